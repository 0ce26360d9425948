//! Zemax' tabular BSDF (`.bsdf`, text): scatter about the specular direction.
//!
//! Rykowski, "BSDF data interchange file format specification" (Radiant Imaging, 2008). Lines that begin with # are remarks; then
//!
//! | line | content |
//! |---|---|
//! | `Source` | Measured |
//! | `Symmetry` | ASymmetrical4D; of one sample rotation ASymmetrical, or PlaneSymmetrical (azimuths 0 to 180) |
//! | `SpectralContent` | Monochrome |
//! | `ScatterType` | BRDF |
//! | `SampleRotation n`, `AngleOfIncidence n`, `ScatterAzimuth n`, `ScatterRadial n` | each followed by a line of n angles in degrees |
//! | `Monochrome`, `DataBegin` | then for each rotation and each angle of incidence |
//! | `TIS x` | total integrated scatter |
//! | numbers | f in sr⁻¹, a line per azimuth, radial angles along it; 0 below the horizon |
//! | `DataEnd` | |
//!
//! No cosine is in f. The radial angle is that from the specular direction; the azimuth about it is 0 towards the normal and grows
//! counter-clockwise as seen by who looks at the sample from there. The specification leaves open where +x of the sample lies: taken
//! here, light comes from φ = rotation − 90° (so that at 0° the normal of the plane of incidence is +x) and goes to φ = rotation + 90°.
//! One number for all colours: the luminance of the channels (Rec. 709 weights).

use std::fmt::Write as _;
use std::path::Path;

use glam::DVec3;

use super::table::{WIDEST_DEG, are_angles, around, polar, steps};
use super::{ExportError, Exporting, Resolution, luminance, reading};
use crate::base::text::shown;
use crate::brdf::sample::{Outgoing, Sample, SampleError};
use crate::hemisphere::direction::{from_degrees, is_above_horizon, to_degrees};

/// Steps of rotations and azimuths, and of angles of incidence, if nobody says otherwise, degrees.
const STEP_DEG: f64 = 15.0;
/// Largest angle of incidence that is written.
const LAST_DEG: f64 = 85.0;
/// Radial angles that are written: fine where gloss is.
const RADIAL_DEG: [f64; 31] = [
    0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 7.0, 9.0, 12.0, 15.0, 20.0, 25.0, 30.0, 35.0, 40.0, 45.0, 50.0, 55.0, 60.0,
    65.0, 70.0, 80.0, 90.0, 100.0, 110.0, 120.0, 130.0, 140.0, 150.0, 165.0, 180.0,
];
/// Most numbers of a file that is written or read: text is for small tables.
const MOST: usize = 20_000_000;
/// Bytes of the largest file that is read.
const MOST_BYTES: u64 = 500_000_000;

/// A material of such a file.
#[derive(Debug)]
pub struct Zemax {
    /// Degrees: rotations, angles of incidence, azimuths, radial angles.
    axes: [Vec<f64>; 4],
    is_mirrored: bool,
    /// f in sr⁻¹, as the axes.
    f: Vec<f32>,
}

/// The specular direction of light at this angle of incidence and rotation, and the axes of azimuth 0 and 90° about it.
fn frame(incidence_deg: f64, rotation_deg: f64) -> [DVec3; 3] {
    let specular = from_degrees(incidence_deg, rotation_deg + 90.0);
    let back = from_degrees(90.0 - incidence_deg, rotation_deg - 90.0);
    [specular, back, specular.cross(back)]
}

/// The direction of view at an azimuth and a radial angle, degrees.
fn view([specular, toward, across]: [DVec3; 3], azimuth_deg: f64, radial_deg: f64) -> DVec3 {
    let (azimuth, radial) = (azimuth_deg.to_radians(), radial_deg.to_radians());
    radial.cos() * specular + radial.sin() * (azimuth.cos() * toward + azimuth.sin() * across)
}

/// Lines of a file that say something.
struct Lines<'a> {
    path: &'a Path,
    text: &'a str,
}

