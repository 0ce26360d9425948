//! The mean of f over a small light and a small pixel.
//!
//! # Design
//! Four directions of light and four places within the pixel, each in the order ++, +−, −+, −−, make 16
//! combinations. The half fraction x₄ = x₁x₂x₃ of them is evaluated (a 2⁴⁻¹ design): 8 evaluations in which no two of
//! the four coordinates are correlated, so all second moments of the joint blur are right.

use glam::DVec3;

use crate::sample::Outgoing;

/// Light (s₁, s₂) goes with the places (+, s₁s₂) and (−, −s₁s₂).
const PLACES: [[usize; 2]; 4] = [[0, 3], [1, 2], [1, 2], [0, 3]];

/// Mean of f in sr⁻¹ over the four `lobes`, one per direction of light, and the four outgoing directions `places`.
pub(crate) fn mean_f(lobes: &[Box<dyn Outgoing + '_>; 4], places: &[DVec3; 4]) -> [f64; 3] {
    let mut sum = [0.0; 3];
    for (lobe, pair) in lobes.iter().zip(PLACES) {
        for place in pair {
            let f = lobe.f(places[place]);
            sum = [sum[0] + f[0], sum[1] + f[1], sum[2] + f[2]];
        }
    }
    sum.map(|sum| sum / 8.0)
}
