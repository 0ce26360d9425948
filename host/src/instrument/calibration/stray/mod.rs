//! Light that reaches a pixel by another way than its own, as calibration found it, and how images lose it.
//!
//! # Design
//! What a camera shows of an image S is S + A·S + D. A is glare and the ghost of the beam splitter: a *halo*, which is a sum of
//! Gaussians of fixed widths and so as cheap as small images (`halo`), and a displaced copy (`ghost`). D is direct light of
//! the projector, which knows no sample: a polynomial over both images (`direct`).
//!
//! A is small: S = (1 − A + A²)·(shown − D) up to A³. What A takes from its own pixel belongs to throughput.
//!
//! Where pixels saturated their light is at least that of saturation; the rest is told by pixels that are dark by
//! construction: hole, rim, and what lies beside the sample. There the halo of the rest is all there is.

mod bias;
mod direct;
mod ghost;
mod halo;
mod level;

use glam::{DVec3, Vec4};
use serde::{Deserialize, Serialize};

use super::lamp::LampFound;
use crate::instrument::frame_format::FrameFormat;
use crate::instrument::optics::View;
use crate::instrument::rig::Rig;

pub(crate) use bias::{Bias, Told};
use direct::DirectImage;
pub(crate) use direct::{CAMERA_TERMS, PROJECTOR_TERMS, camera_terms, lit_terms};
pub(crate) use ghost::Shifted;
pub(crate) use halo::{Halo, Room as HaloRoom};
pub(crate) use level::{ByBand, Level, Levels};

use level::Watch;

/// Standard widths of the Gaussians of a halo, half widths of the image.
pub(crate) const WIDTHS: [f64; 7] = [0.02, 0.04, 0.08, 0.16, 0.32, 0.64, 2.0];

/// Pixels within so many of one that sees the sample are not dark for certain.
const NEAR_PX: usize = 3;
/// Sine of the angle below the horizon from which on the sample is not seen for certain.
const BELOW: f64 = 0.05;

/// Stray light as calibration found it.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Stray {
    /// Share of the light that goes into each Gaussian of the halo, [channel, width], see [`Stray::widths`].
    pub halo: Vec<Vec<f64>>,
    /// Relative standard uncertainty (k = 1) of what the halo adds.
    pub halo_uncertainty: f64,
    /// The ghost of the beam splitter; none if it is nowhere to be seen.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ghost: Option<GhostFound>,
    /// Digital numbers per second and projector pixel that comes directly, [channel, term].
    pub direct: Vec<Vec<f64>>,
    /// Standard uncertainty (k = 1) of direct light, digital numbers per second and projector pixel.
    pub direct_uncertainty: f64,
}

/// A displaced copy of the image.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GhostFound {
    /// Its light over that of the image, of each channel.
    pub share: Vec<f64>,
    /// Standard uncertainty (k = 1) of that.
    pub standard_uncertainty: f64,
    /// Where it is, half widths of the image.
    pub shift: [f64; 2],
}

impl Stray {
    /// Share of light from the middle of the image that the halo spreads over the image, mean over the channels.
    #[must_use]
    pub fn glare(&self) -> f64 {
        // A Gaussian within ±1 along both axes.
        let within = |width: f64| halo::erf((std::f64::consts::SQRT_2 * width).recip()).powi(2);
        let of = |shares: &Vec<f64>| -> f64 {
            shares
                .iter()
                .zip(WIDTHS)
                .map(|(share, width)| share * within(width))
                .sum()
        };
        self.halo.iter().map(of).sum::<f64>() / self.halo.len().max(1) as f64
    }

    /// Direct light, mean over both images and the channels, digital numbers per second and projector pixel.
    #[must_use]
    pub fn direct_mean(&self) -> f64 {
        let constants: f64 = self.direct.iter().filter_map(|terms| terms.first()).sum();
        constants / self.direct.len().max(1) as f64
    }

    /// Standard widths of the Gaussians of a halo, half widths of the image.
    #[must_use]
    pub const fn widths() -> [f64; WIDTHS.len()] {
        WIDTHS
    }

