//! What the pulse engine tells the session: edges of the inputs, steps fired, the end and what went wrong.
//!
//! # Design
//! Edges go to the session in the order of their times, both lines together. Only then is it told how far the
//! run is, and of a time by which all edges are known to be in memory: so a camera that has answered is never
//! taken for one that has not.

use embassy_rp::pac::PIO0 as PIO;
use rcg_firmware::burst::{Burst, Tally};
use rcg_firmware::pulse::{SYNC_LATENCY, SYNC_READY};
use rcg_firmware::session::Session;
use rcg_firmware::starts::{SyncEdge, Unclear};
use rcg_protocol::{Line, Pace, StepId, Ticks};

use super::{COUNTS_PER_TURN, EDGES_PER_TURN, Engine, Phase};
use crate::board::SM_PULSE;

/// An edge is in memory this long after it came: four microseconds hold the input synchroniser, the FIFO, the
/// DMA and a step of the coarse clock.
const SETTLED_AFTER_US: u32 = 4;

impl Engine {
    /// Reports some edges of both lines. Returns whether there may be more.
    pub(super) fn report_edges(&mut self, session: &mut Session, started: Ticks, elapsed: Ticks) -> bool {
        // In this order: a SYNC edge of before a STROBE edge that has arrived has arrived too.
        self.strobe.look();
        if self.stamps_photo {
            self.photo.look();
        }
        self.sync.look();
        (0..EDGES_PER_TURN)
            .all(|_| self.report_edge(session, started, elapsed) || self.report_photo(session, elapsed))
    }

    /// Reports the next edge of PHOTO, if there is one: once the others are told of, so that the start of the run is known.
    fn report_photo(&mut self, session: &mut Session, elapsed: Ticks) -> bool {
        if !self.stamps_photo || self.photo.is_empty() {
            return false;
        }
        let Some(edge) = self.photo.take(elapsed) else {
            return false;
        };
        if let Some(origin) = self.origin
            && edge.at >= origin
        {
            session.photo(edge.active, edge.at - origin);
        }
        true
    }

    /// Reports the earlier of the next edges of both lines, if there is one.
    fn report_edge(&mut self, session: &mut Session, started: Ticks, elapsed: Ticks) -> bool {
        // At the same time SYNC is first: it can be what made the camera expose. Most runs have none.
        if !self.sync.is_empty()
            && let Some(sync) = self.sync.peek(elapsed)
            && self
                .strobe
                .peek(elapsed)
                .is_none_or(|strobe| sync.at <= strobe.at)
        {
            self.sync.advance();
            if sync.active {
                self.report_sync(session, started, elapsed, sync.at);
            } else {
                self.starts.rests(sync.at);
            }
            return true;
        }
        let Some(strobe) = self.strobe.take(elapsed) else {
            return false;
        };
        if let Some(origin) = self.origin
            && strobe.at >= origin
        {
            session.strobe(strobe.active, strobe.at - origin);
        }
        true
    }

    fn report_sync(&mut self, session: &mut Session, started: Ticks, elapsed: Ticks, at: Ticks) {
        let waits = match (self.pace, self.origin) {
            (Pace::FreeRunning, origin) => origin.is_none(),
            (Pace::EachOnSync, _) => self.progress.has_waiting(),
        };
        let edge = if waits {
            self.judge_edge(started, elapsed, at)
        } else {
            // The machine waits for none, or is stopped.
            Ok(self.starts.idle_edge(at))
        };
        let Ok(edge) = edge else {
            self.sync_unclear(session);
            return;
        };
        let begins = edge == SyncEdge::Begins;
        let paced = self.pace == Pace::EachOnSync;
        if begins && self.origin.is_none() {
            // The start of the run: of the first edge when paced, else of the first step.
            let origin = if paced { at } else { at + Ticks(SYNC_LATENCY) };
            self.origin = Some(origin);
            session.begun(started + origin);
        }
        let Some(origin) = self.origin else {
            return;
        };
        if begins && paced {
            let ends = self.progress.sync(at - origin);
            self.starts.wait_from(origin + ends + Ticks(SYNC_READY));
        }
        if paced && edge != SyncEdge::Bounce {
            session.sync(at - origin, begins);
        } else if self.burst.is_some() {
            self.sync.mute(); // the edge that started the burst is the only one of interest
        }
    }

    /// What the edge at `at` did, if a step waited for one.
    fn judge_edge(&mut self, started: Ticks, elapsed: Ticks, at: Ticks) -> Result<SyncEdge, Unclear> {
        let Self {
            phase,
            pace,
            clock,
            begun,
            machine,
            starts,
            sync,
            ..
        } = self;
        let loaded = match pace {
            Pace::FreeRunning => &self.free.0,
            Pace::EachOnSync => &self.paced.0,
        };
        let told = |step| match pace {
            Pace::EachOnSync => begun
                .micros_of(step)
                .map(|us| clock.at_micros(us).saturating_sub(started)),
            Pace::FreeRunning => (!loaded.is_waiting(machine.get_addr())).then_some(at),
        };
        let settled = |step| {
            told(step).or_else(|| {
                clock.spin(SETTLED_AFTER_US);
                told(step)
            })
        };
        match starts.edge(at, settled, || sync.next_like_it(elapsed)) {
            // It came with the halt, or after it.
            Err(Unclear) if matches!(phase, Phase::Halted { .. }) => Ok(SyncEdge::Idle),
            edge => edge,
        }
    }

