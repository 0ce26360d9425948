//! Where hole, rim, wire, horizon and lit spot should be in the camera's image, and how far from there they are seen.
//!
//! # Design
//! An edge is the zero of how far rays pass it ([`View::edge_distances_rad`]), found in the squares of a grid over the image; the
//! horizon of the sample is that of the height of its directions. Across each piece the brightness of the frame is followed: where it
//! steps from light to dark, the edge is seen. The distance is positive where it is seen farther inside of what is lit. What makes no clear step
//! in most places is told as not seen.

use glam::{DVec2, DVec3};
use serde::Serialize;

use crate::base::median::median;
use crate::hemisphere::direction::from_degrees;
use crate::instrument::optics::{View, reflect};

/// Squares along each side of the image.
const SQUARES: u32 = 80;
/// How far beside its place an edge is looked for, as a share of the image's width.
const REACH: f64 = 0.09;
/// A step counts from this share of the frame's range on, between the means of so many pixels on both sides.
const CLEAR: f32 = 0.2;
const BESIDE_PX: usize = 3;
/// An edge is seen where so many of its pieces, and this share of them, show a step.
const FEWEST: usize = 12;
const SEEN: f64 = 0.4;

/// An outline that is expected, and what is seen of it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Outline {
    /// hole, rim, wire, horizon or spot.
    pub name: &'static str,
    /// Pieces of it: two positions each, pixels of the frame.
    pub pieces_px: Vec<[[f64; 2]; 2]>,
    /// How far from there it is seen; `None` if it is not.
    pub seen: Option<Seen>,
}

/// How far from where it is expected something is seen.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Seen {
    /// RMS distance over the pieces, pixels.
    pub distance_px: f64,
    /// The shift that explains most of it (to the right, down), pixels.
    pub shift_px: [f64; 2],
    /// Pieces that show it.
    pub pieces: usize,
}

/// A frame to look for edges in.
#[derive(Clone, Copy)]
pub(super) struct Brightness<'a> {
    pub(super) light: &'a [f32],
    pub(super) width_px: usize,
}

/// The edges that the `camera` should see, and where they are in the frame, if there is one.
pub(super) fn edges(camera: &View, frame: Option<Brightness>) -> Vec<Outline> {
    let (width, height) = camera.size_px();
    let grid = Grid::of(camera, width, height);
    ["hole", "rim", "wire", "horizon"]
        .into_iter()
        .enumerate()
        .map(|(edge, name)| {
            let pieces = grid.pieces(edge);
            Outline {
                name,
                seen: frame.and_then(|frame| seen(&pieces, frame)),
                pieces_px: pieces
                    .iter()
                    .map(|piece| piece.ends.map(|at| at.to_array()))
                    .collect(),
            }
        })
        .filter(|outline| !outline.pieces_px.is_empty())
        .collect()
}

/// A piece of an edge, and the unit direction to its lit side.
struct Piece {
    ends: [DVec2; 2],
    inwards: DVec2,
}

/// How far the rays at the corners of a grid pass each edge: hole, rim, wire, horizon.
struct Grid {
    square_px: DVec2,
    corners: Vec<[Option<f64>; 4]>,
}

impl Grid {
    fn of(camera: &View, width: usize, height: usize) -> Self {
        let square_px = DVec2::new(width as f64, height as f64) / f64::from(SQUARES);
        let corner = |at: u32| {
            let at = DVec2::new(f64::from(at % (SQUARES + 1)), f64::from(at / (SQUARES + 1))) * square_px;
            let [hole, rim, wire] = camera.edge_distances_rad(at.x, at.y);
            [hole, rim, wire, camera.sight(at.x, at.y).map(|w| w.z)]
        };
        Self {
            square_px,
            corners: (0..(SQUARES + 1).pow(2)).map(corner).collect(),
        }
    }

    /// The pieces of an edge that no other hides.
    fn pieces(&self, edge: usize) -> Vec<Piece> {
        let mut found = Vec::new();
        for square in 0..SQUARES * SQUARES {
            let (column, row) = (square % SQUARES, square / SQUARES);
            let places = [(0, 0), (1, 0), (1, 1), (0, 1)].map(|(x, y)| (column + x, row + y));
            let corners = places.map(|(x, y)| &self.corners[(y * (SQUARES + 1) + x) as usize]);
            let [Some(a), Some(b), Some(c), Some(d)] = corners.map(|corner| corner[edge]) else {
                continue;
            };
            let is_hidden = (0..4).any(|other| {
                other != edge
                    && corners
                        .iter()
                        .any(|corner| corner[other].is_some_and(|rad| rad < -1e-3))
            });
            let values = [a, b, c, d];
            if is_hidden
                || values.iter().all(|value| *value >= 0.0)
                || values.iter().all(|value| *value < 0.0)
            {
                continue;
            }
            let at = places.map(|(x, y)| DVec2::new(f64::from(x), f64::from(y)) * self.square_px);
            let crossings = (0..4).filter_map(|side| {
                let next = (side + 1) % 4;
                let (one, other) = (values[side], values[next]);
                ((one < 0.0) != (other < 0.0)).then(|| at[side].lerp(at[next], one / (one - other)))
            });
            let crossings: Vec<DVec2> = crossings.collect();
            let gradient = DVec2::new(b + c - a - d, c + d - a - b) / self.square_px;
            if let ([one, other, ..], Some(inwards)) = (&crossings[..], gradient.try_normalize()) {
                found.push(Piece {
                    ends: [*one, *other],
                    inwards,
                });
            }
        }
        found
    }
}

