//! Peers that are no controller of this version.

use rand::{RngExt, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;
use rcg_protocol::{Decoder, MAX_FRAME, encode};

use crate::world::Peer;

/// Never says anything.
#[derive(Debug)]
pub struct Silent;

impl Peer for Silent {
    fn byte(&mut self, _: u64, _: u8) {}
    fn tick(&mut self, _: u64) {}
    fn next_tick_ns(&self) -> Option<u64> {
        None
    }
    fn say(&mut self) -> Option<Vec<u8>> {
        None
    }
}

/// Says random bytes as fast as the line takes them: a port that belongs to something else.
#[derive(Debug)]
pub struct Noise(Xoshiro256PlusPlus);

impl Noise {
    /// Drawn from `seed`.
    #[must_use]
    pub fn new(seed: u64) -> Self {
        Self(Xoshiro256PlusPlus::seed_from_u64(seed))
    }
}

impl Peer for Noise {
    fn byte(&mut self, _: u64, _: u8) {}
    fn tick(&mut self, _: u64) {}
    fn next_tick_ns(&self) -> Option<u64> {
        None
    }
    fn say(&mut self) -> Option<Vec<u8>> {
        let length = self.0.random_range(1..600);
        // Zeros are frequent, so that there are frames to be refused.
        Some(
            (0..length)
                .map(|_| self.0.random_range(0_u8..=255).saturating_sub(20))
                .collect(),
        )
    }
}

/// Sends back what it is sent, as a cable without a controller does.
#[derive(Debug, Default)]
pub struct Echo(Vec<u8>);

impl Peer for Echo {
    fn byte(&mut self, _: u64, byte: u8) {
        self.0.push(byte);
    }
    fn tick(&mut self, _: u64) {}
    fn next_tick_ns(&self) -> Option<u64> {
        None
    }
    fn say(&mut self) -> Option<Vec<u8>> {
        (!self.0.is_empty()).then(|| std::mem::take(&mut self.0))
    }
}

/// A controller of another protocol version or schema: it knows the frozen messages and says so.
///
/// The frozen messages are written out field by field here, so that a change of the crate's types cannot
/// change them.
#[derive(Debug)]
pub struct OtherVersion {
    version: u16,
    schema: u64,
    decoder: Decoder,
    answers: Vec<Vec<u8>>,
    /// Requests other than `Hello`, which it cannot understand.
    pub misunderstood: u32,
}

impl OtherVersion {
    /// Of this version and schema.
    #[must_use]
    pub const fn new(version: u16, schema: u64) -> Self {
        Self {
            version,
            schema,
            decoder: Decoder::new(),
            answers: Vec::new(),
            misunderstood: 0,
        }
    }
}

impl Peer for OtherVersion {
    fn byte(&mut self, _: u64, byte: u8) {
        // session, seq, which request (0: hello), nonce
        match self.decoder.push::<(u32, u32, u8, u32)>(byte) {
            Some(Ok((_, seq, 0, nonce))) => {
                // response; session 0, seq; ok; identity; protocol, schema, nonce, session
                let identity = (
                    0_u8,
                    0_u32,
                    seq,
                    0_u8,
                    0_u8,
                    self.version,
                    self.schema,
                    nonce,
                    9_u32,
                );
                let mut buffer = [0; MAX_FRAME];
                let frame = encode(&identity, &mut buffer).expect("short");
                self.answers.push(frame.to_vec());
            }
            Some(_) => self.misunderstood += 1,
            None => {}
        }
    }
    fn tick(&mut self, _: u64) {}
    fn next_tick_ns(&self) -> Option<u64> {
        None
    }
    fn say(&mut self) -> Option<Vec<u8>> {
        self.answers.pop()
    }
}