impl<'a> Lines<'a> {
    /// The next line that is neither empty nor a remark; an empty one behind the last.
    fn take(&mut self) -> &'a str {
        while !self.text.is_empty() {
            let (line, rest) = self.text.split_once('\n').unwrap_or((self.text, ""));
            self.text = rest;
            let line = line.trim();
            if !line.is_empty() && !line.starts_with('#') {
                return line;
            }
        }
        ""
    }

    /// What stands behind the word `field` on the next line.
    fn value(&mut self, field: &str) -> Result<&'a str, SampleError> {
        let line = self.take();
        let mut words = line.split_whitespace();
        if words.next().is_some_and(|word| word.eq_ignore_ascii_case(field)) {
            Ok(words.next().unwrap_or(""))
        } else {
            Err(self.wrong(field, &format!("a line {field}"), line))
        }
    }

    /// As many ascending angles as the line `field` says, up to `last` degrees.
    fn angles(&mut self, field: &str, last: f64) -> Result<Vec<f64>, SampleError> {
        let count = self.value(field)?.parse().ok();
        let line = self.take();
        let all = numbers(line).filter(|all| Some(all.len()) == count && are_angles(all, last));
        let expected = format!("as many ascending angles as it says, from 0 to {last}°");
        all.ok_or_else(|| self.wrong(field, &expected, line))
    }

    fn wrong(&self, field: &str, expected: &str, found: &str) -> SampleError {
        reading::wrong(self.path, field, expected, &shown(found))
    }
}

impl Zemax {
    /// Reads the file at `path`.
    ///
    /// # Errors
    /// [`SampleError`] with path, field, expected and found.
    pub fn open(path: &Path) -> Result<Self, SampleError> {
        let text = reading::text(path, MOST_BYTES)?;
        let mut lines = Lines { path, text: &text };
        lines.value("Source")?;
        let symmetry = lines.value("Symmetry")?.to_ascii_lowercase();
        if !["asymmetrical4d", "asymmetrical", "planesymmetrical"].contains(&symmetry.as_str()) {
            let expected = "ASymmetrical4D, ASymmetrical or PlaneSymmetrical";
            return Err(lines.wrong("Symmetry", expected, &symmetry));
        }
        for (field, expected) in [("SpectralContent", "Monochrome"), ("ScatterType", "BRDF")] {
            let found = lines.value(field)?;
            if !found.eq_ignore_ascii_case(expected) {
                return Err(lines.wrong(field, expected, found));
            }
        }
        let axes = [
            lines.angles("SampleRotation", 360.0)?,
            lines.angles("AngleOfIncidence", 90.0)?,
            lines.angles("ScatterAzimuth", 360.0)?,
            lines.angles("ScatterRadial", 180.0)?,
        ];
        let lengths = [0, 1, 2, 3].map(|axis| axes[axis].len());
        let count = lengths.into_iter().fold(1, usize::saturating_mul);
        if count > MOST {
            return Err(lines.wrong(
                "DataBegin",
                &format!("at most {MOST} numbers"),
                &count.to_string(),
            ));
        }
        let is_mirrored = symmetry == "planesymmetrical";
        let is_around = |angles: &[f64]| {
            let gaps = angles.windows(2).map(|two| two[1] - two[0]);
            let last = if is_mirrored { 180.0 } else { 360.0 } - (angles[angles.len() - 1] - angles[0]);
            gaps.chain([last]).all(|gap| gap <= WIDEST_DEG)
        };
        if !is_around(&axes[2]) || axes[0].len() > 1 && !is_around(&axes[0]) {
            let expected = format!("azimuths and rotations all around, at most {WIDEST_DEG}° apart");
            return Err(lines.wrong("ScatterAzimuth", &expected, "others"));
        }
        lines.value("Monochrome")?;
        lines.value("DataBegin")?;
        let mut f = Vec::new();
        for _ in 0..lengths[0] * lengths[1] {
            lines.value("TIS")?;
            for _ in 0..lengths[2] {
                let line = lines.take();
                let row = numbers(line).filter(|row| row.len() == lengths[3]);
                let row =
                    row.ok_or_else(|| lines.wrong("data", &format!("{} numbers a line", lengths[3]), line))?;
                f.extend(row.into_iter().map(|f| f as f32));
            }
        }
        let mut zemax = Self { axes, is_mirrored, f };
        zemax.forget_below();
        Ok(zemax)
    }

