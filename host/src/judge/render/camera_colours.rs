//! From the channels of the camera to colours that people see.
//!
//! # Design
//! A camera's red, green and blue are not those of a screen. A 3 × 3 matrix takes them to CIE XYZ; it is the least-squares fit to patches
//! whose XYZ are known, each weighted by one over its luminance, so that dark ones count as well as bright ones. How well a matrix can do at
//! all is stated: the colour difference ΔE*ab (CIE 1976, ISO/CIE 11664-4) of the patches, whose white is the perfect diffuser under D65.
//! From XYZ to the screen it is the matrix of sRGB (IEC 61966-2-1).

use std::path::Path;

use glam::{DMat3, DVec3};
use serde::Serialize;

use super::{Content, Picture};
use crate::base::blame::Blame;
use crate::base::text;

/// Fewest patches: with three the matrix fits whatever stands there.
const FEWEST: usize = 4;
/// XYZ of the white of sRGB, D65 (IEC 61966-2-1).
const WHITE: DVec3 = DVec3::new(0.950_47, 1.0, 1.088_83);
/// From linear sRGB to XYZ, columns of red, green and blue (IEC 61966-2-1).
const SRGB_TO_XYZ: DMat3 = DMat3::from_cols_array(&[
    0.412_390_8,
    0.212_639,
    0.019_330_8,
    0.357_584_3,
    0.715_168_7,
    0.119_194_8,
    0.180_480_8,
    0.072_192_3,
    0.950_532_2,
]);
/// Smallest luminance by which a patch is weighted, of white.
const DARKEST: f64 = 0.02;
/// Smallest ratio of the determinant of the patches' second moments to what independent channels would have.
const SINGULAR: f64 = 1e-9;

/// Why there is no matrix.
#[derive(Debug, thiserror::Error)]
#[error("{path}{line}: expected {expected}, found {found}", line = line.map_or_else(String::new, |line| format!(", line {line}")))]
pub struct ColourError {
    path: String,
    line: Option<usize>,
    expected: String,
    found: String,
}

impl Blame for ColourError {
    fn is_input(&self) -> bool {
        true
    }
}

/// The matrix of a camera, and how well it does.
#[derive(Clone, Debug, Serialize)]
pub struct CameraColours {
    /// From the camera's channels to linear sRGB, row by row.
    pub matrix: [[f64; 3]; 3],
    /// Patches that it was fitted to.
    pub patches: usize,
    /// Mean and largest colour difference ΔE*ab of the patches.
    pub delta_e: [f64; 2],
    /// Root mean square of the difference in luminance Y, relative to that of each patch.
    pub relative_luminance: f64,
}

impl CameraColours {
    /// Fits the matrix to the table at `path` (CSV with a head): columns `r,g,b` of the camera, of which 1 is a perfect diffuser, and
    /// either `X,Y,Z` under D65, of which Y = 1 is a perfect diffuser, or `sR,sG,sB`, sRGB from 0 to 255.
    ///
    /// # Errors
    /// [`ColourError`] with path, line, expected and found.
    pub fn read(path: &Path) -> Result<Self, ColourError> {
        let fail = |line, expected: &str, found: String| ColourError {
            path: path.display().to_string(),
            line,
            expected: expected.to_owned(),
            found,
        };
        let text = text::read(path).map_err(|error| fail(None, "a table", error.to_string()))?;
        let mut rows = text
            .lines()
            .enumerate()
            .filter(|(_, line)| !line.trim().is_empty());
        let head = rows.next().map_or("", |(_, line)| line.trim());
        let names: Vec<&str> = head.split(',').map(str::trim).collect();
        let column = |name: &str| names.iter().position(|one| *one == name);
        let three = |names: [&str; 3]| -> Option<[usize; 3]> {
            let [a, b, c] = names.map(column);
            Some([a?, b?, c?])
        };
        let is_coded = three(["X", "Y", "Z"]).is_none();
        let (Some(camera), Some(seen)) = (
            three(["r", "g", "b"]),
            three(["X", "Y", "Z"]).or_else(|| three(["sR", "sG", "sB"])),
        ) else {
            let expected = "a head with the columns r,g,b and X,Y,Z or sR,sG,sB";
            return Err(fail(Some(1), expected, text::shown(head)));
        };
        let mut patches = Vec::new();
        for (index, line) in rows {
            let fields: Vec<Option<f64>> = line.split(',').map(|word| word.trim().parse().ok()).collect();
            let read = |columns: [usize; 3]| -> Option<DVec3> {
                let [a, b, c] = columns.map(|column| fields.get(column).copied().flatten());
                Some(DVec3::new(a?, b?, c?)).filter(|read| read.is_finite() && read.min_element() >= 0.0)
            };
            let (Some(rgb), Some(colour)) = (read(camera), read(seen)) else {
                return Err(fail(
                    Some(index + 1),
                    "numbers from 0 on in those columns",
                    text::shown(line),
                ));
            };
            if is_coded && colour.max_element() > 255.0 {
                return Err(fail(Some(index + 1), "sRGB from 0 to 255", text::shown(line)));
            }
            let xyz = if is_coded {
                SRGB_TO_XYZ * (colour / 255.0).map(decoded)
            } else {
                colour
            };
            if xyz.max_element() > 2.0 {
                let expected = "X, Y, Z of which Y = 1 is a perfect diffuser";
                return Err(fail(Some(index + 1), expected, text::shown(line)));
            }
            patches.push((rgb, xyz));
        }
        Self::of(&patches).map_err(|(expected, found)| fail(None, expected, found))
    }

