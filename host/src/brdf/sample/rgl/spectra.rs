//! Red, green and blue of spectra.
//!
//! A sample of three channels has of a spectrum what the CIE 1931 standard observer (2°) sees of it in light of the illuminant D65, as linear
//! RGB of the primaries of Rec. 709 (sRGB), scaled so that the perfect reflector is 1 in each channel. Between its wavelengths a spectrum
//! is linear; before the first and behind the last it is as there. Colours that these primaries do not reach are 0 in the channel that
//! would be negative, as in the `_rgb` files of the database.
//!
//! Source: CIE 15 (colour-matching functions and illuminant, here every 10 nm and linear between), IEC 61966-2-1 (primaries).
//!
//! # Tradeoffs
//! Every 10 nm instead of every one leaves channels of smooth spectra within some 0.2 %. The table has f for the weights alone, once: what
//! one wavelength is, nobody can ask here.

use std::path::Path;

use crate::brdf::sample::SampleError;
use crate::brdf::sample::tensor_file::file_error;

/// What the channels of a file with spectra are, in words.
pub(super) const WORDS: &str =
    "linear sRGB of the CIE 1931 2° observer under D65, the perfect reflector being 1";
/// Wavelengths from which colours follow reach from here to there, nanometres; beyond lie 0.3 % of luminance and 3 % of blue.
const VISIBLE_NM: [f64; 2] = [420.0, 680.0];
/// Farther apart they tell nothing of what is between them.
const WIDEST_NM: f64 = 50.0;
/// Wavelengths that a spectrum of reflectance may have at all.
const KNOWN_NM: [f64; 2] = [100.0, 100_000.0];
/// First wavelength of the tables, and their step.
const FIRST_NM: f64 = 380.0;
const STEP_NM: f64 = 10.0;
/// The weights are summed over as many parts of a step.
const PARTS: usize = 10;

/// Colour-matching functions x̄, ȳ, z̄ and relative power of D65, from 380 nm every 10 nm.
#[rustfmt::skip]
const OBSERVER: [[f64; 4]; 41] = [
    [0.0014, 0.0000, 0.0065, 49.98], [0.0042, 0.0001, 0.0201, 54.65], [0.0143, 0.0004, 0.0679, 82.75],
    [0.0435, 0.0012, 0.2074, 91.49], [0.1344, 0.0040, 0.6456, 93.43], [0.2839, 0.0116, 1.3856, 86.68],
    [0.3483, 0.0230, 1.7471, 104.86], [0.3362, 0.0380, 1.7721, 117.01], [0.2908, 0.0600, 1.6692, 117.81],
    [0.1954, 0.0910, 1.2876, 114.86], [0.0956, 0.1390, 0.8130, 115.92], [0.0320, 0.2080, 0.4652, 108.81],
    [0.0049, 0.3230, 0.2720, 109.35], [0.0093, 0.5030, 0.1582, 107.80], [0.0633, 0.7100, 0.0782, 104.79],
    [0.1655, 0.8620, 0.0422, 107.69], [0.2904, 0.9540, 0.0203, 104.41], [0.4334, 0.9950, 0.0087, 104.05],
    [0.5945, 0.9950, 0.0039, 100.00], [0.7621, 0.9520, 0.0021, 96.33], [0.9163, 0.8700, 0.0017, 95.79],
    [1.0263, 0.7570, 0.0011, 88.69], [1.0622, 0.6310, 0.0008, 90.01], [1.0026, 0.5030, 0.0003, 89.60],
    [0.8544, 0.3810, 0.0002, 87.70], [0.6424, 0.2650, 0.0000, 83.29], [0.4479, 0.1750, 0.0000, 83.70],
    [0.2835, 0.1070, 0.0000, 80.03], [0.1649, 0.0610, 0.0000, 80.21], [0.0874, 0.0320, 0.0000, 82.28],
    [0.0468, 0.0170, 0.0000, 78.28], [0.0227, 0.0082, 0.0000, 69.72], [0.0114, 0.0041, 0.0000, 71.61],
    [0.0058, 0.0021, 0.0000, 74.35], [0.0029, 0.0010, 0.0000, 61.60], [0.0014, 0.0005, 0.0000, 69.89],
    [0.0007, 0.0003, 0.0000, 75.09], [0.0003, 0.0001, 0.0000, 63.59], [0.0002, 0.0001, 0.0000, 46.42],
    [0.0001, 0.0000, 0.0000, 66.81], [0.0000, 0.0000, 0.0000, 63.38],
];

/// Linear RGB of X, Y and Z.
const PRIMARIES: [[f64; 3]; 3] = [
    [3.2406, -1.5372, -0.4986],
    [-0.9689, 1.8758, 0.0415],
    [0.0557, -0.2040, 1.0570],
];

