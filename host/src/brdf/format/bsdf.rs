//! Tensor files of the RGL material database (`.bsdf`), which Mitsuba and others read; reading is [`MeasuredRgl`]'s.
//!
//! Dupuy and Jakob, "An adaptive parameterization for efficient material acquisition and rendering", ACM TOG 37(6), 2018. Written is a
//! dense table whose warp is the identity, with which the look-up f·cosθo = rgb(u, v)·ndf/(4·sigma) is that of the table itself. (u, v) =
//! (√(2θm/π), (φm + π)/2π) of the half vector m; of an isotropic material φm counts from φi.
//!
//! | field | shape | values |
//! |---|---|---|
//! | `version` | u8 \[2\] | 1, 0 |
//! | `description` | u8 \[n\] | where it is from |
//! | `phi_i` | f32 \[P\] | −180° to 180°, both; of an isotropic material 0 alone |
//! | `theta_i` | f32 \[T\] | 0 to 90° |
//! | `ndf`, `sigma` | f32 \[2, 2\] | 1; ¼ |
//! | `vndf` | f32 \[P, T, 2, 2\] | 1 |
//! | `jacobian` | u8 \[1\] | 1 |
//! | `rgb` | f32 \[P, T, 3, R, R\] | f·cosθo in sr⁻¹; the rows are v, the columns u |
//! | `luminance` | f32 \[P, T, R, R\] | that of `rgb` (Rec. 709 weights), at least 10⁻⁶, by which renderers draw directions |
//!
//! The cosine is in it. Beyond the horizon the table is 0: renderers take no negative light, so that f just above the horizon, within
//! an entry of it, comes out too large. A missing value is refused, or 0.

use std::f64::consts::{FRAC_PI_2, PI, TAU};
use std::io::{BufWriter, Write};

use glam::DVec3;

use super::table::BATCH;
use super::{ExportError, Exporting, Resolution};
use crate::brdf::sample::tensor_writer::{Head, Kind, header};
use crate::hemisphere::direction::from_angles;

#[cfg(doc)]
use crate::brdf::sample::MeasuredRgl;

/// Points along each side of the half vectors, polar angles and azimuths of light, if nobody says otherwise: as few as leave an error of
/// some 0.1 % of a satin.
const SIDE: usize = 128;
const THETAS: usize = 31;
const PHIS: usize = 73;
/// The same of isotropic samples, whose files are small.
const ISOTROPIC_SIDE: usize = 192;
const ISOTROPIC_THETAS: usize = 61;
/// Largest side.
const MOST_SIDE: usize = 1024;
/// Cosine of directions of view at which f is taken at least.
const LOWEST: f64 = 0.02;
/// Least luminance.
const LEAST: f32 = 1e-6;
/// The last polar angle at which f is asked for, radians: at 90° there is none.
const LAST_RAD: f64 = 89.5 / 180.0 * PI;

/// What is tabulated.
struct Table {
    /// Radians.
    phi_i: Vec<f64>,
    theta_i: Vec<f64>,
    /// Points along each side of the half vectors.
    side: usize,
    is_isotropic: bool,
}

