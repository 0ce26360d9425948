//! `rcg measure --queue`: one sample after the other.
//!
//! # Design
//! Each sample has a directory of its own, which is measured as `rcg measure --out` does it. What is finished there is kept, what was begun goes on: the
//! same command again does what is left, however it ended before. All rows are read and checked before the first is measured.

use std::collections::BTreeSet;
use std::io::{self, IsTerminal as _, Write as _};
use std::path::{Path, PathBuf};

use rcg::base::progress::Progress as _;
use rcg::base::text::{plain, read, shown};
use rcg::instrument::rig::Rig;
use serde::{Deserialize, Serialize};

use crate::Done;
use crate::collection;
use crate::failure::Failure;
use crate::measure::{Args, Finished, measured};
use crate::output::{Output, table};
use crate::request::words;

/// The heading in the help.
const QUEUE: &str = "Many samples";
/// Bytes of the longest name of a directory.
const LONGEST_NAME: usize = 200;
/// Most samples of a queue.
const MOST: usize = 1_000_000;

/// Many samples, one after the other.
#[derive(Clone, Debug, Default, clap::Args)]
pub(crate) struct QueueArgs {
    /// Measure the samples of this list, each into a directory of its name below --out; what is finished there is skipped, what was begun goes on.
    /// A TOML file of tables [[sample]], or a CSV file with a line of names first: name (of the directory), and as the options take
    /// them, if they differ from sample to sample, sample, sample_name, sample_description, rig and plan (as --replay). Of a real instrument each sample is
    /// asked for on stderr: Enter when it is in the holder, `skip`, or `stop`. In a collection each is added when it is done
    #[arg(long, value_name = "FILE", help_heading = QUEUE)]
    queue: Option<PathBuf>,
    /// With --queue: ask for no sample (something else puts them in)
    #[arg(long, help_heading = QUEUE)]
    yes: bool,
}

impl QueueArgs {
    pub(crate) fn file(&self) -> Option<&Path> {
        self.queue.as_deref()
    }

    pub(crate) const fn asks_nothing(&self) -> bool {
        self.yes
    }

    /// Refuses what is nothing without a queue.
    pub(crate) fn check(&self) -> Done {
        if self.yes {
            return Err(Failure::input("--yes: expected --queue beside it, found none"));
        }
        Ok(())
    }
}

/// A sample that is to be measured.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Next {
    /// Of its directory.
    name: String,
    /// What stands in the virtual rig.
    pub(crate) sample: Option<String>,
    pub(crate) sample_name: Option<String>,
    pub(crate) sample_description: Option<String>,
    rig: Option<String>,
    pub(crate) plan: Option<PathBuf>,
}

/// A list of samples as TOML has it.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct List {
    sample: Vec<Next>,
}

/// The columns of a CSV file.
const COLUMNS: [&str; 6] = [
    "name",
    "sample",
    "sample_name",
    "sample_description",
    "rig",
    "plan",
];

fn refused(path: &Path, expected: &str, found: &str) -> Failure {
    let (path, found) = (path.display(), plain(found));
    Failure::input(format!("{path}: expected {expected}, found {found}"))
}

/// The samples of the list at `path`.
fn list(path: &Path) -> Result<Vec<Next>, Failure> {
    let text =
        read(path).map_err(|error| refused(path, "a list of samples (TOML or CSV)", &error.to_string()))?;
    let is_csv = path
        .extension()
        .is_some_and(|ending| ending.eq_ignore_ascii_case("csv"));
    let all = if is_csv {
        of_csv(path, &text)?
    } else {
        let list: List = toml::from_str(&text)
            .map_err(|error| refused(path, "tables [[sample]] with a name", error.message().trim()))?;
        list.sample
    };
    if all.is_empty() || all.len() > MOST {
        return Err(refused(
            path,
            &format!("1 to {MOST} samples"),
            &all.len().to_string(),
        ));
    }
    let mut names = BTreeSet::new();
    for (number, next) in all.iter().enumerate() {
        let at = |field: &str| format!("sample {}: {field}: ", number + 1);
        let name = &next.name;
        let is_plain =
            !name.starts_with('.') && !name.contains(|c: char| c.is_control() || "/\\:".contains(c));
        if name.trim() != name || name.is_empty() || name.len() > LONGEST_NAME || !is_plain {
            let expected = format!(
                "{}the name of a directory (up to {LONGEST_NAME} bytes without / \\ : and no dot first)",
                at("name")
            );
            return Err(refused(path, &expected, &shown(name)));
        }
        if !names.insert(name.to_lowercase()) {
            let expected = format!("{}another than those before", at("name"));
            return Err(refused(path, &expected, &shown(name)));
        }
        for (field, said) in [
            ("sample_name", &next.sample_name),
            ("sample_description", &next.sample_description),
        ] {
            if let Some(said) = said.as_ref().filter(|said| words(said).is_err()) {
                let expected = format!("{}some words on one line", at(field));
                return Err(refused(path, &expected, &shown(said)));
            }
        }
    }
    Ok(all)
}

/// The fields of a line (RFC 4180, but that no field has lines in it).
fn fields(line: &str) -> Option<Vec<String>> {
    let (mut all, mut field, mut is_quoted) = (Vec::new(), String::new(), false);
    let mut rest = line.chars().peekable();
    while let Some(c) = rest.next() {
        match (c, is_quoted) {
            ('"', true) if rest.peek() == Some(&'"') => {
                field.push('"');
                rest.next();
            }
            ('"', true) => is_quoted = false,
            ('"', false) if field.is_empty() => is_quoted = true,
            (',', false) => all.push(std::mem::take(&mut field)),
            (c, _) => field.push(c),
        }
    }
    all.push(field);
    (!is_quoted).then_some(all)
}

