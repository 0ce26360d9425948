//! Which table is written.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use serde::Serialize;

use super::facets::Facets;
use super::table::{Table, Tried};
use crate::brdf::format::round_trip::RoundTrip;
use crate::brdf::format::{ExportError, Exporting, Resolution};

/// Points along each side of the half vectors, polar angles and azimuths of light, if nobody says otherwise: as few as leave an error of
/// some 0.1 % of a satin.
const SIDE: usize = 128;
const THETAS: usize = 31;
const PHIS: usize = 73;
/// The same of isotropic samples, whose files are small.
const ISOTROPIC_SIDE: usize = 192;
const ISOTROPIC_THETAS: usize = 61;
/// Largest side.
const MOST_SIDE: usize = 1024;
/// Sides of compact tables that are tried, and the one that is written where compact is wanted and nobody says how large.
const SIDES: [usize; 10] = [24, 32, 40, 48, 56, 64, 72, 80, 96, 112];
const COMPACT_SIDE: usize = 64;

/// See [`Candidate::is_as_good_as`].
const LARGEST: f64 = 2.0;

/// Share of the differences of a measurement that a compact table has within half of the standard uncertainty.
const WITHIN: f64 = 0.995;

/// How half vectors are tabulated.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Form {
    /// At equal steps of (u, v).
    Dense,
    /// Where the facets are that light and view see, scaled by their distribution.
    Compact,
    /// The tables of the tensor file that is exported.
    Own,
}

/// What was tabulated, and why so.
#[derive(Clone, Debug, Serialize)]
pub struct Tabulation {
    /// How half vectors are tabulated.
    pub form: Form,
    /// Points along each side of the half vectors.
    pub side: usize,
    /// Azimuths and polar angles of light.
    pub incident: [usize; 2],
    /// Why this form, in a sentence.
    pub why: String,
}

/// A table that is not written, or not yet: its bytes, and how far from its source it is expected to be.
struct Candidate {
    side: usize,
    bytes: u64,
    expected: RoundTrip,
}

impl Candidate {
    /// Whether median and largest of 99 % of the differences are no more than the other's, and the largest of all, which chance decides,
    /// no more than [`LARGEST`] times the other's.
    fn is_as_good_as(&self, other: &Self) -> bool {
        let all = |of: &Self| {
            let RoundTrip {
                median,
                below_99,
                largest,
                ..
            } = of.expected;
            Some([median?, below_99?, largest?])
        };
        match (all(self), all(other)) {
            (Some(of), Some([median, most, largest])) => {
                of[0] <= median && of[1] <= most && of[2] <= LARGEST * largest && self.is_within()
            }
            _ => false,
        }
    }

    /// Whether nearly all is far within the uncertainty of what is exported, if that states one; no more points than the most that are tried
    /// are asked for it.
    fn is_within(&self) -> bool {
        let share = self.expected.within_half_sigma;
        share.is_none_or(|share| share >= WITHIN) || SIDES.last().is_none_or(|most| self.side >= *most)
    }

    fn words(&self) -> String {
        let percent =
            |of: Option<f64>| of.map_or_else(|| "?".to_owned(), |of| format!("{:.2} %", 100.0 * of));
        format!(
            "{} a side, {:.1} MB, median {}, 99 % below {}",
            self.side,
            self.bytes as f64 / 1e6,
            percent(self.expected.median),
            percent(self.expected.below_99)
        )
    }
}

/// Incident directions of a size that `resolution` says, in a table without warp.
fn dense(exporting: &Exporting, resolution: Resolution) -> Result<Table, ExportError> {
    let is_isotropic = exporting.is_isotropic();
    let side = match resolution.side {
        0 if is_isotropic => ISOTROPIC_SIDE,
        0 => SIDE,
        side => side,
    };
    if !(2..=MOST_SIDE).contains(&side) {
        return Err(exporting.refused(
            "resolution",
            format!("2 to {MOST_SIDE} points a side"),
            side.to_string(),
        ));
    }
    let (thetas, phis) = if resolution.step_deg > 0.0 {
        let count = |of_deg: f64| (of_deg / resolution.step_deg).ceil().max(1.0) as usize + 1;
        (count(90.0), count(360.0))
    } else {
        (if is_isotropic { ISOTROPIC_THETAS } else { THETAS }, PHIS)
    };
    let share = |number: usize, count: usize| number as f64 / (count - 1) as f64;
    Ok(Table {
        phi_i: if is_isotropic {
            vec![0.0]
        } else {
            (0..phis).map(|n| share(n, phis).mul_add(TAU, -PI)).collect()
        },
        theta_i: (0..thetas).map(|n| share(n, thetas) * FRAC_PI_2).collect(),
        side,
        is_isotropic,
        facets: Facets::none(),
    })
}

impl Table {
    fn tabulation(&self, form: Form, why: String) -> Tabulation {
        Tabulation {
            form,
            side: self.side,
            incident: [self.phi_i.len(), self.theta_i.len()],
            why,
        }
    }
}

/// The smallest compact table that is as good as the `dense` one, or, if none is, the best of those of `usual` side.
struct Compact {
    table: Table,
    candidate: Candidate,
    is_as_good: bool,
}

