//! Which target stands in the holder, told by one view.
//!
//! # Design
//! A flat mirror shows stripes, the wide ones clearly in coarse and blurred images too; a diffuse standard mixes them, and an empty holder
//! shows none. A match of camera and projector says which normal the mirror has, halfway between what both see; the median over a view is how
//! it stands, and how far its matches miss by it whether it is a mirror at all. This takes the nominal rig, which a workshop misses by a
//! few degrees: enough to tell one tilt from another.
//!
//! Images may be turned against the rig file (`orientation`). Of all ways those that make one mirror of each view are possible, then
//! those by which the mirrors stood in the views before as stated, then those that turn least. Two ways may be mirror images of each other
//! by which mirrors stand at other azimuths: what is nearer to the rig file is taken. Somebody may keep a view all the same;
//! what is found in the end judges.

use std::cmp::Ordering;
use std::f64::consts::PI;

use glam::DVec3;

use super::capture::{Capturing, SPOT_DEG};
use super::orientation::{Sights, sights};
use super::sightings::{Match, Sightings};
use crate::base::median::median;
use crate::calibrate::CalibrateError;
use crate::hemisphere::direction::{angle_between, from_degrees, to_degrees};
use crate::instrument::optics::cone_sr;
use crate::instrument::optics::reflect;
use crate::instrument::rig::Rig;
use crate::store::Segment;

/// Angle in degrees up to which a mirror stands as stated beside those of the views before, and by the rig file alone.
const STANDS_DEG: f64 = 5.0;
const ALONE_DEG: f64 = 11.0;
/// The same by the rig file where views are there already: somebody may have kept one that stood farther off.
const KEPT_DEG: f64 = 22.0;
/// Median angle in radians up to which matches are those of one mirror.
const MIRROR_RAD: f64 = 0.2;
/// A way round of the images that misses by more than so many times the least, and this beside, is not the right one.
const WORSE: f64 = 3.0;
const SLACK_RAD: f64 = 0.02;
/// Fewest matches of a mirror.
const FEWEST: usize = 30;
/// Matches of each view that are asked, at most.
const ASKED: usize = 150;
/// Share of the image's pixels that a diffuse standard lights at least, and the share of the brightest above which one is lit.
const FILLS: f64 = 0.03;
const LIT: f32 = 0.2;
/// Light over its noise, at least, of anything, and over that of a diffuse surface of reflectance 0.5.
const CLEAR: f64 = 5.0;
const EMPTY: f64 = 0.02;
/// The same of the brightest pixel of what a mirror shows.
const PEAK: f64 = 0.3;

/// What was found in the views so far.
pub(super) struct Stands {
    /// Matches of each view of the mirror that is there.
    views: Vec<Option<Vec<Match>>>,
}

/// How the mirror stands in one view by one way round of the images.
struct Stood {
    normal: DVec3,
    /// Median angle by which matches miss by it, radians.
    missed_rad: f64,
    /// By how much the views before have their normals otherwise than stated, on average.
    shift: DVec3,
    /// How far it may stand otherwise than stated beside that, and in all, degrees.
    tolerance_deg: f64,
    farthest_deg: f64,
}

impl Stands {
    /// Of the views that are there already: all but the `missing` ones.
    pub(super) fn new(capturing: &Capturing, missing: &[usize]) -> Result<Self, CalibrateError> {
        let mut stands = Self {
            views: vec![None; capturing.views.tilts.len()],
        };
        let Some(raw) = &capturing.raw else {
            return Ok(stands);
        };
        for view in (0..stands.views.len()).filter(|view| !missing.contains(view)) {
            stands.take(capturing, view, &raw.read_segment(view)?);
        }
        Ok(stands)
    }

    /// Takes the view of this index for one in which the target stands.
    pub(super) fn take(&mut self, capturing: &Capturing, view: usize, taken: &Segment) {
        if let Some(known) = self.views.get_mut(view) {
            *known = Some(matches_of(capturing, view, taken));
        }
    }