fn of_csv(path: &Path, text: &str) -> Result<Vec<Next>, Failure> {
    let lines = text
        .lines()
        .enumerate()
        .filter(|(_, line)| !line.trim().is_empty());
    let mut columns: Option<Vec<String>> = None;
    let mut all = Vec::new();
    for (index, line) in lines {
        let at = |expected: &str| format!("line {}: {expected}", index + 1);
        let fields = fields(line)
            .ok_or_else(|| refused(path, &at("a \" at the end of each quotation"), &shown(line)))?;
        let Some(columns) = &columns else {
            let trimmed: Vec<String> = fields.iter().map(|field| field.trim().to_owned()).collect();
            let is_known = trimmed.iter().all(|name| COLUMNS.contains(&name.as_str()));
            let differ = trimmed.iter().collect::<BTreeSet<_>>().len() == trimmed.len();
            if !is_known || !differ || !trimmed.iter().any(|name| name == COLUMNS[0]) {
                let expected = at(&format!("name, and others of {}, each once", COLUMNS.join(", ")));
                return Err(refused(path, &expected, &shown(line)));
            }
            columns = Some(trimmed);
            continue;
        };
        if fields.len() != columns.len() {
            let expected = at(&format!("{} fields", columns.len()));
            return Err(refused(path, &expected, &fields.len().to_string()));
        }
        let of = |name: &str| {
            let column = columns.iter().position(|column| column == name)?;
            let field = fields[column].trim();
            (!field.is_empty()).then(|| field.to_owned())
        };
        all.push(Next {
            name: of("name").unwrap_or_default(),
            sample: of("sample"),
            sample_name: of("sample_name"),
            sample_description: of("sample_description"),
            rig: of("rig"),
            plan: of("plan").map(PathBuf::from),
        });
    }
    Ok(all)
}

/// What somebody at the instrument says of the next sample.
enum Said {
    Ready,
    Skip,
    Stop,
}

/// Asks for the sample `next`, which is the `number`-th of `of`.
fn ask(next: &Next, number: usize, of: usize, output: &Output) -> Said {
    let called = next.sample_name.as_ref().unwrap_or(&next.name);
    let question = format!(
        "sample {number} of {of}: {}; put it in, then Enter ('skip' to leave it out, 'stop' to go on another day) ",
        plain(called)
    );
    loop {
        let mut voice = io::stderr().lock();
        // Asked with --quiet too: nobody could answer else. A reader of stderr that has gone is no reason to fail.
        write!(voice, "{question}").ok();
        // Whoever reads lines gets whole ones.
        if !io::stdin().is_terminal() {
            writeln!(voice).ok();
        }
        voice.flush().ok();
        drop(voice);
        let mut line = String::new();
        match io::stdin().read_line(&mut line) {
            Ok(0) | Err(_) => return Said::Stop,
            Ok(_) => output.log(&format!("{called}: {}", shown(line.trim()))),
        }
        match line.trim() {
            "" => return Said::Ready,
            "skip" => return Said::Skip,
            "stop" => return Said::Stop,
            _ => {}
        }
    }
}

/// What came of all.
#[derive(Debug, Default, Serialize)]
struct Answer {
    out: PathBuf,
    measured: Vec<String>,
    /// Finished before.
    kept: usize,
    /// As somebody said.
    skipped: Vec<String>,
    /// Left for another day.
    left: usize,
    /// Of those that were measured, with their names.
    warnings: Vec<String>,
}

pub(crate) fn run(args: &Args, file: &Path, named: &str, output: &Output) -> Done {
    let all = list(file)?;
    let rigs = all
        .iter()
        .map(|next| Rig::load(next.rig.as_deref().unwrap_or(named)));
    let rigs = rigs.collect::<Result<Vec<_>, _>>()?;
    let is_collection = collection::is_at(args.folder());
    collection::check(is_collection)?;
    let mut answer = Answer {
        out: args.folder().to_owned(),
        ..Answer::default()
    };
    for (index, (next, rig)) in all.iter().zip(&rigs).enumerate() {
        let dir = args.folder().join(&next.name);
        let one = args.of(next, &dir);
        let is_asked = rig.is_real() && !args.asks_nothing() && !one.is_finished();
        let said = if is_asked {
            ask(next, index + 1, all.len(), output)
        } else {
            Said::Ready
        };
        match said {
            Said::Ready => {}
            Said::Skip => {
                answer.skipped.push(next.name.clone());
                continue;
            }
            Said::Stop => {
                answer.left = all.len() - index;
                break;
            }
        }
        output.remark(&format!("sample {} of {}: {}", index + 1, all.len(), next.name));
        let at = |failure: Failure| failure.at(dir.display());
        match measured(&one, next.rig.as_deref().unwrap_or(named), Finished::Kept, output).map_err(at)? {
            None => answer.kept += 1,
            Some(done) => {
                let told = done
                    .warnings()
                    .iter()
                    .map(|warning| format!("{}: {warning}", next.name));
                answer.warnings.extend(told);
                answer.measured.push(next.name.clone());
            }
        }
        if is_collection {
            collection::take(args.folder(), &dir, output).map_err(at)?;
        }
    }
    output.print(&answer, || {
        table(&[
            ("measured", answer.measured.len().to_string()),
            ("finished before", answer.kept.to_string()),
            ("skipped", answer.skipped.len().to_string()),
            ("left", answer.left.to_string()),
        ])
    })?;
    output.warn(&answer.warnings);
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fields_are_what_stands_between_commas_outside_of_quotations() {
        assert_eq!(fields("a,,\"b, \"\"c\"\"\"").unwrap(), ["a", "", "b, \"c\""]);
        assert_eq!(fields("a,\"b"), None);
    }
}
