//! Pixel formats: codes and names of the GenICam Pixel Format Naming Convention (PFNC 2.x).

/// How pixels become bytes.
#[derive(Clone, Copy, Debug, Hash, PartialEq, Eq)]
pub enum PixelFormat {
    /// Grey, 8 bits.
    Mono8,
    /// Grey, 10 bits in 16, little-endian.
    Mono10,
    /// Grey, 12 bits in 16, little-endian.
    Mono12,
    /// Grey, 16 bits, little-endian.
    Mono16,
    /// Grey, two pixels of 10 bits in three bytes, as GigE Vision 1.x packs.
    Mono10Packed,
    /// Grey, two pixels of 12 bits in three bytes, as GigE Vision 1.x packs.
    Mono12Packed,
    /// Grey, 10 bits without gaps, least significant bit first.
    Mono10p,
    /// Grey, 12 bits without gaps, least significant bit first.
    Mono12p,
    /// Mosaic that begins with red, green; 8 bits.
    BayerRG8,
    /// Mosaic that begins with red, green; 10 bits in 16, little-endian.
    BayerRG10,
    /// Mosaic that begins with red, green; 12 bits in 16, little-endian.
    BayerRG12,
    /// Mosaic that begins with red, green; 16 bits, little-endian.
    BayerRG16,
    /// Mosaic that begins with green, red; 8 bits.
    BayerGR8,
    /// Mosaic that begins with green, blue; 8 bits.
    BayerGB8,
    /// Mosaic that begins with blue, green; 8 bits.
    BayerBG8,
    /// Mosaic that begins with green, red; 12 bits in 16, little-endian.
    BayerGR12,
    /// Mosaic that begins with green, blue; 12 bits in 16, little-endian.
    BayerGB12,
    /// Mosaic that begins with blue, green; 12 bits in 16, little-endian.
    BayerBG12,
    /// Red, green, blue; 8 bits each.
    Rgb8,
    /// Blue, green, red; 8 bits each.
    Bgr8,
    /// Red, green, blue; 12 bits in 16 each, little-endian.
    Rgb12,
    /// Red, green, blue; 16 bits each, little-endian.
    Rgb16,
}

/// How the values of a format stand in bytes.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Layout {
    Byte,
    Word,
    LegacyPacked,
    BitStream,
}

impl PixelFormat {
    /// All of them.
    pub const ALL: [Self; 22] = [
        Self::Mono8,
        Self::Mono10,
        Self::Mono12,
        Self::Mono16,
        Self::Mono10Packed,
        Self::Mono12Packed,
        Self::Mono10p,
        Self::Mono12p,
        Self::BayerRG8,
        Self::BayerRG10,
        Self::BayerRG12,
        Self::BayerRG16,
        Self::BayerGR8,
        Self::BayerGB8,
        Self::BayerBG8,
        Self::BayerGR12,
        Self::BayerGB12,
        Self::BayerBG12,
        Self::Rgb8,
        Self::Bgr8,
        Self::Rgb12,
        Self::Rgb16,
    ];

    /// Name, code, bits of a value, layout: a row of the PFNC's table.
    const fn row(self) -> (&'static str, u32, u32, Layout) {
        use Layout::{BitStream, Byte, LegacyPacked, Word};
        match self {
            Self::Mono8 => ("Mono8", 0x0108_0001, 8, Byte),
            Self::Mono10 => ("Mono10", 0x0110_0003, 10, Word),
            Self::Mono12 => ("Mono12", 0x0110_0005, 12, Word),
            Self::Mono16 => ("Mono16", 0x0110_0007, 16, Word),
            Self::Mono10Packed => ("Mono10Packed", 0x010c_0004, 10, LegacyPacked),
            Self::Mono12Packed => ("Mono12Packed", 0x010c_0006, 12, LegacyPacked),
            Self::Mono10p => ("Mono10p", 0x010a_0046, 10, BitStream),
            Self::Mono12p => ("Mono12p", 0x010c_0047, 12, BitStream),
            Self::BayerRG8 => ("BayerRG8", 0x0108_0009, 8, Byte),
            Self::BayerRG10 => ("BayerRG10", 0x0110_000d, 10, Word),
            Self::BayerRG12 => ("BayerRG12", 0x0110_0011, 12, Word),
            Self::BayerRG16 => ("BayerRG16", 0x0110_002f, 16, Word),
            Self::BayerGR8 => ("BayerGR8", 0x0108_0008, 8, Byte),
            Self::BayerGB8 => ("BayerGB8", 0x0108_000a, 8, Byte),
            Self::BayerBG8 => ("BayerBG8", 0x0108_000b, 8, Byte),
            Self::BayerGR12 => ("BayerGR12", 0x0110_0010, 12, Word),
            Self::BayerGB12 => ("BayerGB12", 0x0110_0012, 12, Word),
            Self::BayerBG12 => ("BayerBG12", 0x0110_0013, 12, Word),
            Self::Rgb8 => ("RGB8", 0x0218_0014, 8, Byte),
            Self::Bgr8 => ("BGR8", 0x0218_0015, 8, Byte),
            Self::Rgb12 => ("RGB12", 0x0230_001a, 12, Word),
            Self::Rgb16 => ("RGB16", 0x0230_0033, 16, Word),
        }
    }

