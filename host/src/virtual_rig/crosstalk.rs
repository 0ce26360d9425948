//! Charge that leaks between the colours of the virtual camera's mosaic.
//!
//! # Design
//! A pixel of a mosaic (RGGB) loses a share of its charge to its four neighbours, a quarter to each, and those of a red or blue one are
//! green. Longer waves go deeper, so red leaks most (Agranov, Berezin, Tsai, IEEE Trans. Electron Devices 50, 4, 2003). Light that comes
//! obliquely reaches more of the neighbour: towards the edges of the image more leaks, around where the microlenses are in line.
//!
//! White samples show nothing of it. Of coloured ones each channel shows some of the others.

use std::ops::RangeInclusive;

use rand::{RngExt as _, SeedableRng as _};
use rand_xoshiro::Xoshiro256PlusPlus;
use serde::{Deserialize, Serialize};

use super::flaws::log_uniform;
use crate::instrument::frame_format::place_of_pixel;

/// Shares of the charge that a green pixel loses: with deep trenches between pixels half a per cent, usually 1 %, of small pixels
/// without them 3 % (the same source, and data sheets that state crosstalk).
pub const CROSSTALKS: RangeInclusive<f64> = 5e-3..=3e-2;
/// What red, green and blue pixels lose, over what green ones do.
const DEPTH: [f64; 3] = [1.4, 1.0, 0.6];
/// What tells the chance of crosstalk from that of the rest of the rig: the letters of `cross`.
const STREAM: u64 = 0x0063_726f_7373;

/// The leaks; none of a camera with one channel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Crosstalk {
    /// Share of its charge that a green pixel loses where light comes straight.
    pub share: f64,
    /// By how much more that is half the image's width away from there, relative.
    pub oblique: f64,
    /// Where light comes straight, half widths of the image from its middle.
    pub straight: [f64; 2],
}

impl Crosstalk {
    /// By chance. Its chance is its own, so that it changes no other flaw that follows from the `seed`.
    pub(super) fn drawn(seed: u64) -> Self {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed ^ STREAM);
        Self {
            share: log_uniform(CROSSTALKS, &mut rng),
            oblique: rng.random_range(0.1..0.5),
            straight: std::array::from_fn(|_| rng.random_range(-0.2..0.2)),
        }
    }

    /// Lets the charges of an image of `width_px` × `height_px` pixels leak, [row, column, red green blue].
    pub(crate) fn leak(&self, charge_e: &mut [f32], width_px: usize, height_px: usize) {
        if self.share <= 0.0 {
            return;
        }
        for (index, charge_e) in charge_e.as_chunks_mut::<3>().0.iter_mut().enumerate() {
            let [x, y] = place_of_pixel(index, width_px, height_px);
            let away = (x - self.straight[0]).hypot(y - self.straight[1]);
            let share = self.share * (1.0 + self.oblique * away);
            let [red, green, blue] = std::array::from_fn(|at| f64::from(charge_e[at]) * share * DEPTH[at]);
            for (charge_e, more) in
                charge_e
                    .iter_mut()
                    .zip([green - red, f64::midpoint(red, blue) - green, green - blue])
            {
                *charge_e += more as f32;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mosaic_keeps_its_charge_and_white_stays_white_where_all_leak_alike() {
        let leaks = Crosstalk::drawn(3);
        assert!(CROSSTALKS.contains(&leaks.share), "{leaks:?}");
        let mut coloured = vec![0.0_f32; 3 * 100];
        for pixel in coloured.as_chunks_mut::<3>().0 {
            *pixel = [1000.0, 500.0, 100.0];
        }
        // Of four pixels of the sensor two are green.
        let all = |image: &[f32]| -> f32 {
            let pixels = image.as_chunks::<3>().0.iter();
            pixels.map(|[red, green, blue]| red + 2.0 * green + blue).sum()
        };
        let before = all(&coloured);
        leaks.leak(&mut coloured, 10, 10);
        assert!((all(&coloured) / before - 1.0).abs() < 1e-6);
        let [red, green, blue] = coloured.as_chunks::<3>().0[0];
        assert!(red < 1000.0 && green > 500.0 && blue > 100.0);
        // In the corner more than in the middle.
        assert!(blue > coloured.as_chunks::<3>().0[55][2]);
        let mut still = vec![7.0_f32; 300];
        Crosstalk::default().leak(&mut still, 10, 10);
        assert!(still.iter().all(|charge_e| (charge_e - 7.0).abs() < 1e-9));
    }
}
