//! SHA-256 sums in hexadecimal digits, by which contents are compared.

use std::fmt::Write as _;
use std::fs::File;
use std::io::{self, Read as _};
use std::path::{Path, PathBuf};

use rayon::prelude::*;
use serde_json::{Map, Value};
use sha2::{Digest as _, Sha256};

/// SHA-256 of `bytes`.
#[must_use]
pub fn sum(bytes: &[u8]) -> String {
    hex(&Sha256::digest(bytes))
}

/// `bytes` in hexadecimal digits.
pub(crate) fn hex(bytes: &[u8]) -> String {
    bytes.iter().fold(String::new(), |mut text, byte| {
        write!(text, "{byte:02x}").expect("strings take everything");
        text
    })
}

/// SHA-256 of a JSON object as it is written without spaces.
pub(crate) fn sum_of_json(object: &Map<String, Value>) -> String {
    let text = serde_json::to_string(object).expect("JSON values can be written");
    sum(text.as_bytes())
}

/// SHA-256 of all files below the folder `dir`, see [`sum_of_files`]. In a shell:
/// `cd DIR && find . -type f -printf '%P\n' | LC_ALL=C sort | xargs -d '\n' sha256sum | sha256sum`.
pub(crate) fn sum_of_tree(dir: &Path) -> io::Result<String> {
    sum_of_files(dir, &files_below(dir)?)
}

/// The paths of all files below the folder `dir` from there, with `/` on every system, ordered by their bytes.
///
/// # Errors
/// What the system says of a folder that cannot be read.
pub fn files_below(dir: &Path) -> io::Result<Vec<String>> {
    let (mut names, mut folders): (Vec<String>, _) = (Vec::new(), vec![dir.to_owned()]);
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(&folder)? {
            let path = entry?.path();
            if path.is_dir() {
                folders.push(path);
            } else {
                names.push(name_below(dir, &path));
            }
        }
    }
    names.sort_unstable();
    Ok(names)
}

/// SHA-256 of the files of these `names` below the folder `dir`: of one line `SUM  PATH` for each, as `sha256sum` prints it.
///
/// # Errors
/// What the system says of a file that cannot be read.
pub fn sum_of_files(dir: &Path, names: &[String]) -> io::Result<String> {
    let line = |name: &String| Ok(format!("{}  {name}\n", sum_of(&dir.join(name))?));
    let lines: Vec<String> = names.par_iter().map(line).collect::<io::Result<_>>()?;
    Ok(sum(lines.concat().as_bytes()))
}

/// The path from `dir` to `path` below it, with `/` on every system.
fn name_below(dir: &Path, path: &Path) -> String {
    let below: PathBuf = path.strip_prefix(dir).expect("it is below").to_owned();
    let parts = below.components().map(|part| part.as_os_str().to_string_lossy());
    parts.collect::<Vec<_>>().join("/")
}

/// SHA-256 of the file at `path`.
pub(crate) fn sum_of(path: &Path) -> io::Result<String> {
    let (mut file, mut digest) = (File::open(path)?, Sha256::new());
    let mut part = vec![0; 1 << 16];
    loop {
        let length = file.read(&mut part)?;
        if length == 0 {
            return Ok(hex(&digest.finalize()));
        }
        digest.update(&part[..length]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sum_of_a_tree_is_that_of_the_lines_of_sha256sum() {
        let dir = tempfile::tempdir().unwrap();
        std::fs::create_dir(dir.path().join("f")).unwrap();
        for (name, text) in [("f/c.1", "1"), ("f.txt", "2"), ("a", "3")] {
            std::fs::write(dir.path().join(name), text).unwrap();
        }
        let line = |name: &str, text: &str| format!("{}  {name}\n", sum(text.as_bytes()));
        // As bytes: the dot comes before the slash.
        let lines = [line("a", "3"), line("f.txt", "2"), line("f/c.1", "1")].concat();
        assert_eq!(sum_of_tree(dir.path()).unwrap(), sum(lines.as_bytes()));
        std::fs::rename(dir.path().join("a"), dir.path().join("b")).unwrap();
        assert_ne!(sum_of_tree(dir.path()).unwrap(), sum(lines.as_bytes()));
        assert!(sum_of_tree(&dir.path().join("none")).is_err());
    }
}
