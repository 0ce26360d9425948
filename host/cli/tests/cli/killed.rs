//! `kill -9` at any moment, then the same command with `--resume`: the same bytes.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::sync::OnceLock;
use std::thread;
use std::time::{Duration, Instant};

use crate::command::{is_full, rcg, run, text};
use crate::tree::{assert_same, count, files};

/// What is waited for comes within a second or two.
const NEVER: Duration = Duration::from_mins(1);

/// A measurement of three segments, with noise, and with faults that make its tally worth a comparison.
fn arguments(out: &Path) -> [&str; 15] {
    [
        "measure",
        "--out",
        text(out),
        "--step",
        "5",
        "--image-size",
        "32",
        "--seed",
        "5",
        "--missed-triggers",
        "0.05",
        "--dropped-frames",
        "0.05",
        "--doubled-frames",
        "0.05",
    ]
}

/// The measurement that nothing has disturbed, made once for all tests, and what was printed of it.
fn undisturbed() -> (&'static Path, &'static str) {
    static MADE: OnceLock<(PathBuf, String)> = OnceLock::new();
    let (out, printed) = MADE.get_or_init(|| {
        let out = Path::new(env!("CARGO_TARGET_TMPDIR")).join("undisturbed");
        fs::remove_dir_all(&out).ok();
        let printed = run(&arguments(&out), "").done().replace(text(&out), "");
        (out, printed)
    });
    (out.as_path(), printed.as_str())
}

/// Measures into `out` (going on with what is there) and kills it once `moment` has come. Returns whether it was
/// killed before its end.
fn kill_at(out: &Path, moment: &dyn Fn(&Path) -> bool) -> bool {
    let mut child = rcg(&arguments(out))
        .arg("--resume")
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let began = Instant::now();
    while !moment(out) {
        if child.try_wait().unwrap().is_some() {
            return false;
        }
        assert!(began.elapsed() < NEVER, "the moment never comes");
        thread::yield_now();
    }
    child.kill().unwrap();
    child.wait().unwrap().code().is_none()
}

/// Goes on to the end; all is as if nothing had happened, the tally too, stored, printed and in the report.
fn resumes(out: &Path) {
    let (expected, printed) = undisturbed();
    let resumed = run(&[&arguments(out)[..], &["--resume"]].concat(), "");
    assert_eq!(resumed.done().replace(text(out), ""), printed);
    assert_same(out, expected);
}

#[test]
fn killed_during_capture_it_goes_on_to_the_same_bytes() {
    let frames = |out: &Path| count(&out.join("raw.zarr/frames"), "c.");
    let mut killed = 0;
    for chunks in if is_full() { 1..3 } else { 1..2 } {
        let scratch = tempfile::tempdir().unwrap();
        let out = scratch.path().join("out");
        if kill_at(&out, &|out| frames(out) >= chunks) {
            killed += 1;
            assert!(!out.join("brdf.zarr").exists());
        }
        resumes(&out);
    }
    assert!(killed > 0, "no run was killed before its end");
}

#[test]
#[cfg(unix)]
fn ctrl_c_says_how_to_go_on_and_loses_nothing() {
    let scratch = tempfile::tempdir().unwrap();
    let out = scratch.path().join("out");
    let child = rcg(&arguments(&out))
        .arg("--resume")
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let began = Instant::now();
    while !out.join("raw.zarr/frames").exists() {
        assert!(began.elapsed() < NEVER, "nothing is captured");
        thread::yield_now();
    }
    let signal = ["-s", "INT", &child.id().to_string()].map(str::to_owned);
    assert!(
        std::process::Command::new("kill")
            .args(signal)
            .status()
            .unwrap()
            .success()
    );
    let ended = child.wait_with_output().unwrap();
    assert_eq!(ended.status.code(), Some(130), "{ended:?}");
    let told = String::from_utf8(ended.stderr).unwrap();
    assert!(
        told.ends_with("rcg: stopped; what was captured is kept: the same command with --resume goes on\n"),
        "{told}"
    );
    resumes(&out);
}

#[test]
fn killed_between_a_segments_records_and_its_frames_it_goes_on_to_the_same_bytes() {
    // Records are written first: one more file of theirs than of frames is a segment in flight.
    let in_flight = |out: &Path| {
        let raw = out.join("raw.zarr");
        let stored = count(&raw.join("frames"), "c.");
        stored >= 1 && count(&raw.join("trigger_tick"), "c.") > stored
    };
    let scratch = tempfile::tempdir().unwrap();
    let out = scratch.path().join("out");
    kill_at(&out, &in_flight);
    resumes(&out);
}