    /// What is wrong with it for a camera of so many channels: the field, and what was expected.
    pub(crate) fn flaw(&self, channels: usize) -> Option<(&'static str, String)> {
        let is_share = |share: &f64| (0.0..=0.5).contains(share);
        let rows = |rows: &[Vec<f64>], terms: usize| {
            rows.len() == channels && rows.iter().all(|row| row.len() == terms)
        };
        if !rows(&self.halo, WIDTHS.len()) || !self.halo.iter().flatten().all(is_share) {
            let expected = format!(
                "{} shares from 0 to 0.5 for each of {channels} channels",
                WIDTHS.len()
            );
            return Some(("halo", expected));
        }
        let terms = CAMERA_TERMS * PROJECTOR_TERMS;
        if !rows(&self.direct, terms) || self.direct.iter().flatten().any(|c| !c.is_finite()) {
            return Some((
                "direct",
                format!("{terms} finite numbers for each of {channels} channels"),
            ));
        }
        let is_uncertainty = |found: f64| found >= 0.0 && found.is_finite();
        if !is_uncertainty(self.halo_uncertainty) {
            return Some(("halo_uncertainty", "a number from 0 on".to_owned()));
        }
        if !is_uncertainty(self.direct_uncertainty) {
            return Some(("direct_uncertainty", "a number from 0 on".to_owned()));
        }
        let is_ghost = |ghost: &GhostFound| {
            ghost.share.len() == channels
                && ghost.share.iter().all(is_share)
                && is_uncertainty(ghost.standard_uncertainty)
                && ghost.shift.iter().all(|shift| (-1.0..=1.0).contains(shift))
        };
        let expected = format!("{channels} shares from 0 to 0.5, and a shift from -1 to 1");
        (!self.ghost.as_ref().is_none_or(is_ghost)).then_some(("ghost", expected))
    }
}

/// Pixels of the image of `rig`'s camera that no light of the sample reaches by its own way: those that look past the mirror,
/// through its hole, or at the sample from below, as all those do that are near. (What looks beside the sample may see it
/// where it is not quite where it should be.)
pub(crate) fn dark_of(rig: &Rig) -> Vec<u32> {
    let FrameFormat {
        width_px, height_px, ..
    } = rig.frame_format();
    let camera = View::camera(rig);
    let is_dark: Vec<bool> = (0..width_px * height_px)
        .map(|pixel| {
            let (u, v) = ((pixel % width_px) as f64 + 0.5, (pixel / width_px) as f64 + 0.5);
            let [hole, rim, _] = camera.edge_distances_rad(u, v);
            let is_past = |edge: Option<f64>| edge.is_some_and(|rad| rad < 0.0);
            let from_below = |w: DVec3| w.z < -BELOW;
            is_past(hole) || is_past(rim) || camera.sight(u, v).is_none_or(from_below)
        })
        .collect();
    let around = |at: usize, size: usize| at.saturating_sub(NEAR_PX)..(at + NEAR_PX + 1).min(size);
    (0..is_dark.len())
        .filter(|pixel| {
            let (x, y) = (pixel % width_px, pixel / width_px);
            around(y, height_px).all(|y| around(x, width_px).all(|x| is_dark[y * width_px + x]))
        })
        .map(|pixel| pixel as u32)
        .collect()
}

/// Takes stray light from images of one size.
#[derive(Debug)]
pub(crate) struct Removal {
    halo: Halo,
    /// Of each Gaussian, by channel.
    shares: Vec<Vec4>,
    halo_uncertainty: f32,
    ghost: Option<(Shifted, Vec4, f32)>,
    size_px: (usize, usize),
    direct_image: DirectImage,
    /// Of each channel.
    direct: Vec<Vec<f64>>,
    direct_uncertainty: f32,
    /// Pixels that are dark by construction, and how much each counts where they tell the lamp's light.
    monitors: Vec<u32>,
    weights: Vec<Vec4>,
    /// What noise leaves of the converter's steps in the difference of two means, in all pixels alike, digital numbers (k = 1).
    steps_dn: f32,
    watch: Option<Watch>,
    /// Bands of an image that are lit one after the other; 1 if all are at once.
    bands: usize,
    /// Standard deviation of the lamp's light from exposure to exposure, relative.
    flicker: f32,
    /// Variance of the light of an exposure as far as nothing watches it.
    prior_variance: f32,
}

