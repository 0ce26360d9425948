//! Runs the command and judges how it ended.

use std::ffi::OsStr;
use std::fmt::Debug;
use std::io::{Read as _, Write as _};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use serde_json::Value;

/// No command of these tests needs a tenth of this; one that does hangs.
const HANGS: Duration = Duration::from_mins(2);

/// Whether the long tests are wanted: `./test.sh full`.
pub(crate) fn is_full() -> bool {
    std::env::var_os("RCG_FULL").is_some()
}

/// How a run of the command ended.
#[derive(Debug)]
pub(crate) struct Outcome {
    /// What was run, for messages.
    line: String,
    /// Exit code; `None` after a signal.
    pub(crate) code: Option<i32>,
    pub(crate) stdout: String,
    pub(crate) stderr: String,
}

/// The command, quiet, with nothing from the environment that would make it talk.
pub(crate) fn rcg<S: AsRef<OsStr>>(arguments: &[S]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_rcg"));
    // What an answer looks like does not depend on the rig: the one with fewest projector pixels is quick.
    command
        .args(arguments)
        .arg("-q")
        .env_remove("RCG_LOG")
        // What is made at another time is the same to the bit.
        .env("SOURCE_DATE_EPOCH", "1700000000")
        .env("RCG_RIG", "rcg-1-16bit")
        // Nothing is kept beyond a test, and what is not about calibration does not wait for one.
        .env("RCG_CALIBRATION", "none");
    command
}

/// Runs the command with `stdin` until it ends.
pub(crate) fn run<S: AsRef<OsStr> + Debug>(arguments: &[S], stdin: &str) -> Outcome {
    let mut child = rcg(arguments)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("the command starts");
    let mut input = child.stdin.take().expect("stdin is piped");
    let mut out = child.stdout.take().expect("stdout is piped");
    let mut err = child.stderr.take().expect("stderr is piped");
    let (mut stdout, mut stderr) = (Vec::new(), Vec::new());
    let code = thread::scope(|scope| {
        scope.spawn(move || {
            // A command that does not read its stdin may be gone already.
            input.write_all(stdin.as_bytes()).ok();
        });
        scope.spawn(|| out.read_to_end(&mut stdout).expect("stdout can be read"));
        scope.spawn(|| err.read_to_end(&mut stderr).expect("stderr can be read"));
        wait(&mut child)
    });
    let outcome = Outcome {
        line: format!("rcg {arguments:?}"),
        code,
        stdout: String::from_utf8(stdout).expect("stdout is UTF-8"),
        stderr: String::from_utf8(stderr).expect("stderr is UTF-8"),
    };
    assert!(!outcome.stderr.contains("panicked"), "{outcome:?}");
    outcome
}

/// The exit code of `child`, which is ended and the test with it if it hangs.
pub(crate) fn wait(child: &mut Child) -> Option<i32> {
    let began = Instant::now();
    loop {
        if let Some(status) = child.try_wait().expect("a child can be waited for") {
            return status.code();
        }
        if began.elapsed() > HANGS {
            child.kill().expect("a child can be ended");
            child.wait().expect("a child that was ended ends");
            panic!("the command hangs");
        }
        thread::sleep(Duration::from_millis(1));
    }
}

impl Outcome {
    /// stdout of a run that must have gone well.
    pub(crate) fn done(&self) -> &str {
        assert_eq!(self.code, Some(0), "{self:?}");
        &self.stdout
    }

    /// The one JSON object on stdout of a run that must have gone well.
    pub(crate) fn object(&self) -> Value {
        let value: Value = serde_json::from_str(self.done()).expect("stdout is one JSON value");
        assert!(value.is_object(), "{self:?}");
        value
    }

    /// Checks that the run ended with `code` and one sentence that has all `parts` in it.
    pub(crate) fn complains(&self, code: i32, parts: &[&str]) {
        assert_eq!(self.code, Some(code), "{self:?}");
        let sentence = self.stderr.strip_suffix('\n').expect("stderr ends its line");
        assert!(!sentence.contains('\n'), "more than one line: {self:?}");
        assert!(sentence.starts_with("rcg: "), "{self:?}");
        // Rust's way of writing values is nobody else's.
        for debug in [
            "Some(",
            "Ok(",
            "Err(",
            " { ",
            "found None",
            "expected None",
            "NotFound",
            "Denied",
            "[]",
        ] {
            assert!(!sentence.contains(debug), "`{debug}` in {self:?}");
        }
        for part in parts {
            assert!(
                sentence.contains(part),
                "`{part}` is missing in `{sentence}` of {}",
                self.line
            );
        }
    }
}

/// Runs the command in plain and with `--json`; both times it must end with `code` and one sentence that has all
/// `parts`, and print nothing but the object that says the same.
pub(crate) fn refuses<S: AsRef<OsStr> + Debug>(arguments: &[S], stdin: &str, code: i32, parts: &[&str]) {
    let plain = run(arguments, stdin);
    plain.complains(code, parts);
    assert_eq!(plain.stdout, "", "{plain:?}");

    let mut with_json: Vec<&OsStr> = arguments.iter().map(AsRef::as_ref).collect();
    with_json.push(OsStr::new("--json"));
    let json = run(&with_json, stdin);
    json.complains(code, parts);
    let object: Value = serde_json::from_str(&json.stdout).expect("stdout is one JSON value");
    let sentence = json.stderr.trim_end().trim_start_matches("rcg: ");
    assert_eq!(object, serde_json::json!({ "error": sentence, "exit": code }));
}

/// Arguments of a measurement without noise that takes a fraction of a second.
pub(crate) fn quick(out: &Path) -> Vec<String> {
    let out = text(out);
    let arguments = ["measure", "--out", out, "--step", "15", "--image-size", "16"];
    let rest = ["--noise", "off", "--exposure-ms", "4"];
    arguments.into_iter().chain(rest).map(str::to_owned).collect()
}

/// [`quick`], done.
pub(crate) fn quick_measurement(out: &Path) {
    run(&quick(out), "").done();
}

/// A path as the command takes it.
pub(crate) fn text(path: &Path) -> &str {
    path.to_str().expect("temporary directories have plain names")
}

/// Arguments of every command that makes a directory, with `out`.
pub(crate) fn makers(out: &Path) -> [Vec<String>; 3] {
    let other = |command: &str| {
        let words = [command, "--out", text(out), "--step", "30"];
        words.map(str::to_owned).to_vec()
    };
    let mut plan = other("plan");
    plan.extend(["--image-size", "16", "--exposure-ms", "4"].map(str::to_owned));
    [quick(out), plan, other("patterns")]
}
