//! How the library tells how far it is.

use std::path::Path;

/// Somebody who wants to know. Called from any thread.
pub trait Progress: Sync {
    /// A stage begins that will do `total` things called `unit` (plural).
    fn begin(&self, stage: &str, total: usize, unit: &str);
    /// So many are done.
    fn reach(&self, done: usize);
    /// The stage is over.
    fn end(&self);
    /// Something worth saying between stages, in one line.
    fn remark(&self, _line: &str) {}
    /// The folder `dir` holds from now on what is being made.
    fn begun(&self, _dir: &Path) {}
}

/// Nobody.
#[derive(Clone, Copy, Debug)]
pub struct Silent;

impl Progress for Silent {
    fn begin(&self, _stage: &str, _total: usize, _unit: &str) {}
    fn reach(&self, _done: usize) {}
    fn end(&self) {}
}
