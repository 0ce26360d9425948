//! Assembly: frames of `raw.zarr` → BRDF with uncertainty.
//!
//! # Design
//! The signal model: the digital number of the camera pixel that looks along ω_o, exposed for t, is
//!
//! g(ω_o) = dark(t) + K · t · T_o(ω_o) · Σ_p f(ω_p, ω_o) · E_p · cosθ_p · Δω_p
//!
//! over the lit projector pixels p, of intensity E_p, direction ω_p and solid angle Δω_p at the sample; its variance
//! is var(g) = σ_read² + (g − dark)/gain with the gain in electrons per number (the photon-transfer curve).
//! Solved for f, which hardly changes over the small spot: f = (g − dark) / (K·t·T_o·Σ E·cosθ·Δω), where the sum is
//! over the pixels that were actually lit, not those that should have been. T_o and E_p are those of the rig file, which
//! are uniform; nothing calibrates them yet.
//!
//! Camera pixels are interpolated linearly onto the outgoing disk. The standard uncertainty follows from the
//! variance above, 1/12 for rounding, and that of the mean dark frame.
//!
//! Frames are read ahead by one thread while the others compute and write; memory holds a few segments.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::mpsc::sync_channel;

use glam::Vec4;
use half::f16;
use half::slice::HalfFloatSliceExt as _;
use rayon::prelude::*;
use serde_json::{Map, Value, json};

use crate::brdf::{Brdf, BrdfError, ERRORS};
use crate::disk::Disk;
use crate::incident::Grid;
use crate::interpolation::{BRANCHES, Errors, REGIONS};
use crate::optics::{Unmeasurable, View};
use crate::plan::{Directions, Plan};
use crate::provenance::Provenance;
use crate::resample::Resampling;
use crate::rig::Rig;
use crate::store::{BrdfLayout, BrdfRows, BrdfWriter, RawStore, Segment, SmallArray, SmallData, StoreError};

mod luminance;

pub(crate) use luminance::FrameAssembler;

/// Incident directions per chunk of `brdf.zarr`.
pub const CHUNK: usize = 32;
/// Chunks that are computed at a time.
const BATCH: usize = 32;

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
}

/// Numbers that turn a frame into f, the same for all frames.
struct Radiometry {
    /// Mean of the black frames, [pixel, channel].
    dark: Vec<f32>,
    /// Variance of a dark-corrected number without light, in DN².
    dark_variance: f32,
    /// Variance per DN of signal, in DN.
    shot_per_dn: f32,
    /// f per (DN / (s × irradiance)).
    scale: f64,
    saturation: u16,
}

impl Radiometry {
    fn new(rig: &Rig, segment: &Segment, pixels: usize) -> Result<Self, String> {
        let gain = rig.gain_e_per_dn();
        let mut sum = vec![0_u64; pixels];
        let mut count = 0_u32;
        for (record, frame) in segment.records.iter().zip(segment.frames.chunks_exact(pixels)) {
            if record.incident < 0 {
                count += 1;
                for (sum, &dn) in sum.iter_mut().zip(frame) {
                    *sum += u64::from(dn);
                }
            }
        }
        if count == 0 {
            return Err("expected black exposures in the first segment, found none".to_owned());
        }
        let read_dn = rig.camera.read_noise_e / gain;
        let one = read_dn * read_dn + 1.0 / 12.0;
        Ok(Self {
            dark: sum
                .into_iter()
                .map(|sum| (sum as f64 / f64::from(count)) as f32)
                .collect(),
            dark_variance: (one * (1.0 + 1.0 / f64::from(count))) as f32,
            shot_per_dn: (1.0 / gain) as f32,
            scale: gain / rig.sensitivity_e(),
            saturation: rig.saturation_dn(),
        })
    }
}

/// What one worker keeps from chunk to chunk.
#[derive(Default)]
struct Work {
    /// Dark-corrected signal of each pixel in DN, its channels in the lanes; NaN where it saturated.
    signal: Vec<Vec4>,
    /// Standard uncertainties of a row, before they are halved in width.
    sigma: Vec<f32>,
    rows: BrdfRows,
}

