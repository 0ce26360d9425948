//! A table over incident directions and half vectors: where its points are, and what it says between them.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use glam::DVec3;
use rayon::prelude::*;

use super::facets::{Facets, half, place, size};
use crate::base::bracket::bracket;
use crate::brdf::format::round_trip::{RoundTrip, Trial};
use crate::brdf::format::{ExportError, Exporting, luminance};
use crate::brdf::sample::warp::Density;
use crate::hemisphere::direction::from_angles;

/// Cosine of directions of view at which f is taken at least.
const LOWEST: f64 = 0.02;
/// The last polar angle at which f is asked for, radians: at 90° there is none.
const LAST_RAD: f64 = 89.5 / 180.0 * PI;
/// Entries around a pair of directions: slices by corners of a cell.
const AROUND: usize = 16;

/// What is tabulated.
#[derive(Debug)]
pub(super) struct Table {
    /// Radians.
    pub(super) phi_i: Vec<f64>,
    pub(super) theta_i: Vec<f64>,
    /// Points along each side of the half vectors.
    pub(super) side: usize,
    /// Whether azimuths count from that of light, which is the only one.
    pub(super) is_isotropic: bool,
    pub(super) facets: Facets,
}

/// One entry of a table.
#[derive(Clone, Copy, Debug)]
pub(super) struct Point {
    wi: DVec3,
    /// May be below the horizon.
    wo: DVec3,
    /// What f·cosθo is multiplied by: 4·sigma/ndf.
    factor: f64,
    /// Solid angle of view by area of the table, which luminance is weighted with: so renderers draw as much as is reflected.
    solid_angle: f64,
}

impl Point {
    /// The pair of directions that is asked for; `None` where nothing is seen.
    pub(super) fn pair(&self) -> Option<(DVec3, DVec3)> {
        (self.wo.z > 0.0).then(|| (self.wi, raised(self.wo)))
    }

    /// What f becomes in a table, from a value that was asked for.
    pub(super) fn weight(&self) -> f64 {
        self.wo.z.max(0.0) * self.factor
    }

    /// What f is multiplied by in the field of luminance.
    pub(super) fn drawn(&self) -> f64 {
        self.wo.z.max(0.0) * self.solid_angle
    }
}

/// A pair of directions between entries of a table.
struct Between {
    entries: [(Point, f64); AROUND],
    /// What the mean of the entries is multiplied by to be f.
    scale: f64,
}

impl Table {
    pub(super) fn slices(&self) -> usize {
        self.phi_i.len() * self.theta_i.len()
    }

    /// Direction of light of a slice, and its place among directions: φi by φi.
    fn light(&self, slice: usize) -> (DVec3, (f64, f64)) {
        let (theta_rad, phi_rad) = (
            self.theta_i[slice % self.theta_i.len()],
            self.phi_i[slice / self.theta_i.len()],
        );
        let at = ((theta_rad / FRAC_PI_2).sqrt(), (phi_rad + PI) / TAU);
        (from_angles(theta_rad.min(LAST_RAD), phi_rad), at)
    }

    /// The warp of a slice.
    pub(super) fn warp(&self, slice: usize) -> Density {
        self.facets.warp(self.light(slice).0)
    }

    /// The entry of a slice at (`s_u`, `s_v`) of a table that `warp` warps.
    fn point(&self, slice: usize, warp: &Density, (s_u, s_v): (f64, f64)) -> Point {
        let (wi, (u_i, v_i)) = self.light(slice);
        let (u, v) = warp.warp(s_u, s_v);
        let m = half(u, v);
        let facing = wi.dot(m);
        Point {
            wi,
            wo: 2.0 * facing * m - wi,
            factor: self.facets.four_sigma_at(u_i, v_i) / self.facets.ndf_at(u, v),
            solid_angle: 4.0 * facing.abs() * size(u) / warp.at(u, v),
        }
    }

    /// The entries of a slice, rows of one s_v.
    pub(super) fn points(&self, slice: usize) -> Vec<Point> {
        let warp = self.warp(slice);
        let position = |number: usize| number as f64 / (self.side - 1) as f64;
        (0..self.side * self.side)
            .map(|number| {
                let at = (position(number % self.side), position(number / self.side));
                self.point(slice, &warp, at)
            })
            .collect()
    }

