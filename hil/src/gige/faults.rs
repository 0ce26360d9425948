//! What goes wrong on purpose.

use super::pixel_format::PixelFormat;

/// What goes wrong on purpose. Frames are named by their ids, packets by their numbers (0 is the leader).
#[derive(Clone, Debug, PartialEq)]
pub struct Faults {
    /// Seed of the packets that are lost by chance.
    pub seed: u64,
    /// Share of packets that are lost by chance, 0 to 1.
    pub packet_loss: f64,
    /// Frame and packet of others that are lost.
    pub lost: Vec<(u64, u32)>,
    /// Whether what is lost is lost again whenever it is sent again.
    pub lost_for_good: bool,
    /// Frames of which no packet is sent; they cannot be asked for either.
    pub starved: Vec<u64>,
    /// Frames that are sent twice.
    pub duplicated: Vec<u64>,
    /// Frames whose ids are larger by so much, and all ids after them.
    pub jumps: Vec<(u64, u64)>,
    /// Frames that come in another pixel format than is set.
    pub formats: Vec<(u64, PixelFormat)>,
    /// Frames that come in another width and height than are set.
    pub sizes: Vec<(u64, (u32, u32))>,
    /// Whether the camera is deaf and mute on its control channel, heartbeats included.
    pub silent: bool,
    /// Parts in a million by which the clock is too fast: of frames, and where it is latched.
    pub clock_ppm: f64,
}

impl Default for Faults {
    /// Nothing goes wrong.
    fn default() -> Self {
        Self {
            seed: 0,
            packet_loss: 0.0,
            lost: Vec::new(),
            lost_for_good: false,
            starved: Vec::new(),
            duplicated: Vec::new(),
            jumps: Vec::new(),
            formats: Vec::new(),
            sizes: Vec::new(),
            silent: false,
            clock_ppm: 0.0,
        }
    }
}

impl Faults {
    /// Whether a packet is lost, when it is sent or sent `again`.
    pub(super) fn loses(&self, frame: u64, packet: u32, again: bool) -> bool {
        if again && !self.lost_for_good {
            return false;
        }
        let key = self.seed ^ frame.rotate_left(32) ^ u64::from(packet);
        // The upper 53 bits are a number from 0 to 1.
        let chance = (mixed(mixed(key)) >> 11) as f64 / (1_u64 << 53) as f64;
        chance < self.packet_loss || self.lost.contains(&(frame, packet))
    }

    /// By how much ids jump at the frame that would be `id`.
    pub(super) fn jump(&self, id: u64) -> u64 {
        let jumps = self.jumps.iter().filter(|(at, _)| *at == id);
        jumps.map(|(_, by)| by).fold(0, |sum, by| sum.wrapping_add(*by))
    }
}

/// `time_ns` by a clock that is too fast by `ppm` parts in a million.
pub(super) fn drifted(time_ns: u64, ppm: f64) -> u64 {
    let drift = (time_ns as f64 * ppm * 1e-6).round() as i64;
    time_ns.saturating_add_signed(drift)
}

/// SplitMix64 (Steele, Lea & Flood 2014): which packets are lost depends on their names alone, not on their order.
fn mixed(state: u64) -> u64 {
    let mut z = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}