/// Images that a worker keeps.
#[derive(Debug, Default)]
pub(crate) struct Room {
    /// What reached each pixel by other ways, and its standard uncertainty (k = 1).
    pub(crate) stray: Vec<Vec4>,
    pub(crate) doubt: Vec<Vec4>,
    /// Standard uncertainty of each pixel by the lamp, for who compares it.
    pub(crate) lamp: Vec<Vec4>,
    clean: Vec<Vec4>,
    once: Vec<Vec4>,
    twice: Vec<Vec4>,
    beyond: Vec<Vec4>,
    halo: halo::Room,
}

/// Groups of pixels that are dark by construction.
const GROUPS: usize = 8;
/// By how much more than found the lamp may change, as a variance.
const UNSURE: f64 = 1.5;
/// What is divided by has to be more than nothing: far below the square of what one pixel throws on any other.
const LEAST: f32 = 1e-30;
/// Where what the lamp does leaves less than this share of what tells light beyond saturation, rounding leaves nothing of it.
const TOLD: f32 = 1e-4;

/// By how much the offset of a pixel of the sensor may be off after a while, electrons (k = 1): that of cameras wanders by 0.1 to 1 as
/// their temperature changes.
const WANDER_E: f64 = 0.5;
/// It takes so many seconds for that.
pub(crate) const WANDER_S: f64 = 250.0;

/// The same of the images of `rig`, digital numbers.
pub(crate) fn offset_dn(rig: &Rig) -> f64 {
    WANDER_E * rig.camera.binned.pixels / rig.gain_e_per_dn()
}

/// What noise leaves of the converter's steps in the difference of two mean images of `rig`, of which one is dark and one shows this light
/// above the dark level, digital numbers (k = 1).
pub(crate) fn steps_dn(rig: &Rig, light_dn: f64) -> f64 {
    let (binned, gain_e_per_dn) = (&rig.camera.binned, rig.gain_e_per_dn());
    binned
        .common_e(0.0)
        .hypot(binned.common_e(light_dn * gain_e_per_dn))
        / gain_e_per_dn
}

impl Removal {
    /// As `found`, for images of `rig` while squares of `side` pixels watch the `lamp`.
    pub(crate) fn of(found: &Stray, lamp: &LampFound, side: u32, rig: &Rig) -> Self {
        let format = rig.frame_format();
        Self {
            steps_dn: steps_dn(rig, 0.0) as f32,
            bands: rig.shown_bands(),
            ..Self::new(
                found,
                (lamp, side),
                (format.width_px, format.height_px),
                dark_of(rig),
            )
        }
    }

    /// In a run whose black frames tell by which variance the lamp differs from one to another, relative; `None` if they do not.
    pub(crate) fn in_run(self, lamp_variance: Option<f64>) -> Self {
        let prior_variance = lamp_variance.map_or(self.prior_variance, |found| {
            let flicker = f64::from(self.flicker).powi(2);
            // As many exposures as black frames tell the flicker.
            (UNSURE * found.max(0.5 * (flicker + found))) as f32
        });
        Self {
            prior_variance,
            ..self
        }
    }

    /// As `found`, for images of this size, while squares of so many pixels watch the lamp; `dark` are the pixels that no light
    /// of the sample reaches.
    fn new(
        found: &Stray,
        (lamp, side): (&LampFound, u32),
        (width_px, height_px): (usize, usize),
        dark: Vec<u32>,
    ) -> Self {
        let monitor = lamp.monitor.as_ref().filter(|_| side > 0);
        let watch = monitor.map(|monitor| Watch::new(monitor, side, (width_px, height_px)));
        let channels = found.halo.len();
        Self {
            halo: Halo::new(width_px, height_px),
            shares: (0..WIDTHS.len())
                .map(|width| lanes(channels, |channel| found.halo[channel][width]))
                .collect(),
            halo_uncertainty: found.halo_uncertainty as f32,
            ghost: found.ghost.as_ref().map(|ghost| {
                (
                    Shifted::new(ghost.shift, width_px, height_px),
                    lanes(channels, |channel| ghost.share[channel]),
                    ghost.standard_uncertainty as f32,
                )
            }),
            direct: found.direct.clone(),
            direct_uncertainty: found.direct_uncertainty as f32,
            weights: Watch::weights(watch.as_ref(), &dark, channels),
            size_px: (width_px, height_px),
            direct_image: DirectImage::new(width_px, height_px),
            watch,
            flicker: lamp.flicker as f32,
            prior_variance: lamp.prior_variance() as f32,
            monitors: dark,
            steps_dn: 0.0,
            bands: 1,
        }
    }

