//! What calibration makes of assembled values, and their standard uncertainty.
//!
//! # Design
//! [`project`](super::radiometry::project) takes light and throughput as the rig file has them, which are uniform, and
//! knows noise only. Here follow, image by image:
//!
//! 1. light and throughput: f is divided by K·T_o·E_p as calibrated, where E_p is that of the pixels that were lit;
//! 2. interreflection: of the light that leaves the sample a share r returns onto it, so that f + r·ρ(ω_i)·ρ(ω_o)/π was
//!    seen, ρ being the sample's directional albedo. It is subtracted with the image's own albedo in both places, what was
//!    not seen of the hemisphere taken to be like the rest;
//! 3. the standard uncertainty: to the noise come, as independent contributions,
//!    - standard and fields: the relative uncertainties that photometry states, those of the fields by their covariance at
//!      the pixels that see and light, which grows where the standard was not seen;
//!    - edges: what the uncertainty of an edge makes of a spot that it cuts (`edges`);
//!    - interreflection: that of r, and a quarter of the correction for its simple model;
//!    - directions: the slope of f over the outgoing directions times the uncertainty of the directions. The slope over the
//!      incident ones is taken to be as steep, which holds where f depends on the half vector;
//!    - interpolation and blur: light and pixels average f over the spot and over what bilinear interpolation takes in,
//!      which shifts it by half the sum of its second derivatives times the variances of both.
//!
//! Slopes and second derivatives come from the neighbours on the disk, less twice what noise alone makes of them.
//!
//! # Tradeoffs
//! What is systematic (fields, directions) is correlated from sample to sample; the file has one number per sample.

use glam::{DVec2, DVec3};

use crate::calibrate::Applied;
use crate::calibrate::photometry::{Interreflection, Photometry};
use crate::disk::Disk;
use crate::optics::View;
use crate::pattern::PatternMaker;
use crate::plan::{Directions, Plan};
use crate::provenance::Provenance;
use crate::quadrature::{interpolated_pixel_rad, spot_rad};
use crate::rig::Rig;
use crate::store::{BrdfRows, stored_sigma};

/// Share of the correction for interreflection that its model may be wrong by (k = 1).
const INTERREFLECTION_MODEL: f64 = 0.25;

/// Squares of slopes and second derivatives count by what they have beyond so many times their variance by noise: two
/// standard deviations, so that noise hardly ever passes for them.
const CLEAR: f32 = 4.0;

/// Angles from a cell to its neighbours, radians: left, right, above, below; `None` where there is none.
type Steps = [Option<f32>; 4];

/// What is done to every image.
pub(super) struct Correction {
    size: usize,
    channels: usize,
    /// Factor of f, [cell, channel].
    cells: Vec<f32>,
    /// Factor of f of each incident direction.
    rows: Vec<f32>,
    /// Relative variance of all f by the standard and by what the fields leave.
    relative2: f32,
    /// Relative variance of f by the throughput of each cell, and by the light of each incident direction.
    cell_relative2: Vec<f32>,
    row_relative2: Vec<f32>,
    interreflection: Option<Interreflection>,
    /// cosθ times solid angle of each cell, 0 beyond the horizon.
    cosine_sr: Vec<f32>,
    steps: Vec<Steps>,
    /// Variance of the directions along each axis, radians².
    direction_variance: f32,
    /// Half the variance of the blur along each axis of each cell, radians².
    half_blur: Vec<f32>,
}

impl Correction {
    /// For images of `rig` that `plan` made, whose cells see the solid angles `pixel_sr`; edges make `cut_relative2` of the
    /// relative variance of the light of each incident direction. Or what is wrong with `applied`.
    pub(super) fn new(
        rig: &Rig,
        plan: &Plan,
        directions: &Directions,
        applied: &Applied,
        disk: Disk,
        pixel_sr: &[f64],
        cut_relative2: &[f32],
    ) -> Result<Self, String> {
        let channels = rig.camera.channels as usize;
        let (mut cells, mut rows) = (vec![1.0; disk.len() * channels], vec![1.0; directions.grid.len()]);
        let (mut cell_relative2, mut row_relative2) = (vec![0.0; disk.len()], vec![0.0; rows.len()]);
        let mut relative = 0.0_f64;
        if let Some(photometry) = &applied.photometry {
            if photometry.sensitivity.len() != channels {
                return Err(format!(
                    "photometry.sensitivity: expected {channels} channels as the camera has, found {}",
                    photometry.sensitivity.len()
                ));
            }
            (cells, cell_relative2) = throughput(rig, photometry, disk);
            (rows, row_relative2) = light(rig, plan, directions, photometry);
            relative = photometry.standard_uncertainty.hypot(photometry.field_residual);
        }
        for (variance, cut) in row_relative2.iter_mut().zip(cut_relative2) {
            *variance += cut;
        }
        let light_variance = spot_rad(plan.spot_deg).powi(2);
        let [camera_deg, projector_deg] = applied.direction_deg;
        Ok(Self {
            size: disk.size(),
            channels,
            cells,
            rows,
            relative2: relative.powi(2) as f32,
            cell_relative2,
            row_relative2,
            interreflection: applied
                .photometry
                .as_ref()
                .and_then(|found| found.interreflection),
            cosine_sr: (0..disk.len())
                .map(|cell| {
                    disk.direction(cell)
                        .map_or(0.0, |w| (w.z * disk.cell_sr()) as f32)
                })
                .collect(),
            steps: steps(disk),
            // The stated angle is that of both axes together.
            direction_variance: (camera_deg.to_radians().powi(2) + projector_deg.to_radians().powi(2)) as f32
                / 2.0,
            half_blur: pixel_sr
                .iter()
                .map(|sr| (0.5 * (light_variance + interpolated_pixel_rad(*sr).powi(2))) as f32)
                .collect(),
        })
    }

