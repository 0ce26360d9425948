//! What the pixels of the camera's sensor differ by.
//!
//! # Design
//! Response, offset and hot pixels belong to the sensor's own pixels: the seed of the sensor draws them row by row, each row
//! from a chance of its own, and a pixel of the image gets what those behind it come to, by area. So the same sensor seen at
//! two sizes of the image is the same. All of it is computed once; a frame then costs one multiplication and one addition
//! per number. The channels of a pixel differ like pixels.
//!
//! A hot pixel adds its dark current, and so its shot noise, as long as that alone leaves it below its full well; above that
//! the camera shows its neighbours in its place, as the defect correction of cameras does.
//!
//! Row noise is drawn for each of the sensor's rows and each frame, and is the same for all channels. The offset of all pixels wanders
//! over the hours.
//!
//! # Tradeoffs
//! The light of a hot pixel that light and dark current together fill is not cut off.

use rand::{RngExt as _, SeedableRng as _};
use rand_distr::StandardNormal;
use rand_xoshiro::Xoshiro256PlusPlus;
use rayon::prelude::*;

use super::flaws::{HOT_E_PER_S, Pixels, log_uniform};
use super::sensor::Noise;
use crate::instrument::rig::Rig;

/// What tells the chances of a sensor from each other.
const RESPONSE: u64 = 1;
const OFFSET: u64 = 2;
const HOT: u64 = 3;
const ROW: u64 = 4;

/// A pixel of the sensor, or a row or column of them: the pixel of the image it lies in, the share of it that does, and the
/// share that lies in the next one.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Place {
    of: usize,
    here: f32,
    next: f32,
}

/// Where the sensor's pixels are along an axis of an image.
#[derive(Debug)]
struct Axis {
    places: Vec<Place>,
    /// Pixels of the sensor along one of the image.
    per_pixel: f64,
}

impl Axis {
    /// For an image of `size_px` pixels, each of so many of the sensor along the axis.
    fn new(size_px: usize, per_pixel: f64) -> Self {
        // Whole, but for rounding.
        let native = (size_px as f64 * per_pixel).round().max(1.0) as usize;
        let per_pixel = native as f64 / size_px as f64;
        let place = |at: usize| {
            let of = (((at as f64 + 1e-9) / per_pixel) as usize).min(size_px - 1);
            let next = (at as f64 + 1.0 - (of + 1) as f64 * per_pixel).clamp(0.0, 1.0);
            // What rounding leaves is nothing.
            let next = if next < 1e-6 || of + 1 == size_px {
                0.0
            } else {
                next
            };
            Place {
                of,
                here: (1.0 - next) as f32,
                next: next as f32,
            }
        };
        Self {
            places: (0..native).map(place).collect(),
            per_pixel,
        }
    }

    /// The sensor's pixels in the pixel `of` of the image, with the share of each that is.
    fn within(&self, of: usize) -> impl Iterator<Item = (usize, f32)> + '_ {
        let first = (of as f64 * self.per_pixel + 1e-9) as usize;
        let places = self.places.iter().enumerate().skip(first);
        places
            .take_while(move |(_, place)| place.of <= of)
            .map(move |(at, place)| (at, if place.of == of { place.here } else { place.next }))
    }
}

/// A hot pixel in a number of the image.
#[derive(Clone, Copy, Debug)]
struct Hot {
    value: usize,
    /// Share of it that lies in the image's pixel.
    share: f32,
    e_per_s: f32,
}

/// What the pixels of an image differ by.
#[derive(Debug)]
pub(super) struct PixelMaps {
    /// Of each number of a frame, what it shows of light over what a perfect pixel does; nothing if they are all alike.
    response: Vec<f32>,
    /// Of each number of a frame, electrons of all pixels behind it; nothing if there are none.
    offset_e: Vec<f32>,
    hot: Vec<Hot>,
    /// Full well of a pixel of the sensor.
    well_e: f64,
    rows: Axis,
    /// Numbers of a row of the image.
    row: usize,
    /// Electrons that a row of the image gets for one of row noise in each row behind it.
    row_e: f64,
    /// What of it wanders.
    flaws: Pixels,
    /// Pixels of the sensor behind one of the image.
    behind: f64,
}

