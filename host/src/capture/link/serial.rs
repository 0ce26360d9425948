//! A serial port: the controller's UART or its USB CDC port.

use std::io::{self, Read, Write};
use std::path::Path;
use std::time::{Duration, Instant};

use serialport::{ErrorKind, SerialPort};

use super::{Link, LinkError, ports};

/// Speed of the controller's UART in baud; USB CDC ignores it.
pub const BAUD: u32 = 921_600;

/// A port that takes no byte for so long will not take this frame.
const STUCK: Duration = Duration::from_millis(200);

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
    /// [`LinkError::NoSuchPort`] with the ports that there are, [`LinkError::Busy`], [`LinkError::NotPermitted`] or
    /// [`LinkError::Unusable`].
    pub fn open(name: &str) -> Result<Self, LinkError> {
        let port = serialport::new(name, BAUD)
            .timeout(Duration::from_millis(10))
            .open()
            .map_err(|error| refusal(name, &error))?;
        Ok(Self {
            name: name.to_owned(),
            port,
            born: Instant::now(),
        })
    }

    /// Asks what is at the port `name` for its boot loader, as boxes with USB understand it: sets the port to 1200 baud and closes it.
    ///
    /// # Errors
    /// As [`open`](Self::open).
    pub fn touch(name: &str) -> Result<(), LinkError> {
        /// A custom that Arduino began.
        const TOUCH_BAUD: u32 = 1200;
        let opened = serialport::new(name, TOUCH_BAUD).open();
        let mut port = opened.map_err(|error| refusal(name, &error))?;
        // A port that has no such line is no reason to fail: the system drops it on closing.
        port.write_data_terminal_ready(false).ok();
        Ok(())
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

/// Why the port `name` was not opened.
fn refusal(name: &str, error: &serialport::Error) -> LinkError {
    let port = name.to_owned();
    let available = ports();
    let there = Path::new(name).exists() || available.iter().any(|port| port == name);
    match error.kind() {
        ErrorKind::NoDevice | ErrorKind::Io(io::ErrorKind::NotFound) if !there => {
            LinkError::NoSuchPort { port, available }
        }
        // A port that is there and is reported as absent is held by another program.
        ErrorKind::NoDevice => LinkError::Busy { port },
        ErrorKind::Io(io::ErrorKind::PermissionDenied) => {
            let group = group_of(Path::new(name));
            LinkError::NotPermitted { port, group }
        }
        _ => {
            let reason = error.to_string();
            LinkError::Unusable { port, reason }
        }
    }
}

/// Name of the group that `port` belongs to, unless that is root's own.
#[cfg(unix)]
fn group_of(port: &Path) -> Option<String> {
    use std::os::unix::fs::MetadataExt as _;
    let gid = std::fs::metadata(port).ok()?.gid();
    group_named(&std::fs::read_to_string("/etc/group").ok()?, gid)
}

/// Name of the group `gid` in the text of /etc/group: lines `name:password:gid:members`.
#[cfg(unix)]
fn group_named(groups: &str, gid: u32) -> Option<String> {
    let mut fields = groups.lines().map(|line| line.split(':'));
    let name = fields.find_map(|mut line| {
        let name = line.next()?;
        (line.nth(1)?.parse() == Ok(gid)).then_some(name)
    })?;
    (gid != 0).then(|| name.to_owned())
}

#[cfg(not(unix))]
fn group_of(_: &Path) -> Option<String> {
    None
}

impl Link for SerialLink {
    fn send(&mut self, bytes: &[u8]) -> Result<(), LinkError> {
        // The system sends what it is given by itself; to wait for that would cost a streaming host its time.
        self.port.set_timeout(STUCK).map_err(|e| self.error(e.into()))?;
        match self.port.write_all(bytes) {
            // Lost like a frame on any bad line: that no answer comes says so.
            Err(error) if error.kind() == io::ErrorKind::TimedOut => Ok(()),
            sent => sent.map_err(|e| self.error(e)),
        }
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

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    #[test]
    fn a_port_that_is_not_permitted_names_the_group_that_may() {
        let groups = "root:x:0:\ndaemon:x:1:\n\ndialout:x:20:ann,bob\nbad line\n";
        assert_eq!(group_named(groups, 20).as_deref(), Some("dialout"));
        assert_eq!(
            group_named(groups, 0),
            None,
            "nobody is told to join root's group"
        );
        assert_eq!(group_named(groups, 7), None);
        let refused = serialport::Error::new(ErrorKind::Io(io::ErrorKind::PermissionDenied), "denied");
        let sentence = refusal("/dev/null", &refused).to_string();
        assert!(
            sentence.starts_with("port /dev/null: expected the right to open it"),
            "{sentence}"
        );
        let group = Some("dialout".to_owned());
        let port = "/dev/ttyACM0".to_owned();
        let sentence = LinkError::NotPermitted { port, group }.to_string();
        assert!(
            sentence.contains("members of the group dialout may"),
            "{sentence}"
        );
    }

    #[test]
    fn a_port_whose_peer_goes_is_disconnected_and_a_silent_one_is_not() {
        let (mut peer, port) = serialport::TTYPort::pair().expect("the system has pseudo terminals");
        let name = port.name().expect("the port has a name");
        let mut link = SerialLink::open(&name).unwrap();
        drop(port);
        let mut buffer = [0; 8];
        assert_eq!(link.receive(&mut buffer, Duration::ZERO).unwrap(), 0);
        peer.write_all(b"abc").unwrap();
        assert_eq!(link.receive(&mut buffer, Duration::from_secs(10)).unwrap(), 3);
        drop(peer);
        let gone = |result: Result<(), LinkError>| matches!(result, Err(LinkError::Disconnected { .. }));
        assert!(gone(
            link.receive(&mut buffer, Duration::from_secs(10)).map(|_| ())
        ));
        assert!(gone(link.send(b"x")));
    }
}
