//! Places that not every machine has: a disk that fills up, as a small file system of its own, a folder that nobody may
//! write into, one whose name is no text. Where there is none, the trial is ignored, and says why.

#![cfg_attr(not(target_os = "linux"), allow(dead_code, unused_imports))]

#[path = "cli/command.rs"]
#[allow(dead_code)]
mod command;
#[path = "cli/commands.rs"]
#[allow(dead_code)]
mod commands;
#[path = "cli/tree.rs"]
#[allow(dead_code)]
mod tree;

use std::fs;
use std::path::Path;
use std::process::{Command, ExitCode};

use libtest_mimic::{Arguments, Completion, Trial};

use crate::command::{is_full, makers, quick, rcg, refuses, run, text};
use crate::commands::{Scene, described};
use crate::tree::{assert_same, files};

/// A file system in memory, gone when it is dropped.
struct SmallDisk {
    at: tempfile::TempDir,
}

impl SmallDisk {
    /// One of `kib` KiB, or how a trial ends that has none.
    fn new(kib: u32) -> Result<Self, Completion> {
        let at = tempfile::tempdir().expect("there is a temporary directory");
        let size = format!("size={kib}k");
        match mount(&["-t", "tmpfs", "-o", &size, "rcg-test", text(at.path())]) {
            Ok(()) => Ok(Self { at }),
            Err(reason) => Err(Completion::ignored_with(format!(
                "no small disk can be mounted: {reason}"
            ))),
        }
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

/// Tries `work` on a disk of `kib` KiB.
fn on_disk(kib: u32, work: impl FnOnce(&SmallDisk)) -> Completion {
    match SmallDisk::new(kib) {
        Ok(disk) => {
            work(&disk);
            Completion::Completed
        }
        Err(ending) => ending,
    }
}

/// Measures onto disks of these sizes; each fails at `stage`, and goes on when there is room.
fn fills_up(sizes_kib: &[u32], stage: &str) -> Completion {
    let scratch = tempfile::tempdir().unwrap();
    let undisturbed = scratch.path().join("out");
    for &kib in sizes_kib {
        let ending = on_disk(kib, |disk| fills_up_one(disk, stage, &undisturbed));
        if !matches!(ending, Completion::Completed) {
            return ending;
        }
    }
    Completion::Completed
}

/// Measures onto the `disk`; `undisturbed` is the same measurement where there is room, made if it is not there.
fn fills_up_one(disk: &SmallDisk, stage: &str, undisturbed: &Path) {
    if !undisturbed.exists() {
        run(&arguments(undisturbed), "").done();
    }
    let out = disk.path().join("out");
    let outcome = run(&arguments(&out), "");
    outcome.complains(1, &[text(&out), stage]);
    assert!(
        outcome.stderr.contains("No space left") || outcome.stderr.contains("disk full"),
        "{outcome:?}"
    );
    assert!(
        !out.join("brdf.zarr").exists(),
        "half a result has the name of a whole one"
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

fn no_command_leaves_half_a_file_on_a_full_disk_or_takes_the_old_one_away(disk: &SmallDisk) {
    use std::io::Write as _;
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

fn a_disk_without_room_for_a_picture_keeps_no_half_of_it(disk: &SmallDisk) {
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

#[cfg(unix)]
fn a_parent_that_may_not_be_written_fails_with_the_path() -> Completion {
    use std::os::unix::fs::PermissionsExt as _;
    let scratch = tempfile::tempdir().unwrap();
    let closed = scratch.path().join("closed");
    fs::create_dir(&closed).unwrap();
    fs::set_permissions(&closed, fs::Permissions::from_mode(0o555)).unwrap();
    if fs::write(closed.join("probe"), "").is_ok() {
        return Completion::ignored_with("this user may write into read-only directories");
    }
    for maker in makers(&closed.join("out")) {
        refuses(&maker, "", 1, &[text(&closed), "ermission denied"]);
    }
    assert!(files(&closed).is_empty());
    fs::set_permissions(&closed, fs::Permissions::from_mode(0o755)).unwrap();
    Completion::Completed
}

#[cfg(unix)]
fn a_folder_whose_own_name_is_no_text_can_be_worked_in() -> Completion {
    use std::os::unix::ffi::OsStringExt as _;
    let folder = tempfile::tempdir().unwrap();
    let odd = folder
        .path()
        .join(std::ffi::OsString::from_vec(b"caf\xe9".to_vec()));
    if fs::create_dir(&odd).is_err() {
        return Completion::ignored_with("this file system takes no such name");
    }
    let done = rcg(&quick(Path::new("m"))).current_dir(&odd).output().unwrap();
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    assert!(odd.join("m/brdf.zarr/zarr.json").is_file());
    Completion::Completed
}

fn main() -> ExitCode {
    let mut trials = Vec::new();
    macro_rules! trials {
        ($($name:ident => $work:expr),* $(,)?) => {
            $(trials.push(Trial::ignorable_test(stringify!($name), || Ok($work)));)*
        };
    }
    #[cfg(unix)]
    trials! {
        a_parent_that_may_not_be_written_fails_with_the_path => a_parent_that_may_not_be_written_fails_with_the_path(),
        a_folder_whose_own_name_is_no_text_can_be_worked_in => a_folder_whose_own_name_is_no_text_can_be_worked_in(),
    }
    #[cfg(target_os = "linux")]
    trials! {
        // In the first segment, and in a later one.
        a_disk_that_fills_up_during_capture => fills_up(&[1024, 4096], "raw.zarr"),
        a_disk_that_fills_up_during_assembly => fills_up(&[9 * 1024, 16 * 1024][..if is_full() { 2 } else { 1 }], "brdf.zarr"),
        // One block is the directory's.
        a_disk_without_room_for_a_plan => fills_up(&[8], ""),
        no_command_leaves_half_a_file_on_a_full_disk_or_takes_the_old_one_away =>
            on_disk(64, no_command_leaves_half_a_file_on_a_full_disk_or_takes_the_old_one_away),
        a_disk_without_room_for_a_picture_keeps_no_half_of_it =>
            on_disk(16, a_disk_without_room_for_a_picture_keeps_no_half_of_it),
    }
    libtest_mimic::run(&Arguments::from_args(), trials).exit_code()
}
