//! Microfacets that a compact table is scaled and warped by.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use glam::DVec3;
use rayon::prelude::*;

use crate::brdf::format::luminance;
use crate::brdf::sample::rgl::Tables;
use crate::brdf::sample::warp::Density;
use crate::hemisphere::direction::from_angles;

/// Polar angle up to which the sample is asked for what it throws back, radians; beyond it is taken as there.
const LAST_RAD: f64 = 85.0 / 180.0 * PI;
/// The distribution of facets is nowhere less than this share of its largest value, so that what it does not explain is no large number.
const LEAST: f64 = 1e-3;
/// Points along each side of the projected area, and of the sum over facets that it is.
const SIGMA_SIDE: usize = 64;
const SUM_SIDE: usize = 96;
/// Points along each side of the density by which a table is warped.
const WARP_SIDE: usize = 32;
/// Least density, as a share of its mean: none is empty.
const EMPTY: f64 = 1e-3;
/// Cosine of directions of view, which are half seen at half of this: the density ends softly behind the horizon, because edges of it would
/// be edges of the table.
const SOFT: f64 = -0.3;

/// Ways to make facets that are tried: how their distribution is found, and the share of visible facets in the density of a table's points;
/// the rest is even over all half vectors that can be seen, so that what comes from elsewhere than the lobe keeps its points.
pub(super) const WAYS: [(Detail, f64); 4] = [
    (Detail::Sharp, 0.3),
    (Detail::Sharp, 0.0),
    (Detail::Smooth, 0.0),
    (Detail::Even, 0.0),
];

/// How the facets' distribution is found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Detail {
    /// As the sample throws light back.
    Sharp,
    /// Smoothed, so that noise of the sample stays out of it.
    Smooth,
    /// Even: the table is warped by what can be seen alone.
    Even,
}

impl Detail {
    /// Rows and columns of the distribution.
    const fn size(self, is_isotropic: bool) -> [usize; 2] {
        match (self, is_isotropic) {
            (Self::Even, _) => [0, 0],
            (Self::Sharp, true) => [2, 512],
            (Self::Sharp, false) => [256, 256],
            (Self::Smooth, true) => [2, 64],
            (Self::Smooth, false) => [64, 64],
        }
    }

    const fn places(self, is_isotropic: bool) -> usize {
        let [rows, columns] = self.size(is_isotropic);
        rows * columns
    }

    /// The facets' normals, row by row.
    fn seen(self, is_isotropic: bool) -> impl Iterator<Item = DVec3> {
        let [rows, columns] = self.size(is_isotropic);
        let last = (LAST_RAD / FRAC_PI_2).sqrt();
        vertices(rows).flat_map(move |v| vertices(columns).map(move |u| half(u.min(last), v)))
    }
}

/// Distribution of facets and their projected area by the retroreflection of Dupuy and Jakob's section 4.1: D·F·G = 4·f·cos²θ where light and
/// view are at the facet's normal. `None` if nothing is thrown back.
fn distribution(
    detail: Detail,
    is_isotropic: bool,
    values: &[Option<[f32; 3]>],
) -> Option<(Tables<f32>, Tables<f32>)> {
    let [rows, columns] = detail.size(is_isotropic);
    let known: Vec<Option<f64>> = values
        .iter()
        .zip(detail.seen(is_isotropic))
        .map(|(f, m)| Some(4.0 * luminance((*f)?).max(0.0) * m.z * m.z))
        .collect();
    let mut values = filled(&known, columns)?;
    if detail == Detail::Smooth {
        for _ in 0..2 {
            values = smoothed(&values, columns);
        }
    }
    let most = values.iter().copied().fold(0.0, f64::max);
    if most <= 0.0 {
        return None;
    }
    let share = |value: &f64| ((value + LEAST * most) / most) as f32;
    let ndf = Tables {
        rows,
        columns,
        values: values.iter().map(share).collect(),
    };
    let sigma = projected(&ndf, is_isotropic);
    Some((ndf, sigma))
}

