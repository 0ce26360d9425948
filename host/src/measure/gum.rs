//! The budget of uncertainty as the GUM has it: for a pair of directions, and for a region of them.
//!
//! # Design
//! Of each cause: the standard uncertainty u(x) of an input quantity x, the sensitivity c = ∂f/∂x, and the contribution c·u(x) to that of f
//! (JCGM 100:2008, 5.1). The contributions are those that assembly adds, of the samples that it is asked for (`assemble/probe`); where the
//! calibration knows u(x) by itself (reflectance of the standard, angles, degree of polarisation) c follows from it, and where f is
//! proportional to x, c is f. What remains is stated in units of f.

use std::fmt::Write as _;
use std::path::Path;

use serde::Serialize;

use super::MeasureError;
use super::again::{To, assembled};
use super::budget::aligned;
use crate::assemble::share::Share;
use crate::assemble::{Probe, Probed};
use crate::base::progress::Progress;
use crate::base::text::quoted;
use crate::brdf::cause::{Cause, KINDS};
use crate::brdf::{Brdf, RegionBudget};
use crate::capture::directory::Measurement;
use crate::hemisphere::direction::{angle_between, from_degrees, to_degrees};
use crate::hemisphere::disk::Disk;
use crate::instrument::calibration::AppliedCalibration;

/// Coverage factor of the expanded uncertainty.
const K: f64 = 2.0;
/// Causes whose input quantities are of the unit of f, so that c is 1.
const ADDED: [&str; 4] = ["noise", "stray light", "blur", "crosstalk"];

/// One row of the table.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Row {
    /// The cause.
    #[serde(flatten)]
    pub cause: Cause,
    /// Standard uncertainty (k = 1) of its input quantity.
    pub standard_uncertainty: f64,
    /// The unit of that.
    pub unit: &'static str,
    /// ∂f/∂x in the unit of f over that unit.
    pub sensitivity: f64,
    /// Its contribution to the standard uncertainty of f, in the unit of f.
    pub contribution: f64,
    /// Share of the variance of f.
    pub share: f64,
}

/// The table of one value, or of a region.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Budget {
    /// What it is of, in words.
    pub of: String,
    /// Number of the channel; `None` for all.
    pub channel: Option<usize>,
    /// What that is called, see [`crate::brdf::Brdf::channel_labels`]; empty if it is alone and nobody says.
    pub band: String,
    /// f; 1 for a region, whose uncertainties are relative.
    pub value: f64,
    /// Unit of value and contributions.
    pub unit: &'static str,
    /// By cause; none that contributes nothing.
    pub rows: Vec<Row>,
    /// Combined standard uncertainty (k = 1).
    pub combined: f64,
    /// Expanded uncertainty.
    pub expanded: f64,
    /// Coverage factor of that.
    pub coverage_factor: f64,
}