/// Where the brightness of a frame steps across `pieces`.
fn seen(pieces: &[Piece], frame: Brightness) -> Option<Seen> {
    let clear = CLEAR * range(frame.light);
    let reach = (REACH * frame.width_px as f64).ceil().max(6.0) as i32;
    let steps = pieces.iter().filter_map(|piece| {
        let middle = piece.ends[0].midpoint(piece.ends[1]);
        let along = (-reach..=reach).map(|px| frame.at(middle + f64::from(px) * piece.inwards));
        let profile: Option<Vec<f32>> = along.collect();
        Some((piece.inwards, step(&profile?, clear)? - f64::from(reach)))
    });
    let steps: Vec<(DVec2, f64)> = steps.collect();
    if steps.len() < FEWEST || (steps.len() as f64) < SEEN * pieces.len() as f64 {
        return None;
    }
    // What is three times as far off as usual is another edge.
    let usual = median(steps.iter().map(|(_, px)| px.abs()).collect())?.max(1.0);
    let near: Vec<&(DVec2, f64)> = steps.iter().filter(|(_, px)| px.abs() <= 3.0 * usual).collect();
    let squares: f64 = near.iter().map(|(_, px)| px * px).sum();
    Some(Seen {
        distance_px: (squares / near.len() as f64).sqrt(),
        shift_px: shift(&near),
        pieces: near.len(),
    })
}

/// The shift of all pieces that explains how far each is off across itself (least squares).
fn shift(steps: &[&(DVec2, f64)]) -> [f64; 2] {
    let (mut xx, mut xy, mut yy, mut right) = (0.0, 0.0, 0.0, DVec2::ZERO);
    for (inwards, px) in steps {
        xx += inwards.x * inwards.x;
        xy += inwards.x * inwards.y;
        yy += inwards.y * inwards.y;
        right += *px * *inwards;
    }
    let determinant = xx * yy - xy * xy;
    if determinant < 1e-3 * (xx + yy) * (xx + yy) {
        // Pieces of one direction tell nothing of the other.
        return (right / (xx + yy).max(f64::MIN_POSITIVE)).to_array();
    }
    [
        (yy * right.x - xy * right.y) / determinant,
        (xx * right.y - xy * right.x) / determinant,
    ]
}

/// Where a profile steps up most, in pixels from its start, if it steps by `clear` at least.
fn step(profile: &[f32], clear: f32) -> Option<f64> {
    let mean = |part: &[f32]| part.iter().sum::<f32>() / part.len() as f32;
    let steps = (BESIDE_PX..profile.len() - BESIDE_PX).map(|at| {
        (
            at,
            mean(&profile[at + 1..=at + BESIDE_PX]) - mean(&profile[at - BESIDE_PX..at]),
        )
    });
    let (at, height) = steps.max_by(|a, b| a.1.total_cmp(&b.1))?;
    if height < clear {
        return None;
    }
    let low = mean(&profile[at - BESIDE_PX..at]);
    // The step is where an edge between both levels would have to be for the light that there is.
    let light: f32 = profile[at - 1..=at + 1]
        .iter()
        .map(|dn| ((dn - low) / height).clamp(0.0, 1.0))
        .sum();
    Some(at as f64 + 1.5 - f64::from(light))
}

/// Brightness of all but the brightest and the darkest hundredth.
fn range(light: &[f32]) -> f32 {
    let mut sorted: Vec<f32> = light
        .iter()
        .copied()
        .step_by((light.len() / 4096).max(1))
        .collect();
    sorted.sort_by(f32::total_cmp);
    let at = |share: usize| sorted.get(sorted.len() * share / 100).copied().unwrap_or(0.0);
    (at(99) - at(1)).max(1.0)
}

