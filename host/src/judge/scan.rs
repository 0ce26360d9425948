//! Reflectance along a circle of outgoing directions: f against the azimuth φr at one polar angle θr.
//!
//! # Design
//! The way in which figure 16 of the RCG paper shows a cloth: one curve per incident direction, θr fixed. A
//! direction without a value is a gap in the curve and has its reason in the table. The table of a measurement has the standard
//! uncertainty of each value and where it is from.

use std::fmt::Write as _;
use std::path::Path;

use glam::DVec3;

use crate::brdf::reflectance::{Reflectance, Value};
use crate::brdf::{Source, Stated};
use crate::hemisphere::direction::from_degrees;
use crate::judge::chart::{Axis, Chart, ChartError, Curve, Scale};
use crate::judge::quantity::Quantity;
use crate::store::StoreError;

/// Incident directions of the paper's figure 16: polar angle and azimuth in degrees.
pub const INCIDENT_DEG: [(f64, f64); 3] = [(30.0, 0.0), (30.0, 45.0), (30.0, 90.0)];
/// Outgoing polar angle of that figure in degrees.
pub const THETA_R_DEG: f64 = 30.0;

/// f along the circle.
#[derive(Clone, Debug)]
pub struct AzimuthScan {
    /// Polar angle of all outgoing directions in degrees.
    pub theta_r_deg: f64,
    /// Azimuths of the outgoing directions in degrees, 0 to 360, both included.
    pub phi_r_deg: Vec<f64>,
    /// What is stated.
    pub quantity: Quantity,
    /// Per incident direction its angles (θ, φ) in degrees and that at each azimuth.
    pub curves: Vec<((f64, f64), Vec<Value>)>,
    /// Where φ = 0 lies on the sample, in words, if the source says so.
    zero: Option<String>,
    /// As that, what a measurement states of f; nothing of other sources.
    stated: Vec<Vec<Option<Stated>>>,
}

/// Finds f of pairs of directions (incident, outgoing).
type Find<'a> = dyn FnMut(&[(DVec3, DVec3)]) -> Result<Vec<Value>, StoreError> + 'a;

impl AzimuthScan {
    /// Looks the `quantity` of `source` up at `steps` + 1 azimuths from 0 to 360°, for each of `incident_deg` (θ, φ in degrees).
    ///
    /// # Errors
    /// [`StoreError`] if the BRDF cannot be read.
    pub fn new(
        source: &Source,
        quantity: Quantity,
        incident_deg: &[(f64, f64)],
        theta_r_deg: f64,
        steps: usize,
    ) -> Result<Self, StoreError> {
        let Source::Measured(brdf) = source else {
            return Self::of(source.reflectance(), quantity, incident_deg, theta_r_deg, steps);
        };
        let mut stated = Vec::new();
        let scan = Self::with(quantity, incident_deg, theta_r_deg, steps, &mut |pairs| {
            let found = brdf.stated(pairs)?;
            stated.push(found.iter().map(|found| found.ok()).collect());
            Ok(found
                .into_iter()
                .map(|found| found.map(|found| found.f))
                .collect())
        })?;
        Ok(Self {
            stated,
            zero: Some(brdf.azimuth().zero()),
            ..scan
        })
    }

    /// As [`new`](Self::new), of anything that has values, without their uncertainties.
    ///
    /// # Errors
    /// [`StoreError`] if the BRDF cannot be read.
    pub fn of(
        material: &dyn Reflectance,
        quantity: Quantity,
        incident_deg: &[(f64, f64)],
        theta_r_deg: f64,
        steps: usize,
    ) -> Result<Self, StoreError> {
        let mut values = |pairs: &[(DVec3, DVec3)]| material.values(pairs);
        Self::with(quantity, incident_deg, theta_r_deg, steps, &mut values)
    }

    /// The scan of what `find` says of f for pairs of directions.
    fn with(
        quantity: Quantity,
        incident_deg: &[(f64, f64)],
        theta_r_deg: f64,
        steps: usize,
        find: &mut Find<'_>,
    ) -> Result<Self, StoreError> {
        let mut scan = Self {
            theta_r_deg,
            phi_r_deg: (0..=steps).map(|k| 360.0 * k as f64 / steps as f64).collect(),
            quantity,
            curves: incident_deg.iter().map(|at| (*at, Vec::new())).collect(),
            zero: None,
            stated: Vec::new(),
        };
        let all: Vec<Vec<(DVec3, DVec3)>> = scan.pairs().collect();
        for (curve, pairs) in scan.curves.iter_mut().zip(all) {
            let values = find(&pairs)?.into_iter().zip(&pairs);
            curve.1 = values
                .map(|(value, (_, wo))| value.map(|f| f.map(|f| quantity.factor(*wo) as f32 * f)))
                .collect();
        }
        Ok(scan)
    }

