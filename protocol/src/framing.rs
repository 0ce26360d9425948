//! Frames on a byte stream: `COBS(postcard(message) ++ CRC-32 little-endian) ++ 0x00`.
//!
//! # Design
//! The CRC is the common CRC-32 (ISO-HDLC, polynomial 0x04C11DB7, as in Ethernet and zlib), so that a
//! client in any language finds it in its standard library. Zero bytes occur as delimiters only, so a
//! reader that joins in mid-stream is in step again after one delimiter.
//!
//! COBS leaves one choice: data that end with a full block of 254 bytes may or may not be followed by an empty block
//! (0x01). Here it always is, and a frame without it is rejected: else one flipped bit, 0x01 to 0x00, would go
//! unnoticed.

use crc::{CRC_32_ISO_HDLC, Crc, Digest, Table};
use postcard::{de_flavors, ser_flavors};
use serde::{Serialize, de::DeserializeOwned};

static CRC: Crc<u32, Table<1>> = Crc::<u32, Table<1>>::new(&CRC_32_ISO_HDLC);

/// Longest frame in bytes, with its delimiter.
///
/// The longest message is [`crate::Request::Append`] with full batches of large numbers: 8 steps of five
/// varints of up to 10 bytes, 17 bytes around them, 4 of CRC; COBS adds one byte in 254, and two.
pub const MAX_FRAME: usize = 448;

const _: () = assert!(MAX_FRAME > (crate::STEPS_PER_APPEND * 50 + 32 + 4) * 255 / 254 + 2);
// A record is at most three 10-byte numbers and one of 10 more, with an option and a flag byte.
const _: () = assert!(MAX_FRAME > (crate::RECORDS_PER_EVENT * 42 + 16 + 4) * 255 / 254 + 2);

/// Why a frame was dropped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum FrameError {
    /// Longer than [`MAX_FRAME`].
    TooLong,
    /// Not COBS.
    Cobs,
    /// The CRC is wrong, or it is right but the content is no message of this version.
    Content,
}

impl core::fmt::Display for FrameError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            Self::TooLong => "frame too long",
            Self::Cobs => "bad COBS coding",
            Self::Content => "bad CRC or unknown message",
        })
    }
}

impl core::error::Error for FrameError {}

/// Encodes `message` with its delimiter into `out` and returns the used part.
///
/// # Errors
/// [`FrameError::TooLong`] if `out` is too short; [`MAX_FRAME`] is always enough.
pub fn encode<'a, T: Serialize>(message: &T, out: &'a mut [u8]) -> Result<&'a mut [u8], FrameError> {
    let cobs = ser_flavors::Cobs::try_new(ser_flavors::Slice::new(out)).map_err(|_| FrameError::TooLong)?;
    let crc = ser_flavors::crc::CrcModifier::new(cobs, digest());
    postcard::serialize_with_flavor(message, crc).map_err(|_| FrameError::TooLong)
}

/// Decodes one frame in place; `frame` comes without its delimiter.
///
/// # Errors
/// [`FrameError::Cobs`] or [`FrameError::Content`]; bytes after the message count as bad content.
pub fn decode<T: DeserializeOwned>(frame: &mut [u8]) -> Result<T, FrameError> {
    if ends_with_full_block(frame) {
        return Err(FrameError::Cobs);
    }
    let length = cobs::decode_in_place(frame).map_err(|_| FrameError::Cobs)?;
    let bytes = frame.get(..length).ok_or(FrameError::Cobs)?;
    let (message, rest) =
        de_flavors::crc::take_from_bytes_u32(bytes, digest()).map_err(|_| FrameError::Content)?;
    if rest.is_empty() {
        Ok(message)
    } else {
        Err(FrameError::Content)
    }
}

/// Whether the last block of a COBS frame is a full one, without the empty block that belongs behind it.
fn ends_with_full_block(frame: &[u8]) -> bool {
    let mut at = 0;
    let mut code = 0;
    while let Some(&next) = frame.get(at) {
        code = next;
        at += usize::from(next.max(1)); // no zero occurs within a frame; whatever comes, this ends
    }
    code == 0xff && at == frame.len()
}

fn digest() -> Digest<'static, u32, Table<1>> {
    CRC.digest()
}

/// Cuts a byte stream into frames and decodes them, one byte at a time.
#[derive(Debug)]
pub struct Decoder {
    buffer: heapless::Vec<u8, MAX_FRAME>,
    too_long: bool,
}

impl Default for Decoder {
    fn default() -> Self {
        Self::new()
    }
}

impl Decoder {
    /// An empty decoder.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            buffer: heapless::Vec::new(),
            too_long: false,
        }
    }

    /// Takes one byte. `Some` at the end of a frame; empty frames are silent, as they resynchronise a link.
    pub fn push<T: DeserializeOwned>(&mut self, byte: u8) -> Option<Result<T, FrameError>> {
        if byte != 0 {
            self.too_long |= self.buffer.push(byte).is_err();
            return None;
        }
        let result = if self.too_long {
            Some(Err(FrameError::TooLong))
        } else if self.buffer.is_empty() {
            None
        } else {
            Some(decode(&mut self.buffer))
        };
        self.reset();
        result
    }

    /// Forgets a half-received frame: the link was cut and has come back.
    pub fn reset(&mut self) {
        self.buffer.clear();
        self.too_long = false;
    }
}
