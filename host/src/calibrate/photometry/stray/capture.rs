//! The views that show stray light.
//!
//! # Design
//! | in the holder | shown | to see |
//! |---|---|---|
//! | a flat mirror | discs, small and large, all over the image | glare and ghost, where it should be dark |
//! | light trap | the same discs, as long | what of that comes directly |
//! | light trap | parts of the image, all of it in turns | direct light of the projector |
//! | light trap | what watches the lamp, as long as the standard is exposed | how bright the lamp is |
//!
//! Every segment ends with [`BLACK`] black exposures of its kind. The image is finer than that of the standard, so that a
//! ghost stands apart from what makes it.

use std::path::Path;

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::super::capture::{SEGMENT, VIEWS, layout};
use crate::calibrate::by_hand::Bench;
use crate::calibrate::{CalibrateError, create_raw, segment_of};
use crate::capture::pilot::TestExposures;
use crate::capture::{Instrument, Tally};
use crate::instrument::calibration::lamp::side;
use crate::instrument::monitor::{BLOCK_PX, watching};
use crate::instrument::rig::Rig;
use crate::plan;
use crate::plan::schedule::{SHORTEST_EXPOSURE_S, Timing};
use crate::store::{RawStore, Segment};
use crate::virtual_rig::{FlatMirror, Held};

/// Name of the raw frames.
pub(in super::super) const RAW: &str = "stray.raw.zarr";
/// Pixels a side of the camera's image, if the sensor has so many.
const IMAGE_SIZE: u32 = 256;
/// Black exposures at the end of each segment.
pub(super) const BLACK: usize = 4;
/// Patterns of a segment.
pub(super) const PATTERNS: usize = SEGMENT - BLACK;
/// Segments of discs, which are shown twice, and of parts.
pub(super) const DISCS: usize = 2;
const PARTED: usize = PARTS[0] * PARTS[1] / PATTERNS;
/// The first segment of parts.
pub(super) const FIRST_PARTED: usize = 2 * DISCS;
/// The segment of what watches the lamp.
pub(super) const WATCHED: usize = FIRST_PARTED + PARTED;
/// All of them.
pub(in super::super) const SEGMENTS: usize = WATCHED + 1;
/// Reflectance of the flat mirror: a surface of black glass.
const REFLECTANCE: f64 = 0.04;
/// Share of the longest exposure that does not saturate: glare is told by what is not saturated.
const SHARE: f64 = 0.7;
/// Discs: distances of their middles from that of the image, and radii, in half heights of the projector's image.
const DISTANCES: [f64; 3] = [0.45, 0.65, 0.8];
const RADII: [f64; 3] = [0.06, 0.15, 0.35];
/// Parts of the projector's image, columns and rows.
const PARTS: [usize; 2] = [8, 6];

/// What was captured.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(in super::super) struct StrayViews {
    /// Pixels a side of the camera's image.
    pub(super) image_size: u32,
    /// Exposure times of discs, and of parts, seconds.
    pub(super) discs_s: f64,
    pub(super) parts_s: f64,
    /// Side in pixels of the squares that watch the lamp in all views of standards, 0 for none, and how long they are exposed,
    /// seconds.
    pub(in super::super) watching_side: u32,
    pub(super) watched_s: f64,
}

/// The flat mirror: it lies as the sample does.
pub(in super::super) fn mirror() -> Held {
    Held::Mirror(FlatMirror {
        normal: DVec3::Z,
        reflectance: REFLECTANCE,
    })
}

/// Pixels that the pattern of this number lights in a projector's image of `size` pixels, with the mirror in the holder.
pub(super) fn disc(number: usize, (width, height): (usize, usize)) -> Vec<u32> {
    let half = height as f64 / 2.0;
    let turn = std::f64::consts::TAU * (number as f64 * 0.381_966).fract();
    let distance = DISTANCES[number % DISTANCES.len()] * half;
    let radius = RADII[number / DISTANCES.len() % RADII.len()] * half;
    let (x, y) = (
        width as f64 / 2.0 + distance * turn.cos(),
        half + distance * turn.sin(),
    );
    within(width, height, |u, v| {
        (u - x).powi(2) + (v - y).powi(2) <= radius * radius
    })
}

