//! A table that is played from where it lies, because its steps are too short to be handed over one by one.
//!
//! # Design
//! The DMA reads the words of the table in slices of whole steps, with no copy in between; the CPU only says
//! where the next slice is. A slice would last long enough for that even if it held the shortest steps only,
//! and a table that is shorter is written several times behind itself ([`Store::unroll`]).
//!
//! # Tradeoffs
//! Nothing is told of single steps: STROBE is not watched, and there are no step records. A stop takes effect
//! with the slice.

use core::ops::Range;

use rcg_protocol::Ticks;

use crate::pulse::{Outline, WordFormat};
use crate::store::Store;

/// What the CPU needs for a step with its record and its two STROBE edges, and for the host meanwhile.
pub const STEP_COST_US: u32 = 40;

/// How far the CPU may fall behind: steps are handed over and edges kept for about a hundred steps.
pub const SLACK_US: u32 = 3_000;

/// How far the CPU would fall behind a table if it had to handle every step by itself.
///
/// It has the period of each step to do the work of one, and catches up in longer steps.
#[derive(Clone, Copy, Debug)]
pub struct Haste {
    step_cost: Ticks,
    behind: Ticks,
    furthest: Ticks,
    steps: u64,
    length: Ticks,
    shortest: Ticks,
}

impl Haste {
    /// For steps of which each takes the CPU so long.
    #[must_use]
    pub const fn new(step_cost: Ticks) -> Self {
        Self {
            step_cost,
            behind: Ticks::ZERO,
            furthest: Ticks::ZERO,
            steps: 0,
            length: Ticks::ZERO,
            shortest: Ticks(u64::MAX),
        }
    }

    /// Forgets the steps.
    pub const fn clear(&mut self) {
        *self = Self::new(self.step_cost);
    }

    /// The next step of the table.
    pub fn add(&mut self, period: Ticks) {
        self.behind = (self.behind + self.step_cost).saturating_sub(period);
        self.furthest = self.furthest.max(self.behind);
        self.steps += 1;
        self.length += period;
        self.shortest = self.shortest.min(period);
    }

    /// Whether the CPU would be more than `slack` behind, in the table or in the course of its cycles.
    #[must_use]
    pub fn exceeds(&self, slack: Ticks) -> bool {
        self.furthest > slack || self.length.0 < self.steps * self.step_cost.0
    }
}

/// What is left to play of a table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Burst {
    /// Steps of one pass.
    steps: u32,
    /// Words of one pass.
    words: usize,
    /// Length of one pass.
    length: Ticks,
    /// Passes that lie behind each other in the store.
    copies: u32,
    /// Steps of a slice; a slice of all steps may hold several passes.
    slice_steps: u32,
    cycles_left: u32,
    /// The next step of the pass, and its word.
    next: (u32, usize),
}

impl Burst {
    /// The table in `store`, of the steps that `haste` knows, to be played `cycles` times, in slices that last for
    /// `slice_for`.
    #[must_use]
    pub fn new(store: &mut Store, haste: &Haste, cycles: u32, slice_for: Ticks) -> Self {
        let &Haste {
            steps,
            length,
            shortest,
            ..
        } = haste;
        let steps = steps as u32; // a table holds a few thousand
        let words = store.table().len();
        let slice_steps = slice_for.0.div_ceil(shortest.0.max(1)).min(u64::from(steps)) as u32;
        let wanted = slice_for.0.div_ceil(length.0.max(1)).min(u64::from(cycles)) as usize;
        let copies = if slice_steps == steps {
            store.unroll(wanted) as u32
        } else {
            1
        };
        Self {
            steps,
            words,
            length,
            copies,
            slice_steps,
            cycles_left: cycles,
            next: (0, 0),
        }
    }

    /// The next slice: its words as a range of the store's ring, and how many steps they are; `None` if there is
    /// none left.
    pub fn next_slice(&mut self, store: &Store) -> Option<(Range<usize>, u64)> {
        if self.cycles_left == 0 {
            return None;
        }
        if self.slice_steps == self.steps {
            let passes = self.copies.min(self.cycles_left);
            self.cycles_left -= passes;
            return Some((0..passes as usize * self.words, u64::from(passes * self.steps)));
        }
        let (from, begin) = self.next;
        // What is left of the pass is not worth a slice of its own if it is shorter than one.
        let whole = self.steps - from >= 2 * self.slice_steps;
        let to = if whole {
            from + self.slice_steps
        } else {
            self.steps
        };
        let end = begin + store.words_of(from as usize..to as usize);
        self.next = (to, end);
        if to == self.steps {
            self.next = (0, 0);
            self.cycles_left -= 1;
        }
        Some((begin..end, u64::from(to - from)))
    }

    /// Counts the steps that are fired whole `now` after the start of the run, if nothing stops it before.
    #[must_use]
    pub fn tally_by(&self, now: Ticks) -> Tally {
        let passes = now.0 / self.length.0.max(1);
        Tally::new(passes, Ticks(now.0 - passes * self.length.0), self.steps)
    }

    /// Counts how long the first `steps` steps last.
    #[must_use]
    pub fn tally_of(&self, steps: u64) -> Tally {
        let passes = steps / u64::from(self.steps.max(1));
        let rest = steps - passes * u64::from(self.steps);
        Tally::new(passes, Ticks(u64::MAX), rest as u32)
    }
}

/// How far a burst got, counted step by step: the steps of one pass may be so many that it takes a while.
#[derive(Clone, Copy, Debug)]
pub struct Tally {
    passes: u64,
    /// What is left of the time, or nearly for ever.
    left: Ticks,
    /// Steps that it may be at most of the last pass.
    most: u32,
    /// The next step of the pass, its word, and when it begins.
    step: u32,
    word: usize,
    begins: Ticks,
}

impl Tally {
    const fn new(passes: u64, left: Ticks, most: u32) -> Self {
        Self {
            passes,
            left,
            most,
            step: 0,
            word: 0,
            begins: Ticks::ZERO,
        }
    }

    /// Looks at up to `steps` steps of `burst`. Returns how many were fired and when the last one ended, once that is known.
    pub fn go_on(
        &mut self,
        burst: &Burst,
        store: &Store,
        format: WordFormat,
        steps: u32,
    ) -> Option<(u64, Ticks)> {
        let words = store.table();
        for _ in 0..steps {
            let mut outline = Outline::new(format);
            let end = self.word + store.step_words(self.step as usize);
            let over = self.step == self.most || {
                outline.add(&words[self.word..end]);
                outline.period() > self.left
            };
            if over {
                let fired = self.passes * u64::from(burst.steps) + u64::from(self.step);
                return Some((fired, Ticks(self.passes * burst.length.0) + self.begins));
            }
            self.left = self.left - outline.period();
            self.begins += outline.period();
            self.word = end;
            self.step += 1;
        }
        None
    }
}
