//! What went wrong, as Python's exceptions with the library's sentence.

use std::error::Error;
use std::io;
use std::sync::Arc;

use pyo3::PyErr;
use pyo3::exceptions::{PyRuntimeError, PyValueError};
use rcg::base::blame::Blame;
use rcg::capture::device::DeviceError;
use rcg::capture::link::LinkError;

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

impl<E: Blame + 'static> From<E> for Failure {
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
fn io_kind(error: &(dyn Error + 'static)) -> Option<io::ErrorKind> {
    let mut cause = Some(error);
    while let Some(one) = cause {
        let shared = one.downcast_ref::<Arc<io::Error>>().map(|io| io.kind());
        let own = one.downcast_ref::<io::Error>().map(io::Error::kind);
        let link = one.downcast_ref::<LinkError>().and_then(link_kind);
        // What is wrapped as it is shows no cause of its own.
        let device = match one.downcast_ref::<DeviceError>() {
            Some(DeviceError::Link(link)) => link_kind(link),
            _ => None,
        };
        if let Some(kind) = own.or(shared).or(link).or(device) {
            return Some(kind);
        }
        cause = one.source();
    }
    None
}

/// What the system said of a port.
fn link_kind(link: &LinkError) -> Option<io::ErrorKind> {
    Some(match link {
        LinkError::NoSuchPort { .. }
        | LinkError::NoTriggerBox { .. }
        | LinkError::SeveralTriggerBoxes { .. }
        | LinkError::NoSuchSerial { .. } => return None,
        LinkError::NotPermitted { .. } => io::ErrorKind::PermissionDenied,
        LinkError::Busy { .. } => io::ErrorKind::ResourceBusy,
        LinkError::Disconnected { .. } => io::ErrorKind::BrokenPipe,
        LinkError::Unusable { .. } => io::ErrorKind::Other,
        LinkError::Io { source, .. } => source.kind(),
    })
}
