//! The sampling study: how fine a measurement must be for pictures made from it to be right.
//!
//! # Design
//! After figures 8 and 9 of the RCG paper. A known sample is captured by an ideal instrument ([`IdealCaptures`]) at
//! an interval between incident directions and with an image size; spheres rendered from the captures are held
//! against spheres of the sample itself ([`Spheres`]). What limits the pictures is then the sampling and the
//! interpolation alone.
//!
//! # Tradeoffs
//! An image is the equal-area [`Disk`] in which this crate stores captures. A camera's own image of the mirror, nearly
//! stereographic, has pixels √2 as wide at the normal: for the same PSNR it needs about √2 as many a side.

mod figures;
mod ideal;
pub mod multiplex;
pub mod paper;
pub mod pareto;
mod spheres;

use std::fs;
use std::path::Path;

use serde::Serialize;

use crate::base::blame::Blame;
use crate::base::progress::Progress;
use crate::brdf::interpolation::{Interpolation, Table};
use crate::brdf::reflectance::Reflectance;
use crate::brdf::sample::Sample;
use crate::hemisphere::disk::Disk;
use crate::hemisphere::incident::{Grid, IncidentError, IncidentSet};
use crate::judge::chart::ChartError;
use crate::store::StoreError;
use crate::store::whole_file::FileError;

pub use ideal::IdealCaptures;
pub use spheres::{LIGHT_PHIS, LIGHT_THETAS, Psnr, SPHERE_PX, Spheres};

/// Allowed image sizes in pixels a side, as those of a measurement.
const IMAGE_SIZES: std::ops::RangeInclusive<usize> = 8..=4096;

/// What is to be studied.
#[derive(Clone, Debug)]
pub struct Settings {
    /// Factor from radiance under unit irradiance to the white of a picture.
    pub exposure: f32,
    /// Whether every ring of incident directions has only as many as keep their gap within the interval, instead of as
    /// many as the widest.
    pub equal_solid_angle: bool,
    /// Degrees between incident directions.
    pub intervals_deg: Vec<f64>,
    /// Pixels a side of a capture.
    pub image_sizes: Vec<usize>,
    /// How captures are interpolated.
    pub interpolation: Interpolation,
    /// Degrees between incident directions of the coarse captures by which all interpolations are compared.
    pub coarse_intervals_deg: Vec<f64>,
}

/// Captures that are kept in memory (all but those for direct interpolation) may take this much.
const MOST_GB: f64 = 8.0;

/// Pixels a side of the captures by which interpolations are compared.
pub const COMPARED_IMAGE_SIZE: usize = 96;

impl Default for Settings {
    /// The intervals and image sizes of the paper's figures, at exposure 1.
    fn default() -> Self {
        Self {
            exposure: 1.0,
            equal_solid_angle: false,
            intervals_deg: vec![10.0, 5.0, 3.0, 2.0, 1.0, 0.5],
            image_sizes: vec![32, 48, 64, 96, 128, 256],
            interpolation: Interpolation::Direct,
            coarse_intervals_deg: vec![30.0, 15.0, 10.0],
        }
    }
}

/// One reconstruction and how good it is.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Row {
    /// Degrees between incident directions.
    pub interval_deg: f64,
    /// Pixels a side of a capture.
    pub image_size: usize,
    /// Number of captures, one per incident direction.
    pub captures: usize,
    /// How they were interpolated.
    pub interpolation: Interpolation,
    /// The smallest PSNR over the lights.
    #[serde(flatten)]
    pub psnr: Psnr,
}

/// The outcome.
#[derive(Clone, Debug, Serialize)]
pub struct Study {
    /// The sample as it was named.
    pub sample: String,
    /// Factor from radiance under unit irradiance to the white of a picture.
    pub exposure: f32,
    /// Pixels a side of the pictures, all of which count.
    pub sphere_px: usize,
    /// Polar angles (0 to 90°) and azimuths of the lights.
    pub lights: [usize; 2],
    /// Kind of the grid of incident directions.
    pub grid: &'static str,
    /// One per interval and image size.
    pub rows: Vec<Row>,
    /// One per coarse interval and interpolation, all at [`COMPARED_IMAGE_SIZE`].
    pub methods: Vec<Row>,
    /// What the study does not say, in sentences.
    pub warnings: Vec<String>,
}

