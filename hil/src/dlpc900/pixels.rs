//! Images as they are uploaded, taken apart again.

/// Length of the header.
pub(super) const HEADER: usize = 48;

/// An image of one controller: 24 bits a pixel, row by row, plane k in bit k.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Image {
    pub(super) size: (usize, usize),
    pub(super) pixels: Vec<u32>,
}

/// Why an image is none.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Bad {
    /// The header.
    Header,
    /// A compression that there is not.
    Compression,
    /// The pixels.
    Pixels,
}

/// The image that `bytes` hold.
pub(super) fn image(bytes: &[u8]) -> Result<Image, Bad> {
    let (header, data) = bytes.split_at_checked(HEADER).ok_or(Bad::Header)?;
    let short = |at: usize| usize::from(u16::from_le_bytes([header[at], header[at + 1]]));
    let length = u32::from_le_bytes([header[8], header[9], header[10], header[11]]) as usize;
    let rest_is_zero = header[20..24].iter().chain(&header[30..]).all(|byte| *byte == 0);
    if &header[..4] != b"Spld"
        || length != data.len()
        || header[12..20] != [0xFF; 8]
        || header[24] != 1
        || header[26..30] != [1, 0, 0, 1]
        || !rest_is_zero
    {
        return Err(Bad::Header);
    }
    let size = (short(4), short(6));
    let pixels = match header[25] {
        0 => bare(data, size),
        1 => run_lengths(data, size),
        2 => enhanced(data, size),
        _ => return Err(Bad::Compression),
    };
    match pixels {
        Some(pixels) if pixels.len() == size.0 * size.1 => Ok(Image { size, pixels }),
        _ => Err(Bad::Pixels),
    }
}

/// Takes bytes from the front.
struct Bytes<'a>(&'a [u8]);

impl Bytes<'_> {
    fn byte(&mut self) -> Option<u8> {
        let (first, rest) = self.0.split_first()?;
        self.0 = rest;
        Some(*first)
    }

    /// The bytes of a pixel are those of planes 16–23, 8–15 and 0–7.
    fn pixel(&mut self) -> Option<u32> {
        let (high, middle, low) = (self.byte()?, self.byte()?, self.byte()?);
        Some(u32::from(high) << 16 | u32::from(middle) << 8 | u32::from(low))
    }

    /// A count of one or two bytes, of which `first` is the first.
    fn count(&mut self, first: u8) -> Option<usize> {
        if first < 0x80 {
            return Some(usize::from(first));
        }
        Some(usize::from(first & 0x7F) | usize::from(self.byte()?) << 7)
    }
}

/// Rows of pixels that begin every 16 bytes.
fn bare(data: &[u8], (width, _): (usize, usize)) -> Option<Vec<u32>> {
    let mut pixels = Vec::new();
    for row in data.chunks((width * 3).next_multiple_of(16)) {
        let mut bytes = Bytes(row);
        for _ in 0..width {
            pixels.push(bytes.pixel()?);
        }
    }
    Some(pixels)
}

/// The plain run-length encoding: rows end with 0 0 and begin every four bytes.
fn run_lengths(data: &[u8], (width, _): (usize, usize)) -> Option<Vec<u32>> {
    let mut bytes = Bytes(data);
    let mut pixels = Vec::new();
    loop {
        match bytes.byte()? {
            0 => match bytes.byte()? {
                0 => {
                    if !pixels.len().is_multiple_of(width) {
                        return None;
                    }
                    while !(data.len() - bytes.0.len()).is_multiple_of(4) {
                        bytes.byte()?;
                    }
                }
                1 => return Some(pixels),
                count => {
                    for _ in 0..count {
                        pixels.push(bytes.pixel()?);
                    }
                }
            },
            count => {
                let pixel = bytes.pixel()?;
                pixels.extend(std::iter::repeat_n(pixel, usize::from(count)));
            }
        }
    }
}

/// The enhanced run-length encoding, in which pixels may be those of the row above and nothing reaches over the end of a row.
fn enhanced(data: &[u8], (width, _): (usize, usize)) -> Option<Vec<u32>> {
    let mut bytes = Bytes(data);
    let mut pixels: Vec<u32> = Vec::new();
    loop {
        let left = width - pixels.len() % width;
        match bytes.byte()? {
            0 => match bytes.byte()? {
                // The end of a row that ends by itself.
                0 => {}
                1 => {
                    let first = bytes.byte()?;
                    if first == 0 {
                        // What is behind the end fills up to four bytes.
                        return (bytes.0.len() < 4).then_some(pixels);
                    }
                    let count = bytes.count(first)?;
                    let above = pixels.len().checked_sub(width)?;
                    if count > left {
                        return None;
                    }
                    pixels.extend_from_within(above..above + count);
                }
                first => {
                    let count = bytes.count(first)?;
                    if count > left {
                        return None;
                    }
                    for _ in 0..count {
                        pixels.push(bytes.pixel()?);
                    }
                }
            },
            first => {
                let count = bytes.count(first)?;
                if count > left {
                    return None;
                }
                let pixel = bytes.pixel()?;
                pixels.extend(std::iter::repeat_n(pixel, count));
            }
        }
    }
}
