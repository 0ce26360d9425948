//! Reflectance along a circle of outgoing directions: f against the azimuth φr at one polar angle θr.
//!
//! # Design
//! The way in which figure 16 of the RCG paper shows a cloth: one curve per incident direction, θr fixed. A
//! direction without a value is a gap in the curve and has its reason in the table.

use std::fmt::Write as _;
use std::path::Path;

use crate::base::file_format::CHART_OR_TABLE;
use crate::brdf::reflectance::Reflectance;
use crate::brdf::reflectance::Value;
use crate::hemisphere::direction::from_degrees;
use crate::judge::chart::{Axis, Chart, ChartError, Curve, Scale};
use crate::store::StoreError;
use crate::store::whole_file::write_whole;

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
    /// Per incident direction its angles (θ, φ) in degrees and f at each azimuth.
    pub curves: Vec<((f64, f64), Vec<Value>)>,
}

impl AzimuthScan {
    /// Looks f up at `steps` + 1 azimuths from 0 to 360°, for each of `incident_deg` (θ, φ in degrees).
    ///
    /// # Errors
    /// [`StoreError`] if the BRDF cannot be read.
    pub fn new(
        material: &dyn Reflectance,
        incident_deg: &[(f64, f64)],
        theta_r_deg: f64,
        steps: usize,
    ) -> Result<Self, StoreError> {
        let phi_r_deg: Vec<f64> = (0..=steps).map(|k| 360.0 * k as f64 / steps as f64).collect();
        let curves = incident_deg
            .iter()
            .map(|&(theta_deg, phi_deg)| {
                let wi = from_degrees(theta_deg, phi_deg);
                let pairs: Vec<_> = phi_r_deg
                    .iter()
                    .map(|&phi| (wi, from_degrees(theta_r_deg, phi)))
                    .collect();
                Ok(((theta_deg, phi_deg), material.values(&pairs)?))
            })
            .collect::<Result<_, StoreError>>()?;
        Ok(Self {
            theta_r_deg,
            phi_r_deg,
            curves,
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

    /// Luma of f (BT.601) against φr, one curve per incident direction.
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
                label: format!(
                    "azimuth φr of the outgoing direction (°), θr = {}°",
                    self.theta_r_deg
                ),
                ticks: (0..=6).map(|k| f64::from(k) * 60.0).collect(),
                scale: Scale::Linear,
            },
            y: Axis::covering("BRDF f (1/sr)", values.chain([0.0])),
            legend: "incident (θi, φi)".to_owned(),
            marks: false,
            curves,
        }
    }

    /// The table: a row per incident direction and azimuth; where there is no value, its reason.
    #[must_use]
    pub fn csv(&self) -> String {
        let mut table =
            "theta_i_deg,phi_i_deg,theta_r_deg,phi_r_deg,f_r_per_sr,f_g_per_sr,f_b_per_sr,reason\n"
                .to_owned();
        for ((theta_i, phi_i), values) in &self.curves {
            for (phi_r, value) in self.phi_r_deg.iter().zip(values) {
                write!(table, "{theta_i},{phi_i},{},{phi_r},", self.theta_r_deg)
                    .expect("strings take everything");
                match value {
                    Ok([r, g, b]) => writeln!(table, "{r:.6e},{g:.6e},{b:.6e},"),
                    Err(reason) => writeln!(table, ",,,{reason}"),
                }
                .expect("strings take everything");
            }
        }
        table
    }

    /// Writes the chart (`.svg`, `.png`) or the table (`.csv`), as the name of `path` ends.
    ///
    /// # Errors
    /// [`ChartError`].
    pub fn save(&self, title: &str, path: &Path) -> Result<(), ChartError> {
        match CHART_OR_TABLE.of(path)? {
            "csv" => Ok(write_whole(path, self.csv().as_bytes())?),
            _ => self.chart(title).save(path),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::brdf::reflectance::Missing;
    use crate::brdf::sample::parse;
    use crate::instrument::optics::Unmeasurable;
    use glam::DVec3;

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
        let scan = AzimuthScan::new(&sample, &INCIDENT_DEG, THETA_R_DEG, 72).unwrap();
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
        let scan = AzimuthScan::new(&Half, &[(30.0, 0.0)], 30.0, 8).unwrap();
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