    /// What light and throughput make of the value at `cell` (with its channel) of the incident direction `row`.
    pub(super) fn factor(&self, row: usize, cell: usize) -> f32 {
        self.cells[cell] * self.rows[row]
    }

    /// Corrects the rows of the incident directions from `first` on. What is missing stays NaN.
    pub(super) fn apply(&self, first: usize, rows: &mut BrdfRows) {
        let (cells, values) = (self.size * self.size, self.cells.len());
        let mut sigma = vec![0.0; values];
        let images = rows
            .f
            .chunks_exact_mut(values)
            .zip(rows.sigma.chunks_exact_mut(values))
            .zip(rows.provenance.chunks_exact(cells));
        for (index, ((f, half_sigma), provenance)) in (first..).zip(images) {
            let scale = self.rows[index];
            for ((f, (sigma, half)), cell) in f
                .iter_mut()
                .zip(sigma.iter_mut().zip(half_sigma.iter()))
                .zip(&self.cells)
            {
                *f *= cell * scale;
                *sigma = half.to_f32() * cell * scale;
            }
            let measured = |cell: usize| provenance[cell] != Provenance::Missing.code();
            for channel in 0..self.channels {
                let back = self.interreflected(f, &measured, channel);
                for cell in (0..cells).filter(|&cell| measured(cell)) {
                    f[cell * self.channels + channel] -= back.0;
                }
                for cell in (0..cells).filter(|&cell| measured(cell)) {
                    let relative2 = self.relative2 + self.row_relative2[index] + self.cell_relative2[cell];
                    let systematic = relative2.sqrt() * f[cell * self.channels + channel];
                    let total = self
                        .uncertainty(f, &sigma, &measured, cell, channel)
                        .hypot(systematic)
                        .hypot(back.1);
                    half_sigma[cell * self.channels + channel] = stored_sigma(total);
                }
            }
        }
    }

    /// What interreflection adds to every f of an image, in sr⁻¹, and its standard uncertainty.
    fn interreflected(&self, f: &[f32], measured: &dyn Fn(usize) -> bool, channel: usize) -> (f32, f32) {
        let Some(found) = self.interreflection else {
            return (0.0, 0.0);
        };
        let (mut sum, mut seen) = (0.0_f64, 0.0_f64);
        for (cell, cosine_sr) in self
            .cosine_sr
            .iter()
            .enumerate()
            .filter(|(cell, _)| measured(*cell))
        {
            sum += f64::from(f[cell * self.channels + channel] * cosine_sr);
            seen += f64::from(*cosine_sr);
        }
        if seen <= 0.0 {
            return (0.0, 0.0);
        }
        let albedo = (sum / seen * std::f64::consts::PI).clamp(0.0, 1.0);
        let per_share = albedo * albedo / std::f64::consts::PI;
        let back = found.share * per_share;
        let uncertainty = (found.standard_uncertainty * per_share).hypot(INTERREFLECTION_MODEL * back);
        (back as f32, uncertainty as f32)
    }

