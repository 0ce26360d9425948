//! The values that a page carries, for a person to look at: fewer and coarser than those of the file.
//!
//! # Design
//! A page is to be sent by mail, so it holds a part of the incident directions, spread over all, and means over blocks of cells of the
//! outgoing disk. All of it is one run of bytes, packed (gzip) and written as text (base64), which the page's own program unpacks:
//!
//! | content | type | axes |
//! |---|---|---|
//! | f in sr⁻¹, NaN where there is none | half float | incident, row, column, channel |
//! | f of the reference, if there is one | half float | incident, row, column, channel |
//! | σ/f of the least certain channel, 10^(6·(code − 1)/254 − 4), 0 where there is none | byte | incident, row, column |
//! | the weakest origin, a code of [`Provenance`] | byte | incident, row, column |
//! | why no cell there has a value, a code of [`Unmeasurable`], 0 if one has | byte | row, column |
//! | the incident directions around a place of the incident disk | 16 bits | row, column, four |
//! | and their weights, 255 in all, or 0 where nothing was lit | byte | row, column, four |
//!
//! Numbers are little-endian; both disks are as [`Disk`] has them, in the frame of the sample.

use std::io::Write as _;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use flate2::Compression;
use flate2::write::GzEncoder;
use glam::DVec3;
use half::f16;
use rayon::prelude::*;
use serde_json::{Value, json};

use crate::brdf::Brdf;
use crate::brdf::sample::Sample;
use crate::hemisphere::disk::Disk;
use crate::hemisphere::incident::{Grid, IncidentSet};
use crate::instrument::optics::Unmeasurable;
use crate::store::provenance::Provenance;
use crate::store::{BrdfRows, StoreError};

/// Incident directions at most.
const LAYERS: usize = 240;
/// Cells along a side of the outgoing disk at most, the fewer the more there is to carry.
const SIZES: [usize; 4] = [48, 40, 32, 24];
/// Characters of text at most: with pictures and tables a page stays below 8 MB.
const MOST_TEXT: usize = 7_000_000;
/// Cells along a side of the incident disk.
const AROUND: usize = 64;
/// Decades of σ/f, and where they begin.
const DECADES: f32 = 6.0;
const FROM_DECADE: f32 = -4.0;

/// What a page carries.
pub(super) struct Shown {
    /// What the bytes mean, for the page's program.
    pub(super) facts: Value,
    /// They, packed, as text.
    pub(super) text: String,
}

/// Which cells of a file are together one of the page.
struct Blocks {
    disk: Disk,
    /// Of each cell of the page, those of the file.
    members: Vec<Vec<usize>>,
}

impl Blocks {
    /// `size` cells along a side, or as many as the file has.
    fn new(brdf: &Brdf, size: usize) -> Self {
        let all = brdf.disk();
        let every = all.size().div_ceil(size);
        let disk = Disk::new(all.size().div_ceil(every));
        let mut members = vec![Vec::new(); disk.len()];
        for cell in 0..all.len() {
            let place = all.direction(cell).and_then(|w| disk.position(w));
            if let Some(place) = place {
                let along = |at: f64| (at as usize).min(disk.size() - 1);
                members[along(place.y) * disk.size() + along(place.x)].push(cell);
            }
        }
        // Where a frame lies turned on the cells of the file a cell of the page may be left without one.
        for (cell, members) in members.iter_mut().enumerate() {
            let Some(around) = disk.direction(cell).and_then(|w| all.neighbours(w)) else {
                continue;
            };
            if members.is_empty() {
                let nearest = around.into_iter().max_by(|a, b| a.1.total_cmp(&b.1));
                members.extend(nearest.map(|(cell, _)| cell));
            }
        }
        Self { disk, members }
    }
}

/// Values of one incident direction.
#[derive(Default)]
struct Layer {
    f: Vec<f16>,
    reference: Vec<f16>,
    sigma: Vec<u8>,
    origin: Vec<u8>,
}

