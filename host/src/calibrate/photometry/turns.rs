//! Turns of fitting and judging, until nothing changes.
//!
//! # Design
//! Light and throughput are fitted to what the standard wholly fills, and that is judged by them (`share`). The first turns grow
//! outwards from the normal, where every sample is seen, with fields that are held smooth: what falls away from how they go on is not
//! whole. What part of the standard is seen begins at the height that was searched for, which little near the normal tells, and is
//! fitted along in the turns after that. Where it does not settle nothing is known.

use super::frames::Frames;
use super::rank_one::{Fields, Held, Seen, fit, unknown_axes, with_heights};
use super::share::{Judged, NEAR_DEG};
use crate::instrument::calibration::{SeenPart, UNKNOWNS, Unknowns};

/// Turns of fitting and judging, at most.
const TURNS: usize = 12;
/// Up to which θ in degrees the turns before them reach, and how little of its prediction is whole then.
const GROWTH_DEG: [f64; 6] = [NEAR_DEG, 60.0, 66.0, 72.0, 76.0, 80.0];
const GROWTH_LEAST: f64 = 0.8;
/// In one turn what part of the standard is seen changes by so many tolerances at most: what edges do is linear over a part of a
/// millimetre only, what falloff does is nearly.
const FARTHEST: Unknowns = [0.15, 0.15, 0.15, 0.4, 0.4, 1.0];
/// It stands still where it changes by less than so many tolerances, or than this share of what it is uncertain by.
const STILL: f64 = 0.02;
const WITHIN: f64 = 1.0;
/// Turns in a row in which it stands still that are enough.
const ENOUGH: usize = 4;
/// Steps that turn back are made so much shorter, down to this share of them.
const SHORTER: f64 = 0.5;
const SHORTEST: f64 = 0.05;

/// What part of the standard is seen and lit, on the way to where it is found.
struct Search {
    part: SeenPart,
    /// The last step, in tolerances.
    last: Unknowns,
    /// How much of a step is gone.
    reach: f64,
    /// Of how many fits, the last ones, each found it where it was.
    still: usize,
}

impl Search {
    const fn from(part: SeenPart) -> Self {
        Self {
            part,
            last: [0.0; UNKNOWNS],
            reach: 1.0,
            still: 0,
        }
    }

    /// Goes on by what a fit of the `fields` found, if it looked for it.
    fn step(&mut self, fields: &Fields) {
        let Some((by, covariance)) = fields.part else {
            return;
        };
        let back: f64 = by.iter().zip(self.last).map(|(by, last)| by * last).sum();
        self.reach = if back < 0.0 {
            (SHORTER * self.reach).max(SHORTEST)
        } else {
            (self.reach / SHORTER).min(1.0)
        };
        let farthest = by.iter().zip(FARTHEST).map(|(by, most)| most / by.abs());
        let share = self.reach * farthest.fold(1.0, f64::min);
        self.last = by.map(|by| share * by);
        let is_still = (0..UNKNOWNS).all(|at| {
            let known = covariance[at][at]
                .sqrt()
                .hypot(SeenPart::LEFT[at] / SeenPart::TOLERANCES[at]);
            self.last[at].abs() < STILL.max(WITHIN * known)
        });
        self.still = if is_still { self.still + 1 } else { 0 };
        self.part = self
            .part
            .moved(&self.last)
            // Where steps were made shorter it is not known better than what the last one was.
            .with_covariance(|row, column| covariance[row][column] + by[row] * by[column]);
    }
}

/// Why there are no fields.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum NoFields {
    /// What is whole does not determine them.
    TooLittle,
    /// What part of the standard is seen is found elsewhere in every turn.
    Unsettled,
}

/// What a fit leaves, relative, RMS, where no further one is tried.
const LITTLE: f64 = 7.5e-3;

/// Fields, and with them what part of the standard was seen and lit, if the rig says anything of that.
type Found = (Fields, Option<SeenPart>);

