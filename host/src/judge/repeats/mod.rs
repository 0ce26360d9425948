//! Repeats: several measurements of one sample, how they scatter, and which is none of them.
//!
//! # Design
//! Repeats have the same directions, cells and channels, so nothing is interpolated. What was filled in has no part. All is streamed,
//! chunk by chunk.
//!
//! | file | holds |
//! |---|---|
//! | `origins` | which parts of σ repeats have in common |
//! | `scan` | the same samples of all repeats |
//! | `scatter` | how they scatter, against what they state |
//! | `departures` | how each departs from the others, and outliers |
//! | `drift` | how their brightness goes with time |

mod departures;
mod drift;
pub(crate) mod origins;
pub(crate) mod scan;
pub(crate) mod scatter;
#[cfg(test)]
mod tests;

use std::path::Path;

use serde::Serialize;

use crate::base::blame::Blame;
use crate::base::date::unix_s;
use crate::brdf::{Brdf, BrdfError, UNCALIBRATED, evidence};
use crate::capture::session::{Record, SessionError};
use crate::judge::compare::check_azimuth;
use crate::judge::evaluate::repeat::check_directions;

pub(crate) use departures::Departures;
pub use departures::{Departure, Outlier};
pub(crate) use drift::DAY_S;
pub use drift::Drift;
pub use scatter::Scatter;

use origins::{Origins, Parts};
use scatter::Tallies;