    /// Takes away what stands for directions below the horizon: it is none.
    fn forget_below(&mut self) {
        let [rotations, incidences, azimuths, radials] = &self.axes;
        let mut values = self.f.iter_mut();
        for rotation in rotations {
            for incidence in incidences {
                let frame = frame(*incidence, *rotation);
                for azimuth in azimuths {
                    for (radial, value) in radials.iter().zip(&mut values) {
                        if view(frame, *azimuth, *radial).z <= 0.0 {
                            *value = f32::NAN;
                        }
                    }
                }
            }
        }
    }
}

/// The numbers of a line; `None` if one is not finite, or no number.
fn numbers(line: &str) -> Option<Vec<f64>> {
    let parsed = line
        .split_whitespace()
        .map(|word| word.parse().ok().filter(|n: &f64| n.is_finite()));
    parsed.collect()
}

impl Sample for Zemax {
    fn incident(&self, wi: DVec3) -> Box<dyn Outgoing + '_> {
        let (theta_deg, phi_deg) = to_degrees(wi);
        let rotation_deg = if self.axes[0].len() > 1 {
            phi_deg + 90.0
        } else {
            self.axes[0][0]
        };
        let mut rows = Vec::with_capacity(4);
        if is_above_horizon(wi) {
            for (r, a) in around(&self.axes[0], rotation_deg) {
                for (i, b) in polar(&self.axes[1], theta_deg) {
                    if a * b > 0.0 {
                        rows.push((r * self.axes[1].len() + i, a * b));
                    }
                }
            }
        }
        Box::new(Lit {
            table: self,
            frame: frame(theta_deg, phi_deg + 90.0),
            rows,
            above: is_above_horizon(wi),
        })
    }

    fn is_isotropic(&self) -> bool {
        self.axes[0].len() == 1
    }
}

struct Lit<'a> {
    table: &'a Zemax,
    frame: [DVec3; 3],
    rows: Vec<(usize, f64)>,
    above: bool,
}

impl Outgoing for Lit<'_> {
    fn f(&self, wo: DVec3) -> [f64; 3] {
        if !self.above || !is_above_horizon(wo) {
            return [0.0; 3];
        }
        let [_, _, azimuths, radials] = &self.table.axes;
        let [specular, toward, across] = self.frame;
        let radial_deg = wo.dot(specular).clamp(-1.0, 1.0).acos().to_degrees();
        let azimuth_deg = wo.dot(across).atan2(wo.dot(toward)).to_degrees();
        // Of two halves that are alike one stands there.
        let azimuth_deg = if self.table.is_mirrored {
            azimuth_deg.abs()
        } else {
            azimuth_deg
        };
        let (mut sum, mut weight) = (0.0, 0.0);
        for &(row, a) in &self.rows {
            for (z, b) in around(azimuths, azimuth_deg) {
                for (r, c) in polar(radials, radial_deg) {
                    let value = f64::from(self.table.f[(row * azimuths.len() + z) * radials.len() + r]);
                    let part = a * b * c;
                    if part > 0.0 && value.is_finite() {
                        sum += part * value;
                        weight += part;
                    }
                }
            }
        }
        [if weight > 0.0 { sum / weight } else { f64::NAN }; 3]
    }
}

/// The lines before the data, of these rotations, angles of incidence and azimuths.
fn head(description: &str, axes: [&[f64]; 3]) -> String {
    let names = [
        "SampleRotation",
        "AngleOfIncidence",
        "ScatterAzimuth",
        "ScatterRadial",
    ];
    let mut text = format!(
        "# {}\nSource\tMeasured\nSymmetry\tASymmetrical4D\nSpectralContent\tMonochrome\nScatterType\tBRDF\n",
        crate::base::text::plain(description)
    );
    for (name, angles) in names.into_iter().zip(axes.into_iter().chain([&RADIAL_DEG[..]])) {
        let words: Vec<String> = angles.iter().map(f64::to_string).collect();
        writeln!(text, "{name}\t{}\n{}", angles.len(), words.join("\t")).expect("strings take everything");
    }
    text.push_str("\nMonochrome\nDataBegin\n");
    text
}

