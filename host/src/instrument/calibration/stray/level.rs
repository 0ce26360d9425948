//! How bright the lamp was in a frame, told by pixels that are dark by construction.
//!
//! # Design
//! A frame shows L·(B + S): the light B of a black pattern and S of what else is lit, both with the lamp as in the black frames,
//! which is L = 1. In dark pixels B is direct light, most of it of the projector pixels that watch the lamp
//! ([`crate::instrument::monitor`]), and S is stray light, which is known. So L − 1 = Σ w·(frame − black − stray)/Σ w·B with
//! weights w that have no noise in common with it: the light that calibration found there.
//!
//! The camera's offset may be another than in the calibration, which passes for light.
//!
//! What noise leaves uncertain, and wrong shapes of stray light, a jackknife over groups of neighbours tells; what is
//! uncertain in stray light itself all pixels share. Where dark pixels tell less than is known of lamps anyway, L is near 1.

use glam::Vec4;

use super::{CAMERA_TERMS, GROUPS, PROJECTOR_TERMS, Removal, Room, lanes};
use crate::instrument::calibration::lamp::Monitor;

/// Light of the lamp in a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Level {
    /// Over that of what it is compared with.
    pub(crate) light: f32,
    /// Its standard uncertainty (k = 1), which all pixels of the frame share.
    pub(crate) uncertainty: f32,
}

impl Level {
    /// As in the black frames, for certain.
    pub(crate) const SAME: Self = Self {
        light: 1.0,
        uncertainty: 0.0,
    };

    /// What a frame shows `more` than a black one, of light `black`, had the lamp been the same.
    pub(crate) fn steady(self, more: Vec4, black: Vec4) -> Vec4 {
        (more - black * (self.light - 1.0)) / self.light
    }
}

/// What dark pixels say of the lamp in black frames of one exposure time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Compared {
    /// By how much more light they show than in the calibration, relative, and the variance of that.
    off: f32,
    variance: f32,
    /// What of it an offset of the camera makes that is higher by one standard deviation.
    per_offset: f32,
}

impl Compared {
    /// The lamp by those of `all` black frames of a run whose stray light is known best; `None` if there are none. Longer exposure times
    /// know less of the camera's offset, but where the sample saturates nobody knows what comes of it, so that they are off by more.
    pub(crate) fn best(all: impl IntoIterator<Item = Self>) -> Option<Level> {
        let best = all.into_iter().min_by(|a, b| a.variance.total_cmp(&b.variance))?;
        Some(Level {
            light: 1.0 + best.off,
            uncertainty: best.variance.sqrt().hypot(best.per_offset),
        })
    }
}

/// What watches the lamp, for images of one size.
#[derive(Debug)]
pub(super) struct Watch {
    /// Light of the watching pixels, digital numbers per second, by camera term, and of all others, which are black.
    light: [Vec4; CAMERA_TERMS],
    black: [Vec4; CAMERA_TERMS],
    /// Its relative standard uncertainty in dark pixels.
    uncertainty: f32,
}

impl Watch {
    /// As `monitor`, with squares of `side` pixels.
    pub(super) fn new(monitor: &Monitor, side: u32) -> Self {
        let scale = f64::from(side * side) / f64::from(monitor.side * monitor.side);
        let terms = |rows: &[Vec<f64>], scale: f64| {
            std::array::from_fn(|term| lanes(rows.len(), |channel| rows[channel][term] * scale))
        };
        Self {
            light: terms(&monitor.light, scale),
            black: terms(&monitor.black, 1.0),
            uncertainty: monitor.uncertainty_of(side) as f32,
        }
    }

    /// Light of the watching pixels in a pixel with these camera terms, and all that comes without a sample, digital numbers per
    /// second.
    fn at(&self, terms: &[f32; CAMERA_TERMS]) -> [Vec4; 2] {
        let sum = |of: &[Vec4; CAMERA_TERMS]| {
            let light = of.iter().zip(terms);
            light.fold(Vec4::ZERO, |sum, (light, term)| sum + *light * *term)
        };
        let light = sum(&self.light);
        [light, light + sum(&self.black)]
    }

