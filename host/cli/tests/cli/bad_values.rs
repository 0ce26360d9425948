//! Values that no option of any command takes.

use std::ffi::{OsStr, OsString};
use std::fs;
use std::path::Path;

use crate::command::{Outcome, is_full, run};
use crate::commands::{Scene, described};
use crate::tree::files;

/// Options that name what is written: any text can be such a name.
const WRITTEN: [&str; 1] = ["--out"];

/// Whether the option `name` of the command that `words` call names what is written.
fn is_written(words: &[String], name: &str) -> bool {
    // That of `export` names a format.
    WRITTEN.contains(&name) || name == "--to" && words[0] == "camera"
}

/// Values, and whether a file or folder that is written could bear them for a name.
fn values() -> Vec<(OsString, bool)> {
    let text = |value: &str| (OsString::from(value), true);
    let mut values: Vec<(OsString, bool)> = [
        "nan",
        "inf",
        "-inf",
        "1e400",
        "-1e400",
        "1e-400x",
        "\u{1b}[31m\r\n7\u{7}",
    ]
    .map(text)
    .to_vec();
    values.push((OsString::new(), false));
    values.push((OsString::from("7".repeat(100_000)), false));
    #[cfg(unix)]
    {
        use std::os::unix::ffi::OsStringExt as _;
        values.push((OsString::from_vec(b"caf\xe9".to_vec()), false));
    }
    if !is_full() {
        // Every other one, the odd ones at the end among them.
        values.reverse();
        values = values.into_iter().step_by(2).collect();
    }
    values
}

/// Options that take any words.
const WORDS: [&str; 5] = [
    "--sample-name",
    "--sample-description",
    "--operator",
    "--note",
    "--device",
];

fn is_words(value: &OsString) -> bool {
    value
        .to_str()
        .is_some_and(|text| !text.is_empty() && text.len() < 1000 && !text.contains(char::is_control))
}

/// One short sentence that no terminal obeys.
fn is_plain(outcome: &Outcome, what: &[OsString]) {
    let what: Vec<_> = what
        .iter()
        .map(|word| word.to_string_lossy().chars().take(60).collect::<String>())
        .collect();
    assert!(
        matches!(outcome.code, Some(1 | 2)),
        "{what:?} ended with {:?}: {:.300} {:.300}",
        outcome.code,
        outcome.stdout,
        outcome.stderr
    );
    outcome.complains(outcome.code.unwrap(), &[]);
    let sentence = outcome.stderr.trim_end_matches('\n');
    assert!(!sentence.contains(char::is_control), "{what:?}: {sentence:?}");
    assert!(
        sentence.chars().count() <= 1100,
        "{what:?}: {} characters",
        sentence.len()
    );
    assert_eq!(outcome.stdout, "", "{what:?}");
}

#[test]
fn every_option_of_every_command_refuses_what_is_no_value_and_leaves_nothing() {
    let scene = Scene::new();
    let before = files(scene.folder());
    let out = scene.folder().join("out");
    let mut refused = 0;
    for command in described() {
        let used = scene.uses(&command.words, &out).into_iter().next();
        let (words, stdin) = used.map_or_else(
            || (command.words.clone(), ""),
            |used| (used.arguments, used.stdin),
        );
        for option in &command.options {
            for (value, can_be_written) in values() {
                if can_be_written && is_written(&command.words, &option.name)
                    || is_words(&value) && WORDS.contains(&option.name.as_str())
                {
                    continue;
                }
                let mut arguments: Vec<OsString> = words.iter().map(OsString::from).collect();
                if let Some(at) = arguments
                    .iter()
                    .position(|argument| argument == OsStr::new(&option.name))
                {
                    arguments.drain(at..at + 2);
                }
                arguments.extend([OsString::from(&option.name), value.clone()]);
                // Files have a folder, directories make theirs.
                let makes = !words.iter().any(|word| Path::new(word).parent() == Some(&out));
                if !makes {
                    fs::create_dir_all(&out).unwrap();
                }
                let outcome = run(&arguments, stdin);
                is_plain(&outcome, &arguments);
                // What the system takes for no name of a file is its failure; everything else is the user's input.
                let is_long = value.len() > 1000;
                assert!(
                    is_long || outcome.code == Some(2),
                    "{arguments:?}: {}",
                    outcome.stderr
                );
                if makes {
                    assert!(!out.exists(), "{arguments:?} left something");
                } else {
                    // Empty, or this fails.
                    fs::remove_dir(&out).unwrap();
                }
                refused += 1;
            }
        }
    }
    assert!(files(scene.folder()) == before);
    assert!(refused > if is_full() { 500 } else { 300 }, "{refused}");
}

#[test]
fn no_argument_in_any_place_is_obeyed_by_the_terminal() {
    let evil = "\u{1b}]0;title\u{7}\r\u{202e}";
    for arguments in [
        &["value", evil][..],
        &["evaluate", evil],
        &["fill", evil, "--out", "x"],
        &["capture", evil],
        &["assemble", evil],
        &[evil],
        &["plan", evil],
        &["plan", &format!("--{evil}")],
        &["controller", "info", "--port", evil],
    ] {
        let outcome = run(arguments, "");
        is_plain(
            &outcome,
            &arguments.iter().map(OsString::from).collect::<Vec<_>>(),
        );
        assert!(!outcome.stderr.contains('\u{202e}'), "{}", outcome.stderr);
    }
}