/// Why measurements cannot be taken together.
#[derive(Debug, thiserror::Error)]
pub enum RepeatError {
    /// A file, or what differs between two.
    #[error(transparent)]
    Brdf(#[from] BrdfError),
    /// When it was measured.
    #[error(transparent)]
    Session(#[from] SessionError),
}

impl Blame for RepeatError {
    fn is_input(&self) -> bool {
        match self {
            Self::Brdf(error) => error.is_input(),
            Self::Session(error) => error.is_input(),
        }
    }
}

/// One of several measurements of a sample.
#[derive(Debug)]
pub struct Repeat {
    /// As it was named.
    pub name: String,
    /// Its values.
    pub brdf: Brdf,
    /// When it began, as RFC 3339 writes it; `None` if nobody said so.
    pub began: Option<String>,
}

impl Repeat {
    /// Opens the `brdf.zarr` at `path` under a `name`; when it was measured stands beside it, in the measurement's `session.json`.
    ///
    /// # Errors
    /// [`RepeatError`].
    pub fn open(name: &str, path: &Path) -> Result<Self, RepeatError> {
        let brdf = Brdf::open(path)?;
        let is_own = path.file_name().is_some_and(|name| name == "brdf.zarr");
        let dir = path.parent().filter(|_| is_own);
        let record = dir.map(Record::read).transpose()?.flatten();
        let began = record.and_then(|record| Some(record.sessions.first()?.began.clone()));
        Ok(Self {
            name: name.to_owned(),
            brdf,
            began: began.filter(|began| unix_s(began).is_some()),
        })
    }
}

/// Refuses measurements that are not repeats of one another: other directions, another φ = 0, other lit cones, calibrated otherwise, or
/// the same capture twice.
///
/// # Errors
/// [`BrdfError`] with the file, the field, what was expected and what was found.
pub fn check_alike(repeats: &[Repeat]) -> Result<(), BrdfError> {
    for other in repeats {
        let (first, brdf) = (&repeats[0].brdf, &other.brdf);
        check_directions(first, brdf)?;
        check_azimuth(first, brdf)?;
        let stated = |brdf: &Brdf| match brdf.uncalibrated() {
            None => "nothing said".to_owned(),
            Some(parts) if parts.is_empty() => "nothing".to_owned(),
            Some(parts) => parts.join(", "),
        };
        let fields = [
            (
                "spot_deg",
                first.spot_deg().to_string(),
                brdf.spot_deg().to_string(),
            ),
            (UNCALIBRATED, stated(first), stated(brdf)),
        ];
        if let Some((field, expected, found)) = fields.into_iter().find(|(_, a, b)| a != b) {
            return Err(BrdfError::Content {
                path: brdf.path().display().to_string(),
                field,
                expected: format!("{expected} as in {}", first.path().display()),
                found,
            });
        }
    }
    evidence::captures_of(&brdfs(repeats))?;
    Ok(())
}

fn brdfs(repeats: &[Repeat]) -> Vec<&Brdf> {
    repeats.iter().map(|repeat| &repeat.brdf).collect()
}

/// Each of `repeats`, as a whole against the one of that number, or against the mean of all.
pub(crate) fn members(repeats: &[Repeat], departures: &Departures, reference: Option<usize>) -> Vec<Member> {
    let member = |(number, repeat): (usize, &Repeat)| Member {
        name: repeat.name.clone(),
        began: repeat.began.clone(),
        departures: departures.against(number, reference),
    };
    repeats.iter().enumerate().map(member).collect()
}

/// How `repeats` depart from one another.
pub(crate) fn departures(repeats: &[Repeat]) -> Result<Departures, BrdfError> {
    let all = brdfs(repeats);
    let parts: Vec<Parts> = all.iter().map(|brdf| Parts::of(brdf)).collect();
    Departures::of(&all, &parts, &Origins::of(&all))
}

/// One repeat among the others.
#[derive(Clone, Debug, Serialize)]
pub struct Member {
    /// As it was named.
    pub name: String,
    /// When it began; `None` if nobody said so.
    pub began: Option<String>,
    /// By channel: as a whole, against the mean of all, over the directions that all have and know well; `None` of too few.
    pub departures: Vec<Option<Departure>>,
}

/// How repeats agree.
#[derive(Clone, Debug, Serialize)]
pub struct Repeats {
    /// Each.
    pub members: Vec<Member>,
    /// Whether all have one calibration for sure: what is wrong with it is common to all.
    pub one_calibration: bool,
    /// Whether all have one standard for sure.
    pub one_standard: bool,
    /// Pairs of directions by how many repeats have them, from one on.
    pub by_count: Vec<u64>,
    /// How they scatter, by region and channel.
    pub scatter: Vec<Scatter>,
    /// By channel, the change over time; empty if it is not known of all when they were measured, or it was at one time.
    pub drift: Vec<Drift>,
    /// Those that are none.
    pub outliers: Vec<Outlier>,
    /// What is to be known of it, in sentences.
    pub warnings: Vec<String>,
    #[serde(skip)]
    pub(crate) parts: Vec<Parts>,
    #[serde(skip)]
    pub(crate) origins: Origins,
    #[serde(skip)]
    pub(crate) tallies: Tallies,
    /// See [`Departures::level_variances`].
    #[serde(skip)]
    pub(crate) level_variances: Vec<Vec<f64>>,
}

impl Repeats {
    /// Of at least two repeats that are alike.
    ///
    /// # Errors
    /// [`BrdfError`] if a file cannot be read.
    pub fn of(repeats: &[Repeat]) -> Result<Self, BrdfError> {
        let all = brdfs(repeats);
        let parts: Vec<Parts> = all.iter().map(|brdf| Parts::of(brdf)).collect();
        let origins = Origins::of(&all);
        let tallies = Tallies::of(&all, &parts, &origins)?;
        let departures = Departures::of(&all, &parts, &origins)?;
        let numbers: Vec<usize> = (0..all.len()).collect();
        let members = members(repeats, &departures, None);
        let mut found = Self {
            drift: drift_of(&members),
            members,
            one_calibration: origins.one_calibration,
            one_standard: origins.one_standard,
            by_count: tallies.by_count.clone(),
            scatter: tallies.table(),
            outliers: departures.outliers(&numbers),
            warnings: Vec::new(),
            level_variances: departures.level_variances(),
            parts,
            origins,
            tallies,
        };
        found.warnings = warnings(&found, departures.pairs);
        Ok(found)
    }

    /// An outlier in words: where it is off, by how much, and by how much it may be.
    #[must_use]
    pub fn told(&self, outlier: &Outlier) -> String {
        let place = outlier
            .region
            .map_or_else(|| "as a whole".to_owned(), |region| region.name());
        let channel = if self.members[0].departures.len() > 1 {
            [" in red", " in green", " in blue"][outlier.channel.min(2)]
        } else {
            ""
        };
        let Departure {
            relative,
            standard_uncertainty,
            ..
        } = outlier.departure;
        format!(
            "{:+.2} % ± {:.2} % (k = 1) from the mean of the others ({place}{channel})",
            100.0 * relative,
            100.0 * standard_uncertainty
        )
    }
}

/// Days since the first of these members began; `None` if one does not say when.
pub(crate) fn days_of(members: &[Member]) -> Option<Vec<f64>> {
    let seconds: Vec<f64> = members
        .iter()
        .map(|member| Some(unix_s(member.began.as_deref()?)? as f64))
        .collect::<Option<_>>()?;
    let first = seconds.iter().copied().fold(f64::INFINITY, f64::min);
    Some(seconds.iter().map(|seconds| (seconds - first) / DAY_S).collect())
}

/// The change of members over time, by channel.
pub(crate) fn drift_of(members: &[Member]) -> Vec<Drift> {
    let Some(days) = days_of(members) else {
        return Vec::new();
    };
    let channels = 0..members[0].departures.len();
    let lines: Option<Vec<Drift>> = channels
        .map(|channel| {
            let each: Vec<Departure> = members
                .iter()
                .map(|member| member.departures[channel])
                .collect::<Option<_>>()?;
            let values: Vec<f64> = each.iter().map(|one| one.relative).collect();
            // Two values do not tell how they scatter: what they state does.
            let own = |one: &Departure| {
                if each.len() > 2 {
                    one.noise
                } else {
                    one.standard_uncertainty
                }
            };
            let noise = each.iter().map(own).fold(0.0, f64::max);
            // A departure from the mean of all has less noise than one value.
            let noise = noise * (each.len() as f64 / (each.len() - 1).max(1) as f64).sqrt();
            Drift::of(&days, &values, noise)
        })
        .collect();
    lines.unwrap_or_default()
}

fn warnings(found: &Repeats, pairs: u64) -> Vec<String> {
    let mut warnings = Vec::new();
    if found.scatter.is_empty() {
        warnings.push(format!(
            "repeats: none, {pairs} pairs of directions with θ ≤ 80° both ways were measured in all files, too few to tell how they scatter"
        ));
    }
    let larger = found.scatter.iter().filter(|one| one.is_larger).count();
    if larger > 0 {
        warnings.push(format!(
            "repeats: in {larger} of {} regions and channels they scatter by more than they state; σ there is as much larger",
            found.scatter.len()
        ));
    }
    let undated = found
        .members
        .iter()
        .filter(|member| member.began.is_none())
        .count();
    if undated > 0 {
        warnings.push(format!(
            "drift: none, {undated} of {} measurements do not say when they were made (session.json beside brdf.zarr)",
            found.members.len()
        ));
    }
    if found.drift.iter().any(|drift| drift.is_significant == Some(true)) {
        warnings.push("drift: the brightness goes with time, which no mean of repeats takes away".to_owned());
    }
    warnings
}
