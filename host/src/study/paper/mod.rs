//! Every figure of the RCG paper from our own data, on one page.
//!
//! # Design
//! Figures that the paper simulates come from the sampling study. Where it shows a measurement, the virtual rig
//! measures: patterns and camera images with the preset `rcg-1-16bit`, two cloths with `rcg-2`, which has no hole. The paper's
//! cloths are not at hand; anisotropic models stand in for them ([`CLOTHS`]), and the page says so.

mod page;

use std::fs;
use std::path::Path;
use std::time::Duration;

use image::RgbImage;
use serde::Serialize;

use crate::base::blame::Blame;
use crate::base::progress::Progress;
use crate::brdf::reflectance::Reflectance;
use crate::brdf::sample::{SampleError, parse};
use crate::brdf::{Brdf, BrdfError};
use crate::capture::directory::{Measurement, MeasurementError};
use crate::hemisphere::incident::Grid;
use crate::instrument::optics::View;
use crate::instrument::rig::{Rig, RigError};
use crate::judge::chart::{ChartError, captioned};
use crate::judge::quantity::Quantity;
use crate::judge::render::{automatic_exposure, corrugated, save, sheet, sphere};
use crate::judge::scan::{self, Along, INCIDENT_DEG, Scan, THETA_R_DEG};
use crate::measure::report::Summary;
use crate::measure::{MeasureError, complete, prepare};
use crate::plan::pattern::{BitPattern, PatternMaker};
use crate::plan::{Request, Virtual};
use crate::store::whole_file::{FileError, write_whole};
use crate::store::{Lock, StoreError};
use crate::study::{Settings, Study, StudyError, study};
use crate::virtual_rig::setup::Setup;

/// What stands in for the paper's cloths.
pub const CLOTHS: [&str; 2] = ["velvet", "satin"];
/// What the paper simulates.
const BRASS: &str = "ward:brass";
/// Rig of the patterns and camera images, and that of the cloths.
const RIGS: [&str; 2] = ["rcg-1-16bit", "rcg-2"];
/// Degrees between the patterns that are shown together.
const PATTERN_STEP_DEG: f64 = 15.0;
/// Degrees between the incident directions of which camera images are shown.
const FRAMES_STEP_DEG: f64 = 10.0;
/// Pixels a side of the pictures of cloth, and the lean of the corrugated sheet in degrees.
const PICTURE_PX: usize = 320;
const TILT_DEG: f64 = 30.0;
/// Lights of those pictures: polar angle and azimuth in degrees.
const LIGHTS_DEG: [(f64, f64); 3] = [(30.0, 180.0), (45.0, 90.0), (60.0, 0.0)];
/// Azimuths of the curves of reflectance.
const AZIMUTHS: usize = 360;

/// What was made.
#[derive(Clone, Debug, Serialize)]
pub struct Paper {
    /// The page.
    pub page: String,
    /// The sampling study.
    pub study: Study,
    /// The measurements: camera images, then the cloths.
    pub measurements: Vec<Summary>,
}

