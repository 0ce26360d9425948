//! How a world ended.

use std::io;
use std::path::Path;

use serde::{Deserialize, Serialize};

use super::{DrawnRequest, DrawnRig, Judgement, Sizes};
use crate::store::checksum::sum_of;

/// Digits of a program's sum that tell it from others.
const DIGITS: usize = 16;

/// How a world ended.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "ended", rename_all = "lowercase")]
pub enum Outcome {
    /// All stages answered, and all samples hold the truth.
    Right,
    /// A stage said in one sentence why it does not answer.
    Refused {
        /// The words of the command.
        command: String,
        /// Its sentence.
        sentence: String,
    },
    /// Results are wrong, and nothing says so.
    Silent {
        /// What is wrong, in sentences.
        wrong: Vec<String>,
    },
    /// A stage ended without a sentence.
    Broken {
        /// The words of the command.
        command: String,
        /// How it ended.
        ending: String,
    },
}

impl Outcome {
    /// The word for it.
    #[must_use]
    pub const fn name(&self) -> &'static str {
        match self {
            Self::Right => "right",
            Self::Refused { .. } => "refused",
            Self::Silent { .. } => "silent",
            Self::Broken { .. } => "broken",
        }
    }

    /// Whether the program is at fault.
    #[must_use]
    pub const fn is_fault(&self) -> bool {
        matches!(self, Self::Silent { .. } | Self::Broken { .. })
    }
}

/// A file of a world as it was judged.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct File {
    /// Its name in the world.
    pub name: String,
    /// Whether it is one capture; else it was made from captures, and its samples are no further ones.
    pub is_capture: bool,
    /// How it stands against the truth.
    pub judgement: Judgement,
}

/// A world: what was drawn and how it ended.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct World {
    /// The program that was judged, as [`build_of`] names it.
    pub version: String,
    /// How fine captures are.
    pub sizes: Sizes,
    /// The rig.
    pub rig: DrawnRig,
    /// What was measured on it.
    pub request: DrawnRequest,
    /// How it ended.
    pub outcome: Outcome,
    /// What was judged.
    pub files: Vec<File>,
    /// Time that it took, calibration included where it was the first on its rig, s.
    pub elapsed_s: f64,
}

impl World {
    /// Whether both are the same world, however they ended.
    #[must_use]
    pub fn is_same(&self, other: &Self) -> bool {
        self.sizes == other.sizes && self.rig == other.rig && self.request == other.request
    }

    /// The captures that were judged.
    pub fn captures(&self) -> impl Iterator<Item = &Judgement> {
        let captures = self.files.iter().filter(|file| file.is_capture);
        captures.map(|file| &file.judgement)
    }
}

/// The name of a build: its version and the sum of the program file.
///
/// # Errors
/// What the file system says.
pub fn build_of(program: &Path) -> io::Result<String> {
    let sum = sum_of(program)?;
    Ok(format!("{}+{}", env!("CARGO_PKG_VERSION"), &sum[..DIGITS]))
}