/// The same with the trap.
pub(super) fn part(number: usize, (width, height): (usize, usize)) -> Vec<u32> {
    let [columns, rows] = PARTS;
    let (column, row) = (number % columns, number / columns % rows);
    within(width, height, |u, v| {
        (u * columns as f64 / width as f64) as usize == column
            && (v * rows as f64 / height as f64) as usize == row
    })
}

/// Row-major indices of the pixels whose centres are within something.
fn within(width: usize, height: usize, is_within: impl Fn(f64, f64) -> bool) -> Vec<u32> {
    let mut pixels = Vec::new();
    for row in 0..height {
        let of_row = (0..width).filter(|column| is_within(*column as f64 + 0.5, row as f64 + 0.5));
        pixels.extend(of_row.map(|column| (row * width + column) as u32));
    }
    pixels
}

impl StrayViews {
    /// How they will be exposed on the rig `full`, the trap no longer than `exposure_s` seconds.
    pub(in super::super) fn plan(
        full: &Rig,
        exposure_s: f64,
        bench: &mut dyn Bench,
    ) -> Result<Self, CalibrateError> {
        let image_size = IMAGE_SIZE.min(full.camera.lens.width_px);
        let rig = full.with_image_size(image_size)?;
        let size = (
            rig.projector.lens.width_px as usize,
            rig.projector.lens.height_px as usize,
        );
        let longest = |held: Held, pattern: fn(usize, (usize, usize)) -> Vec<u32>, bench: &mut dyn Bench| {
            let patterns: Vec<Vec<u32>> = (0..PATTERNS).map(|number| pattern(number, size)).collect();
            let mut instrument = bench.open(&rig, held, None)?;
            let tests = TestExposures::take(&rig, &patterns, &mut instrument)?;
            if tests.is_too_bright {
                return Err(CalibrateError::Views {
                    expected: format!("a flat mirror that does not saturate in {SHORTEST_EXPOSURE_S} s"),
                    found: "one that does".to_owned(),
                    advice: "stop the projector or the camera down and state it in the rig file (light.full_scale_f_sr)",
                });
            }
            Ok::<f64, CalibrateError>((SHARE * tests.longest_s).max(SHORTEST_EXPOSURE_S))
        };
        // Whoever puts them in does so once.
        let watching_side = watching_side(&rig, exposure_s, bench)?;
        let parts_s = longest(Held::Trap, part, bench)?.min(exposure_s);
        Ok(Self {
            watching_side,
            watched_s: exposure_s,
            image_size,
            discs_s: longest(mirror(), disc, bench)?.min(full.camera.exposure_s),
            parts_s,
        })
    }

    /// Exposure times of discs, of parts and of what watches the lamp, seconds.
    pub(in super::super) const fn times(&self) -> [f64; 3] {
        [self.discs_s, self.parts_s, self.watched_s]
    }

    /// The same with these.
    pub(in super::super) fn with_times(&self, [discs_s, parts_s, watched_s]: [f64; 3]) -> Self {
        Self {
            discs_s,
            parts_s,
            watched_s,
            ..self.clone()
        }
    }

    /// The rig of the views.
    pub(super) fn rig(&self, full: &Rig) -> Result<Rig, CalibrateError> {
        Ok(full.with_image_size(self.image_size)?)
    }