    /// The entries around a pair of directions in tables of that many points a side, as readers find them.
    fn between(&self, wi: DVec3, wo: DVec3, sides: &[usize]) -> Vec<Between> {
        let (theta_rad, azimuth_rad) = (wi.truncate().length().atan2(wi.z), wi.y.atan2(wi.x));
        let turn = glam::DVec2::from_angle(if self.is_isotropic { -azimuth_rad } else { 0.0 });
        let h = wi + wo;
        let (u, v) = place(turn.rotate(h.truncate()).extend(h.z));
        let (phi, phi_weights) = bracket(&self.phi_i, if self.is_isotropic { 0.0 } else { azimuth_rad });
        let (theta, theta_weights) = bracket(&self.theta_i, theta_rad);
        let slices = [(0, 0), (0, 1), (1, 0), (1, 1)].map(|(a, b)| {
            let slice = (phi + a) * self.theta_i.len() + theta + b;
            (slice, phi_weights[a] * theta_weights[b])
        });
        // A slice without weight may not exist.
        let warps: Vec<(usize, Density, f64)> = slices
            .into_iter()
            .filter(|(_, weight)| *weight > 0.0)
            .map(|(slice, weight)| (slice, self.warp(slice), weight))
            .collect();
        let s = Density::invert_mean(warps.iter().map(|(_, warp, weight)| (warp, *weight)), u, v);
        let (u_i, v_i) = place(wi);
        let scale = self.facets.ndf_at(u, v) / self.facets.four_sigma_at(u_i, v_i) / wo.z;
        let entries = |&side: &usize| {
            let last = (side - 1) as f64;
            let cell = |s: f64| {
                let at = (s * last) as usize;
                let at = at.min(side - 2);
                (at, s.mul_add(last, -(at as f64)))
            };
            let ((column, t_u), (row, t_v)) = (cell(s.0), cell(s.1));
            let mut entries = warps.iter().flat_map(|(slice, warp, weight)| {
                [(0, 0), (0, 1), (1, 0), (1, 1)].map(|(b, a)| {
                    let at = ((column + a) as f64 / last, (row + b) as f64 / last);
                    let share = [1.0 - t_u, t_u][a] * [1.0 - t_v, t_v][b];
                    (self.point(*slice, warp, at), weight * share)
                })
            });
            let first = self.point(slices[0].0, &warps[0].1, s);
            Between {
                entries: std::array::from_fn(|_| entries.next().unwrap_or((first, 0.0))),
                scale,
            }
        };
        sides.iter().map(entries).collect()
    }
}

/// The entries around each pair of a trial, in tables of some sides: by these alone it is known how far a table would be from its source.
pub(super) struct Tried {
    /// Of each pair, side by side.
    all: Vec<Vec<Between>>,
}

impl Tried {
    /// Those of tables as `table` with so many points along each side of the half vectors.
    pub(super) fn of(table: &Table, trial: &Trial, sides: &[usize]) -> Self {
        let between = |(wi, wo): &(DVec3, DVec3)| table.between(*wi, *wo, sides);
        Self {
            all: trial.pairs.par_iter().map(between).collect(),
        }
    }

    fn entries(&self, side: usize) -> impl Iterator<Item = &(Point, f64)> {
        self.all.iter().flat_map(move |of| of[side].entries.iter())
    }

    /// The pairs of directions of the entries of side number `side`.
    pub(super) fn asked(&self, side: usize) -> Vec<(DVec3, DVec3)> {
        self.entries(side)
            .filter(|(_, share)| *share > 0.0)
            .filter_map(|(point, _)| point.pair())
            .collect()
    }

    /// How far that table is from its source, which has these values at the pairs that are [`asked`](Self::asked) for.
    pub(super) fn told(&self, trial: &Trial, side: usize, found: &[Option<[f32; 3]>]) -> RoundTrip {
        let mut found = found.iter();
        let mut value = |(point, share): &(Point, f64)| {
            if *share <= 0.0 || point.pair().is_none() {
                return 0.0;
            }
            let f = found.next().copied().flatten().map_or(0.0, luminance);
            share * f * point.weight()
        };
        let places = self.all.iter().map(|of| &of[side]);
        let read = places.map(|place| place.scale * place.entries.iter().map(&mut value).sum::<f64>());
        trial.against(read.collect::<Vec<f64>>())
    }

    /// The same, asked for by itself.
    pub(super) fn ask(
        &self,
        exporting: &Exporting,
        trial: &Trial,
        side: usize,
    ) -> Result<RoundTrip, ExportError> {
        Ok(self.told(trial, side, &exporting.peek(&self.asked(side))?))
    }
}

/// `wo`, or if that is just above the horizon the direction of [`LOWEST`] cosine at its azimuth.
fn raised(wo: DVec3) -> DVec3 {
    if wo.z >= LOWEST {
        return wo;
    }
    let across = wo.truncate().try_normalize().unwrap_or(glam::DVec2::X);
    (across * (1.0 - LOWEST * LOWEST).sqrt()).extend(LOWEST)
}
