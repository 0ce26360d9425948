//! The test pictures of the sampling study and the judgement of a reconstruction by them.
//!
//! # Design
//! A sphere of 160 × 160 pixels, seen from +z, under 19 × 10 distant lights: θ from 0 to 90° in steps of 5°, ten
//! azimuths from 0° in steps of 36°. The ten lights at θ = 0 are one and the same and are rendered once. A picture is
//! f·cosθi · exposure, clipped to 0–1, linear (not gamma coded). PSNR is that of the whole picture with its black
//! surroundings, for a peak of 1, and of the lights the worst counts, per channel Y, Cb, Cr (ITU-R BT.601). A pixel whose
//! direction has no value, in the truth or in the reconstruction, is not scored, and the share of those that are is told.
//! Pictures that are black, or clipped, everywhere have no PSNR however well they agree: they show nothing of the sample.

use glam::DVec3;
use rayon::prelude::*;
use serde::Serialize;

use crate::brdf::reflectance::Reflectance;
use crate::brdf::reflectance::Value;
use crate::judge::render::LitSphere;
use crate::store::StoreError;

/// Pixels a side of the pictures.
pub const SPHERE_PX: usize = 160;
/// Polar angles of the lights.
pub const LIGHT_THETAS: usize = 19;
/// Azimuths of the lights.
pub const LIGHT_PHIS: usize = 10;

/// Peak signal-to-noise ratio in dB per channel, the smallest over the lights.
///
/// `None` where there is none: all pictures are exact (`exact` says so of Y), or they show nothing by which to judge.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Psnr {
    /// Luma.
    pub psnr_y_db: Option<f64>,
    /// Blue difference.
    pub psnr_cb_db: Option<f64>,
    /// Red difference.
    pub psnr_cr_db: Option<f64>,
    /// Whether Y agrees to the last bit in all pictures, and shows something.
    pub exact: bool,
    /// Share of the lit pixels of all pictures that are scored: they have a value in truth and reconstruction.
    pub scored_share: f64,
}

/// The true pictures.
#[derive(Clone, Debug)]
pub struct Spheres {
    exposure: f32,
    lit: Vec<LitSphere>,
    /// Directions of all lit pixels, sphere after sphere.
    pairs: Vec<(DVec3, DVec3)>,
    /// Y, Cb, Cr of the true pictures at those pixels; `None` where the truth has no value.
    truth: Vec<Option<[f32; 3]>>,
    /// Whether the pictures show anything: some pixel is neither black nor clipped.
    shown: bool,
}

impl Spheres {
    /// Renders the true pictures of `material`.
    ///
    /// # Errors
    /// [`StoreError`] if it cannot be read.
    pub fn new(material: &dyn Reflectance, exposure: f32) -> Result<Self, StoreError> {
        let lights: Vec<(f64, f64)> = (0..LIGHT_THETAS)
            .flat_map(|theta| (0..if theta == 0 { 1 } else { LIGHT_PHIS }).map(move |phi| (theta, phi)))
            .map(|(theta, phi)| {
                let theta_deg = 90.0 * theta as f64 / (LIGHT_THETAS - 1) as f64;
                (theta_deg, 360.0 * phi as f64 / LIGHT_PHIS as f64)
            })
            .collect();
        let lit: Vec<LitSphere> = lights
            .into_par_iter()
            .map(|light| LitSphere::new(SPHERE_PX, light))
            .collect();
        let pairs: Vec<_> = lit
            .iter()
            .flat_map(|sphere| sphere.pairs.iter().copied())
            .collect();
        let values = material.values(&pairs)?;
        let mut spheres = Self {
            exposure,
            lit,
            pairs,
            truth: Vec::new(),
            shown: false,
        };
        spheres.truth = spheres.pictures(&values);
        let mut luma = spheres.truth.iter().flatten().map(|ycbcr| ycbcr[0]);
        spheres.shown = luma.any(|y| y > 0.0 && y < 1.0);
        Ok(spheres)
    }

    /// Whether the pictures show anything: some pixel is neither black nor clipped.
    #[must_use]
    pub const fn show_something(&self) -> bool {
        self.shown
    }

