//! How light is made: one direction per pattern, or codes that light many at once.
//!
//! # Design
//! Black projector pixels shine in every exposure, however many spots are lit; where they shine brighter than a spot, their
//! photon noise rules, and light that is shared out again afterwards has less of it. The directions that can be lit are split
//! into [`Blocks`]; each block is shown in the patterns of its [`Code`], and what each of its *cells* would have shown alone
//! is computed from these ([`demultiplex()`]). `complement` shows each pattern inverted too, right behind it: cells that were lit
//! are black and those that were black are lit. What drifts slowly drops out of the difference of the two.
//!
//! A block's patterns follow in an order that scatters the code's rows over time: in their own order, rows that change once
//! or twice within a block would take its drift for light of one cell. The cells too are scattered over the code's columns: in
//! the order of their directions some rows would light the steep half of a block, and saturate long before all others.
//!
//! # Tradeoffs
//! The variance of a cell is 2/(n+1)·(2L + Σx) with L the light of black pixels and Σx that of the block's cells, where
//! inverted patterns halve it for twice the exposures: in the same time both codes are alike. A leak that is the same in all
//! exposures of a block is left with a share of 2/(n+1) by both. So inverted patterns pay against drift alone.

pub mod cells;
pub mod code;
pub mod demultiplex;

use std::fmt;
use std::ops::Range;
use std::str::FromStr;

use serde::de::{Error as _, Unexpected};
use serde::{Deserialize, Deserializer, Serialize};

use crate::plan::pattern::LitSet;

pub use cells::{Blocks, CellError};
pub use code::{Code, CodeError};
pub use demultiplex::demultiplex;

/// Orders that are tried where none is asked for.
pub const ORDERS: [usize; 7] = [3, 7, 15, 31, 63, 127, 255];
/// The order where none is asked for is that for so many times the light of a spot by all black pixels: a projector of
/// contrast 1,500 : 1 and a spot of 1° at normal incidence.
const USUAL_BLACK: f64 = 9.0;
/// Rows of a code that are this far apart follow each other in time; it shares no factor with any order.
const SCATTER: usize = 97;
/// What light is written as.
const EXPECTED: &str = "`single`, `multiplexed`, `complement` or `auto`, with the most directions that are lit in one block \
                        behind the middle two if need be, from 2 to 4095 (`multiplexed:63`)";

/// How light is made, as it is asked for. With codes goes the largest number of cells of a block, if that is given.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(into = "String")]
pub enum Light {
    /// One incident direction per pattern.
    #[default]
    Single,
    /// Code patterns.
    Multiplexed(Option<usize>),
    /// Code patterns, each of them inverted too.
    Complement(Option<usize>),
    /// What a pilot capture finds to leave the least noise in the same time.
    Auto,
}

impl FromStr for Light {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || format!("expected {EXPECTED}");
        let (kind, order) = text
            .split_once(':')
            .map_or((text, None), |(kind, n)| (kind, Some(n)));
        let order = order
            .map(|order| {
                let number = order.parse().ok();
                number
                    .filter(|n| (2..=code::MAX_CELLS).contains(n))
                    .ok_or_else(wrong)
            })
            .transpose()?;
        match (kind, order) {
            ("single", None) => Ok(Self::Single),
            ("auto", None) => Ok(Self::Auto),
            ("multiplexed", order) => Ok(Self::Multiplexed(order)),
            ("complement", order) => Ok(Self::Complement(order)),
            _ => Err(wrong()),
        }
    }
}

impl fmt::Display for Light {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Single => f.write_str("single"),
            Self::Auto => f.write_str("auto"),
            Self::Multiplexed(None) => f.write_str("multiplexed"),
            Self::Complement(None) => f.write_str("complement"),
            Self::Multiplexed(Some(order)) => write!(f, "multiplexed:{order}"),
            Self::Complement(Some(order)) => write!(f, "complement:{order}"),
        }
    }
}

impl<'de> Deserialize<'de> for Light {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let text = String::deserialize(deserializer)?;
        text.parse()
            .map_err(|_| D::Error::invalid_value(Unexpected::Str(&text), &EXPECTED))
    }
}

impl From<Light> for String {
    fn from(light: Light) -> Self {
        light.to_string()
    }
}

impl Light {
    /// Whether it is one direction per pattern.
    #[must_use]
    #[allow(clippy::trivially_copy_pass_by_ref)] // serde wants it so
    pub fn is_single(&self) -> bool {
        *self == Self::Single
    }

    /// The code for directions of which each lights what is in `cells`; `None` for single ones, and where a pilot capture is
    /// to choose. Orders that are not given have no more than `most` cells: what frames of a block may fill.
    ///
    /// # Errors
    /// [`CellError`] if the order that is given cannot be used, or none can be.
    pub fn coding(self, cells: &[LitSet], most: usize) -> Result<Option<Coding>, CellError> {
        let (order, complement) = match self {
            Self::Single | Self::Auto => return Ok(None),
            Self::Multiplexed(order) => (order, false),
            Self::Complement(order) => (order, true),
        };
        if let Some(order) = order {
            if order > most {
                return Err(CellError::TooLarge { most, order });
            }
            cells::disjoint_blocks(cells, order)?;
            return Ok(Some(Coding { order, complement }));
        }
        let tried = usable(cells, most);
        let best = tried
            .iter()
            .flatten()
            .min_by(|a, b| cost(a.1, USUAL_BLACK).total_cmp(&cost(b.1, USUAL_BLACK)));
        match (best, tried.first()) {
            (Some((order, _)), _) => Ok(Some(Coding {
                order: *order,
                complement,
            })),
            (None, Some(Err(error))) => Err(*error),
            (None, _) => Err(CellError::TooFew {
                directions: cells.len(),
                order: ORDERS[0],
            }),
        }
    }
}

