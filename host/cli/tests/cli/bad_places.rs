//! Outputs that cannot be where they were asked for.

use std::fs;
use std::path::Path;

use crate::command::{makers, quick, quick_measurement, refuses, run, text};
use crate::tree::files;

#[test]
fn a_directory_with_files_in_it_is_refused_and_stays_as_it_is() {
    let scratch = tempfile::tempdir().unwrap();
    fs::write(scratch.path().join("thesis.tex"), "all of it").unwrap();
    let before = files(scratch.path());
    for maker in makers(scratch.path()) {
        let parts = [
            text(scratch.path()),
            "expected a new or empty directory",
            "found one with files",
        ];
        refuses(&maker, "", 2, &parts);
    }
    // Not even with --resume: there is nothing to go on with.
    let mut resumed = quick(scratch.path());
    resumed.push("--resume".to_owned());
    refuses(&resumed, "", 2, &[text(scratch.path()), "expected", "found"]);
    assert_eq!(files(scratch.path()), before);
}

#[test]
fn a_measurement_is_not_begun_twice_without_resume() {
    let scratch = tempfile::tempdir().unwrap();
    let out = scratch.path().join("out");
    quick_measurement(&out);
    let before = files(&out);
    for maker in makers(&out) {
        refuses(
            &maker,
            "",
            2,
            &[text(&out), "expected", "found a measurement", "--resume"],
        );
    }
    assert!(files(&out) == before);
}

#[test]
fn a_file_where_the_directory_should_be_is_refused() {
    let scratch = tempfile::tempdir().unwrap();
    let out = scratch.path().join("notes.txt");
    fs::write(&out, "mine").unwrap();
    for maker in makers(&out) {
        refuses(
            &maker,
            "",
            2,
            &[text(&out), "expected a new or empty directory", "found a file"],
        );
    }
    for maker in makers(&out.join("below")) {
        refuses(&maker, "", 1, &[text(&out)]);
    }
    assert_eq!(fs::read_to_string(&out).unwrap(), "mine");
}

#[test]
#[cfg(unix)]
fn a_link_that_leads_nowhere_is_named() {
    let scratch = tempfile::tempdir().unwrap();
    let link = scratch.path().join("link");
    std::os::unix::fs::symlink("gone", &link).unwrap();
    for out in [link.clone(), link.join("below")] {
        let mut all = makers(&out).to_vec();
        all.extend(["geometry", "photometry"].map(|what| {
            let words = ["calibrate", what, "--out", text(&out)];
            words.map(str::to_owned).to_vec()
        }));
        for maker in all {
            refuses(&maker, "", 2, &[text(&link), "expected", "leads nowhere"]);
        }
    }
}

#[test]
fn an_empty_name_is_refused() {
    for maker in makers(Path::new("")) {
        refuses(&maker, "", 2, &["--out"]);
    }
}

#[test]
#[cfg(target_os = "linux")]
fn a_parent_in_which_nothing_can_be_made_fails_with_the_path() {
    for maker in makers(Path::new("/proc/rcg-measurement")) {
        refuses(&maker, "", 1, &["/proc/rcg-measurement"]);
    }
    refuses(
        &["render", "lambert", "--size", "8", "--out", "/proc/sphere.png"],
        "",
        1,
        &["/proc/sphere.png"],
    );
}

#[test]
fn a_picture_in_a_directory_that_does_not_exist_fails_with_the_path() {
    let scratch = tempfile::tempdir().unwrap();
    let picture = scratch.path().join("none/sphere.png");
    refuses(
        &["render", "lambert", "--size", "8", "--out", text(&picture)],
        "",
        1,
        &[text(&picture)],
    );
    assert!(files(scratch.path()).is_empty());
}

#[test]
fn a_measurement_is_resumed_only_as_what_it_is() {
    let scratch = tempfile::tempdir().unwrap();
    let out = scratch.path().join("out");
    quick_measurement(&out);
    let before = files(&out);
    for (name, value, parts) in [
        ("--step", "30", ["grid", "θ × φ grid of 15°", "θ × φ grid of 30°"]),
        ("--sample", "lambert:0.5", ["sample", "ward:brass", "lambert:0.5"]),
        ("--seed", "2", ["seed", "1", "2"]),
        ("--image-size", "32", ["image-size", "16", "32"]),
        ("--noise", "on", ["noise", "off", "on"]),
        ("--exposure-ms", "5", ["exposure-ms", "4 ms", "5 ms"]),
        ("--spot", "2", ["spot", "that of the rig", "2°"]),
        ("--rig", "rcg-2", ["rig", "rcg-1-16bit", "rcg-2"]),
    ] {
        let arguments = ["measure", "--out", text(&out), "--resume", name, value];
        let [field, expected, found] = parts;
        let (expected, found) = (format!("expected {expected}"), format!("found {found}"));
        let field = format!("{field}: ");
        refuses(&arguments, "", 2, &[text(&out), &field, &expected, &found]);
    }
    assert!(files(&out) == before);
}

#[test]
fn what_a_measurement_leaves_that_ended_before_its_plan_is_resumed() {
    let scratch = tempfile::tempdir().unwrap();
    let out = scratch.path().join("out");
    fs::create_dir(&out).unwrap();
    fs::write(out.join("rig.toml"), "half a ri").unwrap();
    fs::write(out.join("plan.tmp"), "half a pl").unwrap();
    refuses(&quick(&out), "", 2, &[text(&out), "found one with files"]);
    let mut resumed = quick(&out);
    resumed.push("--resume".to_owned());
    run(&resumed, "").done();
    assert!(out.join("report.html").is_file());
}