    /// What of `shown` (dark-corrected digital numbers of each pixel, channels in the lanes, NaN where saturated) came other
    /// ways, into `room`. `lit` are the terms of the pattern (see [`lit_terms`]), `exposure_s` the exposure time in seconds,
    /// and `saturation` the number of a saturated pixel.
    pub(crate) fn find(
        &self,
        shown: &[Vec4],
        lit: &[f64; PROJECTOR_TERMS],
        exposure_s: f64,
        saturation: f32,
        room: &mut Room,
    ) {
        let direct = self.direct_coefficients(lit, exposure_s);
        let direct_doubt = Vec4::splat(self.direct_uncertainty * (lit[0] * exposure_s) as f32);
        let saturated = Vec4::splat(saturation);
        let mut is_saturated = false;
        room.clean.clear();
        room.stray.clear();
        room.doubt.clear();
        for (shown, light) in shown.iter().zip(self.direct_image.of(&direct)) {
            let is_nan = shown.is_nan_mask();
            is_saturated |= is_nan.any();
            room.clean.push(Vec4::select(is_nan, saturated, *shown) - light);
            room.stray.push(light);
            room.doubt.push(direct_doubt);
        }
        self.spread(&room.clean, &mut room.once, &mut room.halo);
        self.spread(&room.once, &mut room.twice, &mut room.halo);
        for (((stray, doubt), once), twice) in room
            .stray
            .iter_mut()
            .zip(&mut room.doubt)
            .zip(&room.once)
            .zip(&room.twice)
        {
            let spread = *once - *twice;
            *stray += spread;
            *doubt = hypot(*doubt, spread * self.halo_uncertainty);
        }
        if let Some((shifted, share, uncertainty)) = &self.ghost {
            shifted.doubt(&room.clean, *share, *uncertainty, &mut room.doubt);
        }
        if is_saturated {
            self.find_beyond(shown, room);
        }
    }

    /// What came other ways with an image that has lost it, `clean`, into `room`, as [`find`](Self::find) would have found it;
    /// a pixel without a value (NaN) is taken to be dark.
    pub(crate) fn of_clean(
        &self,
        clean: &[Vec4],
        lit: &[f64; PROJECTOR_TERMS],
        exposure_s: f64,
        room: &mut Room,
    ) {
        let direct = self.direct_coefficients(lit, exposure_s);
        let direct_doubt = Vec4::splat(self.direct_uncertainty * (lit[0] * exposure_s) as f32);
        room.clean.clear();
        let known = |clean: &Vec4| Vec4::select(clean.is_nan_mask(), Vec4::ZERO, *clean);
        room.clean.extend(clean.iter().map(known));
        self.spread(&room.clean, &mut room.once, &mut room.halo);
        room.stray.clear();
        room.doubt.clear();
        for (spread, light) in room.once.iter().zip(self.direct_image.of(&direct)) {
            room.stray.push(light + *spread);
            room.doubt
                .push(hypot(direct_doubt, *spread * self.halo_uncertainty));
        }
        if let Some((shifted, share, uncertainty)) = &self.ghost {
            shifted.doubt(&room.clean, *share, *uncertainty, &mut room.doubt);
        }
    }

