//! 64-bit numbers as postcard's varints, made and read byte by byte.
//!
//! # Design
//! The bytes are those that postcard makes of a `u64`, which a test holds against it. On a CPU of 32 bits its own
//! way costs a call for every shift and for every copy; here a number that fits into 32 bits, as nearly all do, is
//! handled in 32. A byte of its own is what postcard makes of a `u8`, so a varint is a tuple of them.
//!
//! # Tradeoffs
//! This is for postcard. Formats for people get a plain number.

use core::fmt;

use serde::de::{Error, SeqAccess, Visitor};
use serde::ser::SerializeTuple;
use serde::{Deserialize, Deserializer, Serializer};

/// Bytes of the longest varint of 64 bits.
const LONGEST: usize = 10;
/// Set in all bytes but the last.
const MORE: u8 = 0x80;

/// For `#[serde(with)]`.
#[allow(clippy::trivially_copy_pass_by_ref)] // serde says how
pub(crate) fn serialize<S: Serializer>(value: &u64, serializer: S) -> Result<S::Ok, S::Error> {
    if serializer.is_human_readable() {
        return serializer.serialize_u64(*value);
    }
    let mut bytes = serializer.serialize_tuple(LONGEST)?;
    let mut long = *value;
    while long > u64::from(u32::MAX) {
        bytes.serialize_element(&(long as u8 | MORE))?;
        long >>= 7;
    }
    let mut short = long as u32;
    while short >= u32::from(MORE) {
        bytes.serialize_element(&(short as u8 | MORE))?;
        short >>= 7;
    }
    bytes.serialize_element(&(short as u8))?;
    bytes.end()
}

/// For `#[serde(with)]`.
pub(crate) fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<u64, D::Error> {
    if deserializer.is_human_readable() {
        return u64::deserialize(deserializer);
    }
    deserializer.deserialize_tuple(LONGEST, Varint)
}

struct Varint;

impl<'de> Visitor<'de> for Varint {
    type Value = u64;

    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str("a varint of 64 bits")
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut bytes: A) -> Result<u64, A::Error> {
        let (mut short, mut long, mut shift) = (0, 0, 0);
        loop {
            let byte: u8 = bytes
                .next_element()?
                .ok_or_else(|| A::Error::custom("varint cut off"))?;
            let bits = byte & !MORE;
            if shift < 28 {
                short |= u32::from(bits) << shift;
            } else if shift < 63 || byte < 2 {
                long |= u64::from(bits) << shift;
            } else {
                return Err(A::Error::custom("varint too long"));
            }
            if byte < MORE {
                return Ok(long | u64::from(short));
            }
            shift += 7;
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::Ticks;

    /// What postcard makes of a number, and the number that it makes of these bytes.
    fn theirs(value: u64, bytes: &[u8]) -> (std::vec::Vec<u8>, Option<(u64, usize)>) {
        let mut buffer = [0; 10];
        let coded = postcard::to_slice(&value, &mut buffer)
            .expect("room for it")
            .to_vec();
        let read = postcard::take_from_bytes::<u64>(bytes).ok();
        (coded, read.map(|(value, rest)| (value, rest.len())))
    }

    fn ours(value: u64, bytes: &[u8]) -> (std::vec::Vec<u8>, Option<(u64, usize)>) {
        let mut buffer = [0; 10];
        let coded = postcard::to_slice(&Ticks(value), &mut buffer)
            .expect("room for it")
            .to_vec();
        let read = postcard::take_from_bytes::<Ticks>(bytes).ok();
        (coded, read.map(|(value, rest)| (value.0, rest.len())))
    }

    #[test]
    fn numbers_of_all_lengths_are_coded_as_postcard_does() {
        for bits in 0..=64 {
            let limit = if bits == 64 { u64::MAX } else { (1 << bits) - 1 };
            for value in [limit, limit.wrapping_add(1), limit / 3, limit - limit / 5] {
                let (coded, _) = theirs(value, &[]);
                assert_eq!(ours(value, &coded), (coded.clone(), Some((value, 0))));
                let cut = &coded[..coded.len() - 1];
                assert_eq!(ours(value, cut), theirs(value, cut), "{value} cut off");
            }
        }
    }

    #[test]
    fn needless_and_excessive_bytes_are_taken_as_postcard_does() {
        for length in 0..=11 {
            for last in [0, 1, 2, 0x7F] {
                let mut bytes = [0x85; 12];
                bytes[length] = last;
                assert_eq!(ours(0, &bytes), theirs(0, &bytes), "{length} bytes, then {last}");
            }
        }
    }
}
