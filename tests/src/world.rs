//! The clock, the lines and the peer; and a client's end of it.
//!
//! # Design
//! Several clients may hold an end of the same world, as two programs may open the same port one after the
//! other: each has lines of its own, and all hear what the peer says.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::Duration;

use rcg::capture::link::{Link, LinkError};
use rcg_protocol::{Decoder, ToDevice};

use crate::line::{Faults, Line, Tally};

/// No test of these crates does more than this in one world; more is a loop that does not end.
const FUSE: u64 = 20_000_000;

/// Who is at the other end. All times are in nanoseconds of virtual time.
pub trait Peer: Send + 'static {
    /// A byte has come.
    fn byte(&mut self, now_ns: u64, byte: u8);

    /// The peer's own affairs that are due.
    fn tick(&mut self, now_ns: u64);

    /// When it next has affairs of its own.
    fn next_tick_ns(&self) -> Option<u64>;

    /// What it says next, when the line is free.
    fn say(&mut self) -> Option<Vec<u8>>;
}

/// A client's lines.
#[derive(Debug)]
struct End {
    down: Line,
    up: Line,
    inbox: VecDeque<u8>,
    connected: bool,
    sent: Vec<ToDevice>,
}

/// Everything behind the links.
#[derive(Debug)]
struct World<P> {
    now_ns: u64,
    peer: P,
    ends: Vec<End>,
    fuse: u64,
}

impl<P: Peer> World<P> {
    /// Lets time pass until `limit_ns`, or until there is something in the inbox of `end`.
    fn pass(&mut self, limit_ns: u64, end: Option<usize>) {
        loop {
            self.fuse += 1;
            assert!(self.fuse < FUSE, "the virtual time runs in a circle");
            self.hear_peer();
            if let Some(end) = end.map(|end| &self.ends[end]) {
                let over = !end.connected && end.up.next_arrival_ns().is_none();
                if over || !end.inbox.is_empty() {
                    return;
                }
            }
            let arrivals = self
                .ends
                .iter()
                .flat_map(|end| [end.down.next_arrival_ns(), end.up.next_arrival_ns()]);
            let free = self.up_free_ns();
            let next = arrivals
                .flatten()
                .chain(self.peer.next_tick_ns())
                .chain((free > self.now_ns).then_some(free))
                .min();
            match next {
                Some(next) if next <= limit_ns => self.now_ns = self.now_ns.max(next),
                _ => {
                    self.now_ns = self.now_ns.max(limit_ns);
                    return;
                }
            }
            self.happen();
        }
    }

    fn happen(&mut self) {
        let now_ns = self.now_ns;
        for end in &mut self.ends {
            for byte in end.down.arrived(now_ns) {
                self.peer.byte(now_ns, byte);
            }
            end.inbox.extend(end.up.arrived(now_ns));
        }
        if self.peer.next_tick_ns().is_some_and(|at| at <= now_ns) {
            self.peer.tick(now_ns);
        }
    }

    fn up_free_ns(&self) -> u64 {
        self.ends.iter().map(|end| end.up.free_ns()).max().unwrap_or(0)
    }

    fn hear_peer(&mut self) {
        while self.up_free_ns() <= self.now_ns {
            let Some(bytes) = self.peer.say() else { return };
            for end in self.ends.iter_mut().filter(|end| end.connected) {
                end.connected = end.up.send(self.now_ns, &bytes);
            }
        }
    }
}

/// A client's end of a mocked link.
#[derive(Debug)]
pub struct MockLink<P> {
    world: Arc<Mutex<World<P>>>,
    end: usize,
}

impl<P: Peer> MockLink<P> {
    /// A link to `peer`; bytes to it meet the faults of `down`, those from it the faults of `up`.
    #[must_use]
    pub fn new(peer: P, down: Faults, up: Faults, seed: u64) -> Self {
        let world = World {
            now_ns: 0,
            peer,
            ends: Vec::new(),
            fuse: 0,
        };
        let link = Self {
            world: Arc::new(Mutex::new(world)),
            end: 0,
        };
        link.add_end(down, up, seed);
        link
    }