impl Shown {
    /// Of `brdf`, beside a `reference` if there is one.
    ///
    /// # Errors
    /// [`StoreError`] if the file cannot be read.
    pub(super) fn of(brdf: &Brdf, reference: Option<&dyn Sample>) -> Result<Self, StoreError> {
        let layers = chosen(brdf);
        let mut shown = Self::coarse(brdf, reference, &layers, SIZES[0])?;
        for size in &SIZES[1..] {
            if shown.text.len() <= MOST_TEXT {
                break;
            }
            shown = Self::coarse(brdf, reference, &layers, *size)?;
        }
        Ok(shown)
    }

    fn coarse(
        brdf: &Brdf,
        reference: Option<&dyn Sample>,
        layers: &[usize],
        size: usize,
    ) -> Result<Self, StoreError> {
        let blocks = Blocks::new(brdf, size);
        let mut all = Vec::with_capacity(layers.len());
        let mut left = layers;
        for chunk in 0..brdf.chunks() {
            let range = brdf.chunk_range(chunk);
            let here = left.partition_point(|layer| *layer < range.end);
            let (some, rest) = left.split_at(here);
            left = rest;
            if some.is_empty() {
                continue;
            }
            let rows = brdf.chunk(chunk)?;
            let of = |layer: &usize| {
                layer_of(
                    brdf,
                    reference,
                    &blocks,
                    *layer,
                    rows.as_ref(),
                    layer - range.start,
                )
            };
            all.extend(some.par_iter().map(of).collect::<Vec<_>>());
        }
        let (around, weights) = surroundings(brdf, layers);
        let mut bytes = Vec::new();
        let halves = |of: &dyn Fn(&Layer) -> &[f16]| -> Vec<u8> {
            all.iter()
                .flat_map(|layer| of(layer).iter().flat_map(|f| f.to_le_bytes()))
                .collect()
        };
        bytes.extend(halves(&|layer| &layer.f));
        bytes.extend(halves(&|layer| &layer.reference));
        bytes.extend(all.iter().flat_map(|layer| &layer.sigma));
        bytes.extend(all.iter().flat_map(|layer| &layer.origin));
        bytes.extend(blocks.members.iter().map(|members| reason(brdf, members)));
        bytes.extend(around.iter().flat_map(|layer| layer.to_le_bytes()));
        bytes.extend(weights);
        let angles = |index: usize| {
            let (theta, phi) = brdf.grid().angles_deg(index);
            [theta, phi].map(|deg| (deg * 1e4).round() / 1e4)
        };
        let unlit: Vec<usize> = (0..brdf.grid().len())
            .filter(|index| brdf.incident_reason(*index).is_some())
            .collect();
        let facts = json!({
            "size": blocks.disk.size(),
            "measured_size": brdf.disk().size(),
            "channels": brdf.channels(),
            "bands": brdf.bands().map(|bands| bands.labels()),
            "incident_deg": layers.iter().map(|layer| angles(*layer)).collect::<Vec<_>>(),
            "incident_measured": brdf.grid().len() - unlit.len(),
            "unlit_deg": thinned(&unlit, brdf.grid(), LAYERS).into_iter().map(angles).collect::<Vec<_>>(),
            "around": AROUND,
            "has_reference": reference.is_some(),
            "sigma": { "from_decade": FROM_DECADE, "decades": DECADES },
            "origins": Provenance::ALL.map(Provenance::name),
            "reasons": std::iter::once(String::new())
                .chain(Unmeasurable::ALL.iter().map(ToString::to_string))
                .collect::<Vec<_>>(),
        });
        Ok(Self {
            facts,
            text: packed(&bytes),
        })
    }
}

/// `bytes` packed and as text.
fn packed(bytes: &[u8]) -> String {
    let mut packer = GzEncoder::new(Vec::new(), Compression::default());
    packer
        .write_all(bytes)
        .expect("invariant: memory takes everything");
    STANDARD.encode(packer.finish().expect("invariant: memory takes everything"))
}

/// Those incident directions that a page shows, ascending.
fn chosen(brdf: &Brdf) -> Vec<usize> {
    let lit: Vec<usize> = (0..brdf.grid().len())
        .filter(|index| brdf.incident_reason(*index).is_none())
        .collect();
    thinned(&lit, brdf.grid(), LAYERS)
}

