//! A reader that goes away is no failure.

use std::io::{BufRead as _, BufReader, Write as _};
use std::process::Stdio;

use crate::command::{quick, rcg, run, wait};

/// Exit code of the command when nobody reads its stdout.
fn unread(arguments: &[&str]) -> Option<i32> {
    let (reader, writer) = std::io::pipe().unwrap();
    drop(reader);
    let mut child = rcg(arguments)
        .stdin(Stdio::null())
        .stdout(writer)
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let code = wait(&mut child);
    let stderr = std::io::read_to_string(child.stderr.take().unwrap()).unwrap();
    assert_eq!(stderr, "", "{arguments:?}");
    code
}

#[test]
fn output_that_nobody_reads_ends_well() {
    for arguments in [
        &["plan"][..],
        &["plan", "--json"],
        &["map", "--json"],
        &["value", "lambert", "--json"],
        &["controller", "info", "--port", "sim"],
        &["controller", "run", "--port", "sim", "--json"],
        &["controller", "bench", "--port", "sim", "--count", "10"],
        &["--help"],
        &["--version"],
    ] {
        assert_eq!(unread(arguments), Some(0), "{arguments:?}");
    }
}

#[test]
fn the_first_line_is_enough() {
    for (arguments, line) in [
        (&["map"][..], "45 20\n"),
        (&["value", "ward:brass"], "45 20 40 200\n"),
    ] {
        let mut child = rcg(arguments)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut stdin = child.stdin.take().unwrap();
        let mut stdout = BufReader::new(child.stdout.take().unwrap());
        // More than pipes hold, so that the command has to notice.
        let lines = line.repeat(400_000);
        let code = std::thread::scope(|scope| {
            // Its reader goes away too.
            scope.spawn(move || stdin.write_all(lines.as_bytes()).ok());
            let mut first = String::new();
            stdout.read_line(&mut first).unwrap();
            assert_eq!(first, run(arguments, line).done());
            drop(stdout);
            wait(&mut child)
        });
        assert_eq!(code, Some(0), "{arguments:?}");
        assert_eq!(std::io::read_to_string(child.stderr.take().unwrap()).unwrap(), "");
    }
}

#[test]
fn remarks_that_nobody_reads_stop_nothing() {
    let scratch = tempfile::tempdir().unwrap();
    let out = scratch.path().join("out");
    let (reader, writer) = std::io::pipe().unwrap();
    drop(reader);
    let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_rcg"));
    // Neither quiet nor at a loss for words.
    command
        .args(quick(&out))
        .env("RCG_CALIBRATION", "none")
        .args(["-vv", "--missed-triggers", "0.05"]);
    let mut child = command
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(writer)
        .spawn()
        .unwrap();
    assert_eq!(wait(&mut child), Some(0));
    assert!(out.join("report.html").is_file());

    let (reader, writer) = std::io::pipe().unwrap();
    drop(reader);
    let mut child = rcg(&["plan", "--step", "7"])
        .stdin(Stdio::null())
        .stderr(writer)
        .spawn()
        .unwrap();
    assert_eq!(wait(&mut child), Some(2), "the exit code is told all the same");
}

#[cfg(target_os = "linux")]
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