impl Budget {
    fn new(
        of: String,
        channel: Option<usize>,
        (value, unit): (f64, &'static str),
        mut rows: Vec<Row>,
    ) -> Self {
        let variance: f64 = rows.iter().map(|row| row.contribution.powi(2)).sum();
        for row in &mut rows {
            row.share = row.contribution.powi(2) / variance;
        }
        rows.retain(|row| row.contribution > 0.0);
        Self {
            of,
            channel,
            band: String::new(),
            value,
            unit,
            rows,
            combined: variance.sqrt(),
            expanded: K * variance.sqrt(),
            coverage_factor: K,
        }
    }

    /// That of a `region` of directions: relative to f, geometric mean of its values; `None` if these are no more than noise.
    #[must_use]
    pub fn of_region(region: &RegionBudget) -> Option<Self> {
        let span = |[from, to]: [f64; 2]| format!("{from:.0} to {to:.0}°");
        let rows = KINDS.iter().zip(&region.shares).map(|(cause, share)| {
            let contribution = region.relative * share.sqrt();
            Row {
                cause: *cause,
                standard_uncertainty: contribution,
                unit: "of f",
                sensitivity: 1.0,
                contribution,
                share: *share,
            }
        });
        region.relative.is_finite().then(|| {
            Self::new(
                format!(
                    "values with light from {} and view to {}",
                    span(region.incident_deg),
                    span(region.outgoing_deg)
                ),
                None,
                (1.0, "of f"),
                rows.collect(),
            )
        })
    }
}

/// The budgets, by channel, of the samples nearest to `pairs` of light and view (polar angle and azimuth, degrees); none of one that has no
/// value. `scratch` is a folder for what is made on the way.
///
/// # Errors
/// [`MeasureError`].
pub fn at(
    measurement: &Measurement,
    pairs: &[[(f64, f64); 2]],
    scratch: &Path,
    progress: &dyn Progress,
) -> Result<Vec<Vec<Budget>>, MeasureError> {
    let disk = Disk::new(measurement.plan.request.image_size as usize);
    let grid = &measurement.directions.grid;
    let samples: Vec<Option<[usize; 2]>> = pairs
        .iter()
        .map(|pair| nearest(measurement, &disk, *pair))
        .collect();
    let probe = Probe::new(samples.iter().flatten().copied().collect());
    let to = To {
        out: &scratch.join("brdf.zarr"),
        probe: Some(&probe),
        share: Share::Whole,
    };
    assembled(measurement, None, to, progress)?;
    let applied = AppliedCalibration::read(measurement.dir()).map_err(Box::new)?;
    let known = Known::of(&applied, measurement.rig.light.polarisation);
    let labels = Brdf::open(&scratch.join("brdf.zarr"))?.channel_labels();
    let budgets = |[incident, cell]: [usize; 2], found: &[Probed]| {
        let light = grid.angles_deg(incident);
        let view = disk.direction(cell).map_or((f64::NAN, f64::NAN), to_degrees);
        let of = format!(
            "f with light from ({:.2}°, {:.2}°) and view to ({:.2}°, {:.2}°)",
            light.0, light.1, view.0, view.1
        );
        let budget = |one: &Probed| Budget {
            band: labels[one.channel].clone(),
            ..known.budget(of.clone(), one)
        };
        found.iter().map(budget).collect()
    };
    let mut found = probe.found().into_iter();
    let of = |sample: Option<[usize; 2]>| match sample.and_then(|sample| Some((sample, found.next()?))) {
        Some((sample, found)) => budgets(sample, &found),
        None => Vec::new(),
    };
    Ok(samples.into_iter().map(of).collect())
}

/// The incident direction that can be lit and the cell of the `disk`, by index, nearest to a pair of light and view, degrees.
fn nearest(measurement: &Measurement, disk: &Disk, pair: [(f64, f64); 2]) -> Option<[usize; 2]> {
    let directions = &measurement.directions;
    let [wi, wo] = pair.map(|(theta, phi)| from_degrees(theta, phi));
    let lit = (0..directions.grid.len()).filter(|index| directions.reasons[*index].is_none());
    let incident = lit.min_by(|a, b| {
        let apart = |index: &usize| angle_between(directions.grid.direction(*index), wi);
        apart(a).total_cmp(&apart(b))
    });
    let cells = disk.neighbours(wo).into_iter().flatten();
    let cell = cells.max_by(|a, b| a.1.total_cmp(&b.1));
    incident.zip(cell).map(|(incident, (cell, _))| [incident, cell])
}

/// Standard uncertainties of input quantities that the calibration knows; 0 where it does not.
struct Known {
    standard: f64,
    direction_deg: f64,
    polarisation: f64,
}

impl Known {
    fn of(applied: &AppliedCalibration, polarisation: f64) -> Self {
        let [camera, projector] = applied.direction_deg;
        Self {
            standard: applied.photometry.as_ref().map_or(
                0.0,
                crate::instrument::calibration::Photometry::uncertainty_by_standard,
            ),
            // The stated angle is that of both axes together.
            direction_deg: f64::midpoint(camera * camera, projector * projector).sqrt(),
            polarisation,
        }
    }

    fn budget(&self, of: String, probed: &Probed) -> Budget {
        let f = f64::from(probed.f);
        let rows = KINDS.iter().zip(probed.variances).map(|(cause, variance)| {
            let contribution = f64::from(variance).sqrt();
            let (standard_uncertainty, unit, sensitivity) = self.input(cause, contribution, f, probed);
            Row {
                cause: *cause,
                standard_uncertainty,
                unit,
                sensitivity,
                contribution,
                share: 0.0,
            }
        });
        Budget::new(of, Some(probed.channel), (f, "1/sr"), rows.collect())
    }

