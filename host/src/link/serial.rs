//! A serial port: the controller's UART or its USB CDC port.

use std::io::{self, Read, Write};
use std::path::Path;
use std::time::{Duration, Instant};

use serialport::{ErrorKind, SerialPort};

use super::{Link, LinkError};

/// Speed of the controller's UART in baud; USB CDC ignores it.
pub const BAUD: u32 = 921_600;

/// An open serial port. Time is real.
pub struct SerialLink {
    name: String,
    port: Box<dyn SerialPort>,
    born: Instant,
}

impl std::fmt::Debug for SerialLink {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("SerialLink")
            .field("name", &self.name)
            .finish_non_exhaustive()
    }
}

impl SerialLink {
    /// Opens the port `name` (`/dev/ttyACM0`, `COM3`).
    ///
    /// # Errors
    /// [`LinkError::NoSuchPort`] with the ports that there are, or [`LinkError::Busy`].
    pub fn open(name: &str) -> Result<Self, LinkError> {
        let port = serialport::new(name, BAUD)
            .timeout(Duration::from_millis(10))
            .open()
            .map_err(|error| {
                let absent = matches!(
                    error.kind(),
                    ErrorKind::NoDevice | ErrorKind::Io(io::ErrorKind::NotFound)
                );
                let available = ports();
                // A port that another program holds is reported as absent too.
                let there = Path::new(name).exists() || available.iter().any(|port| port == name);
                if absent && !there {
                    LinkError::NoSuchPort {
                        port: name.to_owned(),
                        available,
                    }
                } else {
                    LinkError::Busy {
                        port: name.to_owned(),
                        reason: error.to_string(),
                    }
                }
            })?;
        Ok(Self {
            name: name.to_owned(),
            port,
            born: Instant::now(),
        })
    }

    fn error(&self, source: io::Error) -> LinkError {
        use io::ErrorKind::{BrokenPipe, NotConnected, UnexpectedEof};
        let peer = self.name.clone();
        if matches!(source.kind(), BrokenPipe | NotConnected | UnexpectedEof) {
            LinkError::Disconnected { peer }
        } else {
            LinkError::Io { peer, source }
        }
    }
}

/// Names of the serial ports of this machine.
#[must_use]
pub fn ports() -> Vec<String> {
    serialport::available_ports()
        .unwrap_or_default()
        .into_iter()
        .map(|port| port.port_name)
        .collect()
}

impl Link for SerialLink {
    fn send(&mut self, bytes: &[u8]) -> Result<(), LinkError> {
        self.port
            .write_all(bytes)
            .and_then(|()| self.port.flush())
            .map_err(|e| self.error(e))
    }

    fn receive(&mut self, buffer: &mut [u8], timeout: Duration) -> Result<usize, LinkError> {
        // A read with a zero time-out would poll without waiting on some systems and fail on others.
        let timeout = timeout.max(Duration::from_millis(1));
        self.port.set_timeout(timeout).map_err(|e| self.error(e.into()))?;
        match self.port.read(buffer) {
            // The end of a stream is a disconnect, not an empty read.
            Ok(0) => Err(LinkError::Disconnected {
                peer: self.name.clone(),
            }),
            Ok(count) => Ok(count),
            Err(error) if error.kind() == io::ErrorKind::TimedOut => Ok(0),
            Err(error) if error.kind() == io::ErrorKind::Interrupted => Ok(0),
            Err(error) => Err(self.error(error)),
        }
    }

    fn now(&self) -> Duration {
        self.born.elapsed()
    }

    fn peer(&self) -> &str {
        &self.name
    }
}
