//! How bright the lamp was in a frame, told by pixels that are dark by construction.
//!
//! # Design
//! A frame shows L·(B + S): the light B of a black pattern and S of what else is lit, both with the lamp as in the black frames,
//! which is L = 1. In dark pixels B is direct light, most of it of the projector pixels that watch the lamp
//! ([`crate::instrument::monitor`]), and S is stray light, which is known. So L − 1 = Σ w·(frame − black − stray)/Σ w·B with
//! weights w that have no noise in common with it: the light that calibration found there.
//!
//! Beside the calibration only that counts which black frames show more than others without what watches the lamp: no offset of the
//! camera passes for the lamp's light. The lamp flickers from the ones to the others, though, and light of black pixels with it: as
//! all light that differs as the sample looks, where what watches the lamp shines smoothly.
//!
//! What noise leaves uncertain, and wrong shapes of stray light, a jackknife over groups of neighbours tells; what is
//! uncertain in stray light itself all pixels share, and all frames (`bias`). Where dark pixels tell less than is known of lamps
//! anyway, L is near 1.
//!
//! Where the bands of an image are lit one after the other, each has a lamp of its own, and its dark pixels tell that alone.

use glam::Vec4;

use super::bias::{Bias, Told};
use super::{GROUPS, Removal, camera_terms, hypot, lanes};
use crate::base::linear_fit::least_squares;
use crate::instrument::bands::PRIMARIES;
use crate::instrument::calibration::lamp::{Monitor, watch_terms};

/// Pixels that tell how the lamp flickered, about.
const MOST_PIXELS: usize = 10_000;
/// Terms by which what watches it may look otherwise then: up to degree 4.
const SHAPE_TERMS: usize = 15;

/// Light of the lamp in a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Level {
    /// Over that of what it is compared with.
    pub(crate) light: f32,
    /// Its standard uncertainty (k = 1), which all pixels of the frame share …
    pub(crate) uncertainty: f32,
    /// … and the part of it that all frames do.
    pub(crate) common: f32,
}

impl Level {
    /// No lamp drifts farther from what it was in the calibration, relative: above that it is another, which lights otherwise …
    pub(crate) const LARGEST_CHANGE: f32 = 0.1;
    /// … if that is clear, standard uncertainties.
    const CLEAR: f32 = 3.0;

    /// Whether it is not certain to be that of another lamp.
    pub(crate) fn is_same_lamp(self) -> bool {
        (self.light - 1.0).abs() <= Self::LARGEST_CHANGE + Self::CLEAR * self.uncertainty
    }

    /// The one of `all` that tells it best; `None` if there are none.
    pub(crate) fn best(all: impl IntoIterator<Item = Self>) -> Option<Self> {
        let least = |a: &Self, b: &Self| a.uncertainty.total_cmp(&b.uncertainty);
        all.into_iter().min_by(least)
    }

    /// So much light, of which all frames share what is uncertain.
    pub(crate) const fn of_all(light: f32, uncertainty: f32) -> Self {
        Self {
            light,
            uncertainty,
            common: uncertainty,
        }
    }

    /// What is known of a lamp that was told like this and is known to be as what it is compared with to `prior`, relative (k = 1), anyway: a
    /// camera of coarse steps tells less than that.
    pub(crate) fn beside(self, prior: f64) -> Self {
        let trust = (prior * prior / (prior * prior + f64::from(self.uncertainty).powi(2))) as f32;
        Self {
            light: 1.0 + trust * (self.light - 1.0),
            uncertainty: trust.sqrt() * self.uncertainty,
            common: trust.sqrt() * self.common,
        }
    }
}

/// Something of each band of an image; the same of all that are lit at once.
pub(crate) type ByBand<T> = [T; PRIMARIES];

/// Levels of an image, those of its bands in the lanes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Levels {
    /// As in [`Level`].
    pub(crate) light: Vec4,
    pub(crate) uncertainty: Vec4,
    pub(crate) common: Vec4,
}

impl Levels {
    /// As in the black frames, for certain.
    pub(crate) const SAME: Self = Self {
        light: Vec4::ONE,
        uncertainty: Vec4::ZERO,
        common: Vec4::ZERO,
    };

    fn of(bands: ByBand<Level>) -> Self {
        let lanes = |of: fn(&Level) -> f32| {
            let [red, green, blue] = bands.each_ref().map(of);
            // Nothing is in the last lane.
            Vec4::new(red, green, blue, red)
        };
        Self {
            light: lanes(|level| level.light),
            uncertainty: lanes(|level| level.uncertainty),
            common: lanes(|level| level.common),
        }
    }

    /// What a frame shows `more` than a black one, of light `black`, had the lamp been the same.
    pub(crate) fn steady(self, more: Vec4, black: Vec4) -> Vec4 {
        (more - black * (self.light - 1.0)) / self.light
    }

    /// Part of the uncertainty that all frames share, the most of all bands.
    pub(crate) fn share(self) -> f32 {
        (self.common / self.uncertainty.max(Vec4::splat(f32::MIN_POSITIVE))).max_element()
    }
}