/// One frame onto the disk: writes f, sigma and provenance of one incident direction, at the cells that have
/// taps. Returns how many of them were measured and how many saturated.
fn project<const CHANNELS: usize>(
    frame: &[u16],
    factor: f32,
    radiometry: &Radiometry,
    resampling: &Resampling,
    (signal, sigma): (&mut Vec<Vec4>, &mut [f32]),
    (out_f, out_sigma, out_provenance): (&mut [f32], &mut [f16], &mut [u8]),
) -> (u64, u64) {
    signal.clear();
    signal.extend(
        frame
            .chunks_exact(CHANNELS)
            .zip(radiometry.dark.chunks_exact(CHANNELS))
            .map(|(dn, dark)| {
                let mut lanes = [0.0; 4];
                for channel in 0..CHANNELS {
                    // A saturated pixel spoils every cell that it takes part in, and no other.
                    let saturated = dn[channel] >= radiometry.saturation;
                    lanes[channel] = if saturated {
                        f32::NAN
                    } else {
                        f32::from(dn[channel]) - dark[channel]
                    };
                }
                Vec4::from_array(lanes)
            }),
    );
    let (mut measured, mut saturated) = (0, 0);
    for taps in &resampling.taps {
        let cell = taps.cell as usize;
        let mut sum = Vec4::ZERO;
        let mut variance = Vec4::ZERO;
        for (&pixel, &weight) in taps.pixel.iter().zip(&taps.weight) {
            let signal = signal[pixel as usize];
            let shot = signal.max(Vec4::ZERO) * radiometry.shot_per_dn;
            sum += signal * weight;
            variance += (shot + radiometry.dark_variance) * (weight * weight);
        }
        let clear = !sum.is_nan();
        let (f, uncertainty) = if clear {
            // The largest number of f16 stands for "useless".
            let root = Vec4::from_array(variance.to_array().map(f32::sqrt));
            (sum * factor, (root * factor).min(Vec4::splat(65_504.0)))
        } else {
            (Vec4::ZERO, Vec4::ZERO)
        };
        let at = cell * CHANNELS;
        out_f[at..at + CHANNELS].copy_from_slice(&f.to_array()[..CHANNELS]);
        sigma[at..at + CHANNELS].copy_from_slice(&uncertainty.to_array()[..CHANNELS]);
        out_provenance[cell] = if clear {
            Provenance::Measured.code()
        } else {
            Provenance::Missing.code()
        };
        measured += u64::from(clear);
        saturated += u64::from(!clear);
    }
    out_sigma.convert_from_f32_slice(sigma);
    (measured, saturated)
}

