//! Assembly: frames of `raw.zarr` → BRDF with uncertainty.
//!
//! # Design
//! The signal model: the digital number of the camera pixel that looks along ω_o, exposed for t, is
//!
//! g(ω_o) = dark(t) + K · t · T_o(ω_o) · Σ_p f(ω_p, ω_o) · E_p · cosθ_p · Δω_p
//!
//! over the lit projector pixels p, of intensity E_p, direction ω_p and solid angle Δω_p at the sample; its variance is
//! var(g) = σ_read² + (g − dark)/gain with the gain in electrons per number (the photon-transfer curve). Solved for f, which hardly changes over the small
//! spot: f = (g − dark) / (K·t·T_o·Σ E·cosθ·Δω), where the sum is over the pixels that were actually lit, not those that should have
//! been. T_o and E_p are those of the rig file, which are uniform; what calibration found instead comes in behind (`correction`).
//!
//! Code patterns are shared out into the images of single directions (`assemble/coded`). Exposures of different length are merged
//! pixel by pixel (`assemble/merge.rs`) before anything else. Then what came other ways is taken away (`assemble/stray.rs`).
//!
//! Camera pixels, if the plan says so fused with what their surroundings say of them (`assemble/surroundings.rs`), are interpolated linearly onto the
//! outgoing disk. The standard uncertainty of noise follows from the variance above, 1/6
//! for rounding with dither, and that of the mean dark frame; `correction` adds what else there is. With noise go what the pixels'
//! responses differ by, each pixel's own, and the noise of rows, which pixels of a row have in common. Calibration saw pixels of another
//! size of image: what each of these responds by is not known, and stated for all alike. What pixels differ by in the dark is in the
//! black frames, of the same exposure time; beside it the dark level that linearisation starts from errs by 2β·offset/range, 10⁻⁵ of the
//! signal.
//!
//! What no pixel sees, what saturated and what nothing lit is NaN from the first step on: no sum may take it for a dark sample.
//!
//! Frames are read ahead by one thread while the others compute and write; memory holds a few segments.

pub mod combine;
pub mod fill;
pub(crate) mod resample;
pub mod turn;

use std::collections::BTreeSet;
use std::path::Path;

use glam::DVec3;
use serde_json::Value;

use crate::assemble::resample::Resampling;
use crate::base::text::by;
use crate::brdf::budget::BudgetSums;
use crate::brdf::{Brdf, COMMON_UNCERTAINTY};
use crate::hemisphere::disk::Disk;
use crate::instrument::calibration::AppliedCalibration;
use crate::instrument::frame_format::FrameFormat;
use crate::instrument::optics::{Unmeasurable, View};
use crate::instrument::rig::Rig;
use crate::plan::brackets::dark_noise_dn;
use crate::plan::{Directions, Exposure, Plan};
use crate::store::{BrdfLayout, BrdfWriter, RawStore, Segment};

mod agreement;
mod bias;
mod chunks;
mod coded;
mod colours;
mod coordinates;
mod correction;
mod edges;
mod error;
mod interreflection;
pub(crate) mod like;
mod lit;
mod luminance;
mod merge;
mod off_sample;
mod polarisation;
mod probe;
mod projection;
mod radiometry;
mod shape;
pub mod share;
mod stray;
mod surroundings;
mod window;

use chunks::Chunks;
use coded::Cells;
use coordinates::{attributes, common_uncertainty};
pub(crate) use coordinates::{coordinates, interpolation_errors, list_attributes};
use correction::Correction;
use edges::Edges;
pub use error::AssembleError;
use off_sample::OffSample;
pub use probe::{Probe, Probed};
use projection::Projection;
use radiometry::{BlackFrames, usual_lag};
use share::{Share, Written};
use stray::StrayLight;
use surroundings::Surroundings;
use window::Agree;

pub(crate) use luminance::{FrameAssembler, certainly_lit};

/// Incident directions per chunk of `brdf.zarr`.
pub const CHUNK: usize = 32;

/// What assembly found.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct Assembled {
    /// Incident directions with data.
    pub directions: usize,
    /// Frames that went in.
    pub frames: usize,
    /// Samples (incident × cell) with a value.
    pub measured: u64,
    /// Samples that no pixel could see without saturating.
    pub saturated: u64,
    /// Largest f that does not saturate over the noise-equivalent f, see [`dynamic_range`]; `None` if there is none.
    pub dynamic_range: Option<f64>,
}