    /// u(x), its unit, and ∂f/∂x of a `cause`, which makes `contribution` of f.
    fn input(&self, cause: &Cause, contribution: f64, f: f64, probed: &Probed) -> (f64, &'static str, f64) {
        let known = match cause.name {
            "standard" => Some((self.standard, "relative")),
            "directions" => Some((self.direction_deg, "°")),
            "polarisation" => Some((self.polarisation, "1")),
            _ => None,
        };
        if let Some((u, unit)) = known.filter(|(u, _)| *u > 0.0) {
            return (u, unit, contribution / u);
        }
        let factor = if cause.name == "interreflection" {
            f64::from(probed.returned)
        } else {
            f
        };
        if ADDED.contains(&cause.name) || factor == 0.0 {
            (contribution, "1/sr", 1.0)
        } else {
            (contribution / factor.abs(), "relative", factor.abs())
        }
    }
}

/// Heads of the columns.
const HEADS: [&str; 7] = [
    "source",
    "type",
    "u(x)",
    "unit",
    "c = ∂f/∂x",
    "|c|·u(x)",
    "share of u²",
];

/// The tables as text.
#[must_use]
pub fn text(budgets: &[Budget]) -> String {
    let mut all = String::new();
    for budget in budgets {
        let channel = match (budget.channel, budget.band.as_str()) {
            (None, _) => String::new(),
            (Some(channel), "") => format!(", channel {channel}"),
            (Some(channel), band) => format!(", channel {channel}, {band}"),
        };
        writeln!(
            all,
            "{}{channel}: {:.5e} {}, standard uncertainty {:.3e} ({:.2} %), expanded {:.3e} (k = {})",
            budget.of,
            budget.value,
            budget.unit,
            budget.combined,
            100.0 * budget.combined / budget.value.abs(),
            budget.expanded,
            budget.coverage_factor
        )
        .expect("strings take everything");
        let mut heads: Vec<String> = HEADS.map(str::to_owned).into();
        heads.push("shared by".to_owned());
        let rows = budget.rows.iter().map(|row| {
            let mut cells: Vec<String> = cells(row).into();
            cells.push(row.cause.shared_by.to_owned());
            cells
        });
        all.push_str(&aligned(&std::iter::once(heads).chain(rows).collect::<Vec<_>>()));
    }
    all
}

fn cells(row: &Row) -> [String; 7] {
    [
        row.cause.name.to_owned(),
        row.cause.evaluation.to_owned(),
        format!("{:.3e}", row.standard_uncertainty),
        row.unit.to_owned(),
        format!("{:.3e}", row.sensitivity),
        format!("{:.3e}", row.contribution),
        format!("{:.1} %", 100.0 * row.share),
    ]
}

/// The tables as CSV: one line per cause, value and combined uncertainty repeated.
#[must_use]
pub fn csv(budgets: &[Budget]) -> String {
    let mut all = "of,channel,band,value,unit,source,quantity,type,standard_uncertainty_of_source,unit_of_source,sensitivity,contribution,\
                   share_of_variance,shared_by,combined_standard_uncertainty,expanded_uncertainty,coverage_factor\n"
        .to_owned();
    for budget in budgets {
        let channel = budget
            .channel
            .map_or_else(String::new, |channel| channel.to_string());
        for row in &budget.rows {
            writeln!(
                all,
                "\"{}\",{channel},{},{:e},{},{},\"{}\",\"{}\",{:e},{},{:e},{:e},{:.6},\"{}\",{:e},{:e},{}",
                budget.of,
                quoted(&budget.band),
                budget.value,
                budget.unit,
                row.cause.name,
                row.cause.quantity,
                row.cause.evaluation,
                row.standard_uncertainty,
                row.unit,
                row.sensitivity,
                row.contribution,
                row.share,
                row.cause.shared_by,
                budget.combined,
                budget.expanded,
                budget.coverage_factor
            )
            .expect("strings take everything");
        }
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::brdf::CAUSES;

    fn probed() -> Probed {
        let place = |name: &str| CAUSES.iter().position(|cause| *cause == name).unwrap();
        let mut variances = [0.0; CAUSES.len()];
        variances[0] = 9e-6;
        variances[place("standard")] = 16e-6;
        variances[4] = 1e-6;
        variances[place("interreflection")] = 4e-6;
        Probed {
            channel: 1,
            f: 0.2,
            returned: 0.01,
            variances,
        }
    }

    #[test]
    fn contributions_are_sensitivity_times_uncertainty_and_sum_to_the_combined_one() {
        let known = Known {
            standard: 0.025,
            direction_deg: 0.0,
            polarisation: 0.0,
        };
        let budget = known.budget("a pair".to_owned(), &probed());
        assert_eq!(budget.rows.len(), 4);
        assert!((budget.combined - 30e-6_f64.sqrt()).abs() < 1e-9);
        let mut shares = 0.0;
        for row in &budget.rows {
            let product = row.sensitivity * row.standard_uncertainty;
            assert!((product / row.contribution - 1.0).abs() < 1e-9, "{row:?}");
            shares += row.share;
        }
        assert!((shares - 1.0).abs() < 1e-9);
        let by = |name: &str| budget.rows.iter().find(|row| row.cause.name == name).unwrap();
        // A sample as bright as the standard is as uncertain as that, by 2 %; c is what it would be of 2.5 %.
        assert!((by("standard").sensitivity - 0.16).abs() < 1e-9);
        assert!((by("light and throughput").sensitivity - 0.2).abs() < 1e-6);
        assert!((by("interreflection").standard_uncertainty - 0.2).abs() < 1e-6);
        assert_eq!(by("noise").unit, "1/sr");
        assert_eq!(csv(std::slice::from_ref(&budget)).lines().count(), 5);
        assert_eq!(text(&[budget]).lines().count(), 6);
    }

    #[test]
    fn a_region_is_stated_relative_to_its_values() {
        let mut shares = vec![0.0; CAUSES.len()];
        (shares[0], shares[7]) = (0.36, 0.64);
        let region = RegionBudget {
            incident_deg: [0.0, 30.0],
            outgoing_deg: [30.0, 60.0],
            relative: 0.01,
            shares,
            shared: 0.0,
        };
        let budget = Budget::of_region(&region).unwrap();
        assert!(
            (budget.combined - 0.01).abs() < 1e-12 && (budget.rows[1].contribution - 0.008).abs() < 1e-12
        );
        assert!(budget.of.contains("0 to 30°"), "{}", budget.of);
    }
}
