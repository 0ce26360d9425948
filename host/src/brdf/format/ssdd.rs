//! Surface scattering distribution data (`.ssdd`), version 0.3, of the library libbsdf: a dense table over four angles.
//!
//! Lines of text, then binary numbers:
//!
//! | line | content |
//! |---|---|
//! | `VERSION` | 0.3 |
//! | `DATA_TYPE` | brdf |
//! | `COLOR_MODEL` | rgb, or monochrome |
//! | `PARAM_TYPE` | spherical_coordinate_system |
//! | `PARAM0_LIST` … `PARAM3_LIST` | θi, φi, θo, φo in degrees, ascending; azimuths with 0 and 360, or φi = 0 alone of an isotropic sample, φo then counts from it |
//! | `SOURCE_TYPE` | measured, or generated |
//! | `DATA binary` | the last line |
//!
//! Then f in sr⁻¹ as little-endian f32, channels together, entry p0 + n0·(p1 + n1·(p2 + n2·p3)). No cosine is in it; a missing value is NaN.

use std::io::{BufWriter, Write as _};
use std::path::Path;

use glam::DVec3;

use super::table::{Axes, Tabulated, are_angles};
use super::{ExportError, Exporting, Resolution, reading};
use crate::base::text::shown;
use crate::brdf::sample::SampleError;

/// Step of the angles if nobody says otherwise, degrees; never finer than the source.
const STEP_DEG: f64 = 5.0;
/// Bytes of the largest file that is read.
const MOST_BYTES: u64 = 2_000_000_000;
/// The last line of text.
const DATA: &[u8] = b"DATA binary\n";

/// Reads the file at `path`.
pub(super) fn open(path: &Path) -> Result<Tabulated, SampleError> {
    let bytes = reading::bytes(path, MOST_BYTES)?;
    let wrong = |field: &str, expected: &str, found: &str| reading::wrong(path, field, expected, found);
    let end = bytes
        .windows(DATA.len())
        .position(|window| window == DATA)
        .ok_or_else(|| wrong("DATA", "a line `DATA binary`", "none"))?;
    let header = String::from_utf8_lossy(&bytes[..end]);
    let line = |key: &str| {
        let mut lines = header
            .lines()
            .filter_map(|line| line.split_once(char::is_whitespace));
        lines
            .find(|(name, _)| *name == key)
            .map(|(_, value)| value.trim())
    };
    let required = |key: &str, expected: &[&str]| {
        let found = line(key).unwrap_or("");
        if expected.iter().any(|one| found.eq_ignore_ascii_case(one)) {
            Ok(found.to_ascii_lowercase())
        } else {
            Err(wrong(key, &expected.join(" or "), &shown(found)))
        }
    };
    required("DATA_TYPE", &["brdf"])?;
    required("PARAM_TYPE", &["spherical_coordinate_system"])?;
    let channels = if required("COLOR_MODEL", &["rgb", "monochrome"])? == "rgb" {
        3
    } else {
        1
    };
    let angles = |key: &str, last: f64| -> Result<Vec<f64>, SampleError> {
        let text = line(key).ok_or_else(|| wrong(key, "a list of angles in degrees", "none"))?;
        let parsed: Result<Vec<f64>, _> = text.split_whitespace().map(str::parse).collect();
        let all = parsed.map_err(|_| wrong(key, "numbers of degrees", &shown(text)))?;
        if are_angles(&all, last) {
            Ok(all)
        } else {
            Err(wrong(
                key,
                &format!("ascending angles from 0 to {last}°"),
                &shown(text),
            ))
        }
    };
    let axes = Axes {
        theta_i: angles("PARAM0_LIST", 90.0)?,
        phi_i: angles("PARAM1_LIST", 360.0)?,
        theta_o: angles("PARAM2_LIST", 90.0)?,
        phi_o: angles("PARAM3_LIST", 360.0)?,
    };
    if let Some(flaw) = axes.flaw() {
        return Err(wrong(
            "PARAM_LIST",
            "angles that can be interpolated between",
            &flaw,
        ));
    }
    let data = &bytes[end + DATA.len()..];
    let expected = axes.len().saturating_mul(4 * channels);
    if data.len() != expected {
        return Err(wrong(
            "DATA",
            &format!("{expected} bytes"),
            &format!("{} bytes", data.len()),
        ));
    }
    let mut f = vec![[f32::NAN; 3]; axes.len()];
    let number = own_number(&axes);
    for (place, values) in data.chunks_exact(4 * channels).enumerate() {
        let value = |channel: usize| {
            let at = 4 * channel.min(channels - 1);
            f32::from_le_bytes(values[at..at + 4].try_into().expect("invariant: four bytes"))
        };
        f[number(place)] = [value(0), value(1), value(2)];
    }
    Ok(Tabulated::new(axes, f))
}

/// The number in the order of [`Axes`] of an entry of the file.
fn own_number(axes: &Axes) -> impl Fn(usize) -> usize + Sync + use<> {
    let [n0, n1, n2, n3] = axes.shape();
    move |place: usize| {
        let (p0, p1) = (place % n0, place / n0 % n1);
        let (p2, p3) = (place / (n0 * n1) % n2, place / (n0 * n1 * n2));
        ((p0 * n1 + p1) * n2 + p2) * n3 + p3
    }
}

/// Writes the table.
pub(super) fn write(exporting: &Exporting, resolution: Resolution) -> Result<(), ExportError> {
    let axes = Axes::of(exporting, resolution, STEP_DEG, true)?;
    let list = |angles: &[f64]| {
        let words: Vec<String> = angles.iter().map(f64::to_string).collect();
        words.join(" ")
    };
    let channels = exporting.channels();
    let source = if exporting.brdf().is_some() {
        "measured"
    } else {
        "generated"
    };
    let header = format!(
        "VERSION 0.3\nSOFTWARE rcg {}\nDATA_TYPE brdf\nCOLOR_MODEL {}\nPARAM_TYPE spherical_coordinate_system\nPARAM0_LIST {}\n\
         PARAM1_LIST {}\nPARAM2_LIST {}\nPARAM3_LIST {}\nSOURCE_TYPE {source}\nDEVICE RCG\nNAME {}\n",
        env!("CARGO_PKG_VERSION"),
        if channels == 1 { "monochrome" } else { "rgb" },
        list(&axes.theta_i),
        list(&axes.phi_i),
        list(&axes.theta_o),
        list(&axes.phi_o),
        crate::base::text::plain(&exporting.description()),
    );
    let failed = |error| exporting.failed(error);
    let mut file = BufWriter::new(exporting.create()?);
    file.write_all(header.as_bytes()).map_err(failed)?;
    file.write_all(DATA).map_err(failed)?;
    let number = own_number(&axes);
    exporting
        .progress
        .begin("export", axes.len(), "pairs of directions");
    let at_once = exporting.at_once();
    for first in (0..axes.len()).step_by(at_once) {
        let range = first..(first + at_once).min(axes.len());
        let pairs: Vec<(DVec3, DVec3)> = range.clone().map(|place| axes.pair(number(place))).collect();
        for value in exporting.values(&pairs)? {
            for f in &value.unwrap_or([f32::NAN; 3])[..channels] {
                file.write_all(&f.to_le_bytes()).map_err(failed)?;
            }
        }
        exporting.progress.reach(range.end);
    }
    exporting.finish(file)
}