/// At most so many of `all`, as far apart as that takes.
fn thinned(all: &[usize], grid: &IncidentSet, most: usize) -> Vec<usize> {
    let mut apart_rad = 0.0_f64;
    loop {
        let least = apart_rad.cos();
        let mut kept: Vec<(usize, DVec3)> = Vec::new();
        for &index in all {
            let w = grid.direction(index);
            if apart_rad <= 0.0 || kept.iter().all(|(_, other)| other.dot(w) < least) {
                kept.push((index, w));
            }
            if kept.len() > most {
                break;
            }
        }
        if kept.len() <= most {
            return kept.into_iter().map(|(index, _)| index).collect();
        }
        // So many discs of that width fill a hemisphere, about.
        apart_rad = (1.1 * apart_rad).max((2.0 / most as f64).sqrt());
    }
}

/// The incident direction `index`, which is the `row` of the rows of its chunk, in blocks.
fn layer_of(
    brdf: &Brdf,
    reference: Option<&dyn Sample>,
    blocks: &Blocks,
    index: usize,
    rows: Option<&BrdfRows>,
    row: usize,
) -> Layer {
    let (channels, cells) = (brdf.channels(), brdf.disk().len());
    let mut layer = Layer::default();
    let known = reference.map(|sample| sample.incident(brdf.grid().direction(index)));
    for members in &blocks.members {
        let at = |cell: usize| row * cells + cell;
        let with = |rows: &BrdfRows| -> Vec<usize> {
            let is_there = |cell: &usize| rows.provenance[at(*cell)] != Provenance::Missing.code();
            members.iter().copied().filter(is_there).collect()
        };
        let present = rows.map_or_else(Vec::new, with);
        let mean = |of: &dyn Fn(usize) -> f32| {
            present.iter().map(|cell| of(at(*cell))).sum::<f32>() / present.len() as f32
        };
        let mut relative = 0.0_f32;
        for channel in 0..channels {
            let Some(rows) = rows.filter(|_| !present.is_empty()) else {
                layer.f.push(f16::NAN);
                continue;
            };
            let f = mean(&|at| rows.f[at * channels + channel]);
            // As if neighbours had the same error.
            let sigma = mean(&|at| f32::from(rows.sigma[at * channels + channel]));
            layer.f.push(f16::from_f32(f));
            relative = relative.max((sigma / f.abs()).min(f32::MAX));
        }
        layer
            .sigma
            .push(if present.is_empty() { 0 } else { code(relative) });
        let weakest = present
            .iter()
            .filter_map(|cell| rows.map(|rows| rows.provenance[at(*cell)]))
            .max();
        layer.origin.push(weakest.unwrap_or(Provenance::Missing.code()));
        if let Some(known) = &known {
            // Of the same cells, at the border of what was measured too.
            let same = if present.is_empty() { members } else { &present };
            let values = same
                .iter()
                .filter_map(|cell| brdf.disk().direction(*cell))
                .map(|wo| known.f(wo));
            let (mut sum, mut count) = ([0.0; 3], 0.0);
            for f in values {
                count += 1.0;
                for (sum, f) in sum.iter_mut().zip(f) {
                    *sum += f;
                }
            }
            let grey = sum.iter().sum::<f64>() / 3.0;
            let of = |channel: usize| if channels == 1 { grey } else { sum[channel] } / count;
            layer
                .reference
                .extend((0..channels).map(|channel| f16::from_f64(of(channel))));
        }
    }
    layer
}

/// The byte of a relative uncertainty.
fn code(relative: f32) -> u8 {
    let place = (relative.log10() - FROM_DECADE) / DECADES;
    (1.0 + 254.0 * place.clamp(0.0, 1.0)).round() as u8
}

/// Why none of the cells has a value; 0 if one may have one.
fn reason(brdf: &Brdf, members: &[usize]) -> u8 {
    let mut reasons = members.iter().map(|cell| brdf.outgoing_reason(*cell));
    let first = reasons.next().unwrap_or(Some(Unmeasurable::BelowHorizon));
    match first {
        Some(reason) if reasons.all(|reason| reason.is_some()) => reason.code(),
        _ => 0,
    }
}