    /// Takes the segments that show the mirror, or those that show the trap, on the rig `full` at the `bench`, which was opened so many
    /// times for the views before; `reach` is told how many exposures are taken. Returns them with the clock of the trigger box.
    pub(in super::super) fn take(
        &self,
        full: &Rig,
        part: Part,
        bench: &mut dyn Bench,
        opened: u32,
        reach: &dyn Fn(usize),
    ) -> Result<(u32, Vec<(usize, Segment)>), CalibrateError> {
        let rig = self.rig(full)?;
        let watched = watching(&rig, self.watching_side);
        let (held, series) = match part {
            Part::Mirror => (mirror(), vec![(0, 0..DISCS, self.discs_s)]),
            Part::Trap => (
                Held::Trap,
                vec![
                    (1, DISCS..FIRST_PARTED, self.discs_s),
                    (2, FIRST_PARTED..WATCHED, self.parts_s),
                    (3, WATCHED..SEGMENTS, self.watched_s),
                ],
            ),
        };
        let (mut clock_hz, mut taken) = (0, Vec::new());
        for (number, segments, exposure_s) in series {
            bench.set_opened(opened + number);
            let mut instrument = bench.open(&rig, held.clone(), None)?;
            clock_hz = instrument.device.info().clock_hz;
            for segment in segments {
                let before = taken.len() * SEGMENT;
                let draw = |exposure: usize, size: (usize, usize)| match segment {
                    WATCHED => watched.clone(),
                    _ => lit(segment, exposure, size),
                };
                let shots = take(&draw, &rig, exposure_s, &mut instrument, &|count| {
                    reach(before + count);
                })?;
                taken.push((segment, shots));
            }
        }
        Ok((clock_hz, taken))
    }

    /// The file of the frames in `dir`, whose file of views will hold `text`, by a trigger box with this clock.
    pub(in super::super) fn create(
        &self,
        full: &Rig,
        dir: &Path,
        text: &str,
        clock_hz: u32,
    ) -> Result<RawStore, CalibrateError> {
        let layout = layout(SEGMENTS, self.rig(full)?.frame_format());
        create_raw(&dir.join(RAW), layout, clock_hz, VIEWS, text)
    }
}

/// The part of the views of stray light that shows one target.
#[derive(Clone, Copy)]
pub(in super::super) enum Part {
    Mirror,
    Trap,
}

impl Part {
    /// The segments that show it.
    pub(in super::super) const fn segments(self) -> std::ops::Range<usize> {
        match self {
            Self::Mirror => 0..DISCS,
            Self::Trap => DISCS..SEGMENTS,
        }
    }
}

/// Side in pixels of the squares that watch the lamp on `rig` in exposures of `exposure_s` seconds.
fn watching_side(rig: &Rig, exposure_s: f64, bench: &mut dyn Bench) -> Result<u32, CalibrateError> {
    let largest = watching(rig, BLOCK_PX);
    if largest.is_empty() {
        return Ok(0);
    }
    let mut instrument = bench.open(rig, Held::Trap, None)?;
    let tests = TestExposures::take(rig, &[Vec::new(), largest], &mut instrument)?;
    let mean = |dn: &[u16]| dn.iter().map(|dn| f64::from(*dn)).sum::<f64>() / dn.len() as f64;
    let light_dn = mean(&tests.shots[1].dn) - mean(&tests.shots[0].dn);
    let each_dn = light_dn * exposure_s / tests.exposure_s / f64::from(BLOCK_PX * BLOCK_PX);
    Ok(side(each_dn, rig.range_dn()))
}

/// The exposures of one segment, of which `draw` says which pixels each lights.
fn take(
    draw: &dyn Fn(usize, (usize, usize)) -> Vec<u32>,
    rig: &Rig,
    exposure_s: f64,
    instrument: &mut Instrument,
    taken: &dyn Fn(usize),
) -> Result<Segment, CalibrateError> {
    let timing = Timing::patient(rig, exposure_s).map_err(plan::PlanError::from)?;
    let mut tally = Tally::default();
    let shots = instrument.take(
        SEGMENT,
        &[timing],
        |exposure, image| {
            if exposure < PATTERNS {
                image.light(&draw(exposure, image.size_px()));
            }
        },
        &mut tally,
        taken,
    )?;
    Ok(segment_of(shots, tally, exposure_s))
}

/// Pixels that the `exposure` of a `segment` lights; none in its black ones.
pub(super) fn lit(segment: usize, exposure: usize, size: (usize, usize)) -> Vec<u32> {
    if segment < FIRST_PARTED {
        disc(segment % DISCS * PATTERNS + exposure, size)
    } else {
        part((segment - FIRST_PARTED) * PATTERNS + exposure, size)
    }
}