    /// Its name in the PFNC, which is its name in the XML.
    pub const fn name(self) -> &'static str {
        self.row().0
    }

    /// Its 32-bit code: kind (1 single, 2 multiple components), bits of a pixel, number.
    pub const fn code(self) -> u32 {
        self.row().1
    }

    /// The format with `code`.
    pub fn from_code(code: u32) -> Option<Self> {
        Self::ALL.into_iter().find(|format| format.code() == code)
    }

    /// Bits that a pixel takes, with all its components and gaps.
    pub const fn bits_per_pixel(self) -> u32 {
        self.code() >> 16 & 0xff
    }

    /// Values of a pixel: 1, or 3 of a colour.
    pub const fn channels(self) -> usize {
        if self.code() >> 24 == 2 { 3 } else { 1 }
    }

    /// The largest digital number.
    pub const fn largest(self) -> u16 {
        ((1_u32 << self.row().2) - 1) as u16
    }

    /// Bytes of an image of `width` × `height` pixels.
    pub const fn image_bytes(self, width: u32, height: u32) -> usize {
        let bits = width as u64 * height as u64 * self.bits_per_pixel() as u64;
        bits.div_ceil(8) as usize
    }

    /// Digital numbers, [row, column, channel], as bytes of this format, channels in the order that its name says.
    /// Numbers beyond the largest become that.
    pub fn pack(self, dn: &[u16]) -> Vec<u8> {
        let (_, _, bits, layout) = self.row();
        let clipped = dn.iter().map(|&dn| dn.min(self.largest()));
        match layout {
            Layout::Byte => clipped.map(|dn| dn as u8).collect(),
            Layout::Word => clipped.flat_map(u16::to_le_bytes).collect(),
            Layout::LegacyPacked => {
                let values: Vec<u16> = clipped.collect();
                let high = bits - 8;
                let low = |dn: u16| (dn & ((1 << high) - 1)) as u8;
                values
                    .chunks(2)
                    .flat_map(|pair| {
                        let first = [(pair[0] >> high) as u8, low(pair[0])];
                        match pair.get(1) {
                            Some(&second) => {
                                vec![first[0], first[1] | low(second) << 4, (second >> high) as u8]
                            }
                            None => first.to_vec(),
                        }
                    })
                    .collect()
            }
            Layout::BitStream => {
                let (mut bytes, mut pending, mut held) = (Vec::new(), 0_u32, 0);
                for dn in clipped {
                    pending |= u32::from(dn) << held;
                    held += bits;
                    while held >= 8 {
                        bytes.push(pending as u8);
                        pending >>= 8;
                        held -= 8;
                    }
                }
                if held > 0 {
                    bytes.push(pending as u8);
                }
                bytes
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_packed_as_the_convention_draws_them() {
        assert_eq!(
            PixelFormat::Mono12.pack(&[0xabc, 0xffff]),
            [0xbc, 0x0a, 0xff, 0x0f]
        );
        assert_eq!(
            PixelFormat::Mono12Packed.pack(&[0xabc, 0x123]),
            [0xab, 0x3c, 0x12]
        );
        assert_eq!(
            PixelFormat::Mono10Packed.pack(&[0x2ad, 0x155]),
            [0xab, 0x11, 0x55]
        );
        assert_eq!(PixelFormat::Mono12p.pack(&[0xabc, 0x123]), [0xbc, 0x3a, 0x12]);
        assert_eq!(
            PixelFormat::Mono10p.pack(&[0x3ff, 0, 0x3ff, 0]),
            [0xff, 0x03, 0xf0, 0x3f, 0x00]
        );
    }

    #[test]
    fn every_format_packs_an_image_into_the_bytes_that_its_code_states() {
        for format in PixelFormat::ALL {
            for (width, height) in [(1, 1), (3, 1), (3, 3), (8, 5)] {
                let dn = vec![7; width * height * format.channels()];
                assert_eq!(
                    format.pack(&dn).len(),
                    format.image_bytes(width as u32, height as u32),
                    "{} {width}×{height}",
                    format.name()
                );
            }
            assert_eq!(PixelFormat::from_code(format.code()), Some(format));
        }
    }
}
