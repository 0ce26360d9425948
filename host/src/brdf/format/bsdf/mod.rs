//! Tensor files of the RGL material database (`.bsdf`), which Mitsuba and others read; reading is [`MeasuredRgl`]'s.
//!
//! Dupuy and Jakob, "An adaptive parameterization for efficient material acquisition and rendering", ACM TOG 37(6), 2018. The look-up is
//! f·cosθo = rgb(s)·ndf(u, v)/(4·sigma), where (u, v) = (√(2θm/π), (φm + π)/2π) of the half vector m and s is what the warp of the density
//! `vndf` carries to (u, v); of an isotropic material φm counts from φi.
//!
//! | field | shape | values |
//! |---|---|---|
//! | `version` | u8 \[2\] | 1, 0 |
//! | `description` | u8 \[n\] | where it is from |
//! | `phi_i` | f32 \[P\] | −180° to 180°, both; of an isotropic material 0 alone |
//! | `theta_i` | f32 \[T\] | 0 to 90° |
//! | `ndf`, `sigma` | f32 \[≥2, ≥2\] | distribution of facets and their projected area; 1 and ¼ of a dense table |
//! | `jacobian` | u8 \[1\] | 1 |
//! | `vndf` | f32 \[P, T, W, W\] | density of the table's points; 1 (W = 2) of a dense table, whose warp is the identity |
//! | `rgb` | f32 \[P, T, 3, R, R\] | f·cosθo·4·sigma/ndf in sr⁻¹; the rows are s_v, the columns s_u |
//! | `luminance` | f32 \[P, T, R, R\] | that of f·cosθo (Rec. 709 weights) by the solid angle of view of a place in the table, at least 10⁻⁶: by which renderers draw directions |
//!
//! The cosine is in it. Beyond the horizon the table is 0: renderers take no negative light, so that f just above the horizon, within
//! an entry of it, comes out too large. A missing value is refused, or 0.
//!
//! # Design
//! Each entry is f where it stands, whatever warp and facets are; these decide how well what is between follows. A compact table has facets
//! as the sample throws light back (section 4.1 of the paper), by which values are divided, and points where these facets, or any at all,
//! are seen: so lobe and horizon need fewer of them. How far a table would be from its source is found beforehand, from the entries around
//! each pair of the round trip alone: the smallest compact table with no larger median and no larger 99 % of the differences is written, or
//! else the dense one. What is such a file already keeps its own tables, as no others have their points where it bends.

mod choice;
mod facets;
mod own;
mod table;

use std::io::{BufWriter, Write};
use std::ops::Range;

use glam::DVec3;
use rayon::prelude::*;

use self::table::{Point, Table};
use super::{ExportError, Exporting, Resolution};
use crate::brdf::sample::rgl::Tables;
use crate::brdf::sample::tensor_writer::{Head, Kind, header};

pub use choice::{Form, Tabulation};

#[cfg(doc)]
use crate::brdf::sample::MeasuredRgl;

/// Least luminance.
const LEAST: f32 = 1e-6;

/// A field that is in memory as a whole: name, shape, type and data.
type Small = (&'static str, Vec<u64>, Kind, Vec<u8>);

/// R, G and B of `rgb`, and luminance.
type Entry = ([f32; 3], f32);

/// What a file is made of, but for the tables of its slices.
struct Layout<'a> {
    /// Radians.
    phi_i: &'a [f64],
    theta_i: &'a [f64],
    ndf: &'a Tables<f32>,
    sigma: &'a Tables<f32>,
    /// Rows and columns of `vndf`.
    warp: [usize; 2],
    /// Of `rgb` and `luminance`.
    side: usize,
}

/// The tables of slices, φi by φi.
trait Slices {
    /// The density, row by row.
    fn vndf(&self, slice: usize) -> Vec<f32>;

    /// The entries, row by row and slice by slice.
    fn entries(&self, slices: Range<usize>) -> Result<Vec<Entry>, ExportError>;
}

impl Layout<'_> {
    fn slices(&self) -> usize {
        self.phi_i.len() * self.theta_i.len()
    }

    fn small(&self, description: String) -> [Small; 7] {
        let narrow = |of: &[f64]| bytes(of.iter().map(|one| *one as f32));
        let (p, t) = (self.phi_i.len() as u64, self.theta_i.len() as u64);
        let shape = |of: &Tables<f32>| vec![of.rows as u64, of.columns as u64];
        let table = |of: &Tables<f32>| bytes(of.values.iter().copied());
        [
            ("version", vec![2], Kind::U8, vec![1, 0]),
            (
                "description",
                vec![description.len() as u64],
                Kind::U8,
                description.into_bytes(),
            ),
            ("phi_i", vec![p], Kind::F32, narrow(self.phi_i)),
            ("theta_i", vec![t], Kind::F32, narrow(self.theta_i)),
            ("ndf", shape(self.ndf), Kind::F32, table(self.ndf)),
            ("sigma", shape(self.sigma), Kind::F32, table(self.sigma)),
            ("jacobian", vec![1], Kind::U8, vec![1]),
        ]
    }
}

