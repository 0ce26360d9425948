//! The study as tables, charts and pictures.

use std::fmt::Write as _;
use std::path::Path;

use image::RgbImage;

use super::{COMPARED_IMAGE_SIZE, IdealCaptures, Row, Study, StudyError};
use crate::brdf::interpolation::Interpolation;
use crate::brdf::reflectance::Reflectance;
use crate::brdf::sample::Sample;
use crate::hemisphere::disk::Disk;
use crate::hemisphere::incident::Grid;
use crate::judge::chart::{Axis, Chart, ChartError, Curve, Scale, captioned};
use crate::judge::render::{save, sheet, sphere};
use crate::store::whole_file::write_whole;

/// Lights of the comparison, one row each: polar angle and azimuth in degrees.
const COMPARED_LIGHTS_DEG: [(f64, f64); 2] = [(45.0, 90.0), (60.0, 36.0)];

impl Study {
    /// Whether the pictures show anything of the sample; if not there is no PSNR.
    #[must_use]
    pub fn shows_something(&self) -> bool {
        let mut all = self.rows.iter().chain(&self.methods);
        all.any(|row| row.psnr.exact || row.psnr.psnr_y_db.is_some())
    }

    /// PSNR of Y against the interval, one curve per image size: figure 8 of the paper.
    #[must_use]
    pub fn against_interval(&self) -> Chart {
        let interval = |row: &Row| row.interval_deg;
        let size = |row: &Row| row.image_size as f64;
        let mut ticks = distinct(self.rows.iter().map(interval));
        widen(&mut ticks);
        self.chart(
            "interval between incident directions (°)",
            ticks,
            "image size (pixels)",
            interval,
            size,
        )
    }

    /// PSNR of Y against the image size, one curve per interval: figure 9 of the paper.
    #[must_use]
    pub fn against_image_size(&self) -> Chart {
        let interval = |row: &Row| row.interval_deg;
        let size = |row: &Row| row.image_size as f64;
        let mut ticks = distinct(self.rows.iter().map(size));
        widen(&mut ticks);
        self.chart(
            "image size (pixels a side)",
            ticks,
            "interval (°)",
            size,
            interval,
        )
    }

    fn chart(
        &self,
        x: &str,
        ticks: Vec<f64>,
        legend: &str,
        x_of: impl Fn(&Row) -> f64,
        curve_of: impl Fn(&Row) -> f64,
    ) -> Chart {
        let curves = distinct(self.rows.iter().map(&curve_of));
        let points = |value: f64| {
            let rows = self
                .rows
                .iter()
                .filter(|row| curve_of(row).total_cmp(&value).is_eq());
            let mut points: Vec<_> = rows.map(|row| (x_of(row), row.psnr.psnr_y_db)).collect();
            points.sort_by(|a, b| a.0.total_cmp(&b.0));
            points
        };
        let curves = curves.into_iter().map(|value| Curve {
            band: Vec::new(),
            label: format!("{value}"),
            points: points(value),
        });
        self.psnr_chart(x, ticks, legend, curves.collect())
    }

    /// PSNR of Y against the number of captures, one curve per interpolation.
    #[must_use]
    pub fn against_captures(&self) -> Chart {
        let mut ticks = distinct(self.methods.iter().map(|row| row.captures as f64));
        widen(&mut ticks);
        let curve = |method: Interpolation| {
            let rows = self.methods.iter().filter(|row| row.interpolation == method);
            let mut points: Vec<_> = rows
                .map(|row| (row.captures as f64, row.psnr.psnr_y_db))
                .collect();
            points.sort_by(|a, b| a.0.total_cmp(&b.0));
            Curve {
                band: Vec::new(),
                label: method.name().to_owned(),
                points,
            }
        };
        let x = format!("captures of {COMPARED_IMAGE_SIZE} × {COMPARED_IMAGE_SIZE} pixels");
        self.psnr_chart(&x, ticks, "interpolation", Interpolation::ALL.map(curve).to_vec())
    }

    fn psnr_chart(&self, x: &str, ticks: Vec<f64>, legend: &str, curves: Vec<Curve>) -> Chart {
        let values = curves
            .iter()
            .flat_map(|curve| &curve.points)
            .filter_map(|point| point.1);
        Chart {
            title: format!("{}, exposure {}", self.sample, self.exposure),
            x: Axis {
                label: x.to_owned(),
                ticks,
                scale: Scale::Logarithmic,
            },
            y: Axis::covering("smallest PSNR of Y over the lights (dB)", values),
            legend: legend.to_owned(),
            marks: true,
            curves,
        }
    }

