//! Light and throughput from frames of a standard.
//!
//! # Design
//! Of each incident direction and each camera pixel, what was seen over what a uniform instrument would have seen is
//! q = K·T(o)·E(p). Its logarithm is linear in ln K and in the coefficients of both fields: weighted least squares, with the
//! variance of q by noise. All pairs that take part are spread over both images; the pixels of the camera that see an edge
//! of the mirror do not, because the calibrated rig may have it elsewhere by a part of a pixel. Neither do pixels that look
//! past the standard and spots that fall beside it (`share`).
//!
//! Channels share both fields and have a K each.
//!
//! What part of the sample a pixel sees of what a spot lights is no product: where pupils are no points ln q also has the
//! logarithm of that share, by what is known of it so far ([`SeenPart`]), and how it changes with the six numbers that it depends
//! on, which are fitted along.

mod area;
mod fit;
mod height;
mod ratio;

use glam::DVec3;
use nalgebra::DVector;

pub(super) use fit::{Fields, Held, fit};
pub(super) use height::{unknown_axes, with_heights};

use area::Area;

use super::Linear;
use super::capture::{Stand, Views, maker};
use super::frames::Lit;
use super::share::Judged;
use crate::brdf::sample::Sample;
use crate::calibrate::CalibrateError;
use crate::instrument::calibration::stray::{PROJECTOR_TERMS, lit_terms};
use crate::instrument::calibration::{CalibrationError, Patches, lights};
use crate::instrument::optics::{DirectionMap, Unmeasurable, View};
use crate::instrument::rig::Rig;

/// Pairs that take part, about.
const PAIRS: usize = 60_000;
/// Least cosine of both directions: 80° from the normal.
const LEAST_COS: f64 = 0.174;
/// Least signal that is expected by all pixels of a frame, as a share of its noise: below it the logarithm is biased. (By
/// its own signal the dimmer half of the pixels at the limit would be left out.)
const LEAST_SNR: f64 = 20.0;

/// What pair and series differ by beside noise at best, relative: what is more certain than this does not bend the fields.
const FIT: f64 = 5e-4;

/// Spots come no closer than this to an edge of the mirror, degrees.
const EDGE_DEG: f64 = 1.0;

/// One value of a frame of the standard.
#[derive(Clone)]
struct Pair {
    /// Index of the camera pixel and of the incident direction.
    pixel: u32,
    place: u32,
    channel: u8,
    /// ln q.
    log: f64,
    /// Its variance by noise, and what it counts in a fit: pairs of a frame share what is uncertain of the lamp.
    variance: f64,
    weight: f64,
    /// Standard uncertainty of ln q by the lamp that all frames of the stand share.
    common: f64,
    area: Area,
    /// How far it is to be trusted, 0 to 1.
    trust: f64,
}

impl Pair {
    /// What light and throughput make of it.
    const fn target(&self) -> f64 {
        self.log - self.area.log
    }

    /// What it counts in a fit.
    fn weight(&self) -> f64 {
        self.trust / (self.weight.recip() + self.area.variance)
    }
}

/// A number of a frame that did not saturate: its place there, what it shows of the spot and the variance of that, in DN
/// and DN², and what a uniform instrument of K = 1 would show.
struct Value {
    at: usize,
    signal: f64,
    variance: f64,
    uniform: f64,
    /// Standard uncertainty of the signal by the lamp's light, which all values of a frame share, and the part of it that all frames
    /// do.
    lamp: f64,
    common: f64,
}

/// A pixel: index, place in the image (−1 to 1), direction, and whether an edge of the mirror or the wire is beside it.
type SeenPixel = (usize, [f64; 2], DVec3, bool);
/// A spot: centre of the lit pixels in the projector's image (−1 to 1) and Σ cosθ·Δω.
pub(super) type Spot = ([f64; 2], f64);