/// Distribution of facets and their projected area, as [`bsdf`](super) has them.
#[derive(Debug)]
pub(super) struct Facets {
    pub(super) ndf: Tables<f32>,
    pub(super) sigma: Tables<f32>,
    /// Half vector and weight of a facet there (distribution by the size of the place, for a lobe) of each vertex of a warp, row by row;
    /// none of a table that is not warped.
    vertices: Vec<(DVec3, f64)>,
    /// Share of visible facets in the density of points.
    lobe: f64,
}

/// (θ, φ) of the half vector at (`u`, `v`).
pub(super) fn half(u: f64, v: f64) -> DVec3 {
    from_angles(u * u * FRAC_PI_2, v.mul_add(TAU, -PI))
}

/// (u, v) of a direction, which need not be a unit vector.
pub(super) fn place(m: DVec3) -> (f64, f64) {
    let theta_rad = m.truncate().length().atan2(m.z);
    let v = (m.y.atan2(m.x) + PI) / TAU;
    ((theta_rad / FRAC_PI_2).sqrt(), if v < 1.0 { v } else { v - 1.0 })
}

/// Size in sr of the facets at (`u`, v) by that of the square: dω/(du dv).
pub(super) fn size(u: f64) -> f64 {
    TAU * (u * u * FRAC_PI_2).sin() * PI * u
}

/// Positions of `count` vertices from 0 to 1.
fn vertices(count: usize) -> impl Iterator<Item = f64> + Clone {
    (0..count).map(move |number| number as f64 / (count - 1) as f64)
}

impl Facets {
    /// Of a table without warp: the factor ndf/(4·sigma) is 1.
    pub(super) fn none() -> Self {
        let even = |value: f32| Tables {
            rows: 2,
            columns: 2,
            values: vec![value; 4],
        };
        Self {
            ndf: even(1.0),
            sigma: even(0.25),
            vertices: Vec::new(),
            lobe: 0.0,
        }
    }

    /// The pairs of directions by which facets are found, of all [`WAYS`].
    pub(super) fn asked(is_isotropic: bool) -> Vec<(DVec3, DVec3)> {
        let seen = |detail: Detail| detail.seen(is_isotropic).map(|m| (m, m));
        [Detail::Sharp, Detail::Smooth]
            .into_iter()
            .flat_map(seen)
            .collect()
    }

    /// Those of all [`WAYS`] of a sample with these values at the pairs that are [`asked`](Self::asked) for; but for the last none if
    /// nothing of it is thrown back.
    pub(super) fn all(is_isotropic: bool, values: &[Option<[f32; 3]>]) -> Vec<Self> {
        let (sharp, smooth) = values.split_at(Detail::Sharp.places(is_isotropic));
        let sharp = distribution(Detail::Sharp, is_isotropic, sharp);
        let smooth = distribution(Detail::Smooth, is_isotropic, smooth);
        let of = |(detail, lobe): (Detail, f64)| {
            let (ndf, sigma) = match detail {
                Detail::Even => return Some(Self::around(Self::none())),
                Detail::Sharp => sharp.clone(),
                Detail::Smooth => smooth.clone(),
            }?;
            Some(Self::around(Self {
                ndf,
                sigma,
                vertices: Vec::new(),
                lobe,
            }))
        };
        WAYS.into_iter().filter_map(of).collect()
    }

    /// With the vertices of warps.
    fn around(mut self) -> Self {
        self.vertices = vertices(WARP_SIDE)
            .flat_map(|v| vertices(WARP_SIDE).map(move |u| (u, v)))
            .map(|(u, v)| (half(u, v), self.ndf_at(u, v) * size(u)))
            .collect();
        self
    }

    /// Points along each side of a warp.
    pub(super) fn warp_side(&self) -> usize {
        if self.vertices.is_empty() { 2 } else { WARP_SIDE }
    }

    pub(super) fn ndf_at(&self, u: f64, v: f64) -> f64 {
        self.ndf.patch(u, v).value(&self.ndf.values)
    }

    /// 4·sigma of the direction of light at (`u`, `v`).
    pub(super) fn four_sigma_at(&self, u: f64, v: f64) -> f64 {
        4.0 * self.sigma.patch(u, v).value(&self.sigma.values)
    }

