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

use super::Engine;
use crate::board::SM_PULSE;

/// An edge is in memory this long after it came: four microseconds hold the input synchroniser, the FIFO, the
/// DMA and a step of the coarse clock.
const SETTLED_AFTER_US: u32 = 4;

impl Engine {
    /// Reports the earlier of the next edges of both lines, if there is one.
    pub(super) fn report_edge(&mut self, session: &mut Session, started: Ticks, elapsed: Ticks) -> bool {
        let (sync, strobe) = (self.sync.peek(elapsed), self.strobe.peek(elapsed));
        // At the same time SYNC is first: it can be what made the camera expose.
        if let Some(sync) = sync
            && strobe.is_none_or(|strobe| sync.at <= strobe.at)
        {
            self.sync.advance();
            if sync.active {
                self.report_sync(session, started, sync.at);
            }
        } else if let Some(strobe) = strobe {
            self.strobe.advance();
            if let Some(origin) = self.origin
                && strobe.at >= origin
            {
                session.strobe(strobe.active, strobe.at - origin);
            }
        } else {
            return false;
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
        if paced && self.progress.sync(edge) {
            session.step_synced(edge);
        }
    }

    /// Reports how far the engine is, and sees whether it has come to its end.
    pub(super) fn report_progress(&mut self, session: &mut Session, elapsed: Ticks) {
        // In this order: a stall that was seen while the chain is not dry even afterwards is not the end of the
        // run; and a word that leaves the FIFO after the moved ones were counted can only be missed, not be
        // counted too much.
        let stalled = PIO.fdebug().read().txstall() & 1 << SM_PULSE != 0;
        let moved = self.chain.moved();
        let waiting = u32::from(self.machine.tx().level());
        self.chain.retire();

        let elapsed = elapsed.saturating_sub(self.clock.micros(SETTLED_AFTER_US));
        let now = elapsed.saturating_sub(self.origin.unwrap_or(elapsed));
        if self.origin.is_some() {
            let fired = self.progress.fired(moved.wrapping_sub(waiting), now);
            session.fired(fired, now);
        }

        let dry = self.chain.is_dry();
        let awaited_since = match self.origin {
            Some(_) => self.progress.awaits_sync_since(now).map(|since| now - since),
            None => Some(elapsed),
        };
        if self.strobe.lost() || self.sync.lost() || (stalled && !dry) {
            session.engine_failed(now);
        } else if (dry && stalled && waiting == 0) || (self.chain.is_cut() && self.stands_between_steps()) {
            self.finish(session, moved);
        } else if let Some(awaited) = awaited_since
            && self.sync_timeout > Ticks::ZERO
            && awaited > self.sync_timeout
        {
            session.sync_missing(now);
        }
    }

    /// Whether the engine waits for a SYNC edge that cannot come any more.
    fn stands_between_steps(&self) -> bool {
        let waits_at = self.loaded().0.waits_at;
        (self.origin.is_none() || self.pace == Pace::EachOnSync)
            && (waits_at..=waits_at + 1).contains(&self.machine.get_addr())
    }

    /// All that was moved was played, but for a step that still waits for SYNC.
    fn finish(&mut self, session: &mut Session, moved: u32) {
        let fired = self.progress.fired(moved, Ticks(u64::MAX));
        let end = self.progress.ended();
        self.halt();
        session.fired(fired, end);
        // A stream that ran dry is the host's affair, unplayed steps of this side are the engine's.
        let complete = fired == self.total.unwrap_or(self.progress.fetched());
        if complete || session.sequencer().is_stopping() {
            session.drained(end);
        } else {
            session.engine_failed(end);
        }
    }
}
