//! The compiled part of the Python package `rcg`: parses what Python hands over, calls the library, hands the answer back.
//!
//! # Design
//! Users see the Python files in `host/python/rcg`, which document themselves; nobody else imports this module. Arrays cross as
//! NumPy's, everything else as text: requests and answers are the JSON that the command reads and writes too. What takes long runs without
//! Python's lock on a thread of its own ([`long_work`]), so that signals are heard meanwhile.

#![expect(clippy::needless_pass_by_value, reason = "PyO3 hands arguments over so")]

mod brdf;
mod failure;
mod files;
mod long_work;
mod measurement;
mod trigger_box;

use pyo3::prelude::*;

/// What Python imports.
#[pymodule]
mod _rcg {
    #[pymodule_export]
    use crate::brdf::{Brdf, reasons};
    #[pymodule_export]
    use crate::files::{export, fill, formats, info};
    #[pymodule_export]
    use crate::measurement::{measure, plan};
    #[pymodule_export]
    use crate::trigger_box::TriggerBox;
}
