//! Steps of the schedule as words for the PIO, and the reference reading of those words.
//!
//! # Design
//! The outputs are made by one PIO state machine that is fed by DMA, so neither interrupts nor traffic
//! can move an edge. A word holds the levels of the outputs (bits 0 and 1: PROJ, CAM) and how long they
//! last. Two PIO programs exist:
//!
//! - *free running*: `out pins, 2 / out x, 30 / jmp x--`: a word of count n lasts n + 3 ticks.
//! - *paced*: one bit more says "now wait for a SYNC edge":
//!   `out pins, 2 / out y, 1 / out x, 29 / jmp y-- / jmp x--`: a word without the bit lasts n + 5 ticks. With it
//!   `wait 0 [31] / jmp pin / wait 1 / push` follow instead: it lasts until [`SYNC_LATENCY`] after the edge.
//!
//! Where a further output pulses the words are *wide*: two levels more, and two bits between that are nobody's, as their pins are
//! SYNC and STROBE. The same programs play them, with `out pins, 6` and four bits less to count with: a level takes a word for each
//! half (quarter) of a second that it lasts, and a step can be [`WIDE_WORDS`] words long.
//!
//! An edge that is waited for comes after the line was at rest, and was at rest still [`SYNC_MASK`] ticks later: what
//! rings back after a trailing edge is none.
//!
//! [`Reader`] plays words as those programs do. The simulated controller drives its rig with it, and the
//! tests hold `schedule → words → edges = schedule` against it.
//!
//! # Tradeoffs
//! Edges that are not at the same tick must be 3 (5) ticks apart. In exchange one table word is one
//! change of level, however long it lasts.

use core::ops::{BitAnd, BitXor, Shl, Shr, Sub};

use heapless::Vec;
use rcg_protocol::{Aux, AuxPolarity, Fault, Level, Line, Pace, Polarity, Pulse, Step, Ticks};

/// Ticks that a free-running word of count 0 lasts: `out`, `out`, one `jmp`.
pub const FREE_OVERHEAD: u32 = 3;
/// Ticks that a paced word of count 0 lasts: three `out`, `jmp !y`, one `jmp x--`.
pub const PACED_OVERHEAD: u32 = 5;
/// Ticks of a paced wait word before the line is looked at: three `out`, `jmp y--`.
pub const SYNC_READY: u64 = 4;
/// Ticks in which the line is not looked at once it was seen at rest: those of `wait 0` with its delay.
pub const SYNC_MASK: u64 = 32;
/// Ticks of a paced wait word before a SYNC edge can begin the step: [`SYNC_READY`], [`SYNC_MASK`], and `jmp pin`, which
/// must have seen the line at rest still.
pub const WAIT_LEAD: u64 = SYNC_READY + SYNC_MASK + 1;
/// Ticks from the SYNC edge, as the state machine sees it, to the first level of the step.
///
/// `wait 1` ends in the tick of the edge, `push` takes the next, `out pins` acts in the one after.
pub const SYNC_LATENCY: u64 = 2;
/// Longest step: 120 s at 125 MHz, 75 s at 200 MHz.
pub const LONGEST_PERIOD: Ticks = Ticks(15_000_000_000);
/// Most words of one step: the longest period in paced words, one more for each of five segments, one to wait; or, as wide
/// words, [`WIDE_WORDS`], one more for each of nine segments, one to wait.
pub const WORDS_PER_STEP: usize = 44;
/// Words of the longest level of a step in which a further output pulses: 18 s free running and 9 s paced at 125 MHz. To take in more
/// would keep the UART waiting.
pub const WIDE_WORDS: usize = WORDS_PER_STEP - 10;
/// Outputs of a wide word, from PROJ on, among them two pins that are inputs.
pub const WIDE_PINS: u32 = 6;
/// Outputs of another word.
pub const NARROW_PINS: u32 = 2;