    /// Another client's link to the same peer.
    #[must_use]
    pub fn another(&self, down: Faults, up: Faults, seed: u64) -> Self {
        Self {
            world: Arc::clone(&self.world),
            end: self.add_end(down, up, seed),
        }
    }

    fn add_end(&self, down: Faults, up: Faults, seed: u64) -> usize {
        let mut world = self.world();
        world.ends.push(End {
            down: Line::new(down, seed),
            up: Line::new(up, !seed),
            inbox: VecDeque::new(),
            connected: true,
            sent: Vec::new(),
        });
        world.ends.len() - 1
    }

    fn world(&self) -> MutexGuard<'_, World<P>> {
        self.world.lock().expect("no test goes on after a panic")
    }

    /// Looks at the peer, or changes it.
    pub fn peer_mut<T>(&self, look: impl FnOnce(&mut P) -> T) -> T {
        look(&mut self.world().peer)
    }

    /// What went through this client's line to the peer.
    #[must_use]
    pub fn down(&self) -> Tally {
        self.world().ends[self.end].down.tally()
    }

    /// The requests that this client has sent, in their order, retries included.
    #[must_use]
    pub fn sent(&self) -> Vec<ToDevice> {
        self.world().ends[self.end].sent.clone()
    }

    /// Other faults from now on, in both directions.
    pub fn set_faults(&self, down: Faults, up: Faults) {
        let end = &mut self.world().ends[self.end];
        end.down.set_faults(down);
        end.up.set_faults(up);
    }

    /// Cuts the link and loses what is under way.
    pub fn cut(&self) {
        let end = &mut self.world().ends[self.end];
        end.connected = false;
        end.down.clear();
        end.up.clear();
        end.inbox.clear();
    }

    /// Plugs a cut link in again, as a good one. What the peer has received so far it still has.
    pub fn reconnect(&self) {
        self.cut();
        self.set_faults(Faults::NONE, Faults::NONE);
        self.world().ends[self.end].connected = true;
    }

    /// Lets time pass while the client does something else.
    pub fn idle(&self, time: Duration) {
        let mut world = self.world();
        let limit_ns = world.now_ns + time.as_nanos() as u64;
        world.pass(limit_ns, None);
    }

    fn gone(&self) -> LinkError {
        LinkError::Disconnected {
            peer: self.peer().to_owned(),
        }
    }
}

impl<P: Peer> Link for MockLink<P> {
    fn send(&mut self, bytes: &[u8]) -> Result<(), LinkError> {
        let mut world = self.world();
        let now_ns = world.now_ns;
        let end = &mut world.ends[self.end];
        if end.connected {
            let mut decoder = Decoder::new();
            end.sent
                .extend(bytes.iter().filter_map(|&byte| decoder.push(byte)?.ok()));
            end.connected = end.down.send(now_ns, bytes);
        }
        let holds = end.connected;
        drop(world);
        if holds { Ok(()) } else { Err(self.gone()) }
    }

    fn receive(&mut self, buffer: &mut [u8], timeout: Duration) -> Result<usize, LinkError> {
        let mut world = self.world();
        if world.ends[self.end].inbox.is_empty() {
            let limit_ns = world.now_ns + timeout.as_nanos() as u64;
            world.pass(limit_ns, Some(self.end));
        }
        let end = &mut world.ends[self.end];
        let count = end.inbox.len().min(buffer.len());
        for (place, byte) in buffer.iter_mut().zip(end.inbox.drain(..count)) {
            *place = byte;
        }
        let gone = count == 0 && !end.connected;
        drop(world);
        if gone { Err(self.gone()) } else { Ok(count) }
    }

    fn now(&self) -> Duration {
        Duration::from_nanos(self.world().now_ns)
    }

    fn peer(&self) -> &'static str {
        "mock"
    }
}
