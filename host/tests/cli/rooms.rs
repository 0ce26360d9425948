//! The rooms of the library know only those before them.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

use crate::tree::files;

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

#[test]
fn every_room_imports_from_those_before_it_only() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut arrows = BTreeSet::new();
    for name in files(&root).into_keys() {
        let room = name.components().next().unwrap().as_os_str().to_string_lossy();
        let Some(at) = ROOMS.iter().position(|one| *one == room) else {
            assert!(room == "bin" || room == "lib.rs", "{room} is no room");
            continue;
        };
        if name.extension().is_none_or(|ending| ending != "rs") || name.ends_with("tests.rs") {
            continue;
        }
        let source = fs::read_to_string(root.join(&name)).unwrap();
        // Tests stand last, and may use what they like; comments may point anywhere.
        let source = source.split("#[cfg(test)]\nmod ").next().unwrap();
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