    /// Standard uncertainty of one value by noise, directions, interpolation and blur, in sr⁻¹.
    fn uncertainty(
        &self,
        f: &[f32],
        sigma: &[f32],
        measured: &dyn Fn(usize) -> bool,
        cell: usize,
        channel: usize,
    ) -> f32 {
        let at = |cell: usize| {
            (
                f[cell * self.channels + channel],
                sigma[cell * self.channels + channel],
            )
        };
        let (value, noise) = at(cell);
        let neighbours = [
            cell.wrapping_sub(1),
            cell + 1,
            cell.wrapping_sub(self.size),
            cell + self.size,
        ];
        let (mut slope2, mut bend, mut bend_noise2) = (0.0_f32, 0.0_f32, 0.0_f32);
        for axis in 0..2 {
            let side = |side: usize| {
                let step = self.steps[cell][2 * axis + side]?;
                let neighbour = neighbours[2 * axis + side];
                measured(neighbour).then(|| (at(neighbour), step))
            };
            let two = match (side(0), side(1)) {
                (Some(a), Some(b)) => Some((a, b)),
                // At an edge one side stands for both.
                (Some((a, step)), None) | (None, Some((a, step))) => {
                    let noise2 = a.1 * a.1 + noise * noise;
                    slope2 += ((a.0 - value).powi(2) - CLEAR * noise2).max(0.0) / (step * step);
                    None
                }
                (None, None) => None,
            };
            if let Some((((low, low_noise), before), ((high, high_noise), after))) = two {
                let width = before + after;
                let noise2 = low_noise * low_noise + high_noise * high_noise;
                slope2 += ((high - low).powi(2) - CLEAR * noise2).max(0.0) / (width * width);
                let square = before * after;
                bend += (low + high - 2.0 * value) / square;
                bend_noise2 += (noise2 + 4.0 * noise * noise) / (square * square);
            }
        }
        let bend2 = (bend * bend - CLEAR * bend_noise2).max(0.0);
        (noise * noise
            + slope2 * self.direction_variance
            + bend2 * self.half_blur[cell] * self.half_blur[cell])
            .sqrt()
    }
}

/// What f is to be multiplied with for the throughput of the pixel that sees each cell, and for the sensitivity, and the
/// relative variance of the throughput of each cell.
fn throughput(rig: &Rig, photometry: &Photometry, disk: Disk) -> (Vec<f32>, Vec<f32>) {
    // Assembly has divided by this, in digital numbers.
    let assumed = rig.sensitivity_e() / rig.gain_e_per_dn();
    let camera = View::camera(rig);
    let fields = (0..disk.len()).map(|cell| {
        let at = disk.direction(cell).and_then(|w| camera.pixel(w).ok())?;
        let [x, y] = place(&camera, at);
        let field = &photometry.throughput;
        Some((field.at(x, y), field.relative_uncertainty_at(x, y)))
    });
    let (mut factors, mut variances) = (Vec::new(), Vec::new());
    for field in fields {
        let (field, relative) = field.unwrap_or((1.0, 0.0));
        factors.extend(
            photometry
                .sensitivity
                .iter()
                .map(|k| (assumed / (k * field)) as f32),
        );
        variances.push((relative * relative) as f32);
    }
    (factors, variances)
}

/// What f is to be multiplied with for the intensity of the lit pixels of each incident direction, and the relative
/// variance of that.
fn light(rig: &Rig, plan: &Plan, directions: &Directions, photometry: &Photometry) -> (Vec<f32>, Vec<f32>) {
    use rayon::prelude::*;
    let projector = View::projector(rig);
    let maker = PatternMaker::new(projector.clone(), plan.spot_deg, rig.projector.irradiance);
    let (width_px, height_px) = maker.size_px();
    let field = photometry.intensity.over(width_px, height_px);
    (0..directions.grid.len())
        .into_par_iter()
        .map(|index| {
            let w: DVec3 = directions.grid.direction(index);
            let lit = directions.reasons[index].is_none().then(|| maker.lit_set(w).ok());
            let Some((lit, at)) = lit.flatten().zip(projector.pixel(w).ok()) else {
                return (1.0, 0.0);
            };
            let [x, y] = place(&projector, at);
            let relative = photometry.intensity.relative_uncertainty_at(x, y);
            (
                (lit.irradiance / maker.irradiance_of(&lit, &field)) as f32,
                (relative * relative) as f32,
            )
        })
        .unzip()
}

/// The image position `at` (pixels) as fields take it, −1 to 1 over the image.
fn place(view: &View, at: DVec2) -> [f64; 2] {
    let half = |at: f64, size_px: u32| 2.0 * at / f64::from(size_px) - 1.0;
    [
        half(at.x, view.pinhole().width_px()),
        half(at.y, view.pinhole().height_px()),
    ]
}

/// Angles from each cell of the disk to its neighbours.
fn steps(disk: Disk) -> Vec<Steps> {
    let size = disk.size();
    let between = |a: usize, b: usize| -> Option<f32> {
        Some(disk.direction(a)?.angle_between(disk.direction(b)?) as f32)
    };
    (0..disk.len())
        .map(|cell| {
            let (x, y) = (cell % size, cell / size);
            [
                (x > 0).then(|| between(cell, cell - 1)).flatten(),
                (x + 1 < size).then(|| between(cell, cell + 1)).flatten(),
                (y > 0).then(|| between(cell, cell - size)).flatten(),
                (y + 1 < size).then(|| between(cell, cell + size)).flatten(),
            ]
        })
        .collect()
}