    /// The density of points of a table under light from `wi`.
    pub(super) fn warp(&self, wi: DVec3) -> Density {
        if self.vertices.is_empty() {
            return Density::new(&[1.0; 4], 2).expect("invariant: it is not empty");
        }
        let both: Vec<[f64; 2]> = self
            .vertices
            .iter()
            .map(|(m, weight)| {
                let facing = m.dot(wi);
                let t = ((2.0 * facing * m.z - wi.z - SOFT) / -SOFT).clamp(0.0, 1.0);
                let is_seen = t * t * (3.0 - 2.0 * t);
                [weight * facing.max(0.0) * is_seen, is_seen]
            })
            .collect();
        let [lobe, even] = [0, 1].map(|of| both.iter().map(|one| one[of]).sum::<f64>() / both.len() as f64);
        let share = |value: f64, mean: f64| if mean > 0.0 { value / mean } else { 1.0 };
        let densities: Vec<f32> = both
            .iter()
            .map(|one| {
                (self.lobe * share(one[0], lobe) + (1.0 - self.lobe) * share(one[1], even) + EMPTY) as f32
            })
            .collect();
        Density::new(&densities, WARP_SIDE).expect("invariant: it is nowhere empty")
    }
}

/// The values of a table over (v, u) with those that are missing as their neighbours at less u, or else at more; `None` if there are none.
fn filled(known: &[Option<f64>], columns: usize) -> Option<Vec<f64>> {
    let mut filled = Vec::with_capacity(known.len());
    let all: Vec<f64> = known.iter().flatten().copied().collect();
    let mean = all.iter().sum::<f64>() / all.len() as f64;
    for row in known.chunks(columns) {
        let mut last = row.iter().flatten().next().copied().unwrap_or(mean);
        for value in row {
            last = value.unwrap_or(last);
            filled.push(last);
        }
    }
    (!all.is_empty()).then_some(filled)
}

/// The means over a value and its neighbours, which count half; the first row is also behind the last.
fn smoothed(values: &[f64], columns: usize) -> Vec<f64> {
    let rows = values.len() / columns;
    let around = |row: usize, step: isize| (row as isize + step).rem_euclid(rows as isize - 1) as usize;
    let across: Vec<f64> = (0..values.len())
        .map(|at| {
            let (row, column) = (at / columns, at % columns);
            let [before, after] = [column.saturating_sub(1), (column + 1).min(columns - 1)];
            let of = |column: usize| values[row * columns + column];
            0.25 * of(before) + 0.5 * values[at] + 0.25 * of(after)
        })
        .collect();
    (0..values.len())
        .map(|at| {
            let (row, column) = (at / columns, at % columns);
            let of = |row: usize| across[row * columns + column];
            0.25 * of(around(row, -1)) + 0.5 * of(around(row, 0)) + 0.25 * of(around(row, 1))
        })
        .collect()
}

/// The projected area of facets of distribution `ndf`: ∫ D(m)·max(0, m·ωi) dωm, by the middles of equal squares of (u, v).
fn projected(ndf: &Tables<f32>, is_isotropic: bool) -> Tables<f32> {
    let middles = (0..SUM_SIDE * SUM_SIDE).map(|at| {
        let middle = |number: usize| (number as f64 + 0.5) / SUM_SIDE as f64;
        let (u, v) = (middle(at % SUM_SIDE), middle(at / SUM_SIDE));
        (half(u, v), ndf.patch(u, v).value(&ndf.values) * size(u))
    });
    let facets: Vec<(DVec3, f64)> = middles.collect();
    let rows = if is_isotropic { 2 } else { SIGMA_SIDE };
    let directions: Vec<DVec3> = vertices(rows)
        .flat_map(|v| vertices(SIGMA_SIDE).map(move |u| (u, v)))
        .map(|(u, v)| half(u, if is_isotropic { 0.5 } else { v }))
        .collect();
    let area = |wi: &DVec3| {
        let facing = facets.iter().map(|(m, weight)| weight * m.dot(*wi).max(0.0));
        facing.sum::<f64>() / (SUM_SIDE * SUM_SIDE) as f64
    };
    let areas: Vec<f64> = directions.par_iter().map(area).collect();
    let least = LEAST * areas.iter().copied().fold(0.0, f64::max);
    Tables {
        rows,
        columns: SIGMA_SIDE,
        values: areas.iter().map(|area| area.max(least) as f32).collect(),
    }
}
