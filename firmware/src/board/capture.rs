//! Edges of an input line, time-stamped by a state machine on the pulse engine's ticks.
//!
//! # Design
//! The state machine pushes its counter at every change of level ([`programs::edges`](super::programs)), a
//! DMA channel stores the counters in a ring, and [`Capture::peek`] reads them whenever there is time. The
//! machines of both lines are started in the same tick as the pulse engine, so all times of a run have one
//! origin. The levels are those that the PIO sees, two ticks after they came to the pin, for SYNC as for
//! STROBE and as for the pulse engine itself.
//!
//! Where a run begins on START, the machine of SYNC looks at that line.
//!
//! # Tradeoffs
//! The ring is read every millisecond. A line with more than 96 pulses in that time is not one of a camera
//! or of a projector, and ends the run with a fault.

use core::cell::UnsafeCell;

use embassy_rp::gpio::Pull;
use embassy_rp::pac::dma::regs::CtrlTrig;
use embassy_rp::pac::dma::vals::DataSize;
use embassy_rp::pac::io::vals::Inover;
use embassy_rp::pac::{DMA, IO_BANK0, PIO0 as PIO};
use embassy_rp::peripherals::PIO0;
use embassy_rp::pio::{Config, Direction, FifoJoin, Pin, ShiftConfig, ShiftDirection, StateMachine};
use rcg_firmware::edges::{EdgeClock, Sighting, time_of};
use rcg_protocol::{Input, Ticks};

use super::chain::{abort, set_count};
use super::programs::Loaded;
use super::{FIRST_INPUT, INPUTS};

/// Counters that the ring holds.
const RING_WORDS: usize = 256;

/// Edges that may wait: the rest of the ring is for those that come while these are read.
const MOST_WAITING: u32 = RING_WORDS as u32 * 3 / 4;

/// Binary logarithm of the ring's size in bytes.
const RING_BITS: u8 = (RING_WORDS * 4).ilog2() as u8;

/// Edges of one run, as many as both chips can count: 3 hours of 12,000 pulses a second.
const MOST_EDGES: u32 = (1 << 28) - 1;

/// `mov x, ~null`: the counter begins at its largest value.
#[allow(clippy::unusual_byte_groupings)] // the fields of the instruction
const COUNTER_FULL: u16 = 0b101_00000_001_01_011;

/// `in x, 32`: the counter goes to the FIFO.
#[allow(clippy::unusual_byte_groupings)] // the fields of the instruction
const HAND_OVER: u16 = 0b010_00000_001_00000;

/// Aligned to its size, as the DMA wraps by masking address bits.
#[repr(C, align(1024))]
struct Ring(UnsafeCell<[u32; RING_WORDS]>);

const _: () = assert!(RING_WORDS * 4 == 1024);

// SAFETY: each is used by the one capture of its state machine alone.
unsafe impl Sync for Ring {}

/// One for each input.
static RINGS: [Ring; INPUTS] = [const { Ring(UnsafeCell::new([0; RING_WORDS])) }; INPUTS];

/// One input line, watched by state machine `SM`.
///
pub(crate) struct Capture<const SM: usize> {
    machine: StateMachine<'static, PIO0, SM>,
    pin: Pin<'static, PIO0>,
    /// What this state machine has to watch in some runs in place of `pin`.
    other: Option<Pin<'static, PIO0>>,
    channel: usize,
    /// Where the program begins when the line is at rest, or active.
    entry: [u8; 2],
    active_low: bool,
    clock: EdgeClock,
    taken: u32,
    /// Edges that had arrived when last [looked](Self::look) for.
    known: u32,
    /// How many of what was stored are edges, while the machine stands still.
    edges: Option<u32>,
    lost: bool,
    next: Option<Sighting>,
    muted: bool,
    /// Edges that had arrived when last [noted](Self::note), and when the last two of them came, from the start of the count.
    noted: u32,
    last: [Option<Ticks>; 2],
    ring: &'static Ring,
}