/// What watches the lamp, for images of one size.
#[derive(Debug)]
pub(super) struct Watch {
    /// Light of the watching pixels in each pixel, digital numbers per second.
    light: Vec<Vec4>,
    /// Its relative standard uncertainty in dark pixels.
    uncertainty: f32,
}

impl Watch {
    /// As `monitor`, with squares of `side` pixels, for images of this size.
    pub(super) fn new(monitor: &Monitor, side: u32, (width_px, height_px): (usize, usize)) -> Self {
        let at = |pixel| {
            let terms = watch_terms(pixel, width_px, height_px);
            let light: Vec<f64> = monitor.light_at(&terms, side).collect();
            lanes(light.len(), |channel| light[channel])
        };
        Self {
            light: (0..width_px * height_px).map(at).collect(),
            uncertainty: monitor.uncertainty_of(side) as f32,
        }
    }

    /// How much each of the dark `pixels` counts: as much as it shines by what watches the lamp, all alike if nothing does.
    pub(super) fn weights(watch: Option<&Self>, pixels: &[u32], channels: usize) -> Vec<Vec4> {
        let weight = |pixel: &u32| match watch {
            Some(watch) => watch.light[*pixel as usize],
            None => lanes(channels, |_| 1.0),
        };
        pixels.iter().map(weight).collect()
    }
}

/// Sums over a group of dark pixels.
#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    /// Of weight × what is more than in the black frame, × black light, × uncertainty of stray light.
    more: f32,
    black: f32,
    doubt: f32,
    /// Of the weights.
    weight: f32,
}

impl Removal {
    /// The lamp in a frame that `told` so much of it (nothing if `None`), where all frames are off by the `bias`.
    pub(crate) fn level(&self, told: ByBand<Option<Told>>, bias: ByBand<Bias>) -> Levels {
        Levels::of(std::array::from_fn(|band| {
            bias[band].level(told[band], self.prior_variance)
        }))
    }

    /// What frames that `told` of the lamp beside `black` others, from which it changes `slowly` by so much, relative, are off by alike.
    pub(crate) fn bias(&self, told: &[ByBand<Option<Told>>], black: usize, slowly: f64) -> ByBand<Bias> {
        self.by_band(|band| {
            let of_band: Vec<Told> = told.iter().filter_map(|told| told[band]).collect();
            Bias::of(&of_band, black, self.flicker.into(), slowly)
        })
    }

    /// What `of` makes of each band that is lit by itself, or of the first for all.
    fn by_band<T: Copy>(&self, of: impl Fn(usize) -> T) -> ByBand<T> {
        if self.bands > 1 {
            std::array::from_fn(of)
        } else {
            [of(0); PRIMARIES]
        }
    }

    /// The lamp in black frames beside that of the calibration; `watching` is what they show in `exposure_s` seconds more than those
    /// in which nothing watches it, and `others` what these show above the dark level, digital numbers, NaN where saturated, both
    /// means of so many frames. `None` if nothing watches it.
    pub(crate) fn level_of_watching(
        &self,
        watching: &[Vec4],
        others: &[Vec4],
        counts: [usize; 2],
        exposure_s: f64,
    ) -> Option<Level> {
        let watch = self.watch.as_ref()?;
        let own = |pixel: usize| watch.light[pixel] * exposure_s as f32;
        let [brighter, doubt] = self.brighter(watch, watching, others, counts);
        let told = self.told_in(
            Vec4::ONE,
            |pixel| watching[pixel] - others[pixel] * brighter - own(pixel),
            own,
            |pixel| hypot(others[pixel].abs() * doubt, Vec4::splat(self.steps_dn)),
        );
        // All bands together tell it; where each had a lamp of its own, that of one is another than what the brightest tell by no more.
        let own = if self.bands > 1 {
            2.0 * self.flicker.powi(2) / counts[0].max(1) as f32
        } else {
            0.0
        };
        told.map(|told| Level::of_all(1.0 + told.brighter, (told.variance() + own).sqrt()))
    }

