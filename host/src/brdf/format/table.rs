//! Tables over polar angle and azimuth of light and view.

use glam::DVec3;
use rayon::prelude::*;

use super::{ExportError, Exporting, Resolution};
use crate::base::bracket::bracket;
use crate::brdf::sample::{Outgoing, Sample};
use crate::hemisphere::direction::{from_degrees, is_above_horizon, to_degrees};

/// Pairs of directions that are asked for together.
pub(super) const BATCH: usize = 1 << 20;
/// Pairs of the largest table that is written.
pub(super) const MOST_PAIRS: usize = 1 << 31;
/// Angles that are farther apart tell nothing of what is between them, degrees.
pub(super) const WIDEST_DEG: f64 = 60.0;
/// A polar angle that is alone in a table tells of others this close, degrees.
const ALONE_DEG: f64 = 5.0;
/// Polar angles end here: at 90° there is no light.
pub(super) const LAST_DEG: f64 = 89.0;

/// Ascending angles in degrees. Azimuths of light that are one alone are those of a sample that looks alike however it is turned: azimuths
/// of view count from them.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Axes {
    /// Polar angles of light.
    pub(super) theta_i: Vec<f64>,
    /// Azimuths of light.
    pub(super) phi_i: Vec<f64>,
    /// Polar angles of view.
    pub(super) theta_o: Vec<f64>,
    /// Azimuths of view.
    pub(super) phi_o: Vec<f64>,
}

impl Axes {
    /// Every `step_deg` from the normal to the last polar angle and all around, with 0 and 360 if it `closes`.
    pub(super) fn every(step_deg: f64, is_isotropic: bool, closes: bool) -> Self {
        let polar = steps(LAST_DEG, step_deg, true);
        let around = steps(360.0, step_deg, closes);
        Self {
            theta_i: polar.clone(),
            phi_i: if is_isotropic { vec![0.0] } else { around.clone() },
            theta_o: polar,
            phi_o: around,
        }
    }

    /// Of a table whose size `resolution` says, with the step of the source or `usual_deg` otherwise.
    pub(super) fn of(
        exporting: &Exporting,
        resolution: Resolution,
        usual_deg: f64,
        closes: bool,
    ) -> Result<Self, ExportError> {
        let step_deg = if resolution.step_deg > 0.0 {
            resolution.step_deg
        } else {
            exporting.own_step_deg().unwrap_or(usual_deg).max(usual_deg)
        };
        let axes = Self::every(step_deg, exporting.is_isotropic(), closes);
        if axes.len() > MOST_PAIRS {
            return Err(exporting.refused(
                "resolution",
                format!("at most {MOST_PAIRS} pairs of directions, by a wider step"),
                format!("{} at a step of {step_deg}°", axes.len()),
            ));
        }
        Ok(axes)
    }

    /// Between which of them nobody should interpolate; `None` if there are none.
    pub(super) fn flaw(&self) -> Option<String> {
        let widest = |angles: &[f64], closes: bool| {
            let gaps = angles.windows(2).map(|two| two[1] - two[0]);
            let last = closes.then(|| angles[0] + 360.0 - angles[angles.len() - 1]);
            gaps.chain(last).fold(0.0, f64::max)
        };
        let relative = self.phi_i.len() == 1;
        [
            ("polar angles of light", &self.theta_i, false),
            ("azimuths of light", &self.phi_i, !relative),
            ("polar angles of view", &self.theta_o, false),
            ("azimuths of view", &self.phi_o, true),
        ]
        .into_iter()
        .map(|(name, angles, closes)| (name, widest(angles, closes)))
        .find(|(_, gap)| *gap > WIDEST_DEG)
        .map(|(name, gap)| format!("{name} up to {gap}° apart"))
    }

    /// Pairs of directions.
    pub(super) fn len(&self) -> usize {
        let [a, b, c, d] = self.shape();
        a.saturating_mul(b).saturating_mul(c).saturating_mul(d)
    }

    /// Angles along each axis: θi, φi, θo, φo.
    pub(super) fn shape(&self) -> [usize; 4] {
        [&self.theta_i, &self.phi_i, &self.theta_o, &self.phi_o].map(Vec::len)
    }