/// Frames of a standard as far as they were seen.
#[derive(Clone)]
pub(super) struct Seen<'a> {
    pub(super) stand: &'a Stand,
    pub(super) exposure_s: f64,
    /// The lamp in the black frames over that of the calibration, and its standard uncertainty.
    pub(super) lamp: [f64; 2],
    pub(super) channels: usize,
    pub(super) saturation_dn: f64,
    pub(super) size_px: (usize, usize),
    /// Pixels that take part: index, place in the image (−1 to 1) and direction.
    pub(super) pixels: Vec<(usize, [f64; 2], DVec3)>,
    /// All pixels that by the rig see the sample up to their own edges, and whether an edge of the mirror or the wire is beside them.
    pub(super) all_pixels: Vec<SeenPixel>,
    /// Of each place: centre of the lit pixels in the projector's image (−1 to 1) and Σ cosθ·Δω, if it takes part.
    lit: Vec<Option<Spot>>,
    /// The same of all that no edge cuts.
    pub(super) all_lit: Vec<Option<Spot>>,
    /// Of each place, the terms of direct light (see [`lit_terms`]) of the lit pixels; zero where no spot counts.
    pub(super) lit_terms: Vec<[f64; PROJECTOR_TERMS]>,
    /// What of it the standard truly filled.
    pub(super) judged: Judged,
    /// The rig with the standard as it stood.
    rig: Rig,
    /// What part of it is seen and lit, pixel by pixel and place by place, as far as is known; `None` if all of it is.
    patches: Option<Patches>,
    pairs: Vec<Pair>,
    /// Pixels and places that should be bright and are not, in the first channel.
    dark: Vec<(u32, u32)>,
    saturated: u64,
    values: u64,
}

/// Whether the sample's horizon or border is the reason.
fn is_of_sample(reason: Unmeasurable) -> bool {
    matches!(reason, Unmeasurable::BelowHorizon | Unmeasurable::OffSample)
}

/// Where a pixel stands along an axis of an image of `size` pixels: −1 to 1.
fn half(at: f64, size: usize) -> f64 {
    2.0 * at / size as f64 - 1.0
}

/// All pixels of the `camera` that by the rig see the sample up to their own edges; `map` has their directions.
fn seen_pixels(camera: &View, map: &DirectionMap) -> Vec<SeenPixel> {
    let (width, height) = (map.width_px, map.height_px);
    let is_at_edge = |index: usize| {
        let (x, y) = (index % width, index / width);
        let ends = |reason| !is_of_sample(reason);
        (y.saturating_sub(1)..=y + 1)
            .any(|y| (x.saturating_sub(1)..=x + 1).any(|x| map.direction(x, y).is_err_and(ends)))
    };
    let cut = camera.cut_pixels(0.0);
    map.measurable()
        .filter(|(index, ..)| !cut[*index].is_some_and(is_of_sample))
        .map(|(index, w, _)| {
            let at = [
                half((index % width) as f64 + 0.5, width),
                half((index / width) as f64 + 0.5, height),
            ];
            (index, at, w, is_at_edge(index))
        })
        .collect()
}

/// The spot of `spot_deg` degrees that lights each direction of `stand`, and the terms of direct light (see [`lit_terms`]) of
/// its pixels, if no edge cuts it.
fn lit_spots(rig: &Rig, stand: &Stand, spot_deg: f64) -> Vec<Option<(Spot, [f64; PROJECTOR_TERMS])>> {
    let maker = maker(rig, spot_deg);
    let projector = View::projector(rig);
    let clearance_rad = (spot_deg / 2.0 + EDGE_DEG).to_radians();
    let (width, height) = maker.size_px();
    let spot = |(place, index): (usize, &usize)| {
        let w = lights::direction(*index);
        // The last segment is filled with directions that have been lit before: they are the same evidence.
        if stand.directions[..place].contains(index) {
            return None;
        }
        let at = projector.pixel(w).ok()?;
        // A spot that an edge cuts is as strong as the edge is where it should be.
        let is_clear = projector.edge_within(at.x, at.y, clearance_rad).is_none();
        let lit = maker.lit_set(w).ok().filter(|_| is_clear)?;
        let mean = |of: &dyn Fn(usize) -> usize| {
            let sum: f64 = lit
                .pixels
                .iter()
                .map(|pixel| of(*pixel as usize) as f64 + 0.5)
                .sum();
            sum / lit.pixels.len() as f64
        };
        let at = [
            half(mean(&|pixel| pixel % width), width),
            half(mean(&|pixel| pixel / width), height),
        ];
        Some(((at, lit.irradiance), lit_terms(&lit.pixels, width, height)))
    };
    stand.directions.iter().enumerate().map(spot).collect()
}

