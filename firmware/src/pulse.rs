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
        let mut words = StepWords::new();
        self.encode_into(step, index, |word| {
            words.push(word).map_err(|_| Fault::PeriodTooLong { step: index })
        })?;
        Ok(words)
    }

    /// Hands the words of `step` to `push`, as [`encode`](Self::encode) does; some may have been when it fails.
    ///
    /// # Errors
    /// As [`encode`](Self::encode), and those of `push`.
    pub fn encode_into(
        self,
        step: &Step,
        index: u64,
        mut push: impl FnMut(u32) -> Result<(), Fault>,
    ) -> Result<(), Fault> {
        if step.period > LONGEST_PERIOD {
            return Err(Fault::PeriodTooLong { step: index });
        }
        let outside = Fault::PulseOutsidePeriod { step: index };
        let too_close = Fault::EdgesTooClose {
            step: index,
            shortest: self.shortest(),
        };
        if step.period == Ticks::ZERO {
            return Err(too_close);
        }
        let [proj_on, proj_off] = edges_within(step.proj, step.period).ok_or(outside)?;
        let [cam_on, cam_off] = edges_within(step.cam, step.period).ok_or(outside)?;
        // Both pulses are in order already, so three exchanges put their edges in order. An edge is its time and,
        // below, the pin that it toggles.
        let edge = |at: Ticks, pin: u32| at.0 << 2 | u64::from(pin);
        let [mut a, mut b, mut c, mut d] = [
            edge(proj_on, PIN_PROJ),
            edge(proj_off, PIN_PROJ),
            edge(cam_on, PIN_CAM),
            edge(cam_off, PIN_CAM),
        ];
        exchange(&mut a, &mut c);
        exchange(&mut b, &mut d);
        exchange(&mut b, &mut c);

        if self.pace == Pace::EachOnSync {
            push(self.rest() | WAIT_BIT)?;
        }
        let (mut now, mut pins) = (0, self.rest());
        for edge in [a, b, c, d] {
            let at = edge >> 2;
            self.hold(pins, at - now, too_close, &mut push)?;
            (now, pins) = (at, pins ^ (edge as u32 & PINS));
        }
        self.hold(pins, step.period.0 - now, too_close, &mut push)
    }

    /// The words that keep the pins for a while, if it is any.
    fn hold(
        self,
        pins: u32,
        mut left: u64,
        too_close: Fault,
        push: &mut impl FnMut(u32) -> Result<(), Fault>,
    ) -> Result<(), Fault> {
        let shortest = u64::from(self.shortest());
        while left > 0 {
            if left < shortest {
                return Err(too_close);
            }
            let mut ticks = left.min(self.longest());
            if ticks < left && left - ticks < shortest {
                ticks -= shortest; // leave a remainder that a word can make
            }
            let count = (ticks - shortest) as u32;
            push(count << self.shift() | pins)?;
            left -= ticks;
        }
        Ok(())
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

/// What is to be known of a step, gathered from its words one by one.
#[derive(Clone, Copy, Debug)]
pub struct Outline {
    shift: u32,
    shortest: u32,
    wait: u32,
    rest: u32,
    trigger: Option<Ticks>,
    period: Ticks,
}

impl Outline {
    /// Of no words yet.
    #[must_use]
    pub const fn new(format: WordFormat) -> Self {
        // Taken apart here, as this is done for every word that is played.
        Self {
            shift: format.shift(),
            shortest: format.shortest(),
            wait: match format.pace {
                Pace::FreeRunning => 0,
                Pace::EachOnSync => WAIT_BIT,
            },
            rest: format.rest(),
            trigger: None,
            period: Ticks::ZERO,
        }
    }

    /// The next word of the step.
    pub fn add(&mut self, word: u32) {
        if word & self.wait != 0 {
            return;
        }
        if self.trigger.is_none() && (word ^ self.rest) & PIN_CAM != 0 {
            self.trigger = Some(self.period);
        }
        self.period.0 += u64::from(word >> self.shift) + u64::from(self.shortest);
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
fn exchange(low: &mut u64, high: &mut u64) {
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
