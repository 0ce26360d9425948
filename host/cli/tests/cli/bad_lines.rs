//! Lines on stdin that are not what `map` and `value` read.

use crate::command::{refuses, run};

#[test]
fn a_bad_line_is_named_and_the_answers_before_it_are_printed() {
    for (bad, shown) in [
        ("45", "45"),
        ("45 0 0", "45 0 0"),
        ("45 east", "45 east"),
        ("nan 0", "nan 0"),
        ("inf 0", "inf 0"),
        ("45 1e400", "45 1e400"),
        ("45\r0", "45\\r0"),
        ("45 0\u{1b}[31m", "45 0\\u{1b}[31m"),
        ("45\0 0", "45\\u{0} 0"),
    ] {
        let lines = format!("# a remark\n45 0\n\n50 10\n{bad}\n60 0\n");
        let outcome = run(&["map"], &lines);
        outcome.complains(
            2,
            &["stdin, line 5", "expected 2 numbers", &format!("found `{shown}`")],
        );
        assert_eq!(outcome.stdout, run(&["map"], "45 0\n50 10\n").done());
    }
    let outcome = run(&["value", "ward:brass"], "30 0 30 180\n30 0 30\n30 0 30 180\n");
    outcome.complains(2, &["stdin, line 2", "expected 4 numbers", "found `30 0 30`"]);
    assert_eq!(
        outcome.stdout,
        run(&["value", "ward:brass"], "30 0 30 180\n").done()
    );
}

#[test]
fn an_angle_that_is_none_is_refused() {
    for (line, limit) in [
        ("181 0", 180),
        ("-1e300 0", 180),
        ("45 3601", 3600),
        ("45 -1e18", 3600),
    ] {
        let limit = format!("from -{limit} to {limit} degrees");
        refuses(&["map"], line, 2, &["stdin, line 1", &limit, "found"]);
        refuses(
            &["value", "lambert"],
            &format!("45 0 {line}"),
            2,
            &["stdin, line 1", &limit],
        );
    }
    run(&["map"], "-45 -720\n").done();
}

#[test]
fn a_line_as_long_as_a_file_is_named_in_a_short_sentence() {
    for line in [
        "7".repeat(1 << 20),
        "45 0 ".repeat(200_000),
        "\u{1b}".repeat(50_000),
    ] {
        let outcome = run(&["map"], &format!("45 0\n{line}\n"));
        outcome.complains(2, &["stdin, line 2", "expected 2 numbers"]);
        assert!(outcome.stderr.len() < 400, "{}", outcome.stderr.len());
        assert!(!outcome.stderr.contains('\u{1b}'));
    }
}

#[test]
fn with_json_only_the_complaint_is_printed() {
    refuses(
        &["map"],
        "forty five\n",
        2,
        &["stdin, line 1", "expected", "found"],
    );
    refuses(
        &["value", "ward:brass"],
        "1 2 3 4 5\n",
        2,
        &["stdin, line 1", "expected", "found"],
    );
}

#[test]
fn a_line_that_is_no_text_is_refused() {
    use std::io::Write as _;
    use std::process::Stdio;
    let mut child = crate::command::rcg(&["map"])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    child
        .stdin
        .take()
        .unwrap()
        .write_all(b"45 0\n\xff\xfe 3\n")
        .unwrap();
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(2));
    let stderr = String::from_utf8(output.stderr).unwrap();
    assert!(
        stderr.starts_with("rcg: stdin, line 2: expected 2 numbers"),
        "{stderr}"
    );
    assert_eq!(stderr.lines().count(), 1);
    assert_eq!(
        String::from_utf8(output.stdout).unwrap(),
        run(&["map"], "45 0\n").done()
    );
}

#[test]
fn remarks_may_follow_numbers() {
    assert_eq!(
        run(&["map"], "45\t0 # up\n").done(),
        run(&["map"], "45 0\n").done()
    );
}

#[test]
fn no_lines_are_no_answers() {
    assert_eq!(run(&["map"], "").done(), "");
    assert_eq!(run(&["map"], "\n# nothing\n").done(), "");
    assert_eq!(
        run(&["map", "--json"], "").object()["directions"],
        serde_json::json!([])
    );
    assert_eq!(
        run(&["map"], "45 0").done(),
        run(&["map"], "45 0\n").done(),
        "the last line may be open"
    );
}

#[test]
fn an_image_size_out_of_range_is_refused() {
    for size in ["0", "100000"] {
        let found = format!("found `{size}`");
        refuses(
            &["map", "--image-size", size],
            "45 0\n",
            2,
            &["--image-size", "expected", &found],
        );
    }
}