impl<'a> Seen<'a> {
    /// Of the stand of index `stand`, where nothing was seen yet.
    pub(super) fn new(views: &'a Views, stand: usize) -> Result<Self, CalibrateError> {
        let rig = views.rig_of(stand)?;
        let stand = &views.stands[stand];
        let camera = View::camera(&rig);
        let map = DirectionMap::of(&camera);
        let (width, height) = (map.width_px, map.height_px);
        let is_inner = |index: usize| {
            let (x, y) = (index % width, index / width);
            (2..width - 2).contains(&x)
                && (2..height - 2).contains(&y)
                && (y - 2..=y + 2).all(|y| (x - 2..=x + 2).all(|x| map.direction(x, y).is_ok()))
        };
        let all_pixels = seen_pixels(&camera, &map);
        let pixels = all_pixels
            .iter()
            .filter(|(index, _, w, _)| w.z > LEAST_COS && is_inner(*index))
            .map(|&(index, at, w, _)| (index, at, w))
            .collect();
        let spots = lit_spots(&rig, stand, views.spot_deg());
        let all_lit: Vec<Option<Spot>> = spots.iter().map(|spot| spot.map(|(spot, _)| spot)).collect();
        let lit = all_lit
            .iter()
            .zip(&stand.directions)
            .map(|(lit, index)| lit.filter(|_| lights::direction(*index).z > LEAST_COS))
            .collect();
        Ok(Self {
            stand,
            exposure_s: views.exposure_s,
            lamp: [1.0, 0.0],
            channels: rig.channels(),
            saturation_dn: f64::from(rig.saturation_dn()),
            size_px: (width, height),
            judged: Judged::all(width * height, stand.directions.len()),
            pixels,
            all_pixels,
            lit,
            all_lit,
            lit_terms: spots
                .iter()
                .map(|spot| spot.map_or([0.0; PROJECTOR_TERMS], |(_, terms)| terms))
                .collect(),
            rig,
            patches: None,
            pairs: Vec::new(),
            dark: Vec::new(),
            saturated: 0,
            values: 0,
        })
    }

    /// The rig with the standard as it stood.
    pub(super) const fn rig(&self) -> &Rig {
        &self.rig
    }

    /// Takes the frames of the directions from the place `first` on. `black` is the black frame, linear; `standard` is what
    /// was in the holder, named `spec`.
    pub(super) fn add(
        &mut self,
        first: usize,
        frames: &[Lit],
        linear: &Linear,
        black: &[f64],
        standard: &dyn Sample,
        spec: &str,
    ) -> Result<(), CalibrateError> {
        let total = self.pixels.len() * self.stand.directions.len();
        let every = (total * self.channels / PAIRS).max(1);
        let gain = linear.camera.gain_e_per_dn;
        let noise = linear.camera.read_variance_dn2();
        for (place, frame) in (first..).zip(frames) {
            let Some((_, irradiance)) = self.lit[place] else {
                continue;
            };
            let wi = lights::direction(self.stand.directions[place]);
            let lobe = standard.incident(wi);
            let mut values = Vec::new();
            // Another start in each frame, so that all pixels take part.
            for &(index, _, wo) in self.pixels.iter().skip(place * 7 % every).step_by(every) {
                let f = lobe.f(wo);
                for channel in 0..self.channels {
                    let at = index * self.channels + channel;
                    let f = positive(self.f_of(f, channel), spec, wi, wo)?;
                    let dn = f64::from(frame.dn[at]);
                    self.values += 1;
                    self.saturated += u64::from(dn >= self.saturation_dn);
                    if !linear.trusts(dn) {
                        continue;
                    }
                    let (all, dark) = (linear.of(dn), black[at]);
                    // Of the frame, and of the mean of as many black ones as a segment has.
                    values.push(Value {
                        at,
                        signal: frame.spot(all, dark, at),
                        variance: noise + all.max(0.0) / gain + (noise + dark.max(0.0) / gain) / 16.0,
                        uniform: self.exposure_s * self.lamp[0] * f * irradiance,
                        lamp: all * f64::from(frame.lamp.uncertainty[channel]),
                        common: all * f64::from(frame.lamp.common[channel]),
                    });
                }
            }
            self.pair(place, &values);
        }
        Ok(())
    }