/// Why assembly failed.
#[derive(Debug, thiserror::Error)]
pub enum AssembleError {
    /// A store.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// What was assembled cannot be read again.
    #[error(transparent)]
    Brdf(#[from] BrdfError),
    /// The raw frames do not belong to the plan.
    #[error("{path}: {reason}")]
    Mismatch {
        /// The raw store.
        path: String,
        /// What is wrong.
        reason: String,
    },
}

/// Assembles the frames of `raw` into `brdf.zarr` at `target`; `progress` is told the number of frames done.
/// An older result is replaced when the new one is whole.
///
/// # Errors
/// [`AssembleError`].
pub fn assemble(
    rig: &Rig,
    plan: &Plan,
    directions: &Directions,
    raw_path: &Path,
    target: &Path,
    progress: &(dyn Fn(usize) + Sync),
) -> Result<Assembled, AssembleError> {
    let mismatch = |reason: String| AssembleError::Mismatch {
        path: raw_path.display().to_string(),
        reason,
    };
    let raw = RawStore::open(raw_path)?;
    let exposures = plan.exposures(directions);
    let layout = raw.layout();
    let format = rig.frame_format();
    let found = (layout.exposures, layout.height, layout.width, layout.channels);
    let expected = (
        exposures.len(),
        format.height_px,
        format.width_px,
        format.channels,
    );
    if found != expected {
        return Err(mismatch(format!(
            "expected (exposures, rows, columns, channels) = {expected:?} from the plan, found {found:?}"
        )));
    }
    let channels = format.channels;
    let disk = Disk::new(plan.request.image_size as usize);
    let resampling = Resampling::new(&View::camera(rig), disk);
    let grid = &directions.grid;
    let brdf_layout = BrdfLayout {
        incident: grid.len(),
        grid: disk.size(),
        channels,
        chunk: CHUNK,
    };
    let writer = BrdfWriter::create(
        target,
        brdf_layout,
        &coordinates(directions, disk, &resampling),
        attributes(rig, plan),
        true,
    )?;

    // Where each incident direction's frame is: (segment, place in it).
    let mut places = vec![None; grid.len()];
    for segment in 0..raw.segments() {
        for (place, exposure) in raw.segment_range(segment).enumerate() {
            if let crate::plan::Exposure::Incident(index) = exposures[exposure] {
                places[index] = Some((segment, place));
            }
        }
    }

    let mut total = Assembled::default();
    let radiometry = Radiometry::new(rig, &raw.read_segment(0)?, format.len()).map_err(mismatch)?;
    std::thread::scope(|scope| -> Result<(), AssembleError> {
        let (tx, rx) = sync_channel::<Result<Segment, StoreError>>(2);
        let reader = RawStore::open(raw_path)?;
        scope.spawn(move || {
            for segment in 0..reader.segments() {
                if tx.send(reader.read_segment(segment)).is_err() {
                    break; // the receiver has failed and gone
                }
            }
        });
        let mut window: BTreeMap<usize, Segment> = BTreeMap::new();
        let mut next_segment = 0;
        let chunks = grid.len().div_ceil(CHUNK);
        for first in (0..chunks).step_by(BATCH) {
            let batch = first..(first + BATCH).min(chunks);
            let rows = batch.start * CHUNK..(batch.end * CHUNK).min(grid.len());
            let needed = places[rows.clone()]
                .iter()
                .flatten()
                .map(|place: &(usize, usize)| place.0);
            let (Some(low), Some(high)) = (needed.clone().min(), needed.max()) else {
                continue;
            };
            window.retain(|&segment, _| segment >= low);
            while next_segment <= high {
                let segment = rx
                    .recv()
                    .map_err(|_| mismatch("the reading thread has ended".to_owned()))??;
                if next_segment >= low {
                    window.insert(next_segment, segment);
                }
                next_segment += 1;
            }
            let counts = batch
                .into_par_iter()
                .map_init(Work::default, |work, chunk| {
                    let range = chunk * CHUNK..((chunk + 1) * CHUNK).min(grid.len());
                    if places[range.clone()].iter().all(Option::is_none) {
                        return Ok(Assembled::default()); // an absent chunk means missing
                    }
                    let counts = chunk_rows(
                        &places[range],
                        &window,
                        channels,
                        disk,
                        &radiometry,
                        &resampling,
                        work,
                    );
                    writer.write_chunk(chunk, &work.rows)?;
                    Ok(counts)
                })
                .collect::<Result<Vec<Assembled>, StoreError>>()?;
            for counts in counts {
                total.directions += counts.directions;
                total.frames += counts.frames;
                total.measured += counts.measured;
                total.saturated += counts.saturated;
            }
            progress(total.frames);
        }
        Ok(())
    })?;
    let errors = Brdf::open(writer.partial_path())?.learn()?;
    writer.rewrite(&interpolation_errors(errors.as_ref()))?;
    writer.finish()?;
    Ok(total)
}

/// Fills the rows of one chunk: `places` says in which segment and where each incident direction was captured.
fn chunk_rows(
    places: &[Option<(usize, usize)>],
    window: &BTreeMap<usize, Segment>,
    channels: usize,
    disk: Disk,
    radiometry: &Radiometry,
    resampling: &Resampling,
    work: &mut Work,
) -> Assembled {
    let row = disk.len() * channels;
    let pixels = radiometry.dark.len();
    let Work { signal, sigma, rows } = work;
    // Cells without taps are never written, so what the last chunk left there is zero.
    sigma.resize(row, 0.0);
    rows.f.resize(places.len() * row, 0.0);
    rows.sigma.resize(places.len() * row, f16::ZERO);
    rows.provenance
        .resize(places.len() * disk.len(), Provenance::Missing.code());
    let mut counts = Assembled::default();
    let outs = rows
        .f
        .chunks_exact_mut(row)
        .zip(rows.sigma.chunks_exact_mut(row))
        .zip(rows.provenance.chunks_exact_mut(disk.len()));
    for (place, ((f, row_sigma), provenance)) in places.iter().zip(outs) {
        let Some((segment, at)) = *place else {
            f.fill(0.0);
            row_sigma.fill(f16::ZERO);
            provenance.fill(Provenance::Missing.code());
            continue;
        };
        let segment = &window[&segment];
        let record = &segment.records[at];
        let frame = &segment.frames[at * pixels..][..pixels];
        let factor = (radiometry.scale / (record.exposure_s * record.lit_irradiance)) as f32;
        let scratch = (&mut *signal, sigma.as_mut_slice());
        let out = (f, row_sigma, provenance);
        let (measured, saturated) = match channels {
            1 => project::<1>(frame, factor, radiometry, resampling, scratch, out),
            _ => project::<3>(frame, factor, radiometry, resampling, scratch, out),
        };
        counts.directions += 1;
        counts.frames += 1;
        counts.measured += measured;
        counts.saturated += saturated;
    }
    counts
}

/// The errors of the rules of interpolation, zeros if they are not known.
fn interpolation_errors(errors: Option<&Errors>) -> SmallArray<'static> {
    let shape = vec![REGIONS, BRANCHES];
    let values = errors.map_or_else(
        || vec![0.0; REGIONS * BRANCHES],
        |errors| errors.as_slice().to_vec(),
    );
    SmallArray {
        name: ERRORS,
        dims: &["region", "branch"],
        shape,
        data: SmallData::F64(values),
        units: "1",
        long_name: "expected error of each way to interpolate, relative to white",
        codes: &[],
    }
}

