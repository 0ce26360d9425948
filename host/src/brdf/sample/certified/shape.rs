//! How f of a standard goes with direction.

use std::path::Path;

use glam::DVec3;

use super::read::{AngularFile, content};
use crate::brdf::sample::SampleError;
use crate::hemisphere::direction::azimuth_cosine;

/// The least and the largest ratio that a matte standard has.
const RATIOS: [f64; 2] = [0.2, 5.0];
/// The largest polar angle of a ratio, degrees.
const LARGEST_DEG: f64 = 89.0;

/// f relative to that of some direction, the same for all channels.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Shape {
    /// Of each polar angle of light, degrees, ascending.
    lights: Vec<Light>,
}

/// The ratios under light of one polar angle.
#[derive(Clone, Debug, PartialEq)]
struct Light {
    incident_deg: f64,
    /// Polar angle of view, degrees, and the ratio, ascending: on the side away from the light, and on its own.
    sides: [Vec<[f64; 2]>; 2],
}

impl Shape {
    /// That of the file at `path`; Lambert's law where it states none.
    pub(super) fn new(stated: Option<&AngularFile>, path: &Path) -> Result<Self, SampleError> {
        let mut shape = Self::default();
        let rows = stated.map_or(&[][..], |stated| stated.values.as_slice());
        for (index, row) in rows.iter().enumerate() {
            let field = |name: &str| format!("angular.values[{index}].{name}");
            for (name, value, [low, high]) in [
                ("incident_deg", row.incident_deg, [0.0, LARGEST_DEG]),
                ("outgoing_deg", row.outgoing_deg, [-LARGEST_DEG, LARGEST_DEG]),
                ("ratio", row.ratio, RATIOS),
            ] {
                if !(low..=high).contains(&value) {
                    let expected = format!("a number from {low} to {high}");
                    return Err(content(path, &field(name), &expected, value));
                }
            }
            let light = shape.light(row.incident_deg);
            let side = usize::from(row.outgoing_deg < 0.0);
            let place = [row.outgoing_deg.abs(), row.ratio];
            if light.sides[side]
                .iter()
                .any(|[deg, _]| (deg - place[0]).abs() < 1e-9)
            {
                let expected = "each pair of directions once";
                let found = format!("{} again", row.outgoing_deg);
                return Err(content(path, &field("outgoing_deg"), expected, found));
            }
            light.sides[side].push(place);
        }
        for light in &mut shape.lights {
            light.close();
        }
        shape
            .lights
            .sort_by(|a, b| a.incident_deg.total_cmp(&b.incident_deg));
        Ok(shape)
    }

    fn light(&mut self, incident_deg: f64) -> &mut Light {
        let known = |light: &Light| (light.incident_deg - incident_deg).abs() < 1e-9;
        let at = self.lights.iter().position(known).unwrap_or_else(|| {
            self.lights.push(Light {
                incident_deg,
                sides: [Vec::new(), Vec::new()],
            });
            self.lights.len() - 1
        });
        &mut self.lights[at]
    }

    /// Polar angles of light and of view up to which it is stated, degrees.
    pub(super) fn known_to_deg(&self) -> [f64; 2] {
        let light = self.lights.last().map_or(0.0, |light| light.incident_deg);
        let views = self.lights.iter().map(Light::known_to_deg);
        [light, views.reduce(f64::min).unwrap_or(0.0)]
    }

    /// The ratio for light from `wi` and a view from `wo`, both above the horizon; between what is stated it is linear in the polar angles
    /// and in the cosine of the azimuth between them, beyond it goes on as it ends.
    pub(super) fn ratio(&self, wi: DVec3, wo: DVec3) -> f64 {
        if self.lights.is_empty() {
            return 1.0;
        }
        let deg = |w: DVec3| w.z.clamp(-1.0, 1.0).acos().to_degrees();
        let cosine = azimuth_cosine(wi, wo);
        let rows = self.lights.iter().map(|light| {
            let [away, own] = light.sides.each_ref().map(|side| linear(side, deg(wo)));
            [
                light.incident_deg,
                away.midpoint(own) + 0.5 * cosine * (own - away),
            ]
        });
        linear(&rows.collect::<Vec<_>>(), deg(wi))
    }
}

impl Light {
    /// Sorts both sides; of one that is not stated the other stands for both, and the normal belongs to both.
    fn close(&mut self) {
        let [away, own] = &mut self.sides;
        if own.is_empty() {
            own.clone_from(away);
        } else if away.is_empty() {
            away.clone_from(own);
        }
        let normal = |side: &[[f64; 2]]| side.iter().copied().find(|[deg, _]| *deg < 1e-9);
        if let (Some(at), None) = (normal(away), normal(own)) {
            own.push(at);
        }
        for side in &mut self.sides {
            side.sort_by(|a, b| a[0].total_cmp(&b[0]));
        }
    }

    fn known_to_deg(&self) -> f64 {
        let last = |side: &Vec<[f64; 2]>| side.last().map_or(0.0, |[deg, _]| *deg);
        let [away, own] = self.sides.each_ref().map(last);
        away.min(own)
    }
}

/// The value at `x` on the line through `points` (x ascending); beyond them that of the last.
pub(super) fn linear(points: &[[f64; 2]], x: f64) -> f64 {
    let after = points.partition_point(|point| point[0] < x);
    match (points.get(after.wrapping_sub(1)), points.get(after)) {
        (Some([x0, y0]), Some([x1, y1])) => y0 + (y1 - y0) * (x - x0) / (x1 - x0),
        (Some([_, y]), None) | (None, Some([_, y])) => *y,
        (None, None) => f64::NAN,
    }
}
