//! The study as tables, charts and pictures.

use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use image::RgbImage;

use super::{IdealCaptures, Row, Study, StudyError};
use crate::chart::{Axis, Chart, ChartError, Curve, Scale, captioned};
use crate::disk::Disk;
use crate::incident::IncidentGrid;
use crate::measurement::{MeasurementError, write_whole};
use crate::reflectance::Reflectance;
use crate::render::{save, sheet, sphere};
use crate::sample::Sample;

/// Image size of the comparison, or the next to it that was studied.
const COMPARED_IMAGE_SIZE: usize = 96;
/// Lights of the comparison, one row each: polar angle and azimuth in degrees.
const COMPARED_LIGHTS_DEG: [(f64, f64); 2] = [(45.0, 90.0), (60.0, 36.0)];

impl Study {
    /// A row per reconstruction; PSNR is empty where it is infinite.
    #[must_use]
    pub fn csv(&self) -> String {
        let mut table =
            "interval_deg,image_size,captures,interpolation,psnr_y_db,psnr_cb_db,psnr_cr_db\n".to_owned();
        for row in &self.rows {
            let psnr = [row.psnr.psnr_y_db, row.psnr.psnr_cb_db, row.psnr.psnr_cr_db];
            let [y, cb, cr] = psnr.map(|db| db.map_or_else(String::new, |db| format!("{db:.3}")));
            writeln!(
                table,
                "{},{},{},{},{y},{cb},{cr}",
                row.interval_deg,
                row.image_size,
                row.captures,
                row.interpolation.name()
            )
            .expect("strings take everything");
        }
        table
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
            label: format!("{value}"),
            points: points(value),
        });
        Chart {
            title: format!("{}, exposure {}", self.sample, self.exposure),
            x: Axis {
                label: x.to_owned(),
                ticks,
                scale: Scale::Logarithmic,
            },
            y: Axis::covering(
                "smallest PSNR of Y over the lights (dB)",
                self.rows.iter().filter_map(|row| row.psnr.psnr_y_db),
            ),
            legend: legend.to_owned(),
            marks: true,
            curves: curves.collect(),
        }
    }

    /// Writes `study.csv`, `study.json`, the charts `psnr-interval` and `psnr-image-size` (`.svg`, `.png`) and
    /// `comparison.png` into `dir`, which is made if it is missing. `sample` is what was studied.
    ///
    /// # Errors
    /// [`StudyError`].
    pub fn save(&self, sample: &dyn Sample, dir: &Path) -> Result<(), StudyError> {
        fs::create_dir_all(dir).map_err(|source| {
            let path = dir.display().to_string();
            ChartError::from(MeasurementError::Io { path, source })
        })?;
        self.against_interval().save_both(dir, "psnr-interval")?;
        self.against_image_size().save_both(dir, "psnr-image-size")?;
        save(&self.comparison(sample)?, &dir.join("comparison.png")).map_err(ChartError::from)?;
        let json = serde_json::to_string_pretty(self).expect("invariant: plain data");
        for (name, text) in [("study.json", json), ("study.csv", self.csv())] {
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
            .map(|&step| {
                Ok(IdealCaptures::new(
                    sample,
                    IncidentGrid::new(step)?,
                    Disk::new(image_size),
                ))
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
