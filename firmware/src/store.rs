//! The words of the schedule: a table that is played in cycles, or a stream that is eaten as it plays.
//!
//! # Design
//! One ring of words and one of step lengths serve both. A table fills them once and is read round and
//! round; a stream frees what it has played.

use heapless::Deque;
use rcg_protocol::{Extent, Fault};

use crate::pulse::StepWords;

/// Steps that the store holds.
pub const MAX_STEPS: usize = 4096;
/// Output words that the store holds; four a step, and most steps need four or five.
pub const MAX_WORDS: usize = 16_384;

/// Steps as words.
#[derive(Debug)]
pub struct Store {
    words: Deque<u32, MAX_WORDS>,
    lengths: Deque<u8, MAX_STEPS>,
    /// Index of the next step that may be appended.
    appended: u64,
    /// Where the table is being read: step and word.
    cursor: (usize, usize),
    cycles_left: u32,
    keeps: bool,
    complete: bool,
}

impl Default for Store {
    fn default() -> Self {
        Self::new()
    }
}

impl Store {
    /// An empty store.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            words: Deque::new(),
            lengths: Deque::new(),
            appended: 0,
            cursor: (0, 0),
            cycles_left: 0,
            keeps: false,
            complete: false,
        }
    }

    /// Forgets everything and makes ready for a schedule of this extent.
    pub fn begin(&mut self, extent: Extent) {
        self.words.clear();
        self.lengths.clear();
        self.appended = 0;
        self.keeps = matches!(extent, Extent::Table { .. });
        self.complete = false;
        self.rewind(extent);
    }

    /// Begins to read from the start; a stream goes on where it is.
    pub fn rewind(&mut self, extent: Extent) {
        self.cursor = (0, 0);
        self.cycles_left = match extent {
            Extent::Table { cycles, .. } => cycles,
            Extent::Stream => 0,
        };
    }

    /// Index of the next step to append.
    #[must_use]
    pub const fn appended(&self) -> u64 {
        self.appended
    }

    /// Whether no further step will come.
    #[must_use]
    pub const fn is_complete(&self) -> bool {
        self.complete
    }

    /// No further step will come.
    pub fn complete(&mut self) {
        self.complete = true;
    }

    /// Whether nothing is left to play.
    #[must_use]
    pub fn is_dry(&self) -> bool {
        self.lengths.is_empty() || (self.keeps && self.cycles_left == 0)
    }

    /// Steps that certainly fit if they need no more than four words each.
    #[must_use]
    pub fn free_steps(&self) -> u32 {
        let steps = MAX_STEPS - self.lengths.len();
        let words = MAX_WORDS - self.words.len();
        steps.min(words / 4) as u32
    }

    /// Adds one step.
    ///
    /// # Errors
    /// [`Fault::StreamFull`] or, for a table, [`Fault::TooManySteps`] or [`Fault::TooManyWords`]; nothing is
    /// taken then.
    pub fn push(&mut self, step: &StepWords) -> Result<(), Fault> {
        let steps_full = self.lengths.is_full();
        if steps_full || MAX_WORDS - self.words.len() < step.len() {
            return Err(match (self.keeps, steps_full) {
                (false, _) => Fault::StreamFull {
                    free: self.free_steps(),
                },
                (true, true) => Fault::TooManySteps {
                    limit: MAX_STEPS as u32,
                },
                (true, false) => Fault::TooManyWords {
                    limit: MAX_WORDS as u32,
                },
            });
        }
        let fits = "room was checked";
        self.lengths.push_back(step.len() as u8).expect(fits);
        for &word in step {
            self.words.push_back(word).expect(fits);
        }
        self.appended += 1;
        Ok(())
    }

    /// Takes back the last `steps` steps that were pushed.
    pub fn retract(&mut self, steps: u64) {
        for _ in 0..steps {
            for _ in 0..self.lengths.pop_back().unwrap_or(0) {
                self.words.pop_back();
            }
            self.appended -= 1;
        }
    }

    /// The next step to play, or `None` if the store is dry.
    pub fn take_step(&mut self) -> Option<StepWords> {
        if self.is_dry() {
            return None;
        }
        if self.keeps {
            self.next_of_table()
        } else {
            self.next_of_stream()
        }
    }

    fn next_of_table(&mut self) -> Option<StepWords> {
        let (step, word) = self.cursor;
        let length = usize::from(*self.lengths.get(step)?);
        let words = (word..word + length)
            .filter_map(|i| self.words.get(i))
            .copied()
            .collect();
        self.cursor = (step + 1, word + length);
        if self.cursor.0 == self.lengths.len() {
            self.cursor = (0, 0);
            self.cycles_left -= 1;
        }
        Some(words)
    }

    fn next_of_stream(&mut self) -> Option<StepWords> {
        let length = self.lengths.pop_front()?;
        (0..length).map(|_| self.words.pop_front()).collect()
    }
}
