//! The pulse engine: PIO and DMA play what the session decides, and what happens goes back to it.
//!
//! # Design
//! Once started the edges are made without the CPU ([`chain`](super::chain)). What is left to do is to refill
//! the chain, to report the edges of the inputs, and to see how far things are. [`Engine::turn`] does one
//! small piece of it, so that the lock around engine and session is never held for long; it is called until
//! nothing is left, by the DMA's interrupt and by the main loop's poll.
//!
//! The times of a run count from the first step's start, or from the first SYNC edge if every step waits for
//! one; state machines are started in one tick, so the counts of all of them are the same time.
//!
//! A free-running table whose steps are too short to be told one by one is played as a
//! [burst](rcg_firmware::burst).
//!
//! # Tradeoffs
//! A stop ends the run with the block that is being played: one step, or up to a millisecond of short ones.
//! The end of a run is noticed by the poll, up to a millisecond late; its time is exact all the same.

mod inputs;
mod outputs;
mod reports;

use embassy_rp::gpio::{Drive, SlewRate};
use embassy_rp::pac::PIO0 as PIO;
use embassy_rp::peripherals::PIO0;
use embassy_rp::pio::{Config, Direction, FifoJoin, Pin, Pio, ShiftConfig, ShiftDirection, StateMachine};
use rcg_firmware::burst::{Burst, Tally};
use rcg_firmware::control::PulseEngine;
use rcg_firmware::kept::Kept;
use rcg_firmware::progress::Progress;
use rcg_firmware::pulse::{SYNC_READY, WordFormat};
use rcg_firmware::session::Session;
use rcg_firmware::starts::Starts;
use rcg_protocol::{AuxPolarity, Extent, Input, Inputs, Line, Pace, Polarity, Start, Stored, Ticks};

use super::begun::Begun;
use super::capture::Capture;
use super::chain::Chain;
use super::programs::{self, Loaded};
use super::{
    Clock, DMA_PHOTO, DMA_STROBE, DMA_SYNC, DmaParts, Irqs, PulseParts, SM_PHOTO, SM_PULSE, SM_STROBE,
    SM_SYNC, kept,
};

/// The state machines, as bits.
const MACHINES: u8 = 1 << SM_PULSE | INPUT_MACHINES;

/// Those of the inputs.
const INPUT_MACHINES: u8 = 1 << SM_STROBE | 1 << SM_SYNC | 1 << SM_PHOTO;

/// `pull block`.
#[allow(clippy::unusual_byte_groupings)] // the fields of the instruction
const PULL: u16 = 0b100_00000_101_00000;

/// How long a block should be: in about that time the poll comes round, and a stop takes effect.
const BLOCK_US: u32 = 1000;

/// Steps that one turn fetches at most: the UART's FIFO is full after 350 µs, the lock is held for less than half of it.
const STEPS_PER_TURN: usize = 4;

/// Steps of a burst that one turn counts at most.
const COUNTS_PER_TURN: u32 = 16;

/// By how much it is uncertain when a step began, as the machine tells: a microsecond for each of the two clock readings,
/// and what passes between a reading and what it is of.
const BEGUN_WITHIN_US: u32 = 4;

/// Edges that one turn reports at most.
const EDGES_PER_TURN: usize = 8;

/// How far the engine is.
#[derive(Clone, Copy)]
enum Phase {
    /// Outputs at rest, nothing moves.
    Resting,
    /// Filled, to be started.
    Primed,
    /// Started at this time on the controller's clock.
    Started(Ticks),
    /// Halted, with reports of the time before that are left to make.
    Halted {
        /// When it was started.
        started: Ticks,
        /// When it was halted, from then on.
        after: Ticks,
        /// Words that the state machine had taken.
        taken: u32,
    },
    /// All of a burst, or all up to a stop, is played. How long that lasted is being counted.
    Finished {
        /// When it was started.
        started: Ticks,
        /// Steps that were played.
        fired: u64,
    },
}

