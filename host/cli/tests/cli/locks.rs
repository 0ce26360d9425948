//! Two processes at once: one writes, the other is refused in one sentence, and nothing is spoilt.

use std::fs::{self, File};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::thread;
use std::time::Duration;

use crate::command::{is_full, rcg, refuses, run, text, wait};
use crate::tree::{assert_same, copy, files};

/// A measurement whose every stage takes long enough to be met in it.
const SIZE: [&str; 6] = ["--step", "5", "--image-size", "32", "--exposure-ms", "4"];
const ADAPTIVE: [&str; 7] = [
    "--adaptive",
    "--budget",
    "32",
    "--image-size",
    "32",
    "--exposure-ms",
    "4",
];

/// Every command that writes into the measurement `out`.
fn writers(out: &Path) -> [Vec<&str>; 4] {
    let resume = ["measure", "--resume", "--out", text(out)];
    [
        resume.to_vec(),
        [&resume[..], &ADAPTIVE].concat(),
        vec!["capture", text(out)],
        vec!["assemble", text(out)],
    ]
}

fn spawn(arguments: &[&str]) -> Child {
    rcg(arguments)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap()
}

fn signal(child: &Child, name: &str) {
    let line = format!("kill -{name} {}", child.id());
    assert!(Command::new("sh").args(["-c", &line]).status().unwrap().success());
}

/// Starts `arguments` on a copy that `begin` makes and stops the process in its tracks while it writes in `out`.
fn stopped_while_writing(arguments: &[&str], out: &Path, begin: &dyn Fn()) -> Child {
    for _ in 0..50 {
        begin();
        let mut child = spawn(arguments);
        let lock = out.join("write.lock");
        while !lock.exists() && child.try_wait().unwrap().is_none() {
            thread::yield_now();
        }
        if child.try_wait().unwrap().is_some() {
            continue;
        }
        signal(&child, "STOP");
        // Stopped before its end: it holds the lock, unless it had just begun or was about to end.
        let held = File::open(&lock).is_ok_and(|file| file.try_lock().is_err());
        if held && child.try_wait().unwrap().is_none() {
            return child;
        }
        signal(&child, "CONT");
        wait(&mut child);
    }
    panic!("{arguments:?} was never met while it writes");
}

#[test]
fn of_two_writers_one_is_refused_whichever_they_are() {
    let scratch = tempfile::tempdir().unwrap();
    let (planned, captured) = (scratch.path().join("planned"), scratch.path().join("captured"));
    let undisturbed = scratch.path().join("undisturbed");
    run(&[&["plan", "--out", text(&planned)][..], &SIZE].concat(), "").done();
    run(
        &[&["measure", "--out", text(&undisturbed)][..], &SIZE].concat(),
        "",
    )
    .done();
    run(&[&["plan", "--out", text(&captured)][..], &SIZE].concat(), "").done();
    run(&["capture", text(&captured)], "").done();

    let out = scratch.path().join("out");
    let names = ["resume", "adaptive", "capture", "assemble"];
    for (first, name) in names.iter().enumerate().step_by(if is_full() { 1 } else { 3 }) {
        let begin = || {
            fs::remove_dir_all(&out).ok();
            match *name {
                "adaptive" => {}
                "assemble" => copy(&captured, &out),
                _ => copy(&planned, &out),
            }
        };
        let mut one = stopped_while_writing(&writers(&out)[first], &out, &begin);
        let before = files(&out);
        for second in writers(&out) {
            let outcome = run(&second, "");
            if *name == "adaptive" && outcome.code == Some(2) {
                // Not a measurement yet that could be captured or assembled.
                outcome.complains(2, &[text(&out), "expected a measurement"]);
                continue;
            }
            outcome.complains(1, &[text(&out), "process", "writing"]);
        }
        assert!(
            files(&out) == before,
            "{name}: a refused process has changed something"
        );
        // Killed, it leaves its lock file, which locks nobody out.
        one.kill().unwrap();
        one.wait().unwrap();
        assert!(out.join("write.lock").exists(), "{name}");
        let resumed = &writers(&out)[usize::from(*name == "adaptive")];
        run(resumed, "").done();
        assert!(!out.join("write.lock").exists(), "{name}");
        if *name != "adaptive" {
            for part in ["raw.zarr", "brdf.zarr", "figures"] {
                assert_same(&out.join(part), &undisturbed.join(part));
            }
            // One was planned first, the other measured at once: so each says of its first session.
            let manifest = |out: &Path| {
                let content = fs::read(out.join("manifest.json")).unwrap();
                let mut all: serde_json::Value = serde_json::from_slice(&content).unwrap();
                for name in ["first_session", "checksum"] {
                    assert!(all[name].take().is_string(), "{name}");
                }
                all
            };
            assert!(
                manifest(&out) == manifest(&undisturbed),
                "{name}: another manifest"
            );
        }
    }
}

