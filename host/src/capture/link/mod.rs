//! Links: streams of bytes to the controller.
//!
//! # Design
//! One trait for a serial port, a pair of buffers in memory, and the simulated controller. A link has a
//! clock of its own, real or virtual, so that time-outs mean the same on all of them and tests need not wait.

mod memory;
mod port;
mod serial;

use crate::base::blame::Blame;
use std::io;
use std::time::Duration;

pub use memory::{MemoryLink, memory_pair};
pub use port::{nonce, open, ports};
pub use serial::{BAUD, SerialLink};

/// A stream of bytes to and from the controller.
pub trait Link: Send {
    /// Sends all of `bytes`.
    ///
    /// # Errors
    /// [`LinkError`] if the peer is gone or the port fails.
    fn send(&mut self, bytes: &[u8]) -> Result<(), LinkError>;

    /// Waits at most `timeout` for bytes and puts what has come into `buffer`; returns how many, 0 if none came.
    ///
    /// # Errors
    /// [`LinkError`] if the peer is gone or the port fails.
    fn receive(&mut self, buffer: &mut [u8], timeout: Duration) -> Result<usize, LinkError>;

    /// The time on the link's clock, from an arbitrary start.
    fn now(&self) -> Duration;

    /// Who is at the other end, for messages.
    fn peer(&self) -> &str;
}

impl<L: Link + ?Sized> Link for Box<L> {
    fn send(&mut self, bytes: &[u8]) -> Result<(), LinkError> {
        (**self).send(bytes)
    }
    fn receive(&mut self, buffer: &mut [u8], timeout: Duration) -> Result<usize, LinkError> {
        (**self).receive(buffer, timeout)
    }
    fn now(&self) -> Duration {
        (**self).now()
    }
    fn peer(&self) -> &str {
        (**self).peer()
    }
}

/// Why a link does not work.
#[derive(Debug, thiserror::Error)]
pub enum LinkError {
    /// There is no such port.
    #[error("port {port}: expected a serial port, found none of that name{}", listed(.available))]
    NoSuchPort {
        /// The port that was asked for.
        port: String,
        /// The ports that there are.
        available: Vec<String>,
    },
    /// No port looks like that of a trigger box.
    #[error(
        "port auto: expected one trigger box on USB (1209:0001, `RCG trigger box`), found none{}",
        listed(.available)
    )]
    NoTriggerBox {
        /// The ports that there are.
        available: Vec<String>,
    },
    /// More than one port looks like that of a trigger box.
    #[error(
        "port auto: expected one trigger box on USB, found {}: {}; choose with `--port {}`",
        .found.len(), .found.join(", "), .found[0]
    )]
    SeveralTriggerBoxes {
        /// Their ports.
        found: Vec<String>,
    },
    /// No trigger box has this serial number.
    #[error(
        "port serial:{serial}: expected a trigger box on USB with this serial number, found {}",
        if .available.is_empty() { "none".to_owned() } else { format!("only: {}", .available.join(", ")) }
    )]
    NoSuchSerial {
        /// The number that was asked for.
        serial: String,
        /// Those of the boxes that there are.
        available: Vec<String>,
    },
    /// Another program has the port open.
    #[error("port {port}: expected a free port, found that another program has it open")]
    Busy {
        /// The port.
        port: String,
    },
    /// The user may not open the port.
    #[error("port {port}: expected the right to open it, found none{}", allowed(.group.as_deref()))]
    NotPermitted {
        /// The port.
        port: String,
        /// The group whose members may, where there is one.
        group: Option<String>,
    },
    /// The port exists but cannot be opened.
    #[error("port {port}: cannot be opened: {reason}")]
    Unusable {
        /// The port.
        port: String,
        /// What the system says.
        reason: String,
    },
    /// The peer has closed the stream.
    #[error("port {peer}: the connection has ended")]
    Disconnected {
        /// The peer.
        peer: String,
    },
    /// The port failed.
    #[error("port {peer}: {source}")]
    Io {
        /// The peer.
        peer: String,
        /// What the system says.
        source: io::Error,
    },
}

impl Blame for LinkError {
    fn is_input(&self) -> bool {
        matches!(
            self,
            Self::NoSuchPort { .. }
                | Self::NoTriggerBox { .. }
                | Self::SeveralTriggerBoxes { .. }
                | Self::NoSuchSerial { .. }
        )
    }
}

fn allowed(group: Option<&str>) -> String {
    group.map_or_else(String::new, |group| {
        format!("; members of the group {group} may (`sudo usermod -aG {group} $USER`, then log in again)")
    })
}

fn listed(available: &[String]) -> String {
    if available.is_empty() {
        "; this machine has no serial ports (use `--port sim` for the simulated controller)".to_owned()
    } else {
        format!(
            "; there are: {} (choose with `--port NAME`)",
            available.join(", ")
        )
    }
}