/// Of each place of the incident disk the `layers` around it, and their weights.
fn surroundings(brdf: &Brdf, layers: &[usize]) -> (Vec<u16>, Vec<u8>) {
    let grid = brdf.grid();
    let directions: Vec<DVec3> = layers.iter().map(|layer| grid.direction(*layer)).collect();
    let angles = layers.iter().map(|layer| grid.angles_deg(*layer));
    let list = Grid::List {
        directions_deg: angles.map(|(theta, phi)| [theta, phi]).collect(),
    };
    let set = list.build().ok();
    let disk = Disk::new(AROUND);
    let (mut around, mut weights) = (Vec::new(), Vec::new());
    for cell in 0..disk.len() {
        let mut here = [(0, 0.0); 4];
        // Beyond the horizon as at it: what is interpolated between cells needs a neighbour.
        let w = disk.direction(cell);
        let lit = |w: &DVec3| {
            let lit = |(index, weight): (usize, f64)| {
                if brdf.incident_reason(index).is_none() {
                    weight
                } else {
                    0.0
                }
            };
            grid.neighbours(*w).into_iter().map(lit).sum::<f64>() >= 0.5
        };
        if let Some(w) = w.filter(lit) {
            here = set.as_ref().map_or_else(
                || {
                    let nearest = directions
                        .iter()
                        .enumerate()
                        .max_by(|a, b| a.1.dot(w).total_cmp(&b.1.dot(w)));
                    let nearest = nearest.map_or(0, |(layer, _)| layer);
                    [(nearest, 1.0), (0, 0.0), (0, 0.0), (0, 0.0)]
                },
                |set| set.neighbours(w),
            );
        }
        around.extend(here.map(|(layer, _)| layer as u16));
        weights.extend(here.map(|(_, weight)| (255.0 * weight).round() as u8));
    }
    (around, weights)
}

#[cfg(test)]
mod tests {
    use std::io::Read as _;
    use std::time::Duration;

    use flate2::read::GzDecoder;

    use super::*;
    use crate::base::progress::Silent;
    use crate::brdf::sample::parse;
    use crate::instrument::rig::Rig;
    use crate::measure::{complete, prepare};
    use crate::plan::{Request, Virtual};
    use crate::virtual_rig::setup::Setup;

    /// Of so many cells along a side, of `rig`, with what the page carries of it.
    fn measured(rig: &str, image_size: u32) -> (tempfile::TempDir, Brdf, Shown, Vec<u8>) {
        let dir = tempfile::tempdir().unwrap();
        let request = Request {
            grid: Grid::ThetaPhi { step_deg: 15.0 },
            image_size,
            ..Request::default()
        };
        let setup = Setup::from(Virtual {
            sample: "ward:brass".to_owned(),
            ..Virtual::default()
        });
        let (job, measurement) = prepare(
            &dir.path().join("m"),
            &Rig::load(rig).unwrap(),
            request,
            &setup,
            &Silent,
        )
        .unwrap();
        complete(&measurement, &job, &|| Duration::ZERO, &Silent).unwrap();
        let brdf = Brdf::open(&measurement.path("brdf.zarr")).unwrap();
        let shown = Shown::of(&brdf, Some(parse("ward:brass").unwrap().as_ref())).unwrap();
        let mut bytes = Vec::new();
        let text = STANDARD.decode(&shown.text).unwrap();
        GzDecoder::new(text.as_slice()).read_to_end(&mut bytes).unwrap();
        (dir, brdf, shown, bytes)
    }

