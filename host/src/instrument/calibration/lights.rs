//! The incident directions with which the standard is lit.
//!
//! # Design
//! Rings of [`SECTORS`] directions at [`RINGS_DEG`]. A sample that stands a little beside the focus is missed at the last of
//! them first; they are closer there, and what lies between a ring that is lit and one that is not is lost.

use glam::DVec3;

use crate::hemisphere::direction::{from_degrees, to_degrees};
use crate::instrument::optics::View;
use crate::instrument::rig::Rig;

/// θ of the rings, degrees.
pub(crate) const RINGS_DEG: [f64; 11] = [5.0, 15.0, 25.0, 35.0, 45.0, 55.0, 65.0, 75.0, 80.0, 85.0, 89.0];
/// Directions of a ring, the first at φ = 0.
pub(crate) const SECTORS: usize = 36;
/// All directions.
pub(crate) const LIGHTS: usize = RINGS_DEG.len() * SECTORS;

/// Angles (θ, φ) of a direction, degrees.
pub(crate) fn angles_deg(index: usize) -> (f64, f64) {
    let sector_deg = 360.0 / SECTORS as f64;
    (RINGS_DEG[index / SECTORS], (index % SECTORS) as f64 * sector_deg)
}

/// A direction, unit, away from the surface.
pub(crate) fn direction(index: usize) -> DVec3 {
    let (theta_deg, phi_deg) = angles_deg(index);
    from_degrees(theta_deg, phi_deg)
}

/// Indices of the directions that the projector of `rig` can light, ascending.
pub(crate) fn measurable(rig: &Rig) -> Vec<usize> {
    let projector = View::projector(rig);
    (0..LIGHTS)
        .filter(|index| projector.pixel(direction(*index)).is_ok())
        .collect()
}

/// The directions at the corners of the cell of rings and sectors that `w` lies in.
pub(crate) fn corners(w: DVec3) -> [usize; 4] {
    let (theta_deg, phi_deg) = to_degrees(w);
    let place = phi_deg * SECTORS as f64 / 360.0;
    let sectors = [place as usize % SECTORS, (place as usize + 1) % SECTORS];
    let outer = RINGS_DEG.iter().position(|ring_deg| *ring_deg >= theta_deg);
    let last = RINGS_DEG.len() - 1;
    let (inner, outer) = outer.map_or((last, last), |outer| (outer.saturating_sub(1), outer));
    [inner, outer]
        .map(|ring| sectors.map(|sector| ring * SECTORS + sector))
        .as_flattened()
        .try_into()
        .expect("invariant: two by two")
}

/// The directions of the cell that `w` lies in and of those around it.
pub(crate) fn around(w: DVec3) -> Vec<usize> {
    let [first, _, _, last] = corners(w);
    let rings = (first / SECTORS).saturating_sub(1)..=(last / SECTORS + 1).min(RINGS_DEG.len() - 1);
    let sectors = |ring: usize| {
        (0..4).map(move |step| ring * SECTORS + (first % SECTORS + SECTORS - 1 + step) % SECTORS)
    };
    rings.flat_map(sectors).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hemisphere::direction::angle_between;

    #[test]
    fn a_direction_lies_between_the_corners_of_its_cell() {
        for theta_deg in [0.0, 3.0, 5.0, 44.0, 78.0, 86.0, 89.0, 90.0] {
            for phi_deg in [0.0, 0.1, 9.9, 10.0, 181.0, 355.0, 359.99] {
                let w = from_degrees(theta_deg, phi_deg);
                let corners = corners(w).map(direction);
                let reach = corners
                    .iter()
                    .map(|corner| angle_between(*corner, w).to_degrees());
                assert!(reach.fold(0.0, f64::max) < 14.2, "{theta_deg} {phi_deg}");
                let mean_deg = corners.iter().map(|corner| to_degrees(*corner).0).sum::<f64>() / 4.0;
                assert!((mean_deg - theta_deg).abs() <= 5.0, "{theta_deg} {phi_deg}");
            }
        }
        assert_eq!(
            corners(from_degrees(87.0, 355.0)),
            [9 * 36 + 35, 9 * 36, 10 * 36 + 35, 10 * 36]
        );
    }
}