    /// Fits the matrix to `patches`: the camera's channels and XYZ of each.
    fn of(patches: &[(DVec3, DVec3)]) -> Result<Self, (&'static str, String)> {
        if patches.len() < FEWEST {
            return Err(("at least 4 patches", patches.len().to_string()));
        }
        let outer = |a: DVec3, b: DVec3| DMat3::from_cols(a * b.x, a * b.y, a * b.z);
        let (mut moments, mut products) = (DMat3::ZERO, DMat3::ZERO);
        for &(rgb, xyz) in patches {
            let weight = xyz.y.max(DARKEST).powi(-2);
            moments += weight * outer(rgb, rgb);
            products += weight * outer(xyz, rgb);
        }
        let independent = moments.x_axis.x * moments.y_axis.y * moments.z_axis.z;
        if moments.determinant() <= SINGULAR * independent {
            return Err((
                "patches of different colours",
                "patches whose channels depend on each other".to_owned(),
            ));
        }
        let to_xyz = products * moments.inverse();
        let (mut sum, mut largest, mut squares, mut count) = (0.0, 0.0, 0.0, 0.0);
        for &(rgb, xyz) in patches {
            let found = to_xyz * rgb;
            let difference = lab(found).distance(lab(xyz));
            sum += difference;
            largest = f64::max(largest, difference);
            squares += ((found.y - xyz.y) / xyz.y.max(DARKEST)).powi(2);
            count += 1.0;
        }
        let matrix = SRGB_TO_XYZ.inverse() * to_xyz;
        Ok(Self {
            matrix: matrix.transpose().to_cols_array_2d(),
            patches: patches.len(),
            delta_e: [sum / count, largest],
            relative_luminance: f64::sqrt(squares / count),
        })
    }

    /// `picture` in linear sRGB. Colours that no screen has keep numbers below 0.
    #[must_use]
    pub fn shown(&self, mut picture: Picture) -> Picture {
        let matrix = DMat3::from_cols_array_2d(&self.matrix).transpose();
        let (Content::Pixels(values) | Content::Columns { radiance: values, .. }) = &mut picture.content;
        for rgb in values.iter_mut().flatten().flatten() {
            *rgb = (matrix * DVec3::from_array(rgb.map(f64::from)))
                .as_vec3()
                .to_array();
        }
        picture
    }

    /// In words.
    #[must_use]
    pub fn words(&self) -> String {
        let [mean, largest] = self.delta_e;
        format!(
            "sRGB by a matrix from {} patches: ΔE*ab {mean:.2} on the mean, {largest:.2} at most; luminance {:.2} % (root mean square)",
            self.patches,
            100.0 * self.relative_luminance
        )
    }
}

/// Linear light of an sRGB number from 0 to 1 (IEC 61966-2-1).
fn decoded(coded: f64) -> f64 {
    if coded <= 0.040_45 {
        coded / 12.92
    } else {
        ((coded + 0.055) / 1.055).powf(2.4)
    }
}

/// CIE 1976 L*, a*, b* of XYZ (ISO/CIE 11664-4).
fn lab(xyz: DVec3) -> DVec3 {
    let f = (xyz / WHITE).map(|t| {
        if t > (6.0_f64 / 29.0).powi(3) {
            t.cbrt()
        } else {
            t * (29.0_f64 / 6.0).powi(2) / 3.0 + 4.0 / 29.0
        }
    });
    DVec3::new(116.0 * f.y - 16.0, 500.0 * (f.x - f.y), 200.0 * (f.y - f.z))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Colours of a screen.
    fn colours() -> impl Iterator<Item = DVec3> {
        (0..24).map(|k| {
            let k = f64::from(k);
            DVec3::new(
                (k * 0.37).fract(),
                (k * 0.61 + 0.2).fract(),
                (k * 0.83 + 0.1).fract(),
            ) * 0.9
                + 0.05
        })
    }

    #[test]
    fn a_camera_that_is_linear_in_colours_is_found_and_another_is_said_to_be_off() {
        let camera = DMat3::from_cols_array(&[0.8, 0.1, 0.05, 0.15, 0.7, 0.2, 0.02, 0.2, 0.9]);
        let patches: Vec<_> = colours().map(|rgb| (camera * rgb, SRGB_TO_XYZ * rgb)).collect();
        let found = CameraColours::of(&patches).unwrap();
        assert!(
            found.delta_e[1] < 1e-6 && found.relative_luminance < 1e-9,
            "{found:?}"
        );
        let matrix = DMat3::from_cols_array_2d(&found.matrix).transpose();
        assert!((matrix * camera).abs_diff_eq(DMat3::IDENTITY, 1e-9));
        // What no matrix undoes.
        let bent: Vec<_> = patches
            .iter()
            .map(|(rgb, xyz)| (rgb.map(|x| x.powf(1.2)), *xyz))
            .collect();
        let found = CameraColours::of(&bent).unwrap();
        assert!(
            found.delta_e[0] > 1.0 && found.delta_e[1] > found.delta_e[0],
            "{found:?}"
        );
        let grey: Vec<_> = patches
            .iter()
            .map(|(rgb, xyz)| (DVec3::splat(rgb.y), *xyz))
            .collect();
        assert!(CameraColours::of(&grey).is_err() && CameraColours::of(&patches[..3]).is_err());
    }

    #[test]
    fn lab_of_known_colours_is_that_of_the_standard() {
        // sRGB red: L* 53.24, a* 80.09, b* 67.20 (D65).
        let red = lab(SRGB_TO_XYZ * DVec3::X);
        assert!(red.distance(DVec3::new(53.24, 80.09, 67.20)) < 0.05, "{red}");
        assert!(lab(SRGB_TO_XYZ * DVec3::ONE).distance(DVec3::new(100.0, 0.0, 0.0)) < 0.02);
    }
}