impl PixelMaps {
    /// Of a camera as in `rig` with these `flaws`; `None` if its pixels are all alike.
    pub(super) fn of(flaws: &Pixels, rig: &Rig) -> Option<Self> {
        let Pixels {
            seed,
            prnu,
            dsnu_e,
            hot,
            row_noise_e,
            wander_e,
        } = *flaws;
        if [prnu, dsnu_e, hot, row_noise_e, wander_e]
            .iter()
            .all(|flaw| *flaw <= 0.0)
        {
            return None;
        }
        let (format, binned) = (rig.camera_format(), rig.camera.binned);
        let along = binned.pixels.sqrt();
        let sensor = Native {
            seed,
            rows: Axis::new(format.height_px, along),
            columns: Axis::new(format.width_px, along),
            channels: format.channels,
        };
        let map = |stream: u64, size: f64, middle: f64| {
            if size <= 0.0 {
                return Vec::new();
            }
            let map = sensor.means(stream);
            map.into_iter()
                .map(|mean| (middle + size * f64::from(mean)) as f32)
                .collect()
        };
        Some(Self {
            response: map(RESPONSE, prnu, 1.0),
            offset_e: map(OFFSET, dsnu_e * binned.pixels, 0.0),
            hot: sensor.hot(hot),
            well_e: rig.camera.full_well_e / binned.pixels,
            row: format.width_px * format.channels,
            flaws: flaws.clone(),
            behind: binned.pixels,
            row_e: row_noise_e * binned.pixels / sensor.rows.per_pixel,
            rows: sensor.rows,
        })
    }

    /// Makes of the electrons of light that perfect pixels collect in `exposure_s` seconds those of these, with the dark
    /// current of hot ones.
    pub(super) fn expose(&self, charge_e: &mut [f32], exposure_s: f64) {
        for (charge_e, response) in charge_e.iter_mut().zip(&self.response) {
            *charge_e *= response;
        }
        for hot in &self.hot {
            let dark_e = f64::from(hot.e_per_s) * exposure_s;
            if dark_e < self.well_e {
                charge_e[hot.value] += hot.share * dark_e as f32;
            }
        }
    }

    /// Electrons that each number of the frame of this `seed`, taken after so many hours, shows beside its charge.
    pub(super) fn offset_e(&self, noise: Noise, seed: u64, hours: f64) -> Vec<f32> {
        let is_noisy = noise == Noise::On && self.row_e > 0.0;
        if !is_noisy && self.flaws.wander_e <= 0.0 {
            return self.offset_e.clone();
        }
        let height = self.rows.places.last().map_or(0, |last| last.of + 1);
        let mut offset_e = self.offset_e.clone();
        offset_e.resize(height * self.row, 0.0);
        let wandered_e = (self.flaws.wandered_e(hours) * self.behind) as f32;
        let mut rng = chance(seed, ROW, 0);
        let mut rows = vec![0.0_f32; self.rows.places.len()];
        if is_noisy {
            for row in &mut rows {
                *row = rng.sample(StandardNormal);
            }
        }
        for (of, numbers) in offset_e.chunks_exact_mut(self.row).enumerate() {
            let sum: f32 = self.rows.within(of).map(|(row, share)| share * rows[row]).sum();
            let row_e = self.row_e as f32 * sum + wandered_e;
            for number in numbers {
                *number += row_e;
            }
        }
        offset_e
    }
}

/// The chance of row number `row` for what `stream` stands for, of the sensor or frame of this `seed`.
fn chance(seed: u64, stream: u64, row: usize) -> Xoshiro256PlusPlus {
    // The multiplier of SplitMix64: rows and streams that lie next to each other have nothing in common.
    let at = (stream << 32) | row as u64;
    Xoshiro256PlusPlus::seed_from_u64(seed ^ at.wrapping_mul(0x9e37_79b9_7f4a_7c15))
}

/// The pixels of the sensor.
struct Native {
    seed: u64,
    rows: Axis,
    columns: Axis,
    channels: usize,
}

