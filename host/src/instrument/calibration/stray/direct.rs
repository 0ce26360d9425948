//! Direct light as a polynomial over both images: products of Legendre polynomials.

use glam::Vec4;

use crate::instrument::calibration::field::{legendre, products};
use crate::instrument::frame_format::place_of_pixel;

/// Largest degree over the camera's image, and how many terms those are.
const CAMERA_DEGREE: usize = 8;
pub(crate) const CAMERA_TERMS: usize = (CAMERA_DEGREE + 1) * (CAMERA_DEGREE + 2) / 2;
/// The same over the projector's image.
const PROJECTOR_DEGREE: usize = 5;
pub(crate) const PROJECTOR_TERMS: usize = (PROJECTOR_DEGREE + 1) * (PROJECTOR_DEGREE + 2) / 2;

/// The terms at the centre of this pixel (row-major) of a camera's image of this size.
pub(crate) fn camera_terms(pixel: usize, width_px: usize, height_px: usize) -> [f64; CAMERA_TERMS] {
    let [x, y] = place_of_pixel(pixel, width_px, height_px);
    products::<{ CAMERA_DEGREE + 1 }, CAMERA_TERMS>(x, y)
}

/// Sums of the terms over the pixels `lit` (row-major indices) of a projector's image of this size. The first is their number.
pub(crate) fn lit_terms(lit: &[u32], width_px: usize, height_px: usize) -> [f64; PROJECTOR_TERMS] {
    let mut sum = [0.0; PROJECTOR_TERMS];
    for &pixel in lit {
        let [x, y] = place_of_pixel(pixel as usize, width_px, height_px);
        let terms = products::<{ PROJECTOR_DEGREE + 1 }, PROJECTOR_TERMS>(x, y);
        for (sum, term) in sum.iter_mut().zip(terms) {
            *sum += term;
        }
    }
    sum
}

/// Images of the polynomial over the camera's, of one size. Row by row it is a polynomial along x alone.
#[derive(Debug)]
pub(super) struct DirectImage {
    /// P_i of each column and of each row.
    columns: Vec<[f32; CAMERA_DEGREE + 1]>,
    rows: Vec<[f32; CAMERA_DEGREE + 1]>,
}

impl DirectImage {
    pub(super) fn new(width_px: usize, height_px: usize) -> Self {
        let single = |x: f64| legendre::<{ CAMERA_DEGREE + 1 }>(x).map(|p| p as f32);
        let place = |pixel| place_of_pixel(pixel, width_px, height_px);
        Self {
            columns: (0..width_px).map(|column| single(place(column)[0])).collect(),
            rows: (0..height_px)
                .map(|row| single(place(row * width_px)[1]))
                .collect(),
        }
    }

    /// The light of each pixel, row by row, by the coefficients of its terms.
    pub(super) fn of<'a>(
        &'a self,
        coefficients: &'a [Vec4; CAMERA_TERMS],
    ) -> impl Iterator<Item = Vec4> + 'a {
        self.rows.iter().flat_map(move |row| {
            let mut along = [Vec4::ZERO; CAMERA_DEGREE + 1];
            let mut rest = coefficients.iter();
            for degree in 0..=CAMERA_DEGREE {
                for (i, coefficient) in rest.by_ref().take(degree + 1).enumerate() {
                    along[i] += *coefficient * row[degree - i];
                }
            }
            self.columns.iter().map(move |column| {
                let terms = along.iter().zip(column);
                terms.fold(Vec4::ZERO, |sum, (coefficient, term)| sum + *coefficient * *term)
            })
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_image_row_by_row_is_the_sum_of_its_terms() {
        let (width, height) = (7, 5);
        let coefficients: [Vec4; CAMERA_TERMS] =
            std::array::from_fn(|term| Vec4::new(1.0, term as f32, (term % 3) as f32, -1.0));
        let image: Vec<Vec4> = DirectImage::new(width, height).of(&coefficients).collect();
        assert_eq!(image.len(), width * height);
        for (pixel, found) in image.into_iter().enumerate() {
            let terms = camera_terms(pixel, width, height);
            let sum = coefficients
                .iter()
                .zip(terms)
                .fold(Vec4::ZERO, |sum, (c, term)| sum + *c * term as f32);
            assert!((found - sum).abs().max_element() < 1e-3, "{pixel}: {found} {sum}");
        }
    }
}
