//! How far the pulse engine has got, from what the DMA has moved and what the clock says.
//!
//! # Design
//! A step was fired when the PIO has taken its last word, which the DMA and the FIFO tell, and when that
//! word's time is over, which the clock tells. When a step ends is known beforehand: a free-running step
//! begins where the one before it ended, a paced one [`SYNC_LATENCY`] after the SYNC edge that began it.
//! Which one that is [`crate::starts`] says.
//!
//! All times count from the start of the run, which is the start of the first step, or of the first SYNC
//! edge when every step waits for one.

use heapless::Deque;
use rcg_protocol::{Pace, Ticks};

use crate::pulse::SYNC_LATENCY;

/// Steps that can be given to the DMA and not yet be fired.
///
/// The witness is told of them as they are fetched, so it must hold at least as many, and one that is open.
pub const MAX_AHEAD: usize = 250;

const _: () = assert!(MAX_AHEAD < crate::witness::MAX_PENDING);

/// A step that is on its way.
#[derive(Clone, Copy, Debug)]
struct Ahead {
    /// Words up to its end since the start of the run; wraps.
    words_end: u32,
    period: Ticks,
    /// When it ends, if it is known when it begins.
    ends: Option<Ticks>,
}

/// The steps of a run that are on their way through the DMA, and how many are through.
#[derive(Clone, Debug)]
pub struct Progress {
    pace: Pace,
    words: u32,
    fetched: u64,
    fired: u64,
    /// End of the last step that was fired.
    ended: Ticks,
    /// End of the last step of which it is known.
    known: Ticks,
    ahead: Deque<Ahead, MAX_AHEAD>,
}

impl Progress {
    /// Nothing on its way.
    #[must_use]
    pub const fn new(pace: Pace) -> Self {
        Self {
            pace,
            ahead: Deque::new(),
            words: 0,
            fetched: 0,
            fired: 0,
            ended: Ticks::ZERO,
            known: Ticks::ZERO,
        }
    }

    /// Whether no further step can be taken.
    #[must_use]
    pub fn is_full(&self) -> bool {
        self.ahead.is_full()
    }

    /// Steps that were given to the DMA.
    #[must_use]
    pub const fn fetched(&self) -> u64 {
        self.fetched
    }

    /// End of the last step that [`fired`](Self::fired) counted.
    #[must_use]
    pub const fn ended(&self) -> Ticks {
        self.ended
    }

    /// A step of `words` words goes to the DMA, after all others.
    pub fn push(&mut self, words: usize, period: Ticks) {
        self.words = self.words.wrapping_add(words as u32);
        self.fetched += 1;
        let ends = match self.pace {
            Pace::FreeRunning => {
                self.known += period;
                Some(self.known)
            }
            Pace::EachOnSync => None,
        };
        let ahead = Ahead {
            words_end: self.words,
            period,
            ends,
        };
        self.ahead
            .push_back(ahead)
            .expect("the caller asked whether it is full");
    }

    /// The last step grew by `words` words that change nothing.
    pub fn lengthen(&mut self, words: usize) {
        self.words = self.words.wrapping_add(words as u32);
        if let Some(last) = self.ahead.back_mut() {
            last.words_end = self.words;
        }
    }

    /// Whether a step is on its way that has not begun, as far as is known.
    #[must_use]
    pub fn has_waiting(&self) -> bool {
        self.ahead.back().is_some_and(|step| step.ends.is_none())
    }

    /// The SYNC edge at `edge` began the next step that waits. Returns when that one ends.
    pub fn sync(&mut self, edge: Ticks) -> Ticks {
        if let Some(next) = self.ahead.iter_mut().find(|step| step.ends.is_none()) {
            self.known = edge + Ticks(SYNC_LATENCY) + next.period;
            next.ends = Some(self.known);
        }
        self.known
    }

    /// Since when a step has been waiting for its SYNC edge, at `now`; `None` if none is.
    #[must_use]
    pub fn awaits_sync_since(&self, now: Ticks) -> Option<Ticks> {
        let waits = self.known <= now && self.has_waiting();
        waits.then_some(self.known)
    }

    /// Steps that were fired whole by `now`, when the PIO has taken `words` words since the start of the run.
    pub fn fired(&mut self, words: u32, now: Ticks) -> u64 {
        while let Some(step) = self.ahead.front() {
            let taken = words.wrapping_sub(step.words_end) as i32 >= 0;
            match step.ends {
                Some(ends) if taken && ends <= now => self.ended = ends,
                _ => break,
            }
            self.fired += 1;
            self.ahead.pop_front();
        }
        self.fired
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LATE: Ticks = Ticks(u64::MAX / 2);

    #[test]
    fn a_step_is_fired_when_its_words_and_its_time_are_over() {
        let mut progress = Progress::new(Pace::FreeRunning);
        progress.push(3, Ticks(100));
        progress.push(2, Ticks(50));
        progress.lengthen(9);
        assert_eq!(progress.fired(2, LATE), 0, "its last word was not taken");
        assert_eq!(progress.fired(14, Ticks(99)), 0, "its time is not over");
        assert_eq!(progress.fired(13, LATE), 1, "the piece at the end was not taken");
        assert_eq!(progress.ended(), Ticks(100));
        assert_eq!(progress.fired(14, Ticks(150)), 2);
        assert_eq!(progress.ended(), Ticks(150));
    }

    #[test]
    fn words_may_wrap() {
        let mut progress = Progress::new(Pace::FreeRunning);
        for _ in 0..3 {
            progress.push(1 << 30, Ticks(10));
            progress.fired(progress.words, LATE);
        }
        progress.push(1 << 30, Ticks(10));
        assert_eq!(progress.fired(u32::MAX, LATE), 3);
        assert_eq!(progress.fired(0, LATE), 4);
    }

    #[test]
    fn a_paced_step_ends_so_long_after_its_edge() {
        let mut progress = Progress::new(Pace::EachOnSync);
        progress.push(3, Ticks(100));
        progress.push(3, Ticks(100));
        assert_eq!(progress.awaits_sync_since(Ticks::ZERO), Some(Ticks::ZERO));
        let end = progress.sync(Ticks(0));
        assert_eq!(end, Ticks(SYNC_LATENCY + 100));
        let before = end - Ticks(1);
        assert_eq!(
            progress.awaits_sync_since(before),
            None,
            "the step is being played"
        );
        assert_eq!(progress.fired(6, before), 0, "its time is not over");
        assert_eq!(progress.awaits_sync_since(end), Some(end));
        assert_eq!(progress.fired(6, LATE), 1, "the second has not begun");
        assert!(progress.has_waiting());
        progress.sync(end + Ticks(500));
        assert!(!progress.has_waiting(), "there is no third step");
        assert_eq!(progress.awaits_sync_since(LATE), None);
        assert_eq!(progress.fired(6, LATE), 2);
    }
}
