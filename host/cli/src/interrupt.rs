//! Ctrl-C while an instrument runs.
//!
//! # Design
//! A command that moves nothing ends at once: files are whole or as they were. One that fires a trigger box shall end between two steps, with
//! the outputs at rest and what was captured written: it is asked to, and ends by unwinding at the next word of progress, where the library
//! stops the box. Who does not hear that within [`PATIENCE`] moves nothing, and is ended too; whoever asks twice need not wait.

use std::panic::resume_unwind;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

/// Words of progress come at least so often while a box runs.
const PATIENCE: Duration = Duration::from_secs(1);
/// How often the wish is looked after.
const LOOK: Duration = Duration::from_millis(5);

/// The wish that the command ends, and whether it was heard.
#[derive(Clone, Debug, Default)]
pub(crate) struct Wish {
    is_there: Arc<AtomicBool>,
    is_heard: Arc<AtomicBool>,
}

/// What a command is unwound with.
pub(crate) struct Interrupted;

impl Wish {
    /// Wants the command to end, and waits until that is heard. Returns whether the command ends by itself.
    pub(crate) fn want(&self) -> bool {
        if self.is_there.swap(true, Ordering::AcqRel) {
            return false;
        }
        let began = Instant::now();
        while began.elapsed() < PATIENCE {
            if self.is_heard.load(Ordering::Acquire) {
                return true;
            }
            thread::sleep(LOOK);
        }
        false
    }

    /// Ends the command by unwinding where that is wanted.
    pub(crate) fn hear(&self) {
        if self.is_there.load(Ordering::Acquire) && !thread::panicking() {
            self.is_heard.store(true, Ordering::Release);
            resume_unwind(Box::new(Interrupted));
        }
    }
}
