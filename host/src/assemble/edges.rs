//! What an edge of hole, rim or wire may cut, when calibration knows where the edges are only so well.
//!
//! # Design
//! A calibrated edge is known to a standard uncertainty u. What is closer to it than [`CLEAR`]·u may be dark in truth, and
//! nothing is assembled of it: neither camera pixels, nor spots of light, any part of which is that close. By the rig file
//! alone (u = 0) edges are where they are, and the light of a spot is that of its pixels that are not behind one.

use glam::DVec3;

use crate::instrument::optics::{Unmeasurable, View};

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

    /// Which edge may hide a part of the spot of `spot_deg` degrees from `w`, if any may.
    pub(super) fn cuts_light(&self, projector: &View, spot_deg: f64, w: DVec3) -> Option<Unmeasurable> {
        if self.edge_rad <= 0.0 {
            return None;
        }
        let at = projector.pixel(w).ok()?;
        let clearance_rad = spot_deg.to_radians() / 2.0 + CLEAR * self.edge_rad;
        projector.edge_within(at.x, at.y, clearance_rad)
    }

    /// For each pixel of the `camera`, row by row, why a part of it may not see the sample; `None` where all of it does.
    pub(super) fn cut_pixels(&self, camera: &View) -> Vec<Option<Unmeasurable>> {
        camera.cut_pixels(CLEAR * self.edge_rad)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hemisphere::direction::from_degrees;
    use crate::instrument::rig::Rig;

    #[test]
    fn what_an_edge_may_cut_is_left_out() {
        let rig = Rig::load("rcg-1-16bit").unwrap();
        let view = View::projector(&rig);
        // The hole ends at 27°, and half a spot is 0.5° wide.
        for (theta_deg, edge_deg, is_cut) in [
            (27.2, 0.0, false),
            (27.6, 0.1, true),
            (27.9, 0.1, false),
            (28.5, 0.3, false),
            (28.5, 0.4, true),
        ] {
            let found = Edges::new(edge_deg).cuts_light(&view, 1.0, from_degrees(theta_deg, 45.0));
            assert_eq!(
                found,
                is_cut.then_some(Unmeasurable::Hole),
                "{theta_deg} {edge_deg}"
            );
        }

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
