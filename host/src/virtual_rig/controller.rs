//! The simulated controller: the firmware's own library in virtual time, as a link.
//!
//! # Design
//! Bytes go through the firmware's decoder and session; its engine commands play the firmware's own words,
//! edge by edge, into the stage. Virtual time moves only while the host waits for bytes, so a run proceeds
//! exactly as fast as the host takes it in, and nothing piles up.

use std::collections::VecDeque;
use std::time::Duration;

use rcg_firmware::pulse::{Edge, Played, Reader, SYNC_LATENCY, StepWords, WordFormat};
use rcg_firmware::session::{Action, Engine, Session};
use rcg_protocol::{Decoder, MAX_FRAME, Pace, Polarity, Start, Ticks, ToDevice, encode};

use super::SharedStage;
use super::stage::StrobeEdge;
use crate::link::{Link, LinkError};

/// Clock of the simulated controller, that of a Pico.
pub const CLOCK_HZ: u32 = 125_000_000;

/// The controller polls its time-outs this often.
const POLL: Ticks = Ticks(CLOCK_HZ as u64 / 1000);

/// The run that is being played. Times of the reader count from its start.
struct Run {
    reader: Reader,
    started: Ticks,
    steps: u64,
    strobes: VecDeque<StrobeEdge>,
    /// The SYNC edge that the session was told of last.
    last_sync: Option<Ticks>,
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
                Action::Engine(Engine::Prime) => {
                    let format = self.session.sequencer().format();
                    let format =
                        format.unwrap_or_else(|| WordFormat::new(Pace::FreeRunning, Polarity::default()));
                    self.primed = Some(Reader::new(format, Ticks::ZERO));
                }
                Action::Engine(Engine::Go(start)) => self.go(start),
                Action::Engine(Engine::Halt) => self.halt(),
            }
        }
    }

    fn go(&mut self, start: Start) {
        let Some(reader) = self.primed.take() else { return };
        if start == Start::OnSync {
            self.now = self.stage.lock().next_sync(self.now) + Ticks(SYNC_LATENCY);
        }
        self.run = Some(Run {
            reader,
            started: self.now,
            steps: 0,
            strobes: VecDeque::new(),
            last_sync: None,
        });
        self.session.begun(self.now);
    }

    fn halt(&mut self) {
        self.primed = None;
        let mut at = Ticks::ZERO;
        if let Some(mut run) = self.run.take() {
            let mut stage = self.stage.lock();
            at = self.now.saturating_sub(run.started).max(run.reader.now());
            run.reader.halt(at, |edge| {
                stage.edge(edge.line, edge.level, run.started + edge.at);
            });
        }
        self.session.halted(at);
    }

    /// Plays one step, or ends the run.
    fn play(&mut self) {
        let Some(mut run) = self.run.take() else { return };
        let mut words = StepWords::new();
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
            self.report_strobes(&mut run, Ticks(u64::MAX));
            self.session.drained(self.now.saturating_sub(run.started));
            return;
        }
        let mut synced = None;
        for &word in &words {
            let stage = &self.stage;
            let started = run.started;
            let strobes = &mut run.strobes;
            let next_sync = |from: Ticks| {
                synced = Some(stage.lock().next_sync(started + from) - started);
                synced
            };
            let emit = |edge: Edge| {
                strobes.extend(stage.lock().edge(edge.line, edge.level, started + edge.at));
            };
            if run.reader.play(word, next_sync, emit) == Played::NoSync {
                self.session.sync_missing();
                self.run = Some(run);
                return;
            }
        }
        if let Some(edge) = synced {
            self.report_syncs(&mut run, edge);
        }
        self.now = run.started + run.reader.now();
        run.steps += 1;
        let now = self.now;
        self.report_strobes(&mut run, now);
        self.session.fired(run.steps, run.reader.now());
        self.run = Some(run);
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

    /// Tells the session of the strobe edges up to `until`.
    fn report_strobes(&mut self, run: &mut Run, until: Ticks) {
        while let Some(edge) = run.strobes.pop_front_if(|edge| edge.at <= until) {
            self.now = self.now.max(edge.at);
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
        let deadline = self.now + Ticks((timeout.as_secs_f64() * f64::from(CLOCK_HZ)).round() as u64);
        while self.to_host.is_empty() && self.now < deadline {
            if self.run.is_some() {
                self.play();
            } else {
                self.now = (self.now + POLL).min(deadline);
            }
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
