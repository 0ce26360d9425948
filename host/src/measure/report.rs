//! What a measurement came to, in words, and its figures.

use std::fs;

use image::{Rgb, RgbImage};
use serde::Serialize;

use super::budget::budget_line;
use super::page::{self, Page};
use crate::assemble::Assembled;
use crate::base::blame::Blame;
use crate::base::text::duration;
use crate::brdf::Brdf;
use crate::brdf::reflectance::Reflectance;
use crate::brdf::sample::Sample;
use crate::capture::Tally;
use crate::capture::directory::{FIGURES, Measurement, MeasurementError, PICTURES};
use crate::hemisphere::judged::{JUDGED_THETA_DEG, RECIPROCAL_THETA_DEG};
use crate::judge::evaluate::{Albedo, Comparison, Evaluation, Quantile, Resolution};
use crate::judge::render::{
    PictureError, automatic_exposure, azimuth_in_words, save, save_described, sheet, sphere, srgb,
};
use crate::measure::goal::{Adapted, Stop};
use crate::plan::brackets::milliseconds;
use crate::store::whole_file::{FileError, write_whole};
use crate::store::{RawStore, StoreError};

/// Lights of the sphere pictures: polar angle and azimuth in degrees.
pub const LIGHTS_DEG: [(f64, f64); 3] = [(45.0, 90.0), (60.0, 0.0), (75.0, 200.0)];
/// Pixels of one sphere.
const SPHERE: usize = 256;
/// Frames on the contact sheet.
const FRAMES: usize = 4;

/// What a measurement came to.
#[derive(Clone, Debug, Serialize)]
pub struct Summary {
    /// Directory of the measurement.
    pub out: String,
    /// Name of the rig.
    pub rig: String,
    /// What was measured: its name, or what stands in the virtual rig.
    pub sample: String,
    /// What else the user says of it.
    pub sample_description: Option<String>,
    /// The incident directions in words.
    pub grid: String,
    /// Degrees between their rings; `None` for a list.
    pub step_deg: Option<f64>,
    /// How the directions were chosen, if that was done on the way.
    pub adaptive: Option<Adapted>,
    /// Pixels a side.
    pub image_size: u32,
    /// Incident directions of the whole grid, those included that the rig cannot light.
    pub incident_directions: usize,
    /// Exposures taken, those with a black pattern included.
    pub exposures: usize,
    /// Exposure time in s, of several the shortest.
    pub exposure_s: f64,
    /// Exposure times in s of each pattern, ascending.
    pub exposures_s: Vec<f64>,
    /// Time that the instrument needs for the exposures, in s.
    pub instrument_s: f64,
    /// What happened on the way.
    pub capture: Tally,
    /// What assembly found.
    pub assembled: Assembled,
    /// How good it is.
    pub evaluation: Evaluation,
    /// Time that each stage took here, in s.
    pub elapsed_s: Elapsed,
}

/// Seconds of computing.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct Elapsed {
    /// Simulating, capturing and storing.
    pub capture: f64,
    /// Assembling.
    pub assemble: f64,
    /// Evaluating.
    pub evaluate: f64,
    /// Drawing.
    pub report: f64,
}

