//! The seam to a DLPC900's HID interface: reports of 64 bytes, either way.

use std::io::{ErrorKind, Read as _, Write as _};
use std::net::TcpStream;
use std::time::Duration;

/// Length of a report in bytes; there is no report id on the wire.
pub const REPORT: usize = 64;
/// What names a unit whose reports come over TCP: a host and a port behind it, such as `tcp:127.0.0.1:7000`.
pub const TCP: &str = "tcp:";

/// Sends and takes reports.
pub trait Reports: Send {
    /// Sends one report.
    ///
    /// # Errors
    /// What the system says.
    fn send(&mut self, report: &[u8; REPORT]) -> Result<(), String>;

    /// The next report, or `None` if none came within `patience`.
    ///
    /// # Errors
    /// What the system says.
    fn take(&mut self, patience: Duration) -> Result<Option<[u8; REPORT]>, String>;
}

/// Reports over TCP, one after the other: for an emulated unit, or one that is plugged into another computer.
#[derive(Debug)]
pub struct TcpReports {
    stream: TcpStream,
    /// What has come of the next report.
    begun: Vec<u8>,
}

impl TcpReports {
    /// The unit at `address`, a host and a port.
    ///
    /// # Errors
    /// What the system says.
    pub fn connect(address: &str) -> Result<Self, String> {
        let stream = TcpStream::connect(address).map_err(|error| error.to_string())?;
        stream.set_nodelay(true).map_err(|error| error.to_string())?;
        Ok(Self {
            stream,
            begun: Vec::with_capacity(REPORT),
        })
    }
}

impl Reports for TcpReports {
    fn send(&mut self, report: &[u8; REPORT]) -> Result<(), String> {
        self.stream.write_all(report).map_err(|error| error.to_string())
    }

    fn take(&mut self, patience: Duration) -> Result<Option<[u8; REPORT]>, String> {
        // A time of 0 would be none.
        let patience = patience.max(Duration::from_millis(1));
        self.stream
            .set_read_timeout(Some(patience))
            .map_err(|error| error.to_string())?;
        loop {
            let mut bytes = [0; REPORT];
            let wanted = REPORT - self.begun.len();
            match self.stream.read(&mut bytes[..wanted]) {
                Ok(0) => return Err("the connection has ended".to_owned()),
                Ok(read) => self.begun.extend_from_slice(&bytes[..read]),
                Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {
                    return Ok(None);
                }
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) => return Err(error.to_string()),
            }
            if let Ok(report) = <[u8; REPORT]>::try_from(&self.begun[..]) {
                self.begun.clear();
                return Ok(Some(report));
            }
        }
    }
}