    /// Writes `study.csv`, `methods.csv`, `study.json`, the charts `psnr-interval`, `psnr-image-size` and
    /// `psnr-captures` (`.svg`, `.png`) and `comparison.png` into `dir`. `sample` is what was studied.
    ///
    /// # Errors
    /// [`StudyError`].
    pub(super) fn save(&self, sample: &dyn Sample, dir: &Path) -> Result<(), StudyError> {
        self.against_interval().save_both(dir, "psnr-interval")?;
        self.against_image_size().save_both(dir, "psnr-image-size")?;
        if !self.methods.is_empty() {
            self.against_captures().save_both(dir, "psnr-captures")?;
        }
        save(&self.comparison(sample)?, &dir.join("comparison.png")).map_err(ChartError::from)?;
        let json = serde_json::to_string_pretty(self).expect("invariant: plain data");
        let tables = [
            ("study.json", json),
            ("study.csv", csv(&self.rows)),
            ("methods.csv", csv(&self.methods)),
        ];
        for (name, text) in tables {
            write_whole(&dir.join(name), text.as_bytes()).map_err(ChartError::from)?;
        }
        Ok(())
    }

    /// The sample itself beside what is reconstructed at up to four of the intervals: figure 7 of the paper.
    fn comparison(&self, sample: &dyn Sample) -> Result<RgbImage, StudyError> {
        let sizes = self.rows.iter().map(|row| row.image_size);
        let image_size = sizes
            .min_by_key(|size| size.abs_diff(COMPARED_IMAGE_SIZE))
            .unwrap_or(COMPARED_IMAGE_SIZE);
        let mut intervals = distinct(self.rows.iter().map(|row| row.interval_deg));
        intervals.reverse();
        intervals.truncate(4);
        let captures = intervals
            .iter()
            .map(|&step_deg| {
                let set = Grid::ThetaPhi { step_deg }.build()?;
                Ok(IdealCaptures::new(sample, set, Disk::new(image_size)))
            })
            .collect::<Result<Vec<_>, StudyError>>()?;
        let mut materials: Vec<&dyn Reflectance> = vec![&sample];
        materials.extend(captures.iter().map(|captures| captures as &dyn Reflectance));
        let row = |&light: &(f64, f64)| {
            materials
                .iter()
                .map(|&material| sphere(material, 256, light))
                .collect()
        };
        let rows: Vec<Vec<_>> = COMPARED_LIGHTS_DEG.iter().map(row).collect::<Result<_, _>>()?;
        let mut captions = vec!["truth".to_owned()];
        captions.extend(
            intervals
                .iter()
                .map(|step| format!("{step}°, {image_size} × {image_size}")),
        );
        Ok(captioned(&sheet(&rows, self.exposure), &captions))
    }
}

/// A row per reconstruction; PSNR is empty where there is none, and `exact` says whether that is because nothing differs.
fn csv(rows: &[Row]) -> String {
    let mut table =
        "interval_deg,image_size,captures,interpolation,psnr_y_db,psnr_cb_db,psnr_cr_db,exact,scored_share\n"
            .to_owned();
    for row in rows {
        let psnr = [row.psnr.psnr_y_db, row.psnr.psnr_cb_db, row.psnr.psnr_cr_db];
        let [y, cb, cr] = psnr.map(|db| db.map_or_else(String::new, |db| format!("{db:.3}")));
        let (interval, size, method) = (row.interval_deg, row.image_size, row.interpolation.name());
        let (exact, share) = (row.psnr.exact, row.psnr.scored_share);
        writeln!(
            table,
            "{interval},{size},{},{method},{y},{cb},{cr},{exact},{share:.4}",
            row.captures
        )
        .expect("strings take everything");
    }
    table
}

/// Rising values without repetitions.
fn distinct(values: impl Iterator<Item = f64>) -> Vec<f64> {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    values.dedup();
    values
}

/// An axis needs two ticks.
fn widen(ticks: &mut Vec<f64>) {
    if let [only] = ticks[..] {
        ticks.push(2.0 * only);
    }
}
