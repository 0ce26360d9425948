//! Frames of the standard: what of their light came other ways, and how bright the lamp was.

use glam::Vec4;
use rayon::prelude::*;

use super::rank_one::Seen;
use super::{Black, Linear};
use crate::brdf::sample::Sample;
use crate::calibrate::CalibrateError;
use crate::instrument::calibration::LampFound;
use crate::instrument::calibration::lamp::SLOW;
use crate::instrument::calibration::stray::{ByBand, Level, Levels, Removal, Room, Told, lanes};

/// A frame of the standard.
pub(super) struct Lit<'a> {
    pub(super) dn: &'a [u16],
    pub(super) channels: usize,
    /// What came other ways, linear digital numbers.
    pub(super) stray: Vec<f32>,
    /// What it tells of the lamp, if it does, and the lamp over that of the black frames.
    pub(super) told: ByBand<Option<Told>>,
    pub(super) lamp: Levels,
}

impl Lit<'_> {
    /// What the spot shows, had the lamp been as in the black frames, where the frame shows `all` and a black one `black`, linear
    /// numbers above the dark level at the place `at`.
    pub(super) fn spot(&self, all: f64, black: f64, at: usize) -> f64 {
        (all - f64::from(self.stray[at])) / f64::from(self.lamp.light[at % self.channels]) - black
    }
}

/// The frames of the standard at one stand.
pub(super) struct Frames<'a> {
    pub(super) linear: &'a Linear,
    /// Linear.
    pub(super) black: &'a [f64],
    /// One of each place.
    pub(super) lit: Vec<Lit<'a>>,
    pub(super) standard: &'a dyn Sample,
}

impl Seen<'_> {
    /// The `frames` of the directions from the place `first` on, with the stray light that `removal` finds in them and what they tell of
    /// the lamp; `black` is the black frame, linear.
    pub(super) fn lit<'b>(
        &self,
        first: usize,
        frames: &[&'b [u16]],
        linear: &Linear,
        black: &[f64],
        removal: &Removal,
    ) -> Vec<Lit<'b>> {
        let channels = self.channels;
        let saturation = linear.of(self.saturation_dn) as f32;
        let one = |room: &mut Room, (place, dn): (usize, &&'b [u16])| {
            let more = |at: usize| {
                let dn = f64::from(dn[at]);
                if linear.trusts(dn) {
                    linear.of(dn) - black[at]
                } else {
                    f64::NAN
                }
            };
            let shown: Vec<Vec4> = (0..dn.len() / channels)
                .map(|pixel| lanes(channels, |channel| more(pixel * channels + channel)))
                .collect();
            removal.find(
                &shown,
                &self.lit_terms[first + place],
                self.exposure_s,
                saturation,
                room,
            );
            let told = removal.told(
                |pixel| shown[pixel] - room.stray[pixel],
                |pixel| lanes(channels, |channel| black[pixel * channels + channel]),
                |pixel| room.doubt[pixel],
            );
            let stray = room.stray.iter().map(Vec4::to_array);
            Lit {
                dn,
                channels,
                stray: stray.flat_map(|lanes| lanes.into_iter().take(channels)).collect(),
                told,
                lamp: Levels::SAME,
            }
        };
        frames
            .par_iter()
            .enumerate()
            .map_init(Room::default, one)
            .collect()
    }

    /// Sets the lamp of all the `frames` of the stand by what they told of it together, as `removal` has it, beside so many black
    /// ones.
    pub(super) fn set_lamp(frames: &mut [Lit], removal: &Removal, black: usize) {
        let told: Vec<ByBand<Option<Told>>> = frames.iter().map(|frame| frame.told).collect();
        let bias = removal.bias(&told, black, SLOW);
        for frame in frames {
            frame.lamp = removal.level(frame.told, bias);
        }
    }

    /// Compares the lamp in the `black` frames of the stand with what watches it in the calibration.
    ///
    /// # Errors
    /// [`CalibrateError::Views`] if another lamp must have been in it.
    pub(super) fn compare_lamp(&mut self, removal: &Removal, black: &Black) -> Result<(), CalibrateError> {
        let image = |of: &dyn Fn(usize) -> f64| -> Vec<Vec4> {
            (0..black.light.len() / self.channels)
                .map(|pixel| lanes(self.channels, |channel| of(pixel * self.channels + channel)))
                .collect()
        };
        let watching = image(&|at| black.light[at] - black.unwatched[at]);
        let others = image(&|at| black.unwatched[at]);
        let told = removal.level_of_watching(&watching, &others, black.counts, self.exposure_s);
        let Some(level) = told else {
            self.lamp = [1.0, LampFound::BETWEEN_VIEWS];
            return Ok(());
        };
        if level.is_same_lamp() {
            let known = level.beside(LampFound::BETWEEN_VIEWS);
            self.lamp = [known.light, known.uncertainty].map(f64::from);
            return Ok(());
        }
        Err(CalibrateError::Views {
            expected: format!(
                "a lamp within {} % of itself in all views",
                100.0 * Level::LARGEST_CHANGE
            ),
            found: format!("{:.1} ± {:.1} %", 100.0 * level.light, 100.0 * level.uncertainty),
            advice: "let the lamp warm up, and take all views anew",
        })
    }
}