/// The pulse engine.
pub(crate) struct Engine {
    clock: Clock,
    machine: StateMachine<'static, PIO0, SM_PULSE>,
    _outputs: [Pin<'static, PIO0>; 4],
    burst: Option<Burst>,
    /// How far the burst got, while that is being counted.
    tally: Option<Tally>,
    free: (Loaded, Config<'static, PIO0>),
    paced: (Loaded, Config<'static, PIO0>),
    phase: Phase,
    pace: Pace,
    polarity: Polarity,
    aux: AuxPolarity,
    /// Whether pulses of PHOTO are told of in this run.
    stamps_photo: bool,
    format: WordFormat,
    /// How long SYNC may be awaited; zero for ever.
    sync_timeout: Ticks,
    /// Steps of the run, unless it is a stream.
    total: Option<u64>,
    /// A block was cut short because there was nothing to fill it with.
    starved: bool,
    /// The start of the run, from the tick in which the state machines started.
    origin: Option<Ticks>,
    /// When the inputs' machines were started last, on the controller's clock.
    counts_since: Ticks,
    /// The channels that chain and captures use by number.
    _dma: DmaParts,
    progress: Progress,
    starts: Starts,
    begun: Begun,
    chain: Chain,
    strobe: Capture<SM_STROBE>,
    /// SYNC, or START where a run begins on that.
    sync: Capture<SM_SYNC>,
    /// Which of both it is.
    begins_on: Line,
    photo: Capture<SM_PHOTO>,
}

impl Engine {
    /// An engine at rest.
    pub(crate) fn new(parts: PulseParts, clock: Clock, kept: Kept) -> Self {
        let Pio {
            mut common,
            sm0: mut machine,
            sm1,
            sm2,
            sm3,
            ..
        } = Pio::new(parts.pio, Irqs);

        // The PIO drives the pins to rest before it gets them, so they never float.
        let Kept { lines, aux } = kept;
        outputs::drive_to_rest(&mut machine, lines, aux);
        let mut proj = common.make_pio_pin(parts.proj);
        let mut cam = common.make_pio_pin(parts.cam);
        let mut aux_a = common.make_pio_pin(parts.aux_a);
        let mut aux_b = common.make_pio_pin(parts.aux_b);
        for output in [&mut proj, &mut cam, &mut aux_a, &mut aux_b] {
            // With 33 to 100 Ω in series near what a cable looks like; an edge that is quicker would only ring more.
            output.set_drive_strength(Drive::_8mA);
            output.set_slew_rate(SlewRate::Slow);
        }
        let sync = common.make_pio_pin(parts.sync);
        let strobe = common.make_pio_pin(parts.strobe);
        let photo = common.make_pio_pin(parts.photo);
        let start = common.make_pio_pin(parts.start);
        machine.set_pin_dirs(Direction::Out, &[&proj, &cam, &aux_a, &aux_b]);

        let configure = |loaded: &Loaded, fifo_join| {
            let mut config = Config::default();
            config.use_program(&loaded.program, &[]);
            config.set_out_pins(&[&proj, &cam]);
            config.set_in_pins(&[&sync]);
            config.set_jmp_pin(&sync);
            config.fifo_join = fifo_join;
            config.shift_out = ShiftConfig {
                threshold: 32,
                direction: ShiftDirection::Right,
                auto_fill: true,
            };
            config
        };
        let free = programs::free_running(&mut common);
        let free_config = configure(&free, FifoJoin::TxOnly);
        let paced = programs::paced(&mut common);
        // A short FIFO: what is in it can wait long for SYNC, and each step in it is a SYNC edge to remember.
        let paced_config = configure(&paced, FifoJoin::Duplex);
        let edges = programs::edges(&mut common);

        Self {
            clock,
            chain: Chain::new(machine.tx_fifo_ptr() as u32),
            begun: Begun::new(machine.rx_fifo_ptr() as u32),
            starts: Starts::new(Ticks::ZERO, false, Ticks::ZERO),
            machine,
            _outputs: [proj, cam, aux_a, aux_b],
            strobe: Capture::new(sm1, strobe, DMA_STROBE, &edges, lines.strobe_active_low),
            sync: Capture::new(sm2, sync, DMA_SYNC, &edges, lines.sync_active_low)
                .with_other(start, aux.start_active_low),
            begins_on: Line::Sync,
            photo: Capture::new(sm3, photo, DMA_PHOTO, &edges, aux.photo_active_low),
            progress: Progress::new(Pace::FreeRunning),
            burst: None,
            tally: None,
            free: (free, free_config),
            paced: (paced, paced_config),
            phase: Phase::Resting,
            pace: Pace::FreeRunning,
            polarity: lines,
            aux,
            stamps_photo: false,
            format: WordFormat::new(Pace::FreeRunning, lines),
            sync_timeout: Ticks::ZERO,
            total: None,
            starved: false,
            origin: None,
            counts_since: Ticks::ZERO,
            _dma: parts.dma,
        }
    }

    /// Brings the outputs to rest and forgets everything, at once.
    fn stop(&mut self) {
        self.freeze();
        self.note_edges();
        self.strobe.stop();
        self.sync.stop();
        self.photo.stop();
        Begun::stop();
        self.phase = Phase::Resting;
    }

    /// All state machines stop in the same tick, and the outputs rest.
    fn freeze(&mut self) {
        PIO.ctrl().modify(|w| w.set_sm_enable(w.sm_enable() & !MACHINES));
        self.rest();
        self.chain.stop();
    }

    /// Fetches some steps for the block that is being filled. Returns whether there may be more.
    fn feed(&mut self, session: &mut Session) -> bool {
        (0..STEPS_PER_TURN).all(|_| self.feed_one(session))
    }

    /// Fetches a step, and queues the block when it is long enough.
    fn feed_one(&mut self, session: &mut Session) -> bool {
        if let Some(burst) = &mut self.burst {
            let store = session.sequencer().store();
            let slice = self.chain.has_room().then(|| burst.next_slice(store)).flatten();
            if let Some((range, steps)) = &slice {
                self.chain.append(store.slice(range.clone()), *steps);
            }
            return slice.is_some();
        }
        let Some(block) = self.chain.filling() else {
            return false;
        };
        if !block.is_full()
            && !self.progress.is_full()
            && let Some(fetched) = session.next_step(|words| block.push(words))
        {
            block.end_step(fetched.period);
            self.progress.push(fetched.words, fetched.period);
            let (full, ticks) = (block.is_full(), block.ticks());
            // A paced step is a block of its own.
            let enough = self.chain.enough(self.clock.micros(BLOCK_US));
            if full || ticks >= enough || self.pace == Pace::EachOnSync {
                self.queue_rest_of_block();
            }
            true
        } else {
            // Nothing more to be had now. While it is not started a block can wait for more.
            let queued = !matches!(self.phase, Phase::Primed) && self.queue_rest_of_block();
            self.starved |= queued;
            queued
        }
    }

    /// Queues the block that is being filled, unless it is empty.
    fn queue_rest_of_block(&mut self) -> bool {
        let some = self.chain.filling().is_some_and(|block| !block.is_empty());
        if some {
            let grown = self.chain.queue();
            self.progress.lengthen(grown);
        }
        some
    }

    fn loaded(&self) -> &(Loaded, Config<'static, PIO0>) {
        match self.pace {
            Pace::FreeRunning => &self.free,
            Pace::EachOnSync => &self.paced,
        }
    }
}

impl PulseEngine for Engine {
    /// Sets everything up. The blocks are filled by the turns that follow.
    fn prime(&mut self, session: &mut Session) {
        let Some(&program) = session.sequencer().program() else {
            return;
        };
        self.stop();
        self.pace = program.pace;
        self.sync_timeout = match program.start {
            // It is awaited for as long as the host is heard.
            Start::OnStartLine => Ticks::ZERO,
            _ => program.sync_timeout.to_ticks(self.clock.hz()),
        };
        self.total = match program.extent {
            Extent::Table { steps, cycles } => Some(u64::from(steps) * u64::from(cycles)),
            Extent::Stream => None,
        };
        let &aux = session.sequencer().aux();
        self.format = WordFormat::new(program.pace, program.polarity).with_aux(&aux);
        self.stamps_photo = aux.photo;
        self.take_polarity(program.polarity, aux.polarity);
        let (loaded, config) = self.loaded();
        loaded.take_format(self.format);
        let config = *config;
        self.machine.set_config(&config);
        // Of pins that are inputs the levels go nowhere.
        let pins = self.format.pins() as u8;
        if program.start == Start::OnStartLine {
            self.begin_on(Line::Start);
        }
        let begins = self.sync.gpio();
        PIO.sm(SM_PULSE).execctrl().modify(|w| w.set_jmp_pin(begins));
        PIO.sm(SM_PULSE).pinctrl().modify(|w| {
            w.set_out_count(pins);
            w.set_in_base(begins);
        });
        self.machine.clear_fifos();
        self.machine.restart();
        self.chain.prepare(self.format);
        self.progress = Progress::new(program.pace);
        self.burst = session.burst(self.clock.micros(BLOCK_US));
        self.tally = None;
        self.starved = false;
        self.origin = None;
        self.phase = Phase::Primed;
    }

    /// Starts, at once or with the first SYNC edge.
    fn go(&mut self, start: Start, session: &mut Session) {
        if !matches!(self.phase, Phase::Primed) {
            return;
        }
        self.queue_rest_of_block();
        self.chain.start();
        self.strobe.prepare();
        let active = self.sync.prepare();
        self.photo.prepare();
        self.begun.prepare();
        let ready = match self.pace {
            Pace::FreeRunning => Ticks::ZERO,
            Pace::EachOnSync => Ticks(SYNC_READY),
        };
        self.starts = Starts::new(ready, active, self.clock.micros(BEGUN_WITHIN_US));
        if self.burst.is_some() {
            self.strobe.mute();
            self.photo.mute();
            if start == Start::AtOnce {
                self.sync.mute();
            }
        }
        // By now the DMA has filled the FIFO, or moved all there is. The first word goes to the shift register,
        // so that the first tick of the program sets the pins.
        let entry = u16::from(self.loaded().0.entry[usize::from(start != Start::AtOnce)]);
        // SAFETY: the machine is disabled; the word is there, so `pull` does not stall, and the second
        // instruction (`jmp entry`) begins the program.
        unsafe {
            if !self.machine.tx().empty() {
                self.machine.exec_instr(PULL);
            }
            self.machine.exec_instr(entry);
        }
        self.machine.tx().stalled(); // forgets how the last run ended

        if !self.stamps_photo {
            self.photo.mute();
        }

        let now = self.clock.now();
        PIO.ctrl().modify(|w| {
            w.set_clkdiv_restart(MACHINES);
            w.set_sm_enable(MACHINES);
        });
        self.phase = Phase::Started(now);
        self.counts_since = now;
        if start == Start::AtOnce && self.pace == Pace::FreeRunning {
            self.origin = Some(Ticks::ZERO);
            session.begun(now);
        }
    }

    /// Brings the outputs to rest at once. The turns that follow report what is left to report, and then that the
    /// engine has halted.
    fn halt(&mut self) {
        self.freeze();
        let now = self.clock.now();
        let (started, after, taken) = match self.phase {
            Phase::Started(started) => {
                let elapsed = now.saturating_sub(started);
                (started, self.strobe.stopped_at(elapsed), self.taken())
            }
            // Edges are not stored any more, and there is no exact time.
            Phase::Finished { started, .. } => (started, now.saturating_sub(started), 0),
            _ => (Ticks::ZERO, Ticks::ZERO, 0),
        };
        self.phase = Phase::Halted {
            started,
            after,
            taken,
        };
    }

    /// Starts the inputs' machines alone.
    fn watch(&mut self) {
        if !matches!(self.phase, Phase::Resting) {
            return;
        }
        self.stop();
        self.take_polarity(self.polarity, self.aux);
        self.strobe.prepare();
        self.sync.prepare();
        self.photo.prepare();
        self.counts_since = self.clock.now();
        PIO.ctrl().modify(|w| {
            w.set_clkdiv_restart(INPUT_MACHINES);
            w.set_sm_enable(INPUT_MACHINES);
        });
    }

    fn keep(&mut self, kept: Kept) {
        if matches!(self.phase, Phase::Resting) {
            self.stop();
            self.take_polarity(kept.lines, kept.aux);
            kept::write(kept);
        }
    }

    fn store(&mut self, page: u16, bytes: &[u8]) {
        if matches!(self.phase, Phase::Resting) {
            kept::store(page, bytes);
        }
    }

    fn stored(&mut self) -> Option<Stored> {
        kept::schedule(self.clock.hz()).map(|(stored, _)| stored)
    }

    fn inputs(&mut self) -> Inputs {
        self.seen()
    }

    fn photo(&mut self) -> Input {
        self.seen_photo()
    }

    /// Does one small piece of work: about as much as the UART can wait for. Returns whether there may be more.
    fn turn(&mut self, session: &mut Session) -> bool {
        self.chain.retire();
        match self.phase {
            Phase::Resting => false,
            Phase::Primed => self.feed(session),
            Phase::Halted {
                started,
                after,
                taken,
            } => self.report_edges(session, started, after) || self.report_halt(session, after, taken),
            Phase::Finished { fired, .. } => self.report_burst(session, fired),
            Phase::Started(at) => {
                // Taken before the edges are looked at: all that came up to now, or nearly, is among them.
                let elapsed = self.clock.now().saturating_sub(at);
                if session.sequencer().is_stopping() && !self.chain.is_cut() {
                    self.chain.cut();
                    if self.origin.is_none() || self.pace == Pace::EachOnSync {
                        self.sync.mute();
                    }
                }
                // The chain has a deadline, what is reported has not. But before a paced step can be fetched the
                // session has to know which ones have begun.
                let paced = self.pace == Pace::EachOnSync;
                let more = (paced && self.report_edges(session, at, elapsed))
                    | self.feed(session)
                    | self.report_edges(session, at, elapsed);
                more || self.report_progress(session, at, elapsed)
            }
        }
    }
}