    /// How well `reconstruction` reproduces the pictures. What it has no value for is not scored.
    ///
    /// # Errors
    /// [`StoreError`] if it cannot be read.
    pub fn judge(&self, reconstruction: &dyn Reflectance) -> Result<Psnr, StoreError> {
        let pictures = self.pictures(&reconstruction.values(&self.pairs)?);
        // Of the spheres with a scored pixel.
        let mut worst: Option<[f64; 3]> = None;
        let (mut first, mut scored) = (0, 0_usize);
        for sphere in &self.lit {
            let range = first..first + sphere.pairs.len();
            first = range.end;
            let (mut sum, mut count) = ([0.0; 3], 0);
            for pair in pictures[range.clone()].iter().zip(&self.truth[range.clone()]) {
                let (Some(found), Some(truth)) = pair else {
                    continue;
                };
                sum = std::array::from_fn(|c| sum[c] + f64::from(found[c] - truth[c]).powi(2));
                count += 1;
            }
            if count == 0 {
                continue;
            }
            scored += count;
            // The surroundings are black in both and count; what has no value does not.
            let pixels = (SPHERE_PX * SPHERE_PX - (range.len() - count)) as f64;
            let before = worst.unwrap_or([0.0; 3]);
            worst = Some(std::array::from_fn(|c| before[c].max(sum[c] / pixels)));
        }
        let square = |channel: usize| worst.filter(|_| self.shown).map(|worst| worst[channel]);
        let db = |channel: usize| {
            square(channel)
                .filter(|square| *square > 0.0)
                .map(|square| -10.0 * square.log10())
        };
        Ok(Psnr {
            psnr_y_db: db(0),
            psnr_cb_db: db(1),
            psnr_cr_db: db(2),
            exact: square(0) == Some(0.0),
            scored_share: if self.pairs.is_empty() {
                0.0
            } else {
                scored as f64 / self.pairs.len() as f64
            },
        })
    }

    fn pictures(&self, values: &[Value]) -> Vec<Option<[f32; 3]>> {
        let picture = |(value, (wi, _)): (&Value, &(DVec3, DVec3))| {
            let f = value.ok().filter(|f| f.iter().all(|f| f.is_finite()))?;
            let [r, g, b] = f.map(|f| (f * wi.z as f32 * self.exposure).clamp(0.0, 1.0));
            Some(ycbcr(r, g, b))
        };
        values.par_iter().zip(&self.pairs).map(picture).collect()
    }
}

