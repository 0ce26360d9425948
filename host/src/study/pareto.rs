//! Error against the time on the instrument.
//!
//! # Design
//! A plan of measuring is worth what it reaches in its time. Of each draw of a rig, calibrated by its own commands, each sample and
//! each plan there is one [`Row`]: how long the instrument took, light and waiting included, and how far the result is from the sample in closed form or in
//! its file, by the figures of merit that everything else states too. Whoever runs the stages hands over what they answered
//! ([`Row::of`]); a stage that refused is a row with its sentence.

use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::path::Path;

use serde::Serialize;
use serde_json::Value;

use crate::base::median::median;
use crate::judge::chart::{Axis, Chart, ChartError, Curve};
use crate::store::whole_file::write_whole;
use crate::study::Psnr;

/// One measurement.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Row {
    /// Seed of the truth, the calibration and the measurement.
    pub draw: u64,
    /// The sample as it was named.
    pub sample: String,
    /// The options of `rcg measure`.
    pub plan: String,
    /// Why there is nothing else, if a stage refused.
    pub refused: Option<String>,
    /// Exposures, black ones included.
    pub exposures: Option<u64>,
    /// Seconds on the instrument.
    pub instrument_s: Option<f64>,
    /// Relative error over θ ≤ 80° both ways: median, and below which nine of ten lie.
    pub error_median: Option<f64>,
    /// See `error_median`.
    pub error_p90: Option<f64>,
    /// Share of what is scored that lies within k = 2 of its standard uncertainty.
    pub within_k2: Option<f64>,
    /// Share of the pairs of directions that are scored.
    pub scored_share: Option<f64>,
    /// Smallest PSNR of Y over the lights of the sampling study, dB.
    pub psnr_y_db: Option<f64>,
}

impl Row {
    /// Of what `rcg measure --json` answered, and how good pictures are.
    #[must_use]
    pub fn of(draw: u64, sample: &str, plan: &str, answer: &Value, psnr: &Psnr) -> Self {
        let against = &answer["evaluation"]["against_reference"];
        Self {
            exposures: answer["exposures"].as_u64(),
            instrument_s: answer["instrument_s"].as_f64(),
            error_median: against["relative_error"]["median"].as_f64(),
            error_p90: against["relative_error"]["p90"].as_f64(),
            within_k2: against["within_k2"].as_f64(),
            scored_share: against["scored_share"].as_f64(),
            psnr_y_db: psnr.psnr_y_db,
            ..Self::refused(draw, sample, plan, String::new())
        }
        .with_refused(None)
    }

    /// Of a stage that refused with this `sentence`.
    #[must_use]
    pub fn refused(draw: u64, sample: &str, plan: &str, sentence: String) -> Self {
        Self {
            draw,
            sample: sample.to_owned(),
            plan: plan.to_owned(),
            refused: Some(sentence),
            exposures: None,
            instrument_s: None,
            error_median: None,
            error_p90: None,
            within_k2: None,
            scored_share: None,
            psnr_y_db: None,
        }
    }

    fn with_refused(self, refused: Option<String>) -> Self {
        Self { refused, ..self }
    }
}

/// What a plan came to with a sample: medians over the draws.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Point {
    /// The sample as it was named.
    pub sample: String,
    /// The options of `rcg measure`.
    pub plan: String,
    /// Draws that gave a result, and that were refused.
    pub measured: usize,
    /// See `measured`.
    pub refused: usize,
    /// Seconds on the instrument.
    pub instrument_s: Option<f64>,
    /// Median relative error.
    pub error_median: Option<f64>,
    /// Share within k = 2 of the standard uncertainty.
    pub within_k2: Option<f64>,
    /// Smallest PSNR of Y, dB.
    pub psnr_y_db: Option<f64>,
    /// Whether no other plan of this sample took no longer and erred less.
    pub best: bool,
}

/// The outcome.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Pareto {
    /// The rig as it was named.
    pub rig: String,
    /// Factor from radiance under unit irradiance to the white of the pictures.
    pub exposure: f32,
    /// One per sample and plan, in the order of the rows.
    pub points: Vec<Point>,
    /// One per draw, sample and plan.
    pub rows: Vec<Row>,
}

impl Pareto {
    /// Of these rows.
    #[must_use]
    pub fn new(rig: &str, exposure: f32, rows: Vec<Row>) -> Self {
        let mut seen = BTreeSet::new();
        let pairs = rows.iter().map(|row| (row.sample.as_str(), row.plan.as_str()));
        let pairs: Vec<(&str, &str)> = pairs.filter(|pair| seen.insert(*pair)).collect();
        let mut points: Vec<Point> = pairs
            .into_iter()
            .map(|(sample, plan)| point(&rows, sample, plan))
            .collect();
        let reached: Vec<_> = points
            .iter()
            .map(|point| (point.sample.clone(), point.instrument_s.zip(point.error_median)))
            .collect();
        for (point, (sample, own)) in points.iter_mut().zip(&reached) {
            let Some(own) = own else { continue };
            let is_better = |(other, found): &(String, Option<(f64, f64)>)| {
                other == sample && found.is_some_and(|found| found.0 <= own.0 && found.1 < own.1)
            };
            point.best = !reached.iter().any(is_better);
        }
        Self {
            rig: rig.to_owned(),
            exposure,
            points,
            rows,
        }
    }

