//! Edges of an input line, time-stamped by a state machine on the pulse engine's ticks.
//!
//! # Design
//! The state machine pushes its counter at every change of level ([`programs::edges`](super::programs)), a
//! DMA channel stores the counters in a ring, and [`Capture::peek`] reads them whenever there is time. The
//! machines of both lines are started in the same tick as the pulse engine, so all times of a run have one
//! origin. The levels are those that the PIO sees, two ticks after they came to the pin, for SYNC as for
//! STROBE and as for the pulse engine itself.
//!
//! # Tradeoffs
//! The ring is read every millisecond. A line with more than 96 pulses in that time is not one of a camera
//! or of a projector, and ends the run with a fault.

use core::cell::UnsafeCell;

use embassy_rp::gpio::Pull;
use embassy_rp::pac::dma::regs::CtrlTrig;
use embassy_rp::pac::dma::vals::DataSize;
use embassy_rp::pac::io::vals::Inover;
use embassy_rp::pac::{DMA, IO_BANK0};
use embassy_rp::peripherals::PIO0;
use embassy_rp::pio::{Config, Direction, FifoJoin, Pin, ShiftConfig, ShiftDirection, StateMachine};
use rcg_firmware::edges::{EdgeClock, Sighting, time_of};
use rcg_protocol::Ticks;

use super::chain::{abort, set_count};
use super::programs::Loaded;

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

/// One input line, watched by state machine `SM`.
///
/// The DMA writes the ring where it lies, so a capture must not move while it runs: it lives in a static.
pub(crate) struct Capture<const SM: usize> {
    machine: StateMachine<'static, PIO0, SM>,
    pin: Pin<'static, PIO0>,
    channel: usize,
    /// Where the program begins when the line is at rest, or active.
    entry: [u8; 2],
    active_low: bool,
    clock: EdgeClock,
    taken: u32,
    /// Edges that had arrived when last [looked](Self::look) for.
    known: u32,
    /// How many of what was stored are edges, once the machine stands still.
    edges: Option<u32>,
    lost: bool,
    next: Option<Sighting>,
    ring: Ring,
}

impl<const SM: usize> Capture<SM> {
    /// Watches `pin`; DMA channel `channel` stores its edges.
    pub(crate) fn new(
        mut machine: StateMachine<'static, PIO0, SM>,
        pin: Pin<'static, PIO0>,
        channel: usize,
        loaded: &Loaded,
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
        Self {
            machine,
            pin,
            channel,
            entry: loaded.entry,
            active_low: false,
            clock: EdgeClock::new(false),
            taken: 0,
            known: 0,
            edges: None,
            lost: false,
            next: None,
            ring: Ring(UnsafeCell::new([0; RING_WORDS])),
        }
    }

    /// Sets the polarity. A line that nobody drives is pulled to rest.
    pub(crate) fn set_polarity(&mut self, active_low: bool) {
        self.active_low = active_low;
        self.pin.set_pull(if active_low { Pull::Up } else { Pull::Down });
        self.set_input(if active_low {
            Inover::INVERT
        } else {
            Inover::NORMAL
        });
    }

    /// Lets nobody see the line any more: it reads as at rest until the next [`set_polarity`](Self::set_polarity).
    pub(crate) fn mute(&mut self) {
        self.set_input(Inover::LOW);
    }

    fn set_input(&self, inover: Inover) {
        let pin = usize::from(self.pin.pin());
        IO_BANK0.gpio(pin).ctrl().modify(|w| w.set_inover(inover));
    }

    /// Makes everything ready; the count begins when the state machine is enabled.
    pub(crate) fn prepare(&mut self) {
        self.stop();
        self.machine.clear_fifos();
        self.machine.restart();
        let pin = usize::from(self.pin.pin());
        let active = IO_BANK0.gpio(pin).status().read().infrompad() != self.active_low;
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
    }

    /// Looks which edges have arrived: those that can be [peeked](Self::peek) at from now on.
    pub(crate) fn look(&mut self) {
        self.known = self.edges.unwrap_or_else(|| self.arrived());
        self.lost |= self.known - self.taken > MOST_WAITING || self.taken == MOST_EDGES;
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
        abort([self.channel]);
    }
}
