//! How the flat mirror really stood: tilts are set by hand, and no better than the mount can be read.
//!
//! # Design
//! Each tilt has two unknowns, by how much the mirror's normal leans otherwise than stated, in the plane of the tilt and across
//! it. Each is an observation with the standard uncertainty that is stated of tilts. The matches tell to hundredths of a degree
//! how the mirrors stand to each other; how all of them stand to the holder nobody but the statements can tell: it is their mean,
//! and its uncertainty becomes one of all directions.
//!
//! So N tilts leave 2 N − 3 numbers that must agree. What a lean has beyond its statement, over what it may have by the
//! statement's uncertainty (the difference of the covariances before and after the fit: D. Ku in *Data reduction and error
//! analysis*, Bevington and Robinson 2003, section 11; the deviate of an observation that itself took part), is refused above
//! [`CLEAR`], with the name of the view. Below, what scatters more than stated makes the statement less certain (the Birge
//! ratio).

use glam::DVec3;
use nalgebra::DMatrix;

use crate::calibrate::CalibrateError;
use crate::hemisphere::direction::from_degrees;
use crate::instrument::calibration::TiltFound;

/// Standard uncertainties by which a tilt may differ from what is stated.
const CLEAR: f64 = 3.0;
/// What is to be done about a tilt that is refused.
const ADVICE: &str = "check how the mirror stood in that view; if all tilts are known no better, say so \
     (--tilt-uncertainty-deg), and take views at more of them";

/// A tilt of the flat mirror, as it is stated.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Mount {
    /// Tilt and azimuth towards which, degrees.
    pub(super) stated_deg: [f64; 2],
    normal: DVec3,
    /// Towards larger tilts, and across it.
    axes: [DVec3; 2],
}

impl Mount {
    pub(super) fn of(stated_deg: [f64; 2]) -> Self {
        let [tilt_deg, azimuth_deg] = stated_deg;
        Self {
            stated_deg,
            normal: from_degrees(tilt_deg, azimuth_deg),
            axes: [
                from_degrees(tilt_deg + 90.0, azimuth_deg),
                from_degrees(90.0, azimuth_deg + 90.0),
            ],
        }
    }

    /// The normal of the mirror that leans by so much, radians.
    pub(super) fn leaning(&self, leans_rad: [f64; 2]) -> DVec3 {
        let [along, across] = self.axes;
        (self.normal + leans_rad[0] * along + leans_rad[1] * across).normalize()
    }

    /// What the report calls it.
    fn name(&self) -> String {
        format!("{}:{}", self.stated_deg[0], self.stated_deg[1])
    }
}

/// How far leans are from what was stated.
pub(super) struct Agreement {
    /// Each over its own standard uncertainty, two of each mount.
    deviates: Vec<f64>,
    /// Factor of the variance of the statements, 1 or more.
    pub(super) birge: f64,
}

impl Agreement {
    /// Of `leans` in units of the stated uncertainty, of which `covariance` is what the fit left of them.
    pub(super) fn of(leans: &[f64], covariance: &DMatrix<f64>) -> Self {
        // How much of each statement the others check: nothing of one that stands alone.
        let checked = |at: usize| (1.0 - covariance[(at, at)]).max(1e-3);
        let degrees: f64 = (0..leans.len()).map(checked).sum();
        Self {
            deviates: leans
                .iter()
                .enumerate()
                .map(|(at, lean)| lean / checked(at).sqrt())
                .collect(),
            birge: (leans.iter().map(|lean| lean.powi(2)).sum::<f64>() / degrees).max(1.0),
        }
    }

    /// Refuses tilts of which one is not what was stated to `uncertainty_deg`.
    pub(super) fn check(
        &self,
        mounts: &[Mount],
        found: &[TiltFound],
        uncertainty_deg: f64,
    ) -> Result<(), CalibrateError> {
        let largest = |pair: &[f64]| pair[0].abs().max(pair[1].abs());
        let deviates = self.deviates.chunks_exact(2).map(largest);
        let worst = deviates.enumerate().max_by(|a, b| a.1.total_cmp(&b.1));
        let Some((at, deviate)) = worst.filter(|(_, deviate)| *deviate > CLEAR) else {
            return Ok(());
        };
        let [along_deg, across_deg] = found[at].leans_deg;
        Err(CalibrateError::Views {
            expected: format!("a flat mirror at the tilts that are stated, to {uncertainty_deg}° (k = 1)"),
            found: format!(
                "view {} ({}), in which it leans by {along_deg:+.2}° in the plane of its tilt and {across_deg:+.2}° across it, if \
                 the others are right ({deviate:.1} standard uncertainties)",
                at + 1,
                mounts[at].name()
            ),
            advice: ADVICE,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mirror_leans_along_its_tilt_and_across_it() {
        let mount = Mount::of([15.0, 120.0]);
        let leant = |leans_deg: [f64; 2]| mount.leaning(leans_deg.map(f64::to_radians));
        let missed = |found: DVec3, tilt_deg: f64, azimuth_deg: f64| {
            (found - from_degrees(tilt_deg, azimuth_deg))
                .length()
                .to_degrees()
        };
        assert!(missed(leant([0.5, 0.0]), 15.5, 120.0) < 1e-4);
        let across_deg = 1.0 * 15_f64.to_radians().sin();
        assert!(missed(leant([0.0, across_deg]), 15.0, 121.0) < 3e-3);
    }

    #[test]
    fn the_view_that_does_not_agree_is_named_and_what_scatters_is_less_certain() {
        let mounts = [[0.0, 0.0], [15.0, 0.0], [15.0, 120.0]].map(Mount::of);
        // Of six leans three are checked.
        let covariance = DMatrix::from_diagonal_element(6, 6, 0.5);
        let found = mounts.map(|mount| TiltFound {
            stated_deg: mount.stated_deg,
            leans_deg: [0.1, 0.2],
            standard_uncertainty_deg: [0.03; 2],
            match_residual_deg: 0.01,
        });
        let agreement = Agreement::of(&[0.5, -0.3, 0.2, 0.6, -0.7, 0.4], &covariance);
        assert!((agreement.birge - 1.0).abs() < 1e-12);
        agreement.check(&mounts, &found, 0.05).unwrap();
        let agreement = Agreement::of(&[0.5, -1.3, 1.2, 0.6, -1.7, 1.4], &covariance);
        assert!((agreement.birge - 8.59 / 3.0).abs() < 1e-9, "{}", agreement.birge);
        agreement.check(&mounts, &found, 0.05).unwrap();
        let agreement = Agreement::of(&[0.5, -1.3, 1.2, 2.6, -1.7, 1.4], &covariance);
        let error = agreement.check(&mounts, &found, 0.05).unwrap_err().to_string();
        assert!(error.contains("view 2 (15:0)"), "{error}");
    }
}
