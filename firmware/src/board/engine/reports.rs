//! What the pulse engine tells the session: edges of the inputs, steps fired, the end and what went wrong.
//!
//! # Design
//! Edges go to the session in the order of their times, both lines together. Only then is it told how far the
//! run is, and of a time by which all edges are known to be in memory: so a camera that has answered is never
//! taken for one that has not.

use embassy_rp::pac::PIO0 as PIO;
use rcg_firmware::pulse::{SYNC_LATENCY, WAIT_LEAD};
use rcg_firmware::session::Session;
use rcg_protocol::{Pace, Ticks};

use super::{EDGES_PER_TURN, Engine};
use crate::board::SM_PULSE;

/// An edge is in memory this long after it came: four microseconds hold the input synchroniser, the FIFO, the
/// DMA and a step of the coarse clock.
const SETTLED_AFTER_US: u32 = 4;

impl Engine {
    /// Reports some edges of both lines. Returns whether there may be more.
    pub(super) fn report_edges(&mut self, session: &mut Session, started: Ticks, elapsed: Ticks) -> bool {
        // In this order: a SYNC edge of before a STROBE edge that has arrived has arrived too.
        self.strobe.look();
        self.sync.look();
        (0..EDGES_PER_TURN).all(|_| self.report_edge(session, started, elapsed))
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
                self.report_sync(session, started, sync.at);
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

    fn report_sync(&mut self, session: &mut Session, started: Ticks, at: Ticks) {
        let paced = self.pace == Pace::EachOnSync;
        if self.origin.is_none() {
            // The start of the run. The program looks for the edge from its first word on when paced, else from
            // its second instruction on.
            if at < Ticks(if paced { WAIT_LEAD } else { 1 }) {
                return;
            }
            let origin = if paced { at } else { at + Ticks(SYNC_LATENCY) };
            self.origin = Some(origin);
            session.begun(started + origin);
        }
        let edge = at.saturating_sub(self.origin.unwrap_or(at));
        if paced {
            session.sync(edge, self.progress.sync(edge));
        } else if self.burst.is_some() {
            self.sync.mute(); // the edge that started the burst is the only one of interest
        }
    }

    /// Reports how far the engine is, and sees whether it has come to its end. Returns whether there is room in the
    /// chain since then.
    pub(super) fn report_progress(&mut self, session: &mut Session, elapsed: Ticks) -> bool {
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
        if self.strobe.lost() || self.sync.lost() || (stalled && !dry) {
            session.engine_failed();
        } else if (dry && stalled && waiting == 0) || (self.chain.is_cut() && self.stands_between_steps()) {
            self.finish(session);
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
        let waits_at = self.loaded().0.waits_at;
        (self.origin.is_none() || self.pace == Pace::EachOnSync)
            && (waits_at..=waits_at + 1).contains(&self.machine.get_addr())
    }

    /// All that was moved was played, but for a step that still waits for SYNC.
    fn finish(&mut self, session: &mut Session) {
        let (fired, end) = if let Some(burst) = &self.burst {
            let fired = self.chain.steps_through();
            (
                fired,
                burst.duration_of(fired, session.sequencer().store(), self.format()),
            )
        } else {
            let fired = self.progress.fired(self.chain.moved(), Ticks(u64::MAX));
            (fired, self.progress.ended())
        };
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
    /// [`Phase::Halted`](super::Phase::Halted).
    pub(super) fn report_halt(&mut self, session: &mut Session, after: Ticks, taken: u32) {
        let now = after.saturating_sub(self.origin.unwrap_or(after));
        if self.origin.is_some() {
            let fired = match &self.burst {
                Some(burst) => burst.fired(now, session.sequencer().store(), self.format()),
                None => self.progress.fired(taken, now),
            };
            session.fired(fired, now);
        }
        self.stop();
        session.halted(now);
    }
}
