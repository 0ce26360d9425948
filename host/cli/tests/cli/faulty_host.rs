//! What goes wrong with the computer that measures: its disk and its clock.

use std::fs;
use std::path::Path;
use std::process::Stdio;
use std::thread;
use std::time::{Duration, Instant};

use crate::command::{rcg, run, text};
use crate::tree::{assert_same, count, files};

/// Several segments.
const SIZE: [&str; 8] = [
    "--step",
    "5",
    "--image-size",
    "32",
    "--exposure-ms",
    "4",
    "--seed",
    "5",
];
const NEVER: Duration = Duration::from_mins(1);

fn arguments(out: &Path) -> Vec<&str> {
    [&["measure", "--out", text(out)][..], &SIZE].concat()
}

/// On a disk of its own: it fills up, is made larger, becomes read-only and writable again. `$1` to `$4`: the command, where the disk is
/// mounted, where answers go, a small size in kB.
const SCRIPT: &str = r#"
mount -t tmpfs -o size=$4k none "$2" || exit 77
measure() { "$1" -q measure --out "$2/m" --resume --step 5 --image-size 32 --exposure-ms 4 --seed 5 2>"$3" >"$3.out"; }
measure "$1" "$2" "$3/full"; echo $? >"$3/full.code"
mount -o remount,size=200m "$2" || exit 77
measure "$1" "$2" "$3/read-only" & running=$!
while ! ls "$2/m/raw.zarr/frames" 2>/dev/null | grep -q c.; do kill -0 $running 2>/dev/null || break; done
while kill -0 $running 2>/dev/null; do mount -o remount,ro "$2" 2>/dev/null && break; done
wait $running; echo $? >"$3/read-only.code"
mount -o remount,rw "$2" || exit 77
measure "$1" "$2" "$3/resumed"; echo $? >"$3/resumed.code"
cp -r "$2/m" "$3/m"
"#;

#[test]
fn a_disk_that_is_full_or_becomes_read_only_ends_the_run_and_a_resumed_one_completes_it() {
    let scratch = tempfile::tempdir().unwrap();
    let at = |name: &str| scratch.path().join(name);
    fs::create_dir(at("disk")).unwrap();
    fs::create_dir(at("told")).unwrap();
    let mut shell = std::process::Command::new("unshare");
    shell.args(["--map-root-user", "--mount", "sh", "-c", SCRIPT, "sh"]);
    shell.args([
        env!("CARGO_BIN_EXE_rcg"),
        text(&at("disk")),
        text(&at("told")),
        "900",
    ]);
    shell.envs([("SOURCE_DATE_EPOCH", "1700000000"), ("RCG_RIG", "rcg-1-16bit")]);
    let ended = shell
        .stderr(Stdio::null())
        .status()
        .ok()
        .and_then(|status| status.code());
    if ended != Some(0) {
        println!("skipped: nobody may mount a disk here ({ended:?})");
        return;
    }
    let told = |name: &str| fs::read_to_string(at("told").join(name)).unwrap();
    assert_eq!(told("full.code"), "1\n", "{}", told("full"));
    assert!(
        told("full").contains("the disk full") && told("full").lines().count() == 1,
        "{}",
        told("full")
    );
    // The run may be over before the disk is read-only.
    if told("read-only.code") != "0\n" {
        assert_eq!(told("read-only.code"), "1\n", "{}", told("read-only"));
        let said = told("read-only");
        assert!(
            said.to_lowercase().contains("read-only") && said.lines().count() == 1,
            "{said}"
        );
    }
    assert_eq!(told("resumed.code"), "0\n", "{}", told("resumed"));
    let undisturbed = at("undisturbed");
    run(&arguments(&undisturbed), "").done();
    for part in ["raw.zarr", "brdf.zarr", "figures"] {
        assert_same(&at("told").join("m").join(part), &undisturbed.join(part));
    }
}

#[test]
fn a_folder_that_goes_in_mid_run_ends_it_in_a_sentence() {
    let scratch = tempfile::tempdir().unwrap();
    let out = scratch.path().join("out");
    let child = rcg(&arguments(&out))
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let began = Instant::now();
    while count(&out.join("raw.zarr/frames"), "c.") == 0 {
        assert!(began.elapsed() < NEVER, "nothing is captured");
        thread::yield_now();
    }
    while out.exists() {
        fs::remove_dir_all(&out).ok();
    }
    let ended = child.wait_with_output().unwrap();
    let told = String::from_utf8(ended.stderr).unwrap();
    // What could not be written is the host's fault; what is not there when it is read is the input's.
    assert!(matches!(ended.status.code(), Some(1 | 2)), "{told}");
    assert!(told.contains(text(&out)) && told.lines().count() == 1, "{told}");
    // Whatever it wrote before it noticed is no measurement.
    assert!(!out.join("brdf.zarr").exists());
}

#[test]
fn a_clock_that_is_set_back_changes_no_value() {
    let scratch = tempfile::tempdir().unwrap();
    let (steady, set_back) = (scratch.path().join("steady"), scratch.path().join("set-back"));
    run(&arguments(&steady), "").done();
    run(&[&["plan", "--out", text(&set_back)][..], &SIZE].concat(), "").done();
    for (command, epoch) in [("capture", "1699996400"), ("assemble", "1699992800")] {
        let status = rcg(&[command, text(&set_back)])
            .env("SOURCE_DATE_EPOCH", epoch)
            .stdout(Stdio::null())
            .status()
            .unwrap();
        assert!(status.success(), "{command} an hour before");
    }
    assert_same(&set_back.join("raw.zarr"), &steady.join("raw.zarr"));
    let (mut found, mut expected) = (
        files(&set_back.join("brdf.zarr")),
        files(&steady.join("brdf.zarr")),
    );
    // Its lineage says that it was planned first.
    for files in [&mut found, &mut expected] {
        files.remove(Path::new("zarr.json"));
    }
    assert!(found == expected, "values differ");
    let sessions = fs::read_to_string(set_back.join("session.json")).unwrap();
    assert!(sessions.contains("2023-11-14T21:13:20"), "{sessions}");
}