/// Why there is no study.
#[derive(Debug, thiserror::Error)]
pub enum StudyError {
    /// An interval makes no grid.
    #[error("intervals: {0}")]
    Interval(#[from] IncidentError),
    /// An image size is out of range.
    #[error("image-sizes: expected a number of pixels from 8 to 4096, found {0}")]
    ImageSize(usize),
    /// The captures do not fit into memory.
    #[error(
        "interval {interval_deg}° with {image_size} pixels a side: expected captures of at most {most_gb:.0} GB for \
         {interpolation} interpolation, found {gb:.0} GB; take larger intervals, smaller images or direct interpolation"
    )]
    TooLarge {
        /// Degrees between incident directions.
        interval_deg: f64,
        /// Pixels a side.
        image_size: usize,
        /// Name of the interpolation.
        interpolation: &'static str,
        /// 10⁹ bytes that are allowed.
        most_gb: f64,
        /// 10⁹ bytes that it would take.
        gb: f64,
    },
    /// The exposure is none.
    #[error("exposure: expected a positive number, found {0}")]
    Exposure(f32),
    /// What was captured cannot be read.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// Figures and tables.
    #[error(transparent)]
    Chart(#[from] ChartError),
}

impl Blame for StudyError {
    fn is_input(&self) -> bool {
        match self {
            Self::Store(error) => error.is_input(),
            Self::Chart(error) => error.is_input(),
            Self::TooLarge { .. } | Self::Interval(_) | Self::ImageSize(_) | Self::Exposure(_) => true,
        }
    }
}

impl Settings {
    fn grid(&self, step_deg: f64) -> Grid {
        if self.equal_solid_angle {
            Grid::EqualSolidAngle { step_deg }
        } else {
            Grid::ThetaPhi { step_deg }
        }
    }

    /// What is tried: the curves, and how many those are, then the coarse captures.
    fn trials(&self) -> Result<(Vec<Trial>, usize), StudyError> {
        if !(self.exposure.is_finite() && self.exposure > 0.0) {
            return Err(StudyError::Exposure(self.exposure));
        }
        if let Some(&size) = self.image_sizes.iter().find(|size| !IMAGE_SIZES.contains(size)) {
            return Err(StudyError::ImageSize(size));
        }
        let mut trials = Vec::new();
        let mut add = |interval_deg: f64, image_sizes: &[usize], interpolations: &[Interpolation]| {
            let set = self.grid(interval_deg).build()?;
            for &image_size in image_sizes {
                trials.extend(interpolations.iter().map(|&interpolation| Trial {
                    interval_deg,
                    set: set.clone(),
                    image_size,
                    interpolation,
                }));
            }
            Ok::<_, StudyError>(trials.len())
        };
        let mut curves = 0;
        for &interval_deg in &self.intervals_deg {
            curves = add(interval_deg, &self.image_sizes, &[self.interpolation])?;
        }
        for &interval_deg in &self.coarse_intervals_deg {
            add(interval_deg, &[COMPARED_IMAGE_SIZE], &Interpolation::ALL)?;
        }
        trials.iter().try_for_each(Trial::check)?;
        Ok((trials, curves))
    }
}

/// One reconstruction that is judged.
struct Trial {
    interval_deg: f64,
    set: IncidentSet,
    image_size: usize,
    interpolation: Interpolation,
}

impl Trial {
    /// Whether its captures fit into memory.
    fn check(&self) -> Result<(), StudyError> {
        let gb = (12 * self.set.len() * self.image_size * self.image_size) as f64 * 1e-9;
        if self.interpolation == Interpolation::Direct || gb <= MOST_GB {
            return Ok(());
        }
        Err(StudyError::TooLarge {
            interval_deg: self.interval_deg,
            image_size: self.image_size,
            interpolation: self.interpolation.name(),
            most_gb: MOST_GB,
            gb,
        })
    }
}

