//! Patterns as a DLPC900 stores them: 24 planes of one bit in an image, compressed.
//!
//! # Design
//! An image has 24 bits a pixel, planes 0–7 in green, 8–15 in red, 16–23 in blue; what is uploaded has the bytes of a pixel in the order
//! blue, red, green. A header of 48 bytes comes first (DLPU018J, 2.4.2), then rows from the top, compressed by the enhanced run-length
//! encoding (2.4.3.2), as which images of spots shrink to a thousandth:
//!
//! | bytes | meaning |
//! |---|---|
//! | 0 1 0 | end of the image |
//! | 0 1 n | n pixels as in the row above |
//! | 0 n p…, n > 1 | n pixels |
//! | n p | one pixel n times |
//!
//! n has one byte below 128, and two above: its lowest seven bits with the highest bit set, then the others. Nothing reaches over the end
//! of a row.

use crate::plan::pattern::BitPattern;

/// Bits of a pixel.
pub const PLANES: usize = 24;
/// Length of the header, bytes.
pub const HEADER: usize = 48;

/// What is in the planes of an image, from plane 0 on: a pattern of `depth` bits takes so many of them.
#[derive(Debug)]
pub struct Planes<'a> {
    patterns: &'a [BitPattern],
    depth: usize,
}

impl<'a> Planes<'a> {
    /// The planes of `patterns`, of one size: one each where they are black and white (`depth` 1), eight where they have levels (8).
    #[must_use]
    pub fn of(patterns: &'a [BitPattern], depth: usize) -> Self {
        debug_assert!(patterns.len() * depth <= PLANES, "{} patterns", patterns.len());
        Self { patterns, depth }
    }

    /// The image of columns `from` until `to`, as it is uploaded.
    #[must_use]
    pub fn upload(&self, (from, to): (usize, usize)) -> Vec<u8> {
        let height = self.patterns.first().map_or(0, |pattern| pattern.size_px().1);
        let mut bytes = vec![0; HEADER];
        let mut above = Vec::new();
        let mut row = vec![0; to - from];
        for y in 0..height {
            self.row(y, from, &mut row);
            encode(&row, &above, &mut bytes);
            above.clone_from(&row);
        }
        bytes.extend([0, 1, 0]);
        let length = (bytes.len() - HEADER) as u32;
        let size = [(to - from) as u16, height as u16];
        bytes[..HEADER].copy_from_slice(&header(size, length));
        bytes
    }

    /// The pixels of row `y` from column `from` on, plane k in bit k.
    pub fn row(&self, y: usize, from: usize, row: &mut [u32]) {
        row.fill(0);
        for (index, pattern) in self.patterns.iter().enumerate() {
            let level = match self.depth {
                1 => u32::from(pattern.level() > 0),
                _ => u32::from(pattern.level()),
            };
            let value = level << (index * self.depth);
            let stride = pattern.size_px().0.div_ceil(8);
            let bytes = &pattern.bytes()[y * stride..(y + 1) * stride];
            for (at, &byte) in bytes.iter().enumerate().filter(|(_, byte)| **byte != 0) {
                for bit in (0..8).filter(|bit| byte & (0x80 >> bit) != 0) {
                    let x = (at * 8 + bit).checked_sub(from);
                    if let Some(pixel) = x.and_then(|x| row.get_mut(x)) {
                        *pixel |= value;
                    }
                }
            }
        }
    }
}

/// The header of an image of `size` (width, height) whose compressed pixels have `length` bytes.
fn header(size: [u16; 2], length: u32) -> [u8; HEADER] {
    let mut header = [0; HEADER];
    header[..4].copy_from_slice(b"Spld");
    header[4..6].copy_from_slice(&size[0].to_le_bytes());
    header[6..8].copy_from_slice(&size[1].to_le_bytes());
    header[8..12].copy_from_slice(&length.to_le_bytes());
    // No part of the image is shown alone.
    header[12..20].fill(0xFF);
    // Pixels of 24 bits, the enhanced run-length encoding, bytes in the order above; an image for the left eye, as all are.
    header[24..27].copy_from_slice(&[1, 2, 1]);
    header[29] = 1;
    header
}

/// Appends `row`, below `above` (empty for the first one), to `bytes`.
fn encode(row: &[u32], above: &[u32], bytes: &mut Vec<u8>) {
    let same = |at: usize| -> usize {
        let pairs = row[at..].iter().zip(above.get(at..).unwrap_or_default());
        pairs.take_while(|(pixel, above)| pixel == above).count()
    };
    let run = |at: usize| row[at..].iter().take_while(|pixel| **pixel == row[at]).count();
    let mut x = 0;
    // Pixels that neither repeat the one before nor the one above.
    let mut bare = 0;
    while x < row.len() {
        let (same, run) = (same(x), run(x));
        if same < 2 && run < 2 {
            bare += 1;
            x += 1;
            continue;
        }
        encode_bare(&row[x - bare..x], bytes);
        bare = 0;
        if same >= run {
            bytes.extend([0, 1]);
            encode_count(same, bytes);
            x += same;
        } else {
            encode_count(run, bytes);
            encode_pixel(row[x], bytes);
            x += run;
        }
    }
    encode_bare(&row[x - bare..], bytes);
}

fn encode_bare(pixels: &[u32], bytes: &mut Vec<u8>) {
    match pixels {
        [] => {}
        // A count of 1 behind a 0 would mean the row above.
        [one] => {
            bytes.push(1);
            encode_pixel(*one, bytes);
        }
        _ => {
            bytes.push(0);
            encode_count(pixels.len(), bytes);
            for &pixel in pixels {
                encode_pixel(pixel, bytes);
            }
        }
    }
}

fn encode_count(count: usize, bytes: &mut Vec<u8>) {
    if count < 0x80 {
        bytes.push(count as u8);
    } else {
        bytes.extend([count as u8 | 0x80, (count >> 7) as u8]);
    }
}

fn encode_pixel(pixel: u32, bytes: &mut Vec<u8>) {
    let [green, red, blue, _] = pixel.to_le_bytes();
    bytes.extend([blue, red, green]);
}
