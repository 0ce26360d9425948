//! How much of a pixel or of a spot of light the standard filled.
//!
//! # Design
//! A frame of the standard over what light and throughput say it should be is the share s of pixel and spot that the
//! standard filled: s = Σ g·p/var / Σ p²/var with the signal g and its prediction p, over the lit directions for a pixel, over
//! the pixels for a direction. What is not as predicted, beyond what noise and field leave uncertain, is off the sample: what is less
//! is cut, and what is more is cut less than it should be, so that nobody knows what is seen there. So is what lies beyond that, seen
//! from the normal: where its own edge should have ended it, a wrong edge may well seem right.
//!
//! The fields do not know that and would bend into the darkness. So they are fitted to what is whole, and what is whole is
//! judged by them, in turns (`turns`).

use glam::DVec3;
use rayon::prelude::*;

use super::frames::Frames;
use super::rank_one::{Fields, Seen, Spot};
use crate::brdf::sample::{Outgoing, Sample};
use crate::instrument::calibration::{BLIND, EDGE, SEEN, Sight, SmoothField, UNSEEN, lights};

/// A share is whole within so many of its standard uncertainties …
const CLEAR: f64 = 3.0;
/// … but at least within this, and at most within that.
const LEAST: f64 = 0.02;
const MOST: f64 = 0.5;
/// Within this θ every sample is seen, degrees.
pub(super) const NEAR_DEG: f64 = 52.0;
/// Before there are fields, what shines less than this share of the usual does not take part.
const DIM: f64 = 0.4;
/// Directions that judge a pixel, and pixels that judge a direction, about.
const LIGHTS: usize = 48;
const PIXELS: usize = 400;

/// What is wholly on the standard.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Judged {
    /// Of each pixel of the camera's image.
    pub(super) pixels: Vec<bool>,
    /// Of each place of the stand's directions.
    pub(super) places: Vec<bool>,
}

impl Judged {
    /// Everything, until more is known.
    pub(super) fn all(pixels: usize, places: usize) -> Self {
        Self {
            pixels: vec![true; pixels],
            places: vec![true; places],
        }
    }
}

/// Share and its relative variance.
#[derive(Clone, Copy, Default)]
struct Share {
    signal: f64,
    weight: f64,
}

impl Share {
    fn add(&mut self, signal: f64, predicted: f64, variance: f64) {
        self.signal += signal * predicted / variance;
        self.weight += predicted * predicted / variance;
    }

    /// Whether it is 1 within noise and the relative uncertainty of the prediction; not if nothing was predicted.
    fn is_whole(&self, relative: f64) -> bool {
        let margin = (CLEAR * (self.weight.recip() + relative * relative).sqrt()).clamp(LEAST, MOST);
        self.weight > 0.0 && (self.signal / self.weight - 1.0).abs() < margin
    }

    /// Whether it is more than `least`; not if nothing was predicted.
    fn is_above(&self, least: f64) -> bool {
        self.weight > 0.0 && self.signal / self.weight > least
    }
}

/// A pixel: its index, throughput, and direction.
type Through = (usize, f64, DVec3);

/// What the frames of a stand should show by light and throughput.
struct Judge<'a> {
    seen: &'a Seen<'a>,
    frames: &'a Frames<'a>,
    fields: &'a Fields,
    /// Of each place what a uniform camera of K = 1 would show over f, and how the standard returns it; `None` where no spot counts.
    lights: Vec<Option<(f64, Box<dyn Outgoing + 'a>)>>,
}

impl<'a> Judge<'a> {
    fn of(seen: &'a Seen<'a>, frames: &'a Frames<'a>, fields: &'a Fields) -> Self {
        let shown = |([x, y], irradiance): Spot| {
            seen.exposure_s * seen.lamp[0] * irradiance * fields.intensity.at(x, y)
        };
        let spots = seen.spots(frames.standard).into_iter();
        Self {
            seen,
            frames,
            fields,
            lights: spots
                .map(|spot| spot.map(|(spot, lobe)| (shown(spot), lobe)))
                .collect(),
        }
    }

    /// The share of `pairs` of places and pixels that the standard filled.
    fn share(&self, pairs: impl Iterator<Item = (usize, Through)>) -> Share {
        let seen = self.seen;
        let mut share = Share::default();
        for (place, (index, throughput, wo)) in pairs {
            let Some((shown, lobe)) = &self.lights[place] else {
                continue;
            };
            let f = lobe.f(wo);
            let scale = shown * throughput * seen.share(place, index);
            for channel in 0..seen.channels {
                if let Some((signal, variance)) =
                    Seen::signal(self.frames, place, index * seen.channels + channel)
                {
                    let predicted = scale * self.fields.sensitivity[channel] * seen.f_of(f, channel);
                    share.add(signal, predicted, variance);
                }
            }
        }
        share
    }
}

