//! One direction of a serial link: bytes in, and out again late, damaged, twice, or not at all.
//!
//! # Design
//! What is sent is cut into chunks, as a USB port or an operating system does, and each chunk meets its
//! fate by itself. A chunk takes the time of its bytes at the speed of the line.

use std::collections::BTreeMap;

use rand::{RngExt, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;

/// Time of one byte at 921,600 baud, 8N1, in nanoseconds.
pub const BYTE_NS: u64 = 10_850;

/// What can go wrong. Probabilities are per byte or per chunk.
#[derive(Clone, Copy, Debug)]
pub struct Faults {
    /// A byte is lost.
    pub lose_byte: f64,
    /// One bit of a byte is flipped.
    pub flip_bit: f64,
    /// A chunk is lost.
    pub lose_chunk: f64,
    /// A chunk comes twice.
    pub duplicate: f64,
    /// A chunk comes late, and those after it wait behind it.
    pub delay: f64,
    /// A chunk comes late, and those after it overtake it.
    pub reorder: f64,
    /// Random bytes come before a chunk.
    pub garbage: f64,
    /// The longest delay, in nanoseconds.
    pub longest_delay_ns: u64,
    /// The longest chunk in bytes; 1 splits at every byte.
    pub longest_chunk: usize,
    /// The link is cut after this many bytes.
    pub cut_after: Option<u64>,
}

impl Faults {
    /// A good line.
    pub const NONE: Self = Self {
        lose_byte: 0.0,
        flip_bit: 0.0,
        lose_chunk: 0.0,
        duplicate: 0.0,
        delay: 0.0,
        reorder: 0.0,
        garbage: 0.0,
        longest_delay_ns: 0,
        longest_chunk: 4096,
        cut_after: None,
    };

    /// Any mixture of faults. About half of them are absent, so that each also occurs by itself.
    #[must_use]
    pub fn any(seed: u64) -> Self {
        let faults = Self::of_a_stream(seed);
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed ^ 0x5EED);
        let per_chunk = chance(faults.longest_chunk);
        Self {
            duplicate: maybe(&mut rng, 0.15 * per_chunk),
            reorder: maybe(&mut rng, 0.15 * per_chunk),
            ..faults
        }
    }

    /// As [`any`](Self::any), but the order of what gets through is kept and nothing comes twice, as on a
    /// real serial port.
    #[must_use]
    pub fn of_a_stream(seed: u64) -> Self {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed);
        let longest_chunk = [1, 7, 64, 512][rng.random_range(0..4)];
        let per_chunk = chance(longest_chunk);
        Self {
            lose_byte: maybe(&mut rng, 0.004),
            flip_bit: maybe(&mut rng, 0.004),
            lose_chunk: maybe(&mut rng, 0.1 * per_chunk),
            delay: maybe(&mut rng, 0.1 * per_chunk),
            garbage: maybe(&mut rng, 0.1 * per_chunk),
            longest_delay_ns: rng.random_range(0..120_000_000),
            longest_chunk,
            ..Self::NONE
        }
    }
}

/// Small chunks are many: each is damaged less often, so that frames get through at all.
fn chance(longest_chunk: usize) -> f64 {
    (longest_chunk as f64 / 64.0).min(1.0)
}

fn maybe(rng: &mut Xoshiro256PlusPlus, most: f64) -> f64 {
    if rng.random_bool(0.5) {
        rng.random_range(0.0..most)
    } else {
        0.0
    }
}

/// What went through a line.
#[derive(Clone, Copy, Debug, Default)]
pub struct Tally {
    /// Chunks that came twice.
    pub duplicated: u64,
    /// Delimited, non-empty runs of bytes that arrived: a frame each, good or bad.
    pub frames_arrived: u64,
}

/// One direction.
#[derive(Debug)]
pub struct Line {
    faults: Faults,
    rng: Xoshiro256PlusPlus,
    in_flight: BTreeMap<(u64, u64), Vec<u8>>,
    chunks: u64,
    bytes: u64,
    /// When the last byte that was sent has left.
    free_ns: u64,
    last_arrival_ns: u64,
    in_frame: bool,
    tally: Tally,
}

