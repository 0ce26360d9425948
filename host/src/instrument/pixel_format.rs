//! How a camera writes the values of its pixels.
//!
//! Formats of pixels are those of the Pixel Format Naming Convention (PFNC 2.4), by their names:
//!
//! | name | bytes |
//! |---|---|
//! | `Mono8`, `BayerRG8` … | one per pixel |
//! | `Mono10`, `Mono12`, `Mono14`, `Mono16`, `BayerRG12` … | two per pixel, little-endian |
//! | `Mono12Packed`, `BayerRG12Packed` … | three per two pixels: bits 11–4 of the first, 3–0 of the first (low) and of the second (high), 11–4 of the second |
//! | `Mono10p`, `Mono12p`, `BayerRG10p` … | a stream of bits, the lowest of each pixel first |
//! | `RGB8`, `RGB16` | three values per pixel, as `Mono8` and `Mono16` |

/// How values lie in a frame's bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Packing {
    /// One byte each.
    Bytes,
    /// Two bytes each, little-endian.
    Words,
    /// Two of 12 bits in three bytes, GigE Vision's way.
    Packed12,
    /// A stream of bits.
    Stream,
}

/// A format of pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PixelFormat {
    bits: u8,
    packing: Packing,
    /// Values of a pixel: 1 or 3.
    values: usize,
    /// Channel of the pixels at (even row, even column), (even, odd), (odd, even), (odd, odd) under a mosaic of colours.
    mosaic: Option<[usize; 4]>,
}

impl PixelFormat {
    /// The format of this name; `None` if it is not one of the table above.
    #[must_use]
    pub fn of(name: &str) -> Option<Self> {
        let (family, rest) = ["Mono", "BayerRG", "BayerGR", "BayerGB", "BayerBG", "RGB"]
            .into_iter()
            .find_map(|family| name.strip_prefix(family).map(|rest| (family, rest)))?;
        let (bits, packing) = match rest {
            "8" => (8, Packing::Bytes),
            "10" | "12" | "14" | "16" => (rest.parse().ok()?, Packing::Words),
            "12Packed" => (12, Packing::Packed12),
            "10p" | "12p" => (rest[..2].parse().ok()?, Packing::Stream),
            _ => return None,
        };
        let mosaic = match family {
            "BayerRG" => Some([0, 1, 1, 2]),
            "BayerGR" => Some([1, 0, 2, 1]),
            "BayerGB" => Some([1, 2, 0, 1]),
            "BayerBG" => Some([2, 1, 1, 0]),
            _ => None,
        };
        let values = if family == "RGB" { 3 } else { 1 };
        (values == 1 || matches!(packing, Packing::Bytes | Packing::Words)).then_some(Self {
            bits,
            packing,
            values,
            mosaic,
        })
    }

    /// Channel of the pixels at (even row, even column), (even, odd), (odd, even), (odd, odd) under a mosaic of colours.
    #[must_use]
    pub const fn mosaic(&self) -> Option<[usize; 4]> {
        self.mosaic
    }

    /// Colours of an image that is made of it.
    #[must_use]
    pub const fn channels(&self) -> usize {
        if self.mosaic.is_some() { 3 } else { self.values }
    }

    /// Bits of a value.
    #[must_use]
    pub const fn bits(&self) -> u8 {
        self.bits
    }

    /// Values of a pixel: 1 or 3.
    #[must_use]
    pub const fn values(&self) -> usize {
        self.values
    }

    /// The values of so many `pixels`; `None` if there are fewer in `bytes`.
    #[must_use]
    pub fn values_of(&self, bytes: &[u8], pixels: usize) -> Option<Vec<u16>> {
        (bytes.len() >= self.bytes(pixels)).then(|| self.unpack(bytes, pixels * self.values))
    }

    /// Bytes of a frame of so many pixels.
    #[must_use]
    pub const fn bytes(&self, pixels: usize) -> usize {
        let values = pixels * self.values;
        match self.packing {
            Packing::Bytes => values,
            Packing::Words => values * 2,
            Packing::Packed12 => (values * 3).div_ceil(2),
            Packing::Stream => (values * self.bits as usize).div_ceil(8),
        }
    }

    /// Whether its bytes are the values as files have them: one byte each, or all 16 bits of two, the least first.
    #[must_use]
    pub const fn is_stored_as_it_is(&self) -> bool {
        matches!(self.packing, Packing::Bytes) || matches!(self.packing, Packing::Words) && self.bits == 16
    }

    /// The first `count` values in `bytes`, of which there are enough.
    fn unpack(&self, bytes: &[u8], count: usize) -> Vec<u16> {
        let most = u16::MAX >> (16 - self.bits);
        match self.packing {
            Packing::Bytes => bytes[..count].iter().map(|&value| u16::from(value)).collect(),
            // Bits above those of the format are no part of the number.
            Packing::Words => bytes[..2 * count]
                .chunks_exact(2)
                .map(|pair| u16::from_le_bytes([pair[0], pair[1]]) & most)
                .collect(),
            Packing::Packed12 => (0..count)
                .map(|index| {
                    let three = &bytes[index / 2 * 3..];
                    if index % 2 == 0 {
                        u16::from(three[0]) << 4 | u16::from(three[1] & 0x0f)
                    } else {
                        u16::from(three[2]) << 4 | u16::from(three[1] >> 4)
                    }
                })
                .collect(),
            Packing::Stream => {
                let bits = usize::from(self.bits);
                (0..count)
                    .map(|index| {
                        let first = index * bits;
                        let byte = |at: usize| u32::from(bytes.get(first / 8 + at).copied().unwrap_or(0));
                        let three = byte(0) | byte(1) << 8 | byte(2) << 16;
                        (three >> (first % 8)) as u16 & most
                    })
                    .collect()
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `values` of 12 bits in the packing of this format.
    fn packed(name: &str, values: &[u16]) -> Vec<u8> {
        match name {
            "Mono12" => values.iter().flat_map(|value| value.to_le_bytes()).collect(),
            "Mono12Packed" => values
                .chunks(2)
                .flat_map(|two| {
                    let [a, b] = [two[0], two[1]];
                    [(a >> 4) as u8, (a & 0xf | (b & 0xf) << 4) as u8, (b >> 4) as u8]
                })
                .collect(),
            _ => values
                .chunks(2)
                .flat_map(|two| {
                    let bits = u32::from(two[0]) | u32::from(two[1]) << 12;
                    [bits as u8, (bits >> 8) as u8, (bits >> 16) as u8]
                })
                .collect(),
        }
    }

    #[test]
    fn packed_values_are_those_that_were_packed() {
        let values: Vec<u16> = (0..64_u32).map(|at| ((at * 1117 + 13) % 4096) as u16).collect();
        for name in ["Mono12", "Mono12Packed", "Mono12p"] {
            let format = PixelFormat::of(name).unwrap();
            let bytes = packed(name, &values);
            assert_eq!(format.bytes(64), bytes.len(), "{name}");
            assert_eq!(format.unpack(&bytes, 64), values, "{name}");
        }
        for name in ["Mono9", "RGB12Packed", "YUV8", "Mono", "BayerRG", ""] {
            assert_eq!(PixelFormat::of(name), None, "{name}");
        }
    }
}