impl Assembled {
    /// Adds what was found in other chunks.
    fn add(&mut self, other: &Self) {
        self.directions += other.directions;
        self.frames += other.frames;
        self.measured += other.measured;
        self.saturated += other.saturated;
    }
}

/// The dynamic range of exposures of `exposures_s` seconds (ascending) of the camera of `rig`, at any incident direction:
/// the largest f that does not saturate the shortest over the noise-equivalent f, which is the standard deviation (k = 1)
/// of f in the longest where there is no light. For one exposure it is that of the camera (EMVA 1288: saturation capacity
/// over temporal dark noise). `None` without an exposure, or if the camera has neither range nor noise.
#[must_use]
pub fn dynamic_range(rig: &Rig, exposures_s: &[f64]) -> Option<f64> {
    let (shortest_s, longest_s) = (exposures_s.first()?, exposures_s.last()?);
    let range_dn = rig.range_dn();
    let ratio = (range_dn / shortest_s) / (dark_noise_dn(rig, *longest_s) / longest_s);
    (ratio.is_finite() && ratio > 0.0).then_some(ratio)
}

/// Where a result is written, and what it says of where it comes from.
#[derive(Clone, Copy, Debug)]
pub struct Target<'a> {
    /// The `brdf.zarr`.
    pub path: &'a Path,
    /// Its lineage (see [`Measurement::lineage`](crate::capture::directory::Measurement::lineage)), if that is known.
    pub lineage: Option<&'a Value>,
    /// What is wanted of one sample; with it that one's chunk alone is made.
    pub probe: Option<&'a Probe>,
    /// Which of its chunks are made now.
    pub share: Share,
}

