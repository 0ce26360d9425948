//! GigE Vision Streaming Protocol: frames to packets.
//!
//! # Format (GigE Vision 2.x, "GVSP"; big-endian)
//! A packet begins with `status16 block16 format8 packet24`, or with 64-bit ids `status16 flags16 (80 | format)8
//! 000000 block64 packet32`. Packet 0 is the leader (format 1), then comes the payload (format 3), the last is the
//! trailer (format 2). A packet that is sent again has the flag 0001, or without flags the status 0100 where the
//! client wants that; one that is not there any more has status 800c and no bytes.
//!
//! | packet | bytes |
//! |---|---|
//! | leader | `0000 type16 timestamp64 pixel32 width32 height32 x32 y32 padding_x16 padding_y16`; type 0001 image, 4001 with chunks |
//! | payload | the image; with chunks each chunk is followed by `id32 length32`, the image first |
//! | trailer | `0000 type16 height32`, with chunks `length32 layout32` |
//! | test packet | zeros, all of them as large as the packet size says |
//!
//! | chunk | id | bytes |
//! |---|---|---|
//! | image | 000000a0 | filled up to a multiple of 4 with zeros |
//! | frame id | 000000a1 | 64-bit number |
//! | time-stamp in ticks | 000000a2 | 64-bit number |
//! | exposure time in µs | 000000a3 | 64-bit floating-point number |

use std::net::SocketAddrV4;
use std::sync::Arc;

use super::gvcp::Status;
use super::settings::{Chunks, Config};

/// What a packet's size has beside GVSP: heads of IP and UDP.
pub(super) const IP_AND_UDP_BYTES: u32 = 28;

pub(super) const IMAGE_CHUNK: u32 = 0xa0;
pub(super) const FRAME_ID_CHUNK: u32 = 0xa1;
pub(super) const TIMESTAMP_CHUNK: u32 = 0xa2;
pub(super) const EXPOSURE_CHUNK: u32 = 0xa3;

/// Bytes of the payload with an image of `image` bytes.
pub(super) fn payload_bytes(image: usize, chunks: Chunks) -> usize {
    if !chunks.active {
        return image;
    }
    let more = [chunks.frame_id, chunks.timestamp, chunks.exposure_time];
    image.next_multiple_of(4) + 8 + 16 * more.iter().filter(|&&on| on).count()
}

/// What a frame is, before it is cut up.
pub(super) struct Shot<'a> {
    pub(super) config: &'a Config,
    pub(super) destination: SocketAddrV4,
    pub(super) image: Arc<[u8]>,
    /// Bytes that stand in place of the image's first ones.
    pub(super) stamped: bool,
    pub(super) ticks: u64,
    pub(super) exposure_us: f64,
}

/// A frame, ready to be sent, as often as needed.
pub(super) struct Frame {
    pub(super) id: u64,
    pub(super) extended: bool,
    pub(super) destination: SocketAddrV4,
    /// Bytes of payload in a packet.
    part: usize,
    leader: Vec<u8>,
    image: Arc<[u8]>,
    /// In place of the image's first bytes.
    stamp: Vec<u8>,
    /// What follows the image.
    tail: Vec<u8>,
    trailer: Vec<u8>,
}

impl Frame {
    pub(super) fn new(id: u64, shot: Shot<'_>) -> Self {
        let config = shot.config;
        let head = if config.extended_ids { 20 } else { 8 };
        let kind: u32 = if config.chunks.active { 0x4001 } else { 1 };
        let region = config.region;
        let mut leader = Vec::with_capacity(36);
        leader.extend(kind.to_be_bytes());
        leader.extend(shot.ticks.to_be_bytes());
        for word in [
            config.format.code(),
            region.width,
            region.height,
            region.offset_x,
            region.offset_y,
            0,
        ] {
            leader.extend(word.to_be_bytes());
        }
        let mut tail = Vec::new();
        if config.chunks.active {
            let image = shot.image.len().next_multiple_of(4);
            tail.resize(image - shot.image.len(), 0);
            let mut end = |id: u32, length: usize, value: &[u8]| {
                tail.extend(value);
                tail.extend(id.to_be_bytes());
                tail.extend((length as u32).to_be_bytes());
            };
            end(IMAGE_CHUNK, image, &[]);
            let chunks = config.chunks;
            for (on, chunk, value) in [
                (chunks.frame_id, FRAME_ID_CHUNK, id),
                (chunks.timestamp, TIMESTAMP_CHUNK, shot.ticks),
                (chunks.exposure_time, EXPOSURE_CHUNK, shot.exposure_us.to_bits()),
            ] {
                if on {
                    end(chunk, 8, &value.to_be_bytes());
                }
            }
        }
        let mut trailer = Vec::new();
        trailer.extend(kind.to_be_bytes());
        trailer.extend(region.height.to_be_bytes());
        if config.chunks.active {
            let length = shot.image.len() + tail.len();
            trailer.extend((length as u32).to_be_bytes());
            trailer.extend([0; 4]);
        }
        let stamp = if shot.stamped && shot.image.len() >= 8 {
            id.to_le_bytes().to_vec()
        } else {
            Vec::new()
        };
        Self {
            id,
            extended: config.extended_ids,
            destination: shot.destination,
            part: (config.packet_bytes - IP_AND_UDP_BYTES) as usize - head,
            leader,
            image: shot.image,
            stamp,
            tail,
            trailer,
        }
    }

    /// Bytes that it holds.
    pub(super) fn bytes(&self) -> usize {
        self.image.len() + self.tail.len()
    }

    /// Number of packets, leader and trailer included.
    pub(super) fn packets(&self) -> u32 {
        self.bytes().div_ceil(self.part) as u32 + 2
    }

    /// Makes `out` its packet number `packet`; `again` as what it is marked to be sent again.
    pub(super) fn packet(&self, packet: u32, again: Option<Status>, out: &mut Vec<u8>) {
        out.clear();
        let last = self.packets() - 1;
        let format = match packet {
            0 => 1,
            packet if packet == last => 2,
            _ => 3,
        };
        head(self.extended, self.id, format, packet, again, out);
        match format {
            1 => out.extend(&self.leader),
            2 => out.extend(&self.trailer),
            _ => {
                let start = (packet as usize - 1) * self.part;
                let end = (start + self.part).min(self.bytes());
                let image = self.image.len();
                let first = out.len();
                out.extend(&self.image[start.min(image)..end.min(image)]);
                out.extend(&self.tail[start.max(image) - image..end.max(image) - image]);
                if let Some(stamp) = self.stamp.get(start..) {
                    let stamped = stamp.len().min(end - start);
                    out[first..first + stamped].copy_from_slice(&stamp[..stamped]);
                }
            }
        }
    }
}

/// The head of a packet.
pub(super) fn head(
    extended: bool,
    id: u64,
    format: u8,
    packet: u32,
    status: Option<Status>,
    out: &mut Vec<u8>,
) {
    if extended {
        let resent = status == Some(Status::PacketResend);
        let status = status.filter(|_| !resent).map_or(0, |status| status as u16);
        out.extend(status.to_be_bytes());
        out.extend(u16::from(resent).to_be_bytes());
        out.extend([0x80 | format, 0, 0, 0]);
        out.extend(id.to_be_bytes());
        out.extend(packet.to_be_bytes());
    } else {
        out.extend(status.map_or(0, |status| status as u16).to_be_bytes());
        out.extend((id as u16).to_be_bytes());
        out.extend((u32::from(format) << 24 | packet & 0xff_ffff).to_be_bytes());
    }
}