impl<const SM: usize> Capture<SM> {
    /// Watches `pin`, which rests where `active_low` says; DMA channel `channel` stores its edges.
    pub(crate) fn new(
        mut machine: StateMachine<'static, PIO0, SM>,
        pin: Pin<'static, PIO0>,
        channel: usize,
        loaded: &Loaded,
        active_low: bool,
    ) -> Self {
        let mut config = Config::default();
        config.use_program(&loaded.program, &[]);
        config.set_jmp_pin(&pin);
        config.fifo_join = FifoJoin::RxOnly;
        config.shift_in = ShiftConfig {
            threshold: 32,
            direction: ShiftDirection::Left,
            auto_fill: true,
        };
        machine.set_config(&config);
        machine.set_pin_dirs(Direction::In, &[&pin]);
        let mut capture = Self {
            machine,
            pin,
            other: None,
            channel,
            entry: loaded.entry,
            active_low: false,
            clock: EdgeClock::new(false),
            taken: 0,
            known: 0,
            edges: Some(0),
            lost: false,
            next: None,
            muted: false,
            noted: 0,
            last: [None; 2],
            ring: &RINGS[SM - FIRST_INPUT],
        };
        // The line does not float until a schedule says which side is rest.
        capture.set_polarity(active_low);
        capture
    }

    /// Sets the polarity. A line that nobody drives is pulled to rest.
    pub(crate) fn set_polarity(&mut self, active_low: bool) {
        self.active_low = active_low;
        self.muted = false;
        self.pin.set_pull(if active_low { Pull::Up } else { Pull::Down });
        self.set_input(if active_low {
            Inover::INVERT
        } else {
            Inover::NORMAL
        });
    }

    /// Can watch `other` too, which is at rest where `active_low` says.
    pub(crate) fn with_other(mut self, mut other: Pin<'static, PIO0>, active_low: bool) -> Self {
        self.machine.set_pin_dirs(Direction::In, &[&other]);
        other.set_pull(if active_low { Pull::Up } else { Pull::Down });
        self.other = Some(other);
        self
    }

    /// Watches the other line from now on, and what was watched before is the other one.
    pub(crate) fn exchange(&mut self) {
        if let Some(other) = &mut self.other {
            core::mem::swap(&mut self.pin, other);
            let pin = self.pin.pin();
            PIO.sm(SM).execctrl().modify(|w| w.set_jmp_pin(pin));
        }
    }

    /// The line that is watched.
    pub(crate) fn gpio(&self) -> u8 {
        self.pin.pin()
    }

    /// Lets nobody see the line any more: it reads as at rest until the next [`set_polarity`](Self::set_polarity).
    pub(crate) fn mute(&mut self) {
        self.muted = true;
        self.set_input(Inover::LOW);
    }

    /// Whether the pin is high.
    fn is_high(&self) -> bool {
        Self::level(&self.pin)
    }

    fn level(pin: &Pin<'static, PIO0>) -> bool {
        IO_BANK0.gpio(usize::from(pin.pin())).status().read().infrompad()
    }

    /// Notes how many edges have come by `elapsed`, the coarse time since the count began, and when the last two did: a counter
    /// alone tells that for a minute only.
    pub(crate) fn note(&mut self, elapsed: Ticks) {
        let edges = self.edges.unwrap_or_else(|| self.arrived());
        let new = edges - self.noted;
        if new == 0 {
            return;
        }
        let when = |number: u32| Some(time_of(self.stored(number), elapsed));
        let last = when(edges - 1);
        let before = if new > 1 { when(edges - 2) } else { self.last[1] };
        // If the ring came round meanwhile these are none.
        let came_round = self.arrived() - edges > MOST_WAITING;
        self.last = if came_round { [None; 2] } else { [before, last] };
        self.noted = edges;
    }

    /// What stands at the line, as last [noted](Self::note); the count began at `since`.
    pub(crate) fn seen(&self, since: Ticks) -> Input {
        Input {
            high: self.is_high(),
            pulled_up: self.active_low,
            edges: (!self.muted).then_some(self.noted),
            last: self.last.map(|last| last.map(|last| since + last)),
        }
    }

    /// What stands at the line that is not watched, which rests where `active_low` says.
    pub(crate) fn unwatched(&self, active_low: bool) -> Input {
        Input {
            high: self.other.as_ref().is_some_and(Self::level),
            pulled_up: active_low,
            edges: None,
            last: [None; 2],
        }
    }

    fn set_input(&self, inover: Inover) {
        let pin = usize::from(self.pin.pin());
        IO_BANK0.gpio(pin).ctrl().modify(|w| w.set_inover(inover));
    }

