//! The simulated controller as a link: the firmware's own library in virtual time, with the stage at its pins.
//!
//! # Design
//! Virtual time moves only while the host waits for bytes, never beyond what the host waits for.

use std::collections::VecDeque;
use std::time::Duration;

use rcg_firmware::pulse::Edge;
use rcg_firmware::virtual_time::{Pins, StrobeEdge, VirtualBox};
use rcg_protocol::{Input, Line, Ticks};

use super::SharedStage;
use crate::capture::link::{Link, LinkError};

/// Clock of the simulated controller, that of a Pico.
pub const CLOCK_HZ: u32 = 125_000_000;

impl Pins for SharedStage {
    fn edge(&mut self, edge: Edge) -> Option<StrobeEdge> {
        self.lock().edge(edge.line, edge.level, edge.at)
    }

    /// The projector's vsync goes on for ever.
    fn next_sync(&mut self, from: Ticks) -> Option<Ticks> {
        Some(self.lock().next_sync(from))
    }

    /// SYNC is the projector's vsync; what STROBE does the box knows by itself.
    fn input(&mut self, line: Line, since: Ticks, now: Ticks, active_low: bool) -> Option<Input> {
        (line == Line::Sync).then(|| self.lock().sync_seen(since, now, active_low))
    }
}

/// A link to the simulated controller.
pub struct VirtualController {
    controller: VirtualBox<SharedStage>,
    to_host: VecDeque<u8>,
}

impl VirtualController {
    pub(super) fn new(stage: SharedStage, seed: u32) -> Self {
        Self {
            controller: VirtualBox::new(stage, CLOCK_HZ, seed, Ticks::ZERO),
            to_host: VecDeque::new(),
        }
    }
}

impl Link for VirtualController {
    fn send(&mut self, bytes: &[u8]) -> Result<(), LinkError> {
        self.controller.hear(bytes, |frame| self.to_host.extend(frame));
        Ok(())
    }

    fn receive(&mut self, buffer: &mut [u8], timeout: Duration) -> Result<usize, LinkError> {
        // Rounded up: time goes on in every wait, however short, or who waits for the rest of a tick waits for ever.
        let wait = Ticks((timeout.as_secs_f64() * f64::from(CLOCK_HZ)).ceil() as u64);
        let deadline = self.controller.now() + wait;
        while self.to_host.is_empty() && self.controller.now() < deadline {
            self.controller.advance(deadline);
            self.controller.poll();
            self.controller.act(|frame| self.to_host.extend(frame));
        }
        let count = self.to_host.len().min(buffer.len());
        for (to, byte) in buffer.iter_mut().zip(self.to_host.drain(..count)) {
            *to = byte;
        }
        Ok(count)
    }

    fn now(&self) -> Duration {
        Duration::from_secs_f64(self.controller.now().0 as f64 / f64::from(CLOCK_HZ))
    }

    fn peer(&self) -> &'static str {
        "sim"
    }
}