    #[test]
    fn a_page_carries_what_the_file_has_and_says_where_it_has_nothing() {
        // A colour and a grey camera; whole cells, and blocks of four.
        for (rig, image_size, every) in [("rcg-1-16bit", 32, 1), ("rcg-3", 64, 2)] {
            let (_dir, brdf, shown, bytes) = measured(rig, image_size);
            let size = shown.facts["size"].as_u64().unwrap() as usize;
            assert_eq!(size * every, image_size as usize);
            let layers: Vec<[f64; 2]> = serde_json::from_value(shown.facts["incident_deg"].clone()).unwrap();
            let unlit = shown.facts["unlit_deg"].as_array().unwrap().len();
            assert_eq!(layers.len() + unlit, brdf.grid().len());
            let (cells, channels) = (size * size, brdf.channels());
            let count = layers.len() * cells;
            assert_eq!(
                bytes.len(),
                count * (4 * channels + 2) + cells + AROUND * AROUND * 4 * 3
            );
            let half = |at: usize| f16::from_le_bytes([bytes[2 * at], bytes[2 * at + 1]]).to_f32();
            // The first rings may lie in the hole.
            let chunk = (0..brdf.chunks())
                .find(|chunk| brdf.chunk(*chunk).unwrap().is_some())
                .unwrap();
            let rows = brdf.chunk(chunk).unwrap().unwrap();
            let range = brdf.chunk_range(chunk);
            let lit = (0..brdf.grid().len()).filter(|index| brdf.incident_reason(*index).is_none());
            let lit: Vec<(usize, usize)> = lit
                .enumerate()
                .filter(|(_, index)| range.contains(index))
                .map(|(layer, index)| (layer, index - range.start))
                .collect();
            let (mut compared, mut missing) = (0, 0);
            for (layer, row) in lit {
                for cell in 0..cells {
                    let (x, y) = (cell % size * every, cell / size * every);
                    let members =
                        (0..every * every).map(|k| (y + k / every) * brdf.disk().size() + x + k % every);
                    let all: Vec<f32> = members
                        .map(|cell| rows.f[(row * brdf.disk().len() + cell) * channels])
                        .filter(|f| f.is_finite())
                        .collect();
                    let found = half((layer * cells + cell) * channels);
                    let origin = bytes[count * (4 * channels + 1) + layer * cells + cell];
                    if all.is_empty() {
                        missing += 1;
                        assert!(found.is_nan() && origin == 0, "{layer} {cell}: {found} {origin}");
                    } else {
                        compared += 1;
                        let mean = all.iter().sum::<f32>() / all.len() as f32;
                        assert!(
                            (found - mean).abs() <= 1e-3 * mean.abs() + 1e-6,
                            "{layer} {cell}: {found}, {mean}"
                        );
                        assert_ne!(origin, 0);
                    }
                }
            }
            assert!(compared > 1000 && missing > 100, "{compared} {missing}");
            // Weights of places that light comes from are whole.
            let weights = &bytes[bytes.len() - 4 * AROUND * AROUND..];
            let sums: Vec<u32> = weights
                .chunks(4)
                .map(|four| four.iter().map(|w| u32::from(*w)).sum())
                .collect();
            assert!(sums.iter().all(|sum| *sum == 0 || (253..=257).contains(sum)));
            assert_eq!(
                sums[AROUND / 2 * AROUND + AROUND / 2] == 0,
                rig == "rcg-1-16bit",
                "its hole"
            );
        }
    }

    #[test]
    fn directions_that_are_left_are_far_apart_and_of_all_kinds() {
        let grid = Grid::ThetaPhi { step_deg: 3.0 }.build().unwrap();
        let kept = thinned(&(0..grid.len()).collect::<Vec<_>>(), &grid, LAYERS);
        assert!((LAYERS / 2..=LAYERS).contains(&kept.len()), "{}", kept.len());
        let nearest = |index: &usize| {
            let w = grid.direction(*index);
            let others = kept
                .iter()
                .filter(|other| *other != index)
                .map(|other| grid.direction(*other).dot(w));
            others.fold(-1.0, f64::max).acos().to_degrees()
        };
        assert!(kept.iter().all(|index| (4.0..15.0).contains(&nearest(index))));
        assert_eq!(thinned(&[0, 1, 2, 3, 4], &grid, LAYERS), [0, 1, 2, 3, 4]);
    }

    #[test]
    fn relative_uncertainties_are_known_to_a_few_percent() {
        for relative in [1e-4_f32, 3e-3, 0.05, 1.0, 80.0] {
            let found = 10_f32.powf(DECADES * (f32::from(code(relative)) - 1.0) / 254.0 + FROM_DECADE);
            assert!((found / relative - 1.0).abs() < 0.03, "{relative} {found}");
        }
        assert_eq!((code(0.0), code(f32::MAX)), (1, 255));
    }
}
