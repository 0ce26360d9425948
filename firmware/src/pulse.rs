//! Steps of the schedule as words for the PIO, and the reference reading of those words.
//!
//! # Design
//! The two outputs are made by one PIO state machine that is fed by DMA, so neither interrupts nor traffic
//! can move an edge. A word holds the levels of both outputs (bits 0 and 1: PROJ, CAM) and how long they
//! last. Two PIO programs exist:
//!
//! - *free running*: `out pins, 2 / out x, 30 / jmp x--`: a word of count n lasts n + 3 ticks.
//! - *paced*: one bit more says "now wait for a SYNC edge":
//!   `out pins, 2 / out y, 1 / out x, 29 / jmp !y / wait 0 / wait 1 / jmp x--`: a word without the bit lasts
//!   n + 5 ticks; a word with it lasts until [`SYNC_LATENCY`] after the edge.
//!
//! [`Reader`] plays words as those programs do. The simulated controller drives its rig with it, and the
//! tests hold `schedule → words → edges = schedule` against it.
//!
//! # Tradeoffs
//! Edges that are not at the same tick must be 3 (5) ticks apart. In exchange one table word is one
//! change of level, however long it lasts.

use heapless::Vec;
use rcg_protocol::{Fault, Level, Line, Pace, Polarity, Pulse, Step, Ticks};

/// Ticks that a free-running word of count 0 lasts: `out`, `out`, one `jmp`.
pub const FREE_OVERHEAD: u32 = 3;
/// Ticks that a paced word of count 0 lasts: three `out`, `jmp !y`, one `jmp x--`.
pub const PACED_OVERHEAD: u32 = 5;
/// Ticks of a paced wait word before a SYNC edge can begin the step: three `out`, `jmp !y`, and the `wait 0`
/// that must have seen the line at rest in the tick before the edge.
pub const WAIT_LEAD: u64 = 5;
/// Ticks from the SYNC edge, as the state machine sees it, to the first level of the step.
///
/// `wait 1` ends in the tick of the edge, `jmp x--` takes the next, `out pins` acts in the one after.
pub const SYNC_LATENCY: u64 = 2;
/// Longest step: 120 s at 125 MHz, 75 s at 200 MHz.
pub const LONGEST_PERIOD: Ticks = Ticks(15_000_000_000);
/// Most words of one step: the longest period in paced words, one more for each of five segments, one to wait.
pub const WORDS_PER_STEP: usize = 36;

const PIN_PROJ: u32 = 0b01;
const PIN_CAM: u32 = 0b10;
const PINS: u32 = PIN_PROJ | PIN_CAM;
const WAIT_BIT: u32 = 0b100;

const _: () = assert!(LONGEST_PERIOD.0.div_ceil(1 << 29) + 5 < WORDS_PER_STEP as u64);

/// The words of one step.
pub type StepWords = Vec<u32, WORDS_PER_STEP>;

/// A change of level of an output pin.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Edge {
    /// When.
    pub at: Ticks,
    /// [`Line::Proj`] or [`Line::Cam`].
    pub line: Line,
    /// The level after the edge.
    pub level: Level,
}

/// How the words of one PIO program are laid out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WordFormat {
    pace: Pace,
    polarity: Polarity,
}

impl WordFormat {
    /// The format for a pace and a polarity.
    #[must_use]
    pub const fn new(pace: Pace, polarity: Polarity) -> Self {
        Self { pace, polarity }
    }

    /// Shortest distance of two edges, or of an edge and a border of the step, in ticks.
    #[must_use]
    pub const fn shortest(self) -> u32 {
        match self.pace {
            Pace::FreeRunning => FREE_OVERHEAD,
            Pace::EachOnSync => PACED_OVERHEAD,
        }
    }

    pub(crate) const fn shift(self) -> u32 {
        match self.pace {
            Pace::FreeRunning => 2,
            Pace::EachOnSync => 3,
        }
    }

    const fn longest(self) -> u64 {
        (u32::MAX >> self.shift()) as u64 + self.shortest() as u64
    }

    /// Levels of the pins at rest, as the low bits of a word.
    #[must_use]
    pub const fn rest(self) -> u32 {
        self.polarity.proj_active_low as u32 * PIN_PROJ + self.polarity.cam_active_low as u32 * PIN_CAM
    }

