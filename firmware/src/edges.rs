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

/// Leaves out levels that are too short to be meant: both of their edges.
#[derive(Clone, Copy, Debug)]
pub struct Filter {
    shortest: Ticks,
    /// The last edge, as long as it is not certain to stay.
    held: Option<Sighting>,
}

impl Filter {
    /// Leaves out what is shorter than this.
    #[must_use]
    pub const fn new(shortest: Ticks) -> Self {
        Self { shortest, held: None }
    }

    /// The next edge. Returns the one before it, if that was meant and was not [taken](Self::settled) yet.
    pub fn edge(&mut self, edge: Sighting) -> Option<Sighting> {
        match self.held.take() {
            Some(held) if edge.at.saturating_sub(held.at) < self.shortest => None,
            held => {
                self.held = Some(edge);
                held
            }
        }
    }

    /// The last edge, if it is certain by `now` that it was meant, all edges up to then being known.
    pub fn settled(&mut self, now: Ticks) -> Option<Sighting> {
        let shortest = self.shortest;
        self.held.take_if(|held| held.at + shortest <= now)
    }

    /// The time of the last edge, if it is not certain that it was meant.
    #[must_use]
    pub fn doubtful(&self) -> Option<Ticks> {
        self.held.map(|held| held.at)
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
    fn short_levels_are_left_out_of_both_kinds() {
        let line = [
            (true, 100),
            (false, 103),
            (true, 105),
            (false, 500),
            (true, 504),
            (false, 509),
            (true, 900),
        ];
        let told = |shortest| {
            let mut filter = Filter::new(Ticks(shortest));
            let mut told = std::vec::Vec::new();
            for (active, at) in line {
                let at = Ticks(at);
                told.extend(filter.settled(at).map(|edge| edge.at.0));
                told.extend(filter.edge(Sighting { active, at }).map(|edge| edge.at.0));
            }
            told.extend(filter.settled(Ticks(2000)).map(|edge| edge.at.0));
            told
        };
        assert_eq!(told(0), line.map(|(_, at)| at));
        assert_eq!(told(3), [100, 500, 504, 509, 900]);
        assert_eq!(told(5), [105, 509, 900]);
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
