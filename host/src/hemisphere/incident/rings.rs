//! Rings of equally spaced incident directions.
//!
//! # Design
//! Ring k lies at θ = (k + ½)·step. Interpolation works in the plane p = θ·(cos φ, sin φ), where the directions of a
//! ring are the corners of a regular polygon. A direction lies between two polygons, on a ray from the pole that
//! crosses one side of each; it is interpolated linearly along both sides and then along the ray. That reproduces
//! every linear function of p exactly, at the pole and where two rings have different counts too. Within the first
//! polygon the ray's other end takes part; beyond the last one the value stays.
//!
//! # Tradeoffs
//! At the pole the value is the mean of two opposite directions, and which two depends on the azimuth that it was asked
//! at: a difference of second order in the step, for which four neighbours are always enough.

use std::f64::consts::{PI, TAU};

use glam::DVec3;

use super::{IncidentError, Neighbours, NeighboursOfEight};
use crate::base::eight::{Eight, LANES, Vectors};
use crate::hemisphere::direction::from_degrees;

/// Directions of a ring whose sides are short enough for [`Eight::tan`].
const SHORT_SIDES: usize = 6;

/// Rings of equally spaced directions.
#[derive(Clone, Debug, PartialEq)]
pub struct Rings {
    step_deg: f64,
    step_rad: f64,
    /// Index of the first direction of each ring, and after the last one.
    starts: Vec<usize>,
    /// Tangent and cosine of half the angle of a side, of each ring: look-ups by the million ask for them.
    half_sides: Vec<[f64; 2]>,
    /// Of each ring, for eight look-ups at once: how many directions it has and the index of the first one, the angle of half a side in
    /// rad, half of one over its tangent, and the least distance of its polygon from the pole in rad.
    at_once: Vec<[f32; 5]>,
    /// Azimuth on the rings of the +x of the frame in which directions are, degrees.
    azimuth_deg: f64,
}

/// Where a ray from the pole crosses a side of a ring's polygon.
struct Crossing {
    /// The corners of the side with their weights.
    ends: [(usize, f64); 2],
    /// Distance from the pole in the plane, in radians.
    radius_rad: f64,
}

/// As [`Crossing`], of eight rays.
struct Crossings {
    rows: [[u32; LANES]; 2],
    weights: [Eight; 2],
    radius_rad: Eight,
}

impl Rings {
    /// Rings of 360/`step_deg` directions each.
    ///
    /// # Errors
    /// [`IncidentError::Step`] if 90° is no whole number of steps.
    pub fn theta_phi(step_deg: f64) -> Result<Self, IncidentError> {
        Self::new(step_deg, |_, rings| 4 * rings)
    }

    /// Rings of as many directions as keep the gap along each ring within `step_deg`: 360·sinθ/step, rounded up.
    ///
    /// # Errors
    /// As [`Self::theta_phi`].
    pub fn equal_solid_angle(step_deg: f64) -> Result<Self, IncidentError> {
        Self::new(step_deg, |theta_deg, rings| {
            (4.0 * rings as f64 * theta_deg.to_radians().sin()).ceil() as usize
        })
    }

    fn new(step_deg: f64, count: impl Fn(f64, usize) -> usize) -> Result<Self, IncidentError> {
        let rings = 90.0 / step_deg;
        let whole = (rings - rings.round()).abs() < 1e-9 * rings;
        if !(0.25..=45.0).contains(&step_deg) || !whole {
            return Err(IncidentError::Step { step_deg });
        }
        let rings = rings.round() as usize;
        let step_deg = 90.0 / rings as f64;
        let half = |ring: usize| PI / count((ring as f64 + 0.5) * step_deg, rings) as f64;
        let half_sides = (0..rings).map(|ring| [half(ring).tan(), half(ring).cos()]);
        let half_sides = half_sides.collect();
        let mut starts = vec![0];
        for ring in 0..rings {
            starts.push(starts[ring] + count((ring as f64 + 0.5) * step_deg, rings));
        }
        let step_rad = step_deg.to_radians();
        let at_once = (0..rings).map(|ring| {
            let radius_rad = (ring as f64 + 0.5) * step_rad * half(ring).cos();
            let count = (starts[ring + 1] - starts[ring]) as f32;
            let half = half(ring);
            [
                count,
                starts[ring] as f32,
                half as f32,
                (0.5 / half.tan()) as f32,
                radius_rad as f32,
            ]
        });
        Ok(Self {
            at_once: at_once.collect(),
            step_deg,
            step_rad,
            starts,
            half_sides,
            azimuth_deg: 0.0,
        })
    }

    /// The same directions in a frame whose +x lies at `azimuth_deg` in this one.
    #[must_use]
    pub fn turned(&self, azimuth_deg: f64) -> Self {
        Self {
            azimuth_deg: self.azimuth_deg + azimuth_deg,
            ..self.clone()
        }
    }