impl Seen<'_> {
    /// Whether each pixel of the image takes part and sees nothing but the standard.
    pub(super) fn whole_pixels(&self) -> Vec<bool> {
        let mut whole = vec![false; self.judged.pixels.len()];
        for (index, ..) in &self.pixels {
            whole[*index] = self.judged.pixels[*index];
        }
        whole
    }

    /// Signal and its variance by noise, in linear digital numbers, of one number of a frame; `None` if it saturated.
    fn signal(frames: &Frames, place: usize, at: usize) -> Option<(f64, f64)> {
        let lit = &frames.lit[place];
        let dn = f64::from(lit.dn[at]);
        if !frames.linear.trusts(dn) {
            return None;
        }
        let camera = &frames.linear.camera;
        let all = frames.linear.of(dn);
        let noise = camera.read_variance_dn2();
        Some((
            lit.spot(all, frames.black[at], at),
            noise + all.max(0.0) / camera.gain_e_per_dn,
        ))
    }

    /// f in sr⁻¹ of `channel`.
    pub(super) fn f_of(&self, f: [f64; 3], channel: usize) -> f64 {
        if self.channels == 1 {
            f.iter().sum::<f64>() / 3.0
        } else {
            f[channel]
        }
    }

    /// Places that judge pixels: whole ones that take part in the fit, spread over all.
    fn judges(&self) -> Vec<usize> {
        let whole: Vec<usize> = (0..self.all_lit.len())
            .filter(|place| self.judged.places[*place] && self.takes_part_of(*place))
            .collect();
        let every = (whole.len() / LIGHTS).max(1);
        whole.into_iter().step_by(every).collect()
    }

    /// The spot of each place, and how the `standard` returns its light; `None` where no spot counts.
    fn spots<'b>(&self, standard: &'b dyn Sample) -> Vec<Option<(Spot, Box<dyn Outgoing + 'b>)>> {
        let places = self.all_lit.iter().zip(&self.stand.directions);
        places
            .map(|(lit, index)| lit.map(|spot| (spot, standard.incident(lights::direction(*index)))))
            .collect()
    }

    /// Drops at once what is far dimmer than the usual.
    pub(super) fn drop_the_dim(&mut self, frames: &Frames) {
        let places = self.judges();
        let spots = self.spots(frames.standard);
        let rate = |place: usize, index: usize, wo: DVec3| {
            let ((_, irradiance), lobe) = spots[place].as_ref()?;
            let (signal, _) = Self::signal(frames, place, index * self.channels)?;
            Some(signal / (self.f_of(lobe.f(wo), 0) * irradiance))
        };
        let pixels: Vec<(usize, Option<f64>)> = self
            .pixels
            .par_iter()
            .map(|&(index, _, wo)| {
                (
                    index,
                    mean(places.iter().filter_map(|place| rate(*place, index, wo))),
                )
            })
            .collect();
        let every = (self.pixels.len() / PIXELS).max(1);
        let lights: Vec<(usize, Option<f64>)> = (0..self.all_lit.len())
            .into_par_iter()
            .map(|place| {
                let some = self.pixels.iter().step_by(every);
                (
                    place,
                    mean(some.filter_map(|&(index, _, wo)| rate(place, index, wo))),
                )
            })
            .collect();
        for (of, rates) in [
            (&mut self.judged.pixels, pixels),
            (&mut self.judged.places, lights),
        ] {
            let mut known: Vec<f64> = rates.iter().filter_map(|(_, rate)| *rate).collect();
            known.sort_by(f64::total_cmp);
            let usual = known.get(known.len() / 2).copied().unwrap_or(0.0);
            for (at, rate) in rates {
                of[at] = rate.is_none_or(|rate| rate > DIM * usual);
            }
        }
    }

    /// Of what is on the standard, keeps what is within `theta_deg` of the normal.
    pub(super) fn keep_within(&mut self, theta_deg: f64) {
        let least = theta_deg.to_radians().cos();
        for &(index, _, wo, _) in &self.all_pixels {
            self.judged.pixels[index] &= wo.z >= least;
        }
        for (is_whole, index) in self.judged.places.iter_mut().zip(&self.stand.directions) {
            *is_whole &= lights::direction(*index).z >= least;
        }
    }

    /// Judges by `fields` what is wholly on the standard: more than the share `least` of the prediction, or 1 within noise and
    /// fields if there is none.
    pub(super) fn judge(&mut self, frames: &Frames, fields: &Fields, least: Option<f64>) {
        let judge = Judge::of(self, frames, fields);
        let is_whole = |share: Share, field: &SmoothField, [x, y]: [f64; 2]| match least {
            Some(least) => share.is_above(least),
            None => share.is_whole(field.relative_uncertainty_at(x, y).hypot(fields.residual)),
        };
        let places = self.judges();
        let judged = self.all_pixels.par_iter().map(|&(index, o, wo, _)| {
            let throughput = fields.throughput.at(o[0], o[1]);
            let share = judge.share(places.iter().map(|&place| (place, (index, throughput, wo))));
            (index, is_whole(share, &fields.throughput, o))
        });
        let mut pixels = vec![true; self.judged.pixels.len()];
        for (index, is_whole) in judged.collect::<Vec<_>>() {
            pixels[index] = is_whole;
        }
        let whole: Vec<Through> = self
            .pixels
            .iter()
            .filter(|(index, ..)| pixels[*index])
            .map(|&(index, o, wo)| (index, fields.throughput.at(o[0], o[1]), wo))
            .collect();
        let every = (whole.len() / PIXELS).max(1);
        let lights: Vec<bool> = (0..self.all_lit.len())
            .into_par_iter()
            .map(|place| {
                let Some((p, _)) = self.all_lit[place] else {
                    return true;
                };
                let some = whole.iter().skip(place % every).step_by(every);
                let share = judge.share(some.map(|pixel| (place, *pixel)));
                is_whole(share, &fields.intensity, p)
            })
            .collect();
        drop(judge);
        if least.is_none() {
            self.keep_joined(&mut pixels);
        }
        self.judged.pixels = pixels;
        self.judged.places = lights;
    }

    /// Of the `pixels` that are whole, keeps those that whole ones join to where every sample is seen.
    fn keep_joined(&self, pixels: &mut [bool]) {
        let near = NEAR_DEG.to_radians().cos();
        let mut whole = vec![false; pixels.len()];
        for &(index, ..) in &self.all_pixels {
            whole[index] = pixels[index];
        }
        let from = self.all_pixels.iter().filter(|(.., wo, _)| wo.z >= near);
        let reached = reached(&whole, self.size_px.0, from.map(|(index, ..)| *index));
        for &(index, ..) in &self.all_pixels {
            pixels[index] = reached[index];
        }
    }

    /// What was seen, as files have it.
    pub(super) fn sight(&self) -> Sight {
        let (width, height) = self.size_px;
        let mut camera = vec![BLIND; width * height];
        for (index, _, _, at_edge) in &self.all_pixels {
            camera[*index] = match (self.judged.pixels[*index], at_edge) {
                (true, _) => SEEN,
                (false, true) => EDGE,
                (false, false) => UNSEEN,
            };
        }
        let mut incident = vec![BLIND; lights::LIGHTS];
        for ((index, lit), whole) in self
            .stand
            .directions
            .iter()
            .zip(&self.all_lit)
            .zip(&self.judged.places)
        {
            let of = &mut incident[*index];
            *of = match (*of, lit, whole) {
                (BLIND, None, _) => EDGE,
                (BLIND, Some(_), true) => SEEN,
                (BLIND, Some(_), false) => UNSEEN,
                // Lit again to fill the last segment.
                (before, ..) => before,
            };
        }
        Sight::new(self.stand.tilt, &camera, width, &incident)
    }
}