/// Fields from what is whole of all that was `seen`, and what that is; `frames` are those of each stand. Of the heights of the standard
/// that explain what is lit, the one that leaves least.
///
/// # Errors
/// [`NoFields`].
pub(super) fn fit_whole(seen: &mut [Seen], frames: &[Frames]) -> Result<Found, NoFields> {
    let Some(part) = SeenPart::of(seen[0].rig()) else {
        return fit_from(seen, frames, None);
    };
    let left = |found: &Result<Found, NoFields>| {
        found
            .as_ref()
            .map_or(f64::INFINITY, |(fields, _)| fields.residual)
    };
    let begun = seen.to_vec();
    let mut best: Option<(f64, Result<Found, NoFields>, Vec<Seen>)> = None;
    for part in with_heights(&begun, part) {
        let mut tried = begun.clone();
        let begins = part.offset_m;
        let found = fit_from(&mut tried, frames, Some(part));
        let left = left(&found);
        tracing::debug!(?begins, left, "standard's height");
        if best.as_ref().is_none_or(|(least, ..)| left < *least) {
            best = Some((left, found, tried));
        }
        if left <= LITTLE {
            break;
        }
    }
    let (_, found, tried) = best.expect("invariant: the best heights are always there");
    put(seen, tried);
    found
}

/// The same where the search for what part of the standard is seen begins at `part`.
fn fit_from(seen: &mut [Seen], frames: &[Frames], part: Option<SeenPart>) -> Result<Found, NoFields> {
    set_part(seen, part.as_ref());
    for (seen, frames) in seen.iter_mut().zip(frames) {
        seen.drop_the_dim(frames);
    }
    for theta_deg in GROWTH_DEG {
        let before: Vec<Judged> = seen.iter().map(|seen| seen.judged.clone()).collect();
        for seen in seen.iter_mut() {
            seen.keep_within(theta_deg);
        }
        // What is near to the normal says too little of edges.
        let Some(fields) = fit(seen, Held::Smooth, None) else {
            // Nothing is lit so near to the normal: not yet.
            for (seen, before) in seen.iter_mut().zip(before) {
                seen.judged = before;
            }
            continue;
        };
        for (seen, frames) in seen.iter_mut().zip(frames) {
            seen.judge(frames, &fields, Some(GROWTH_LEAST));
        }
    }
    let mut search = part.map(Search::from);
    // What comes and goes at the edges may bend some of the fits.
    let mut best: Option<(Found, Vec<Seen>)> = None;
    for _ in 0..TURNS {
        let fields = fit_with(seen, &mut search)?;
        let before: Vec<Judged> = seen.iter().map(|seen| seen.judged.clone()).collect();
        for (seen, frames) in seen.iter_mut().zip(frames) {
            seen.judge(frames, &fields, None);
        }
        let mut pairs = seen.iter().zip(&before);
        let is_same = pairs.all(|(seen, before)| seen.takes_the_same(before));
        // At the edge of what is whole a pixel may come and go for ever.
        let (is_still, is_found) = search.as_ref().map_or((is_same, is_same), |search| {
            let is_still = search.still > 0;
            (is_still, search.still >= ENOUGH || is_same && is_still)
        });
        let left = fields.residual;
        tracing::debug!(left, is_still, "turn");
        let found = (fields, search.as_ref().map(|search| search.part.clone()));
        if is_found && left <= LITTLE {
            return Ok(found);
        }
        if is_still && best.as_ref().is_none_or(|((best, _), _)| left < best.residual) {
            best = Some((found, seen.to_vec()));
        }
        if is_same && is_found {
            break;
        }
    }
    if let Some((found, best)) = best {
        put(seen, best);
        return Ok(found);
    }
    let fields = fit_with(seen, &mut search)?;
    match search {
        Some(search) if search.still == 0 => Err(NoFields::Unsettled),
        search => Ok((fields, search.map(|search| search.part))),
    }
}

/// Puts what was seen so into the place of `seen`.
fn put<'a>(seen: &mut [Seen<'a>], so: Vec<Seen<'a>>) {
    for (seen, so) in seen.iter_mut().zip(so) {
        *seen = so;
    }
}

/// Takes what is seen and lit for as in `part`, if anything is known of it.
fn set_part(seen: &mut [Seen], part: Option<&SeenPart>) {
    if let Some(part) = part {
        let aside = unknown_axes(seen);
        for seen in seen {
            seen.set_part(part, &aside);
        }
    }
}

/// Fits the fields, and goes on with the `search` for the part of the sample that is seen.
fn fit_with(seen: &mut [Seen], search: &mut Option<Search>) -> Result<Fields, NoFields> {
    let from = search
        .as_ref()
        .map(|search| search.part.beside_nominal(seen[0].rig()));
    let fields = fit(seen, Held::Loosely, from.as_ref()).ok_or(NoFields::TooLittle)?;
    if let Some(search) = search {
        search.step(&fields);
        for (stand, seen) in seen.iter_mut().enumerate() {
            seen.set_trust(&fields, stand);
        }
        set_part(seen, Some(&search.part));
    }
    Ok(fields)
}
