//! Whole steps put together into a block of words, which the DMA hands to the PIO.
//!
//! # Design
//! The DMA runs ahead of the PIO by as many words as the FIFO holds. Were a block shorter than that, the
//! DMA would be through with it long before its steps are played, and "the current step" would not be what
//! the DMA is at. So [`Block::close`] plays a word near the end of a block in up to [`PIECES`] pieces, all but
//! the first as short as words can be: the DMA leaves the block in the last few ticks of that word. Pieces of
//! a word are no edges, and their durations add up to that of the word.
//!
//! # Tradeoffs
//! A block of short words only stays as it is. The DMA is ahead by up to nine words then, and a stop takes
//! effect as much later.

use heapless::Vec;
use rcg_protocol::Ticks;

use crate::pulse::{WORDS_PER_STEP, WordFormat};

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
    steps: usize,
    ticks: Ticks,
    words: Vec<u32, BLOCK_WORDS>,
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

    /// How many steps there are.
    #[must_use]
    pub const fn steps(&self) -> usize {
        self.steps
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

    /// Adds words of the next step of a block that is not [full](Self::is_full).
    pub fn push(&mut self, words: &[u32]) {
        self.words
            .extend_from_slice(words)
            .expect("the caller asked whether it is full");
    }

    /// The step whose words were pushed is complete; it lasts `period`.
    pub fn end_step(&mut self, period: Ticks) {
        self.steps += 1;
        self.ticks += period;
    }

    /// Divides the last word that is long enough, so that what follows its first piece fills the FIFO. Returns by how
    /// many words the block grew.
    pub fn close(&mut self, format: WordFormat) -> usize {
        let shortest = u64::from(format.shortest());
        for (after, index) in (0..self.words.len()).rev().enumerate() {
            let pieces = PIECES.saturating_sub(after);
            if pieces <= 1 || self.words.len() + pieces > BLOCK_WORDS {
                break;
            }
            let word = self.words[index];
            let tail = (pieces as u64 - 1) * shortest;
            let first = format.duration(word).0.saturating_sub(tail);
            if format.waits(word) || first < shortest {
                continue;
            }
            let levels = word & ((1 << format.shift()) - 1);
            self.words[index] = ((first - shortest) as u32) << format.shift() | levels;
            let length = self.words.len();
            self.words.extend(core::iter::repeat_n(levels, pieces - 1));
            self.words.copy_within(index + 1..length, index + pieces);
            self.words[index + 1..index + pieces].fill(levels);
            return pieces - 1;
        }
        0
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

    fn push(block: &mut Block, words: &[u32], period: Ticks) {
        block.push(words);
        block.end_step(period);
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
                push(&mut block, &words, Ticks(period));
                push(&mut block, &words, Ticks(period));
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
        let words = format.encode(&step(10_000), 0).expect("a good step");
        push(&mut block, &words, Ticks(10_000));
        assert_eq!(block.close(format), PIECES - 1);
        let tail = &block.words()[block.words().len() - (PIECES - 1)..];
        assert!(tail.iter().all(|&word| format.duration(word) == Ticks(3)));
    }

    #[test]
    fn a_short_last_word_leaves_only_short_words_to_the_fifo_too() {
        let format = WordFormat::new(Pace::FreeRunning, Polarity::default());
        // A pulse that ends with the step, or a few ticks before: the long word is the last but a few.
        for (proj, cam) in [
            (Pulse::new(0, 9_997), Pulse::NONE),
            (Pulse::new(3, 9_984), Pulse::new(9_990, 7)),
        ] {
            let step = Step {
                proj,
                cam,
                period: Ticks(10_000),
            };
            let words = format.encode(&step, 0).expect("a good step");
            let mut block = Block::new();
            push(&mut block, &words, step.period);
            let before = edges(format, block.words());
            assert!(block.close(format) > 0);
            assert_eq!(edges(format, block.words()), before);
            let tail = &block.words()[block.words().len() - (PIECES - 1)..];
            assert!(tail.iter().all(|&word| format.duration(word) < Ticks(30)));
        }
    }

    #[test]
    fn the_longest_step_fits_whenever_a_block_is_not_full() {
        let format = WordFormat::new(Pace::EachOnSync, Polarity::default());
        let longest = step(crate::pulse::LONGEST_PERIOD.0);
        let words = format.encode(&longest, 0).expect("a good step");
        let mut block = Block::new();
        while !block.is_full() {
            push(&mut block, &words, longest.period);
        }
        assert_eq!(block.close(format), PIECES - 1);
    }
}
