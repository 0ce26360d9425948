//! Where the standard was seen and lit: only there has light and throughput been measured.
//!
//! # Design
//! A camera beside its focus looks past the sample at grazing directions, and so does the projector: there is no signal of
//! the standard, and there will be none of a sample. What was seen is kept as a picture of the camera's image and one of
//! the incident directions, one character for each ([`SEEN`], [`UNSEEN`], [`EDGE`], [`BLIND`]), stand by stand.
//!
//! A pixel of a measurement, of whatever size, counts as on the sample if the standard was seen all over it, and none of the
//! pixels of the picture beside it is dark; an incident direction, if none of the corners of its cell is, nor, where nothing is
//! said of a corner, one beside them. So what lies between light and darkness, and may be on the sample in part, is left out.

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::lights::{RINGS_DEG, SECTORS, around, corners};
use crate::instrument::rig::Tilt;

/// The standard was seen as bright as it should be.
pub(crate) const SEEN: u8 = b'#';
/// It should have been seen and was not, or in part.
pub(crate) const UNSEEN: u8 = b'.';
/// An edge of the mirror or the wire is so near that nothing is said.
pub(crate) const EDGE: u8 = b'|';
/// By the rig nothing is seen there.
pub(crate) const BLIND: u8 = b' ';

/// In cells that reach beyond this θ, in degrees, the standard has to have been lit at each corner.
const STRICT_DEG: f64 = 80.0;

/// What was seen of the standard as it stood.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Sight {
    /// Its tilt, if it was tilted.
    pub(crate) tilt: Option<Tilt>,
    /// Rows of the camera's image as captured, a character for each pixel.
    pub(crate) camera: Vec<String>,
    /// Rings of incident directions, a character for each direction.
    pub(crate) incident: Vec<String>,
}

impl Sight {
    pub(crate) fn new(tilt: Option<Tilt>, camera: &[u8], width_px: usize, incident: &[u8]) -> Self {
        let rows = |all: &[u8], width: usize| {
            all.chunks(width)
                .map(|row| String::from_utf8_lossy(row).into_owned())
                .collect()
        };
        Self {
            tilt,
            camera: rows(camera, width_px),
            incident: rows(incident, SECTORS),
        }
    }

    /// What is wrong with it: the field, and what was expected.
    pub(crate) fn flaw(&self) -> Option<(&'static str, String)> {
        let known = |rows: &[String]| {
            let mut all = rows.iter().flat_map(|row| row.bytes());
            all.all(|one| [SEEN, UNSEEN, EDGE, BLIND].contains(&one))
        };
        let width = self.camera.first().map_or(0, String::len);
        let is_image = width > 0 && self.camera.iter().all(|row| row.len() == width) && known(&self.camera);
        let is_grid = self.incident.len() == RINGS_DEG.len()
            && self.incident.iter().all(|row| row.len() == SECTORS)
            && known(&self.incident);
        match (is_image, is_grid) {
            (false, _) => Some((
                "camera",
                "rows of one length of the characters # . | and blank".to_owned(),
            )),
            (_, false) => Some((
                "incident",
                format!(
                    "{} rows of {SECTORS} of the characters # . | and blank",
                    RINGS_DEG.len()
                ),
            )),
            _ => None,
        }
    }

    /// For each pixel of an image of `width_px` × `height_px` pixels, row by row, whether it is on the sample.
    #[must_use]
    pub fn pixels(&self, width_px: usize, height_px: usize) -> Vec<bool> {
        let rows: Vec<&[u8]> = self.camera.iter().map(String::as_bytes).collect();
        let columns = rows.first().map_or(0, |row| row.len());
        // Pixels of the picture whose centres are within a pixel of its own of the area of pixel `index` of `size`.
        let beside = |index: usize, size: usize, of: usize| {
            let scale = of as f64 / size as f64;
            let low = (index as f64 * scale - 1.5).ceil().max(0.0) as usize;
            let high = ((index + 1) as f64 * scale + 0.5).floor() as usize;
            low..(high + 1).min(of)
        };
        // Those that it covers, wholly or in part. Of a pixel of the picture that counts as seen a part may be dark still,
        // which could be all of a finer pixel: that one needs those beside it too.
        let own = |index: usize, size: usize, of: usize| {
            if of < size {
                return beside(index, size, of);
            }
            index * of / size..((index + 1) * of).div_ceil(size)
        };
        (0..width_px * height_px)
            .map(|index| {
                let (x, y) = (index % width_px, index / width_px);
                let clear = beside(y, height_px, rows.len()).all(|row| {
                    let mut around = beside(x, width_px, columns);
                    around.all(|column| rows[row][column] != UNSEEN)
                });
                let columns = own(x, width_px, columns);
                clear
                    && own(y, height_px, rows.len()).all(|row| {
                        let mut all = rows[row][columns.clone()].iter();
                        all.all(|one| *one == SEEN)
                    })
            })
            .collect()
    }