/// A field that is in memory as a whole: name, shape, type and data.
type Small = (&'static str, Vec<u64>, Kind, Vec<u8>);

impl Table {
    /// Of a size that `resolution` says.
    fn of(exporting: &Exporting, resolution: Resolution) -> Result<Self, ExportError> {
        let is_isotropic = exporting.is_isotropic();
        let side = match resolution.side {
            0 if is_isotropic => ISOTROPIC_SIDE,
            0 => SIDE,
            side => side,
        };
        if !(2..=MOST_SIDE).contains(&side) {
            return Err(exporting.refused(
                "resolution",
                format!("2 to {MOST_SIDE} points a side"),
                side.to_string(),
            ));
        }
        let (thetas, phis) = if resolution.step_deg > 0.0 {
            let count = |of_deg: f64| (of_deg / resolution.step_deg).ceil().max(1.0) as usize + 1;
            (count(90.0), count(360.0))
        } else {
            (if is_isotropic { ISOTROPIC_THETAS } else { THETAS }, PHIS)
        };
        let share = |number: usize, count: usize| number as f64 / (count - 1) as f64;
        Ok(Self {
            phi_i: if is_isotropic {
                vec![0.0]
            } else {
                (0..phis).map(|n| share(n, phis).mul_add(TAU, -PI)).collect()
            },
            theta_i: (0..thetas).map(|n| share(n, thetas) * FRAC_PI_2).collect(),
            side,
            is_isotropic,
        })
    }

    fn slices(&self) -> usize {
        self.phi_i.len() * self.theta_i.len()
    }

    fn small(&self, description: String) -> [Small; 8] {
        let narrow = |of: &[f64]| bytes(&of.iter().map(|one| *one as f32).collect::<Vec<f32>>());
        let (p, t) = (self.phi_i.len() as u64, self.theta_i.len() as u64);
        let ones = vec![1.0_f32; 4 * self.slices()];
        [
            ("version", vec![2], Kind::U8, vec![1, 0]),
            (
                "description",
                vec![description.len() as u64],
                Kind::U8,
                description.into_bytes(),
            ),
            ("phi_i", vec![p], Kind::F32, narrow(&self.phi_i)),
            ("theta_i", vec![t], Kind::F32, narrow(&self.theta_i)),
            ("ndf", vec![2, 2], Kind::F32, bytes(&[1.0; 4])),
            ("sigma", vec![2, 2], Kind::F32, bytes(&[0.25; 4])),
            ("vndf", vec![p, t, 2, 2], Kind::F32, bytes(&ones)),
            ("jacobian", vec![1], Kind::U8, vec![1]),
        ]
    }

    /// The pairs of directions of a slice: φi by φi.
    fn pairs(&self, slice: usize) -> impl Iterator<Item = (DVec3, DVec3)> + use<> {
        let theta_rad = self.theta_i[slice % self.theta_i.len()].min(LAST_RAD);
        let wi = from_angles(theta_rad, self.phi_i[slice / self.theta_i.len()]);
        grid(wi, self.side, self.is_isotropic)
    }

    /// Writes `rgb` and answers `luminance`.
    fn write(&self, exporting: &Exporting, file: &mut impl Write) -> Result<Vec<f32>, ExportError> {
        let cells = self.side * self.side;
        let mut luminance = Vec::with_capacity(self.slices() * cells);
        let at_once = (BATCH / cells).max(1);
        exporting
            .progress
            .begin("export", self.slices(), "incident directions");
        for first in (0..self.slices()).step_by(at_once) {
            let range = first..(first + at_once).min(self.slices());
            let asked: Vec<(DVec3, DVec3)> = range.clone().flat_map(|slice| self.pairs(slice)).collect();
            let pairs: Vec<_> = asked
                .iter()
                .filter(|(_, wo)| wo.z > 0.0)
                .map(|(wi, wo)| (*wi, raised(*wo)))
                .collect();
            let mut found = exporting.values(&pairs)?.into_iter();
            let weighted: Vec<[f32; 3]> = asked
                .iter()
                .map(|(_, wo)| {
                    let f = if wo.z > 0.0 { found.next().flatten() } else { None };
                    f.map_or([0.0; 3], |f| f.map(|f| (f * wo.z as f32).max(0.0)))
                })
                .collect();
            for slice in weighted.chunks(cells) {
                let planes: Vec<f32> = (0..3)
                    .flat_map(|channel| slice.iter().map(move |f| f[channel]))
                    .collect();
                file.write_all(&bytes(&planes))
                    .map_err(|error| exporting.failed(error))?;
                luminance.extend(slice.iter().map(|f| (super::luminance(*f) as f32).max(LEAST)));
            }
            exporting.progress.reach(range.end);
        }
        Ok(luminance)
    }
}

/// Writes the table.
///
/// # Errors
/// [`ExportError`].
pub(super) fn write(exporting: &Exporting, resolution: Resolution) -> Result<(), ExportError> {
    let table = Table::of(exporting, resolution)?;
    let small = table.small(exporting.description());
    let mut fields: Vec<Head> = small
        .iter()
        .map(|(name, shape, kind, data)| (*name, shape.as_slice(), *kind, data.len() as u64))
        .collect();
    let [p, t, r] = [table.phi_i.len(), table.theta_i.len(), table.side].map(|count| count as u64);
    let (rgb_shape, luminance_shape) = ([p, t, 3, r, r], [p, t, r, r]);
    let plane_bytes = 4 * p * t * r * r;
    fields.push(("rgb", &rgb_shape, Kind::F32, 3 * plane_bytes));
    fields.push(("luminance", &luminance_shape, Kind::F32, plane_bytes));
    let (head, gaps) = header(&fields);

    let mut file = BufWriter::new(exporting.create()?);
    let failed = |error| exporting.failed(error);
    file.write_all(&head).map_err(failed)?;
    for ((.., data), gap) in small.iter().zip(&gaps) {
        file.write_all(&vec![0; *gap]).map_err(failed)?;
        file.write_all(data).map_err(failed)?;
    }
    file.write_all(&vec![0; gaps[small.len()]]).map_err(failed)?;
    let luminance = table.write(exporting, &mut file)?;
    exporting.check_whole(resolution.zeros)?;
    file.write_all(&vec![0; gaps[small.len() + 1]]).map_err(failed)?;
    file.write_all(&bytes(&luminance)).map_err(failed)?;
    exporting.finish(file)
}

/// The pairs of directions at the half vectors of a table of `side`² entries under light from `wi`, rows of one φm; the outgoing one may be
/// below the horizon.
fn grid(wi: DVec3, side: usize, is_relative: bool) -> impl Iterator<Item = (DVec3, DVec3)> {
    let turn_rad = if is_relative { wi.y.atan2(wi.x) } else { 0.0 };
    let place = move |number: usize| number as f64 / (side - 1) as f64;
    (0..side * side).map(move |number| {
        let (u, v) = (place(number % side), place(number / side));
        let half = from_angles(u * u * FRAC_PI_2, v.mul_add(TAU, -PI) + turn_rad);
        (wi, 2.0 * wi.dot(half) * half - wi)
    })
}

/// `wo`, or if that is just above the horizon the direction of [`LOWEST`] cosine at its azimuth.
fn raised(wo: DVec3) -> DVec3 {
    if wo.z >= LOWEST {
        return wo;
    }
    let across = wo.truncate().try_normalize().unwrap_or(glam::DVec2::X);
    (across * (1.0 - LOWEST * LOWEST).sqrt()).extend(LOWEST)
}

fn bytes(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|value| value.to_le_bytes()).collect()
}
