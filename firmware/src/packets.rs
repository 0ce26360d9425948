//! Frames on their way to a link that takes packets, and what of them is lost when nobody takes a packet.
//!
//! # Design
//! Frames follow each other without a gap, or most packets would be short. A frame has been sent when the packet with its
//! last byte was handed over. When the link breaks off, all others are forgotten, and how many step records were in them is
//! told, so that none is lost uncounted. What the host may hold of a frame that was cut ends with a delimiter then, or the
//! frame after it would be taken for the rest of it.

use heapless::Deque;
use rcg_protocol::MAX_FRAME;

/// Longest packet of a full-speed bulk endpoint.
pub const PACKET: usize = 64;

/// Bytes from one frame to the next at least: delimiter, CRC, and the shortest message.
const SHORTEST_FRAME: usize = 8;

/// Frames that wait: begun while there was less than a packet, or the last one before that.
const FRAMES: usize = PACKET / SHORTEST_FRAME + 2;

/// A frame that is not sent.
#[derive(Clone, Copy, Debug)]
struct Waiting {
    /// Where it ends.
    end: usize,
    /// Step records in it.
    records: u32,
}

/// Frames, cut into packets.
#[derive(Debug)]
#[repr(C, align(4))] // a packet can be copied word by word
pub struct Packets {
    bytes: [u8; PACKET + MAX_FRAME],
    from: usize,
    to: usize,
    frames: Deque<Waiting, FRAMES>,
    /// The last packet was full.
    full: bool,
    /// The host may have half a frame.
    severed: bool,
}

impl Default for Packets {
    fn default() -> Self {
        Self::new()
    }
}

impl Packets {
    /// No frames.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            bytes: [0; PACKET + MAX_FRAME],
            from: 0,
            to: 0,
            frames: Deque::new(),
            full: false,
            severed: false,
        }
    }

    /// Takes frames until there is a packet or no further frame. `next` puts one at the start of what it is given, of
    /// [`MAX_FRAME`] bytes or nearly as many, and returns its length, zero for none, and the step records in it.
    pub fn fill(&mut self, mut next: impl FnMut(&mut [u8]) -> (usize, u32)) {
        while self.to - self.from < PACKET && !self.frames.is_full() {
            self.move_to_front();
            // Of no use by itself: it goes with the frame behind it.
            let begins = self.to + usize::from(self.severed);
            let (length, records) = next(&mut self.bytes[begins..]);
            if length == 0 {
                break;
            }
            if self.severed {
                self.bytes[self.to] = 0;
                self.severed = false;
            }
            self.to = begins + length;
            let end = self.to;
            self.frames.push_back(Waiting { end, records }).ok(); // there is room
        }
    }

    fn move_to_front(&mut self) {
        let by = self.from;
        self.bytes.copy_within(by..self.to, 0);
        (self.from, self.to) = (0, self.to - by);
        for frame in &mut self.frames {
            frame.end -= by;
        }
    }

    /// The next packet; `None` if there is nothing to send. It is empty where the host would wait for more otherwise:
    /// behind a full one.
    #[must_use]
    pub fn packet(&self) -> Option<&[u8]> {
        let some = self.from < self.to || self.full;
        some.then(|| &self.bytes[self.from..self.to.min(self.from + PACKET)])
    }

    /// That packet was handed over.
    pub fn sent(&mut self) {
        let length = (self.to - self.from).min(PACKET);
        self.full = length == PACKET;
        self.from += length;
        while self.frames.front().is_some_and(|frame| frame.end <= self.from) {
            self.frames.pop_front();
        }
    }

    /// Nobody takes packets any more: forgets everything. Returns how many step records were in it.
    pub fn lost(&mut self) -> u32 {
        // One that lacks its delimiter only is whole with the one that comes next.
        let cut = self.frames.iter().filter(|frame| frame.end > self.from + 1);
        let records = cut.map(|frame| frame.records).sum();
        self.frames.clear();
        self.from = self.to;
        self.full = false;
        self.severed = true;
        records
    }
}
