//! An emulated Pico on the bench, and the link to it in virtual time.
//!
//! # Design
//! [`Pico`] collects what the emulator reports: edges, log, resets. [`PicoLink`] is the host's end of UART or USB:
//! waiting for bytes is what lets virtual time pass, so the client's time-outs are counted in cycles of the device.
//! Both ends share the Pico; the bench looks at the wires while the client talks.

use std::collections::VecDeque;
use std::io;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use rcg::capture::link::{Link, LinkError};

use crate::dut::EmulatedPico;
use crate::emulator::{Emulator, EmulatorError, Until, Why};
use crate::trace::Edge;

/// Time from power-up to a firmware that waits for requests; USB is enumerated by then.
const BOOT_CYCLES: u64 = 25_000_000;

/// An emulated Pico and what was seen of it.
#[derive(Debug)]
pub struct Pico {
    /// The emulator, for requests that are not common.
    pub emulator: Emulator,
    clock_hz: u32,
    cycle: u64,
    received: VecDeque<u8>,
    edges: Vec<Edge>,
    rtt: Vec<u8>,
    resets: Vec<u64>,
    arrives: u64,
}

impl Pico {
    /// Powers up and boots.
    ///
    /// # Errors
    /// [`EmulatorError`].
    pub fn boot(dut: &EmulatedPico) -> Result<Self, EmulatorError> {
        let mut pico = Self {
            emulator: Emulator::start(&dut.image(), dut.link)?,
            clock_hz: 1,
            cycle: 0,
            received: VecDeque::new(),
            edges: Vec::new(),
            rtt: Vec::new(),
            resets: Vec::new(),
            arrives: 0,
        };
        pico.run(BOOT_CYCLES)?;
        pico.clock_hz = pico.emulator.stats()?.clock_hz;
        Ok(pico)
    }

    /// Rate of the cycles.
    #[must_use]
    pub const fn clock_hz(&self) -> u32 {
        self.clock_hz
    }

    /// Cycles since power-up.
    #[must_use]
    pub const fn cycle(&self) -> u64 {
        self.cycle
    }

    /// Time since power-up.
    #[must_use]
    pub fn now(&self) -> Duration {
        Duration::from_nanos((u128::from(self.cycle) * 1_000_000_000 / u128::from(self.clock_hz)) as u64)
    }

    /// Cycles that `time` takes.
    #[must_use]
    pub fn cycles(&self, time: Duration) -> u64 {
        (time.as_nanos() * u128::from(self.clock_hz)).div_ceil(1_000_000_000) as u64
    }

    /// Cycle at which the last byte arrives that was sent. Where the emulator cannot tell (USB), the one at which it
    /// was sent: it cannot have arrived before.
    #[must_use]
    pub const fn arrives(&self) -> u64 {
        self.arrives
    }

    /// Takes the edges that were seen so far.
    pub fn take_edges(&mut self) -> Vec<Edge> {
        std::mem::take(&mut self.edges)
    }

    /// Cycles at which the chip was reset.
    #[must_use]
    pub fn resets(&self) -> &[u64] {
        &self.resets
    }

    /// The log so far, as it came over RTT.
    #[must_use]
    pub fn rtt(&self) -> &[u8] {
        &self.rtt
    }

    /// Lets `cycles` pass, whatever happens.
    ///
    /// # Errors
    /// [`EmulatorError`].
    pub fn run(&mut self, cycles: u64) -> Result<(), EmulatorError> {
        let end = self.cycle + cycles;
        while self.cycle < end && self.advance(end - self.cycle, Until::Cycles)? != Why::Halt {}
        Ok(())
    }

    /// Lets up to `cycles` pass.
    ///
    /// # Errors
    /// [`EmulatorError`].
    pub fn advance(&mut self, cycles: u64, until: Until) -> Result<Why, EmulatorError> {
        let ran = self.emulator.run(cycles, until)?;
        self.cycle = ran.cycle;
        self.received.extend(ran.received);
        self.edges.extend(ran.edges);
        self.rtt.extend(ran.rtt);
        if ran.why == Why::Reset {
            self.resets.push(ran.cycle);
        }
        Ok(ran.why)
    }

    /// Takes the bytes that have reached the host.
    pub fn take_received(&mut self) -> impl Iterator<Item = u8> {
        self.received.drain(..)
    }
}

/// A Pico that bench and client share.
#[derive(Clone, Debug)]
pub struct SharedPico(Arc<Mutex<Pico>>);

impl SharedPico {
    /// Shares `pico`.
    #[must_use]
    pub fn new(pico: Pico) -> Self {
        Self(Arc::new(Mutex::new(pico)))
    }

    /// The Pico, for as long as the guard lives.
    pub fn lock(&self) -> MutexGuard<'_, Pico> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The host's end of the link.
#[derive(Debug)]
pub struct PicoLink(pub SharedPico);

impl Link for PicoLink {
    fn send(&mut self, bytes: &[u8]) -> Result<(), LinkError> {
        let mut pico = self.0.lock();
        let arrives = pico.emulator.send(bytes).map_err(failed)?;
        pico.arrives = arrives.unwrap_or(pico.cycle);
        Ok(())
    }

    fn receive(&mut self, buffer: &mut [u8], timeout: Duration) -> Result<usize, LinkError> {
        let mut pico = self.0.lock();
        let end = pico.cycle + pico.cycles(timeout);
        while pico.received.is_empty() && pico.cycle < end {
            let left = end - pico.cycle;
            if pico.advance(left, Until::Frame).map_err(failed)? == Why::Halt {
                return Err(failed(io::Error::other("the CPU has stopped for good")));
            }
        }
        let count = pico.received.len().min(buffer.len());
        for (to, byte) in buffer.iter_mut().zip(pico.received.drain(..count)) {
            *to = byte;
        }
        Ok(count)
    }

    fn now(&self) -> Duration {
        self.0.lock().now()
    }

    fn peer(&self) -> &'static str {
        "emulator"
    }
}

fn failed(error: impl std::error::Error + Send + Sync + 'static) -> LinkError {
    LinkError::Io {
        peer: "emulator".to_owned(),
        source: io::Error::other(error),
    }
}