#[test]
fn killed_again_and_again_it_still_comes_to_the_same_bytes() {
    let scratch = tempfile::tempdir().unwrap();
    let out = scratch.path().join("out");
    let mut killed = 0;
    killed += usize::from(kill_at(&out, &|out| out.join("rig.toml").exists()));
    killed += usize::from(kill_at(&out, &|out| out.join("plan.toml").exists()));
    killed += usize::from(kill_at(&out, &|out| out.join("raw.zarr").exists()));
    for chunks in [1, 2] {
        let stored = move |out: &Path| count(&out.join("raw.zarr/frames"), "c.") >= chunks;
        killed += usize::from(kill_at(&out, &stored));
    }
    assert!(killed > 2, "only {killed} runs were killed before their end");
    resumes(&out);
}

#[test]
fn killed_at_any_time_it_still_comes_to_the_same_bytes() {
    let mut chance = std::time::SystemTime::now()
        .duration_since(std::time::UNIX_EPOCH)
        .unwrap()
        .subsec_nanos();
    println!("drawn by {chance}");
    let scratch = tempfile::tempdir().unwrap();
    let out = scratch.path().join("out");
    for _ in 0..6 {
        chance = chance.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        let (began, until) = (Instant::now(), Duration::from_millis(u64::from(chance >> 23)));
        kill_at(&out, &|_| began.elapsed() > until);
    }
    resumes(&out);
}

#[test]
fn killed_during_assembly_it_goes_on_to_the_same_bytes() {
    let mut killed = 0;
    for chunks in if is_full() { vec![0, 8, 20] } else { vec![4] } {
        let scratch = tempfile::tempdir().unwrap();
        let out = scratch.path().join("out");
        let assembling = move |out: &Path| {
            let partial = out.join("brdf.zarr.partial");
            partial.exists() && count(&partial.join("f"), "c.") >= chunks
        };
        if kill_at(&out, &assembling) {
            killed += 1;
        }
        resumes(&out);
    }
    assert!(killed > 0, "no run was killed before its end");
}

#[test]
fn a_finished_measurement_is_resumed_without_a_change() {
    let scratch = tempfile::tempdir().unwrap();
    let out = scratch.path().join("out");
    run(&arguments(&out), "").done();
    let arrays = |name: &str| files(&out.join(name));
    let before = [arrays("raw.zarr"), arrays("brdf.zarr"), arrays("figures")];
    let texts = |name: &str| fs::read_to_string(out.join(name)).unwrap();
    let (rig, plan) = (texts("rig.toml"), texts("plan.toml"));
    resumes(&out);
    // Neither needs its arguments again.
    run(&["measure", "--out", text(&out), "--resume"], "").done();
    let told = run(&["capture", text(&out)], "");
    let (_, printed) = undisturbed();
    let paired = told.done().split(' ').next().unwrap();
    assert!(
        printed.contains(&format!("{paired} paired")),
        "{told:?}, before: {printed}"
    );
    assert!([arrays("raw.zarr"), arrays("brdf.zarr"), arrays("figures")] == before);
    assert_eq!((texts("rig.toml"), texts("plan.toml")), (rig, plan));
}

#[test]
fn resume_of_nothing_begins() {
    let scratch = tempfile::tempdir().unwrap();
    let out = scratch.path().join("out");
    resumes(&out);
}

#[test]
fn a_calibration_that_was_killed_while_it_captured_is_begun_anew() {
    let scratch = tempfile::tempdir().unwrap();
    let out = scratch.path().join("calibration");
    let calibrate = ["calibrate", "geometry", "--image-size", "64", "--out", text(&out)];
    let mut child = rcg(&calibrate)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    // Its frames are there, and nothing says of what.
    while !out.join("geometry.raw.zarr").exists() {
        thread::sleep(Duration::from_millis(5));
    }
    child.kill().unwrap();
    child.wait().unwrap();
    assert!(!out.join("geometry-views.json").exists(), "it came to its end");
    run(&calibrate, "").done();
    let found = fs::read(out.join("geometry.json")).unwrap();
    fs::remove_dir_all(&out).unwrap();
    run(&calibrate, "").done();
    assert!(found == fs::read(out.join("geometry.json")).unwrap());
}
