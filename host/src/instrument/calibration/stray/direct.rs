//! Direct light as a polynomial over both images: products of Legendre polynomials.

use crate::instrument::frame_format::place_of_pixel;

/// Largest degree over the camera's image, and how many terms those are.
const CAMERA_DEGREE: usize = 4;
pub(crate) const CAMERA_TERMS: usize = (CAMERA_DEGREE + 1) * (CAMERA_DEGREE + 2) / 2;
/// The same over the projector's image.
const PROJECTOR_DEGREE: usize = 4;
pub(crate) const PROJECTOR_TERMS: usize = (PROJECTOR_DEGREE + 1) * (PROJECTOR_DEGREE + 2) / 2;

/// The terms at the centre of this pixel (row-major) of a camera's image of this size.
pub(crate) fn camera_terms(pixel: usize, width_px: usize, height_px: usize) -> [f64; CAMERA_TERMS] {
    let [x, y] = place_of_pixel(pixel, width_px, height_px);
    terms::<CAMERA_DEGREE, CAMERA_TERMS>(x, y)
}

/// Sums of the terms over the pixels `lit` (row-major indices) of a projector's image of this size. The first is their number.
pub(crate) fn lit_terms(lit: &[u32], width_px: usize, height_px: usize) -> [f64; PROJECTOR_TERMS] {
    let mut sum = [0.0; PROJECTOR_TERMS];
    for &pixel in lit {
        let [x, y] = place_of_pixel(pixel as usize, width_px, height_px);
        let terms = terms::<PROJECTOR_DEGREE, PROJECTOR_TERMS>(x, y);
        for (sum, term) in sum.iter_mut().zip(terms) {
            *sum += term;
        }
    }
    sum
}

/// P_i(x)·P_j(y) for i + j up to `DEGREE`, in the order of i + j.
fn terms<const DEGREE: usize, const TERMS: usize>(x: f64, y: f64) -> [f64; TERMS] {
    let mut terms = [0.0; TERMS];
    let mut at = 0;
    for degree in 0..=DEGREE {
        for i in 0..=degree {
            terms[at] = legendre(i, x) * legendre(degree - i, y);
            at += 1;
        }
    }
    terms
}

/// P_n(x) for n up to 4.
fn legendre(n: usize, x: f64) -> f64 {
    let square = x * x;
    match n {
        0 => 1.0,
        1 => x,
        2 => 1.5 * square - 0.5,
        3 => (2.5 * square - 1.5) * x,
        _ => (4.375 * square - 3.75) * square + 0.375,
    }
}
