//! Whole steps put together into a block of words, which the DMA hands to the PIO.
//!
//! # Design
//! The DMA runs ahead of the PIO by as many words as the FIFO holds. Were a block shorter than that, the
//! DMA would be through with it long before its steps are played, and "the current step" would not be what
//! the DMA is at. So [`Block::close`] plays the last word of a block in [`PIECES`] pieces, all but the first
//! as short as words can be: the DMA leaves the block in the last few ticks of its last step. Pieces of a
//! word are no edges, and their durations add up to that of the word.
//!
//! # Tradeoffs
//! A last word that is too short to be divided stays whole. The DMA is ahead by up to nine words then, and
//! a stop takes effect as much later.

use heapless::Vec;
use rcg_protocol::Ticks;

use crate::pulse::{StepWords, WORDS_PER_STEP, WordFormat};

/// Words of a block: [`BLOCK_STEPS`] steps of four words, as most are.
pub const BLOCK_WORDS: usize = 512;

/// Steps of a block: two blocks of them can be on their way at once.
pub const BLOCK_STEPS: usize = 120;

/// Pieces of the last word: one that is being played, one in the output shift register, eight in the FIFO.
pub const PIECES: usize = 10;

const _: () = assert!(BLOCK_WORDS > WORDS_PER_STEP + PIECES && BLOCK_WORDS > 4 * BLOCK_STEPS);
const _: () = assert!(2 * BLOCK_STEPS < crate::progress::MAX_AHEAD);

/// Some steps, as words.
#[derive(Debug, Default)]
pub struct Block {
    words: Vec<u32, BLOCK_WORDS>,
    steps: usize,
    ticks: Ticks,
}

impl Block {
    /// No steps.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            words: Vec::new(),
            steps: 0,
            ticks: Ticks::ZERO,
        }
    }

    /// Forgets the steps.
    pub fn clear(&mut self) {
        self.words.clear();
        self.steps = 0;
        self.ticks = Ticks::ZERO;
    }

    /// The words.
    #[must_use]
    pub fn words(&self) -> &[u32] {
        &self.words
    }

    /// Periods of all steps, without what they wait for SYNC.
    #[must_use]
    pub const fn ticks(&self) -> Ticks {
        self.ticks
    }

    /// Whether there is no step.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.words.is_empty()
    }

    /// Whether another step might not fit.
    #[must_use]
    pub fn is_full(&self) -> bool {
        self.steps == BLOCK_STEPS || BLOCK_WORDS - self.words.len() < WORDS_PER_STEP + PIECES
    }

    /// Adds a step of a block that is not [full](Self::is_full).
    pub fn push(&mut self, step: &StepWords, period: Ticks) {
        self.words
            .extend_from_slice(step)
            .expect("the caller asked whether it is full");
        self.steps += 1;
        self.ticks += period;
    }

    /// Divides the last word, if it is long enough. Returns by how many words the last step grew.
    pub fn close(&mut self, format: WordFormat) -> usize {
        let Some(&last) = self.words.last() else {
            return 0;
        };
        let tail = (PIECES as u64 - 1) * u64::from(format.shortest());
        let first = format.duration(last).0.saturating_sub(tail);
        if format.waits(last)
            || first < u64::from(format.shortest())
            || self.words.len() + PIECES > BLOCK_WORDS
        {
            return 0;
        }
        let piece = last & ((1 << format.shift()) - 1);
        let count = first as u32 - format.shortest();
        self.words.pop();
        let head = core::iter::once(count << format.shift() | piece);
        self.words
            .extend(head.chain(core::iter::repeat_n(piece, PIECES - 1)));
        PIECES - 1
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pulse::{Edge, Reader};
    use rcg_protocol::{Pace, Polarity, Pulse, Step};

    fn edges(format: WordFormat, words: &[u32]) -> (std::vec::Vec<Edge>, Ticks) {
        let mut reader = Reader::new(format, Ticks::ZERO);
        let mut edges = std::vec::Vec::new();
        for &word in words {
            let _ = reader.play(word, Some, |edge| edges.push(edge));
        }
        (edges, reader.now())
    }

    fn step(period: u64) -> Step {
        Step {
            proj: Pulse::new(0, 10),
            cam: Pulse::new(20, period - 20),
            period: Ticks(period),
        }
    }

    #[test]
    fn closing_moves_no_edge() {
        for pace in [Pace::FreeRunning, Pace::EachOnSync] {
            for period in [26, 46, 47, 69, 70, 71, 1000, 1 << 31] {
                let format = WordFormat::new(pace, Polarity::default());
                let words = format.encode(&step(period), 0).expect("a good step");
                let mut block = Block::new();
                block.push(&words, Ticks(period));
                block.push(&words, Ticks(period));
                let before = edges(format, block.words());
                let length = block.words().len();
                let grown = block.close(format);
                assert_eq!(block.words().len(), length + grown);
                assert_eq!(edges(format, block.words()), before, "{pace:?}, period {period}");
                assert_eq!(block.ticks(), Ticks(2 * period));
            }
        }
    }

    #[test]
    fn a_long_last_word_leaves_only_short_pieces_to_the_fifo() {
        let format = WordFormat::new(Pace::FreeRunning, Polarity::default());
        let mut block = Block::new();
        block.push(
            &format.encode(&step(10_000), 0).expect("a good step"),
            Ticks(10_000),
        );
        assert_eq!(block.close(format), PIECES - 1);
        let tail = &block.words()[block.words().len() - (PIECES - 1)..];
        assert!(tail.iter().all(|&word| format.duration(word) == Ticks(3)));
    }

    #[test]
    fn the_longest_step_fits_whenever_a_block_is_not_full() {
        let format = WordFormat::new(Pace::EachOnSync, Polarity::default());
        let longest = step(crate::pulse::LONGEST_PERIOD.0);
        let words = format.encode(&longest, 0).expect("a good step");
        let mut block = Block::new();
        while !block.is_full() {
            block.push(&words, longest.period);
        }
        assert_eq!(block.close(format), PIECES - 1);
    }
}
