//! What two results say of the same pairs of directions.

use glam::{DMat3, DVec3};

use crate::brdf::reflectance::Reflectance;
use crate::brdf::{Brdf, BrdfError, CAUSES, Source};
use crate::hemisphere::direction::to_degrees;
use crate::hemisphere::judged::is_judged;
use crate::judge::evaluate::scoring::seen_by;
use crate::store::provenance::Provenance;

/// Pairs of directions that are looked up, about.
const ASKED: usize = 200_000;
/// How far to both sides the slope along the azimuth is found, degrees.
const SLOPE_DEG: f64 = 2.0;

/// Incident and outgoing unit vectors.
type Directions = (DVec3, DVec3);

/// Both results at one pair of directions, per channel.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pair {
    /// Incident and outgoing unit vectors.
    pub(super) directions: Directions,
    /// The first result.
    pub(super) a: Side,
    /// The second.
    pub(super) b: Side,
    /// Standard uncertainty of the difference in sr⁻¹ by how both lay.
    pub(super) by_azimuth: [f64; 3],
}

/// What one result says of a pair.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Side {
    /// f in sr⁻¹.
    pub(super) f: [f64; 3],
    /// Its standard uncertainty (k = 1) in sr⁻¹.
    pub(super) sigma: [f64; 3],
    /// Shares of the variance by noise, and by the standard.
    pub(super) noise: f64,
    /// See `noise`.
    pub(super) standard: f64,
}

/// All pairs that were found, of those that were `asked`.
pub(super) struct Pairs {
    pub(super) pairs: Vec<Pair>,
    pub(super) asked: usize,
}

/// The measured pairs of `b` that are judged, spread evenly, and what `a` has there.
pub(super) fn of(a: &Source, b: &Brdf) -> Result<Pairs, BrdfError> {
    let seconds = seconds(b)?;
    let directions: Vec<Directions> = seconds.iter().map(|(pair, _)| *pair).collect();
    let channels = b.channels();
    let firsts = firsts(a, &directions, channels)?;
    let of_a = match a {
        Source::Measured(brdf) => brdf.azimuth().standard_uncertainty_deg,
        Source::Known(_) => None,
    };
    let turn_deg = of_a
        .unwrap_or(0.0)
        .hypot(b.azimuth().standard_uncertainty_deg.unwrap_or(0.0));
    let slopes = if turn_deg > 0.0 {
        slopes(a.reflectance(), &directions)?
    } else {
        vec![[0.0; 3]; directions.len()]
    };
    let asked = seconds.len();
    let pairs = seconds
        .into_iter()
        .zip(firsts)
        .zip(slopes)
        .filter_map(|(((directions, b), a), slope)| {
            Some(Pair {
                directions,
                a: a?,
                b,
                by_azimuth: seen_by(slope, channels).map(|per_deg| per_deg * turn_deg),
            })
        })
        .collect();
    Ok(Pairs { pairs, asked })
}

/// Judged pairs of `b` with a measured value, by a fixed stride.
fn seconds(b: &Brdf) -> Result<Vec<(Directions, Side)>, BrdfError> {
    let (cells, channels) = (b.disk().len(), b.channels());
    let outgoing: Vec<(usize, DVec3)> = (0..cells)
        .filter_map(|cell| Some((cell, b.disk().direction(cell).filter(|wo| is_judged(*wo))?)))
        .collect();
    let lit = (0..b.grid().len()).filter(|&row| is_judged(b.grid().direction(row)));
    // Odd, so that it does not stay in step with rows of an even number.
    let stride = (lit.count() * outgoing.len()).div_ceil(ASKED) | 1;
    let (mut all, mut place) = (Vec::new(), 0_usize);
    for chunk in 0..b.chunks() {
        let Some(rows) = b.chunk(chunk)? else { continue };
        for (row, index) in b.chunk_range(chunk).enumerate() {
            let wi = b.grid().direction(index);
            if !is_judged(wi) {
                continue;
            }
            for &(cell, wo) in &outgoing {
                place += 1;
                let origin = Provenance::from_code(rows.provenance[row * cells + cell]);
                if !place.is_multiple_of(stride) || !origin.is_some_and(Provenance::is_seen) {
                    continue;
                }
                let at = (row * cells + cell) * channels;
                let each =
                    |of: &dyn Fn(usize) -> f64| [0, 1, 2].map(|channel| of(at + channel.min(channels - 1)));
                let f = each(&|at| f64::from(rows.f[at]));
                let sigma = each(&|at| rows.sigma[at].to_f64());
                all.push(((wi, wo), side(Some(b), (wi, wo), f, sigma)));
            }
        }
    }
    Ok(all)
}

/// What `a` says of the pairs to a camera of so many `channels`; `None` where it has no measured value. Colours are as uncertain
/// together as if they were off alike.
fn firsts(a: &Source, directions: &[Directions], channels: usize) -> Result<Vec<Option<Side>>, BrdfError> {
    Ok(match a {
        Source::Measured(brdf) => {
            let stated = brdf.stated(directions)?.into_iter().zip(directions);
            stated
                .map(|(stated, pair)| {
                    let stated = stated.ok().filter(|stated| stated.provenance.is_seen())?;
                    let [f, sigma] = [stated.f, stated.sigma].map(|of| seen_by(of.map(f64::from), channels));
                    Some(side(Some(brdf), *pair, f, sigma))
                })
                .collect()
        }
        Source::Known(_) => {
            let values = a.reflectance().values(directions)?.into_iter().zip(directions);
            values
                .map(|(f, pair)| {
                    let f = seen_by(f.ok()?.map(f64::from), channels);
                    f.iter()
                        .all(|f| f.is_finite())
                        .then(|| side(None, *pair, f, [0.0; 3]))
                })
                .collect()
        }
    })
}

/// A value of `brdf` with what its budget says of the region.
fn side(brdf: Option<&Brdf>, (wi, wo): Directions, f: [f64; 3], sigma: [f64; 3]) -> Side {
    let [theta_i, theta_o] = [wi, wo].map(|w| to_degrees(w).0);
    let region = brdf.and_then(|brdf| brdf.region(theta_i, theta_o));
    let share = |name: &str| {
        let cause = CAUSES.iter().position(|cause| *cause == name);
        let share = region.zip(cause).map(|(region, cause)| region.shares[cause]);
        share.unwrap_or(0.0).clamp(0.0, 1.0)
    };
    Side {
        f,
        sigma,
        noise: share("noise"),
        standard: share("standard"),
    }
}

/// By how much f changes along the azimuth, sr⁻¹ per degree; 0 where `a` has no values to both sides.
pub(in crate::judge) fn slopes(
    a: &dyn Reflectance,
    directions: &[Directions],
) -> Result<Vec<[f64; 3]>, BrdfError> {
    let turned = |deg: f64| {
        let turn = DMat3::from_rotation_z(deg.to_radians());
        let pairs: Vec<_> = directions
            .iter()
            .map(|(wi, wo)| (turn * *wi, turn * *wo))
            .collect();
        a.values(&pairs)
    };
    let (after, before) = (turned(SLOPE_DEG)?, turned(-SLOPE_DEG)?);
    let both = after.into_iter().zip(before);
    Ok(both
        .map(|both| match both {
            (Ok(after), Ok(before)) => [0, 1, 2]
                .map(|channel| f64::from(after[channel] - before[channel]) / (2.0 * SLOPE_DEG))
                .map(|slope| if slope.is_finite() { slope.abs() } else { 0.0 }),
            _ => [0.0; 3],
        })
        .collect())
}