const PIN_PROJ: u32 = 0b01;
const PIN_CAM: u32 = 0b10;
const PIN_AUX_A: u32 = 0b01_0000;
const PIN_AUX_B: u32 = 0b10_0000;
const PINS: u32 = PIN_PROJ | PIN_CAM;
const OUTPUTS: [(u32, Line); 4] = [
    (PIN_PROJ, Line::Proj),
    (PIN_CAM, Line::Cam),
    (PIN_AUX_A, Line::AuxA),
    (PIN_AUX_B, Line::AuxB),
];

const _: () = assert!(LONGEST_PERIOD.0.div_ceil(1 << 29) + 5 < WORDS_PER_STEP as u64);

/// The words of one step.
pub type StepWords = Vec<u32, WORDS_PER_STEP>;

/// A change of level of an output pin.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Edge {
    /// When.
    pub at: Ticks,
    /// An output.
    pub line: Line,
    /// The level after the edge.
    pub level: Level,
}

/// How the words of one PIO program are laid out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WordFormat {
    pace: Pace,
    polarity: Polarity,
    aux: AuxPolarity,
    wide: bool,
}

impl WordFormat {
    /// The format for a pace and a polarity.
    #[must_use]
    pub const fn new(pace: Pace, polarity: Polarity) -> Self {
        Self {
            pace,
            polarity,
            aux: AuxPolarity {
                a_active_low: false,
                b_active_low: false,
                photo_active_low: false,
                start_active_low: false,
            },
            wide: false,
        }
    }

    /// The same where further outputs do what `aux` says.
    #[must_use]
    pub const fn with_aux(self, aux: &Aux) -> Self {
        Self {
            aux: aux.polarity,
            wide: aux.has_pulses(),
            ..self
        }
    }

    /// Levels of a word, from its lowest bit on: [`NARROW_PINS`] or [`WIDE_PINS`].
    #[must_use]
    pub const fn pins(self) -> u32 {
        if self.wide { WIDE_PINS } else { NARROW_PINS }
    }

    const fn wait_bit(self) -> u32 {
        1 << self.pins()
    }

    /// Longest step.
    #[must_use]
    pub const fn longest_period(self) -> Ticks {
        if self.wide {
            Ticks((WIDE_WORDS as u64) << (u32::BITS - self.shift()))
        } else {
            LONGEST_PERIOD
        }
    }

    /// Shortest distance of two edges, or of an edge and a border of the step, in ticks.
    #[must_use]
    pub const fn shortest(self) -> u32 {
        match self.pace {
            Pace::FreeRunning => FREE_OVERHEAD,
            Pace::EachOnSync => PACED_OVERHEAD,
        }
    }

    /// Bits of a word before its count.
    #[must_use]
    pub const fn shift(self) -> u32 {
        match self.pace {
            Pace::FreeRunning => self.pins(),
            Pace::EachOnSync => self.pins() + 1,
        }
    }

    /// Levels of the pins at rest, as the low bits of a word.
    #[must_use]
    pub const fn rest(self) -> u32 {
        let narrow =
            self.polarity.proj_active_low as u32 * PIN_PROJ + self.polarity.cam_active_low as u32 * PIN_CAM;
        if !self.wide {
            return narrow;
        }
        narrow + self.aux.a_active_low as u32 * PIN_AUX_A + self.aux.b_active_low as u32 * PIN_AUX_B
    }

    /// The words of `step`, which is number `index` of the table or stream, with the further outputs at rest.
    ///
    /// # Errors
    /// [`Fault::PulseOutsidePeriod`], [`Fault::EdgesTooClose`] or [`Fault::PeriodTooLong`], naming `index`.
    pub fn encode(self, step: &Step, index: u64) -> Result<StepWords, Fault> {
        let mut words = StepWords::new();
        self.encode_into(step, &Aux::default(), index, &mut words)?;
        Ok(words)
    }

