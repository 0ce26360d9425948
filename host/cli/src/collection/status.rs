//! `rcg collection status`

use std::collections::BTreeSet;

use serde::Serialize;

use super::Status;
use super::add::measurements_below;
use super::catalogue::{Catalogue, Row, text_of};
use super::content::Content;
use crate::Done;
use crate::failure::Failure;
use crate::output::{Output, table};

/// What there is.
#[derive(Debug, Default, Serialize)]
struct Answer {
    /// In the catalogue, and as it says.
    done: usize,
    /// In the catalogue, but no longer in the folder.
    missing: Vec<String>,
    /// Whose result has changed since.
    stale: Vec<String>,
    /// In the folder, but not in the catalogue.
    not_added: Vec<String>,
}

/// How a row stands to what is in the folder.
enum State {
    Done,
    Missing,
    Stale,
}

fn state(args: &Status, row: &Row) -> Result<State, Failure> {
    let result = args.dir.join(text_of(row, "path")).join("brdf.zarr");
    if !result.is_dir() {
        return Ok(State::Missing);
    }
    let content = Content::of(&result)?;
    let is_same = if !args.verify && content.stamp == text_of(row, "stamp") {
        true
    } else {
        content.sum()? == text_of(row, "sha256")
    };
    Ok(if is_same { State::Done } else { State::Stale })
}

pub(super) fn run(args: &Status, output: &Output) -> Done {
    let rows = Catalogue::open(&args.dir, false)?.all()?;
    let mut answer = Answer::default();
    let mut known = BTreeSet::new();
    for row in &rows {
        let path = text_of(row, "path").to_owned();
        known.insert(args.dir.join(&path));
        match state(args, row)? {
            State::Done => answer.done += 1,
            State::Missing => answer.missing.push(path),
            State::Stale => answer.stale.push(path),
        }
    }
    let there = measurements_below(&args.dir);
    let new = there.iter().filter(|dir| !known.contains(*dir));
    let below = |dir: &std::path::PathBuf| dir.strip_prefix(&args.dir).unwrap_or(dir).display().to_string();
    answer.not_added = new.map(below).collect();
    output.print(&answer, || {
        let listed = |paths: &[String]| match paths {
            [] => "0".to_owned(),
            _ => format!("{}: {}", paths.len(), paths.join(", ")),
        };
        table(&[
            ("done", answer.done.to_string()),
            ("missing", listed(&answer.missing)),
            ("stale", listed(&answer.stale)),
            ("not added", listed(&answer.not_added)),
        ])
    })
}