/// Which pixels of an image of this width, row by row, are reached `from` some over side by side `open` ones.
fn reached(open: &[bool], width: usize, from: impl Iterator<Item = usize>) -> Vec<bool> {
    let mut reached = vec![false; open.len()];
    let mut reach = |index: usize, to_go: &mut Vec<usize>| {
        if open[index] && !std::mem::replace(&mut reached[index], true) {
            to_go.push(index);
        }
    };
    let mut to_go = Vec::new();
    for index in from {
        reach(index, &mut to_go);
    }
    while let Some(index) = to_go.pop() {
        let x = index % width;
        let beside = [
            (x > 0).then(|| index - 1),
            (x + 1 < width).then_some(index + 1),
            index.checked_sub(width),
            Some(index + width).filter(|below| *below < open.len()),
        ];
        for next in beside.into_iter().flatten() {
            reach(next, &mut to_go);
        }
    }
    reached
}

fn mean(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (sum, count) = values.fold((0.0, 0_u32), |(sum, count), value| (sum + value, count + 1));
    (count > 0).then(|| sum / f64::from(count))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whole_is_what_is_as_predicted_and_no_more() {
        let share = |signal: f64, variance: f64| {
            let mut share = Share::default();
            share.add(signal, 100.0, variance);
            share
        };
        for (signal, variance, relative, whole) in [
            (100.0, 1.0, 0.0, true),
            (98.5, 1e-3, 0.0, true),
            (97.0, 1e-3, 0.0, false),
            (103.0, 1e-3, 0.0, false),
            (103.0, 1e-3, 0.02, true),
            (80.0, 100.0, 0.0, true),
            // What may be half or double tells nothing.
            (120.0, 100.0, 0.0, true),
            // What may be anything is not less than half.
            (60.0, 1e6, 0.0, true),
            (40.0, 1e6, 0.0, false),
        ] {
            assert_eq!(
                share(signal, variance).is_whole(relative),
                whole,
                "{signal} {variance} {relative}"
            );
        }
        assert!(!Share::default().is_whole(0.01));
    }

    #[test]
    fn beyond_darkness_nothing_is_reached() {
        let picture = ["###.#", "###.#", "##.##", "#..##"];
        let open: Vec<bool> = picture.concat().bytes().map(|pixel| pixel == b'#').collect();
        let found = reached(&open, 5, [0, 7].into_iter());
        let expected = ["###..", "###..", "##...", "#...."].concat();
        let expected: Vec<bool> = expected.bytes().map(|pixel| pixel == b'#').collect();
        assert_eq!(found, expected);
        // Nor over the end of a row into the next.
        assert_eq!(
            reached(&[false, true, true, false], 2, [1].into_iter()),
            [false, true, false, false]
        );
    }
}