/// Why there is no report.
#[derive(Debug, thiserror::Error)]
pub enum ReportError {
    /// A store.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// A picture.
    #[error(transparent)]
    Picture(#[from] PictureError),
    /// A file.
    #[error(transparent)]
    File(#[from] FileError),
    /// Who measured, when and with what.
    #[error(transparent)]
    Record(#[from] MeasurementError),
}

impl Blame for ReportError {
    fn is_input(&self) -> bool {
        match self {
            Self::Store(error) => error.is_input(),
            Self::Record(error) => error.is_input(),
            Self::Picture(_) | Self::File(_) => false,
        }
    }
}

/// What others state, for comparison: who, and the uncertainty.
pub const PUBLISHED: [(&str, &str); 3] = [
    ("NIST five-axis goniospectrometer", "0.5 % (k = 2)"),
    ("KRISS", "below 3 % (k = 2)"),
    ("a coaxial projector-camera scanner", "within 5.5 %"),
];

/// Draws `figures/`, with `reference` beside what was measured if there is one, and writes `report.html`.
///
/// # Errors
/// [`ReportError`].
pub fn report(
    measurement: &Measurement,
    brdf: &Brdf,
    reference: Option<&dyn Sample>,
    summary: &Summary,
) -> Result<(), ReportError> {
    let figures = measurement.path(FIGURES);
    fs::create_dir_all(&figures).map_err(|source| FileError::at(&figures, source))?;
    let [spheres_png, frames_png] = PICTURES.map(|name| figures.join(name));
    let azimuth = azimuth_in_words(Some(&brdf.azimuth().zero()));
    save_described(&spheres(brdf, reference)?, &spheres_png, Some(&azimuth))?;
    save(&frames(measurement)?, &frames_png)?;
    let page = Page {
        title: &summary.sample,
        lines: lines(summary),
        evaluation: &summary.evaluation,
        pictures: Some([spheres_png.as_path(), frames_png.as_path()]),
        capture: Some(page::Capture::of(measurement)?),
        instrument_s: Some(summary.instrument_s),
    };
    write_whole(
        &measurement.path("report.html"),
        page.html(brdf, reference)?.as_bytes(),
    )?;
    Ok(())
}

/// Measured spheres above, what they are compared with below, one column per light.
fn spheres(brdf: &Brdf, reference: Option<&dyn Sample>) -> Result<RgbImage, StoreError> {
    let row = |material: &dyn Reflectance| {
        LIGHTS_DEG
            .iter()
            .map(|&light| sphere(material, SPHERE, light))
            .collect::<Result<Vec<_>, _>>()
    };
    let mut rows = vec![row(brdf)?];
    if let Some(reference) = reference {
        rows.push(row(&reference)?);
    }
    let exposure = automatic_exposure(&rows);
    Ok(sheet(&rows, exposure))
}

/// Some camera images as they were stored, each stretched to its own range.
fn frames(measurement: &Measurement) -> Result<RgbImage, StoreError> {
    let raw = RawStore::open(&measurement.path("raw.zarr"))?;
    let layout = *raw.layout();
    let patterns = measurement.plan.patterns(&measurement.directions);
    let brackets = measurement.plan.brackets();
    let lit: Vec<usize> = (0..patterns.len() * brackets)
        .filter(|&i| !patterns[i / brackets].is_black())
        .collect();
    let (width, height, channels) = (layout.width, layout.height, layout.channels);
    let mut image = RgbImage::new((width * FRAMES) as u32, height as u32);
    // Without a lit pattern there is nothing to show.
    for column in 0..if lit.is_empty() { 0 } else { FRAMES } {
        // From steep to grazing incidence, at different azimuths.
        let exposure = lit[(lit.len() - 1) * (2 * column + 1) / (2 * FRAMES)];
        let segment = raw.read_segment(exposure / layout.segment)?;
        let frame = &segment.frames[(exposure % layout.segment) * width * height * channels..];
        let frame = &frame[..width * height * channels];
        let low = f32::from(frame.iter().copied().min().unwrap_or(0));
        let high = f32::from(frame.iter().copied().max().unwrap_or(1)).max(low + 1.0);
        for (place, pixel) in frame.chunks_exact(channels).enumerate() {
            let level = |channel: usize| srgb((f32::from(pixel[channel % channels]) - low) / (high - low));
            let (x, y) = ((column * width + place % width) as u32, (place / width) as u32);
            image.put_pixel(x, y, Rgb([level(0), level(1), level(2)]));
        }
    }
    Ok(image::imageops::resize(
        &image,
        (SPHERE * FRAMES) as u32,
        (SPHERE * height / width) as u32,
        image::imageops::FilterType::Nearest,
    ))
}

/// The summary as lines of (what, figure), for the page and the terminal.
#[must_use]
pub fn lines(summary: &Summary) -> Vec<(&'static str, String)> {
    let described = summary.sample_description.as_ref();
    let sample = described.map_or_else(
        || summary.sample.clone(),
        |described| format!("{}: {described}", summary.sample),
    );
    let mut lines = vec![
        ("sample", sample),
        ("rig", summary.rig.clone()),
        (
            "incident directions",
            format!(
                "{} ({}), {} in reach",
                summary.incident_directions, summary.grid, summary.assembled.directions
            ),
        ),
        (
            "exposures",
            format!(
                "{} of {} ms, {} px; {} on the instrument",
                summary.exposures,
                milliseconds(&summary.exposures_s),
                summary.image_size,
                duration(summary.instrument_s)
            ),
        ),
        (
            "triggers",
            format!(
                "{} paired, {} missed, {} frames dropped, {} taken again",
                summary.capture.paired,
                summary.capture.missed_triggers,
                summary.capture.dropped_frames,
                summary.capture.repeated
            ),
        ),
        (
            "samples",
            format!(
                "{} measured, {} saturated",
                summary.assembled.measured, summary.assembled.saturated
            ),
        ),
        ("dynamic range", dynamic_range(summary.assembled.dynamic_range)),
    ];
    lines.extend(summary.adaptive.as_ref().map(adaptive_line));
    lines.extend(evaluation_lines(&summary.evaluation));
    lines
}

fn adaptive_line(adapted: &Adapted) -> (&'static str, String) {
    let decibels = |db: Option<f64>| or_none(db, |db| format!("{db:.1} dB"));
    let predicted = format!(
        "{} captures, {} predicted (f·cosθi at exposure 1, clipped to 1)",
        adapted.captures,
        decibels(adapted.predicted_db)
    );
    let why = match (adapted.stop, adapted.goal.target_db) {
        (Stop::Target, _) => "the target is reached".to_owned(),
        (Stop::Budget, None) => "the budget is used up".to_owned(),
        (stop, target_db) => {
            let why = match stop {
                Stop::Noise => format!(
                    "more captures cannot help: noise alone allows {}",
                    decibels(adapted.noise_limit_db)
                ),
                Stop::Spot => "more captures cannot help: their spots of light would overlap".to_owned(),
                Stop::Target | Stop::Budget => "the budget is used up".to_owned(),
            };
            target_db.map_or(why.clone(), |target_db| {
                format!("the target of {target_db} dB is not reached; {why}")
            })
        }
    };
    ("adaptive", format!("{predicted}: {why}"))
}

/// An evaluation as lines of (what, figure).
#[must_use]
pub fn evaluation_lines(evaluation: &Evaluation) -> Vec<(&'static str, String)> {
    let mut lines = vec![
        ("azimuth", evaluation.azimuth.to_string()),
        (
            "coverage",
            format!(
                "{} of direction pairs with θ ≤ {JUDGED_THETA_DEG}°",
                or_none(evaluation.coverage, percent)
            ),
        ),
        (
            "noise",
            format!(
                "median standard uncertainty {}{}",
                quantile(evaluation.median_relative_sigma),
                match evaluation.uncalibrated.as_deref() {
                    None | Some([]) => String::new(),
                    Some(all) => format!("; of noise and blur, not of {}: not calibrated", all.join(", ")),
                }
            ),
        ),
    ];
    let standards = evaluation.standards.iter();
    lines.extend(standards.map(|standard| ("standard", standard.to_string())));
    let area = evaluation.measured_area;
    lines.extend(area.map(|area| ("measured area", area.to_string())));
    lines.extend(budget_line(&evaluation.budget).map(|line| ("uncertainty", line)));
    lines.extend([
        (
            "reciprocity",
            format!(
                "median residual {} for θ ≤ {RECIPROCAL_THETA_DEG}°, from {} of the pairs",
                or_none(evaluation.reciprocity_residual_median, percent),
                percent(evaluation.reciprocity_share)
            ),
        ),
        ("directional albedo", albedo_line(&evaluation.albedo)),
    ]);
    lines.push(resolution_line(&evaluation.resolution));
    for origin in evaluation.provenance.iter().filter(|origin| origin.share > 0.0) {
        let error = origin.relative_error.map_or_else(String::new, |error| {
            format!(
                ", error median {}, {}",
                quantile(error.median),
                bound("99 %", error.p99)
            )
        });
        lines.push((origin.provenance, format!("{}{error}", percent(origin.share))));
    }
    if let Some(against) = &evaluation.against_reference {
        lines.extend(reference_lines(against));
    }
    lines
}

/// Resolution in degrees.
fn resolution_line(resolution: &Resolution) -> (&'static str, String) {
    (
        "resolution",
        format!(
            "light {}, pixels {} (median), {} (coarsest)",
            or_none(resolution.light_deg, degrees),
            or_none(resolution.pixel_median_deg, degrees),
            or_none(resolution.pixel_worst_deg, degrees)
        ),
    )
}

/// Error against a reference, and what blur has of it.
fn reference_lines(against: &Comparison) -> [(&'static str, String); 2] {
    let error = against.relative_error;
    let psnr = match against.psnr_db {
        _ if against.is_exact => "exact".to_owned(),
        Some(db) => format!("{db:.1} dB"),
        None => "none".to_owned(),
    };
    let blur = against.blur;
    [
        (
            "error",
            format!(
                "median {}, {}, {}; PSNR {psnr}; {} of the pairs are scored, {} of them within k = 2{}",
                quantile(error.median),
                bound("90 %", error.p90),
                bound("99 %", error.p99),
                or_none(against.scored_share, percent),
                or_none(against.within_k2, percent),
                match against.samples - against.scored_samples {
                    0 => String::new(),
                    dark => format!(", {dark} samples of a dark reference are not"),
                }
            ),
        ),
        (
            "blur",
            format!(
                "light {}, pixels {}: these alone make a median error of {}, {}",
                or_none(against.light_deg, degrees),
                or_none(against.pixel_deg, degrees),
                quantile(blur.median),
                bound("99 %", blur.p99)
            ),
        ),
    ]
}

/// The albedo nearest to 45°, or what is known of it.
fn albedo_line(all: &[Albedo]) -> String {
    let near = |albedo: &&Albedo| (albedo.theta_deg - 45.0).abs();
    let Some(at) = all.iter().min_by(|a, b| near(a).total_cmp(&near(b))) else {
        return "none".to_owned();
    };
    let from = |share: f64| match at.filled {
        filled if filled > 0.0 => format!(
            "{} of the hemisphere, {} of it filled in",
            percent(share),
            percent(filled)
        ),
        _ => format!("{} of the hemisphere", percent(share)),
    };
    let known = |value: f64, uncertainty: Option<f64>| {
        format!("{value:.3} ± {:.3} (k = 1)", uncertainty.unwrap_or(f64::NAN))
    };
    match (at.albedo, at.measured_part) {
        (Some(albedo), _) => format!(
            "{} at θi = {}° from {}",
            known(albedo, at.standard_uncertainty),
            at.theta_deg,
            from(at.seen)
        ),
        (None, Some(part)) => format!(
            "none; {} comes back at θi = {}° into the {} that has values",
            known(part, at.part_uncertainty),
            at.theta_deg,
            from(at.seen)
        ),
        (None, None) => format!("none; nothing was measured at θi = {}°", at.theta_deg),
    }
}

/// A figure as `show` writes it, or `none`.
fn or_none(figure: Option<f64>, show: impl Fn(f64) -> String) -> String {
    figure
        .filter(|figure| figure.is_finite())
        .map_or_else(|| "none".to_owned(), show)
}

fn degrees(degrees: f64) -> String {
    format!("{degrees:.2}°")
}

/// A quantile for people.
#[must_use]
pub fn quantile(quantile: Quantile) -> String {
    match quantile {
        Quantile::None => "none".to_owned(),
        Quantile::At(value) => percent(value),
        Quantile::Above(least) => format!("above {}", percent(least)),
    }
}

/// What `share` of the errors lies below, in words.
fn bound(share: &str, quantile: Quantile) -> String {
    match quantile {
        Quantile::None => format!("{share} below: none, too few"),
        Quantile::At(value) if value > 0.0 => format!("{share} below {}", percent(value)),
        Quantile::At(_) => format!("{share} exact"),
        Quantile::Above(least) => format!("{share} not below {}", percent(least)),
    }
}

fn percent(share: f64) -> String {
    if share > 0.0 && share < 5e-5 {
        "under 0.01 %".to_owned()
    } else {
        format!("{:.2} %", share * 100.0)
    }
}

/// A dynamic range (see [`crate::assemble::dynamic_range`]) for people.
#[must_use]
pub fn dynamic_range(ratio: Option<f64>) -> String {
    let ratio = or_none(ratio, |ratio| format!("{ratio:.0} : 1"));
    format!("{ratio}, from saturation to the noise without light")
}

/// Text as HTML.
pub(crate) fn escape(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
}