    /// Makes everything ready; the count begins when the state machine is enabled. Returns whether the line is active.
    pub(crate) fn prepare(&mut self) -> bool {
        self.stop();
        self.machine.clear_fifos();
        self.machine.restart();
        let active = self.is_high() != self.active_low;
        let entry = u16::from(self.entry[usize::from(active)]);
        // SAFETY: the machine is disabled; the first sets X, the second (`jmp entry`) begins the program.
        unsafe {
            self.machine.exec_instr(COUNTER_FULL);
            self.machine.exec_instr(entry);
        }
        self.clock = EdgeClock::new(active);
        self.taken = 0;
        self.known = 0;
        self.edges = None;
        self.lost = false;
        self.next = None;
        self.noted = 0;
        self.last = [None; 2];

        let ch = DMA.ch(self.channel);
        ch.read_addr().write_value(self.machine.rx_fifo_ptr() as u32);
        ch.write_addr().write_value(self.ring.0.get() as u32);
        set_count(self.channel, MOST_EDGES);
        let mut control = CtrlTrig(0);
        control.set_en(true);
        control.set_data_size(DataSize::SIZE_WORD);
        control.set_incr_write(true);
        control.set_ring_sel(true);
        control.set_ring_size(RING_BITS);
        control.set_treq_sel(self.machine.rx_treq());
        control.set_chain_to(self.channel as u8);
        ch.ctrl_trig().write_value(control);
        active
    }

    /// Looks which edges have arrived: those that can be [peeked](Self::peek) at from now on.
    pub(crate) fn look(&mut self) {
        self.known = self.edges.unwrap_or_else(|| self.arrived());
        self.lost |= self.known - self.taken > MOST_WAITING || self.taken == MOST_EDGES;
    }

    /// When the next edge in the same direction as the one that was taken last came, if it has come by now; `elapsed` as in
    /// [`peek`](Self::peek).
    pub(crate) fn next_like_it(&mut self, elapsed: Ticks) -> Option<Ticks> {
        self.look();
        let some = self.known - self.taken >= 2 && !self.lost;
        some.then(|| time_of(self.stored(self.taken + 1), elapsed))
    }

    /// Whether there is no edge to peek at.
    pub(crate) fn is_empty(&self) -> bool {
        self.next.is_none() && (self.taken == self.known || self.lost)
    }

    /// The next edge; `elapsed` is the coarse time since the count began.
    pub(crate) fn peek(&mut self, elapsed: Ticks) -> Option<Sighting> {
        if self.next.is_none() {
            self.next = self.read(elapsed);
        }
        self.next
    }

    /// The next edge, which is dealt with at once.
    pub(crate) fn take(&mut self, elapsed: Ticks) -> Option<Sighting> {
        self.next.take().or_else(|| self.read(elapsed))
    }

    fn read(&mut self, elapsed: Ticks) -> Option<Sighting> {
        if self.taken == self.known || self.lost {
            return None;
        }
        let counter = self.stored(self.taken);
        self.taken += 1;
        Some(self.clock.edge(counter, elapsed))
    }

    /// The counter that the DMA stored as number `number`, which must have arrived.
    fn stored(&self, number: u32) -> u32 {
        let index = number as usize % RING_WORDS;
        let word = self.ring.0.get().cast::<u32>().wrapping_add(index);
        // SAFETY: the index is within the ring, and the DMA has written this word and has not come round to it
        // again, as fewer words wait than the ring holds. Volatile, as the compiler knows of no DMA.
        unsafe { word.read_volatile() }
    }

    /// When the count stood still; `elapsed` is the coarse time since it began. To be called once the machine is
    /// disabled. Edges of before can still be [peeked](Self::peek) at.
    pub(crate) fn stopped_at(&mut self, elapsed: Ticks) -> Ticks {
        if self.lost {
            return elapsed;
        }
        // What is still in the FIFO are edges. Then the counter is handed over as if it were one more.
        while self.machine.rx().level() > 0 {}
        let edges = self.arrived();
        self.edges = Some(edges);
        // SAFETY: the machine is disabled and has no further use of its shift register.
        unsafe { self.machine.exec_instr(HAND_OVER) };
        while self.arrived() == edges {}
        time_of(self.stored(edges), elapsed)
    }

    /// The edge that was peeked at is dealt with.
    pub(crate) fn advance(&mut self) {
        self.next = None;
    }

    /// Whether edges came faster than they were read, or more than can be counted.
    pub(crate) const fn lost(&self) -> bool {
        self.lost
    }

    fn arrived(&self) -> u32 {
        let count = DMA.ch(self.channel).trans_count().read();
        #[cfg(rp2350)]
        let count = count.count();
        MOST_EDGES - count
    }

    /// Stops storing. The state machine is disabled by the engine, together with the others.
    pub(crate) fn stop(&mut self) {
        self.edges = Some(self.noted);
        abort([self.channel]);
    }
}