    /// Adds what the light of saturated pixels beyond saturation makes.
    fn find_beyond(&self, shown: &[Vec4], room: &mut Room) {
        room.beyond.clear();
        let beyond = shown
            .iter()
            .map(|shown| Vec4::select(shown.is_nan_mask(), Vec4::ONE, Vec4::ZERO));
        room.beyond.extend(beyond);
        self.spread(&room.beyond, &mut room.once, &mut room.halo);
        // Sums over the monitors, by groups of neighbours: what is wrong with the halo's shape they share.
        let mut sums = [Beyond::default(); GROUPS];
        let mut count = 0.0_f32;
        for (place, &pixel) in self.monitors.iter().enumerate() {
            let at = pixel as usize;
            if shown[at].is_nan() {
                continue;
            }
            let (x, y) = (room.once[at], shown[at] - room.stray[at]);
            // The lamp may be brighter than in the black frames.
            let lamp = self.watch.as_ref().map_or(Vec4::ZERO, |_| self.weights[place]);
            sums[place * GROUPS / self.monitors.len()].add(x, y, lamp);
            count += 1.0;
        }
        let all = sums.iter().fold(Beyond::default(), |sum, one| sum.plus(one, 1.0));
        let least = Vec4::splat(LEAST);
        let (raw, xx) = all.solve();
        let is_known = xx.cmpgt(least.max(all.xx * TOLD)) & Vec4::splat(count).cmpgt(Vec4::splat(8.0));
        let each = Vec4::select(is_known, raw.max(Vec4::ZERO), Vec4::ZERO);
        // By a jackknife over the groups.
        let squares = sums.iter().fold(Vec4::ZERO, |sum, group| {
            let off = all.plus(group, -1.0).solve().0 - raw;
            sum + off * off
        });
        let jackknife = sqrt(squares * ((GROUPS - 1) as f32 / GROUPS as f32));
        let uncertain = Vec4::select(is_known, jackknife, Vec4::splat(f32::INFINITY));
        for ((stray, doubt), spread) in room.stray.iter_mut().zip(&mut room.doubt).zip(&room.once) {
            let added = *spread * each;
            *stray += added;
            let unknown = Vec4::select(spread.cmpgt(Vec4::ZERO), *spread * uncertain, Vec4::ZERO);
            *doubt = hypot(hypot(*doubt, added * self.halo_uncertainty), unknown);
        }
    }

    /// Direct light of a pattern, digital numbers of each term over the camera's image.
    fn direct_coefficients(&self, lit: &[f64; PROJECTOR_TERMS], exposure_s: f64) -> [Vec4; CAMERA_TERMS] {
        std::array::from_fn(|term| {
            lanes(self.direct.len(), |channel| {
                let row = &self.direct[channel][term * PROJECTOR_TERMS..][..PROJECTOR_TERMS];
                let sum: f64 = row.iter().zip(lit).map(|(c, lit)| c * lit).sum();
                sum * exposure_s
            })
        })
    }

    /// A·`image` into `out`.
    fn spread(&self, image: &[Vec4], out: &mut Vec<Vec4>, room: &mut halo::Room) {
        self.halo.of(image, &self.shares, out, room);
        if let Some((shifted, share, _)) = &self.ghost {
            shifted.add(image, *share, out);
        }
    }
}

/// Sums for light beyond saturation, whose halo is x, in what y dark pixels show, where the lamp's change goes with z.
#[derive(Clone, Copy, Debug, Default)]
struct Beyond {
    xx: Vec4,
    xy: Vec4,
    xz: Vec4,
    yz: Vec4,
    zz: Vec4,
}

impl Beyond {
    fn add(&mut self, x: Vec4, y: Vec4, z: Vec4) {
        self.xx += x * x;
        self.xy += x * y;
        self.xz += x * z;
        self.yz += y * z;
        self.zz += z * z;
    }

    fn plus(&self, other: &Self, times: f32) -> Self {
        Self {
            xx: self.xx + other.xx * times,
            xy: self.xy + other.xy * times,
            xz: self.xz + other.xz * times,
            yz: self.yz + other.yz * times,
            zz: self.zz + other.zz * times,
        }
    }

    /// Light per x by least squares, whatever the lamp does, and what of Σ x² tells it.
    fn solve(&self) -> (Vec4, Vec4) {
        let zz = self.zz.max(Vec4::splat(f32::MIN_POSITIVE));
        let share = self.xz / zz;
        let xx = self.xx - share * self.xz;
        ((self.xy - share * self.yz) / xx.max(Vec4::splat(LEAST)), xx)
    }
}

/// What `of` makes of each of the `channels` in the lanes, zeros behind them.
pub(crate) fn lanes(channels: usize, of: impl Fn(usize) -> f64) -> Vec4 {
    let mut lanes = [0.0; 4];
    for (channel, lane) in lanes.iter_mut().enumerate().take(channels) {
        *lane = of(channel) as f32;
    }
    Vec4::from_array(lanes)
}

/// √(a² + b²) of each lane.
pub(crate) fn hypot(a: Vec4, b: Vec4) -> Vec4 {
    sqrt(a * a + b * b)
}

/// √ of each lane.
pub(crate) fn sqrt(of: Vec4) -> Vec4 {
    Vec4::from_array(of.to_array().map(f32::sqrt))
}

#[cfg(test)]
mod tests;
