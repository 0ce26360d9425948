//! A disk that fills up, as a small file system of its own.

use std::path::Path;
use std::process::Command;

use crate::command::{rcg, run, text};
use crate::commands::{Scene, described};
use crate::tree::{assert_same, files};

/// A file system in memory, gone when it is dropped.
struct SmallDisk {
    at: tempfile::TempDir,
}

impl SmallDisk {
    /// One of `kib` KiB, or the reason why there is none.
    fn new(kib: u32) -> Result<Self, String> {
        let at = tempfile::tempdir().map_err(|error| error.to_string())?;
        let size = format!("size={kib}k");
        mount(&["-t", "tmpfs", "-o", &size, "rcg-test", text(at.path())])?;
        Ok(Self { at })
    }

    fn grow(&self) {
        mount(&["-o", "remount,size=256m", text(self.at.path())]).expect("it was mounted before");
    }

    fn path(&self) -> &Path {
        self.at.path()
    }
}

impl Drop for SmallDisk {
    fn drop(&mut self) {
        // Lazily: it goes even if a failed test still holds a file.
        Command::new("umount").arg("-l").arg(self.at.path()).status().ok();
    }
}

fn mount(arguments: &[&str]) -> Result<(), String> {
    let output = Command::new("mount")
        .args(arguments)
        .output()
        .map_err(|error| error.to_string())?;
    if output.status.success() {
        Ok(())
    } else {
        Err(String::from_utf8_lossy(&output.stderr).trim().to_owned())
    }
}

fn arguments(out: &Path) -> [&str; 7] {
    ["measure", "--out", text(out), "--step", "5", "--image-size", "32"]
}

/// Measures onto disks of these sizes; each fails as `parts` say, and goes on when there is room.
fn fills_up(sizes_kib: &[u32], stage: &str) {
    let scratch = tempfile::tempdir().unwrap();
    let undisturbed = scratch.path().join("out");
    for &kib in sizes_kib {
        let disk = match SmallDisk::new(kib) {
            Ok(disk) => disk,
            Err(reason) => {
                println!("skipped: no small disk can be mounted: {reason}");
                return;
            }
        };
        if !undisturbed.exists() {
            run(&arguments(&undisturbed), "").done();
        }
        let out = disk.path().join("out");
        let outcome = run(&arguments(&out), "");
        outcome.complains(1, &[text(&out), stage]);
        assert!(
            outcome.stderr.contains("No space left") || outcome.stderr.contains("disk full"),
            "{kib} KiB: {outcome:?}"
        );
        assert!(
            !out.join("brdf.zarr").exists(),
            "{kib} KiB: half a result has the name of a whole one"
        );
        assert!(!out.join("report.html").exists());
        // Still full: it fails again, no worse.
        let resumed = [&arguments(&out)[..], &["--resume"]].concat();
        run(&resumed, "").complains(1, &[text(&out)]);

        disk.grow();
        run(&resumed, "").done();
        for array in ["raw.zarr", "brdf.zarr"] {
            assert_same(&out.join(array), &undisturbed.join(array));
        }
        assert!(out.join("report.html").is_file());
    }
}

#[test]
fn a_disk_that_fills_up_during_capture() {
    // In the first segment, and in a later one.
    fills_up(&[1024, 4096], "raw.zarr");
}

#[test]
fn a_disk_that_fills_up_during_assembly() {
    fills_up(&[9 * 1024, 16 * 1024], "brdf.zarr");
}

#[test]
fn a_disk_without_room_for_a_plan() {
    // One block is the directory's.
    fills_up(&[8], "");
}

#[test]
fn no_command_leaves_half_a_file_on_a_full_disk_or_takes_the_old_one_away() {
    use std::io::Write as _;
    let disk = match SmallDisk::new(64) {
        Ok(disk) => disk,
        Err(reason) => {
            println!("skipped: no small disk can be mounted: {reason}");
            return;
        }
    };
    // To the last block: a name still fits, but nothing in it.
    let ballast = disk.path().join("ballast");
    let mut file = std::fs::File::create(&ballast).unwrap();
    while file.write(&[0; 4096]).is_ok_and(|written| written > 0) {}
    drop(file);
    let full = files(disk.path());
    let scene = Scene::new();
    let mut failed = 0;
    for command in described() {
        for used in scene.uses(&command.words, disk.path()) {
            let below = |word: &&Path| word.starts_with(disk.path()) && *word != disk.path();
            let Some(path) = used.arguments.iter().map(Path::new).find(below) else {
                continue;
            };
            if path.extension().is_none_or(|ending| ending == "zarr") {
                continue;
            }
            run(&used.arguments, used.stdin).complains(1, &[text(path), "No space left"]);
            assert!(files(disk.path()) == full, "{used:?} left something");
            // An old one that takes no block.
            std::fs::write(path, "").unwrap();
            run(&used.arguments, used.stdin).complains(1, &[text(path), "No space left"]);
            assert_eq!(files(disk.path()).len(), 2, "{used:?}");
            std::fs::remove_file(path).unwrap();
            failed += 1;
        }
    }
    assert!(failed >= 9, "{failed}");
}

#[test]
fn a_disk_without_room_for_a_picture_keeps_no_half_of_it() {
    let disk = match SmallDisk::new(16) {
        Ok(disk) => disk,
        Err(reason) => {
            println!("skipped: no small disk can be mounted: {reason}");
            return;
        }
    };
    let picture = disk.path().join("sphere.png");
    let render = ["render", "ward:brass", "--size", "512", "--out", text(&picture)];
    run(&render, "").complains(1, &[text(&picture), "No space left"]);
    assert!(files(disk.path()).is_empty());
    let patterns = disk.path().join("patterns");
    run(&["patterns", "--step", "15", "--out", text(&patterns)], "").complains(1, &[text(&patterns)]);
    assert!(
        !patterns.join("patterns.csv").exists(),
        "the table says that all are there"
    );
}

#[test]
fn a_terminal_that_takes_nothing_is_an_error() {
    let full = std::fs::OpenOptions::new().write(true).open("/dev/full").unwrap();
    let status = rcg(&["plan"])
        .stdout(full)
        .stderr(std::process::Stdio::null())
        .status()
        .unwrap();
    assert_eq!(status.code(), Some(1));
}