impl Native {
    /// Of each number of the image, the mean over the sensor's pixels behind it of a normal number that each of them has.
    fn means(&self, stream: u64) -> Vec<f32> {
        let (width, height) = [&self.columns, &self.rows]
            .map(|axis| axis.places.last().map_or(0, |last| last.of + 1))
            .into();
        let channels = self.channels;
        let pixels = (self.rows.per_pixel * self.columns.per_pixel) as f32;
        let mut means = vec![0.0_f32; width * height * channels];
        means
            .par_chunks_exact_mut((width * channels).max(1))
            .enumerate()
            .for_each(|(of, means)| {
                for (row, share) in self.rows.within(of) {
                    let mut rng = chance(self.seed, stream, row);
                    for place in &self.columns.places {
                        let at = place.of * channels;
                        for channel in at..at + channels {
                            let normal: f32 = rng.sample(StandardNormal);
                            let part = share * normal;
                            means[channel] += place.here * part;
                            if place.next > 0.0 {
                                means[channel + channels] += place.next * part;
                            }
                        }
                    }
                }
                for mean in means {
                    *mean /= pixels;
                }
            });
        means
    }

    /// The hot pixels, of which the sensor has this `share`.
    fn hot(&self, share: f64) -> Vec<Hot> {
        let mut hot = Vec::new();
        if share <= 0.0 {
            return hot;
        }
        let channels = self.channels;
        let width = self.columns.places.last().map_or(0, |last| last.of + 1);
        for (row, place_y) in self.rows.places.iter().enumerate() {
            let mut rng = chance(self.seed, HOT, row);
            let mut at = 0_usize;
            loop {
                // How many there are up to the next hot one: of a geometric distribution.
                let skipped = rng.random_range(f64::MIN_POSITIVE..1.0).ln() / (-share).ln_1p();
                at = at.saturating_add(skipped as usize);
                let Some(place_x) = self.columns.places.get(at / channels) else {
                    break;
                };
                let e_per_s = log_uniform(HOT_E_PER_S, &mut rng) as f32;
                let ends = [(0, place_y.here), (1, place_y.next)];
                for (dy, share_y) in ends.into_iter().filter(|(_, share)| *share > 0.0) {
                    let ends = [(0, place_x.here), (1, place_x.next)];
                    for (dx, share_x) in ends.into_iter().filter(|(_, share)| *share > 0.0) {
                        let pixel = (place_y.of + dy) * width + place_x.of + dx;
                        hot.push(Hot {
                            value: pixel * channels + at % channels,
                            share: share_x * share_y,
                            e_per_s,
                        });
                    }
                }
                at += 1;
            }
        }
        hot
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FLAWS: Pixels = Pixels {
        seed: 5,
        prnu: 0.01,
        dsnu_e: 2.0,
        hot: 1e-3,
        row_noise_e: 0.7,
        wander_e: 0.0,
    };

    fn maps(size_px: u32) -> (PixelMaps, f64) {
        let rig = Rig::load("dmd").unwrap().with_image_size(size_px).unwrap();
        (PixelMaps::of(&FLAWS, &rig).unwrap(), rig.camera.binned.pixels)
    }

    fn deviation(values: impl Iterator<Item = f64> + Clone) -> f64 {
        let count = values.clone().count() as f64;
        let mean = values.clone().sum::<f64>() / count;
        (values.map(|value| (value - mean).powi(2)).sum::<f64>() / count).sqrt()
    }

    /// Sums over blocks of `side` × `side` of the `values` of an image `width` wide.
    fn blocks(values: &[f32], width: usize, side: usize) -> Vec<f64> {
        let (across, height) = (width / side, values.len() / width);
        let mut sums = vec![0.0; across * (height / side)];
        for (at, value) in values.iter().enumerate() {
            sums[at / width / side * across + at % width / side] += f64::from(*value);
        }
        sums
    }

    #[test]
    fn the_same_sensor_at_two_sizes_of_the_image_is_the_same() {
        let (fine, _) = maps(256);
        let light = |maps: &PixelMaps, size: usize, exposure_s: f64| {
            let mut charge_e = vec![1000.0 * (512.0 / size as f32).powi(2); size * size];
            maps.expose(&mut charge_e, exposure_s);
            charge_e
        };
        // Whole pixels of the finer image behind one of the coarser, and borders in the midst of the sensor's pixels.
        for (size, common) in [(128, 128), (64, 64), (192, 64)] {
            let (coarse, _) = maps(size as u32);
            let all = |maps: &PixelMaps, size: usize| {
                // Dark ones above the full well of one are left out: 20,000 e in 0.25 s.
                let charge = [0.05, 0.25].map(|time_s| light(maps, size, time_s));
                [
                    maps.offset_e(Noise::Off, 1, 0.0),
                    charge[0].clone(),
                    charge[1].clone(),
                ]
                .map(|values| blocks(&values, size, size / common))
            };
            for (one, other) in all(&coarse, size).iter().zip(all(&fine, 256)) {
                let scale = deviation(other.iter().copied());
                for (one, other) in one.iter().zip(other) {
                    assert!(
                        (one - other).abs() < 2e-3 * scale,
                        "{size}: {one} {other} {scale}"
                    );
                }
            }
        }
    }

    #[test]
    fn pixels_differ_by_as_much_as_is_said() {
        let (maps, pixels) = maps(256);
        let response = deviation(maps.response.iter().map(|of| f64::from(*of))) * pixels.sqrt();
        assert!((response / FLAWS.prnu - 1.0).abs() < 0.02, "{response}");
        let offset_e = deviation(maps.offset_e.iter().map(|of| f64::from(*of))) / pixels.sqrt();
        assert!((offset_e / FLAWS.dsnu_e - 1.0).abs() < 0.02, "{offset_e}");
        let share = maps.hot.iter().map(|hot| f64::from(hot.share)).sum::<f64>() / 512_f64.powi(2);
        assert!((share / FLAWS.hot - 1.0).abs() < 0.25, "{share}");
        assert!(maps.hot.iter().all(|hot| (1e2..=1.001e5).contains(&hot.e_per_s)));
        // The logarithm of the dark current is uniform: its median is in the middle.
        let above = maps.hot.iter().filter(|hot| hot.e_per_s > 3162.0).count() as f64;
        assert!((above / maps.hot.len() as f64 - 0.5).abs() < 0.15, "{above}");
    }

    #[test]
    fn a_row_of_the_image_has_the_mean_of_the_rows_behind_it_and_another_in_each_frame() {
        for size in [512, 128] {
            let (maps, pixels) = maps(size as u32);
            let mut squares = 0.0;
            for seed in 0..8 {
                let (with, without) = (maps.offset_e(Noise::On, seed, 0.0), &maps.offset_e);
                let rows: Vec<f64> = (0..size)
                    .map(|row| f64::from(with[row * size] - without[row * size]) / pixels)
                    .collect();
                let last = (0..size).map(|row| row * size + size - 1);
                for (at, row) in last.zip(&rows) {
                    let here = f64::from(with[at] - without[at]) / pixels;
                    assert!((here - row).abs() < 1e-4, "{here} {row}");
                }
                squares += deviation(rows.into_iter()).powi(2) / 8.0;
                assert_ne!(with, maps.offset_e(Noise::On, seed + 1, 0.0));
            }
            let found_e = squares.sqrt() * pixels.sqrt().sqrt();
            assert!(
                (found_e / FLAWS.row_noise_e - 1.0).abs() < 0.08,
                "{size}: {found_e}"
            );
        }
    }

    #[test]
    fn the_offset_of_all_pixels_wanders_as_far_as_is_said() {
        let flaws = Pixels {
            wander_e: 0.5,
            ..Pixels::default()
        };
        let rig = Rig::load("dmd").unwrap();
        let maps = PixelMaps::of(&flaws, &rig).unwrap();
        let at = |hours: f64| maps.offset_e(Noise::On, 1, hours);
        let first = at(0.3);
        assert!(
            first.len() >= 32
                && first
                    .iter()
                    .all(|offset_e| offset_e.to_bits() == first[0].to_bits())
        );
        let over_hours = deviation((0..10_000).map(|at| flaws.wandered_e(f64::from(at) * 0.01)));
        assert!((over_hours / 0.5 - 1.0).abs() < 0.02, "{over_hours}");
        let behind = rig.camera.binned.pixels;
        assert!((f64::from(first[0]) / behind - flaws.wandered_e(0.3)).abs() < 1e-4);
    }

    #[test]
    fn pixels_without_flaws_cost_nothing() {
        let rig = Rig::load("dmd").unwrap();
        assert!(PixelMaps::of(&Pixels::default(), &rig).is_none());
    }
}
