//! The words of the schedule: a table that is played in cycles, or a stream that is eaten as it plays.
//!
//! # Design
//! One ring of words and one of step lengths serve both. A table fills them once and is read round and
//! round; a stream frees what it has played. A table lies in one piece from the start of the ring, so the DMA
//! can play it [where it is](Store::table), even several times over.

use core::ops::Range;

use heapless::{Deque, Vec};
use rcg_protocol::{Extent, Fault};

/// Steps that the store holds.
pub const MAX_STEPS: usize = 4096;
/// Output words that the store holds; four a step, and most steps need four or five.
pub const MAX_WORDS: usize = 16_384;

/// Words, first in, first out.
#[derive(Clone, Debug)]
struct Words {
    first: usize,
    len: usize,
    /// Grows as places are used for the first time, so that an empty one need not be written.
    ring: Vec<u32, MAX_WORDS>,
}

impl Words {
    const fn new() -> Self {
        Self {
            ring: Vec::new(),
            first: 0,
            len: 0,
        }
    }

    fn clear(&mut self) {
        self.first = 0;
        self.len = 0;
    }

    /// Place in the ring of word `index`, which may be the one after the last.
    const fn place(&self, index: usize) -> usize {
        (self.first + index) % MAX_WORDS
    }

    /// Puts `words`, for which there is room, behind the others: in one piece or, over the end of the ring, in two.
    fn push(&mut self, words: &[u32]) {
        let place = self.place(self.len);
        let (first, second) = words.split_at(words.len().min(MAX_WORDS - place));
        self.put(place, first);
        self.put(0, second);
        self.len += words.len();
    }

    /// Puts `words` at `place`: over those that were there before, and behind them.
    fn put(&mut self, place: usize, words: &[u32]) {
        let (over, behind) = words.split_at(words.len().min(self.ring.len() - place));
        self.ring[place..place + over.len()].copy_from_slice(over);
        self.ring
            .extend_from_slice(behind)
            .expect("the place is within the ring");
    }

    /// Takes the first `count` words off, which lie in one piece or, over the end of the ring, in two.
    fn pop(&mut self, count: usize, mut take: impl FnMut(&[u32])) {
        let end = self.first + count;
        self.len -= count;
        if end < MAX_WORDS {
            take(&self.ring[self.first..end]);
            self.first = end;
        } else {
            take(&self.ring[self.first..]);
            take(&self.ring[..end - MAX_WORDS]);
            self.first = end - MAX_WORDS;
        }
    }
}

/// Steps as words.
#[derive(Clone, Debug)]
pub struct Store {
    /// Index of the next step that may be appended.
    appended: u64,
    /// Where the table is being read: step and word.
    cursor: (usize, usize),
    cycles_left: u32,
    keeps: bool,
    complete: bool,
    lengths: Deque<u8, MAX_STEPS>,
    words: Words,
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
            words: Words::new(),
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
        let words = MAX_WORDS - self.words.len;
        steps.min(words / 4) as u32
    }

    /// Adds one step of these words.
    ///
    /// # Errors
    /// [`Fault::StreamFull`] or, for a table, [`Fault::TooManySteps`] or [`Fault::TooManyWords`]. Nothing is taken
    /// then.
    pub fn push(&mut self, words: &[u32]) -> Result<(), Fault> {
        let steps_full = self.lengths.is_full();
        if steps_full || MAX_WORDS - self.words.len < words.len() {
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
        self.words.push(words);
        self.lengths.push_back(words.len() as u8).ok(); // there is room
        self.appended += 1;
        Ok(())
    }

    /// Takes back the last `steps` steps that were pushed.
    pub fn retract(&mut self, steps: u64) {
        for _ in 0..steps {
            self.words.len -= usize::from(self.lengths.pop_back().unwrap_or(0));
            self.appended -= 1;
        }
    }

    /// Hands the words of the next step to `take`, in order and in one piece or two. Returns how many there were, or
    /// `None` if the store is dry.
    pub fn take_step(&mut self, mut take: impl FnMut(&[u32])) -> Option<usize> {
        if self.is_dry() {
            return None;
        }
        let length;
        if self.keeps {
            let (step, word) = self.cursor;
            length = usize::from(*self.lengths.get(step)?);
            take(&self.table()[word..word + length]);
            self.cursor = (step + 1, word + length);
            if self.cursor.0 == self.lengths.len() {
                self.cursor = (0, 0);
                self.cycles_left -= 1;
            }
        } else {
            length = usize::from(self.lengths.pop_front()?);
            self.words.pop(length, take);
        }
        Some(length)
    }

    /// The words of one pass of a table.
    #[must_use]
    pub fn table(&self) -> &[u32] {
        &self.words.ring[..self.words.len]
    }

    /// Words of a table and its [copies](Self::unroll).
    #[must_use]
    pub fn slice(&self, range: Range<usize>) -> &[u32] {
        &self.words.ring[range]
    }

    /// How many words step `step` of a table has.
    #[must_use]
    pub fn step_words(&self, step: usize) -> usize {
        self.lengths.get(step).map_or(0, |&length| usize::from(length))
    }

    /// How many words the steps in `range` have together.
    #[must_use]
    pub fn words_of(&self, range: Range<usize>) -> usize {
        // In pieces, as it is asked for a thousand steps at a time while everybody waits.
        let (first, second) = self.lengths.as_slices();
        let sum = |part: &[u8], from: usize| {
            let range = range.start.saturating_sub(from)..range.end.saturating_sub(from);
            let part = part
                .get(range.start..range.end.min(part.len()))
                .unwrap_or_default();
            part.iter().map(|&length| usize::from(length)).sum::<usize>()
        };
        sum(first, 0) + sum(second, first.len())
    }

    /// Writes copies of a table behind it until there are `passes` or no further one fits. Returns how many
    /// there are.
    pub fn unroll(&mut self, passes: usize) -> usize {
        let words = self.words.len.max(1);
        let passes = passes.clamp(1, MAX_WORDS / words);
        let length = self.words.ring.len().max(passes * words);
        self.words.ring.resize(length, 0).expect("as many passes as fit");
        for pass in 1..passes {
            self.words.ring.copy_within(..words, pass * words);
        }
        passes
    }

    /// The whole table, all cycles of it, is taken at once.
    pub fn take_table(&mut self) {
        self.cycles_left = 0;
    }
}