/// Assembles the frames of `raw` into `brdf.zarr` at `target`; `progress` is told the number of frames done.
/// An older result is replaced when the new one is whole. `applied` is what calibration found of the instrument.
///
/// # Errors
/// [`AssembleError`].
pub fn assemble(
    rig: &Rig,
    plan: &Plan,
    directions: &Directions,
    applied: &AppliedCalibration,
    raw_path: &Path,
    target: Target<'_>,
    progress: &(dyn Fn(usize) + Sync),
) -> Result<Assembled, AssembleError> {
    let mismatch = |reason: String| AssembleError::Mismatch {
        path: raw_path.display().to_string(),
        reason,
    };
    let raw = RawStore::open(raw_path)?;
    let patterns = plan.patterns(directions);
    let format = rig.frame_format();
    check_layout(&raw, plan, &format).map_err(mismatch)?;
    let disk = Disk::new(plan.request.image_size as usize);
    let edges = Edges::new(applied.edge_deg);
    let off_sample = OffSample::new(applied, plan)?;
    let resampling = seen((rig, plan), &edges, &off_sample, disk);
    let grid = &directions.grid;
    let reasons = Probe::left(target.probe, missing(rig, plan, directions, &edges, &off_sample));
    let of_calibration = |reason: String| AssembleError::Mismatch {
        path: raw_path
            .with_file_name(AppliedCalibration::FILE)
            .display()
            .to_string(),
        reason,
    };
    let mut correction =
        Correction::new(rig, plan, directions, applied, disk, &resampling).map_err(of_calibration)?;
    let exposures_s = plan.exposures_s();
    let agree = |number: usize, segment: &Segment| {
        let first = raw.segment_range(number).start;
        agreement::check(first, &segment.records, &patterns, &exposures_s).map_err(mismatch)
    };
    let black = black_frames((rig, plan, applied), &raw, &patterns, &agree)?;
    let black = black.finish(rig, plan).map_err(mismatch)?;
    let stray = StrayLight::new(rig, plan, applied, &correction, black.lamp_variance);
    let lamp = stray
        .as_ref()
        .map(|stray| stray.lamp(&black.radiometry, format.channels))
        .transpose()
        .map_err(of_calibration)?;
    if let Some(level) = lamp {
        correction.set_lamp(level);
    }
    if let Some(photometry) = &applied.photometry {
        correction.learn(rig, photometry, &black.radiometry, &resampling);
    }
    let (path, _together) = target.share.begin(target.path)?;
    let writer = BrdfWriter::create(
        &path,
        layout(grid.len(), disk, format.channels),
        &coordinates(grid, &reasons, disk, &resampling.reasons, &resampling.pixel_sr),
        attributes(rig, plan, applied, lamp, &resampling, target.lineage),
        true,
    )?;
    let written = if target.share == Share::Finish {
        share::gather(target.path, &writer)?
    } else {
        let projection = Projection {
            channels: format.channels,
            disk,
            radiometry: black.radiometry,
            drift: black.drift,
            segment: plan.segment,
            stray,
            resampling,
        };
        let frames = (&raw, raw_path, &patterns[..], &agree as &Agree<'_>);
        let means = (projection, correction);
        write_chunks(
            (rig, plan, directions),
            frames,
            means,
            &writer,
            (&target, &reasons),
            progress,
        )?
    };
    let range = dynamic_range(rig, &exposures_s).map(|ratio| ratio * applied.linear_to());
    let common = |shared: f64| common_uncertainty(applied, lamp, shared);
    concluded(&target, writer, &written, (plan, range), common)
}

/// Puts what was `written` for `target` under its name; `common` says what all values share by what the standards and the lamp make of it.
fn concluded(
    target: &Target<'_>,
    writer: BrdfWriter,
    written: &[Written],
    (plan, dynamic_range): (&Plan, Option<f64>),
    common: impl Fn(f64) -> Option<f64>,
) -> Result<Assembled, AssembleError> {
    let (total, budget) = share::sum(written);
    let total = Assembled {
        dynamic_range,
        ..counted(plan, total)
    };
    if let Share::Part(part) = target.share {
        part.finish(writer, written)?;
        return Ok(total);
    }
    finished(writer, (&budget, common(budget.shared())))?;
    if target.share == Share::Finish {
        share::remove(target.path)?;
    }
    Ok(total)
}

/// Writes the chunks of the share that `target` is of, from the frames of `raw` at `raw_path`, which show these `patterns`.
fn write_chunks(
    subject: (&Rig, &Plan, &Directions),
    (raw, raw_path, patterns, agree): (&RawStore, &Path, &[Exposure], &Agree<'_>),
    (mut projection, correction): (Projection, Correction),
    writer: &BrdfWriter,
    (target, reasons): (&Target<'_>, &[Option<Unmeasurable>]),
    progress: &(dyn Fn(usize) + Sync),
) -> Result<Vec<Written>, AssembleError> {
    let (_, plan, directions) = subject;
    bias::learn(&mut projection, (plan, directions), raw, patterns, agree)?;
    let cells = Cells::of(subject, &projection, raw, agree, writer.partial_path(), progress)?;
    let chunks = Chunks {
        places: match &cells {
            None => places(raw, patterns, plan.brackets(), reasons),
            Some(cells) => cells.places(reasons),
        },
        probe: target.probe,
        projection,
        correction,
        cells,
        writer,
    };
    let made = target.share.chunks(directions.grid.len().div_ceil(CHUNK));
    if chunks.cells.is_some() {
        return Ok(chunks.write_cells(made)?);
    }
    let mismatch = |reason| AssembleError::Mismatch {
        path: raw_path.display().to_string(),
        reason,
    };
    chunks.write(made, raw_path, agree, mismatch, progress)
}

/// `total` with the number of frames that went in: of code patterns all did, into every chunk.
fn counted(plan: &Plan, total: Assembled) -> Assembled {
    let frames = if plan.code.is_some() {
        plan.lit_patterns() * plan.brackets()
    } else {
        total.frames
    };
    Assembled { frames, ..total }
}

/// Writes what the values and their `budget` say of the whole, and puts the file of the `writer` under its name.
fn finished(
    mut writer: BrdfWriter,
    (budget, common): (&BudgetSums, Option<f64>),
) -> Result<(), AssembleError> {
    if let Some(common) = common {
        writer.state(COMMON_UNCERTAINTY, common.into())?;
    }
    for array in BudgetSums::arrays(Some(budget)) {
        writer.rewrite(&array)?;
    }
    let errors = Brdf::open(writer.partial_path())?.learn()?;
    writer.rewrite(&interpolation_errors(errors.as_ref()))?;
    Ok(writer.finish()?)
}

/// Of so many incident directions.
const fn layout(incident: usize, disk: Disk, channels: usize) -> BrdfLayout {
    BrdfLayout {
        incident,
        grid: disk.size(),
        channels,
        chunk: CHUNK,
    }
}

/// Refuses frames of another number or `format` than those of `plan`, with the reason.
fn check_layout(raw: &RawStore, plan: &Plan, format: &FrameFormat) -> Result<(), String> {
    let layout = raw.layout();
    let found = [
        layout.exposures,
        layout.height,
        layout.width,
        layout.channels,
        layout.bits.into(),
    ];
    let expected = [
        plan.len(),
        format.height_px,
        format.width_px,
        format.channels,
        format.bits.into(),
    ];
    if found != expected {
        return Err(format!(
            "exposures × rows × columns × channels × bits: expected {} from rig and plan, found {}",
            by(&expected),
            by(&found)
        ));
    }
    Ok(())
}

/// Why each incident direction has no value: as `directions` say by the rig, or because its spot may not light the sample.
fn missing(
    rig: &Rig,
    plan: &Plan,
    directions: &Directions,
    edges: &Edges,
    off_sample: &OffSample<'_>,
) -> Vec<Option<Unmeasurable>> {
    let projector = View::projector(rig);
    let by_rig = directions.reasons.iter().enumerate();
    by_rig
        .map(|(index, by_rig)| {
            by_rig.or_else(|| {
                unlit(
                    &projector,
                    plan.spot_deg,
                    edges,
                    off_sample,
                    directions.grid.direction(index),
                )
            })
        })
        .collect()
}

/// Where each incident direction's first frame is: (segment, place in it). `patterns` are exposed `brackets` times each;
/// a direction that has no value for one of `reasons` has no place.
fn places(
    raw: &RawStore,
    patterns: &[Exposure],
    brackets: usize,
    reasons: &[Option<Unmeasurable>],
) -> Vec<Option<(usize, usize)>> {
    let mut places = vec![None; reasons.len()];
    for segment in 0..raw.segments() {
        for (place, exposure) in raw.segment_range(segment).enumerate().step_by(brackets) {
            if let Exposure::Incident(index) = patterns[exposure / brackets] {
                places[index] = reasons[index].is_none().then_some((segment, place));
            }
        }
    }
    places
}

/// None yet of those that `plan` takes on `rig`.
fn no_black_frames(rig: &Rig, plan: &Plan, applied: &AppliedCalibration) -> BlackFrames {
    let usual = usual_lag(rig, &plan.timings());
    let exposures: Vec<(f64, f64)> = plan.exposures_s().into_iter().zip(usual).collect();
    BlackFrames::new(rig, applied.camera_and_lamp(), &exposures)
}

/// The black ones of the frames of `raw`, which show the `patterns` of a plan.
fn black_frames(
    (rig, plan, applied): (&Rig, &Plan, &AppliedCalibration),
    raw: &RawStore,
    patterns: &[Exposure],
    agree: &Agree<'_>,
) -> Result<BlackFrames, AssembleError> {
    let shown = patterns.iter().enumerate();
    let black = shown.filter(|(_, exposure)| exposure.is_black());
    let segments: BTreeSet<usize> = black
        .map(|(pattern, _)| pattern * plan.brackets() / plan.segment)
        .collect();
    let mut frames = no_black_frames(rig, plan, applied);
    for number in segments {
        let segment = raw.read_segment(number)?;
        agree(number, &segment)?;
        frames.add(
            raw.segment_range(number).start,
            &segment,
            rig.frame_format().len(),
        );
    }
    Ok(frames)
}

/// Why a spot of `spot_deg` degrees from `w`, which the `projector` has by the rig file, may not light the sample as a whole;
/// `None` if it does for certain.
fn unlit(
    projector: &View,
    spot_deg: f64,
    edges: &Edges,
    off_sample: &OffSample<'_>,
    w: DVec3,
) -> Option<Unmeasurable> {
    edges
        .cuts_light(projector, spot_deg, w)
        .or_else(|| off_sample.is_missed(w).then_some(Unmeasurable::OffSample))
}

/// How the camera pixels of `rig` that see nothing but the sample become cells of `disk`, as `plan` has it.
fn seen((rig, plan): (&Rig, &Plan), edges: &Edges, off_sample: &OffSample<'_>, disk: Disk) -> Resampling {
    let camera = View::camera(rig);
    let mut cut = edges.cut_pixels(&camera);
    off_sample.cut_pixels(&mut cut, &camera);
    let surroundings = plan.request.estimate.then(|| Surroundings::new(&camera, &cut));
    Resampling {
        surroundings,
        ..Resampling::new(&camera, &cut, disk)
    }
}
