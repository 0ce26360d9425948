//! What all frames of a run together tell of the lamp.
//!
//! # Design
//! Stray light in dark pixels that is taken for too much makes the lamp too dark in every frame: no frame shows that by itself, and no
//! mean lessens it. But the lamp flickers about what it was in the black frames that stand among the others. So what a frame
//! tells is
//!
//! told = flicker + ξ·doubt + s + m,
//!
//! where stray light is off by ξ of its standard uncertainties, s is what the converter's steps make of dark pixels, and m by how much
//! the lamp of the mean black frame was another than in the mean of the others. Least squares have ξ, s and m beside what is known of
//! each anyway: ξ about 1, s as large as steps, m as flicker and slow changes make it. ξ·doubt + s is taken away, and what
//! is left uncertain of it all frames have in common.

use super::level::Level;
use crate::base::linear_fit::least_squares;

/// Part of the doubt of stray light that frames do not share.
const OWN: f64 = 0.5;

/// What dark pixels of a frame tell of the lamp, relative.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Told {
    /// By how much it was brighter than in the black frames.
    pub(super) brighter: f32,
    /// Variance of that by noise and by shapes of stray light.
    pub(super) variance: f32,
    /// What one standard uncertainty of stray light makes of it.
    pub(super) doubt: f32,
    /// What half a step of the converter in all dark pixels would make of it, as far as noise does not dither it.
    pub(super) steps: f32,
}

impl Told {
    /// Variance by all of that but the steps.
    pub(super) fn variance(self) -> f32 {
        self.variance + self.doubt * self.doubt
    }

    /// With what an `error` that no other frame shares tells of the lamp as uncertain too.
    pub(crate) fn doubted_by(self, error: Option<Self>) -> Self {
        let brighter = error.map_or(0.0, |error| error.brighter);
        Self {
            variance: self.variance + brighter * brighter,
            ..self
        }
    }

    /// Variance by what frames do not share.
    fn own_variance(self) -> f32 {
        self.variance + (OWN as f32 * self.doubt).powi(2)
    }
}

/// What all frames of a run are off by alike.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Bias {
    /// Stray light in dark pixels, in its standard uncertainties.
    stray: f32,
    /// The converter's steps, relative to the lamp.
    steps: f32,
    /// Variance of what both together make of the lamp.
    variance: f32,
    /// Variance by which the mean lamp of the frames is another than that of the black ones.
    mean_variance: f32,
}

impl Bias {
    /// From what frames `told` beside `black` others; the lamp flickers by so much and changes `slowly` by so much from these to those,
    /// relative (k = 1).
    pub(crate) fn of(told: &[Told], black: usize, flicker: f64, slowly: f64) -> Self {
        let count = told.len().max(1) as f64;
        let mean = |of: &dyn Fn(&Told) -> f32| told.iter().map(|one| f64::from(of(one))).sum::<f64>() / count;
        let (doubt, steps) = (mean(&|one| one.doubt), mean(&|one| one.steps));
        let mean_variance = flicker.powi(2) * (1.0 / black.max(1) as f64 + 1.0 / count) + slowly.powi(2);
        let weight = |one: &Told| {
            (flicker.powi(2) + f64::from(one.own_variance()))
                .max(f64::from(f32::MIN_POSITIVE))
                .recip()
        };
        let rows: Vec<(Vec<f64>, f64, f64)> = told
            .iter()
            .map(|one| {
                let row = vec![one.doubt.into(), one.steps.into(), 1.0];
                (row, f64::from(one.brighter), weight(one))
            })
            .chain([
                (vec![1.0, 0.0, 0.0], 0.0, 1.0),
                (vec![0.0, 1.0, 0.0], 0.0, 1.0),
                (
                    vec![0.0, 0.0, 1.0],
                    0.0,
                    mean_variance.max(f64::from(f32::MIN_POSITIVE)).recip(),
                ),
            ])
            .collect();
        let Some((found, covariance)) = least_squares(3, rows.iter().cloned()) else {
            return Self::default();
        };
        let both = doubt * doubt * covariance[(0, 0)]
            + 2.0 * doubt * steps * covariance[(0, 1)]
            + steps * steps * covariance[(1, 1)];
        Self {
            stray: found[0] as f32,
            steps: found[1] as f32,
            variance: both.max(0.0) as f32,
            mean_variance: mean_variance as f32,
        }
    }