/// Y, Cb, Cr of ITU-R BT.601 for R, G, B in 0–1; Cb and Cr in ±0.5. Grey has none of them, to the bit.
fn ycbcr(r: f32, g: f32, b: f32) -> [f32; 3] {
    let y = g + 0.299 * (r - g) + 0.114 * (b - g);
    [y, (b - y) / 1.772, (r - y) / 1.402]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::brdf::sample::parse;

    /// Truth plus a constant, in one channel.
    struct Off<'a>(&'a dyn Reflectance, [f32; 3]);

    impl Reflectance for Off<'_> {
        fn values(&self, pairs: &[(DVec3, DVec3)]) -> Result<Vec<Value>, StoreError> {
            let values = self.0.values(pairs)?;
            let off = |(value, (wi, _)): (Value, &(DVec3, DVec3))| {
                value.map(|f| std::array::from_fn(|c| f[c] + self.1[c] / wi.z as f32))
            };
            Ok(values.into_iter().zip(pairs).map(off).collect())
        }
    }

    #[test]
    fn colours_are_those_of_the_standard() {
        let close = |found: [f32; 3], expected: [f32; 3]| {
            assert!(
                found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-6),
                "{found:?} {expected:?}"
            );
        };
        close(ycbcr(1.0, 0.0, 0.0), [0.299, -0.168_736, 0.5]);
        close(ycbcr(0.0, 1.0, 0.0), [0.587, -0.331_264, -0.418_688]);
        close(ycbcr(0.0, 0.0, 1.0), [0.114, 0.5, -0.081_312]);
        assert_eq!(ycbcr(0.3, 0.3, 0.3)[1..], [0.0, 0.0]);
    }

    #[test]
    fn a_known_error_has_the_psnr_that_it_must_have() {
        let lambert = parse("lambert:0.5").unwrap();
        let spheres = Spheres::new(&lambert, 1.0).unwrap();
        let exact = spheres.judge(&lambert).unwrap();
        assert_eq!(
            exact,
            Psnr {
                psnr_y_db: None,
                psnr_cb_db: None,
                psnr_cr_db: None,
                exact: true,
                scored_share: 1.0,
            }
        );
        // 0.01 too bright wherever light falls: the light from behind the camera lights the whole disk, π/4·0.96² of
        // the picture.
        let off = spheres.judge(&Off(&lambert, [0.01; 3])).unwrap();
        let share = std::f64::consts::FRAC_PI_4 * 0.96 * 0.96;
        let expected = -10.0 * (share * 1e-4).log10();
        assert!(
            (off.psnr_y_db.unwrap() - expected).abs() < 0.01,
            "{off:?} {expected}"
        );
        assert!(off.psnr_cb_db.is_none_or(|db| db > 150.0), "{off:?}");
        // In blue alone: Y has 0.114 of it, Cb 0.5.
        let blue = spheres.judge(&Off(&lambert, [0.0, 0.0, 0.01])).unwrap();
        assert!(
            (blue.psnr_y_db.unwrap() - expected + 20.0 * 0.114_f64.log10()).abs() < 0.01,
            "{blue:?}"
        );
        assert!(
            (blue.psnr_cb_db.unwrap() - expected + 20.0 * 0.5_f64.log10()).abs() < 0.01,
            "{blue:?}"
        );
    }

    /// Lambert without values for x > 0.
    struct Half;

    impl Reflectance for Half {
        fn values(&self, pairs: &[(DVec3, DVec3)]) -> Result<Vec<Value>, StoreError> {
            let hidden = Err(crate::brdf::reflectance::Missing::Saturated);
            Ok(pairs
                .iter()
                .map(|pair| if pair.1.x > 0.0 { hidden } else { Ok([0.2; 3]) })
                .collect())
        }
    }

    /// Nothing at all.
    struct Nothing;

    impl Reflectance for Nothing {
        fn values(&self, pairs: &[(DVec3, DVec3)]) -> Result<Vec<Value>, StoreError> {
            Ok(vec![
                Err(crate::brdf::reflectance::Missing::Saturated);
                pairs.len()
            ])
        }
    }

    #[test]
    fn what_has_no_value_or_shows_nothing_is_not_scored() {
        let lambert = parse("lambert:0.5").unwrap();
        let spheres = Spheres::new(&lambert, 1.0).unwrap();
        let none = Psnr {
            psnr_y_db: None,
            psnr_cb_db: None,
            psnr_cr_db: None,
            exact: false,
            scored_share: 0.0,
        };
        assert_eq!(spheres.judge(&Nothing).unwrap(), none);
        assert_eq!(
            Spheres::new(&Nothing, 1.0).unwrap().judge(&lambert).unwrap(),
            none
        );
        // 0.2 instead of 0.5/π, where there is a value: half of it has none, on either side.
        let half = spheres.judge(&Half).unwrap();
        let other_way = Spheres::new(&Half, 1.0).unwrap().judge(&lambert).unwrap();
        assert!((0.3..0.7).contains(&half.scored_share), "{half:?}");
        assert!((half.psnr_y_db.unwrap() - other_way.psnr_y_db.unwrap()).abs() < 1e-3);
        // Black, and clipped everywhere: nothing is shown.
        for (sample, exposure) in [("lambert:0", 1.0), ("lambert:1", 1e9)] {
            let sample = parse(sample).unwrap();
            let spheres = Spheres::new(&sample, exposure).unwrap();
            let found = spheres.judge(&Off(&sample, [1.0; 3])).unwrap();
            assert!(found.psnr_y_db.is_none() && !found.exact, "{found:?}");
            assert!(!spheres.show_something());
        }
    }
}
