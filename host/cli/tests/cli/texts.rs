//! Text as other systems and programs write it: byte order marks, line ends, encodings, files without end.

use std::fs;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::Stdio;

use crate::command::{quick, quick_measurement, rcg, refuses, run, text};

/// Kinds of files of text, and the use of a command that reads one.
type Command = Box<dyn Fn(&Path) -> Vec<String>>;

fn readers(folder: &Path) -> Vec<(&'static str, Vec<u8>, Command)> {
    let measured = folder.join("measured");
    quick_measurement(&measured);
    let truth = folder.join("truth.toml");
    run(&["truth", "--out", text(&truth)], "").done();
    let words = |words: &[&str]| words.iter().map(|&word| word.to_owned()).collect::<Vec<_>>();
    let plan = move |option: &str, file: &Path| words(&["plan", "--image-size", "16", option, text(file)]);
    let out: PathBuf = folder.join("out");
    let replayed = out.clone();
    let read = |path: &Path| fs::read(path).unwrap();
    vec![
        (
            "rig",
            read(&measured.join("rig.toml")),
            Box::new(move |file| plan("--rig", file)),
        ),
        (
            "grid",
            b"# list\n40 0\n50 90\n\n60 180 # last\n".to_vec(),
            Box::new(move |file| plan("--grid", file)),
        ),
        (
            "truth",
            read(&truth),
            Box::new(move |file| {
                let more = ["--truth".to_owned(), text(file).to_owned()];
                [quick(&out), more.to_vec()].concat()
            }),
        ),
        (
            "plan",
            read(&measured.join("plan.toml")),
            Box::new(move |file| words(&["measure", "--out", text(&replayed), "--replay", text(file)])),
        ),
    ]
}

fn utf16(content: &[u8], big_endian: bool) -> Vec<u8> {
    let content = std::str::from_utf8(content).unwrap();
    let units = std::iter::once(0xfeff).chain(content.encode_utf16());
    units
        .flat_map(|unit: u16| {
            if big_endian {
                unit.to_be_bytes()
            } else {
                unit.to_le_bytes()
            }
        })
        .collect()
}

fn crlf(content: &[u8]) -> Vec<u8> {
    String::from_utf8(content.to_vec())
        .unwrap()
        .replace('\n', "\r\n")
        .into_bytes()
}

#[test]
fn every_file_of_text_is_read_as_any_system_writes_it() {
    let folder = tempfile::tempdir().unwrap();
    let mark = b"\xef\xbb\xbf".as_slice();
    for (kind, content, command) in readers(folder.path()) {
        // Its name is part of some answers.
        let file = folder.path().join(format!("a-{kind}"));
        let out = folder.path().join("out");
        let answer = |bytes: &[u8]| {
            fs::write(&file, bytes).unwrap();
            let outcome = run(&command(&file), "");
            let brdf = out
                .join("brdf.zarr")
                .is_dir()
                .then(|| crate::tree::values(&out.join("brdf.zarr")));
            fs::remove_dir_all(&out).ok();
            (outcome, brdf)
        };
        let (plain, plain_brdf) = answer(&content);
        plain.done();
        for bytes in [
            [mark, &content].concat(),
            crlf(&content),
            [mark, &crlf(&content)].concat(),
        ] {
            let (outcome, brdf) = answer(&bytes);
            outcome.done();
            assert!(
                plain_brdf.is_some() || outcome.stdout == plain.stdout,
                "{kind}: {outcome:?}"
            );
            assert!(brdf == plain_brdf, "{kind}");
        }
        for big_endian in [false, true] {
            fs::write(&file, utf16(&content, big_endian)).unwrap();
            refuses(
                &command(&file),
                "",
                2,
                &[text(&file), "UTF-16", "save it as UTF-8"],
            );
        }
        fs::write(&file, [&content[..], b"\n\xff\n"].concat()).unwrap();
        refuses(&command(&file), "", 2, &[text(&file), "no UTF-8"]);
        refuses(&command(folder.path()), "", 2, &[text(folder.path())]);
        #[cfg(unix)]
        refuses(
            &command(Path::new("/dev/zero")),
            "",
            2,
            &["/dev/zero", "a file of more than"],
        );
        assert!(!out.exists());
    }
}

/// What the command answers to bytes on stdin: exit code, stdout, stderr.
fn answer(arguments: &[&str], stdin: &[u8]) -> (Option<i32>, String, String) {
    let mut child = rcg(arguments)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    child.stdin.take().unwrap().write_all(stdin).unwrap();
    let output = child.wait_with_output().unwrap();
    let text = |bytes| String::from_utf8(bytes).unwrap();
    (output.status.code(), text(output.stdout), text(output.stderr))
}

#[test]
fn lines_on_stdin_are_read_as_any_system_writes_them() {
    for (arguments, lines) in [
        (&["map"][..], "# first\n45 20\n50 30\n"),
        (&["value", "ward:brass"], "45 20 40 200\n\n50 30 20 10\n"),
    ] {
        let plain = answer(arguments, lines.as_bytes());
        assert_eq!(plain.0, Some(0));
        let mark = "\u{feff}";
        for variant in [
            format!("{mark}{lines}"),
            lines.replace('\n', "\r\n"),
            format!("{mark}{}", lines.replace('\n', "\r\n")),
            // Before a number too.
            format!("{mark}{}", lines.trim_start_matches("# first\n")),
        ] {
            assert_eq!(answer(arguments, variant.as_bytes()), plain, "{variant:?}");
        }
        for big_endian in [false, true] {
            let (code, stdout, stderr) = answer(arguments, &utf16(lines.as_bytes(), big_endian));
            assert_eq!((code, stdout.as_str()), (Some(2), ""));
            assert!(
                stderr.starts_with("rcg: stdin, line 1: expected") && stderr.contains("UTF-16"),
                "{stderr}"
            );
        }
    }
}

#[cfg(unix)]
#[test]
fn a_line_without_end_is_refused_before_it_fills_memory() {
    for arguments in [&["map"][..], &["value", "lambert"]] {
        let zero = fs::File::open("/dev/zero").unwrap();
        let output = rcg(arguments).stdin(zero).output().unwrap();
        assert_eq!(output.status.code(), Some(2));
        let stderr = String::from_utf8(output.stderr).unwrap();
        assert!(
            stderr.contains("stdin, line 1") && stderr.contains("a line of more than"),
            "{stderr}"
        );
    }
}