    /// The words of `step`, which is number `index` of the table or stream.
    ///
    /// # Errors
    /// [`Fault::PulseOutsidePeriod`], [`Fault::EdgesTooClose`] or [`Fault::PeriodTooLong`], naming `index`.
    pub fn encode(self, step: &Step, index: u64) -> Result<StepWords, Fault> {
        if step.period > LONGEST_PERIOD {
            return Err(Fault::PeriodTooLong { step: index });
        }
        let proj_end = end_within(step.proj, step.period).ok_or(Fault::PulseOutsidePeriod { step: index })?;
        let cam_end = end_within(step.cam, step.period).ok_or(Fault::PulseOutsidePeriod { step: index })?;
        let mut borders = [
            Ticks::ZERO,
            step.proj.at,
            proj_end,
            step.cam.at,
            cam_end,
            step.period,
        ];
        if step.proj.is_none() {
            (borders[1], borders[2]) = (Ticks::ZERO, Ticks::ZERO);
        }
        if step.cam.is_none() {
            (borders[3], borders[4]) = (Ticks::ZERO, Ticks::ZERO);
        }
        borders.sort_unstable();

        let too_close = Fault::EdgesTooClose {
            step: index,
            shortest: self.shortest(),
        };
        if step.period == Ticks::ZERO {
            return Err(too_close);
        }
        let mut words = StepWords::new();
        if self.pace == Pace::EachOnSync {
            words.push(self.rest() | WAIT_BIT).map_err(|_| too_close)?;
        }
        for pair in borders.windows(2) {
            let (from, to) = (pair[0], pair[1]);
            let mut left = (to - from).0;
            if left == 0 {
                continue;
            }
            let active =
                u32::from(covers(step.proj, from)) * PIN_PROJ + u32::from(covers(step.cam, from)) * PIN_CAM;
            let pins = active ^ self.rest();
            while left > 0 {
                let shortest = u64::from(self.shortest());
                if left < shortest {
                    return Err(too_close);
                }
                let mut ticks = left.min(self.longest());
                if ticks < left && left - ticks < shortest {
                    ticks -= shortest; // leave a remainder that a word can make
                }
                let count = (ticks - shortest) as u32;
                words
                    .push(count << self.shift() | pins)
                    .map_err(|_| Fault::PeriodTooLong { step: index })?;
                left -= ticks;
            }
        }
        Ok(words)
    }

    /// Ticks from the start of the step to the leading edge of CAM, if it has one; and the step's period.
    #[must_use]
    pub fn trigger_and_period(self, words: &[u32]) -> (Option<Ticks>, Ticks) {
        let mut at = Ticks::ZERO;
        let mut trigger = None;
        for &word in words {
            if self.waits(word) {
                continue;
            }
            if trigger.is_none() && (word ^ self.rest()) & PIN_CAM != 0 {
                trigger = Some(at);
            }
            at += self.duration(word);
        }
        (trigger, at)
    }

    /// Whether `word` waits for a SYNC edge.
    #[must_use]
    pub fn waits(self, word: u32) -> bool {
        self.pace == Pace::EachOnSync && word & WAIT_BIT != 0
    }

    pub(crate) fn duration(self, word: u32) -> Ticks {
        Ticks(u64::from(word >> self.shift()) + u64::from(self.shortest()))
    }
}

fn end_within(pulse: Pulse, period: Ticks) -> Option<Ticks> {
    let end = pulse.at.checked_add(pulse.width)?;
    (pulse.is_none() || end <= period).then_some(end)
}

fn covers(pulse: Pulse, at: Ticks) -> bool {
    !pulse.is_none() && pulse.at <= at && at < pulse.at + pulse.width
}

/// Plays words as the PIO does.
#[derive(Clone, Debug)]
pub struct Reader {
    format: WordFormat,
    now: Ticks,
    pins: u32,
}

/// What playing a word came to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[must_use]
pub enum Played {
    /// The next word begins at [`Reader::now`].
    Through,
    /// No SYNC edge came.
    NoSync,
}

impl Reader {
    /// A state machine with its outputs at rest, that plays its first word at `start`.
    #[must_use]
    pub const fn new(format: WordFormat, start: Ticks) -> Self {
        Self {
            format,
            now: start,
            pins: format.rest(),
        }
    }

    /// When the next word begins.
    #[must_use]
    pub const fn now(&self) -> Ticks {
        self.now
    }

    /// Plays one word. `next_sync(t)` is the first SYNC edge at or after t; `emit` takes the edges in order,
    /// PROJ before CAM where both change at once.
    pub fn play(
        &mut self,
        word: u32,
        next_sync: impl FnOnce(Ticks) -> Option<Ticks>,
        mut emit: impl FnMut(Edge),
    ) -> Played {
        self.set_pins(word & PINS, &mut emit);
        if self.format.waits(word) {
            match next_sync(self.now + Ticks(WAIT_LEAD)) {
                Some(edge) => self.now = edge + Ticks(SYNC_LATENCY),
                None => return Played::NoSync,
            }
        } else {
            self.now += self.format.duration(word);
        }
        Played::Through
    }

    /// Brings the outputs to rest at `at`, as an abort does.
    pub fn halt(&mut self, at: Ticks, mut emit: impl FnMut(Edge)) {
        self.now = at;
        self.set_pins(self.format.rest(), &mut emit);
    }

    fn set_pins(&mut self, pins: u32, emit: &mut impl FnMut(Edge)) {
        let changed = self.pins ^ pins;
        for (pin, line) in [(PIN_PROJ, Line::Proj), (PIN_CAM, Line::Cam)] {
            if changed & pin != 0 {
                let active = (pins ^ self.format.rest()) & pin != 0;
                let level = if active { Level::Active } else { Level::Inactive };
                emit(Edge {
                    at: self.now,
                    line,
                    level,
                });
            }
        }
        self.pins = pins;
    }
}