impl Compact {
    fn of(
        exporting: &Exporting,
        resolution: Resolution,
        dense: &Candidate,
        facets: Vec<Facets>,
    ) -> Result<Option<Self>, ExportError> {
        let own = [resolution.side];
        let (sides, usual) = match resolution.side {
            0 => (SIDES.as_slice(), COMPACT_SIDE),
            side => (own.as_slice(), side),
        };
        let tables: Vec<Table> = facets
            .into_iter()
            .map(|facets| {
                let table = self::dense(exporting, resolution)?;
                Ok(Table { facets, ..table })
            })
            .collect::<Result<_, ExportError>>()?;
        let expected = if exporting.is_read_each_time() {
            all_at_once(exporting, &tables, sides)?
        } else {
            Vec::new()
        };
        let mut best: Option<Self> = None;
        for (way, mut table) in tables.into_iter().enumerate() {
            let trial = exporting.trial()?;
            let tried = expected.is_empty().then(|| Tried::of(&table, trial, sides));
            let mut found = None;
            for (number, side) in sides.iter().enumerate() {
                let candidate = Candidate {
                    side: *side,
                    bytes: table.bytes(*side),
                    expected: match &tried {
                        Some(tried) => tried.ask(exporting, trial, number)?,
                        None => expected[way][number],
                    },
                };
                // With a side that somebody asked for, the warp is all that it is larger by.
                let is_as_good =
                    candidate.is_as_good_as(dense) && (resolution.side > 0 || candidate.bytes < dense.bytes);
                if is_as_good || candidate.side == usual {
                    found = Some((candidate, is_as_good));
                }
                if is_as_good {
                    break;
                }
            }
            let Some((candidate, is_as_good)) = found else {
                continue;
            };
            table.side = candidate.side;
            let one = Self {
                table,
                candidate,
                is_as_good,
            };
            best = Some(match best {
                Some(best) if !one.is_better_than(&best) => best,
                _ => one,
            });
        }
        Ok(best)
    }

    fn is_better_than(&self, other: &Self) -> bool {
        let most = |of: &Self| of.candidate.expected.below_99.unwrap_or(f64::INFINITY);
        match (self.is_as_good, other.is_as_good) {
            (true, true) if self.candidate.side != other.candidate.side => {
                self.candidate.side < other.candidate.side
            }
            (of, others) if of == others => most(self) < most(other),
            (of, _) => of,
        }
    }
}

/// How far each of the `tables` with each of the `sides` is from its source, of which all entries are asked for together.
fn all_at_once(
    exporting: &Exporting,
    tables: &[Table],
    sides: &[usize],
) -> Result<Vec<Vec<RoundTrip>>, ExportError> {
    let trial = exporting.trial()?;
    let all: Vec<Tried> = tables
        .iter()
        .map(|table| Tried::of(table, trial, sides))
        .collect();
    let (mut asked, mut counts) = (Vec::new(), Vec::new());
    for tried in &all {
        for side in 0..sides.len() {
            let pairs = tried.asked(side);
            counts.push(pairs.len());
            asked.extend(pairs);
        }
    }
    let found = exporting.peek(&asked)?;
    let (mut rest, mut counts) = (found.as_slice(), counts.into_iter());
    let mut next = || {
        let (own, others) = rest.split_at(counts.next().unwrap_or(0));
        rest = others;
        own
    };
    let told = |tried: &Tried| -> Vec<RoundTrip> {
        let sides = 0..sides.len();
        sides.map(|side| tried.told(trial, side, next())).collect()
    };
    Ok(all.iter().map(told).collect())
}

/// The table that is written of what is exported.
pub(super) fn choose(
    exporting: &Exporting,
    resolution: Resolution,
) -> Result<(Table, Tabulation), ExportError> {
    let table = dense(exporting, resolution)?;
    if resolution.form == Some(Form::Dense) {
        let told = table.tabulation(Form::Dense, "it was asked for".to_owned());
        return Ok((table, told));
    }
    // One asking may be one reading of a file.
    exporting.progress.begin("choose a table", 3, "askings");
    let trial = exporting.trial()?;
    exporting.progress.reach(1);
    let tried = Tried::of(&table, trial, &[table.side]);
    let mut asked = tried.asked(0);
    let own = asked.len();
    asked.extend(Facets::asked(exporting.is_isotropic()));
    let found = exporting.peek(&asked)?;
    let (own, seen) = found.split_at(own);
    let known = Candidate {
        side: table.side,
        bytes: table.bytes(table.side),
        expected: tried.told(trial, 0, own),
    };
    exporting.progress.reach(2);
    let facets = Facets::all(exporting.is_isotropic(), seen);
    let compact = Compact::of(exporting, resolution, &known, facets)?;
    exporting.progress.reach(3);
    exporting.progress.end();
    let Some(compact) = compact else {
        let why = "nothing is thrown back, from which a warp could be made".to_owned();
        let told = table.tabulation(Form::Dense, why);
        return Ok((table, told));
    };
    let words = [known.words(), compact.candidate.words()];
    if compact.is_as_good || resolution.form == Some(Form::Compact) {
        let why = match compact.is_as_good {
            true if resolution.side > 0 => format!(
                "no worse than a dense table of as many points ({} against {})",
                words[1], words[0]
            ),
            true => format!(
                "as good as a dense table and smaller ({} against {})",
                words[1], words[0]
            ),
            false => format!("it was asked for ({} against {} dense)", words[1], words[0]),
        };
        let told = compact.table.tabulation(Form::Compact, why);
        return Ok((compact.table, told));
    }
    let why = format!(
        "no smaller one is as good ({} against {} compact)",
        words[0], words[1]
    );
    let told = table.tabulation(Form::Dense, why);
    Ok((table, told))
}
