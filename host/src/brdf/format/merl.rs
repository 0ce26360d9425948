//! MERL's tables (`.binary`): isotropic, over the half vector and the direction of light relative to it.
//!
//! Matusik et al., "A data-driven reflectance model", ACM TOG 22(3), 2003. θh and θd are the polar angles of the half vector about the
//! normal and of light about the half vector, φd its azimuth there; φd and φd + 180° are one, by reciprocity.
//!
//! | bytes | content |
//! |---|---|
//! | 12 | three i32: 90 θh, 90 θd, 180 φd |
//! | 8 · 1,458,000 | f64, red; entry φd + 180·(θd + 90·θh), with θh = 90°·(n/90)², θd and φd every degree |
//! | the same twice | green, blue |
//!
//! All numbers are little-endian. f = value × (1, 1.15, 1.66)/1500 in sr⁻¹; no cosine is in it; a negative value is none. Each entry is
//! that of a cell, from its angles to the next ones, and is looked up without interpolation, as the authors' own program does.

use std::f64::consts::{FRAC_PI_2, PI, TAU};
use std::io::{BufWriter, Write as _};
use std::path::Path;

use glam::{DMat3, DVec3};

use super::{ExportError, Exporting, reading};
use crate::brdf::sample::{Outgoing, Sample, SampleError};
use crate::hemisphere::direction::{from_angles, is_above_horizon};

/// Entries along θh, θd and φd.
const SHAPE: [usize; 3] = [90, 90, 180];
/// Entries of a channel.
const CELLS: usize = SHAPE[0] * SHAPE[1] * SHAPE[2];
/// Bytes before the values.
const HEAD: usize = 12;
/// f over the value, of each channel.
const SCALE: [f64; 3] = [1.0 / 1500.0, 1.15 / 1500.0, 1.66 / 1500.0];
/// Azimuths of the sample over which f of one that is not isotropic is averaged.
const TURNS: usize = 8;
/// Every so many cells tell how f differs over them.
const SAMPLED: usize = 37;
/// Share of them in which it differs by less than is told: where a lobe is.
const MANY: f64 = 0.9;

/// Whether a file begins like one.
pub(super) fn is_head(head: &[u8]) -> bool {
    head.get(..HEAD) == Some(&header())
}

fn header() -> [u8; HEAD] {
    let mut header = [0; HEAD];
    for (bytes, count) in header.chunks_exact_mut(4).zip(SHAPE) {
        bytes.copy_from_slice(&(count as i32).to_le_bytes());
    }
    header
}

/// A material of such a file.
#[derive(Debug)]
pub struct Merl {
    /// f in sr⁻¹; NaN is no value.
    f: Vec<[f32; 3]>,
}

impl Merl {
    /// Reads the file at `path`.
    ///
    /// # Errors
    /// [`SampleError`] with path, field, expected and found.
    pub fn open(path: &Path) -> Result<Self, SampleError> {
        let whole = HEAD + 3 * 8 * CELLS;
        let bytes = reading::bytes(path, whole as u64)?;
        if !is_head(&bytes) {
            return Err(reading::wrong(
                path,
                "dimensions",
                "90, 90 and 180 entries",
                "something else",
            ));
        }
        if bytes.len() != whole {
            let found = format!("{} bytes", bytes.len());
            return Err(reading::wrong(path, "size", &format!("{whole} bytes"), &found));
        }
        let mut f = vec![[f32::NAN; 3]; CELLS];
        for (number, value) in bytes[HEAD..].chunks_exact(8).enumerate() {
            let value = f64::from_le_bytes(value.try_into().expect("invariant: eight bytes"));
            let channel = number / CELLS;
            if value >= 0.0 && value.is_finite() {
                f[number % CELLS][channel] = (value * SCALE[channel]) as f32;
            }
        }
        Ok(Self { f })
    }

    fn at(&self, wi: DVec3, wo: DVec3) -> [f64; 3] {
        let half = (wi + wo).normalize();
        let theta_h = half.z.clamp(-1.0, 1.0).acos();
        let phi_h = half.y.atan2(half.x);
        let d = DMat3::from_rotation_y(-theta_h) * (DMat3::from_rotation_z(-phi_h) * wi);
        let theta_d = d.z.clamp(-1.0, 1.0).acos();
        let phi_d = d.y.atan2(d.x).rem_euclid(PI);
        let place = |of: f64, count: usize| ((of * count as f64) as usize).min(count - 1);
        let [h, t, p] = [
            place((theta_h / FRAC_PI_2).max(0.0).sqrt(), SHAPE[0]),
            place(theta_d / FRAC_PI_2, SHAPE[1]),
            place(phi_d / PI, SHAPE[2]),
        ];
        self.f[p + SHAPE[2] * (t + SHAPE[1] * h)].map(f64::from)
    }
}