impl Line {
    /// A line with these faults, drawn from `seed`.
    #[must_use]
    pub fn new(faults: Faults, seed: u64) -> Self {
        Self {
            faults,
            rng: Xoshiro256PlusPlus::seed_from_u64(seed),
            in_flight: BTreeMap::new(),
            chunks: 0,
            bytes: 0,
            free_ns: 0,
            last_arrival_ns: 0,
            in_frame: false,
            tally: Tally::default(),
        }
    }

    /// Other faults from now on.
    pub const fn set_faults(&mut self, faults: Faults) {
        self.faults = faults;
        self.bytes = 0;
    }

    /// What went through.
    #[must_use]
    pub const fn tally(&self) -> Tally {
        self.tally
    }

    /// When all that was sent has left.
    #[must_use]
    pub const fn free_ns(&self) -> u64 {
        self.free_ns
    }

    /// Sends `bytes` at `now_ns`. Returns whether the line holds; if it is cut, a part may have left.
    #[must_use]
    pub fn send(&mut self, now_ns: u64, bytes: &[u8]) -> bool {
        let holds = self.faults.cut_after.map_or(bytes.len(), |cut| {
            bytes.len().min(cut.saturating_sub(self.bytes) as usize)
        });
        self.bytes += holds as u64;
        let mut left = &bytes[..holds];
        while !left.is_empty() {
            let most = self.faults.longest_chunk.min(left.len());
            let length = if self.rng.random_bool(0.5) {
                most
            } else {
                self.rng.random_range(1..=most)
            };
            let (chunk, rest) = left.split_at(length);
            left = rest;
            self.free_ns = self.free_ns.max(now_ns) + length as u64 * BYTE_NS;
            self.send_chunk(chunk);
        }
        holds == bytes.len()
    }

    fn send_chunk(&mut self, chunk: &[u8]) {
        if self.rng.random_bool(self.faults.garbage) {
            let garbage: Vec<u8> = (0..self.rng.random_range(1..40))
                .map(|_| self.rng.random_range(0..=255))
                .collect();
            self.fly(self.free_ns, garbage);
        }
        if self.rng.random_bool(self.faults.lose_chunk) {
            return;
        }
        let mut bytes = Vec::new();
        for &byte in chunk {
            if self.rng.random_bool(self.faults.lose_byte) {
                continue;
            }
            let flip = self.rng.random_bool(self.faults.flip_bit);
            bytes.push(if flip {
                byte ^ 1 << self.rng.random_range(0..8)
            } else {
                byte
            });
        }
        let mut delay = || self.rng.random_range(0..=self.faults.longest_delay_ns);
        let (late, overtaken) = (delay(), delay());
        if self.rng.random_bool(self.faults.duplicate) {
            self.tally.duplicated += 1;
            self.fly(self.free_ns, bytes.clone());
        }
        if self.rng.random_bool(self.faults.reorder) {
            self.chunks += 1;
            self.in_flight
                .insert((self.free_ns + overtaken, self.chunks), bytes);
        } else if self.rng.random_bool(self.faults.delay) {
            self.fly(self.free_ns + late, bytes);
        } else {
            self.fly(self.free_ns, bytes);
        }
    }

    /// Arrives at `at_ns`, but not before what was sent before.
    fn fly(&mut self, at_ns: u64, bytes: Vec<u8>) {
        self.last_arrival_ns = self.last_arrival_ns.max(at_ns);
        self.chunks += 1;
        self.in_flight.insert((self.last_arrival_ns, self.chunks), bytes);
    }

    /// When the next bytes arrive.
    #[must_use]
    pub fn next_arrival_ns(&self) -> Option<u64> {
        self.in_flight.keys().next().map(|(at, _)| *at)
    }

    /// The bytes that have arrived by `now_ns`.
    #[must_use]
    pub fn arrived(&mut self, now_ns: u64) -> Vec<u8> {
        let mut bytes = Vec::new();
        while let Some(first) = self.in_flight.first_entry()
            && first.key().0 <= now_ns
        {
            bytes.extend(first.remove());
        }
        for &byte in &bytes {
            self.tally.frames_arrived += u64::from(byte == 0 && self.in_frame);
            self.in_frame = byte != 0;
        }
        bytes
    }

    /// Loses all that is under way.
    pub fn clear(&mut self) {
        self.in_flight.clear();
    }
}
