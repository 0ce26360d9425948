//! Whose fault an error is.

use std::io;

/// An error that knows whether what it was given is wrong, or whether something failed.
pub trait Blame: std::error::Error {
    /// Whether the input is wrong, so that the same call fails again; else a disk, a device or chance was at fault.
    fn is_input(&self) -> bool;
}

impl Blame for io::Error {
    fn is_input(&self) -> bool {
        false
    }
}
