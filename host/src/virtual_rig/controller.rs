//! The simulated controller: the firmware's own library in virtual time, as a link.
//!
//! # Design
//! Bytes go through the firmware's decoder and session; its engine commands play the firmware's own words,
//! edge by edge, into the stage. Virtual time moves only while the host waits for bytes, never beyond what the host waits
//! for, and word by word: a run proceeds exactly as fast as the host takes it in, nothing piles up, and a host that makes
//! itself heard while a long word lasts is heard in time.

use std::collections::VecDeque;
use std::time::Duration;

use rcg_firmware::pulse::{Edge, Played, Reader, SYNC_LATENCY, StepWords, WordFormat};
use rcg_firmware::session::{Action, EngineCommand, Session};
use rcg_protocol::{Decoder, MAX_FRAME, Pace, Polarity, Start, Ticks, ToDevice, encode};

use super::SharedStage;
use super::stage::StrobeEdge;
use crate::capture::link::{Link, LinkError};

/// Clock of the simulated controller, that of a Pico.
pub const CLOCK_HZ: u32 = 125_000_000;

/// The controller polls its time-outs this often.
const POLL: Ticks = Ticks(CLOCK_HZ as u64 / 1000);

/// What the run is at.
enum Phase {
    /// Its first step begins at [`Run::started`].
    Ahead,
    /// Its words play. The reader's time is when the next one begins.
    Playing,
    /// A word waits for the SYNC edge at this time from the start, which is still to be told.
    Synced(Ticks),
    /// SYNC does not come before the time-out, which is over at this time from the start.
    SyncLost(Ticks),
    /// The last word is over; edges of STROBE may still come, until this time from the start.
    Draining(Ticks),
}

/// The run that is being played. Times of the reader count from its start.
struct Run {
    reader: Reader,
    started: Ticks,
    phase: Phase,
    /// Words of the present step that are still to be played, the next one last.
    words: StepWords,
    /// Whether a step has begun that is not over.
    in_step: bool,
    steps: u64,
    strobes: VecDeque<StrobeEdge>,
    /// The SYNC edge that the session was told of last.
    last_sync: Option<Ticks>,
}

impl Run {
    /// When something is to be done next, on the controller's clock.
    fn due(&self) -> Ticks {
        self.started
            + match self.phase {
                Phase::Ahead => Ticks::ZERO,
                Phase::Playing | Phase::Synced(_) => self.reader.now(),
                Phase::SyncLost(at) | Phase::Draining(at) => at,
            }
    }
}

/// A link to the simulated controller.
pub struct VirtualController {
    stage: SharedStage,
    session: Session,
    decoder: Decoder,
    now: Ticks,
    primed: Option<Reader>,
    run: Option<Run>,
    to_host: VecDeque<u8>,
}

impl VirtualController {
    pub(super) fn new(stage: SharedStage, seed: u32) -> Self {
        Self {
            stage,
            session: Session::new(CLOCK_HZ, seed),
            decoder: Decoder::new(),
            now: Ticks::ZERO,
            primed: None,
            run: None,
            to_host: VecDeque::new(),
        }
    }

    /// Does what the session wants done.
    fn act(&mut self) {
        while let Some(action) = self.session.action() {
            match action {
                Action::Send(message) => {
                    let mut buffer = [0; MAX_FRAME];
                    let frame = encode(&message, &mut buffer).expect("MAX_FRAME holds every message");
                    self.to_host.extend(frame.iter());
                }
                Action::Engine(EngineCommand::Prime) => {
                    let format = self.session.sequencer().format();
                    let format =
                        format.unwrap_or_else(|| WordFormat::new(Pace::FreeRunning, Polarity::default()));
                    self.primed = Some(Reader::new(format, Ticks::ZERO));
                }
                Action::Engine(EngineCommand::Go(start)) => self.go(start),
                Action::Engine(EngineCommand::Halt) => self.halt(),
            }
        }
    }

    fn go(&mut self, start: Start) {
        let Some(reader) = self.primed.take() else { return };
        let (mut started, mut phase) = (self.now, Phase::Ahead);
        if start == Start::OnSync {
            // An edge at this very tick is over before the engine waits for it.
            let edge = self.stage.lock().next_sync(self.now + Ticks(1));
            match self.sync_lost(edge - self.now) {
                Some(timeout) => phase = Phase::SyncLost(timeout),
                None => started = edge + Ticks(SYNC_LATENCY),
            }
        }
        self.run = Some(Run {
            reader,
            started,
            phase,
            words: StepWords::new(),
            in_step: false,
            steps: 0,
            strobes: VecDeque::new(),
            last_sync: None,
        });
    }

    /// The time-out of SYNC, if it is over when an edge has been awaited for so long.
    fn sync_lost(&self, awaited: Ticks) -> Option<Ticks> {
        let timeout = self
            .session
            .sequencer()
            .program()?
            .sync_timeout
            .to_ticks(CLOCK_HZ);
        (timeout > Ticks::ZERO && awaited > timeout).then_some(timeout)
    }

    fn halt(&mut self) {
        self.primed = None;
        let mut at = Ticks::ZERO;
        if let Some(mut run) = self.run.take() {
            at = self.now.saturating_sub(run.started);
            run.reader.halt(at, |edge| {
                self.stage
                    .lock()
                    .edge(edge.line, edge.level, run.started + edge.at);
            });
        }
        self.session.halted(at);
    }

