//! Two ends of a link in memory, for tests and for programs that bring their own controller.

use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::time::{Duration, Instant};

use super::{Link, LinkError};

/// One end of a pair. Time is real.
#[derive(Debug)]
pub struct MemoryLink {
    tx: Sender<Vec<u8>>,
    rx: Receiver<Vec<u8>>,
    left_over: Vec<u8>,
    born: Instant,
}

/// Two ends that are connected to each other. Dropping one disconnects the other.
#[must_use]
pub fn memory_pair() -> (MemoryLink, MemoryLink) {
    let (tx_a, rx_b) = channel();
    let (tx_b, rx_a) = channel();
    let end = |tx, rx| MemoryLink {
        tx,
        rx,
        left_over: Vec::new(),
        born: Instant::now(),
    };
    (end(tx_a, rx_a), end(tx_b, rx_b))
}

impl MemoryLink {
    fn gone(&self) -> LinkError {
        LinkError::Disconnected {
            peer: self.peer().to_owned(),
        }
    }
}

impl Link for MemoryLink {
    fn send(&mut self, bytes: &[u8]) -> Result<(), LinkError> {
        self.tx.send(bytes.to_vec()).map_err(|_| self.gone())
    }

    fn receive(&mut self, buffer: &mut [u8], timeout: Duration) -> Result<usize, LinkError> {
        if self.left_over.is_empty() {
            match self.rx.recv_timeout(timeout) {
                Ok(bytes) => self.left_over = bytes,
                Err(RecvTimeoutError::Timeout) => return Ok(0),
                Err(RecvTimeoutError::Disconnected) => return Err(self.gone()),
            }
        }
        let count = self.left_over.len().min(buffer.len());
        buffer[..count].copy_from_slice(&self.left_over[..count]);
        self.left_over.drain(..count);
        Ok(count)
    }

    fn now(&self) -> Duration {
        self.born.elapsed()
    }

    fn peer(&self) -> &'static str {
        "memory"
    }
}
