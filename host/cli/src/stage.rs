//! Stages that are processes of their own, as a user would run them.

use std::ffi::OsStr;
use std::path::Path;
use std::process::{Command, Stdio};

/// This `program` with the words of `line`, that answers with one JSON object and says nothing else.
pub(crate) fn stage(program: &Path, line: impl IntoIterator<Item = impl AsRef<OsStr>>) -> Command {
    let mut command = Command::new(program);
    command
        .args(line)
        .args(["-q", "--json"])
        .env_remove("RCG_LOG")
        .stdin(Stdio::null());
    command
}