/// Why there is no page.
#[derive(Debug, thiserror::Error)]
pub enum PaperError {
    /// A measurement.
    #[error(transparent)]
    Measure(#[from] MeasureError),
    /// The study.
    #[error(transparent)]
    Study(#[from] StudyError),
    /// A figure.
    #[error(transparent)]
    Chart(#[from] ChartError),
}

impl Blame for PaperError {
    fn is_input(&self) -> bool {
        match self {
            Self::Measure(error) => error.is_input(),
            Self::Study(error) => error.is_input(),
            Self::Chart(error) => error.is_input(),
        }
    }
}

macro_rules! through {
    ($($error:ty => $way:ty),*) => {
        $(impl From<$error> for PaperError {
            fn from(error: $error) -> Self {
                <$way>::from(error).into()
            }
        })*
    };
}
through!(
    MeasurementError => MeasureError,
    FileError => ChartError,
    StoreError => MeasureError,
    BrdfError => MeasureError,
    SampleError => MeasureError,
    crate::judge::render::PictureError => ChartError
);

impl From<RigError> for PaperError {
    fn from(error: RigError) -> Self {
        MeasurementError::from(error).into()
    }
}

/// Makes all figures and the page `paper.html` in the new or empty directory `out`; cloths are measured every
/// `step_deg` degrees with `image_size` pixels a side, and `settings` are those of the study.
///
/// # Errors
/// [`PaperError`].
pub fn paper(
    out: &Path,
    step_deg: f64,
    image_size: u32,
    settings: &Settings,
    clock: &dyn Fn() -> Duration,
    progress: &dyn Progress,
) -> Result<Paper, PaperError> {
    Measurement::check_new(out)?;
    let _lock = Lock::folder(out)?;
    // Checks what was asked for before anything is made.
    Grid::ThetaPhi { step_deg }
        .build()
        .map_err(MeasurementError::from)?;
    let figures = out.join("figures");
    let made = |sample: &str, rig: &str, step_deg: f64| -> Result<Summary, PaperError> {
        let request = Request {
            grid: Grid::ThetaPhi { step_deg },
            image_size,
            ..Request::default()
        };
        let setup = Setup::from(Virtual {
            sample: sample.to_owned(),
            ..Virtual::default()
        });
        let dir = out.join(sample.replace(':', "-"));
        let (job, measurement) = prepare(&dir, &Rig::load(rig)?, request, &setup, progress)?;
        Ok(complete(&measurement, &job, clock, progress)?)
    };
    // The first also checks the image size, before anything is made.
    let mut measurements = vec![made(BRASS, RIGS[0], FRAMES_STEP_DEG)?];
    fs::create_dir_all(&figures).map_err(|source| FileError::at(&figures, source))?;
    patterns(&figures)?;
    for cloth in CLOTHS {
        measurements.push(made(cloth, RIGS[1], step_deg)?);
        let brdf = Brdf::open(&out.join(cloth).join("brdf.zarr"))?;
        cloth_figures(cloth, &brdf, &figures)?;
    }
    let brass = parse(BRASS)?;
    let study = study(BRASS, brass.as_ref(), settings, Some(&figures), progress)?;
    let page = out.join("paper.html");
    // The page comes last: a directory that has it is whole.
    write_whole(&page, page::page(&study, &measurements, step_deg).as_bytes())?;
    Ok(Paper {
        page: page.display().to_string(),
        study,
        measurements,
    })
}

/// One pattern, and all of a coarse grid in one picture: `patterns.png`.
fn patterns(dir: &Path) -> Result<(), PaperError> {
    let rig = Rig::load(RIGS[0])?;
    let step_deg = PATTERN_STEP_DEG;
    let set = Grid::ThetaPhi { step_deg }.build().map_err(StudyError::from)?;
    let maker = PatternMaker::new(
        View::projector(&rig),
        rig.light.spot_deg,
        rig.projector.irradiance,
    );
    let (width, height) = maker.size_px();
    let sets: Vec<_> = (0..set.len())
        .filter_map(|index| maker.lit_set(set.direction(index)).ok())
        .collect();
    let (mut one, mut all) = (BitPattern::black(width, height), BitPattern::black(width, height));
    if let Some(set) = sets.get(sets.len() / 3) {
        one.light(&set.pixels);
    }
    for set in &sets {
        all.light(&set.pixels);
    }
    // The mirror is in the middle of the projector's picture; the margins are black.
    let side = width.min(height) as u32;
    let mut both = RgbImage::new(2 * side, side);
    for (column, pattern) in [one, all].iter().enumerate() {
        let picture = image::DynamicImage::from(pattern.to_image()).into_rgb8();
        let (left, top) = ((width as u32 - side) / 2, (height as u32 - side) / 2);
        let middle = image::imageops::crop_imm(&picture, left, top, side, side);
        image::imageops::replace(&mut both, &*middle, i64::from(side) * column as i64, 0);
    }
    let captions = [
        "one pattern".to_owned(),
        format!("all {} of a grid of {PATTERN_STEP_DEG}°", sets.len()),
    ];
    Ok(save(&captioned(&both, &captions), &dir.join("patterns.png"))?)
}

/// Reflectance as measured and of the model itself, and pictures of the measured cloth.
fn cloth_figures(cloth: &str, brdf: &Brdf, dir: &Path) -> Result<(), PaperError> {
    let model = parse(cloth)?;
    let scans: [(&str, &dyn Reflectance); 2] = [("measured", brdf), ("model", &model)];
    for (what, material) in scans {
        let circle = Along::Circle {
            theta_r_deg: THETA_R_DEG,
            steps: AZIMUTHS,
        };
        let scans = [(what, Scan::of(material, Quantity::Brdf, &INCIDENT_DEG, circle)?)];
        let stem = format!("{cloth}-{what}");
        scan::chart(&scans, &format!("{cloth}, {what}"), false).save_both(dir, &stem)?;
        write_whole(
            &dir.join(stem).with_extension("csv"),
            scan::csv(&scans).as_bytes(),
        )?;
    }
    let spheres = LIGHTS_DEG.iter().map(|&light| sphere(brdf, PICTURE_PX, light));
    let sheets = LIGHTS_DEG
        .iter()
        .map(|&light| corrugated(brdf, PICTURE_PX, TILT_DEG, light));
    let rows = [
        spheres.collect::<Result<Vec<_>, _>>()?,
        sheets.collect::<Result<Vec<_>, _>>()?,
    ];
    let captions: Vec<String> = LIGHTS_DEG
        .iter()
        .map(|(theta, phi)| format!("light ({theta}°, {phi}°)"))
        .collect();
    let image = captioned(&sheet(&rows, automatic_exposure(&rows)), &captions);
    Ok(save(&image, &dir.join(format!("{cloth}-rendered.png")))?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::progress::Silent;

    #[test]
    #[ignore = "long: ./test.sh full runs it"]
    fn all_that_the_page_shows_is_there() {
        let scratch = tempfile::tempdir().unwrap();
        let out = scratch.path().join("paper");
        let settings = Settings {
            intervals_deg: vec![30.0],
            image_sizes: vec![16],
            coarse_intervals_deg: vec![30.0],
            ..Settings::default()
        };
        let made = paper(&out, 22.5, 16, &settings, &|| Duration::ZERO, &Silent).unwrap();
        let page = fs::read_to_string(&made.page).unwrap();
        let named: Vec<&str> = ["src=\"", "href=\""]
            .into_iter()
            .flat_map(|mark| page.split(mark).skip(1))
            .filter_map(|rest| rest.split('"').next())
            .collect();
        assert!(named.len() > 20, "{named:?}");
        for name in named {
            assert!(out.join(name).is_file(), "{name}");
        }
        assert_eq!(
            made.measurements
                .iter()
                .map(|m| m.sample.as_str())
                .collect::<Vec<_>>(),
            ["ward:brass", "velvet", "satin"]
        );
        // Not a second time into the same place.
        assert!(paper(&out, 22.5, 16, &settings, &|| Duration::ZERO, &Silent).is_err());
    }
}