impl Sample for Merl {
    fn incident(&self, wi: DVec3) -> Box<dyn Outgoing + '_> {
        Box::new(Lit { table: self, wi })
    }

    fn is_isotropic(&self) -> bool {
        true
    }
}

struct Lit<'a> {
    table: &'a Merl,
    wi: DVec3,
}

impl Outgoing for Lit<'_> {
    fn f(&self, wo: DVec3) -> [f64; 3] {
        if is_above_horizon(self.wi) && is_above_horizon(wo) {
            self.table.at(self.wi, wo)
        } else {
            [0.0; 3]
        }
    }
}

/// The pair of directions in the middle of a cell, of a sample turned by `azimuth_rad`; one may be below the horizon.
fn pair(cell: usize, azimuth_rad: f64) -> (DVec3, DVec3) {
    let middle = |number: usize, count: usize| (number as f64 + 0.5) / count as f64;
    let [p, t, h] = [
        cell % SHAPE[2],
        cell / SHAPE[2] % SHAPE[1],
        cell / (SHAPE[2] * SHAPE[1]),
    ];
    let theta_h = middle(h, SHAPE[0]).powi(2) * FRAC_PI_2;
    let d = from_angles(middle(t, SHAPE[1]) * FRAC_PI_2, middle(p, SHAPE[2]) * PI);
    let turn = DMat3::from_rotation_z(azimuth_rad) * DMat3::from_rotation_y(theta_h);
    (turn * d, turn * DVec3::new(-d.x, -d.y, d.z))
}

/// Writes the file; of a sample that is not isotropic the mean over azimuths, and answers how f differs over them.
pub(super) fn write(exporting: &Exporting) -> Result<Option<f64>, ExportError> {
    let turns = if exporting.is_isotropic() { 1 } else { TURNS };
    let mut values = vec![[-1.0_f64; 3]; CELLS];
    let mut spreads = Vec::new();
    exporting.progress.begin("export", CELLS, "cells");
    let cells: Vec<usize> = (0..CELLS)
        .filter(|cell| {
            let (wi, wo) = pair(*cell, 0.0);
            is_above_horizon(wi) && is_above_horizon(wo)
        })
        .collect();
    for some in cells.chunks(exporting.at_once() / turns) {
        let pairs: Vec<(DVec3, DVec3)> = some
            .iter()
            .flat_map(|cell| (0..turns).map(|turn| pair(*cell, TAU * turn as f64 / turns as f64)))
            .collect();
        let found = exporting.values(&pairs)?;
        for (place, (cell, found)) in some.iter().zip(found.chunks(turns)).enumerate() {
            let known: Vec<[f32; 3]> = found.iter().copied().flatten().collect();
            if known.is_empty() {
                continue;
            }
            let count = known.len() as f64;
            let mean: [f64; 3] = std::array::from_fn(|channel| {
                known.iter().map(|f| f64::from(f[channel])).sum::<f64>() / count
            });
            // A negative value is none there.
            values[*cell] = std::array::from_fn(|channel| (mean[channel] / SCALE[channel]).max(0.0));
            if place % SAMPLED == 0 && known.len() > 1 && mean[1] > 0.0 {
                let squares: f64 = known.iter().map(|f| (f64::from(f[1]) - mean[1]).powi(2)).sum();
                spreads.push((squares / count).sqrt() / mean[1]);
            }
        }
        exporting
            .progress
            .reach(some.last().map_or(CELLS, |cell| cell + 1));
    }
    let failed = |error| exporting.failed(error);
    let mut file = BufWriter::new(exporting.create()?);
    file.write_all(&header()).map_err(failed)?;
    for channel in 0..3 {
        for value in &values {
            file.write_all(&value[channel].to_le_bytes()).map_err(failed)?;
        }
    }
    exporting.finish(file)?;
    let place = (spreads.len() as f64 * MANY) as usize;
    Ok((!spreads.is_empty()).then(|| *spreads.select_nth_unstable_by(place, f64::total_cmp).1))
}
