//! What went wrong, as Python's exceptions with the library's sentence.

use std::error::Error;
use std::io;

use pyo3::PyErr;
use pyo3::exceptions::{PyRuntimeError, PyValueError};
use rcg::base::blame::Blame;

/// A failed call.
pub(crate) struct Failure(PyErr);

impl Failure {
    /// Wrong input in one sentence.
    pub(crate) fn input(sentence: impl std::fmt::Display) -> Self {
        Self(PyValueError::new_err(sentence.to_string()))
    }

    /// Something that failed, in one sentence.
    pub(crate) fn failed(sentence: impl std::fmt::Display) -> Self {
        Self(PyRuntimeError::new_err(sentence.to_string()))
    }
}

impl<E: Blame> From<E> for Failure {
    /// `OSError` (of its kinds the one that fits) where the system is the cause, `ValueError` where the input is, else `RuntimeError`.
    fn from(error: E) -> Self {
        if let Some(kind) = io_kind(&error) {
            return Self(io::Error::new(kind, error.to_string()).into());
        }
        if error.is_input() {
            Self::input(error)
        } else {
            Self::failed(error)
        }
    }
}

impl From<Failure> for PyErr {
    fn from(failure: Failure) -> Self {
        failure.0
    }
}

/// What the system said, where it is a cause of `error`.
fn io_kind(error: &(impl Error + ?Sized)) -> Option<io::ErrorKind> {
    let mut cause = error.source();
    while let Some(one) = cause {
        if let Some(io) = one.downcast_ref::<io::Error>() {
            return Some(io.kind());
        }
        cause = one.source();
    }
    None
}
