//! A share of a result, made by a process of its own, and the whole that is made of all shares.
//!
//! # Design
//! Part K of N of a result `OUT` is the K-th of N runs of chunks; it stands in `OUT.parts/K-of-N.zarr`, which is whole or not there, with the
//! sums of each chunk beside its values. So parts may be made in any order, at the same time, on several machines that share a disk, and again.
//! Whoever puts them together reads no frame but the black ones: it checks that all parts are there and of the same frames, plan and
//! calibration as it would make itself, copies their chunks and adds their sums up in the order of the chunks, as one process does.
//!
//! A part holds the lock of the result together with others; who makes the whole has it alone.
//!
//! # Tradeoffs
//! Each part looks at the black frames for itself. Of code patterns each shares out all blocks, so that parts of these save no time.

use std::fs;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use serde::{Deserialize, Serialize};
use serde_json::json;

use super::{AssembleError, Assembled};
use crate::brdf::PART;
use crate::brdf::budget::BudgetSums;
use crate::store::lock::Lock;
use crate::store::whole_file::write_whole;
use crate::store::{BrdfReader, BrdfWriter, StoreError, with_suffix};

/// Beside the values of a part: the sums of its chunks.
const SUMS: &str = "sums.json";

/// Part `number`, from 1 on, of `of`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Part {
    number: usize,
    of: usize,
}

/// What is made of a result.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Share {
    /// All of it.
    #[default]
    Whole,
    /// One part.
    Part(Part),
    /// The whole, of parts that were made before.
    Finish,
}

/// What was written of a chunk.
#[derive(Clone, Debug)]
pub(super) struct Written {
    pub(super) chunk: usize,
    /// Whether it has anything; an absent chunk means missing.
    pub(super) is_there: bool,
    pub(super) counts: Assembled,
    pub(super) budget: BudgetSums,
}

impl Written {
    /// Of a chunk that has nothing.
    pub(super) fn nothing(chunk: usize) -> Self {
        Self {
            chunk,
            is_there: false,
            counts: Assembled::default(),
            budget: BudgetSums::default(),
        }
    }
}

/// As it stands in the file; real numbers by their bits, which no way of writing them changes.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Sums {
    chunk: usize,
    is_there: bool,
    directions: usize,
    frames: usize,
    measured: u64,
    saturated: u64,
    budget: Vec<u64>,
}

/// The sums over chunks, in their order.
pub(super) fn sum(written: &[Written]) -> (Assembled, BudgetSums) {
    let (mut total, mut budget) = (Assembled::default(), BudgetSums::default());
    for one in written {
        total.add(&one.counts);
        budget.merge(&one.budget);
    }
    (total, budget)
}

impl FromStr for Part {
    type Err = String;

    /// `K/N`, from `1/N` to `N/N`.
    fn from_str(text: &str) -> Result<Self, String> {
        let refused = || "expected K/N with 1 ≤ K ≤ N ≤ 1000000, such as 3/8".to_owned();
        let (number, of) = text.split_once('/').ok_or_else(refused)?;
        let (number, of) = (number.parse(), of.parse());
        match (number, of) {
            (Ok(number), Ok(of)) if 1 <= number && number <= of && of <= 1_000_000 => Ok(Self { number, of }),
            _ => Err(refused()),
        }
    }
}

impl std::fmt::Display for Part {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} of {}", self.number, self.of)
    }
}

impl Part {
    /// Its place beside the result `out`.
    fn path(self, out: &Path) -> Result<PathBuf, StoreError> {
        Ok(folder(out)?.join(format!("{}-of-{}.zarr", self.number, self.of)))
    }

    /// Gives the file of the `writer`, which holds what was `written`, its name.
    pub(super) fn finish(self, mut writer: BrdfWriter, written: &[Written]) -> Result<(), AssembleError> {
        let sums: Vec<Sums> = written.iter().map(Sums::of).collect();
        let text = serde_json::to_string(&sums).expect("JSON values can be written");
        let path = writer.partial_path().join(SUMS);
        write_whole(&path, text.as_bytes()).map_err(|error| StoreError::io(&path, "write", error.source))?;
        writer.state(PART, json!([self.number, self.of]))?;
        Ok(writer.finish()?)
    }
}

impl Share {
    /// Begins it of the result `out`: where it is written, and the lock that keeps who makes the whole away from who makes parts.
    pub(super) fn begin(self, out: &Path) -> Result<(PathBuf, Option<Lock>), AssembleError> {
        match self {
            Self::Part(part) => Ok((part.path(out)?, Some(Lock::output_together(out)?))),
            Self::Whole | Self::Finish => Ok((out.to_owned(), None)),
        }
    }

    /// Which of so many chunks it has.
    pub(super) const fn chunks(self, chunks: usize) -> Range<usize> {
        match self {
            Self::Part(Part { number, of }) => chunks * (number - 1) / of..chunks * number / of,
            Self::Whole => 0..chunks,
            Self::Finish => 0..0,
        }
    }
}

