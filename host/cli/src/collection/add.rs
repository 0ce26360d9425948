//! `rcg collection init` and `rcg collection add`

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use rcg::capture::directory::Measurement;
use rcg::judge::fit::Model;
use serde::Serialize;
use serde_json::json;

use super::catalogue::{Catalogue, Row, text_of};
use super::content::Content;
use super::entry::{finished, row};
use super::{Add, Init};
use crate::Done;
use crate::failure::Failure;
use crate::fit::Kind;
use crate::output::{Output, table};

/// Folders below a collection are looked into so deep: a folder for each series, and one for each day in it, are enough for people.
const DEPTH: usize = 8;

pub(super) fn init(args: &Init, output: &Output) -> Done {
    let path = Catalogue::create(&args.dir)?;
    let answer = json!({ "collection": args.dir, "catalogue": path });
    output.print(&answer, || table(&[("catalogue", path.display().to_string())]))
}

/// What came of a measurement.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Taken {
    Added,
    Changed,
    Unchanged,
}

/// What came of all.
#[derive(Debug, Default, Serialize)]
struct Answer {
    added: Vec<String>,
    changed: Vec<String>,
    unchanged: usize,
    /// Not finished yet, in sentences; only where all below the folder are asked for.
    unfinished: Vec<String>,
}

/// A collection that is added to.
struct Adding<'a> {
    /// Its folder, however it was named.
    dir: PathBuf,
    catalogue: Catalogue,
    known: BTreeMap<String, Row>,
    model: Model,
    output: &'a Output,
}

impl<'a> Adding<'a> {
    fn open(dir: &Path, model: Kind, output: &'a Output) -> Result<Self, Failure> {
        let catalogue = Catalogue::open(dir, true)?;
        let known = catalogue.all()?;
        let known = known
            .into_iter()
            .map(|row| (text_of(&row, "path").to_owned(), row));
        Ok(Self {
            dir: resolved(dir)?,
            known: known.collect(),
            catalogue,
            model: model.into(),
            output,
        })
    }

    /// The path of `measurement` below the folder.
    fn below(&self, measurement: &Path) -> Result<String, Failure> {
        let found = resolved(measurement)?;
        let below = found.strip_prefix(&self.dir).ok();
        let below = below
            .filter(|below| !below.as_os_str().is_empty())
            .and_then(Path::to_str);
        below.map(|below| below.replace('\\', "/")).ok_or_else(|| {
            Failure::input(format!(
                "{}: expected a measurement below the folder of the collection {}, found one elsewhere (or a name that is no UTF-8)",
                measurement.display(),
                self.dir.display()
            ))
        })
    }

    fn take(&self, measurement: &Measurement) -> Result<(String, Taken), Failure> {
        let path = self.below(measurement.dir())?;
        let result = measurement.path("brdf.zarr");
        let content = Content::of(&result)?;
        let before = self.known.get(&path);
        if before.is_some_and(|row| text_of(row, "stamp") == content.stamp) {
            return Ok((path, Taken::Unchanged));
        }
        let row = row(measurement, &path, &content, self.model, self.output)?;
        self.catalogue.put(&row)?;
        let is_same = before.map(|before| text_of(before, "sha256") == text_of(&row, "sha256"));
        let taken = match is_same {
            None => Taken::Added,
            Some(true) => Taken::Unchanged,
            Some(false) => Taken::Changed,
        };
        Ok((path, taken))
    }
}

/// The place without links and dots.
fn resolved(path: &Path) -> Result<PathBuf, Failure> {
    path.canonicalize().map_err(|error| {
        Failure::input(format!(
            "{}: expected a folder, found none: {error}",
            path.display()
        ))
    })
}

/// The directories of measurements below `dir`, in the order of their names.
pub(super) fn measurements_below(dir: &Path) -> Vec<PathBuf> {
    let (mut found, mut open) = (Vec::new(), vec![(dir.to_owned(), 0)]);
    while let Some((folder, depth)) = open.pop() {
        if Measurement::exists(&folder) {
            found.push(folder);
        } else if depth < DEPTH {
            let entries = fs::read_dir(&folder).into_iter().flatten().flatten();
            let folders = entries.filter(|entry| entry.file_type().is_ok_and(|kind| kind.is_dir()));
            open.extend(folders.map(|entry| (entry.path(), depth + 1)));
        }
    }
    found.sort_unstable();
    found
}

pub(super) fn run(args: &Add, output: &Output) -> Done {
    let adding = Adding::open(&args.dir, args.model, output)?;
    let is_all = args.measurements.is_empty();
    let asked = if is_all {
        measurements_below(&args.dir)
    } else {
        args.measurements.clone()
    };
    let mut answer = Answer::default();
    for dir in &asked {
        let measurement = match finished(dir) {
            Ok(measurement) => measurement,
            Err(Failure::Input(why)) if is_all => {
                answer.unfinished.push(why.to_string());
                continue;
            }
            Err(failure) => return Err(failure.at(dir.display())),
        };
        let taken = adding.take(&measurement);
        match taken.map_err(|failure| failure.at(dir.display()))? {
            (path, Taken::Added) => answer.added.push(path),
            (path, Taken::Changed) => answer.changed.push(path),
            (_, Taken::Unchanged) => answer.unchanged += 1,
        }
    }
    output.print(&answer, || {
        table(&[
            ("added", answer.added.len().to_string()),
            ("changed", answer.changed.len().to_string()),
            ("unchanged", answer.unchanged.to_string()),
            ("not finished", answer.unfinished.len().to_string()),
        ])
    })?;
    output.warn(&answer.unfinished);
    Ok(())
}

/// Adds one that is finished, without a word.
pub(super) fn take(dir: &Path, measurement: &Path, output: &Output) -> Done {
    Adding::open(dir, Kind::Ggx, output)?.take(&finished(measurement)?)?;
    Ok(())
}
