//! The firmware's library in virtual time as what stands at the end of a mocked line.

use std::collections::VecDeque;

use rcg_firmware::virtual_time::VirtualBox;
use rcg_protocol::Ticks;

use super::table::Table;
use crate::controller::TICK_NS;
use crate::world::Peer;

/// The box is let go on so often.
const LOOK_NS: u64 = 250_000;

/// A trigger box that may lose its supply for a moment.
pub(super) struct Box {
    inner: VirtualBox<Table>,
    table: Table,
    seed: u32,
    said: VecDeque<Vec<u8>>,
    next_ns: u64,
    /// It is switched off and on when so many exposures were begun.
    reset_at: Option<u64>,
}

impl Box {
    /// A box with `table` at its pins.
    pub(super) fn new(table: Table, seed: u32, reset_at: Option<u64>) -> Self {
        Self {
            inner: Self::on(&table, seed, Ticks::ZERO),
            table,
            seed,
            said: VecDeque::new(),
            next_ns: LOOK_NS,
            reset_at,
        }
    }

    fn on(table: &Table, seed: u32, now: Ticks) -> VirtualBox<Table> {
        VirtualBox::new(table.clone(), (1_000_000_000 / TICK_NS) as u32, seed, now)
    }
}

impl Peer for Box {
    fn byte(&mut self, _now_ns: u64, byte: u8) {
        self.inner
            .hear(&[byte], |frame| self.said.push_back(frame.to_vec()));
    }

    fn tick(&mut self, now_ns: u64) {
        let now = Ticks(now_ns / TICK_NS);
        if self.reset_at.is_some_and(|at| self.table.exposures() >= at) {
            self.reset_at = None;
            self.seed = self.seed.wrapping_add(1);
            // Its outputs have resistors that pull them to rest.
            self.table.rest();
            self.said.clear();
            self.inner = Self::on(&self.table, self.seed, now);
        }
        while self.inner.now() < now {
            self.inner.advance(now);
            self.inner.poll();
            self.inner.act(|frame| self.said.push_back(frame.to_vec()));
        }
        self.next_ns = now_ns + LOOK_NS;
    }

    fn next_tick_ns(&self) -> Option<u64> {
        Some(self.next_ns)
    }

    fn say(&mut self) -> Option<Vec<u8>> {
        self.said.pop_front()
    }
}