    /// Number of directions.
    #[must_use]
    pub fn len(&self) -> usize {
        self.starts[self.rings()]
    }

    /// Never: there are at least two rings.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        false
    }

    /// Number of rings.
    #[must_use]
    pub fn rings(&self) -> usize {
        self.starts.len() - 1
    }

    /// Number of directions of `ring`, from the pole.
    #[inline]
    #[must_use]
    pub fn count(&self, ring: usize) -> usize {
        self.starts[ring + 1] - self.starts[ring]
    }

    /// Degrees between rings.
    #[must_use]
    pub const fn step_deg(&self) -> f64 {
        self.step_deg
    }

    /// Angles (θ, φ) of direction `index` in degrees.
    #[must_use]
    pub fn angles_deg(&self, index: usize) -> (f64, f64) {
        let ring = self.ring_of(index);
        let sector = index - self.starts[ring];
        (
            (ring as f64 + 0.5) * self.step_deg,
            turned_deg(
                sector as f64 * (360.0 / self.count(ring) as f64),
                self.azimuth_deg,
            ),
        )
    }

    /// Unit vector of direction `index`, sample frame.
    #[must_use]
    pub fn direction(&self, index: usize) -> DVec3 {
        let (theta_deg, phi_deg) = self.angles_deg(index);
        from_degrees(theta_deg, phi_deg)
    }

    fn ring_of(&self, index: usize) -> usize {
        self.starts.partition_point(|&start| start <= index) - 1
    }

    /// See [`super::IncidentSet::neighbours`].
    #[must_use]
    pub fn neighbours(&self, w: DVec3) -> Neighbours {
        let theta_rad = w.truncate().length().atan2(w.z);
        let phi_rad = w.y.atan2(w.x) + self.azimuth_deg.to_radians();
        let last = self.rings() - 1;
        // The ring at or inside of w; its polygon lies within its circle.
        let circle = theta_rad / self.step_rad - 0.5;
        if circle < 0.0 {
            let outer = self.crossing(0, phi_rad);
            if theta_rad < outer.radius_rad {
                let across = self.crossing(0, phi_rad + PI);
                return between(&across, -across.radius_rad, &outer, theta_rad);
            }
        }
        let mut ring = (circle.max(0.0) as usize).min(last);
        let mut inner = self.crossing(ring, phi_rad);
        while ring < last {
            let outer = self.crossing(ring + 1, phi_rad);
            if theta_rad < outer.radius_rad {
                return between(&inner, inner.radius_rad, &outer, theta_rad);
            }
            inner = outer;
            ring += 1;
        }
        let [a, b] = inner.ends;
        [a, b, (a.0, 0.0), (b.0, 0.0)]
    }

    /// Where the ray at azimuth `phi_rad` crosses the polygon of `ring`. No division, remainder or second function of an angle more than has
    /// to be: most of the time of a look-up would be spent here.
    #[inline]
    fn crossing(&self, ring: usize, phi_rad: f64) -> Crossing {
        let count = self.count(ring);
        let turns = phi_rad * (1.0 / TAU);
        let place = (turns - turns.floor()) * count as f64;
        let low = place as usize;
        let [half_tan, half_cos] = self.half_sides[ring];
        // Angles from the middle of the side, at whose distance from the pole the radius is least.
        let tan = ((2.0 * (place - low as f64) - 1.0) * (PI / count as f64)).tan();
        let t = 0.5 + 0.5 * tan / half_tan;
        let index = |sector: usize| self.starts[ring] + if sector < count { sector } else { sector - count };
        Crossing {
            ends: [(index(low), 1.0 - t), (index(low + 1), t)],
            radius_rad: (ring as f64 + 0.5) * self.step_rad * half_cos * (1.0 + tan * tan).sqrt(),
        }
    }

    /// The rings between which a direction lies whose circle is that far out, in steps: `None` near the pole and the horizon, where
    /// polygons are none, or too coarse.
    fn plain_rings(&self) -> std::ops::Range<usize> {
        let first = (0..self.rings()).find(|&ring| self.count(ring) >= SHORT_SIDES);
        first.unwrap_or(self.rings())..self.rings().saturating_sub(2)
    }

    /// See [`super::IncidentSet::neighbours_of_eight`].
    #[allow(clippy::inline_always)]
    #[inline(always)]
    pub(crate) fn neighbours_of_eight(&self, w: &[DVec3; LANES], lanes: &Vectors) -> NeighboursOfEight {
        let theta_rad = lanes.theta_rad();
        let circle = theta_rad * Eight::splat((1.0 / self.step_rad) as f32) - Eight::splat(0.5);
        let plain = self.plain_rings();
        let ends = [plain.start, plain.end].map(|ring| Eight::splat(ring as f32));
        let is_plain = circle.is_less(ends[1]) & !circle.is_less(ends[0]);
        let mut found = NeighboursOfEight::default();
        if !plain.is_empty() {
            let turns = lanes.x.turns(lanes.y) + Eight::splat((self.azimuth_deg / 360.0) as f32);
            let turns = turns - turns.floor();
            let one = Eight::splat(1.0);
            let ring = circle.floor().max(ends[0]).min(ends[1] - one);
            // Where the side of the ring outside lies within, it is the ring inside.
            let outer = self.crossings(ring + one, turns);
            let ring = theta_rad.where_less(outer.radius_rad, ring, ring + one);
            let (inner, outer) = (self.crossings(ring, turns), self.crossings(ring + one, turns));
            let t = (theta_rad - inner.radius_rad) / (outer.radius_rad - inner.radius_rad);
            let t = t.max(Eight::splat(0.0)).min(one);
            let s = one - t;
            found = NeighboursOfEight {
                rows: [inner.rows[0], inner.rows[1], outer.rows[0], outer.rows[1]],
                weights: [
                    (s * inner.weights[0]).to_array(),
                    (s * inner.weights[1]).to_array(),
                    (t * outer.weights[0]).to_array(),
                    (t * outer.weights[1]).to_array(),
                ],
            };
        }
        for lane in (0..LANES).filter(|&lane| is_plain >> lane & 1 == 0) {
            found.put(lane, self.neighbours(w[lane]));
        }
        found
    }

    /// As [`crossing`](Self::crossing), of eight rays; the corner with the smaller index comes first.
    #[allow(clippy::inline_always)]
    #[inline(always)]
    fn crossings(&self, ring: Eight, turns: Eight) -> Crossings {
        let mut of = [[0.0; LANES]; 5];
        for (lane, ring) in ring.whole().into_iter().enumerate() {
            for (of, x) in of.iter_mut().zip(self.at_once[ring as usize]) {
                of[lane] = x;
            }
        }
        let [count, start, half, half_over_tan, least_rad] = of;
        let [count, start] = [Eight::new(count), Eight::new(start)];
        let [half, half_over_tan] = [Eight::new(half), Eight::new(half_over_tan)];
        let place = turns * count;
        let low = place.floor();
        let one = Eight::splat(1.0);
        let tan = ((Eight::splat(2.0) * (place - low) - one) * half).tan();
        let t = Eight::splat(0.5) + tan * half_over_tan;
        let in_ring = |sector: Eight| start + sector.where_less(count, sector, sector - count);
        let (a, b) = (in_ring(low), in_ring(low + one));
        let s = one - t;
        Crossings {
            rows: [a.min(b).whole(), a.max(b).whole()],
            weights: [a.where_less(b, s, t), a.where_less(b, t, s)],
            radius_rad: Eight::new(least_rad) * (one + tan * tan).sqrt(),
        }
    }

    /// See [`super::IncidentSet::adjacent`].
    #[must_use]
    pub fn adjacent(&self, index: usize) -> Vec<usize> {
        let ring = self.ring_of(index);
        let count = self.count(ring);
        let sector = index - self.starts[ring];
        let phi_rad = TAU * sector as f64 / count as f64;
        let beside = [(sector + 1) % count, (sector + count - 1) % count].map(|s| self.starts[ring] + s);
        let above = if ring == 0 {
            self.crossing(0, phi_rad + PI)
        } else {
            self.crossing(ring - 1, phi_rad)
        };
        let below = (ring + 1 < self.rings()).then(|| self.crossing(ring + 1, phi_rad));
        let mut adjacent = beside.to_vec();
        for (end, weight) in above
            .ends
            .into_iter()
            .chain(below.into_iter().flat_map(|b| b.ends))
        {
            if weight > 1e-9 && !adjacent.contains(&end) {
                adjacent.push(end);
            }
        }
        adjacent
    }
}

/// The azimuth `phi_deg` in a frame whose +x lies at `azimuth_deg`, from 0 up to 360.
pub(super) fn turned_deg(phi_deg: f64, azimuth_deg: f64) -> f64 {
    // What is not turned stays as it was given.
    if azimuth_deg == 0.0 {
        return phi_deg;
    }
    let turned = (phi_deg - azimuth_deg).rem_euclid(360.0);
    // So little below 0 that the remainder is all of it.
    if turned < 360.0 { turned } else { 0.0 }
}

/// Linear between two crossings of a ray, for a place at `theta_rad` on it; `inner` stands at `inner_rad`.
#[inline]
fn between(inner: &Crossing, inner_rad: f64, outer: &Crossing, theta_rad: f64) -> Neighbours {
    let t = ((theta_rad - inner_rad) / (outer.radius_rad - inner_rad)).clamp(0.0, 1.0);
    let ([a, b], [c, d]) = (inner.ends, outer.ends);
    [
        (a.0, a.1 * (1.0 - t)),
        (b.0, b.1 * (1.0 - t)),
        (c.0, c.1 * t),
        (d.0, d.1 * t),
    ]
}
