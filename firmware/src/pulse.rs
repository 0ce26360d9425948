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

use core::ops::{BitAnd, BitXor, Shl, Shr, Sub};

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
        let mut words = StepWords::new();
        self.encode_into(step, index, &mut words)?;
        Ok(words)
    }

    /// Puts the words of `step` into `words`, which were empty, as [`encode`](Self::encode) does; some may be there
    /// when it fails.
    ///
    /// # Errors
    /// As [`encode`](Self::encode).
    pub fn encode_into(self, step: &Step, index: u64, words: &mut StepWords) -> Result<(), Fault> {
        let period = step.period;
        if period > LONGEST_PERIOD {
            return Err(Fault::PeriodTooLong { step: index });
        }
        let (Some(proj), Some(cam)) = (edges_within(step.proj, period), edges_within(step.cam, period))
        else {
            return Err(Fault::PulseOutsidePeriod { step: index });
        };
        if self.pace == Pace::EachOnSync {
            put(words, self.rest() | WAIT_BIT);
        }
        let done = if period.0 <= SHORT_PERIOD {
            let [proj, cam] = [proj, cam].map(|edges| edges.map(|at| at.0 as u32));
            let (shift, shortest) = (self.shift(), self.shortest());
            segments(self.rest(), proj, cam, period.0 as u32, |pins, ticks| {
                let count = ticks.checked_sub(shortest)?;
                put(words, count << shift | pins);
                Some(())
            })
        } else {
            let [proj, cam] = [proj, cam].map(|edges| edges.map(|at| at.0));
            segments(u64::from(self.rest()), proj, cam, period.0, |pins, ticks| {
                self.hold(pins as u32, ticks, words)
            })
        };
        // A step of no length is one whose borders are too close.
        if done.is_none() || period == Ticks::ZERO {
            return Err(Fault::EdgesTooClose {
                step: index,
                shortest: self.shortest(),
            });
        }
        Ok(())
    }

    /// The words that keep the pins for a while; `None` if it is too short for a word.
    fn hold(self, pins: u32, mut left: u64, words: &mut StepWords) -> Option<()> {
        let shortest = u64::from(self.shortest());
        while left > 0 {
            let mut ticks = left.min(self.longest());
            if ticks < left && left - ticks < shortest {
                ticks -= shortest; // leave a remainder that a word can make
            }
            let count = ticks.checked_sub(shortest)?;
            put(words, (count as u32) << self.shift() | pins);
            left -= ticks;
        }
        Some(())
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

/// What is to be known of a step, gathered from its words.
#[derive(Clone, Copy, Debug)]
pub struct Outline {
    format: WordFormat,
    trigger: Option<Ticks>,
    period: Ticks,
}

impl Outline {
    /// Of no words yet.
    #[must_use]
    pub const fn new(format: WordFormat) -> Self {
        Self {
            format,
            trigger: None,
            period: Ticks::ZERO,
        }
    }

    /// The next words of the step.
    #[inline(never)] // else its loop competes for registers with what is around it
    pub fn add(&mut self, words: &[u32]) {
        let (shift, shortest) = (self.format.shift(), self.format.shortest());
        let rest = self.format.rest();
        let wait = match self.format.pace {
            Pace::FreeRunning => 0,
            Pace::EachOnSync => WAIT_BIT,
        };
        let length = |word: u32| u64::from((word >> shift) + shortest); // at most 2³⁰ + 2
        let mut period = self.period.0;
        let mut words = words.iter().filter(|&&word| word & wait == 0);
        if self.trigger.is_none() {
            for &word in words.by_ref() {
                let at = period;
                period += length(word);
                if (word ^ rest) & PIN_CAM != 0 {
                    self.trigger = Some(Ticks(at));
                    break;
                }
            }
        }
        for &word in words {
            period += length(word);
        }
        self.period.0 = period;
    }

    /// Leading edge of CAM from the start of the step, if there is one.
    #[must_use]
    pub const fn trigger(&self) -> Option<Ticks> {
        self.trigger
    }

    /// Length of the step, without what it waits for SYNC.
    #[must_use]
    pub const fn period(&self) -> Ticks {
        self.period
    }
}

/// A step that is no longer has one word for each of its segments, and its times with a pin fit into 32 bits.
const SHORT_PERIOD: u64 = 1 << 29;

/// Hands the segments of a step to `hold`, pins and length, leaving out those of no length; ends when `hold` says
/// `None`. In numbers of 32 bits this is a third of the work that it is in 64.
fn segments<T>(
    rest: T,
    [proj_on, proj_off]: [T; 2],
    [cam_on, cam_off]: [T; 2],
    period: T,
    mut hold: impl FnMut(T, T) -> Option<()>,
) -> Option<()>
where
    T: Copy + Ord + From<u32> + Sub<Output = T> + BitXor<Output = T> + BitAnd<Output = T>,
    T: Shl<u32, Output = T> + Shr<u32, Output = T>,
{
    // An edge is its time and the pin that it toggles.
    let edge = |at: T, pin: u32| at << 2 ^ T::from(pin);
    let (mut a, mut b) = (edge(proj_on, PIN_PROJ), edge(proj_off, PIN_PROJ));
    let (mut c, mut d) = (edge(cam_on, PIN_CAM), edge(cam_off, PIN_CAM));
    // Both pulses are in order already, so three exchanges put their edges in order.
    exchange(&mut a, &mut c);
    exchange(&mut b, &mut d);
    exchange(&mut b, &mut c);
    let (mut now, mut pins) = (T::from(0), rest);
    for edge in [a, b, c, d] {
        let at = edge >> 2;
        if at != now {
            hold(pins, at - now)?;
        }
        (now, pins) = (at, pins ^ (edge & T::from(PINS)));
    }
    if period == now {
        Some(())
    } else {
        hold(pins, period - now)
    }
}

/// Adds a word, for which there is room: [`WORDS_PER_STEP`] is for the longest step.
fn put(words: &mut StepWords, word: u32) {
    words.push(word).expect("no step has more words");
}

/// Leading and trailing edge of `pulse`, or twice the start of the step if there is no pulse; `None` if they are not
/// within the period.
fn edges_within(pulse: Pulse, period: Ticks) -> Option<[Ticks; 2]> {
    if pulse.is_none() {
        return Some([Ticks::ZERO; 2]);
    }
    let end = pulse.at.checked_add(pulse.width)?;
    (end <= period).then_some([pulse.at, end])
}

/// Puts two numbers in order.
fn exchange<T: Ord>(low: &mut T, high: &mut T) {
    if *low > *high {
        core::mem::swap(low, high);
    }
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