    /// The pairs of directions of each curve.
    fn pairs(&self) -> impl Iterator<Item = Vec<(DVec3, DVec3)>> + '_ {
        self.curves.iter().map(|((theta_deg, phi_deg), _)| {
            let wi = from_degrees(*theta_deg, *phi_deg);
            let outgoing = self.phi_r_deg.iter();
            outgoing
                .map(|&phi| (wi, from_degrees(self.theta_r_deg, phi)))
                .collect()
        })
    }

    /// Number of directions without a value.
    #[must_use]
    pub fn missing(&self) -> usize {
        self.curves
            .iter()
            .flat_map(|curve| &curve.1)
            .filter(|value| value.is_err())
            .count()
    }

    /// Luma (BT.601) against φr, one curve per incident direction.
    #[must_use]
    pub fn chart(&self, title: &str) -> Chart {
        let luma = |value: &Value| {
            let [r, g, b] = value.ok()?.map(f64::from);
            Some(0.299 * r + 0.587 * g + 0.114 * b)
        };
        let curves: Vec<Curve> = self
            .curves
            .iter()
            .map(|((theta, phi), values)| Curve {
                label: format!("({theta}°, {phi}°)"),
                points: self
                    .phi_r_deg
                    .iter()
                    .copied()
                    .zip(values.iter().map(luma))
                    .collect(),
            })
            .collect();
        let values = curves
            .iter()
            .flat_map(|curve| &curve.points)
            .filter_map(|point| point.1);
        Chart {
            title: title.to_owned(),
            x: Axis {
                label: match &self.zero {
                    None => format!(
                        "azimuth φr of the outgoing direction (°), θr = {}°",
                        self.theta_r_deg
                    ),
                    Some(zero) => format!("outgoing azimuth φr (°), θr = {}°; {zero}", self.theta_r_deg),
                },
                ticks: (0..=6).map(|k| f64::from(k) * 60.0).collect(),
                scale: Scale::Linear,
            },
            y: Axis::covering(&self.quantity.label(), values.chain([0.0])),
            legend: "incident (θi, φi)".to_owned(),
            marks: false,
            curves,
        }
    }

    /// The table: a row per incident direction and azimuth; where there is no value, its reason.
    #[must_use]
    pub fn csv(&self) -> String {
        let name = self.quantity.column();
        let unit = self.quantity.column_unit();
        let columns = |before: &str| {
            ["r", "g", "b"]
                .map(|channel| format!("{before}_{channel}{unit}"))
                .join(",")
        };
        let uncertain = if self.stated.is_empty() {
            String::new()
        } else {
            format!(",{},provenance", columns(&format!("u_{name}")))
        };
        let mut table = format!(
            "theta_i_deg,phi_i_deg,theta_r_deg,phi_r_deg,{},reason{uncertain}\n",
            columns(name)
        );
        for (number, ((theta_i, phi_i), values)) in self.curves.iter().enumerate() {
            for (place, (phi_r, value)) in self.phi_r_deg.iter().zip(values).enumerate() {
                write!(table, "{theta_i},{phi_i},{},{phi_r},", self.theta_r_deg)
                    .expect("strings take everything");
                match value {
                    Ok([r, g, b]) => write!(table, "{r:.6e},{g:.6e},{b:.6e},"),
                    Err(reason) => write!(table, ",,,{reason}"),
                }
                .expect("strings take everything");
                let factor = self.quantity.factor(from_degrees(self.theta_r_deg, *phi_r)) as f32;
                match self.stated.get(number).map(|stated| stated[place]) {
                    None => Ok(()),
                    Some(None) => write!(table, ",,,,"),
                    Some(Some(stated)) => {
                        let [r, g, b] = stated.sigma.map(|sigma| factor * sigma);
                        write!(table, ",{r:.3e},{g:.3e},{b:.3e},{}", stated.provenance.name())
                    }
                }
                .expect("strings take everything");
                table.push('\n');
            }
        }
        table
    }

    /// Writes the chart (`.svg`, `.png`) or the table (`.csv`), as the name of `path` ends.
    ///
    /// # Errors
    /// [`ChartError`].
    pub fn save(&self, title: &str, path: &Path) -> Result<(), ChartError> {
        self.chart(title).save_or_table(|| self.csv(), path)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::brdf::reflectance::Missing;
    use crate::brdf::sample::parse;
    use crate::instrument::optics::Unmeasurable;

    /// Lambert that cannot be seen for x > 0.
    struct Half;

    impl Reflectance for Half {
        fn values(&self, pairs: &[(DVec3, DVec3)]) -> Result<Vec<Value>, StoreError> {
            let hidden = Err(Missing::Outgoing(Unmeasurable::Hole));
            Ok(pairs
                .iter()
                .map(|pair| if pair.1.x > 0.0 { hidden } else { Ok([0.2; 3]) })
                .collect())
        }
    }

    #[test]
    fn a_cloth_is_as_bright_as_its_model_says() {
        let sample = parse("velvet").unwrap();
        let scan = AzimuthScan::of(&sample, Quantity::Brdf, &INCIDENT_DEG, THETA_R_DEG, 72).unwrap();
        let rows: Vec<Vec<f64>> = scan
            .csv()
            .lines()
            .skip(1)
            .map(|line| {
                line.split(',')
                    .take(5)
                    .map(|cell| cell.parse().unwrap())
                    .collect()
            })
            .collect();
        assert_eq!(rows.len(), 3 * 73);
        for row in rows {
            let f = sample.f(from_degrees(row[0], row[1]), from_degrees(row[2], row[3]))[0];
            assert!((row[4] / f - 1.0).abs() < 1e-5, "{row:?} {f}");
        }
    }

    #[test]
    fn what_has_no_value_is_a_gap_with_a_reason() {
        let scan = AzimuthScan::of(&Half, Quantity::Brdf, &[(30.0, 0.0)], 30.0, 8).unwrap();
        let points = &scan.chart("half").curves[0].points;
        let gaps: Vec<f64> = points
            .iter()
            .filter(|point| point.1.is_none())
            .map(|point| point.0)
            .collect();
        // At 90° cos φ is 6e-17 rather than 0.
        assert_eq!(gaps, [0.0, 45.0, 90.0, 315.0, 360.0]);
        assert_eq!(scan.missing(), 5);
        assert!(scan.csv().contains("\n30,0,30,45,,,,hole\n"), "{}", scan.csv());
    }
}