    /// What seems to stand in the holder in place of the target of the view of this index, if it does.
    pub(super) fn doubt(&self, capturing: &Capturing, view: usize, taken: &Segment) -> Option<String> {
        let frames = Sightings::frames(
            taken,
            capturing.rig.frame_format().len(),
            capturing.rig.channels(),
        );
        let sentence = |expected: &str, found: String| Some(format!("expected {expected}, found {found}"));
        let Some(&[tilt_deg, azimuth_deg]) = capturing.views.tilts.get(view) else {
            let light = Light::of(&frames, &capturing.rig, taken, cone_sr(SPOT_DEG));
            tracing::debug!(?light, "diffuse standard");
            return match light.looks() {
                Looks::Diffuse => None,
                looks => sentence("the diffuse standard", looks.words().to_owned()),
            };
        };
        let expected = format!("a mirror at {tilt_deg}° / {azimuth_deg}°");
        let matches = matches_of(capturing, view, taken);
        let found = self.mirror(capturing, view, &matches);
        let light = Light::of(&frames, &capturing.rig, taken, PI);
        tracing::debug!(view, matches = matches.len(), ?light, "mirror");
        let Some(stood) = found else {
            let looks = match light.looks() {
                Looks::Spot => "neither a mirror nor a standard that could be told".to_owned(),
                looks => looks.words().to_owned(),
            };
            return sentence(&expected, looks);
        };
        let stated = from_degrees(tilt_deg, azimuth_deg);
        let off_deg = angle_between(stood.normal, stated).to_degrees();
        let beside_deg = angle_between(stood.normal - stood.shift, stated).to_degrees();
        tracing::debug!(view, off_deg, beside_deg, stood.missed_rad, "mirror stands");
        if off_deg <= stood.farthest_deg && beside_deg <= stood.tolerance_deg {
            return None;
        }
        let (tilt_deg, azimuth_deg) = to_degrees(stood.normal);
        sentence(
            &expected,
            format!(
                "one at about {tilt_deg:.0}° / {:.0}°",
                azimuth_deg.rem_euclid(360.0)
            ),
        )
    }

    /// How the mirror stands that shows these `matches` in the view of this index; `None` if they are none of a mirror.
    fn mirror(&self, capturing: &Capturing, view: usize, matches: &[Match]) -> Option<Stood> {
        if matches.len() < FEWEST {
            return None;
        }
        // The view itself first, then those that are known.
        let mut all = matches.to_vec();
        let mut ends = vec![all.len()];
        let mut stated = Vec::new();
        for (other, known) in self.views.iter().enumerate() {
            if let Some(known) = known.as_ref().filter(|_| other != view) {
                all.extend(known);
                ends.push(all.len());
                let [tilt_deg, azimuth_deg] = capturing.views.tilts[other];
                stated.push(from_degrees(tilt_deg, azimuth_deg));
            }
        }
        let [of_camera, of_projector] = sights(&capturing.rig, &all);
        let mut ways: Vec<([f64; 3], Stood)> = Vec::new();
        for (camera, outs) in &of_camera {
            for (projector, lits) in &of_projector {
                let turned = f64::from(u8::from(camera.is_any()) + u8::from(projector.is_any()));
                if let Some((others, stood)) = explained(outs, lits, &ends, &stated) {
                    ways.push(([others, turned, stood.missed_rad], stood));
                }
            }
        }
        let least_rad = ways.iter().map(|(rank, _)| rank[2]).fold(f64::INFINITY, f64::min);
        ways.retain(|(rank, _)| rank[2] <= WORSE * least_rad + SLACK_RAD);
        let best = ways
            .into_iter()
            .min_by(|(one, _), (other, _)| one.partial_cmp(other).unwrap_or(Ordering::Equal));
        best.map(|(_, stood)| stood)
    }
}

/// How the mirror stands in the first of the views whose matches end at `ends`, and whether the others, 0 or 1, stand otherwise than
/// `stated`; `None` if one of the views is none of a mirror.
fn explained(outs: &Sights, lits: &Sights, ends: &[usize], stated: &[DVec3]) -> Option<(f64, Stood)> {
    let mut first: Option<Stood> = None;
    let (mut others, mut shifts) = (0.0, Vec::new());
    let mut start = 0;
    for (at, end) in ends.iter().enumerate() {
        let stood = stood(&outs[start..*end], &lits[start..*end])?;
        start = *end;
        match at.checked_sub(1) {
            None => first = Some(stood),
            Some(other) => {
                if angle_between(stood.normal, stated[other]).to_degrees() > KEPT_DEG {
                    others = 1.0;
                }
                shifts.push(stood.normal - stated[other]);
            }
        }
    }
    let mut first = first?;
    // What the rig file is off by turns all mirrors alike.
    if !shifts.is_empty() && others == 0.0 {
        first.shift = shifts.iter().sum::<DVec3>() / shifts.len() as f64;
        first.tolerance_deg = STANDS_DEG;
        first.farthest_deg = KEPT_DEG;
    }
    Some((others, first))
}

