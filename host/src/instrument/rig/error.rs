//! What can be wrong with a rig file, each as one sentence.

use crate::base::blame::Blame;
use std::path::PathBuf;

/// Why a rig could not be used. Every message names the file, the field, what was expected and found.
#[derive(Debug, thiserror::Error)]
pub enum RigError {
    /// The file cannot be read.
    #[error(
        "{}: expected a readable rig file (TOML) or one of the presets rcg-1, rcg-1-16bit, rcg-2, rcg-3, dmd, found: {found}",
        path.display()
    )]
    Unreadable {
        /// The path or the name that was asked for.
        path: PathBuf,
        /// What the operating system said.
        found: std::io::Error,
    },
    /// The text is not TOML.
    #[error("{}: line {line}, column {column}: expected {expected}, found {found}", path.display())]
    Syntax {
        /// File that was read.
        path: PathBuf,
        /// Line of the mistake, from 1.
        line: usize,
        /// Column of the mistake in characters, from 1.
        column: usize,
        /// What would have been right.
        expected: String,
        /// What stands there.
        found: String,
    },
    /// A field is unknown, missing, of the wrong type, out of range, or contradicts another one.
    #[error("{}: {field}: expected {expected}, found {found}", path.display())]
    Field {
        /// File that was read, or the name of the rig when it was not read from a file.
        path: PathBuf,
        /// The field with its table, such as `mirror.b_m`.
        field: String,
        /// What would have been right, with the unit.
        expected: String,
        /// What stands there.
        found: String,
    },
}

impl Blame for RigError {
    fn is_input(&self) -> bool {
        true
    }
}