    /// Whether light from `w` fell on the whole standard.
    #[must_use]
    pub fn is_lit(&self, w: DVec3) -> bool {
        let at = |index: usize| self.incident[index / SECTORS].as_bytes()[index % SECTORS];
        let cell = corners(w);
        let corners = cell.map(at);
        if corners.iter().all(|one| *one == SEEN) {
            return true;
        }
        // Towards the horizon the sample is missed first, and nobody says where.
        let outermost = cell.into_iter().map(|corner| RINGS_DEG[corner / SECTORS]);
        if outermost.fold(0.0, f64::max) > STRICT_DEG {
            return false;
        }
        // For a corner at which nothing is said those beside the cell speak.
        let beside: Vec<u8> = around(w).into_iter().map(at).collect();
        !beside.contains(&UNSEEN)
            && corners.iter().any(|one| matches!(*one, SEEN | EDGE))
            && beside.contains(&SEEN)
    }
}

#[cfg(test)]
mod tests {
    use super::super::lights::LIGHTS;
    use super::*;
    use crate::hemisphere::direction::from_degrees;

    #[test]
    fn pixels_beside_darkness_are_off_the_sample_at_every_size() {
        // Dark from column 20 of 32 on.
        let row: Vec<u8> = (0..32).map(|x| if x < 20 { SEEN } else { UNSEEN }).collect();
        let sight = Sight::new(None, &row.repeat(32), 32, &vec![SEEN; LIGHTS]);
        assert_eq!(sight.flaw(), None);
        for size in [7, 16, 32, 50, 96, 128] {
            let pixels = sight.pixels(size, size);
            for x in 0..size {
                // The border is between the centres of columns 19 and 20.
                let (left, right) = (x as f64 * 32.0 / size as f64, (x + 1) as f64 * 32.0 / size as f64);
                let on = pixels[3 * size + x];
                assert!(!on || right < 20.0, "{size}: {x} is not clear of the border");
                assert!(on || right > 18.0, "{size}: {x} is clear of the border: {left}");
            }
        }
        let blind = Sight::new(None, &[BLIND; 64], 8, &vec![BLIND; LIGHTS]);
        assert!(blind.pixels(8, 8).iter().all(|on| !on));
        assert!(!blind.is_lit(from_degrees(40.0, 3.0)));
    }

    #[test]
    fn a_direction_beside_darkness_is_not_lit() {
        let mut incident = vec![SEEN; LIGHTS];
        incident[7 * SECTORS + 3] = UNSEEN; // 75°, 30°
        let sight = Sight::new(None, &[SEEN], 1, &incident);
        for theta_deg in [30.0, 64.0, 66.0, 74.0, 76.0, 84.0, 86.0, 90.0] {
            for phi_deg in [5.0, 19.0, 21.0, 29.0, 31.0, 39.0, 41.0, 200.0] {
                let near = (65.0..80.0).contains(&theta_deg) && (20.0..40.0).contains(&phi_deg);
                assert_eq!(
                    sight.is_lit(from_degrees(theta_deg, phi_deg)),
                    !near,
                    "{theta_deg} {phi_deg}"
                );
            }
        }
    }

    #[test]
    fn where_nothing_is_said_of_a_corner_those_beside_it_speak() {
        // On the ring of 85° nothing is said below 120°, and it is dark above.
        let mut incident = vec![SEEN; LIGHTS];
        incident[9 * SECTORS..9 * SECTORS + 12].fill(BLIND);
        incident[9 * SECTORS + 12] = EDGE;
        incident[9 * SECTORS + 13..9 * SECTORS + 20].fill(UNSEEN);
        let sight = Sight::new(None, &[SEEN], 1, &incident);
        for phi_deg in [111.0, 119.999_999_9, 120.0, 121.0, 140.0] {
            assert!(!sight.is_lit(from_degrees(82.5, phi_deg)), "{phi_deg}");
        }
        // Beside a hole in what is said, with light all around, there is light.
        let mut incident = vec![SEEN; LIGHTS];
        incident[3 * SECTORS + 5] = BLIND;
        incident[3 * SECTORS + 6] = EDGE;
        let sight = Sight::new(None, &[SEEN], 1, &incident);
        for theta_deg in [26.0, 34.0, 36.0, 44.0] {
            assert!(sight.is_lit(from_degrees(theta_deg, 55.0)), "{theta_deg}");
        }
    }
}