    /// Puts the words of `step` into `words`, which were empty, as [`encode`](Self::encode) does, with the pulses of `aux`, which
    /// this format is [of](Self::with_aux); some may be there when it fails.
    ///
    /// # Errors
    /// As [`encode`](Self::encode).
    pub fn encode_into(self, step: &Step, aux: &Aux, index: u64, words: &mut StepWords) -> Result<(), Fault> {
        let period = step.period;
        if period > self.longest_period() {
            return Err(Fault::PeriodTooLong { step: index });
        }
        let (Some(proj), Some(cam)) = (edges_within(step.proj, period), edges_within(step.cam, period))
        else {
            return Err(Fault::PulseOutsidePeriod { step: index });
        };
        if self.pace == Pace::EachOnSync {
            put(words, self.rest() | self.wait_bit());
        }
        let done = if self.wide {
            let aux = [aux.a, aux.b].map(|aux| aux.of(step).and_then(|pulse| edges_within(pulse, period)));
            let [Some(a), Some(b)] = aux else {
                return Err(Fault::PulseOutsidePeriod { step: index });
            };
            let edges = [proj, cam, a, b].map(|edges| edges.map(|at| at.0));
            wide_segments(self.rest(), edges, period.0, |pins, ticks| {
                self.hold(pins, ticks, words)
            })
        } else if period.0 <= SHORT_PERIOD {
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
    fn hold(self, pins: u32, ticks: u64, words: &mut StepWords) -> Option<()> {
        let (shift, shortest) = (self.shift(), self.shortest());
        // Whole words are powers of two, so that many are made without reckoning in 64 bits for each.
        let bits = u32::BITS - shift;
        let mut whole = (ticks >> bits) as u32;
        let mut rest = ticks as u32 & ((1 << bits) - 1);
        let word = |ticks: u32| Some(ticks.checked_sub(shortest)? << shift | pins);
        if whole > 0 && rest > 0 && rest < shortest {
            // Leave a remainder that a word can make.
            put(words, word((1 << bits) - shortest)?);
            whole -= 1;
            rest += shortest;
        }
        words
            .resize(words.len() + whole as usize, word(1 << bits)?)
            .expect("no step has more words");
        if rest > 0 {
            put(words, word(rest)?);
        }
        Some(())
    }

    /// Whether `word` waits for a SYNC edge.
    #[must_use]
    pub fn waits(self, word: u32) -> bool {
        self.pace == Pace::EachOnSync && word & self.wait_bit() != 0
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
            Pace::EachOnSync => self.format.wait_bit(),
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

/// As [`segments`], of four outputs in the order of [`OUTPUTS`].
fn wide_segments(
    rest: u32,
    pulses: [[u64; 2]; 4],
    period: u64,
    mut hold: impl FnMut(u32, u64) -> Option<()>,
) -> Option<()> {
    // An edge is its time and the pin that it toggles. Each is put before those that are later.
    let mut edges = [0; 8];
    for (number, at) in pulses.as_flattened().iter().enumerate() {
        let edge = at << WIDE_PINS | u64::from(OUTPUTS[number / 2].0);
        let mut place = number;
        while place > 0 && edges[place - 1] > edge {
            edges[place] = edges[place - 1];
            place -= 1;
        }
        edges[place] = edge;
    }
    let (mut now, mut pins) = (0, rest);
    for edge in edges {
        let at = edge >> WIDE_PINS;
        if at != now {
            hold(pins, at - now)?;
        }
        (now, pins) = (at, pins ^ (edge as u32 & ((1 << WIDE_PINS) - 1)));
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

    /// Plays one word. `next_sync(t)` is the first SYNC edge at or after t that is no ring-back; `emit` takes the edges in order,
    /// PROJ before CAM before AUX-A before AUX-B where some change at once.
    pub fn play(
        &mut self,
        word: u32,
        next_sync: impl FnOnce(Ticks) -> Option<Ticks>,
        mut emit: impl FnMut(Edge),
    ) -> Played {
        self.set_pins(word & ((1 << self.format.pins()) - 1), &mut emit);
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
        for (pin, line) in OUTPUTS {
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