    /// Median error against time, one curve per sample.
    #[must_use]
    pub fn chart(&self) -> Chart {
        let reached = |point: &Point| point.instrument_s.zip(point.error_median);
        let mut names: Vec<&str> = self.points.iter().map(|point| point.sample.as_str()).collect();
        names.dedup();
        let curves = names.into_iter().map(|name| {
            let of_name = self.points.iter().filter(|point| point.sample == name);
            let mut points: Vec<_> = of_name
                .filter_map(reached)
                .map(|(s, error)| (s, Some(100.0 * error)))
                .collect();
            points.sort_by(|a, b| a.0.total_cmp(&b.0));
            Curve {
                label: name.to_owned(),
                points,
                band: Vec::new(),
            }
        });
        let all = self.points.iter().filter_map(reached);
        Chart {
            title: format!("error against time, rig {}", self.rig),
            x: Axis::decades("time on the instrument (s)", all.clone().map(|(s, _)| s), 6),
            y: Axis::decades(
                "median relative error (%)",
                all.map(|(_, error)| 100.0 * error),
                6,
            ),
            legend: "sample".to_owned(),
            marks: true,
            curves: curves.collect(),
        }
    }

    /// Writes `pareto.csv` (all rows), `pareto.json` and the chart (`pareto.svg`, `pareto.png`) into `dir`.
    ///
    /// # Errors
    /// [`ChartError`].
    pub fn save(&self, dir: &Path) -> Result<(), ChartError> {
        let json = serde_json::to_string_pretty(self).expect("invariant: plain data");
        write_whole(&dir.join("pareto.json"), json.as_bytes())?;
        write_whole(&dir.join("pareto.csv"), self.csv().as_bytes())?;
        self.chart().save_both(dir, "pareto")
    }

    /// All rows as a table.
    fn csv(&self) -> String {
        let quoted = |text: &str| format!("\"{}\"", text.replace('"', "\"\""));
        let number = |number: Option<f64>| number.map_or_else(String::new, |number| number.to_string());
        let mut table =
            "rig,draw,sample,plan,exposures,instrument_s,error_median,error_p90,within_k2,scored_share,\
                         psnr_y_db,refused\n"
                .to_owned();
        for row in &self.rows {
            let exposures = row.exposures.map_or_else(String::new, |count| count.to_string());
            let numbers = [
                row.instrument_s,
                row.error_median,
                row.error_p90,
                row.within_k2,
                row.scored_share,
                row.psnr_y_db,
            ];
            writeln!(
                table,
                "{},{},{},{},{exposures},{},{}",
                quoted(&self.rig),
                row.draw,
                quoted(&row.sample),
                quoted(&row.plan),
                numbers.map(number).join(","),
                row.refused.as_deref().map_or_else(String::new, quoted)
            )
            .expect("strings take everything");
        }
        table
    }
}

/// What `plan` came to with `sample` in these rows.
fn point(rows: &[Row], sample: &str, plan: &str) -> Point {
    let of_it = || rows.iter().filter(|row| row.sample == sample && row.plan == plan);
    let of = |value: fn(&Row) -> Option<f64>| median(of_it().filter_map(value).collect());
    let refused = of_it().filter(|row| row.refused.is_some()).count();
    Point {
        sample: sample.to_owned(),
        plan: plan.to_owned(),
        measured: of_it().count() - refused,
        refused,
        instrument_s: of(|row| row.instrument_s),
        error_median: of(|row| row.error_median),
        within_k2: of(|row| row.within_k2),
        psnr_y_db: of(|row| row.psnr_y_db),
        best: false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn row(draw: u64, plan: &str, instrument_s: f64, error: f64) -> Row {
        let answer = json!({
            "exposures": 100,
            "instrument_s": instrument_s,
            "evaluation": { "against_reference": {
                "relative_error": { "median": error, "p90": 3.0 * error },
                "within_k2": 0.96,
                "scored_share": 1.0,
            }},
        });
        let psnr = Psnr {
            psnr_y_db: Some(40.0),
            psnr_cb_db: None,
            psnr_cr_db: None,
            exact: false,
            scored_share: 1.0,
        };
        Row::of(draw, "a \"b\"", plan, &answer, &psnr)
    }

    #[test]
    fn points_are_medians_and_the_best_are_those_that_no_other_beats() {
        let rows = vec![
            row(1, "quick", 5.0, 0.02),
            row(2, "quick", 5.0, 0.04),
            row(3, "quick", 5.0, 0.03),
            Row::refused(4, "a \"b\"", "quick", "too dark".to_owned()),
            row(1, "slow", 60.0, 0.01),
            row(1, "wasteful", 61.0, 0.03),
        ];
        let found = Pareto::new("rcg-3", 3.0, rows);
        let quick = &found.points[0];
        assert_eq!((quick.measured, quick.refused), (3, 1));
        assert!((quick.error_median.unwrap() - 0.03).abs() < 1e-12);
        let best: Vec<bool> = found.points.iter().map(|point| point.best).collect();
        assert_eq!(best, [true, true, false]);
        let table = found.csv();
        assert!(
            table.contains("\"rcg-3\",1,\"a \"\"b\"\"\",\"quick\",100,5,0.02,0.06,0.96,1,40,\n"),
            "{table}"
        );
        assert!(
            table.contains("4,\"a \"\"b\"\"\",\"quick\",,,,,,,,\"too dark\"\n"),
            "{table}"
        );
        let dir = tempfile::tempdir().unwrap();
        found.save(dir.path()).unwrap();
        for name in ["pareto.csv", "pareto.json", "pareto.svg", "pareto.png"] {
            assert!(dir.path().join(name).is_file(), "{name}");
        }
    }
}
