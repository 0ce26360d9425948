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

use core::ops::Range;

use crc::{CRC_32_ISO_HDLC, Crc, Table};
use postcard::ser_flavors::Flavor;
use serde::{Serialize, de::DeserializeOwned};

static CRC: Crc<u32, Table<1>> = Crc::<u32, Table<1>>::new(&CRC_32_ISO_HDLC);

/// Bytes of a COBS block that stands for no zero.
const FULL_BLOCK: usize = 254;

/// Bytes that COBS adds to a frame at most: the first code, and one for every full block.
const MOST_ADDED: usize = 1 + MAX_FRAME / FULL_BLOCK;

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
#[cfg_attr(target_os = "none", derive(defmt::Format))]
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
    // One pass over the bytes for each of the three: on a small CPU that is a fraction of the work of one pass with
    // three things to do at every byte. COBS makes room at the front for what it adds.
    let body = out.get_mut(MOST_ADDED..).ok_or(FrameError::TooLong)?;
    let used = postcard::serialize_with_flavor(message, Body { bytes: body, used: 0 })
        .map_err(|_| FrameError::TooLong)?;
    let crc = CRC.checksum(&body[..used]).to_le_bytes();
    body.get_mut(used..used + crc.len())
        .ok_or(FrameError::TooLong)?
        .copy_from_slice(&crc);
    let coded = stuff(out, MOST_ADDED..MOST_ADDED + used + crc.len());
    *out.get_mut(coded).ok_or(FrameError::TooLong)? = 0;
    Ok(&mut out[..=coded])
}

/// Takes the bytes of a message one by one: they come in ones and twos, for which a call of `memcpy` is long.
struct Body<'a> {
    bytes: &'a mut [u8],
    used: usize,
}

impl Flavor for Body<'_> {
    type Output = usize;

    #[inline]
    fn try_push(&mut self, byte: u8) -> postcard::Result<()> {
        let place = self.bytes.get_mut(self.used);
        *place.ok_or(postcard::Error::SerializeBufferFull)? = byte;
        self.used += 1;
        Ok(())
    }

    fn finalize(self) -> postcard::Result<usize> {
        Ok(self.used)
    }
}

/// Brings the bytes in `body` to the front of `buffer` as COBS, and returns how many they are then. The body
/// begins at least as far behind the front as COBS adds bytes.
fn stuff(buffer: &mut [u8], body: Range<usize>) -> usize {
    // Byte by byte, as most blocks are shorter than a call of `memmove` takes.
    let (mut code, mut to) = (0, 1);
    for from in body {
        let byte = buffer[from];
        if byte != 0 {
            buffer[to] = byte;
            to += 1;
        }
        if byte == 0 || to - code > FULL_BLOCK {
            buffer[code] = (to - code) as u8;
            (code, to) = (to, to + 1);
        }
    }
    buffer[code] = (to - code) as u8;
    to // the zero of the last block is the delimiter
}

/// The CRC-32 of frames, of any bytes.
#[must_use]
pub fn checksum(bytes: &[u8]) -> u32 {
    CRC.checksum(bytes)
}

/// Decodes one frame in place; `frame` comes without its delimiter.
///
/// # Errors
/// [`FrameError::Cobs`] or [`FrameError::Content`]; bytes after the message count as bad content.
pub fn decode<T: DeserializeOwned>(frame: &mut [u8]) -> Result<T, FrameError> {
    let length = unstuff(frame).ok_or(FrameError::Cobs)?;
    let bytes = &frame[..length];
    let (body, crc) = bytes.split_last_chunk().ok_or(FrameError::Content)?;
    if CRC.checksum(body) != u32::from_le_bytes(*crc) {
        return Err(FrameError::Content);
    }
    let mut deserializer = postcard::Deserializer::from_bytes(body);
    let message = T::deserialize(&mut deserializer).map_err(|_| FrameError::Content)?;
    match deserializer.finalize() {
        Ok([]) => Ok(message),
        _ => Err(FrameError::Content),
    }
}

/// Undoes [`stuff`] in place, and returns how many bytes there are then; `None` if it is not COBS, or ends with
/// a full block.
fn unstuff(frame: &mut [u8]) -> Option<usize> {
    let (mut from, mut to) = (0, 0);
    loop {
        let code = usize::from(*frame.get(from)?);
        let taken = code.checked_sub(1)?;
        if from + code > frame.len() {
            return None;
        }
        for at in from + 1..from + code {
            frame[to] = frame[at];
            to += 1;
        }
        from += code;
        if taken < FULL_BLOCK {
            if from == frame.len() {
                return Some(to);
            }
            frame[to] = 0;
            to += 1;
        }
    }
}

/// Cuts a byte stream into frames and decodes them.
#[derive(Debug)]
pub struct Decoder {
    buffer: heapless::Vec<u8, MAX_FRAME>,
    too_long: bool,
    /// The buffer holds a frame that was handed out.
    ended: bool,
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
            ended: false,
        }
    }

    /// Takes one byte. `Some` at the end of a frame; empty frames are silent, as they resynchronise a link.
    pub fn push<T: DeserializeOwned>(&mut self, byte: u8) -> Option<Result<T, FrameError>> {
        self.frame(&mut &[byte][..]).map(|frame| frame.and_then(decode))
    }

    /// Takes bytes off the front of `bytes`, up to the end of a frame that holds something, or all of them. Such a
    /// frame is for [`decode`].
    pub fn frame(&mut self, bytes: &mut &[u8]) -> Option<Result<&mut [u8], FrameError>> {
        if core::mem::take(&mut self.ended) {
            self.reset();
        }
        while let Some(end) = bytes.iter().position(|&byte| byte == 0) {
            self.keep(&bytes[..end]);
            *bytes = &bytes[end + 1..];
            if core::mem::take(&mut self.too_long) {
                self.reset();
                return Some(Err(FrameError::TooLong));
            }
            if !self.buffer.is_empty() {
                self.ended = true;
                return Some(Ok(&mut self.buffer));
            }
        }
        self.keep(bytes);
        *bytes = &[];
        None
    }

    fn keep(&mut self, part: &[u8]) {
        self.too_long |= self.buffer.extend_from_slice(part).is_err();
    }

    /// Forgets a half-received frame: the link was cut and has come back.
    pub fn reset(&mut self) {
        self.buffer.clear();
        self.too_long = false;
        self.ended = false;
    }
}