impl Sums {
    fn of(written: &Written) -> Self {
        let Assembled {
            directions,
            frames,
            measured,
            saturated,
            dynamic_range: _,
        } = written.counts;
        Self {
            chunk: written.chunk,
            is_there: written.is_there,
            directions,
            frames,
            measured,
            saturated,
            budget: written.budget.to_bits(),
        }
    }

    fn written(&self) -> Option<Written> {
        let Self {
            chunk,
            is_there,
            directions,
            frames,
            measured,
            saturated,
            ref budget,
        } = *self;
        Some(Written {
            chunk,
            is_there,
            counts: Assembled {
                directions,
                frames,
                measured,
                saturated,
                dynamic_range: None,
            },
            budget: BudgetSums::from_bits(budget)?,
        })
    }
}

/// The folder of the parts of `out`.
fn folder(out: &Path) -> Result<PathBuf, StoreError> {
    with_suffix(out, ".parts")
}

/// How many parts the result `out` has by the names of those that are there.
fn number_of_parts(out: &Path) -> Result<usize, StoreError> {
    let folder = folder(out)?;
    let refused = |found: String| StoreError::NotAGroup {
        path: folder.clone(),
        expected: "all parts of one number, made with --part K/N".to_owned(),
        found,
    };
    let entries = fs::read_dir(&folder).map_err(|_| refused("no such folder".to_owned()))?;
    let mut numbers: Vec<usize> = entries
        .flatten()
        .filter_map(|entry| {
            let name = entry.file_name().into_string().ok()?;
            name.strip_suffix(".zarr")?.split_once("-of-")?.1.parse().ok()
        })
        .collect();
    numbers.sort_unstable();
    numbers.dedup();
    match numbers[..] {
        [] => Err(refused("none".to_owned())),
        [of] => Ok(of),
        [one, other, ..] => Err(refused(format!(
            "some of {one} and some of {other}: remove those that are not wanted"
        ))),
    }
}

/// Copies what the parts of the result `out` hold to its `writer`.
pub(super) fn gather(out: &Path, writer: &BrdfWriter) -> Result<Vec<Written>, AssembleError> {
    let of = number_of_parts(out)?;
    let mut all = Vec::new();
    for number in 1..=of {
        let part = Part { number, of };
        let path = part.path(out)?;
        let refused = |expected: String, found: String| StoreError::NotAGroup {
            path: path.clone(),
            expected,
            found,
        };
        let reader = BrdfReader::open(&path)?;
        reader.check_attributes(&path)?;
        if reader.layout() != writer.layout() || !writer.is_of_same_origin(&reader, PART) {
            let expected = "a part of the same frames, plan, calibration and program".to_owned();
            return Err(refused(expected, "one of others: make it again".to_owned()).into());
        }
        let sums = path.join(SUMS);
        let bytes = fs::read(&sums).map_err(|error| StoreError::io(&sums, "read", error))?;
        let written: Option<Vec<Written>> = serde_json::from_slice::<Vec<Sums>>(&bytes)
            .ok()
            .and_then(|sums| sums.iter().map(Sums::written).collect());
        let chunks = Share::Part(part).chunks(reader.chunks());
        let is_of_chunks = |written: &Vec<Written>| written.iter().map(|one| one.chunk).eq(chunks.clone());
        let Some(written) = written.filter(is_of_chunks) else {
            let expected = format!("the sums of its {} chunks in {SUMS}", chunks.len());
            return Err(refused(expected, "something else: make the part again".to_owned()).into());
        };
        for one in &written {
            if one.is_there != reader.chunk_is_present(one.chunk) {
                let expected = format!("chunk {} as {SUMS} says", one.chunk);
                return Err(refused(expected, "another: make the part again".to_owned()).into());
            }
            if one.is_there {
                writer.write_chunk(one.chunk, &reader.read_chunk(one.chunk)?)?;
            }
        }
        all.extend(written);
    }
    Ok(all)
}

/// Removes the parts of the result `out`, which is whole.
pub(super) fn remove(out: &Path) -> Result<(), AssembleError> {
    let folder = folder(out)?;
    Ok(fs::remove_dir_all(&folder).map_err(|error| StoreError::io(&folder, "remove", error))?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_have_every_chunk_once_however_many_there_are() {
        for chunks in [0, 1, 2, 7, 32, 313] {
            for of in 1..=40 {
                let parts = (1..=of).flat_map(|number| Share::Part(Part { number, of }).chunks(chunks));
                assert!(parts.eq(0..chunks), "{chunks} in {of}");
            }
        }
    }

    #[test]
    fn what_is_no_part_is_refused() {
        assert_eq!("3/8".parse(), Ok(Part { number: 3, of: 8 }));
        for text in ["", "3", "0/8", "9/8", "-1/8", "1/0", "a/b", "1/8/9", "1/1000001"] {
            assert!(text.parse::<Part>().is_err(), "{text}");
        }
    }
}
