//! Whether a wire that was fitted is the one that is seen.
//!
//! # Design
//! An edge counts for the nearest one of hole, rim and wire. Both edges of a wire are so near to each other that a fit may rest where each that
//! is seen counts for the other one: the wire stands aside by its own width then, and no derivative shows it. So all places near by are
//! asked how far edges pass by in all, where what is far from every edge counts as far as [`CLEAR`] scales.

use crate::instrument::optics::View;
use crate::instrument::rig::Rig;

use super::sightings::Sightings;

/// What is asked on both sides: so many half widths, in so many steps of each.
const HALF_WIDTHS: i32 = 4;
const STEPS: i32 = 4;
/// Scales of the residuals beyond which an edge is none of what is there.
const CLEAR: f64 = 4.0;
/// By so much the sum of squares over the scale's has to be less elsewhere.
const BETTER: f64 = 12.0;

/// The azimuth in degrees at which the wire of `rig` is where the edges are that were `seen`, whose residuals have the scale
/// `scale_rad`; `None` where it is there.
pub(super) fn better_deg(rig: &Rig, seen: &Sightings, scale_rad: f64) -> Option<f64> {
    let wire = rig.wire.as_ref()?;
    let missed = |by_deg: f64| {
        let mut moved = rig.clone();
        if let Some(wire) = &mut moved.wire {
            wire.azimuth_deg += by_deg;
        }
        let camera = View::camera(&moved);
        let of_edge = |at: &glam::DVec2| {
            let distances = camera.edge_distances_rad(at.x, at.y).into_iter().flatten();
            let nearest = distances.map(f64::abs).fold(f64::INFINITY, f64::min);
            (nearest / scale_rad).min(CLEAR).powi(2)
        };
        seen.edges_px.iter().map(of_edge).sum::<f64>()
    };
    let here = missed(0.0);
    let (by_deg, least) = (-HALF_WIDTHS * STEPS..=HALF_WIDTHS * STEPS)
        .map(|step| f64::from(step) / f64::from(STEPS) * wire.half_width_deg)
        .map(|by_deg| (by_deg, missed(by_deg)))
        .min_by(|(_, a), (_, b)| a.total_cmp(b))?;
    tracing::debug!(here, least, by_deg, "wire beside where it was fitted");
    (by_deg.abs() > wire.half_width_deg && least < here - BETTER).then_some(wire.azimuth_deg + by_deg)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hemisphere::direction::from_degrees;

    #[test]
    fn a_wire_that_stands_aside_by_its_width_is_told_where_its_edges_are() {
        let rig = Rig::load("rcg-1-16bit").unwrap().with_image_size(96).unwrap();
        let wire = rig.wire.clone().unwrap();
        // What is seen has no wire before it.
        let bare = Rig {
            wire: None,
            ..rig.clone()
        };
        let camera = View::camera(&bare);
        let edges_px = (0..40)
            .flat_map(|at| {
                [-1.0, 1.0].map(|side| {
                    let azimuth_deg = wire.azimuth_deg + side * wire.half_width_deg;
                    camera.pixel(from_degrees(35.0 + f64::from(at), azimuth_deg))
                })
            })
            .flatten()
            .collect();
        let seen = Sightings {
            edges_px,
            ..Sightings::default()
        };
        let scale_rad = 0.15_f64.to_radians();
        assert_eq!(better_deg(&rig, &seen, scale_rad), None);
        for by_deg in [-1.2, 1.2] {
            let mut aside = rig.clone();
            aside.wire.as_mut().unwrap().azimuth_deg += by_deg;
            let found_deg = better_deg(&aside, &seen, scale_rad).unwrap();
            assert!(
                (found_deg - wire.azimuth_deg).abs() < 0.2,
                "{by_deg}: {found_deg}"
            );
        }
    }
}