fn coordinates(directions: &Directions, disk: Disk, resampling: &Resampling) -> [SmallArray<'static>; 6] {
    let grid = &directions.grid;
    let angle = |pick: fn((f64, f64)) -> f64| (0..grid.len()).map(|i| pick(grid.angles_deg(i))).collect();
    let codes = |reasons: &[Option<Unmeasurable>]| {
        reasons
            .iter()
            .map(|reason| reason.map_or(0, Unmeasurable::code))
            .collect()
    };
    let small = |name, dims, shape, data, units, long_name| SmallArray {
        name,
        dims,
        shape,
        data,
        units,
        long_name,
        codes: &[],
    };
    [
        small(
            "incident_theta",
            &["incident"],
            vec![grid.len()],
            SmallData::F64(angle(|angles| angles.0)),
            "degree",
            "polar angle of the incident direction",
        ),
        small(
            "incident_phi",
            &["incident"],
            vec![grid.len()],
            SmallData::F64(angle(|angles| angles.1)),
            "degree",
            "azimuth of the incident direction",
        ),
        small(
            "incident_reason",
            &["incident"],
            vec![grid.len()],
            SmallData::U8(codes(&directions.reasons)),
            "1",
            "why the incident direction cannot be lit; 0 = it can",
        ),
        small(
            "outgoing_reason",
            &["y", "x"],
            vec![disk.size(), disk.size()],
            SmallData::U8(codes(&resampling.reasons)),
            "1",
            "why the outgoing direction cannot be seen; 0 = it can",
        ),
        small(
            "outgoing_pixel",
            &["y", "x"],
            vec![disk.size(), disk.size()],
            SmallData::F64(resampling.pixel_sr.clone()),
            "sr",
            "solid angle of the camera pixel that sees the outgoing direction",
        ),
        interpolation_errors(None),
    ]
}

fn attributes(rig: &Rig, plan: &Plan) -> Map<String, Value> {
    let incident = match plan.request.grid {
        Grid::ThetaPhi { .. } => {
            "theta = (ring + 1/2) step, phi = sector step, index = ring * (360/step) + sector"
        }
        Grid::EqualSolidAngle { .. } => {
            "theta = (ring + 1/2) step, ceil(360 sin(theta)/step) directions on each ring, from phi = 0 on"
        }
        Grid::List { .. } => "any directions, interpolated on their spherical Delaunay triangulation",
    };
    let attributes = json!({
        "title": "bidirectional reflectance distribution function f in 1/sr, without the cosine",
        "incident_grid": incident,
        "incident_kind": plan.request.grid.kind(),
        "outgoing_grid": "Lambert azimuthal equal-area disk: x + iy = sqrt(2) sin(theta/2) exp(i phi), -1..1",
        "step_deg": plan.request.grid.step_deg(),
        "rig": rig.name,
        "spot_deg": plan.spot_deg,
        "exposure_s": plan.exposure_s,
        "source": concat!("rcg ", env!("CARGO_PKG_VERSION")),
    });
    match attributes {
        Value::Object(mut map) => {
            map.retain(|_, value| !value.is_null());
            map
        }
        _ => Map::new(),
    }
}
