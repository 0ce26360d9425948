//! What an edge of hole, rim or wire may cut, when calibration knows where the edges are only so well.
//!
//! # Design
//! By the rig file a pixel whose centre is clear of an edge is whole. A calibrated edge is known to a standard uncertainty u.
//! What is closer to it than [`CLEAR`]·u may be dark in truth, and nothing is assembled of it: neither camera pixels, nor
//! spots with such a centre. Of a spot that an edge crosses farther out, a shift of the edge by u changes the lit area by
//! chord × u: relative to the area of the spot of diameter D, (4/π)·(u/D)·√(1 − (2d/D)²) for an edge at distance d from its
//! centre, which goes into the standard uncertainty of that incident direction.

use glam::DVec3;

use crate::optics::{Unmeasurable, View};
use crate::plan::{Directions, Plan};
use crate::rig::Rig;

/// So many standard uncertainties from an edge there is light.
const CLEAR: f64 = 3.0;

/// Edges that are known to a standard uncertainty.
pub(super) struct Edges {
    edge_rad: f64,
}

impl Edges {
    /// Edges known to `edge_deg` degrees (k = 1); 0 stands for just where the rig file has them.
    pub(super) fn new(edge_deg: f64) -> Self {
        Self {
            edge_rad: edge_deg.to_radians(),
        }
    }

    /// Whether an edge may hide the spot of light from `w`, or the `projector` does not reach it.
    pub(super) fn may_hide_light(&self, projector: &View, w: DVec3) -> bool {
        projector
            .pixel(w)
            .map_or(true, |at| self.may_hide(nearest_rad(projector, at.x, at.y)))
    }

    /// For each pixel of the `camera`, row by row, why a part of it may not see the sample; `None` where all of it does.
    pub(super) fn cut_pixels(&self, camera: &View) -> Vec<Option<Unmeasurable>> {
        camera.cut_pixels(CLEAR * self.edge_rad)
    }

    /// For each incident direction of `directions`, the relative variance of its light by edges; infinite where they may
    /// hide it.
    pub(super) fn light_relative2(&self, rig: &Rig, plan: &Plan, directions: &Directions) -> Vec<f32> {
        let projector = View::projector(rig);
        let spot_rad = plan.spot_deg.to_radians();
        let relative2 = |w: DVec3| {
            let Ok(at) = projector.pixel(w) else { return 0.0 };
            let nearest_rad = nearest_rad(&projector, at.x, at.y);
            if self.may_hide(nearest_rad) {
                return f32::INFINITY;
            }
            let half_chord2 = 1.0 - (2.0 * nearest_rad / spot_rad).powi(2);
            let per_spot = 4.0 / std::f64::consts::PI * self.edge_rad / spot_rad;
            (per_spot * per_spot * half_chord2.max(0.0)) as f32
        };
        (0..directions.grid.len())
            .map(|index| relative2(directions.grid.direction(index)))
            .collect()
    }

    fn may_hide(&self, nearest_rad: f64) -> bool {
        nearest_rad < CLEAR * self.edge_rad
    }
}

/// Distance of a position to the nearest edge, radians; infinite without edges.
fn nearest_rad(view: &View, u_px: f64, v_px: f64) -> f64 {
    let distances = view.edge_distances_rad(u_px, v_px);
    distances
        .into_iter()
        .flatten()
        .map(f64::abs)
        .fold(f64::INFINITY, f64::min)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::direction::from_degrees;

    #[test]
    fn what_is_near_an_edge_is_left_out_and_what_it_may_cut_is_uncertain() {
        let rig = Rig::load("rcg-1").unwrap();
        let view = View::projector(&rig);
        let distance_deg = |theta_deg: f64| {
            let at = view.pixel(from_degrees(theta_deg, 45.0)).unwrap();
            nearest_rad(&view, at.x, at.y).to_degrees()
        };
        // The hole ends at 27°.
        assert!((distance_deg(27.2) - 0.2).abs() < 1e-6 && (distance_deg(28.5) - 1.5).abs() < 1e-6);

        let camera = View::camera(&rig.with_image_size(96).unwrap());
        let whole = Edges::new(0.0).cut_pixels(&camera);
        let count = |edge_deg: f64| {
            let hidden = Edges::new(edge_deg).cut_pixels(&camera);
            let seen = |at: &usize| whole[*at].is_none() && hidden[*at].is_some();
            (0..hidden.len()).filter(seen).count()
        };
        // Pixels are some 1.8° wide: of those that see the sample few are within 0.3° of an edge, more within 1.2°.
        let (few, more) = (count(0.1), count(0.4));
        assert_eq!(count(0.0), 0);
        assert!(few > 10 && more > 2 * few && more < 1000, "{few} {more}");
    }
}