    /// Lets time go on, to `deadline` at most: to what the run does next, which is done, or to the next poll.
    fn advance(&mut self, deadline: Ticks) {
        let Some(mut run) = self.run.take() else {
            self.now = (self.now + POLL).min(deadline);
            return;
        };
        let due = run.due();
        self.now = self.now.max(due.min(deadline).min(self.now + POLL));
        self.report_strobes(&mut run);
        if self.now < due || self.proceed(&mut run) {
            self.run = Some(run);
        }
    }

    /// Does what is due in `run`; returns whether it goes on.
    fn proceed(&mut self, run: &mut Run) -> bool {
        match run.phase {
            Phase::Ahead => {
                self.session.begun(run.started);
                run.phase = Phase::Playing;
            }
            Phase::Synced(edge) => {
                self.report_syncs(run, edge);
                run.phase = Phase::Playing;
            }
            Phase::SyncLost(_) => self.session.sync_missing(),
            Phase::Draining(at) => {
                self.session.drained(at);
                return false;
            }
            Phase::Playing => self.play(run),
        }
        true
    }

    /// Plays the next word, of the next step if none of the present one is left.
    fn play(&mut self, run: &mut Run) {
        if run.words.is_empty() {
            if std::mem::take(&mut run.in_step) {
                run.steps += 1;
                self.session.fired(run.steps, run.reader.now());
            }
            let words = &mut run.words;
            let push = |piece: &[u32]| {
                words
                    .extend_from_slice(piece)
                    .expect("a step has room for its words");
            };
            if self.session.next_step(push).is_none() {
                // The engine rests after its last word, as if one more of resting levels followed.
                let end = run.reader.now();
                let (stage, started, strobes) = (&self.stage, run.started, &mut run.strobes);
                run.reader.halt(end, |edge| {
                    strobes.extend(stage.lock().edge(edge.line, edge.level, started + edge.at));
                });
                let last = run.strobes.back().map_or(end, |edge| edge.at - started);
                run.phase = Phase::Draining(last.max(end));
                return;
            }
            run.words.reverse();
            run.in_step = true;
        }
        let word = run.words.pop().expect("a step has words");
        let from = run.reader.now();
        let (stage, started, strobes) = (&self.stage, run.started, &mut run.strobes);
        let mut synced = None;
        let next_sync = |from: Ticks| {
            synced = Some(stage.lock().next_sync(started + from) - started);
            synced
        };
        let emit = |edge: Edge| {
            strobes.extend(stage.lock().edge(edge.line, edge.level, started + edge.at));
        };
        let played = run.reader.play(word, next_sync, emit);
        debug_assert_eq!(played, Played::Through, "the projector's vsync goes on for ever");
        if let Some(edge) = synced {
            let lost = self.sync_lost(edge - from);
            run.phase = lost.map_or(Phase::Synced(edge), |timeout| Phase::SyncLost(from + timeout));
        }
    }

    /// Tells the session of the SYNC edges up to `begins_step`, which began a step.
    fn report_syncs(&mut self, run: &mut Run, begins_step: Ticks) {
        while let Some(last) = run.last_sync {
            let from = run.started + last + Ticks(1);
            let edge = self.stage.lock().next_sync(from) - run.started;
            if edge >= begins_step {
                break;
            }
            self.session.sync(edge, false);
            run.last_sync = Some(edge);
        }
        self.session.sync(begins_step, true);
        run.last_sync = Some(begins_step);
    }

    /// Tells the session of the strobe edges that have come.
    fn report_strobes(&mut self, run: &mut Run) {
        while let Some(edge) = run.strobes.pop_front_if(|edge| edge.at <= self.now) {
            self.session
                .strobe(edge.active, edge.at.saturating_sub(run.started));
        }
    }
}

impl Link for VirtualController {
    fn send(&mut self, bytes: &[u8]) -> Result<(), LinkError> {
        for &byte in bytes {
            match self.decoder.push::<ToDevice>(byte) {
                Some(Ok(message)) => self.session.request(self.now, &message),
                Some(Err(_)) => self.session.corrupt_frame(),
                None => {}
            }
            self.act();
        }
        Ok(())
    }

    fn receive(&mut self, buffer: &mut [u8], timeout: Duration) -> Result<usize, LinkError> {
        // Rounded up: time goes on in every wait, however short, or who waits for the rest of a tick waits for ever.
        let wait = Ticks((timeout.as_secs_f64() * f64::from(CLOCK_HZ)).ceil() as u64);
        let deadline = self.now + wait;
        while self.to_host.is_empty() && self.now < deadline {
            self.advance(deadline);
            self.session.poll(self.now);
            self.act();
        }
        let count = self.to_host.len().min(buffer.len());
        for (to, byte) in buffer.iter_mut().zip(self.to_host.drain(..count)) {
            *to = byte;
        }
        Ok(count)
    }

    fn now(&self) -> Duration {
        Duration::from_secs_f64(self.now.0 as f64 / f64::from(CLOCK_HZ))
    }

    fn peer(&self) -> &'static str {
        "sim"
    }
}