    /// Angles of a pair in degrees, by its number in the order θi, φi, θo, φo, the last fastest.
    pub(super) fn angles(&self, number: usize) -> [f64; 4] {
        let [_, p, t, q] = self.shape();
        [
            self.theta_i[number / (q * t * p)],
            self.phi_i[number / (q * t) % p],
            self.theta_o[number / q % t],
            self.phi_o[number % q],
        ]
    }

    /// The pair of directions of that number.
    pub(super) fn pair(&self, number: usize) -> (DVec3, DVec3) {
        let [theta_i, phi_i, theta_o, phi_o] = self.angles(number);
        (from_degrees(theta_i, phi_i), from_degrees(theta_o, phi_o))
    }

    /// Calls `each` with the numbers of pairs, and those, in order and in batches.
    pub(super) fn scan(
        &self,
        exporting: &Exporting,
        mut each: impl FnMut(std::ops::Range<usize>, &[(DVec3, DVec3)]) -> Result<(), ExportError>,
    ) -> Result<(), ExportError> {
        exporting
            .progress
            .begin("export", self.len(), "pairs of directions");
        for first in (0..self.len()).step_by(BATCH) {
            let range = first..(first + BATCH).min(self.len());
            let pairs: Vec<_> = range
                .clone()
                .into_par_iter()
                .map(|number| self.pair(number))
                .collect();
            each(range.clone(), &pairs)?;
            exporting.progress.reach(range.end);
        }
        Ok(())
    }
}

/// 0, `step`, 2·`step` … below `last`, and `last` itself if it `closes`.
pub(super) fn steps(last: f64, step: f64, closes: bool) -> Vec<f64> {
    let count = (last / step - 1e-9).ceil().max(1.0) as usize;
    let mut all: Vec<f64> = (0..count).map(|number| number as f64 * step).collect();
    if closes {
        all.push(last);
    }
    all
}

/// Whether these are angles of an axis: some, ascending, from 0 to `last`.
pub(super) fn are_angles(all: &[f64], last: f64) -> bool {
    !all.is_empty()
        && all.windows(2).all(|two| two[0] < two[1])
        && all.iter().all(|deg| (0.0..=last).contains(deg))
}

/// f of a table, linear in each of the four angles between its entries; NaN where less than half of the weight has a value.
#[derive(Clone, Debug)]
pub(super) struct Tabulated {
    axes: Axes,
    /// f in sr⁻¹, in the order of [`Axes`]; NaN is no value.
    f: Vec<[f32; 3]>,
}

impl Tabulated {
    /// Of as many values as the axes have pairs.
    pub(super) fn new(axes: Axes, f: Vec<[f32; 3]>) -> Self {
        debug_assert_eq!(axes.len(), f.len());
        Self { axes, f }
    }

    fn is_relative(&self) -> bool {
        self.axes.phi_i.len() == 1
    }
}

impl Sample for Tabulated {
    fn incident(&self, wi: DVec3) -> Box<dyn Outgoing + '_> {
        let (theta_deg, phi_deg) = to_degrees(wi);
        let [_, azimuths, ..] = self.axes.shape();
        let mut rows = Vec::with_capacity(4);
        if is_above_horizon(wi) {
            for (t, a) in polar(&self.axes.theta_i, theta_deg) {
                for (p, b) in around(&self.axes.phi_i, phi_deg) {
                    if a * b > 0.0 {
                        rows.push((t * azimuths + p, a * b));
                    }
                }
            }
        }
        Box::new(Lit {
            table: self,
            turn_deg: if self.is_relative() { phi_deg } else { 0.0 },
            rows,
            above: is_above_horizon(wi),
        })
    }

    fn is_isotropic(&self) -> bool {
        self.is_relative()
    }
}

/// A table under an incident direction.
struct Lit<'a> {
    table: &'a Tabulated,
    turn_deg: f64,
    /// Rows of the table, with their weights; none if the table says nothing of the direction, or it is not above the horizon.
    rows: Vec<(usize, f64)>,
    above: bool,
}