    /// The lamp by what a frame `told`, `None` if it told nothing, where its light has this variance if nothing tells it.
    pub(super) fn level(self, told: Option<Told>, prior_variance: f32) -> Level {
        let (brighter, own, trust) = told.map_or((0.0, prior_variance, 0.0), |told| {
            let variance = told.own_variance();
            let trust = prior_variance / (prior_variance + variance);
            let brighter = told.brighter - self.stray * told.doubt - self.steps * told.steps;
            (brighter, trust * variance, trust)
        });
        let common = trust * trust * self.variance + (1.0 - trust).powi(2) * self.mean_variance;
        Level {
            light: 1.0 + trust * brighter,
            uncertainty: (own + common).sqrt(),
            common: common.sqrt(),
        }
    }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt as _, SeedableRng as _};
    use rand_distr::StandardNormal;
    use rand_xoshiro::Xoshiro256PlusPlus;

    use super::*;

    const FLICKER: f64 = 4e-3;
    const BLACK: usize = 12;

    /// What 80 frames tell that have stray light off as much as can be, each with its true lamp, from a run that `seed` draws.
    fn run(doubt: f64, steps: f64, seed: u64) -> Vec<(Told, f64)> {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed);
        let mut normal = || -> f64 { rng.sample(StandardNormal) };
        let (stray, step) = (normal(), normal() * steps);
        let black = FLICKER * normal() / (BLACK as f64).sqrt();
        (0..80)
            .map(|frame| {
                let doubt = doubt * (1.0 + f64::from(frame % 7) / 7.0);
                let lamp = FLICKER * normal() - black;
                let told = Told {
                    brighter: (lamp + stray * doubt + step) as f32,
                    variance: 1e-10,
                    doubt: doubt as f32,
                    steps: steps as f32,
                };
                (told, lamp)
            })
            .collect()
    }

    #[test]
    fn what_all_frames_are_off_by_alike_is_found_or_stated() {
        let prior = (2.0 * FLICKER).powi(2) as f32;
        for (doubt, steps) in [(1e-4, 0.0), (3e-3, 0.0), (1e-2, 0.0), (1e-4, 0.03), (1e-2, 3e-3)] {
            let (mut squares, mut stated, mut as_told) = (0.0, 0.0, 0.0);
            for seed in 0..200 {
                let run = run(doubt, steps, seed);
                let told: Vec<Told> = run.iter().map(|(told, _)| *told).collect();
                let bias = Bias::of(&told, BLACK, FLICKER, 0.0);
                let levels: Vec<Level> = told.iter().map(|told| bias.level(Some(*told), prior)).collect();
                let count = run.len() as f64;
                let off = |of: &dyn Fn(usize) -> f64| {
                    let each = (0..run.len()).map(|frame| of(frame) - run[frame].1);
                    (each.sum::<f64>() / count).powi(2)
                };
                squares += off(&|frame| f64::from(levels[frame].light) - 1.0);
                as_told += off(&|frame| f64::from(told[frame].brighter));
                stated += levels
                    .iter()
                    .map(|level| f64::from(level.common).powi(2))
                    .sum::<f64>()
                    / count;
            }
            let ratio = (squares / stated).sqrt();
            assert!((0.7..1.25).contains(&ratio), "{doubt} {steps}: {ratio}");
            assert!(squares < 1.1 * as_told, "{doubt} {steps}: {squares} {as_told}");
            if doubt.hypot(steps) > 9e-3 {
                assert!(squares < 0.1 * as_told, "{doubt} {steps}: {squares} {as_told}");
            }
        }
    }

    #[test]
    fn nothing_told_leaves_what_was_known() {
        let bias = Bias::of(&[], BLACK, FLICKER, 1e-3);
        let level = bias.level(None, 1e-4);
        assert!(
            (level.light - 1.0).abs() < 1e-9 && level.uncertainty > 0.01,
            "{level:?}"
        );
        assert!(level.common > 1e-3, "{level:?}");
    }
}