/// The orders of [`ORDERS`] up to `most` with their blocks of `cells`, or why there are none.
pub(crate) fn usable(cells: &[LitSet], most: usize) -> Vec<Result<(usize, Blocks), CellError>> {
    let fits = ORDERS.into_iter().filter(|order| *order <= most.max(ORDERS[0]));
    fits.map(|order| {
        // A few directions are one block, in the smallest code that they fit.
        let order = if order <= cells.len() { order } else { cells.len() };
        cells::disjoint_blocks(cells, order).map(|blocks| (order, blocks))
    })
    .collect()
}

/// Variance × exposures of spots that all show the signal 1 where black pixels show `black`.
fn cost(blocks: Blocks, black: f64) -> f64 {
    let code = blocks.code(0);
    blocks.exposures() as f64 * code.variance_of_cells(code.cells() as f64, black, 1.0)
}

/// The code of a plan.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Coding {
    /// Most cells of a block.
    pub order: usize,
    /// Whether each pattern is shown inverted too, right behind it.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub complement: bool,
}

impl fmt::Display for Coding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.light().fmt(f)
    }
}

impl Coding {
    /// What asks for it.
    #[must_use]
    pub const fn light(self) -> Light {
        if self.complement {
            Light::Complement(Some(self.order))
        } else {
            Light::Multiplexed(Some(self.order))
        }
    }

    /// The code patterns for so many `directions` that can be lit.
    ///
    /// # Errors
    /// As [`Blocks::new`].
    pub fn patterns(self, directions: usize) -> Result<CodePatterns, CellError> {
        let blocks = Blocks::new(directions, self.order)?;
        let mut starts = vec![0];
        for block in 0..blocks.count() {
            starts.push(starts[block] + blocks.code(block).order() * self.each());
        }
        Ok(CodePatterns {
            blocks,
            each: self.each(),
            starts,
        })
    }

    /// Patterns of each row of the code.
    const fn each(self) -> usize {
        1 + self.complement as usize
    }
}

/// The code patterns of a measurement, in the order in which they are shown.
#[derive(Clone, Debug)]
pub struct CodePatterns {
    blocks: Blocks,
    /// Patterns of each row of the code: 2 with inverted ones.
    each: usize,
    /// Number of the first pattern of each block, and how many there are.
    starts: Vec<usize>,
}

/// One code pattern.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CodePattern {
    /// The block that is lit.
    pub block: usize,
    /// Row of its code.
    pub row: usize,
    /// Whether those cells are lit that the row leaves black.
    pub is_inverted: bool,
}

impl CodePatterns {
    /// How many there are.
    #[must_use]
    pub fn len(&self) -> usize {
        self.starts.last().copied().unwrap_or(0)
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The blocks.
    #[must_use]
    pub const fn blocks(&self) -> Blocks {
        self.blocks
    }

    /// Whether rows are shown inverted too.
    #[must_use]
    pub const fn are_inverted_too(&self) -> bool {
        self.each > 1
    }

    /// The patterns of a block.
    #[must_use]
    pub fn of_block(&self, block: usize) -> Range<usize> {
        self.starts[block]..self.starts[block + 1]
    }

    /// What `pattern` is.
    #[must_use]
    pub fn pattern(&self, pattern: usize) -> CodePattern {
        let block = self.starts.partition_point(|start| *start <= pattern) - 1;
        let place = pattern - self.starts[block];
        CodePattern {
            block,
            row: place / self.each * SCATTER % self.blocks.code(block).order(),
            is_inverted: place % self.each == 1,
        }
    }

    /// The cells that `pattern` lights, by their numbers among the directions that can be lit.
    pub fn lit(&self, pattern: usize) -> impl Iterator<Item = usize> + use<> {
        let CodePattern {
            block,
            row,
            is_inverted,
        } = self.pattern(pattern);
        let code = self.blocks.code(block);
        self.cells(block)
            .filter(move |(column, _)| code.lights(row, *column) != is_inverted)
            .map(|(_, direction)| direction)
    }

    /// The cells of a block: the column of the code that each has, and its number among the directions that can be lit.
    pub fn cells(&self, block: usize) -> impl Iterator<Item = (usize, usize)> + use<> {
        let count = self.blocks.code(block).cells();
        let stride = stride(count);
        let cells = self.blocks.cells(block).enumerate();
        cells.map(move |(cell, direction)| (cell * stride % count, direction))
    }
}

/// A step that visits all of `count` places, neighbours far from each other.
fn stride(count: usize) -> usize {
    let divides = |by: usize, number: usize| number.is_multiple_of(by);
    let shares_none = |step: &usize| (2..=*step).all(|by| !divides(by, *step) || !divides(by, count));
    let golden = (count * 5 / 8).max(1);
    (golden..=count).find(shares_none).unwrap_or(1)
}

/// The light of all `cells` together.
#[must_use]
pub fn together<'a>(cells: impl IntoIterator<Item = &'a LitSet>) -> LitSet {
    let mut all = LitSet {
        pixels: Vec::new(),
        solid_angle_sr: 0.0,
        irradiance: 0.0,
        centroid: glam::DVec3::ZERO,
    };
    for cell in cells {
        all.pixels.extend(&cell.pixels);
        all.solid_angle_sr += cell.solid_angle_sr;
        all.irradiance += cell.irradiance;
        all.centroid += cell.centroid * cell.solid_angle_sr;
    }
    all.centroid = all.centroid.normalize_or(glam::DVec3::Z);
    all
}

#[cfg(test)]
mod tests;