#[test]
fn many_at_once_come_to_what_one_comes_to() {
    let scratch = tempfile::tempdir().unwrap();
    let (alone, together) = (scratch.path().join("alone"), scratch.path().join("together"));
    let size = ["--step", "15", "--image-size", "24", "--exposure-ms", "4"];
    run(&[&["measure", "--out", text(&alone)][..], &size].concat(), "").done();
    let measure = [&["measure", "--resume", "--out", text(&together)][..], &size].concat();
    let mut all: Vec<Child> = (0..4)
        .map(|n| {
            thread::sleep(Duration::from_millis(20 * n));
            spawn(&measure)
        })
        .collect();
    let codes: Vec<_> = all.iter_mut().map(wait).collect();
    assert!(codes.contains(&Some(0)), "{codes:?}");
    assert!(codes.iter().all(|code| matches!(code, Some(0..=2))), "{codes:?}");
    for part in ["raw.zarr", "brdf.zarr", "figures"] {
        assert_same(&together.join(part), &alone.join(part));
    }
}

#[test]
fn an_output_that_is_being_made_is_not_made_twice() {
    let scratch = tempfile::tempdir().unwrap();
    let at = |name: &str| scratch.path().join(name);
    let measurement = at("m");
    let size = ["--step", "30", "--image-size", "16", "--exposure-ms", "4"];
    run(
        &[&["measure", "--out", text(&measurement)][..], &size].concat(),
        "",
    )
    .done();
    let out = at("filled.zarr");
    let fill = ["fill", text(&measurement), "--out", text(&out)];
    let partial = at("filled.zarr.partial");
    fs::create_dir(&partial).unwrap();
    fs::write(partial.join("chunk"), "of another process").unwrap();
    {
        let lock = File::create(at("filled.zarr.lock")).unwrap();
        lock.try_lock().unwrap();
        refuses(&fill, "", 1, &[text(&out), "another process", "writing"]);
        assert!(
            partial.join("chunk").exists(),
            "what another process makes was removed"
        );
    }
    // The other is no more; neither its lock file nor its leftovers are in the way.
    run(&fill, "").done();
    assert!(out.is_dir() && !partial.exists() && !at("filled.zarr.lock").exists());
    for maker in [
        vec!["calibrate", "geometry", "--out"],
        vec!["calibrate", "photometry", "--out"],
        vec!["patterns", "--out"],
    ] {
        let dir = at("held");
        fs::create_dir(&dir).unwrap();
        let lock = File::create(dir.join("write.lock")).unwrap();
        lock.try_lock().unwrap();
        refuses(
            &[&maker[..], &[text(&dir)]].concat(),
            "",
            1,
            &[text(&dir), "writing"],
        );
        fs::remove_dir_all(&dir).unwrap();
    }
}

#[test]
fn readers_are_never_kept_out() {
    let scratch = tempfile::tempdir().unwrap();
    let measurement = scratch.path().join("m");
    let size = ["--step", "30", "--image-size", "16", "--exposure-ms", "4"];
    run(
        &[&["measure", "--out", text(&measurement)][..], &size].concat(),
        "",
    )
    .done();
    let lock = File::create(measurement.join("write.lock")).unwrap();
    lock.try_lock().unwrap();
    let brdf = measurement.join("brdf.zarr");
    run(&["evaluate", text(&brdf)], "").done();
    run(&["value", text(&brdf)], "45 0 30 90\n").done();
    drop(lock);
}