/// Studies `sample`, which is called `name`; with tables and figures in the directory `out` if there is one.
///
/// # Errors
/// [`StudyError`].
pub fn study(
    name: &str,
    sample: &dyn Sample,
    settings: &Settings,
    out: Option<&Path>,
    progress: &dyn Progress,
) -> Result<Study, StudyError> {
    let (trials, curves) = settings.trials()?;
    if let Some(out) = out {
        // Before the work rather than after it.
        fs::create_dir_all(out).map_err(|source| ChartError::from(FileError::at(out, source)))?;
    }
    let spheres = Spheres::new(&sample, settings.exposure)?;
    progress.begin("study", trials.len(), "reconstructions");
    let mut rows: Vec<Row> = Vec::new();
    for Trial {
        interval_deg,
        set,
        image_size,
        interpolation,
    } in trials
    {
        // What was judged for the curves need not be judged again.
        let known = rows.iter().find(|row| {
            (row.captures, row.image_size, row.interpolation) == (set.len(), image_size, interpolation)
        });
        let psnr = match known {
            Some(row) => row.psnr,
            None => spheres.judge(reconstruction(sample, set.clone(), image_size, interpolation).as_ref())?,
        };
        let captures = set.len();
        rows.push(Row {
            interval_deg,
            image_size,
            captures,
            interpolation,
            psnr,
        });
        progress.reach(rows.len());
    }
    let warnings = warnings(&spheres, &rows);
    let methods = rows.split_off(curves);
    progress.end();
    let study = Study {
        sample: name.to_owned(),
        exposure: settings.exposure,
        sphere_px: SPHERE_PX,
        lights: [LIGHT_THETAS, LIGHT_PHIS],
        grid: settings.grid(90.0).kind(),
        rows,
        methods,
        warnings,
    };
    if let Some(out) = out {
        study.save(sample, out)?;
    }
    Ok(study)
}

fn warnings(spheres: &Spheres, rows: &[Row]) -> Vec<String> {
    let mut warnings = Vec::new();
    if !spheres.show_something() {
        let why = "the pictures are black or clipped everywhere and show nothing of the sample";
        warnings.push(format!("PSNR: none, {why}; choose another exposure"));
    }
    let least = rows.iter().map(|row| row.psnr.scored_share).fold(1.0, f64::min);
    if least < 1.0 {
        warnings.push(format!(
            "PSNR: only {:.2} % of the lit pixels have a value and are scored in the worst case",
            100.0 * least
        ));
    }
    warnings
}

/// What can be looked up in ideal captures of `sample` from the directions of `set` with `image_size` pixels a side.
#[must_use]
pub fn reconstruction<'a>(
    sample: &'a dyn Sample,
    set: IncidentSet,
    image_size: usize,
    interpolation: Interpolation,
) -> Box<dyn Reflectance + 'a> {
    let disk = Disk::new(image_size);
    match interpolation {
        Interpolation::Direct => Box::new(IdealCaptures::new(sample, set, disk)),
        _ => Box::new(Table::of(sample, set, disk).with(interpolation)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::progress::Silent;
    use crate::brdf::sample::parse;

    fn settings(intervals_deg: &[f64], image_sizes: &[usize]) -> Settings {
        Settings {
            exposure: 1.0,
            intervals_deg: intervals_deg.to_vec(),
            image_sizes: image_sizes.to_vec(),
            coarse_intervals_deg: Vec::new(),
            ..Settings::default()
        }
    }

    #[test]
    fn linear_interpolation_converges_with_the_square_of_the_steps() {
        // Half the interval and half the pixel make a quarter of the error: 12 dB, once both are finer than the lobe.
        let brass = parse("ward:brass").unwrap();
        let y = |interval_deg: f64, image_size: usize| {
            let settings = settings(&[interval_deg], &[image_size]);
            let found = study("brass", brass.as_ref(), &settings, None, &Silent).unwrap();
            assert_eq!(
                found.rows[0].captures,
                (4.0 * (90.0 / interval_deg).powi(2)) as usize
            );
            found.rows[0].psnr.psnr_y_db.unwrap()
        };
        let (coarse, fine) = (y(2.0, 96), y(1.0, 192));
        assert!((10.0..13.5).contains(&(fine - coarse)), "{coarse} {fine}");
        // The paper's claim.
        assert!(y(1.0, 96) > 40.0);
        // A lobe of 5° falls through a grid of 10°.
        assert!((20.0..32.0).contains(&y(10.0, 96)));
    }

    #[test]
    fn settings_that_make_no_study_are_refused() {
        let white = parse("lambert").unwrap();
        let refused = |settings: &Settings| {
            study("white", white.as_ref(), settings, None, &Silent)
                .expect_err("must be refused")
                .to_string()
        };
        assert!(refused(&settings(&[7.0], &[32])).contains("found 7"));
        assert_eq!(
            refused(&settings(&[10.0], &[4])),
            "image-sizes: expected a number of pixels from 8 to 4096, found 4"
        );
        let dark = Settings {
            exposure: 0.0,
            ..settings(&[10.0], &[32])
        };
        assert!(refused(&dark).contains("found 0"));
    }
}