/// How a mirror stands in which the camera and the projector see in these directions; `None` if it is none.
fn stood(outs: &[Option<DVec3>], lits: &[Option<DVec3>]) -> Option<Stood> {
    let seen = || {
        outs.iter()
            .zip(lits)
            .filter_map(|(out, lit)| Some(((*out)?, (*lit)?)))
    };
    let middle = |axis: usize| {
        median(
            seen()
                .map(|(out, lit)| (out + lit).normalize_or_zero()[axis])
                .collect(),
        )
    };
    let normal = DVec3::new(middle(0)?, middle(1)?, middle(2)?).normalize_or_zero();
    let missed = seen().map(|(out, lit)| (-reflect(out, normal)).distance(lit));
    let missed: Vec<f64> = missed.collect();
    let is_most = missed.len() * 2 > outs.len();
    let missed_rad = median(missed).filter(|rad| is_most && *rad < MIRROR_RAD)?;
    Some(Stood {
        normal,
        missed_rad,
        shift: DVec3::ZERO,
        tolerance_deg: ALONE_DEG,
        farthest_deg: ALONE_DEG,
    })
}

/// Some of the matches of a view.
fn matches_of(capturing: &Capturing, view: usize, taken: &Segment) -> Vec<Match> {
    Sightings::coarse(&capturing.views, capturing.rig.frame_format(), view, taken, ASKED)
}

/// What the first two frames of a view show: lit, and dark.
#[derive(Clone, Copy, Debug)]
struct Light {
    /// The brighter pixels' over the noise of a pixel.
    over_noise: f64,
    /// The same over what a diffuse surface of reflectance 0.5 shows on the nominal rig.
    of_diffuse: f64,
    /// The same of the brightest pixel.
    peak_of_diffuse: f64,
    /// Share of the pixels that are lit.
    fills: f64,
}

/// What it looks like.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Looks {
    Diffuse,
    /// Light in few pixels.
    Spot,
    Nothing,
}

impl Looks {
    const fn words(self) -> &'static str {
        match self {
            Self::Diffuse => "something diffuse, such as a standard",
            Self::Spot => "light in a part of the image only, as a mirror has",
            Self::Nothing => "next to nothing: an empty holder, or one that is not lit",
        }
    }
}

impl Light {
    /// Of the `frames` of a view of `taken`, where `lit_sr` of the sky is lit, weighted by the cosine.
    fn of(frames: &[Vec<f32>], rig: &Rig, taken: &Segment, lit_sr: f64) -> Self {
        let light: Vec<f32> = frames[0]
            .iter()
            .zip(&frames[1])
            .map(|(lit, dark)| lit - dark)
            .collect();
        let mut sorted = light.clone();
        sorted.sort_unstable_by(f32::total_cmp);
        let bright = sorted[sorted.len() * 98 / 100];
        // Neighbours differ by noise.
        let steps = light.windows(2).map(|pair| f64::from((pair[1] - pair[0]).abs()));
        let noise = 1.05 * median(steps.collect()).unwrap_or(0.0);
        let lit = light.iter().filter(|light| **light > LIT * bright).count();
        let exposure_s = taken.records.first().map_or(0.0, |record| record.exposure_s);
        let irradiance = rig.projector.irradiance * lit_sr * exposure_s;
        let diffuse_dn = 0.5 / PI * rig.sensitivity_e() * irradiance / rig.gain_e_per_dn();
        Self {
            over_noise: f64::from(bright) / noise.max(0.5),
            of_diffuse: f64::from(bright) / diffuse_dn,
            peak_of_diffuse: f64::from(sorted[sorted.len() - 1]) / diffuse_dn,
            fills: lit as f64 / light.len() as f64,
        }
    }

    fn looks(self) -> Looks {
        let is_dim = self.over_noise < CLEAR || self.of_diffuse < EMPTY;
        if is_dim && self.peak_of_diffuse < PEAK {
            Looks::Nothing
        } else if is_dim || self.fills < FILLS {
            Looks::Spot
        } else {
            Looks::Diffuse
        }
    }
}
