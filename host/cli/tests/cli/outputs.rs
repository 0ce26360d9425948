//! Files that commands write: in the format of their name, whole or not at all, and no others touched.

use std::fs;
use std::path::{Path, PathBuf};

use crate::command::{refuses, run, text};
use crate::commands::{Scene, Use, described};
use crate::tree::files;

/// Options that name a file.
const FILES: [&str; 4] = ["--out", "--records", "--residuals", "--csv"];

/// How a file of a format begins.
fn begins(ending: &str) -> &'static [u8] {
    match ending {
        "png" => b"\x89PNG\r\n\x1a\n",
        "svg" => b"<svg",
        "pdf" => b"%PDF-",
        "html" => b"<!doctype html>",
        "csv" => b"",
        "jsonl" => b"{",
        "toml" => b"version",
        "bsdf" => b"tensor_file",
        "npy" => b"\x93NUMPY",
        "ssdd" => b"VERSION",
        "exr" => b"\x76\x2f\x31\x01",
        other => panic!("no command writes {other}"),
    }
}

/// Every use of a command that writes one file below `out`, and where the file's name stands.
fn writers(scene: &Scene, out: &Path) -> Vec<(Use, usize, PathBuf)> {
    let uses = described()
        .into_iter()
        .flat_map(|command| scene.uses(&command.words, out));
    let file = |used: Use| {
        let at = used
            .arguments
            .iter()
            .position(|word| FILES.contains(&word.as_str()))?
            + 1;
        let path = PathBuf::from(&used.arguments[at]);
        // Folders end otherwise.
        let is_file = path != out && path.extension().is_some_and(|ending| ending != "zarr");
        is_file.then_some((used, at, path))
    };
    uses.filter_map(file).collect()
}

/// What has the same formats: words of a command, of exports with the format that they name.
fn kind(used: &Use) -> &[String] {
    let words = if used.arguments[0] == "export" { 3 } else { 2 };
    &used.arguments[..words]
}

fn with(used: &Use, at: usize, path: &Path) -> Vec<String> {
    let mut arguments = used.arguments.clone();
    text(path).clone_into(&mut arguments[at]);
    arguments
}

#[test]
fn a_file_is_of_the_format_that_its_name_says_or_refused_before_any_work() {
    let scene = Scene::new();
    let out = scene.folder().join("out");
    fs::create_dir(&out).unwrap();
    let writers = writers(&scene, &out);
    assert!(writers.len() >= 9, "{writers:?}");
    let endings_of = |used: &Use| -> Vec<String> {
        let same = writers.iter().filter(|(other, ..)| kind(other) == kind(used));
        same.map(|(_, _, path)| path.extension().unwrap().to_str().unwrap().to_owned())
            .collect()
    };
    for (used, at, path) in &writers {
        let ending = path.extension().unwrap().to_str().unwrap();
        for name in [format!("a.{ending}"), format!("b.c.{}", ending.to_uppercase())] {
            let path = out.join(name);
            run(&with(used, *at, &path), used.stdin).done();
            assert!(
                fs::read(&path).unwrap().starts_with(begins(ending)),
                "{}",
                path.display()
            );
        }
        let all = endings_of(used);
        let before = files(&out);
        for wrong in [
            "x.bmp", "x.jpg", "x.jpeg", "x.tiff", "x.pdf", "x.txt", "x.json", "x", "png", ".png", "x.png.gz",
        ] {
            // Charts are written as PDF, too.
            if wrong == "x.pdf" && all.iter().any(|ending| ending == "pdf") {
                continue;
            }
            let path = out.join(wrong);
            let mut parts: Vec<String> = all.iter().map(|ending| format!(".{ending}")).collect();
            parts.extend([
                text(&path).to_owned(),
                "expected a file name that ends in".to_owned(),
            ]);
            let parts: Vec<&str> = parts.iter().map(String::as_str).collect();
            let mut arguments = with(used, *at, &path);
            refuses(&arguments, used.stdin, 2, &parts);
            // Before the material is looked for, too.
            if let Some(material) = arguments
                .iter_mut()
                .find(|word| matches!(word.as_str(), "lambert" | "ward:brass"))
            {
                "no/such/material.bsdf".clone_into(material);
                refuses(&arguments, used.stdin, 2, &parts);
            }
        }
        assert!(files(&out) == before);
    }
}

#[test]
fn no_other_file_is_touched_and_a_failed_write_keeps_the_old_one() {
    let scene = Scene::new();
    let out = scene.folder().join("out");
    for (used, at, path) in writers(&scene, &out) {
        fs::create_dir(&out).unwrap();
        let (stem, name) = (path.file_stem().unwrap(), path.file_name().unwrap());
        let (stem, name) = (stem.to_str().unwrap(), name.to_str().unwrap());
        let neighbours = [
            format!("{stem}.tmp"),
            stem.to_owned(),
            format!("{name}.tmp"),
            format!("{name}.partial"),
            format!(".{name}.partial"),
            format!("{stem}.partial"),
        ];
        for neighbour in &neighbours {
            fs::write(out.join(neighbour), "mine").unwrap();
        }
        run(&used.arguments, used.stdin).done();
        let mut found = files(&out);
        assert!(
            found
                .remove(Path::new(name))
                .is_some_and(|content| content.len() > 4)
        );
        assert_eq!(found.len(), neighbours.len(), "{found:?}");
        assert!(found.values().all(|content| content == b"mine"), "{used:?}");

        // Neither a folder nor a place that is not there.
        let before = files(scene.folder());
        let folder = out.join(format!("folder.{}", path.extension().unwrap().to_str().unwrap()));
        fs::create_dir(&folder).unwrap();
        for place in [&folder, &out.join("none").join(name)] {
            refuses(&with(&used, at, place), used.stdin, 1, &[text(place)]);
        }
        assert!(files(scene.folder()) == before);
        fs::remove_dir_all(&out).unwrap();
    }
}

#[cfg(unix)]
#[test]
fn a_name_that_leads_elsewhere_or_may_not_be_written_is_respected() {
    use std::os::unix::fs::{PermissionsExt as _, symlink};
    let scene = Scene::new();
    let out = scene.folder().join("out");
    fs::create_dir(&out).unwrap();
    for (used, at, path) in writers(&scene, &out) {
        let target = scene.folder().join("target");
        fs::write(&target, "old").unwrap();
        symlink(&target, &path).unwrap();
        run(&used.arguments, used.stdin).done();
        assert!(fs::symlink_metadata(&path).unwrap().is_symlink());
        assert_ne!(fs::read(&target).unwrap(), b"old", "{used:?}");
        fs::remove_file(&path).unwrap();

        fs::write(&path, "old").unwrap();
        fs::set_permissions(&path, fs::Permissions::from_mode(0o444)).unwrap();
        if fs::OpenOptions::new().write(true).open(&path).is_err() {
            refuses(
                &with(&used, at, &path),
                used.stdin,
                1,
                &[text(&path), "ermission denied"],
            );
            assert_eq!(fs::read(&path).unwrap(), b"old");
        }
        fs::remove_file(&path).unwrap();
    }
}
