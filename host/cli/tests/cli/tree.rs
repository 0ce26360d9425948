//! Directory trees as values.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

/// The file of a measurement that grows with every command; what stands in it is not compared.
const LOG: &str = "log.txt";

/// Content of every file under `root` by its relative path.
pub(crate) fn files(root: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut found = BTreeMap::new();
    let mut folders = vec![root.to_owned()];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(&folder).expect("a folder can be listed") {
            let path = entry.expect("a folder can be listed").path();
            if path.is_dir() {
                folders.push(path);
            } else {
                let name = path.strip_prefix(root).expect("it is under the root");
                let mut content = fs::read(&path).expect("a file can be read");
                if name.ends_with(LOG) {
                    content.clear();
                }
                found.insert(name.to_owned(), content);
            }
        }
    }
    found
}

/// Checks that both trees have the same files with the same bytes.
pub(crate) fn assert_same(found: &Path, expected: &Path) {
    let (found_files, expected_files) = (files(found), files(expected));
    let names = |files: &BTreeMap<PathBuf, Vec<u8>>| files.keys().cloned().collect::<Vec<_>>();
    assert_eq!(names(&found_files), names(&expected_files), "{}", found.display());
    for (name, bytes) in &expected_files {
        assert!(
            found_files[name] == *bytes,
            "{} differs from the undisturbed one",
            found.join(name).display()
        );
    }
}

/// The files of a `brdf.zarr` without its lineage, which says of which files and captures it is.
pub(crate) fn values(brdf: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut files = files(brdf);
    let group = files.get_mut(Path::new("zarr.json")).expect("a group");
    let mut object: serde_json::Value = serde_json::from_slice(group).expect("JSON");
    let attributes = object["attributes"].as_object_mut().expect("attributes");
    attributes.shift_remove("rcg_checksum");
    assert!(attributes.shift_remove("lineage").is_some(), "{}", brdf.display());
    *group = object.to_string().into_bytes();
    files
}

/// Checks that two `brdf.zarr` are the same but for their lineage.
pub(crate) fn assert_same_values(found: &Path, expected: &Path) {
    assert!(
        values(found) == values(expected),
        "{} has other values",
        found.display()
    );
}

/// Copies the files under `from` to `to`; that of the log is empty there.
pub(crate) fn copy(from: &Path, to: &Path) {
    for (name, content) in files(from) {
        let path = to.join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, content).unwrap();
    }
}

/// Number of files in `folder` whose name starts with `prefix`; 0 if there is no such folder.
pub(crate) fn count(folder: &Path, prefix: &str) -> usize {
    let starts = |entry: &fs::DirEntry| entry.file_name().to_string_lossy().starts_with(prefix);
    fs::read_dir(folder).map_or(0, |entries| entries.flatten().filter(starts).count())
}