    fn sync_unclear(&self, session: &mut Session) {
        if matches!(self.phase, Phase::Halted { .. }) {
            return;
        }
        if self.begins_on == Line::Start {
            session.input_too_fast(Line::Start);
        } else {
            session.sync_unclear(StepId(u64::from(self.starts.known())));
        }
    }

    /// Reports how far the engine is, and sees whether it has come to its end. Returns whether there is room in the
    /// chain since then.
    pub(super) fn report_progress(&mut self, session: &mut Session, started: Ticks, elapsed: Ticks) -> bool {
        // In this order: a stall that was seen while the chain is not dry even afterwards is not the end of the run.
        let stalled = PIO.fdebug().read().txstall() & 1 << SM_PULSE != 0;
        let taken = self.taken();
        let waiting = self.machine.tx().level();
        let room = self.chain.retire();

        let elapsed = elapsed.saturating_sub(self.clock.micros(SETTLED_AFTER_US));
        let now = elapsed.saturating_sub(self.origin.unwrap_or(elapsed));
        if self.origin.is_some() {
            let fired = match self.burst {
                Some(_) => self.chain.steps_through(),
                None => self.progress.fired(taken, now),
            };
            session.fired(fired, now);
        }

        let dry = self.chain.is_dry();
        let awaited_since = match self.origin {
            Some(_) => self.progress.awaits_sync_since(now).map(|since| now - since),
            None => Some(elapsed),
        };
        // Steps whose edge is still on its way to be told of are not over.
        let begun = self.pace == Pace::EachOnSync && self.begun.micros_of(self.starts.known()).is_some();
        let settling = self.clock.micros(2 * SETTLED_AFTER_US);
        if self.starts.agree(begun, elapsed, settling).is_err() {
            self.sync_unclear(session);
        } else if self.strobe.lost() {
            session.input_too_fast(Line::Strobe);
        } else if self.sync.lost() {
            session.input_too_fast(self.begins_on);
        } else if self.stamps_photo && self.photo.lost() {
            session.input_too_fast(Line::Photo);
        } else if stalled && !dry {
            session.engine_failed();
        } else if begun {
            return room;
        } else if (dry && stalled && waiting == 0) || (self.chain.is_cut() && self.stands_between_steps()) {
            self.finish(session, started);
        } else if let Some(awaited) = awaited_since
            && self.sync_timeout > Ticks::ZERO
            && awaited > self.sync_timeout
        {
            session.sync_missing();
        }
        room
    }

    /// Words that the state machine has taken; wraps. A word that leaves the FIFO meanwhile can only be missed.
    pub(super) fn taken(&mut self) -> u32 {
        let moved = self.chain.moved();
        moved.wrapping_sub(u32::from(self.machine.tx().level()))
    }

    /// Whether the engine waits for a SYNC edge that cannot come any more.
    fn stands_between_steps(&self) -> bool {
        (self.origin.is_none() || self.pace == Pace::EachOnSync)
            && self.loaded().0.is_waiting(self.machine.get_addr())
    }

    /// All that was moved was played, but for a step that still waits for SYNC.
    fn finish(&mut self, session: &mut Session, started: Ticks) {
        if self.burst.is_some() {
            let fired = self.chain.steps_through();
            self.stop();
            self.phase = Phase::Finished { started, fired };
            return;
        }
        let fired = self.progress.fired(self.chain.moved(), Ticks(u64::MAX));
        let end = self.progress.ended();
        self.end(session, fired, end);
    }

    /// Counts how long the `fired` steps of a burst lasted. Returns whether that goes on.
    pub(super) fn report_burst(&mut self, session: &mut Session, fired: u64) -> bool {
        let counted = self.count_burst(session, |burst| burst.tally_of(fired));
        if let Some((_, end)) = counted {
            self.end(session, fired, end);
        }
        counted.is_none()
    }

    /// Goes on counting how far the burst got.
    fn count_burst(
        &mut self,
        session: &Session,
        begin: impl FnOnce(&Burst) -> Tally,
    ) -> Option<(u64, Ticks)> {
        let format = self.format;
        let burst = self.burst.as_ref()?;
        let tally = self.tally.get_or_insert_with(|| begin(burst));
        tally.go_on(burst, session.sequencer().store(), format, COUNTS_PER_TURN)
    }

    /// The run is over: `fired` steps were played whole, the last of which ended at `end`.
    fn end(&mut self, session: &mut Session, fired: u64, end: Ticks) {
        // A stream that ran dry is the host's affair, and so are steps that came when it was already running dry.
        // Other unplayed steps are the engine's.
        let complete = match self.total {
            Some(total) => fired == total,
            None => fired == self.progress.fetched() || self.starved,
        };
        if complete || session.sequencer().is_stopping() {
            self.stop();
            session.fired(fired, end);
            session.drained(end);
        } else {
            session.engine_failed();
        }
    }

    /// All edges of the time before the halt are reported; `after` and `taken` as in
    /// [`Phase::Halted`](super::Phase::Halted). Returns whether there is more to do.
    pub(super) fn report_halt(&mut self, session: &mut Session, after: Ticks, taken: u32) -> bool {
        let now = after.saturating_sub(self.origin.unwrap_or(after));
        if self.origin.is_some() {
            let fired = if self.burst.is_some() {
                match self.count_burst(session, |burst| burst.tally_by(now)) {
                    Some((fired, _)) => fired,
                    None => return true,
                }
            } else {
                self.progress.fired(taken, now)
            };
            session.fired(fired, now);
        }
        self.stop();
        session.halted(now);
        false
    }
}
