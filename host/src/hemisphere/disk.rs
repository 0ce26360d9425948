//! The outgoing disk: an N × N grid that covers the hemisphere with cells of equal solid angle.
//!
//! # Design
//! Lambert's azimuthal equal-area projection, r = √2·sin(θ/2), so that r = 1 is the horizon and every cell
//! counts the same in an integral over solid angle: dω = 2 dA. The grid belongs to the BRDF, not to a
//! camera: captures by different rigs can be compared and merged cell by cell. Rows run along +y, columns
//! along +x; the centre of the first cell is at (0.5, 0.5).
//!
//! Where the frame of a sample was turned after it was measured, the cells stay and the grid lies turned in it
//! ([`Disk::turned`]): nothing is resampled, and turning back loses nothing.

use glam::{DVec2, DVec3};

/// The grid of outgoing directions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Disk {
    size: usize,
    /// Cosine and sine of the azimuth of the frame's +x on the grid.
    x: DVec2,
}

impl Disk {
    /// A grid of `size` × `size` cells.
    #[must_use]
    pub const fn new(size: usize) -> Self {
        Self { size, x: DVec2::X }
    }

    /// The same cells in a frame whose +x lies at `azimuth_deg` on this one: what was at that azimuth is at 0 there.
    #[must_use]
    pub fn turned(self, azimuth_deg: f64) -> Self {
        Self {
            x: DVec2::from_angle(azimuth_deg.to_radians()).rotate(self.x),
            ..self
        }
    }

    /// Cosine and sine of the azimuth of the frame's +x on the grid.
    pub(crate) const fn x_axis(&self) -> DVec2 {
        self.x
    }

    /// Cells along a side.
    #[must_use]
    pub const fn size(&self) -> usize {
        self.size
    }

    /// Cells in all, those beyond the horizon included.
    #[must_use]
    pub const fn len(&self) -> usize {
        self.size * self.size
    }

    /// Whether there is no cell.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.size == 0
    }

    /// Solid angle of a cell in sr.
    #[must_use]
    pub fn cell_sr(&self) -> f64 {
        2.0 * (2.0 / self.size as f64).powi(2)
    }

    /// Direction of the centre of cell `index` = `row · size + column`; `None` beyond the horizon.
    #[must_use]
    pub fn direction(&self, index: usize) -> Option<DVec3> {
        self.at(DVec2::new(
            (index % self.size) as f64 + 0.5,
            (index / self.size) as f64 + 0.5,
        ))
    }

    /// The direction at a `position` on the grid in cells, (column, row); `None` beyond the horizon.
    #[must_use]
    pub fn at(&self, position: DVec2) -> Option<DVec3> {
        let p = position / (self.size as f64 / 2.0) - 1.0;
        let rr = p.length_squared();
        // x = sin θ cos φ with sin θ = 2 sin(θ/2) cos(θ/2) = r √(2 − r²); cos θ = 1 − r².
        let p = DVec2::new(self.x.x, -self.x.y).rotate(p);
        (rr < 1.0).then(|| (p * (2.0 - rr).sqrt()).extend(1.0 - rr))
    }

    /// Place of the unit vector `w` on the grid in cells, (column, row); `None` below the horizon.
    #[must_use]
    pub fn position(&self, w: DVec3) -> Option<DVec2> {
        (w.z >= 0.0).then(|| {
            let half = self.size as f64 / 2.0;
            (self.x.rotate(w.truncate()) / (1.0 + w.z).sqrt() + 1.0) * half
        })
    }

    /// The four cells around `w` with bilinear weights that sum to 1; corners off the grid repeat its border.
    #[must_use]
    pub fn neighbours(&self, w: DVec3) -> Option<[(usize, f64); 4]> {
        Some(bilinear(self.position(w)?, self.size, self.size))
    }
}

/// The four pixels around `position` (centre of the first = 0.5) of a `width` × `height` image, row-major,
/// with bilinear weights; the border is repeated.
#[must_use]
pub fn bilinear(position: DVec2, width: usize, height: usize) -> [(usize, f64); 4] {
    let p = position - 0.5;
    let low = p.floor();
    let t = p - low;
    let clamp = |value: f64, size: usize| (value.max(0.0) as usize).min(size - 1);
    let (x0, x1) = (clamp(low.x, width), clamp(low.x + 1.0, width));
    let (y0, y1) = (clamp(low.y, height), clamp(low.y + 1.0, height));
    [
        (y0 * width + x0, (1.0 - t.x) * (1.0 - t.y)),
        (y0 * width + x1, t.x * (1.0 - t.y)),
        (y1 * width + x0, (1.0 - t.x) * t.y),
        (y1 * width + x1, t.x * t.y),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hemisphere::direction::{angle_between, from_degrees};

    #[test]
    fn direction_and_position_are_inverse() {
        let disk = Disk::new(96);
        for index in 0..disk.len() {
            let Some(w) = disk.direction(index) else { continue };
            assert!((w.length() - 1.0).abs() < 1e-12);
            let p = disk.position(w).unwrap();
            let cell = DVec2::new((index % 96) as f64 + 0.5, (index / 96) as f64 + 0.5);
            assert!((p - cell).length() < 1e-9, "{index}: {p} {cell}");
        }
        assert!(disk.position(from_degrees(91.0, 0.0)).is_none());
        let rim = disk.position(from_degrees(90.0, 0.0)).unwrap();
        assert!((rim - DVec2::new(96.0, 48.0)).length() < 1e-9);
    }

    #[test]
    fn a_turned_frame_has_the_same_cells_elsewhere() {
        let (disk, turned) = (Disk::new(32), Disk::new(32).turned(50.0).turned(-20.0));
        for index in 0..disk.len() {
            let (Some(w), Some(there)) = (disk.direction(index), turned.direction(index)) else {
                assert_eq!(turned.direction(index), None);
                continue;
            };
            let back = glam::DMat3::from_rotation_z(30_f64.to_radians()) * there;
            assert!((back - w).length() < 1e-12);
            assert!((turned.position(there).unwrap() - disk.position(w).unwrap()).length() < 1e-9);
        }
    }

    #[test]
    fn cells_have_equal_solid_angle() {
        // Sum over cells of ω·cosθ is π, of 1 is 2π, within the staircase of the rim.
        let disk = Disk::new(128);
        let cells: Vec<DVec3> = (0..disk.len()).filter_map(|i| disk.direction(i)).collect();
        let total = cells.len() as f64 * disk.cell_sr();
        assert!((total / std::f64::consts::TAU - 1.0).abs() < 2e-3, "{total}");
        let projected: f64 = cells.iter().map(|w| w.z * disk.cell_sr()).sum();
        assert!(
            (projected / std::f64::consts::PI - 1.0).abs() < 1e-3,
            "{projected}"
        );
    }

    #[test]
    fn neighbours_interpolate_direction_itself() {
        let disk = Disk::new(64);
        for (theta, phi) in [(0.0, 0.0), (10.0, 33.0), (45.0, 190.0), (80.0, 300.0)] {
            let w = from_degrees(theta, phi);
            let mean: DVec3 = disk
                .neighbours(w)
                .unwrap()
                .iter()
                .map(|&(i, t)| t * disk.direction(i).unwrap())
                .sum();
            assert!(angle_between(mean.normalize(), w) < 1e-3);
        }
    }
}
