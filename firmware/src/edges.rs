//! What the PIO counted, as times of edges.
//!
//! # Design
//! A state machine watches an input line. It counts down, by one every [`TICKS_PER_COUNT`] ticks from the
//! tick in which the pulse engine starts, and hands its counter over at every change of level. Levels
//! alternate, so the counter alone is enough; it wraps after 2³³ ticks (68.7 s at 125 MHz), and a coarse
//! clock says how often it did.
//!
//! # Tradeoffs
//! An edge is seen up to one tick late and never early. A level that lasts less than four ticks may be
//! missed together with the one after it.

use rcg_protocol::Ticks;

/// Ticks from one count to the next: the loop tests the line and counts, one tick each.
pub const TICKS_PER_COUNT: u64 = 2;

/// The counter begins at `u32::MAX` and has as many bits.
const SPAN: u64 = TICKS_PER_COUNT << 32;

/// By how much the coarse clock may be behind an edge: far more than it ever is, far less than the span.
const COARSE: u64 = 1 << 20;

/// A change of level of an input line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sighting {
    /// Whether the line became active.
    pub active: bool,
    /// When, from the start of the count.
    pub at: Ticks,
}

/// Reads the counters of one line in their order.
#[derive(Clone, Copy, Debug, Default)]
pub struct EdgeClock {
    active: bool,
}

impl EdgeClock {
    /// A line that is `active` when the count begins.
    #[must_use]
    pub const fn new(active: bool) -> Self {
        Self { active }
    }

    /// The next edge: the machine handed over `counter`, not long before `elapsed` by the coarse clock.
    pub fn edge(&mut self, counter: u32, elapsed: Ticks) -> Sighting {
        self.active = !self.active;
        Sighting {
            active: self.active,
            at: time_of(counter, elapsed),
        }
    }
}

/// When the counter had this value, not long before `elapsed` by the coarse clock.
#[must_use]
pub fn time_of(counter: u32, elapsed: Ticks) -> Ticks {
    let within = TICKS_PER_COUNT * u64::from(u32::MAX - counter);
    let latest = elapsed.0 + COARSE;
    let turns = latest.saturating_sub(within) / SPAN;
    Ticks(turns * SPAN + within)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn counter_at(ticks: u64) -> u32 {
        u32::MAX - ((ticks / TICKS_PER_COUNT) & u64::from(u32::MAX)) as u32
    }

    #[test]
    fn levels_alternate_from_the_first() {
        let mut high = EdgeClock::new(true);
        assert!(!high.edge(counter_at(10), Ticks(10)).active);
        assert!(high.edge(counter_at(20), Ticks(20)).active);
    }

    #[test]
    fn times_survive_the_wrap_and_a_coarse_clock() {
        let mut clock = EdgeClock::new(false);
        for turn in 0..5 {
            for within in [0, 2, 1_000_000, SPAN / 2, SPAN - 2] {
                let at = turn * SPAN + within;
                // The poll may come late, and the coarse clock may be a little behind.
                for elapsed in [at.saturating_sub(500), at, at + 125_000, at + SPAN / 2] {
                    assert_eq!(
                        clock.edge(counter_at(at), Ticks(elapsed)).at,
                        Ticks(at),
                        "{at} seen at {elapsed}"
                    );
                }
            }
        }
    }
}