    /// How much each of the dark `pixels` counts, of an image with these camera terms: as much as it shines by what watches the
    /// lamp, all alike if nothing does.
    pub(super) fn weights(
        watch: Option<&Self>,
        pixels: &[u32],
        camera_terms: &[[f32; CAMERA_TERMS]],
        channels: usize,
    ) -> Vec<Vec4> {
        let weight = |pixel: &u32| match watch {
            Some(watch) => watch.at(&camera_terms[*pixel as usize])[0],
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
    /// Of weights.
    weight: f32,
}

impl Removal {
    /// The lamp in a frame over that in the black ones: `more(pixel)` is what it shows more than they did, less stray light,
    /// `black(pixel)` their light, `doubt(pixel)` the standard uncertainty of the stray light, all in digital numbers, NaN
    /// where saturated.
    pub(crate) fn level(
        &self,
        more: impl Fn(usize) -> Vec4,
        black: impl Fn(usize) -> Vec4,
        doubt: impl Fn(usize) -> Vec4,
    ) -> Level {
        let Some(Compared { off, variance, .. }) = self.compare(more, black, doubt) else {
            return Level {
                light: 1.0,
                uncertainty: self.prior_variance.sqrt(),
            };
        };
        let trust = self.prior_variance / (self.prior_variance + variance);
        Level {
            light: 1.0 + trust * off,
            uncertainty: (trust * variance).sqrt(),
        }
    }

    /// The lamp in black frames beside that of the calibration; `light` is what they show above the dark level in `exposure_s`
    /// seconds, digital numbers, NaN where saturated, which is at least `saturation`. `None` if nothing watches it.
    pub(crate) fn level_of_black(
        &self,
        light: &[Vec4],
        exposure_s: f64,
        saturation: f32,
    ) -> Option<Compared> {
        let watch = self.watch.as_ref()?;
        let own: Vec<Vec4> = self
            .camera_terms
            .iter()
            .map(|terms| watch.at(terms)[1] * exposure_s as f32)
            .collect();
        // What comes directly takes part in no glare.
        let of_sample: Vec<Vec4> = light.iter().zip(&own).map(|(light, own)| *light - *own).collect();
        let mut room = Room::default();
        self.find(
            &of_sample,
            &[0.0; PROJECTOR_TERMS],
            exposure_s,
            saturation,
            &mut room,
        );
        self.compare(
            |pixel| of_sample[pixel] - room.stray[pixel],
            |pixel| own[pixel],
            |pixel| room.doubt[pixel],
        )
    }

    /// Relative standard uncertainty of what [`level_of_black`](Self::level_of_black) compares with.
    pub(crate) fn level_uncertainty(&self) -> f32 {
        self.watch.as_ref().map_or(0.0, |watch| watch.uncertainty)
    }

    /// By how much `more` exceeds what `black` says; `None` if no pixel tells.
    fn compare(
        &self,
        more: impl Fn(usize) -> Vec4,
        black: impl Fn(usize) -> Vec4,
        doubt: impl Fn(usize) -> Vec4,
    ) -> Option<Compared> {
        let mut groups = [Sums::default(); GROUPS];
        for (place, &pixel) in self.monitors.iter().enumerate() {
            let at = pixel as usize;
            let (more, weight) = (more(at), self.weights[place]);
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
        let (more, black, doubt) = (sum(&|one| one.more), sum(&|one| one.black), sum(&|one| one.doubt));
        let off = more / black;
        let squares: f32 = groups
            .iter()
            .map(|one| ((more - one.more) / (black - one.black) - off).powi(2))
            .sum();
        let variance = squares * (GROUPS - 1) as f32 / GROUPS as f32 + (doubt / black).powi(2);
        (black > 0.0 && variance.is_finite()).then(|| Compared {
            off,
            variance,
            per_offset: self.offset_dn * sum(&|one| one.weight) / black,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_lamp_is_told_by_what_stray_light_leaves_best_known_as_well_as_the_offset_is() {
        let (light, offset) = (1.01, 1.5);
        let shown = |variance: f32, per_offset: f32| Compared {
            off: light - 1.0 + offset * per_offset,
            variance,
            per_offset,
        };
        let level = Compared::best([shown(4e-4, 0.001), shown(9e-6, 0.004)]).unwrap();
        assert!((level.light - light).abs() < 2.0 * level.uncertainty, "{level:?}");
        assert!((level.uncertainty - 0.005).abs() < 1e-4, "{level:?}");
        assert_eq!(Compared::best([]), None);
    }
}