impl Table {
    fn layout(&self) -> Layout<'_> {
        Layout {
            phi_i: &self.phi_i,
            theta_i: &self.theta_i,
            ndf: &self.facets.ndf,
            sigma: &self.facets.sigma,
            warp: [self.facets.warp_side(); 2],
            side: self.side,
        }
    }

    /// Bytes of the tables of a file whose side is that.
    fn bytes(&self, side: usize) -> u64 {
        let warp = self.facets.warp_side();
        let facets = self.facets.ndf.values.len() + self.facets.sigma.values.len();
        4 * (self.slices() * (4 * side * side + warp * warp) + facets) as u64
    }
}

/// A table and the source of its values.
struct Asked<'a>(&'a Table, &'a Exporting<'a>);

impl Slices for Asked<'_> {
    fn vndf(&self, slice: usize) -> Vec<f32> {
        self.0.warp(slice).densities().collect()
    }

    fn entries(&self, slices: Range<usize>) -> Result<Vec<Entry>, ExportError> {
        let seen: Vec<Seen> = slices
            .into_par_iter()
            .map(|slice| Seen::of(&self.0.points(slice)))
            .collect();
        let mut pairs = Vec::with_capacity(seen.iter().map(|slice| slice.pairs.len()).sum());
        let mut weights = Vec::with_capacity(seen.len());
        for slice in seen {
            pairs.extend(slice.pairs);
            weights.push(slice.weights);
        }
        let values = self.1.values(&pairs)?;
        drop(pairs);
        let mut found = values.into_iter();
        let entry = |weights: &Option<[f32; 2]>| {
            let Some([weight, drawn]) = weights else {
                return ([0.0; 3], 0.0);
            };
            let f = found.next().flatten().unwrap_or_default();
            let luminance = super::luminance(f) as f32;
            (f.map(|f| (f * weight).max(0.0)), luminance * drawn)
        };
        Ok(weights.iter().flatten().map(entry).collect())
    }
}

/// What is asked for of a slice.
struct Seen {
    pairs: Vec<(DVec3, DVec3)>,
    /// Of each point what its f and its luminance are multiplied by; `None` where nothing is seen.
    weights: Vec<Option<[f32; 2]>>,
}

impl Seen {
    fn of(points: &[Point]) -> Self {
        Self {
            pairs: points.iter().filter_map(Point::pair).collect(),
            weights: points
                .iter()
                .map(|point| {
                    point
                        .pair()
                        .map(|_| [point.weight() as f32, point.drawn() as f32])
                })
                .collect(),
        }
    }
}

/// Writes the table that is the smallest and good enough, and answers which that is.
///
/// # Errors
/// [`ExportError`].
pub(super) fn write(exporting: &Exporting, resolution: Resolution) -> Result<Tabulation, ExportError> {
    if let Some(own) = own::write(exporting, resolution)? {
        return Ok(own);
    }
    let (table, told) = choice::choose(exporting, resolution)?;
    stream(
        exporting,
        resolution.zeros,
        &table.layout(),
        &Asked(&table, exporting),
    )?;
    Ok(told)
}

/// Writes a file, some slices at a time.
fn stream(
    exporting: &Exporting,
    zeros: bool,
    layout: &Layout,
    slices: &dyn Slices,
) -> Result<(), ExportError> {
    let small = layout.small(exporting.description());
    let mut fields: Vec<Head> = small
        .iter()
        .map(|(name, shape, kind, data)| (*name, shape.as_slice(), *kind, data.len() as u64))
        .collect();
    let [p, t, r] = [layout.phi_i.len(), layout.theta_i.len(), layout.side].map(|count| count as u64);
    let [rows, columns] = layout.warp.map(|count| count as u64);
    let (vndf_shape, rgb_shape, luminance_shape) = ([p, t, rows, columns], [p, t, 3, r, r], [p, t, r, r]);
    let plane_bytes = 4 * p * t * r * r;
    fields.push(("vndf", &vndf_shape, Kind::F32, 4 * p * t * rows * columns));
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
    let [vndf_gap, rgb_gap, luminance_gap] = [0, 1, 2].map(|field| vec![0; gaps[small.len() + field]]);
    file.write_all(&vndf_gap).map_err(failed)?;
    for slice in 0..layout.slices() {
        file.write_all(&bytes(slices.vndf(slice))).map_err(failed)?;
    }
    file.write_all(&rgb_gap).map_err(failed)?;
    let cells = layout.side * layout.side;
    let mut luminance: Vec<f32> = Vec::with_capacity(layout.slices() * cells);
    let at_once = (exporting.at_once() / cells).max(1);
    exporting
        .progress
        .begin("export", layout.slices(), "incident directions");
    for first in (0..layout.slices()).step_by(at_once) {
        let range = first..(first + at_once).min(layout.slices());
        for slice in slices.entries(range.clone())?.chunks(cells) {
            let planes = (0..3).flat_map(|channel| slice.iter().map(move |(rgb, _)| rgb[channel]));
            file.write_all(&bytes(planes)).map_err(failed)?;
            luminance.extend(slice.iter().map(|(_, luminance)| luminance.max(LEAST)));
        }
        exporting.progress.reach(range.end);
    }
    exporting.check_whole(zeros)?;
    file.write_all(&luminance_gap).map_err(failed)?;
    file.write_all(&bytes(luminance)).map_err(failed)?;
    exporting.finish(file)
}

fn bytes(values: impl IntoIterator<Item = f32>) -> Vec<u8> {
    values.into_iter().flat_map(f32::to_le_bytes).collect()
}
