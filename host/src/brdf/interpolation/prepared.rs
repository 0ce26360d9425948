//! What queries ask, whichever images there are: eight of them are prepared at once.

use glam::{DVec3, Vec4};

use super::Blend;
use super::blend::{BACK, BRANCHES};
use super::lanes::{FOUR, Side};
use super::rule::Captured;
use crate::base::eight::{LANES, Vectors};
use crate::hemisphere::incident::{IncidentSet, NeighboursOfEight};

/// Pairs of directions (incident, outgoing), all above the horizon.
pub(crate) type Pairs = [(DVec3, DVec3); LANES];

/// Eight of one to eight.
pub(crate) fn filled(pairs: &[(DVec3, DVec3)]) -> Pairs {
    let mut eight = [pairs[0]; LANES];
    eight[..pairs.len()].copy_from_slice(pairs);
    eight
}

/// Rows and weights of the images in a lane.
#[allow(clippy::inline_always)]
#[inline(always)]
pub(super) fn of_lane(neighbours: &NeighboursOfEight, lane: usize) -> ([u32; FOUR], [f32; FOUR]) {
    let ([a, b, c, d], [e, f, g, h]) = (&neighbours.rows, &neighbours.weights);
    (
        [a[lane], b[lane], c[lane], d[lane]],
        [e[lane], f[lane], g[lane], h[lane]],
    )
}

/// One side of a query.
#[allow(clippy::inline_always)]
#[inline(always)]
pub(super) fn side<'a>(
    (wi, wo): (DVec3, DVec3),
    captured: &'a [Captured],
    ([a, b, c, d], weights): ([u32; FOUR], [f32; FOUR]),
    shares: &'a [f32; BACK],
    is_back: bool,
) -> Side<'a> {
    let of = |row: u32| &captured[row as usize];
    Side {
        wi: wi.as_vec3(),
        wo: wo.as_vec3(),
        captured: [of(a), of(b), of(c), of(d)],
        weights: Vec4::from_array(weights),
        shares,
        is_back,
    }
}

/// What eight pairs ask of the images, whichever they are.
pub(super) struct Prepared<'a> {
    pairs: &'a Pairs,
    directions: [[DVec3; LANES]; 2],
    lanes: [Vectors; 2],
    shares: [[f32; BRANCHES]; LANES],
}

#[allow(clippy::inline_always)]
impl<'a> Prepared<'a> {
    #[inline(always)]
    pub(super) fn new(blend: &Blend, pairs: &'a Pairs) -> Self {
        let directions = [pairs.map(|pair| pair.0), pairs.map(|pair| pair.1)];
        let lanes = [Vectors::of(&directions[0]), Vectors::of(&directions[1])];
        Self {
            pairs,
            shares: blend.shares(&lanes[0], &lanes[1]),
            directions,
            lanes,
        }
    }

    /// The images around the direction that is asked as the incident one. In the order of the indices, in which a file hands images out:
    /// however many at a time, sums are the same.
    #[inline(always)]
    pub(super) fn neighbours(&self, set: &IncidentSet, is_back: bool) -> NeighboursOfEight {
        let at = usize::from(is_back);
        set.neighbours_of_eight(&self.directions[at], &self.lanes[at])
    }

    /// How much each rule counts on a side.
    #[inline(always)]
    pub(super) fn side(&self, lane: usize, is_back: bool) -> &[f32; BACK] {
        let (forth, back) = self.shares[lane]
            .split_first_chunk()
            .expect("invariant: both have as many");
        if is_back {
            back.first_chunk().expect("invariant: both have as many")
        } else {
            forth
        }
    }

    /// The pair as images on a side are asked.
    #[inline(always)]
    pub(super) fn pair(&self, lane: usize, is_back: bool) -> (DVec3, DVec3) {
        let (wi, wo) = self.pairs[lane];
        if is_back { (wo, wi) } else { (wi, wo) }
    }
}