impl Brightness<'_> {
    /// The brightness at a position, between the centres of pixels; beyond the border it goes on as at the border.
    fn at(self, at: DVec2) -> Option<f32> {
        let height = self.light.len() / self.width_px;
        let last = DVec2::new(self.width_px as f64, height as f64) - 1.0;
        let at = (at - 0.5).clamp(DVec2::ZERO, last - 1e-6);
        let (x, y) = (at.x.floor(), at.y.floor());
        let first = y as usize * self.width_px + x as usize;
        let (right, down) = ((at.x - x) as f32, (at.y - y) as f32);
        let row = |first: usize| -> Option<f32> {
            let pair = self.light.get(first..first + 2)?;
            Some(pair[0] + right * (pair[1] - pair[0]))
        };
        let (upper, lower) = (row(first)?, row(first + self.width_px)?);
        Some(upper + down * (lower - upper))
    }

    /// The centre of what is brighter than half of the brightest, if that is a spot.
    fn centre(self) -> Option<DVec2> {
        let mut sorted = self.light.to_vec();
        sorted.sort_by(f32::total_cmp);
        let (dark, bright) = (sorted.get(sorted.len() / 2)?, sorted.last()?);
        let half = f32::midpoint(*dark, *bright);
        if bright - dark < 30.0 {
            return None;
        }
        let (mut sum, mut centre, mut count) = (0.0, DVec2::ZERO, 0);
        for (pixel, dn) in self.light.iter().enumerate().filter(|(_, dn)| **dn > half) {
            let weight = f64::from(dn - half);
            sum += weight;
            count += 1;
            centre += weight
                * DVec2::new(
                    (pixel % self.width_px) as f64 + 0.5,
                    (pixel / self.width_px) as f64 + 0.5,
                );
        }
        (count < self.light.len() / 20).then(|| centre / sum)
    }
}

/// The image of a spot of `spot_deg` degrees that lights from (θ, φ), degrees, which a flat mirror of this `normal` shows the `camera`.
pub(super) fn spot(
    camera: &View,
    [theta_deg, phi_deg]: [f64; 2],
    normal: DVec3,
    spot_deg: f64,
    frame: Option<Brightness>,
) -> Option<Outline> {
    let seen_from = -reflect(from_degrees(theta_deg, phi_deg), normal);
    let centre = camera.pixel(seen_from).ok()?;
    let (across, up) = seen_from.any_orthonormal_pair();
    let radius = (spot_deg / 2.0).to_radians();
    let around: Vec<DVec2> = (0..=24)
        .filter_map(|turn| {
            let turn = f64::from(turn) * std::f64::consts::TAU / 24.0;
            let w = seen_from + radius * (turn.cos() * across + turn.sin() * up);
            camera.pixel(w.normalize()).ok()
        })
        .collect();
    let pieces = around.iter().zip(around.iter().skip(1));
    let found = frame.and_then(Brightness::centre);
    Some(Outline {
        name: "spot",
        pieces_px: pieces.map(|(a, b)| [a.to_array(), b.to_array()]).collect(),
        seen: found.map(|at| Seen {
            distance_px: at.distance(centre),
            shift_px: (at - centre).to_array(),
            pieces: 1,
        }),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::instrument::rig::Rig;

    /// A frame of what a lit standard shows the camera of `rig`.
    fn frame(rig: &Rig) -> Vec<f32> {
        let camera = View::camera(rig);
        let (width, height) = camera.size_px();
        let light = |pixel: usize| {
            // A pixel shows the mean over its area.
            let lit = (0..16).filter(|part| {
                let at = |part: usize| (part as f64 + 0.5) / 4.0;
                let (u, v) = (
                    (pixel % width) as f64 + at(part % 4),
                    (pixel / width) as f64 + at(part / 4),
                );
                camera.direction(u, v).is_ok()
            });
            100.0 + 50.0 * lit.count() as f32
        };
        (0..width * height).map(light).collect()
    }

    fn seen_in(rig: &Rig, light: &[f32]) -> Vec<Outline> {
        let camera = View::camera(rig);
        let width_px = camera.size_px().0;
        edges(&camera, Some(Brightness { light, width_px }))
    }

    #[test]
    fn edges_are_seen_where_they_are_and_as_far_off_as_the_camera_is_turned() {
        for (preset, names) in [
            ("rcg-1", vec!["hole", "wire", "horizon"]),
            ("rcg-3", vec!["horizon"]),
        ] {
            let rig = Rig::load(preset).unwrap().with_image_size(128).unwrap();
            for outline in seen_in(&rig, &frame(&rig)) {
                if names.contains(&outline.name) {
                    let seen = outline
                        .seen
                        .unwrap_or_else(|| panic!("{preset}: no {}", outline.name));
                    assert!(seen.distance_px < 1.0, "{preset} {}: {seen:?}", outline.name);
                }
            }
            let mut turned = rig.clone();
            turned.camera.lens.centre_px[0] += 2.5;
            turned.camera.lens.centre_px[1] -= 1.0;
            let outlines = seen_in(&rig, &frame(&turned));
            let horizon = outlines.iter().find(|outline| outline.name == "horizon").unwrap();
            let [right, down] = horizon.seen.unwrap().shift_px;
            assert!(
                (right - 2.5).abs() < 0.6 && (down + 1.0).abs() < 0.6,
                "{preset}: {right} {down}"
            );
        }
        // Nothing is seen of what is not lit.
        let rig = Rig::load("rcg-3").unwrap().with_image_size(64).unwrap();
        assert!(
            seen_in(&rig, &vec![100.0; 64 * 64])
                .iter()
                .all(|outline| outline.seen.is_none())
        );
    }
}
