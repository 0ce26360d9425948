//! What the session has to say: records of steps, events and responses, as far as the outbox has room.

use rcg_protocol::{Event, Fault, Reply, Response, Seq, SessionId, Status, StepRecord, Ticks, ToHost};

use super::Session;

/// Places in the outbox that telemetry leaves to responses.
pub(super) const RESERVED: usize = 4;

/// Spurious strobes that are told one by one in a second, beyond [`SPURIOUS_AT_ONCE`]: a tenth of what a UART carries.
const SPURIOUS_PER_SECOND: u64 = 500;
/// Spurious strobes that are told one by one however quickly they come.
const SPURIOUS_AT_ONCE: u64 = 16;

/// How many events of one kind may still be told. A noisy line shall not displace what else there is to say; all are counted.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ration {
    left: u64,
    /// When `left` was last a whole number.
    since: Ticks,
}

impl Ration {
    /// Nothing told.
    pub(super) const FULL: Self = Self {
        left: SPURIOUS_AT_ONCE,
        since: Ticks::ZERO,
    };

    /// Whether one may be told at `at`, on a clock of `clock_hz`.
    fn take(&mut self, at: Ticks, clock_hz: u32) -> bool {
        let each = u64::from(clock_hz) / SPURIOUS_PER_SECOND;
        let more = at.saturating_sub(self.since).0 / each;
        self.since += Ticks(more * each);
        self.left = (self.left + more).min(SPURIOUS_AT_ONCE);
        let some = self.left > 0;
        self.left -= u64::from(some);
        some
    }
}

impl Session {
    pub(super) fn spurious(&mut self, at: Ticks) {
        self.counters.spurious_strobes = self.counters.spurious_strobes.saturating_add(1);
        if self.spurious.take(at, self.clock_hz) {
            self.send_event(Event::SpuriousStrobe {
                run: self.sequencer.run(),
                on: at,
            });
        }
    }

    pub(super) fn ended(&mut self, at: Ticks) {
        if !self.witnessed {
            let unseen = u32::try_from(self.sequencer.steps_done()).unwrap_or(u32::MAX);
            self.records_lost(unseen);
        }
        self.take_settled_strobe(Ticks(u64::MAX));
        while let Some(record) = self.witness.last(at) {
            self.record(record, at);
        }
        self.witness.clear();
        self.awaiting_sync.clear();
        self.end_photo(at);
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
            self.records_lost(records);
        }
    }

    pub(super) fn send_event(&mut self, event: Event) {
        // The end of a run may use the reserve: the host waits for it.
        let reserve = match &event {
            Event::Ended { .. } => 0,
            Event::Photo { pulses, .. } if pulses.is_empty() => 1,
            _ => RESERVED,
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