/// Writes the file.
pub(super) fn write(exporting: &Exporting, resolution: Resolution) -> Result<(), ExportError> {
    let step_deg = if resolution.step_deg > 0.0 {
        resolution.step_deg
    } else {
        STEP_DEG
    };
    let around = steps(360.0, step_deg, true);
    let rotations = if exporting.is_isotropic() {
        vec![0.0]
    } else {
        around.clone()
    };
    let incidences = steps(LAST_DEG, step_deg, true);
    let count = rotations.len() * incidences.len() * around.len() * RADIAL_DEG.len();
    if count > MOST {
        let found = format!("{count}, which a wider step makes fewer");
        return Err(exporting.refused("resolution", format!("at most {MOST} numbers"), found));
    }
    exporting.check_visible()?;
    let mut text = head(&exporting.description(), [&rotations, &incidences, &around]);
    let slices = rotations.len() * incidences.len();
    exporting.progress.begin("export", slices, "incident directions");
    let at_once = (exporting.at_once() / (around.len() * RADIAL_DEG.len())).max(1);
    for first in (0..slices).step_by(at_once) {
        let range = first..(first + at_once).min(slices);
        let lit: Vec<(DVec3, Vec<DVec3>)> = range
            .clone()
            .map(|slice| {
                let rotation = rotations[slice / incidences.len()];
                lit(incidences[slice % incidences.len()], rotation, &around)
            })
            .collect();
        let above = |(wi, views): &(DVec3, Vec<DVec3>)| {
            let wi = *wi;
            let above = views.clone().into_iter().filter(|wo| is_above_horizon(*wo));
            above.map(move |wo| (wi, wo))
        };
        let pairs: Vec<_> = lit.iter().flat_map(above).collect();
        let mut found = exporting.values(&pairs)?.into_iter();
        let mut next = || found.next().flatten().map_or(0.0, luminance);
        for (_, views) in &lit {
            let f = views
                .iter()
                .map(|wo| if is_above_horizon(*wo) { next() } else { 0.0 });
            write_slice(&mut text, &f.collect::<Vec<f64>>(), views, &around);
        }
        exporting.progress.reach(range.end);
    }
    exporting.check_whole(resolution.zeros)?;
    text.push_str("DataEnd\n");
    exporting.write_whole(text.as_bytes())
}

/// The direction of light at an incidence of a sample that is turned, and those of view [azimuth, radial].
fn lit(incidence_deg: f64, rotation_deg: f64, around: &[f64]) -> (DVec3, Vec<DVec3>) {
    let frame = frame(incidence_deg, rotation_deg);
    let views = around.iter().flat_map(|azimuth| {
        RADIAL_DEG
            .iter()
            .map(move |radial| view(frame, *azimuth, *radial))
    });
    (from_degrees(incidence_deg, rotation_deg - 90.0), views.collect())
}

/// f of a table [azimuth, radial].
fn write_slice(text: &mut String, f: &[f64], views: &[DVec3], around: &[f64]) {
    writeln!(text, "TIS\t{:.6}", scattered(f, views, around)).expect("strings take everything");
    for row in f.chunks(RADIAL_DEG.len()) {
        let words: Vec<String> = row.iter().map(|f| format!("{f:.5e}")).collect();
        writeln!(text, "{}", words.join("\t")).expect("strings take everything");
    }
}

/// ∫ f·cosθo dωo over a table [azimuth, radial] of f, by trapezoids.
fn scattered(f: &[f64], views: &[DVec3], azimuths: &[f64]) -> f64 {
    let radials = RADIAL_DEG.map(f64::to_radians);
    let at = |azimuth: usize, radial: usize| {
        let place = azimuth * radials.len() + radial;
        f[place] * views[place].z.max(0.0) * radials[radial].sin()
    };
    let mut sum = 0.0;
    for azimuth in 1..azimuths.len() {
        let across = (azimuths[azimuth] - azimuths[azimuth - 1]).to_radians();
        for radial in 1..radials.len() {
            let corners = at(azimuth - 1, radial - 1)
                + at(azimuth, radial - 1)
                + at(azimuth - 1, radial)
                + at(azimuth, radial);
            sum += corners / 4.0 * across * (radials[radial] - radials[radial - 1]);
        }
    }
    sum
}
