//! What the camera's colours show of each other.
//!
//! # Design
//! The bands of a measurement are the projector's primaries. A channel shows light of its neighbours' too: filters overlap, and
//! charge leaks between the pixels of a mosaic. So of a sample channel c shows Σ_d m_cd·f_d, where m_cd is what it shows of primary d
//! over what it shows of white. A white standard, whose f is the same in all bands, hides that. m varies over the image with the
//! angle at which light meets the sensor: m = a + b·ρ², ρ the distance from the middle in half widths of the image.

use glam::DMat3;
use serde::{Deserialize, Serialize};

/// Colours of a camera that has any.
pub(crate) const COLOURS: usize = 3;

/// What each channel shows of each primary.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Crosstalk {
    /// a and b, [channel, primary]; over all primaries a sums to 1 and b to 0.
    pub shares: [[[f64; 2]; COLOURS]; COLOURS],
    /// Standard uncertainty (k = 1) of m, [channel, primary].
    pub standard_uncertainty: [[f64; COLOURS]; COLOURS],
}

impl Crosstalk {
    /// m at (`x`, `y`), each −1 to 1 over the image: of what a channel shows of white light the share of each primary, rows are
    /// channels.
    #[must_use]
    pub fn at(&self, x: f64, y: f64) -> DMat3 {
        let square = x * x + y * y;
        // By columns.
        DMat3::from_cols_array_2d(&self.shares.map(|row| row.map(|[a, b]| a + b * square))).transpose()
    }

    /// The most that a channel shows of the other primaries in the middle of the image.
    #[must_use]
    pub fn most(&self) -> f64 {
        let others = |(channel, row): (usize, &[[f64; 2]; COLOURS])| 1.0 - row[channel][0];
        self.shares.iter().enumerate().map(others).fold(0.0, f64::max)
    }

    /// What is wrong with numbers that were read, if any is: a field and what it should have.
    pub(super) fn flaw(&self) -> Option<(&'static str, &'static str)> {
        let rows = || self.shares.iter();
        let own = |(channel, row): (usize, &[[f64; 2]; COLOURS])| {
            let sums = [0, 1].map(|term| row.iter().map(|terms| terms[term]).sum::<f64>());
            // Three times as far from the middle as a corner nothing is asked for.
            row[channel][0] > 0.5
                && row[channel][0] + 2.0 * row[channel][1].min(0.0) > 0.4
                && (sums[0] - 1.0).abs() < 1e-6
                && sums[1].abs() < 1e-6
        };
        let known = |uncertainty: &f64| (0.0..=0.5).contains(uncertainty);
        if !rows().enumerate().all(own) {
            return Some((
                "shares",
                "rows that sum to 1 and 0, of which more than half is a channel's own primary",
            ));
        }
        (!self.standard_uncertainty.iter().flatten().all(known))
            .then_some(("standard_uncertainty", "numbers from 0 to 0.5"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    #[test]
    fn channels_are_rows_and_primaries_columns() {
        let mut found = Crosstalk {
            shares: [
                [[0.97, -0.01], [0.02, 0.01], [0.01, 0.0]],
                [[0.0, 0.0], [1.0, 0.0], [0.0, 0.0]],
                [[0.0, 0.0], [0.1, 0.02], [0.9, -0.02]],
            ],
            standard_uncertainty: [[1e-4; 3]; 3],
        };
        let shown = found.at(1.0, 1.0) * DVec3::new(1.0, 2.0, 4.0);
        assert!(
            (shown.x - (0.95 + 2.0 * 0.04 + 4.0 * 0.01)).abs() < 1e-12,
            "{shown}"
        );
        assert!((shown.z - (2.0 * 0.14 + 4.0 * 0.86)).abs() < 1e-12, "{shown}");
        assert!((found.most() - 0.1).abs() < 1e-12);
        assert_eq!(found.flaw(), None);
        found.shares[1][0][0] = 0.1;
        assert_eq!(found.flaw().map(|flaw| flaw.0), Some("shares"));
    }
}
