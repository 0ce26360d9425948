//! Directions and edges as calibration found them.

use std::path::Path;

use serde::{Deserialize, Serialize};

use super::{CalibrationError, file};

/// Name of the file with what was found.
pub const GEOMETRY: &str = "geometry.json";
/// What writes the files of this calibration.
pub(crate) const COMMAND: &str = "rcg calibrate geometry --out DIR";
/// Standard uncertainty of the directions above which the views do not determine the geometry, degrees, RMS. A mirror whose slopes
/// are off by half a milliradian bends light by 0.06°, and by some times as much what a fit without it makes of lenses.
pub const WORST_DEG: f64 = 0.2;

/// What is said of an image that is as the rig file has it.
pub const AS_STATED: &str = "as stated";

/// One number of the calibrated rig.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Found {
    /// Its place in the rig file, which names the unit.
    pub name: String,
    /// What was found.
    pub value: f64,
    /// Its standard uncertainty (k = 1).
    pub standard_uncertainty: f64,
    /// What the rig file had said.
    pub nominal: f64,
    /// To what standard uncertainty.
    pub tolerance: f64,
}

/// How the flat mirror stood in one view.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TiltFound {
    /// Tilt and azimuth towards which, as stated, degrees.
    pub stated_deg: [f64; 2],
    /// By how much its normal leans otherwise, in the plane of the tilt (positive: more) and across it, degrees.
    pub leans_deg: [f64; 2],
    /// Standard uncertainty of either (k = 1), degrees.
    pub standard_uncertainty_deg: [f64; 2],
    /// Median angle of the residuals of this view's matches, degrees.
    pub match_residual_deg: f64,
}

/// What calibration found, as `geometry.json` has it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Geometry {
    /// Hash of the nominal rig.
    pub nominal_sha256: String,
    /// Hash of the calibrated rig.
    pub rig_sha256: String,
    /// The unknowns of the rig.
    pub parameters: Vec<Found>,
    /// How the images of camera and projector are turned and mirrored against the nominal rig; [`AS_STATED`] if they are not.
    pub images: [String; 2],
    /// How the flat mirror stood, view by view.
    pub tilts: Vec<TiltFound>,
    /// Standard uncertainty (k = 1) of either lean of a tilt as stated, degrees.
    pub tilt_uncertainty_deg: f64,
    /// The covariance of the unknowns of the rig, [row, column], in the units of the rig file.
    pub covariance: Vec<Vec<f64>>,
    /// Matches of camera and projector that took part.
    pub matches: usize,
    /// Positions on edges of the mirror that took part.
    pub edges: usize,
    /// Median angle of a match's residual, degrees.
    pub match_residual_deg: f64,
    /// Median angle of an edge's residual, degrees; `None` if the mirror shows no edge.
    pub edge_residual_deg: Option<f64>,
    /// Standard uncertainty (k = 1, RMS over what of the image is judged) of the directions of the camera, apart from a turn about
    /// the sample's normal, degrees.
    pub camera_deg: f64,
    /// The same of the projector's.
    pub projector_deg: f64,
    /// Standard uncertainty (k = 1) of where azimuth 0 of the holder lies, by a turn of all directions about the normal, degrees.
    pub azimuth_deg: f64,
}

impl Geometry {
    /// What `dir` holds.
    ///
    /// # Errors
    /// [`CalibrationError::Content`].
    pub fn read(dir: &Path) -> Result<Self, CalibrationError> {
        let path = dir.join(GEOMETRY);
        let found: Self = file::read(&path, COMMAND)?;
        found.check(&path)?;
        Ok(found)
    }

    /// Refuses numbers that no calibration finds; `path` is where they were read.
    fn check(&self, path: &Path) -> Result<(), CalibrationError> {
        let content = |field: String, expected: String, found: String| {
            Err(CalibrationError::Content {
                path: path.display().to_string(),
                field,
                expected: format!("{expected} as `{COMMAND}` writes it"),
                found,
            })
        };
        for (field, deg) in [
            ("camera_deg", self.camera_deg),
            ("projector_deg", self.projector_deg),
        ] {
            if !(0.0..=WORST_DEG).contains(&deg) {
                return content(field.to_owned(), format!("0 to {WORST_DEG}"), deg.to_string());
            }
        }
        let unknowns = self.parameters.len();
        if self.covariance.len() != unknowns || self.covariance.iter().any(|row| row.len() != unknowns) {
            let expected = format!("{unknowns} rows and columns, one for each parameter,");
            return content("covariance".to_owned(), expected, "others".to_owned());
        }
        let negative = self
            .parameters
            .iter()
            .find(|found| found.standard_uncertainty < 0.0);
        negative.map_or(Ok(()), |found| {
            content(
                format!("standard_uncertainty of {}", found.name),
                "0 or more".to_owned(),
                found.standard_uncertainty.to_string(),
            )
        })
    }

    /// Standard uncertainty (k = 1) of where the edges of hole, rim and wire are, degrees: that of the angle of theirs that
    /// is known worst, and their own residual, which is not all chance: a pixel is coarse; 0 if the camera sees no edge.
    #[must_use]
    pub fn edge_deg(&self) -> f64 {
        if self.edges == 0 {
            return 0.0;
        }
        let of_edges = |found: &&Found| {
            ["mirror.edge_", "wire."]
                .iter()
                .any(|part| found.name.starts_with(part))
        };
        let angles = self.parameters.iter().filter(of_edges);
        let worst_deg = angles.map(|found| found.standard_uncertainty).fold(0.0, f64::max);
        worst_deg.hypot(self.edge_residual_deg.unwrap_or(0.0))
    }
}
