//! Regions of direction pairs, in each of which the same interpolation does best.

use glam::DVec3;

use crate::base::eight::{Eight, LANES, Vectors};

/// Regions along θi, θo and the angle θh of the half vector.
const COUNTS: [usize; 3] = [6, 6, 7];
/// Number of regions.
pub const REGIONS: usize = COUNTS[0] * COUNTS[1] * COUNTS[2];

/// The regions around a pair of directions, with weights that sum to 1.
pub type Regions = [(usize, f32); 8];

/// Place of a pair along the three axes, in regions.
///
/// θi and θo tell how near the horizon is; θh tells a highlight (small) from the rest, so that its axis is finer there:
/// θh = 90°·(u/7)².
#[inline]
fn place(wi: DVec3, wo: DVec3) -> [f64; 3] {
    let share = |z: f64| z.clamp(0.0, 1.0).acos() / std::f64::consts::FRAC_PI_2;
    let half = (wi + wo).normalize_or(DVec3::Z);
    let [i, o, h] = COUNTS;
    [
        share(wi.z) * i as f64,
        share(wo.z) * o as f64,
        share(half.z).sqrt() * h as f64,
    ]
}

#[inline]
const fn index([i, o, h]: [usize; 3]) -> usize {
    (i * COUNTS[1] + o) * COUNTS[2] + h
}

/// The region that the pair (`wi`, `wo`) lies in.
pub(super) fn region(wi: DVec3, wo: DVec3) -> usize {
    let place = place(wi, wo);
    index(std::array::from_fn(|axis| {
        (place[axis] as usize).min(COUNTS[axis] - 1)
    }))
}

/// The regions whose centres are around the pair (`wi`, `wo`), with trilinear weights.
#[inline]
pub(super) fn around(wi: DVec3, wo: DVec3) -> Regions {
    let place = place(wi, wo);
    // Along each axis the two regions, and the weight of the second.
    let mut ends = [[0; 2]; 3];
    let mut shares = [0.0; 3];
    let axes = ends.iter_mut().zip(&mut shares);
    for ((ends, share), (place, count)) in axes.zip(place.into_iter().zip(COUNTS)) {
        let low = (place - 0.5).floor();
        *ends = [low, low + 1.0].map(|end| (end.max(0.0) as usize).min(count - 1));
        *share = place - 0.5 - low;
    }
    let mut regions = [(0, 0.0); 8];
    for (corner, region) in regions.iter_mut().enumerate() {
        let up = [corner & 1, corner >> 1 & 1, corner >> 2 & 1];
        let mut weight = 1.0;
        for (up, share) in up.into_iter().zip(shares) {
            weight *= if up == 1 { share } else { 1.0 - share };
        }
        let [i, o, h] = ends;
        *region = (index([i[up[0]], o[up[1]], h[up[2]]]), weight as f32);
    }
    regions
}

/// Where eight pairs lie between the centres of regions: along each axis the region below and the share of the one above, in each lane.
pub(super) struct Between {
    low: [[f32; LANES]; 3],
    share: [[f32; LANES]; 3],
}

// Inlined whatever the compiler thinks of it: a function of its own would not be compiled for the processor that is there.
#[allow(clippy::inline_always)]
impl Between {
    /// As [`around`], of eight pairs (`wi`, `wo`) above the horizon.
    #[inline(always)]
    pub(super) fn of(wi: &Vectors, wo: &Vectors) -> Self {
        let half = Vectors {
            x: wi.x + wo.x,
            y: wi.y + wo.y,
            z: wi.z + wo.z,
        };
        let quarters = |w: &Vectors| w.theta_rad() * Eight::splat(std::f32::consts::FRAC_2_PI);
        let quarters = [quarters(wi), quarters(wo), quarters(&half).sqrt()];
        let mut found = Self {
            low: [[0.0; LANES]; 3],
            share: [[0.0; LANES]; 3],
        };
        for axis in 0..3 {
            let place = quarters[axis] * Eight::splat(COUNTS[axis] as f32) - Eight::splat(0.5);
            let low = place.floor();
            found.low[axis] = low.to_array();
            found.share[axis] = (place - low).to_array();
        }
        found
    }

    /// The regions around the pair in `lane`, with trilinear weights.
    #[inline(always)]
    pub(super) fn regions(&self, lane: usize) -> Regions {
        let (mut ends, mut shares) = ([[0; 2]; 3], [[0.0; 2]; 3]);
        for axis in 0..3 {
            let (low, share) = (self.low[axis][lane] as i32, self.share[axis][lane]);
            let last = COUNTS[axis] as i32 - 1;
            ends[axis] = [low.max(0) as usize, (low + 1).min(last) as usize];
            shares[axis] = [1.0 - share, share];
        }
        let mut regions = [(0, 0.0); 8];
        for (corner, region) in regions.iter_mut().enumerate() {
            let [i, o, h] = [corner & 1, corner >> 1 & 1, corner >> 2 & 1];
            let weight = shares[0][i] * shares[1][o] * shares[2][h];
            *region = (index([ends[0][i], ends[1][o], ends[2][h]]), weight);
        }
        regions
    }
}

/// Groups of regions, coarser and coarser, in which to look for what is known if nothing is known of region `region`:
/// without θo, then without θi too, then everything.
pub(super) fn wider(region: usize) -> [usize; 3] {
    let (i, h) = (region / COUNTS[2] / COUNTS[1], region % COUNTS[2]);
    let (by_incident, by_half) = (COUNTS[0] * COUNTS[2], COUNTS[2]);
    [i * COUNTS[2] + h, by_incident + h, by_incident + by_half]
}

/// Number of such groups.
pub(super) const WIDER: usize = COUNTS[0] * COUNTS[2] + COUNTS[2] + 1;
