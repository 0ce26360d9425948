//! Runs that are armed and started: by the host, and of a series by the box.

use rcg_protocol::{Fault, RunId, Start, State, Ticks};

use super::reports::Ration;
use super::{EngineCommand, Session};
use crate::edges::Filter;
use crate::vsync::VsyncWatch;

impl Session {
    pub(super) fn arm(&mut self) -> Result<RunId, Fault> {
        let run = self.sequencer.arm()?;
        let program = self.sequencer.program();
        self.dead_man = program.map_or(Ticks::ZERO, |p| p.dead_man.to_ticks(self.clock_hz));
        self.witness.clear();
        self.spurious = Ration::FULL;
        self.filter = Filter::new(self.shortest_strobe);
        self.awaiting_sync.clear();
        self.vsync = VsyncWatch::new();
        self.witnessed = true;
        self.outbox.batch().clear();
        self.photo.clear();
        self.starts_again = false;
        self.engine = Some(EngineCommand::Prime);
        Ok(run)
    }

    pub(super) fn start(&mut self) -> Result<(), Fault> {
        self.sequencer.start()?;
        let start = self.sequencer.program().map_or(Start::AtOnce, |p| p.start);
        self.engine = Some(EngineCommand::Go(start));
        Ok(())
    }

    /// The run is done and told of: arms the next one of its series, if there is one. It starts at the next poll, when the engine has
    /// filled its blocks.
    pub(super) fn go_on(&mut self) {
        if self.sequencer.state() == State::Done && self.runs_left != Some(0) && self.arm().is_ok() {
            self.runs_left = self.runs_left.map(|left| left - 1);
            self.starts_again = true;
        }
    }
}