impl Outgoing for Lit<'_> {
    fn f(&self, wo: DVec3) -> [f64; 3] {
        if !self.above || !is_above_horizon(wo) {
            return [0.0; 3];
        }
        let axes = &self.table.axes;
        let (theta_deg, phi_deg) = to_degrees(wo);
        let phi_deg = (phi_deg - self.turn_deg).rem_euclid(360.0);
        let (polar, azimuths) = (polar(&axes.theta_o, theta_deg), around(&axes.phi_o, phi_deg));
        let (mut sum, mut weight) = ([0.0; 3], 0.0);
        for &(row, a) in &self.rows {
            for (t, b) in polar {
                for (p, c) in azimuths {
                    let value = self.table.f[(row * axes.theta_o.len() + t) * axes.phi_o.len() + p];
                    let part = a * b * c;
                    if part > 0.0 && value.iter().all(|f| f.is_finite()) {
                        weight += part;
                        for (sum, f) in sum.iter_mut().zip(value) {
                            *sum += part * f64::from(f);
                        }
                    }
                }
            }
        }
        if weight >= 0.5 {
            sum.map(|sum| sum / weight)
        } else {
            [f64::NAN; 3]
        }
    }
}

/// The two entries of ascending `values` around `value`, and their weights; clamped to the ends.
fn entries(values: &[f64], value: f64) -> [(usize, f64); 2] {
    let (below, [a, b]) = bracket(values, value);
    [(below, a), ((below + 1).min(values.len() - 1), b)]
}

/// As [`entries`], of polar angles: beyond the ends of a table nothing is known farther than to the next of its angles, and both weights are 0.
pub(super) fn polar(values: &[f64], value: f64) -> [(usize, f64); 2] {
    let (first, last) = (values[0], values[values.len() - 1]);
    let (Some(second), Some(before)) = (values.get(1), values.len().checked_sub(2).map(|at| values[at]))
    else {
        let is_near = (value - first).abs() <= ALONE_DEG;
        return if is_near {
            entries(values, value)
        } else {
            [(0, 0.0); 2]
        };
    };
    if value < 2.0 * first - second || value > 2.0 * last - before {
        return [(0, 0.0); 2];
    }
    entries(values, value)
}

/// As [`entries`], of azimuths in degrees: behind the last comes the first again, unless both are the same.
pub(super) fn around(values: &[f64], value: f64) -> [(usize, f64); 2] {
    let (Some(first), Some(last)) = (values.first(), values.last()) else {
        return [(0, 1.0), (0, 0.0)];
    };
    let value = first + (value - first).rem_euclid(360.0);
    let gap = first + 360.0 - last;
    if values.len() > 1 && value > *last && gap > 1e-9 {
        let t = (value - last) / gap;
        return [(values.len() - 1, 1.0 - t), (0, t)];
    }
    entries(values, value)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn azimuths_go_around_with_and_without_a_last_one() {
        for values in [
            vec![0.0, 90.0, 180.0, 270.0],
            vec![0.0, 90.0, 180.0, 270.0, 360.0],
        ] {
            for (asked, expected) in [
                (45.0, 45.0),
                (300.0, 300.0),
                (-30.0, 330.0),
                (0.0, 0.0),
                (359.0, 359.0),
            ] {
                let found: f64 = around(&values, asked)
                    .iter()
                    .map(|(at, weight)| {
                        let value = if *at == 0 && expected > 180.0 {
                            360.0
                        } else {
                            values[*at]
                        };
                        weight * value
                    })
                    .sum();
                assert!((found - expected).abs() < 1e-9, "{values:?} {asked}: {found}");
            }
        }
        assert_eq!(around(&[0.0], 123.0), [(0, 1.0), (0, 0.0)]);
    }

    #[test]
    fn steps_end_where_they_should() {
        assert_eq!(steps(90.0, 30.0, true), [0.0, 30.0, 60.0, 90.0]);
        assert_eq!(steps(360.0, 90.0, false), [0.0, 90.0, 180.0, 270.0]);
        assert_eq!(steps(89.0, 40.0, true), [0.0, 40.0, 80.0, 89.0]);
    }
}
