//! What the session has to say: records of steps, events and responses, as far as the outbox has room.

use rcg_protocol::{Event, Fault, Reply, Response, Seq, SessionId, Status, StepRecord, Ticks, ToHost};

use super::Session;

/// Places in the outbox that telemetry leaves to responses.
const RESERVED: usize = 4;

impl Session {
    pub(super) fn ended(&mut self, at: Ticks) {
        if !self.witnessed {
            let unseen = u32::try_from(self.sequencer.steps_done()).unwrap_or(u32::MAX);
            self.counters.records_lost = self.counters.records_lost.saturating_add(unseen);
        }
        while let Some(record) = self.witness.last(at) {
            self.record(record, at);
        }
        self.witness.clear();
        self.awaiting_sync.clear();
        self.flush();
        let Status {
            state,
            run,
            steps_done,
            fault,
            ..
        } = self.status(at);
        self.send_event(Event::Ended {
            run,
            state,
            fault,
            steps_done,
            at,
        });
    }

    pub(super) fn settle(&mut self, now: Ticks) {
        while let Some(record) = self.witness.settled(now) {
            self.record(record, now);
        }
    }

    pub(super) fn record(&mut self, record: StepRecord, now: Ticks) {
        let batch = self.outbox.batch();
        if batch.is_empty() {
            self.batch_since = now;
        }
        batch.push(record).ok(); // flushed when full, so there is room
        if batch.is_full() {
            self.flush();
        }
    }

    pub(super) fn flush(&mut self) {
        let batch = self.outbox.batch();
        let records = batch.len() as u32;
        if records == 0 {
            return;
        }
        if self.outbox.room() > RESERVED {
            self.outbox.push_batch(self.sequencer.run());
        } else {
            self.outbox.batch().clear();
            self.counters.records_lost += records;
        }
    }

    pub(super) fn send_event(&mut self, event: Event) {
        // The end of a run may use the reserve: the host waits for it.
        let reserve = if matches!(event, Event::Ended { .. }) {
            0
        } else {
            RESERVED
        };
        if self.outbox.room() > reserve {
            self.outbox.push(ToHost::Event(event));
        }
    }

    pub(super) fn respond(&mut self, session: SessionId, seq: Seq, result: Result<Reply, Fault>) {
        // If even the reserve is full the host asks again and is answered from memory.
        self.outbox
            .push(ToHost::Response(Response { session, seq, result }));
    }
}
