//! Messages that wait for the link, and the step records of the batch that is being filled.
//!
//! # Design
//! A message lies in a slot until it is sent, and what is queued is the slot's number. A batch of records has a slot
//! from its first record on, so it is filled where it will be sent from: a full one is long, and to move it costs a
//! small CPU as much as to make half of it.

use core::fmt;

use heapless::{Deque, Vec};
use rcg_protocol::{Event, RECORDS_PER_EVENT, RunId, StepRecord, ToHost};

/// Messages that can wait for the link.
pub const OUTBOX: usize = 16;

/// A slot for every message, and one for the batch.
const SLOTS: usize = OUTBOX + 1;

/// The records of one message.
pub type Batch = Vec<StepRecord, RECORDS_PER_EVENT>;

const EMPTY: ToHost = ToHost::Event(Event::Records {
    run: 0,
    records: Vec::new(),
});

/// Messages, first in, first out.
#[derive(Clone)]
pub struct Outbox {
    /// Slots of the messages that wait, in their order.
    waiting: Deque<u8, OUTBOX>,
    /// Slots that are in use, as bits.
    used: u32,
    /// The slot of the batch; it always holds [`Event::Records`].
    batch: u8,
    slots: [ToHost; SLOTS],
}

/// What waits and then the batch: which slots these are in is nobody's business.
impl fmt::Debug for Outbox {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let used = self.waiting.iter().chain([&self.batch]);
        f.debug_list()
            .entries(used.map(|&slot| &self.slots[usize::from(slot)]))
            .finish()
    }
}

impl Default for Outbox {
    fn default() -> Self {
        Self::new()
    }
}

impl Outbox {
    /// No messages, and an empty batch.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            slots: [EMPTY; SLOTS],
            waiting: Deque::new(),
            used: 1,
            batch: 0,
        }
    }

    /// How many further messages can wait.
    #[must_use]
    pub fn room(&self) -> usize {
        OUTBOX - self.waiting.len()
    }

    /// Lets `message` wait behind all others. Returns whether there was room.
    pub fn push(&mut self, message: ToHost) -> bool {
        let room = self.room() > 0;
        if room {
            let slot = self.take_slot();
            self.slots[usize::from(slot)] = message;
            self.waiting.push_back(slot).ok(); // there is room
        }
        room
    }

    /// The message that has waited longest.
    #[must_use]
    pub fn front(&self) -> Option<&ToHost> {
        self.waiting.front().map(|&slot| &self.slots[usize::from(slot)])
    }

    /// Takes that message away, for one that has read it.
    pub fn discard(&mut self) {
        if let Some(slot) = self.waiting.pop_front() {
            self.used &= !(1 << slot);
        }
    }

    /// The batch that is being filled.
    pub fn batch(&mut self) -> &mut Batch {
        match &mut self.slots[usize::from(self.batch)] {
            ToHost::Event(Event::Records { records, .. }) => records,
            _ => unreachable!("the slot of the batch holds records"),
        }
    }

    /// Lets the batch wait behind all messages, as one of run `run`, and begins another. To be called while there is
    /// [room](Self::room).
    pub fn push_batch(&mut self, of_run: RunId) {
        if let ToHost::Event(Event::Records { run, .. }) = &mut self.slots[usize::from(self.batch)] {
            *run = of_run;
        }
        self.waiting
            .push_back(self.batch)
            .expect("the caller asked whether there is room");
        self.batch = self.take_slot();
        let slot = &mut self.slots[usize::from(self.batch)];
        if let ToHost::Event(Event::Records { records, .. }) = slot {
            records.clear();
        } else {
            *slot = EMPTY;
        }
    }

    /// A slot that was free: there is one more than messages can wait.
    fn take_slot(&mut self) -> u8 {
        let slot = self.used.trailing_ones() as u8;
        self.used |= 1 << slot;
        slot
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rcg_protocol::{StepId, Ticks};

    fn other(number: u32) -> ToHost {
        ToHost::Event(Event::Room {
            run: 0,
            steps: number,
        })
    }

    fn record(step: u64) -> StepRecord {
        StepRecord {
            step: StepId(step),
            trigger: Ticks(step),
            strobe: None,
            flags: rcg_protocol::StepFlags::default(),
        }
    }

    #[test]
    fn messages_and_batches_come_out_in_order_however_full_it_is() {
        let (mut outbox, mut sent, mut expected) =
            (Outbox::new(), std::vec::Vec::new(), std::vec::Vec::new());
        for turn in 0..200_u32 {
            outbox.batch().push(record(u64::from(turn))).expect("room for it");
            // A batch of one to three records, with messages before and behind it.
            if turn % 3 != 0 && outbox.room() > 0 {
                let records = outbox.batch().clone();
                outbox.push_batch(turn);
                expected.push(ToHost::Event(Event::Records { run: turn, records }));
                assert!(outbox.batch().is_empty());
            }
            let room = outbox.room() > 0;
            assert_eq!(outbox.push(other(turn)), room, "the batch takes nobody's room");
            if room {
                expected.push(other(turn));
            }
            // Sometimes full, sometimes empty.
            if outbox.batch().is_full() || turn % 40 > 20 {
                while let Some(message) = outbox.front() {
                    sent.push(message.clone());
                    outbox.discard();
                }
                outbox.batch().clear();
            }
        }
        while let Some(message) = outbox.front() {
            sent.push(message.clone());
            outbox.discard();
        }
        assert_eq!(sent, expected);
    }
}
