//! Laws of the source text: rooms of the library know only those before them, and messages are made of words and
//! numbers with their units, not of Rust's way of writing values.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

/// In the order of the table at the top of the library.
const ROOMS: [&str; 13] = [
    "base",
    "hemisphere",
    "store",
    "instrument",
    "brdf",
    "plan",
    "capture",
    "virtual_rig",
    "judge",
    "calibrate",
    "assemble",
    "measure",
    "study",
];

/// Source text under `folder` of this package by its path, without the tests, which stand last and may do what they
/// like.
fn sources(folder: &str) -> BTreeMap<PathBuf, String> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join(folder);
    let mut found = BTreeMap::new();
    let mut folders = vec![root.clone()];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(&folder).expect("a folder can be listed") {
            let path = entry.expect("a folder can be listed").path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|ending| ending == "rs") {
                let source = fs::read_to_string(&path).expect("a source can be read");
                let source = source.split("#[cfg(test)]\nmod ").next().expect("a first part");
                let name = path.strip_prefix(&root).expect("it is under the root");
                found.insert(name.to_owned(), source.to_owned());
            }
        }
    }
    found.retain(|name, _| {
        let parts = name.components().map(|part| part.as_os_str().to_string_lossy());
        !parts.into_iter().any(|part| part.starts_with("tests"))
    });
    found
}

/// The library.
fn library() -> BTreeMap<PathBuf, String> {
    let found = sources("src");
    assert!(found.len() > 100, "{}", found.len());
    found
}

#[test]
fn every_room_imports_from_those_before_it_only() {
    let mut arrows = BTreeSet::new();
    for (name, source) in library() {
        let room = name.components().next().unwrap().as_os_str().to_string_lossy();
        let Some(at) = ROOMS.iter().position(|one| *one == room) else {
            assert!(room == "lib.rs", "{room} is no room");
            continue;
        };
        // Comments may point anywhere.
        let code = source.lines().filter(|line| !line.trim_start().starts_with("//"));
        for part in code.flat_map(|line| line.split("crate::").skip(1)) {
            let other = part
                .split(|c: char| !c.is_alphanumeric() && c != '_')
                .next()
                .unwrap();
            let place = ROOMS.iter().position(|one| *one == other);
            let place = place.unwrap_or_else(|| panic!("{}: crate::{part}", name.display()));
            assert!(place <= at, "{}: {room} imports from {other}", name.display());
            if place < at {
                arrows.insert((at, place));
            }
        }
    }
    assert!(arrows.len() > 40, "{}", arrows.len());
}

#[test]
fn no_message_is_made_with_the_format_of_debugging() {
    let command = sources("cli/src");
    assert!(command.len() > 20, "{}", command.len());
    let python = sources("python/src");
    assert!(python.len() > 5, "{}", python.len());
    for (name, source) in library().into_iter().chain(command).chain(python) {
        for (index, line) in source.lines().enumerate() {
            let is_debug = |(at, _)| {
                let inside = line[..at].rsplit('{').next().unwrap();
                inside.ends_with('?') && inside.contains(':') && !inside.contains(' ')
            };
            assert!(
                !line.match_indices('}').any(is_debug),
                "{}, line {}: {line}",
                name.display(),
                index + 1
            );
        }
    }
}
