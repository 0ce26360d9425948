//! What the pulse engine asks the session for, and what it tells it.

use rcg_protocol::{Event, Extent, Fault, Line, Pace, Reply, State, StepFlags, StepId, Ticks};

use super::{EngineCommand, ROOM_EVERY, Session, micros};
use crate::burst::{Burst, SLACK_US};
use crate::edges::Sighting as Edge;
use crate::pulse::SYNC_LATENCY;
use crate::sequencer::Fetched;
use crate::vsync::Regularity;
use crate::witness::Sighting;

impl Session {
    /// The loaded table as a burst, if its steps are too short and too many to be told one by one.
    /// Then no step has a record, which is counted, and none is left to [`next_step`](Self::next_step). To be
    /// asked for when the engine is primed.
    pub fn burst(&mut self, slice_for: Ticks) -> Option<Burst> {
        let slack = micros(SLACK_US, self.clock_hz);
        let burst = self.sequencer.burst(slack, slice_for);
        self.witnessed = burst.is_none();
        burst
    }

    /// The next step for the engine, its words handed to `take` in one piece or two; `None` if it shall let what it
    /// has run out.
    pub fn next_step(&mut self, take: impl FnMut(&[u32])) -> Option<Fetched> {
        if self.awaiting_sync.is_full() {
            return None; // a paced engine fetches a step or two ahead, never this many
        }
        let fetched = self.sequencer.next_step(take)?;
        let paced = self
            .sequencer
            .program()
            .is_some_and(|p| p.pace == Pace::EachOnSync);
        if paced {
            self.awaiting_sync.push_back(fetched).ok();
        } else {
            self.announce(&fetched, fetched.begins);
        }
        Some(fetched)
    }

    fn announce(&mut self, fetched: &Fetched, begins: Ticks) {
        let at = fetched.trigger.map_or(begins, |offset| begins + offset);
        if let Some(record) = self.witness.announce(fetched.step, at, fetched.trigger.is_some()) {
            self.record(record, at);
        }
    }

    /// The first step began at `at` on the controller's clock. All later times of the run count from it.
    pub fn begun(&mut self, at: Ticks) {
        self.sequencer.begun(at);
        self.send_event(Event::Started {
            run: self.sequencer.run(),
            at,
        });
    }

    /// A SYNC edge of a paced run came at `edge` from its start, and may have begun the next step.
    pub fn sync(&mut self, edge: Ticks, begins_step: bool) {
        if begins_step && let Some(fetched) = self.awaiting_sync.pop_front() {
            self.announce(&fetched, edge + Ticks(SYNC_LATENCY));
        }
        match self.vsync.edge(edge) {
            Regularity::Regular => {}
            Regularity::AfterMissing => self.witness.flag_newest(StepFlags::SYNC_MISSED),
            Regularity::Extra => self.witness.flag_newest(StepFlags::SYNC_EXTRA),
        }
    }

    /// The engine has fired `steps` steps of this run whole, at `now` from the start of the run.
    pub fn fired(&mut self, steps: u64, now: Ticks) {
        let before = self.sequencer.steps_done();
        self.sequencer.fired(steps);
        self.take_settled_strobe(now);
        // An edge that is not certain yet has its say before the steps that it may belong to.
        self.settle(self.filter.doubtful().map_or(now, |doubtful| doubtful.min(now)));
        let streaming = self
            .sequencer
            .program()
            .is_some_and(|p| p.extent == Extent::Stream);
        if streaming && before / ROOM_EVERY != steps / ROOM_EVERY {
            self.send_event(Event::Room {
                run: self.sequencer.run(),
                steps: self.sequencer.room(),
            });
        }
    }

    /// STROBE became active (or went to rest) at `at`, from the start of the run.
    pub fn strobe(&mut self, active: bool, at: Ticks) {
        if let Some(edge) = self.filter.edge(Edge { active, at }) {
            self.strobe_meant(edge);
        }
        self.take_settled_strobe(at);
    }

    /// Takes the last edge of STROBE, if it is certain by `now` that it is none of a glitch.
    pub(super) fn take_settled_strobe(&mut self, now: Ticks) {
        if let Some(edge) = self.filter.settled(now) {
            self.strobe_meant(edge);
        }
    }

    fn strobe_meant(&mut self, Edge { active, at }: Edge) {
        if active {
            self.settle(at);
            if self.witness.strobe_on(at) == Sighting::Spurious {
                self.spurious(at);
            }
        } else {
            self.witness.strobe_off(at);
        }
    }

    /// The engine has nothing more to play, and all edges up to `at` (from the start of the run) were reported. If
    /// that is too soon the host was late.
    pub fn drained(&mut self, at: Ticks) {
        if self.sequencer.state() == State::Running {
            self.sequencer.drained();
            self.ended(at);
            self.go_on();
        }
    }

    /// No SYNC edge came in time for the next step.
    pub fn sync_missing(&mut self) {
        let step = StepId(self.sequencer.steps_done());
        self.fail(Fault::SyncTimeout { step });
    }

    /// It is not certain which SYNC edge began `step`.
    pub fn sync_unclear(&mut self, step: StepId) {
        self.fail(Fault::SyncUnclear { step });
    }

    /// `line`, an input, has more edges than can be told apart.
    pub fn input_too_fast(&mut self, line: Line) {
        self.fail(Fault::InputTooFast { line });
    }

    /// The engine lost its timing.
    pub fn engine_failed(&mut self) {
        self.fail(Fault::Engine);
    }

    pub(super) fn fail(&mut self, fault: Fault) {
        let state = self.sequencer.state();
        if self.sequencer.fail(fault) {
            self.halt(state);
        }
    }

    pub(super) fn halt(&mut self, in_state: State) {
        self.engine = Some(EngineCommand::Halt);
        self.halting = Some(in_state);
    }

    /// The engine has halted at `at` from the start of the run, and everything up to then was reported.
    pub fn halted(&mut self, at: Ticks) {
        if self.halting.take().is_none() {
            return;
        }
        self.ended(at);
        for (seq, now) in core::mem::take(&mut self.unanswered) {
            let result = Ok(Reply::Status(self.status(now)));
            self.respond(self.id, seq, result);
        }
    }
}