    /// By how much the lamp was brighter where something watched it than in the `others`, relative, and the standard uncertainty of
    /// that: `watching` = (what watches) × (a polynomial over the image) + brighter × `others`; by a jackknife, and not far more than it
    /// flickers.
    fn brighter(&self, watch: &Watch, watching: &[Vec4], others: &[Vec4], counts: [usize; 2]) -> [f32; 2] {
        let flicker = self.flicker
            * counts
                .map(|count| (count as f32).recip())
                .iter()
                .sum::<f32>()
                .sqrt();
        let (width, height) = self.size_px;
        let every = watching.len().div_ceil(MOST_PIXELS).max(1);
        let rows: Vec<(usize, Vec<f64>, f64)> = (0..watching.len())
            .step_by(every)
            .filter_map(|pixel| {
                let (target, light) = (watching[pixel].element_sum(), others[pixel].element_sum());
                let own = watch.light[pixel].element_sum();
                let terms = camera_terms(pixel, width, height);
                let smooth = terms
                    .into_iter()
                    .take(SHAPE_TERMS)
                    .map(|term| f64::from(own) * term);
                let row: Vec<f64> = smooth.chain([f64::from(light)]).collect();
                (target + light).is_finite().then_some((
                    pixel * GROUPS / watching.len(),
                    row,
                    f64::from(target),
                ))
            })
            .collect();
        let without = |group: usize| {
            let some = rows.iter().filter(|(of, ..)| *of != group);
            let some = some.map(|(_, row, target)| (row.clone(), *target, 1.0));
            least_squares(SHAPE_TERMS + 1, some).map(|(found, _)| found[SHAPE_TERMS])
        };
        let (Some(all), Some(groups)) = (
            without(GROUPS),
            (0..GROUPS).map(without).collect::<Option<Vec<f64>>>(),
        ) else {
            return [0.0, flicker];
        };
        let squares: f64 = groups.iter().map(|one| (one - all).powi(2)).sum();
        let variance = squares * (GROUPS - 1) as f64 / GROUPS as f64;
        let prior = f64::from(flicker).powi(2);
        let trust = prior / (prior + variance).max(f64::MIN_POSITIVE);
        [(trust * all) as f32, (trust * variance).sqrt() as f32]
    }

    /// Relative standard uncertainty of what [`level_of_watching`](Self::level_of_watching) compares with.
    pub(crate) fn level_uncertainty(&self) -> f32 {
        self.watch.as_ref().map_or(0.0, |watch| watch.uncertainty)
    }

    /// What dark pixels tell of the lamp in a frame: `more(pixel)` is what it shows more than black ones, less stray light,
    /// `black(pixel)` their light, `doubt(pixel)` the standard uncertainty of the stray light, all in digital numbers, NaN where
    /// saturated. `None` if no pixel tells.
    pub(crate) fn told(
        &self,
        more: impl Fn(usize) -> Vec4,
        black: impl Fn(usize) -> Vec4,
        doubt: impl Fn(usize) -> Vec4,
    ) -> ByBand<Option<Told>> {
        self.by_band(|band| {
            let lanes = if self.bands > 1 {
                Vec4::AXES[band]
            } else {
                Vec4::ONE
            };
            self.told_in(lanes, &more, &black, &doubt)
        })
    }

    /// As [`told`](Self::told), by what is in these `lanes`.
    fn told_in(
        &self,
        lanes: Vec4,
        more: impl Fn(usize) -> Vec4,
        black: impl Fn(usize) -> Vec4,
        doubt: impl Fn(usize) -> Vec4,
    ) -> Option<Told> {
        let mut groups = [Sums::default(); GROUPS];
        for (place, &pixel) in self.monitors.iter().enumerate() {
            let at = pixel as usize;
            let (more, weight) = (more(at), self.weights[place] * lanes);
            if more.is_nan() {
                continue;
            }
            let group = &mut groups[place * GROUPS / self.monitors.len()];
            group.more += (weight * more).element_sum();
            group.black += (weight * black(at)).element_sum();
            group.doubt += (weight * doubt(at)).element_sum();
            group.weight += weight.element_sum();
        }
        let sum = |of: &dyn Fn(&Sums) -> f32| groups.iter().map(of).sum::<f32>();
        let (more, black) = (sum(&|one| one.more), sum(&|one| one.black));
        let brighter = more / black;
        let squares: f32 = groups
            .iter()
            .map(|one| ((more - one.more) / (black - one.black) - brighter).powi(2))
            .sum();
        let told = Told {
            brighter,
            variance: squares * (GROUPS - 1) as f32 / GROUPS as f32,
            doubt: sum(&|one| one.doubt) / black,
            steps: self.steps_dn * sum(&|one| one.weight) / black,
        };
        (black > 0.0 && told.variance().is_finite()).then_some(told)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_lamp_is_known_no_worse_than_lamps_are_and_no_better_than_it_is_told() {
        let [well, badly] = [1e-4, 0.19].map(|uncertainty| Level::of_all(1.06, uncertainty).beside(0.02));
        assert!(
            (well.light - 1.06).abs() < 1e-5 && (well.uncertainty - 1e-4).abs() < 1e-8,
            "{well:?}"
        );
        assert!((badly.light - 1.0).abs() < 1e-3, "{badly:?}");
        assert!((0.0198..0.02).contains(&badly.uncertainty), "{badly:?}");
    }

    #[test]
    fn the_lamp_is_told_by_the_exposure_time_that_tells_it_best() {
        let level = Level::best([1e-4_f32, 4e-6, 9e-6].map(|variance| Level {
            light: 1.01,
            uncertainty: variance.sqrt(),
            common: 0.0,
        }));
        let level = level.unwrap();
        assert!((level.light - 1.01).abs() < 1e-6, "{level:?}");
        assert!((level.uncertainty - 0.002).abs() < 1e-6, "{level:?}");
        assert_eq!(Level::best([]), None);
    }
}