    /// Makes pairs of the `values` of a frame that are bright enough.
    fn pair(&mut self, place: usize, values: &[Value]) {
        let sum = |of: &dyn Fn(&Value) -> f64| values.iter().map(of).sum::<f64>();
        let scale = sum(&|value| value.signal) / sum(&|value| value.uniform);
        let is_clear = |value: &&Value| scale * value.uniform >= LEAST_SNR * value.variance.sqrt();
        // What is far below is off the standard, or not lit; a logarithm needs more than 0.
        let is_bright = |value: &&Value| value.signal > 0.1 * scale * value.uniform;
        let clear = values.iter().filter(is_clear);
        let dark = clear
            .clone()
            .filter(|value| !is_bright(value) && value.at % self.channels == 0);
        self.dark
            .extend(dark.map(|value| ((value.at / self.channels) as u32, place as u32)));
        let bright = clear.filter(is_bright);
        let count = bright.clone().count() as f64;
        self.pairs.extend(bright.map(|value| {
            let relative = value.variance / (value.signal * value.signal);
            let lamp = (value.lamp / value.signal).powi(2);
            Pair {
                pixel: (value.at / self.channels) as u32,
                place: place as u32,
                channel: (value.at % self.channels) as u8,
                // The mean of a logarithm lies half its variance too low.
                log: (value.signal / value.uniform).ln() + 0.5 * relative,
                variance: relative + lamp,
                weight: (relative + count * lamp + FIT * FIT).recip(),
                common: value.common / value.signal,
                area: Area::ALL,
                trust: 1.0,
            }
        }));
    }

    /// How many values were saturated, and of how many.
    pub(super) const fn saturated(&self) -> (u64, u64) {
        (self.saturated, self.values)
    }

    /// Whether light and pixel of a pair are wholly on the standard.
    fn takes_part(&self, pair: &Pair) -> bool {
        self.judged.pixels[pair.pixel as usize] && self.judged.places[pair.place as usize] && pair.area.is_lit
    }

    /// Whether spots at `place` take part in the fit, if they are wholly on the standard.
    pub(super) fn takes_part_of(&self, place: usize) -> bool {
        self.lit[place].is_some()
    }

    /// Whether the fit would use the same pairs if it were `before` that is on the standard.
    pub(super) fn takes_the_same(&self, before: &Judged) -> bool {
        let pixels = self.pixels.iter().map(|(index, ..)| *index);
        pixels
            .into_iter()
            .all(|index| before.pixels[index] == self.judged.pixels[index])
            && (0..self.lit.len())
                .filter(|place| self.lit[*place].is_some())
                .all(|place| before.places[place] == self.judged.places[place])
    }
}

/// `f` in sr⁻¹ of the standard named `spec`, which has light to show only if it is above 0.
///
/// # Errors
/// [`CalibrationError::Content`] with the directions.
pub(super) fn positive(f: f64, spec: &str, wi: DVec3, wo: DVec3) -> Result<f64, CalibrateError> {
    if f > 0.0 {
        return Ok(f);
    }
    Err(CalibrationError::Content {
        path: spec.to_owned(),
        field: format!(
            "standard, f at incident θ {:.1}° and outgoing θ {:.1}°",
            wi.z.acos().to_degrees(),
            wo.z.acos().to_degrees()
        ),
        expected: "a number above 0 in every direction that is seen; give another standard, or mend its file"
            .to_owned(),
        found: format!("{f}"),
    }
    .into())
}

/// What a row of least squares makes of what was `found`.
fn dot(row: &[f64], found: &DVector<f64>) -> f64 {
    row.iter().zip(found.iter()).map(|(a, b)| a * b).sum()
}