/// Weights of each of `wavelengths_nm`, ascending, in red, green and blue; they sum to 1 in each. Of one wavelength alone they are 1: it
/// is one band.
///
/// # Errors
/// [`SampleError::File`] of wavelengths from which colours do not follow.
pub(super) fn weights(wavelengths_nm: &[f64], path: &Path) -> Result<Vec<[f64; 3]>, SampleError> {
    let wrong = |expected: &str, found: String| file_error(path, "wavelengths", expected, &found);
    let ([first, .., last] | [first @ last]) = *wavelengths_nm else {
        return Err(wrong("some", "none".to_owned()));
    };
    let [least, most] = KNOWN_NM;
    if first < least || last > most {
        let expected = format!("nanometres from {least} to {most}");
        return Err(wrong(&expected, format!("{first} to {last}")));
    }
    if wavelengths_nm.len() == 1 {
        return Ok(vec![[1.0; 3]]);
    }
    let [from, to] = VISIBLE_NM;
    if first > from || last < to {
        let expected = format!("{from} to {to} nm within them, from which colours follow, or one alone");
        return Err(wrong(&expected, format!("{first} to {last}")));
    }
    let visible = |two: &&[f64]| two[1] > from && two[0] < to && two[1] - two[0] > WIDEST_NM;
    if let Some([before, after]) = wavelengths_nm.windows(2).find(visible) {
        let expected = format!("steps of at most {WIDEST_NM} nm from {from} to {to} nm");
        return Err(wrong(&expected, format!("{after} after {before}")));
    }
    let mut weights = vec![[0.0; 3]; wavelengths_nm.len()];
    for number in 0..(OBSERVER.len() - 1) * PARTS {
        let at = (number as f64 + 0.5) / PARTS as f64;
        let (entry, t) = (at as usize, at.fract());
        let seen: [f64; 4] = std::array::from_fn(|of| {
            OBSERVER[entry][of] + t * (OBSERVER[entry + 1][of] - OBSERVER[entry][of])
        });
        let rgb = PRIMARIES.map(|row| {
            let sum = row.iter().zip(seen).map(|(factor, xyz)| factor * xyz);
            seen[3] * sum.sum::<f64>()
        });
        let (below, shares) = crate::base::bracket::bracket(wavelengths_nm, at.mul_add(STEP_NM, FIRST_NM));
        for (place, share) in [below, below + 1].into_iter().zip(shares) {
            if let Some(weights) = weights.get_mut(place).filter(|_| share > 0.0) {
                *weights = std::array::from_fn(|c| weights[c] + share * rgb[c]);
            }
        }
    }
    let white: [f64; 3] = std::array::from_fn(|c| weights.iter().map(|weights| weights[c]).sum());
    Ok(weights
        .into_iter()
        .map(|of| std::array::from_fn(|c| of[c] / white[c]))
        .collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(wavelengths_nm: &[f64]) -> Result<Vec<[f64; 3]>, SampleError> {
        weights(wavelengths_nm, Path::new("x.bsdf"))
    }

    /// Red, green and blue of the reflectance `of` a wavelength in nanometres, from spectra every `step` nm.
    fn seen(step: f64, of_nm: impl Fn(f64) -> f64) -> [f64; 3] {
        let wavelengths: Vec<f64> = (0..=(470.0 / step) as usize)
            .map(|n| 360.0 + n as f64 * step)
            .collect();
        let weights = of(&wavelengths).unwrap();
        let all = wavelengths.iter().zip(&weights);
        all.fold([0.0; 3], |sum, (nm, weight)| {
            std::array::from_fn(|c| sum[c] + of_nm(*nm) * weight[c])
        })
    }

    #[test]
    fn the_white_of_the_tables_is_that_of_d65() {
        let xyz: [f64; 3] = std::array::from_fn(|c| OBSERVER.iter().map(|of| of[c] * of[3]).sum());
        let sum: f64 = xyz.iter().sum();
        assert!(
            (xyz[0] / sum - 0.3127).abs() < 2e-4 && (xyz[1] / sum - 0.3290).abs() < 2e-4,
            "{xyz:?}"
        );
        // Before it is scaled, white is some 1 in each channel already.
        for row in PRIMARIES {
            let channel: f64 = row.iter().zip(xyz).map(|(factor, of)| factor * of / xyz[1]).sum();
            assert!((channel - 1.0).abs() < 2e-3, "{channel}");
        }
    }

    #[test]
    fn grey_is_grey_and_colours_are_theirs_however_fine_the_spectrum() {
        for step in [1.0, 4.0, 7.3, 31.0] {
            let grey = seen(step, |_| 0.4);
            assert!(grey.iter().all(|of| (of - 0.4).abs() < 1e-12), "{step}: {grey:?}");
            let slope = |nm: f64| (nm - 300.0) / 500.0;
            let (fine, coarse) = (seen(1.0, slope), seen(step, slope));
            assert!(
                fine.iter().zip(coarse).all(|(a, b)| (a - b).abs() < 1e-6),
                "{step}: {fine:?} {coarse:?}"
            );
            assert!(fine[0] > fine[1] && fine[1] > fine[2], "{fine:?}");
        }
        let red = seen(5.0, |nm| if nm > 600.0 { 1.0 } else { 0.0 });
        assert!(red[0] > 0.7 && red[1] < 0.2 && red[2].abs() < 0.1, "{red:?}");
    }

    #[test]
    fn wavelengths_without_colours_are_refused() {
        assert_eq!(of(&[650.0]).unwrap(), [[1.0; 3]]);
        for (wavelengths, words) in [
            (vec![], "found none"),
            (vec![500.0, 550.0, 600.0], "420 to 680"),
            (vec![400.0, 500.0, 700.0], "500 after 400"),
            (vec![0.4, 0.55, 0.7], "100 to 100000"),
        ] {
            let told = of(&wavelengths).unwrap_err().to_string();
            assert!(told.contains(words), "{told}");
        }
    }
}
