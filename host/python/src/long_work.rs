//! Work that takes long: without Python's lock, and with an ear for Ctrl-C.
//!
//! # Design
//! Python hears signals on its main thread only, and only where somebody asks. So the work goes to a thread of its own, and the caller
//! asks ten times a second. The library has no way to be told to stop, but tells how far it is: there the work ends by unwinding, as if the
//! program had been killed there, which every file that is being written survives.

use std::panic::resume_unwind;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::Duration;

use pyo3::prelude::*;
use rcg::base::progress::Progress;

use crate::failure::Failure;

/// How often signals are asked for.
const ASKING: Duration = Duration::from_millis(100);

/// Ends the work when somebody wants it to end.
#[derive(Default)]
pub(crate) struct Patience {
    is_over: AtomicBool,
}

/// What a work is unwound with.
struct Interrupted;

impl Patience {
    /// Whether the work shall end.
    pub(crate) fn is_over(&self) -> bool {
        self.is_over.load(Ordering::Relaxed)
    }

    fn check(&self) {
        if self.is_over() {
            resume_unwind(Box::new(Interrupted));
        }
    }
}

impl Progress for Patience {
    fn begin(&self, _stage: &str, _total: usize, _unit: &str) {
        self.check();
    }
    fn reach(&self, _done: usize) {
        self.check();
    }
    fn end(&self) {
        self.check();
    }
}

#[expect(
    clippy::redundant_closure_for_method_calls,
    reason = "the method alone is not general enough in its lifetime"
)]
fn signals() -> PyResult<()> {
    Python::attach(|py| py.check_signals())
}

/// The answer of `work`, which shall ask the [`Patience`] that it gets, as a [`Progress`] or by itself.
///
/// # Errors
/// That of the work, or what Python makes of a signal (`KeyboardInterrupt`).
pub(crate) fn run<T: Send>(
    py: Python<'_>,
    work: impl FnOnce(&Patience) -> Result<T, Failure> + Send,
) -> PyResult<T> {
    let patience = Patience::default();
    let (ended, signal) = py.detach(|| {
        std::thread::scope(|scope| {
            let (done, is_done) = channel::<()>();
            let patience = &patience;
            let thread = scope.spawn(move || {
                // Dropped with the end of the work, however it ends.
                let _done = done;
                work(patience)
            });
            let mut signal = None;
            while let Err(RecvTimeoutError::Timeout) = is_done.recv_timeout(ASKING) {
                if let Err(error) = signals() {
                    patience.is_over.store(true, Ordering::Relaxed);
                    signal.get_or_insert(error);
                }
            }
            (thread.join(), signal)
        })
    });
    match (signal, ended) {
        (Some(signal), _) => Err(signal),
        (None, Ok(answer)) => Ok(answer?),
        (None, Err(panic)) => resume_unwind(panic),
    }
}
