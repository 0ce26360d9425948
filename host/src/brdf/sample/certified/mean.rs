//! One certificate of several that different laboratories, or years, have given of the same plate.
//!
//! # Design
//! The mean is weighted by 1/u², and where the certificates scatter by more than they state its uncertainty grows by as much as they do (R. T.
//! Birge, *The calculation of errors by the method of least squares*, Phys. Rev. 40, 207, 1932). Laboratories take their scales from one
//! another, and who does from whom no certificate says: so the mean is taken to be no better than the best of them, unless somebody says that
//! they are independent. Certificates of which one is off by more than [`FARTHEST`] of what both sides state are no basis of a mean.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use super::Certified;
use super::geometry::Geometry;
use super::read::{self, AngularFile, CertificateFile, content};
use crate::brdf::sample::SampleError;

/// Standard uncertainties by which a certificate may be off the mean of the others.
const FARTHEST: f64 = 3.0;

/// Several certificates made one.
#[derive(Clone, Debug, PartialEq)]
pub struct Mean {
    /// The file of the mean (TOML).
    pub text: String,
    /// Scatter of the certificates about the mean over what they state of it, the largest of all channels or wavelengths.
    pub birge_ratio: f64,
}

/// What one file says in one channel, or at one wavelength: value and standard uncertainty (k = 1).
type Entry = [f64; 2];

/// A certificate with its file.
struct Read {
    path: PathBuf,
    file: CertificateFile,
    geometry: Geometry,
    sha256: String,
}

impl Read {
    fn open(path: &Path) -> Result<Self, SampleError> {
        let (file, sha256) = read::open(path)?;
        // It has to be right by itself.
        Certified::of(&file, path, sha256.clone())?;
        Ok(Self {
            geometry: file.geometry(path)?,
            path: path.to_owned(),
            file,
            sha256,
        })
    }

    fn entries(&self) -> Vec<Entry> {
        let file = &self.file;
        match (&file.value, &file.expanded_uncertainty) {
            (Some(value), Some(expanded)) => {
                let of = |at: usize| expanded.0.get(at).unwrap_or(&expanded.0[0]) / file.k;
                value
                    .0
                    .iter()
                    .enumerate()
                    .map(|(at, value)| [*value, of(at)])
                    .collect()
            }
            _ => file
                .spectrum
                .iter()
                .map(|line| [line.value, line.expanded_uncertainty / file.k])
                .collect(),
        }
    }

    /// What has to be the same in all, by the name of its field.
    fn same(&self) -> [(&'static str, String); 6] {
        let file = &self.file;
        let wavelengths = file.spectrum.iter().map(|line| line.wavelength_nm);
        [
            ("serial", file.serial.clone().unwrap_or_else(|| "none".to_owned())),
            (
                "geometry",
                format!("{} of {}", self.geometry, self.geometry.quantity.name()),
            ),
            (
                "value",
                format!("{} of them", file.value.as_ref().map_or(0, |value| value.0.len())),
            ),
            ("spectrum", format!("{} nm", list(wavelengths))),
            ("bands_nm", bands(file)),
            (
                "angular",
                file.angular
                    .as_ref()
                    .map_or_else(|| "none".to_owned(), |stated| angular(stated).replace('\n', " ")),
            ),
        ]
    }
}

/// The weighted mean of the certificates at `paths`, which are of the same plate; `are_independent` if somebody knows that no two of the
/// laboratories share a scale.
///
/// # Errors
/// [`SampleError`] if one cannot be read, is of another plate, geometry or wavelengths, or does not agree with the others.
pub fn mean_of(paths: &[PathBuf], are_independent: bool) -> Result<Mean, SampleError> {
    let all = paths
        .iter()
        .map(|path| Read::open(path))
        .collect::<Result<Vec<_>, _>>()?;
    check(&all)?;
    let entries: Vec<Vec<Entry>> = all.iter().map(Read::entries).collect();
    let (mut means, mut birge_ratio) = (Vec::new(), 0.0_f64);
    for at in 0..entries[0].len() {
        let of: Vec<Entry> = entries.iter().map(|entries| entries[at]).collect();
        let weight: f64 = of.iter().map(|[_, u]| u.powi(-2)).sum();
        let mean = of.iter().map(|[value, u]| value / u.powi(2)).sum::<f64>() / weight;
        let off = of.iter().enumerate().map(|(at, [value, u])| {
            // From the mean of the others.
            let rest = weight - u.powi(-2);
            let other = (mean * weight - value / u.powi(2)) / rest;
            (at, other, (value - other) / u.hypot(rest.recip().sqrt()))
        });
        if let Some((at, other, off)) = off.max_by(|a, b| a.2.abs().total_cmp(&b.2.abs()))
            && off.abs() > FARTHEST
        {
            let expected =
                format!("{other:.5} as the other certificates have it, to {FARTHEST} standard uncertainties");
            let found = format!("{}, {off:+.1} standard uncertainties off", of[at][0]);
            return Err(content(&all[at].path, "value", &expected, found));
        }
        let scatter: f64 = of.iter().map(|[value, u]| ((value - mean) / u).powi(2)).sum();
        let birge = (scatter / (of.len() - 1) as f64).sqrt();
        birge_ratio = birge_ratio.max(birge);
        let best = of.iter().map(|[_, u]| *u).fold(f64::INFINITY, f64::min);
        let of_mean = weight.recip().sqrt() * birge.max(1.0);
        means.push([
            mean,
            if are_independent {
                of_mean
            } else {
                of_mean.max(best)
            },
        ]);
    }
    Ok(Mean {
        text: text(&all, &means, birge_ratio, are_independent),
        birge_ratio,
    })
}

/// Refuses certificates that are not of one plate, or not of one time.
fn check(all: &[Read]) -> Result<(), SampleError> {
    let (first, others) = match all {
        [first, others @ ..] if !others.is_empty() => (first, others),
        _ => {
            let expected = "two or more of one plate";
            return Err(content(Path::new("certificates"), "count", expected, all.len()));
        }
    };
    if first.file.serial.is_none() {
        let expected =
            "the serial number of the plate, by which certificates are known to be of the same one";
        return Err(content(&first.path, "serial", expected, "nothing"));
    }
    for other in others {
        if let Some(((field, expected), (_, found))) =
            first.same().into_iter().zip(other.same()).find(|(a, b)| a != b)
        {
            let expected = crate::base::text::shown(&expected);
            let expected = format!("as in {}, {expected}", first.path.display());
            let found = crate::base::text::shown(&found);
            return Err(content(&other.path, field, &expected, found));
        }
        if all.iter().filter(|one| one.sha256 == other.sha256).count() > 1 {
            return Err(content(
                &other.path,
                "certificate",
                "another one than before",
                "the same file",
            ));
        }
    }
    let latest = all.iter().map(|one| one.file.calibrated.0).max();
    for one in all {
        if let Some(expires) = one
            .file
            .expires
            .as_ref()
            .filter(|expires| Some(expires.0) <= latest)
        {
            let expected = "a day after the latest of the calibrations, so that all hold at the same time";
            return Err(content(&one.path, "expires", expected, expires.0));
        }
    }
    Ok(())
}

/// The file of the mean.
fn text(all: &[Read], means: &[Entry], birge_ratio: f64, are_independent: bool) -> String {
    let file = &all[0].file;
    let joined = |of: fn(&CertificateFile) -> &str| {
        let mut names: Vec<&str> = Vec::new();
        for one in all {
            let name = of(&one.file);
            if !names.contains(&name) {
                names.push(name);
            }
        }
        let joined = names.join(", ");
        if joined.chars().count() > 100 {
            format!("{} laboratories or numbers", names.len())
        } else {
            joined
        }
    };
    let quoted = |text: &str| toml::Value::from(text).to_string();
    let mut text = String::new();
    let mut line = |line: &str| writeln!(text, "{line}").expect("strings take everything");
    line("# The weighted mean of several certificates of one plate, made by `rcg standard`:");
    for one in all {
        line(&format!(
            "#   {} of {}, SHA-256 {}",
            one.file.certificate, one.file.laboratory, one.sha256
        ));
    }
    let known = if are_independent {
        "independent, as somebody said"
    } else {
        "no better than the best of them"
    };
    line(&format!("# Birge ratio {birge_ratio:.2}; taken for {known}."));
    line("version = 1");
    line(&format!("name = {}", quoted(&file.name)));
    if let Some(serial) = &file.serial {
        line(&format!("serial = {}", quoted(serial)));
    }
    line(&format!(
        "certificate = {}",
        quoted(&format!("mean of {}", joined(|file| &file.certificate)))
    ));
    line(&format!(
        "laboratory = {}",
        quoted(&joined(|file| &file.laboratory))
    ));
    // It holds from when the last was given until the first ends.
    let calibrated = all.iter().map(|one| one.file.calibrated.0).max();
    line(&format!(
        "calibrated = {}",
        calibrated.unwrap_or(file.calibrated.0)
    ));
    if let Some(expires) = all
        .iter()
        .filter_map(|one| one.file.expires.as_ref().map(|day| day.0))
        .min()
    {
        line(&format!("expires = {expires}"));
    }
    line(&format!("quantity = {}", quoted(&file.quantity)));
    line(&format!("geometry = {}", quoted(&all[0].geometry.to_string())));
    line("k = 1");
    line(&values(file, means));
    if let Some(stated) = &file.angular {
        line(&format!("[angular]\n{}", angular(stated)));
    }
    text
}

/// The content of the table `angular`.
fn angular(stated: &AngularFile) -> String {
    let mut text = format!("standard_uncertainty = {}\n", stated.standard_uncertainty);
    for (name, number) in [("correlation", stated.correlation), ("to_deg", stated.to_deg)] {
        if let Some(number) = number {
            writeln!(text, "{name} = {number}").expect("strings take everything");
        }
    }
    if !stated.values.is_empty() {
        text.push_str("values = [\n");
        for of in &stated.values {
            writeln!(
                text,
                "  {{ incident_deg = {}, outgoing_deg = {}, ratio = {} }},",
                of.incident_deg, of.outgoing_deg, of.ratio
            )
            .expect("strings take everything");
        }
        text.push_str("]\n");
    }
    text
}

/// The lines that hold values and uncertainties.
fn values(file: &CertificateFile, means: &[Entry]) -> String {
    if file.spectrum.is_empty() {
        let all = |of: usize| {
            let numbers = list(means.iter().map(|mean| mean[of]));
            if means.len() == 1 {
                numbers
            } else {
                format!("[{numbers}]")
            }
        };
        return format!("value = {}\nexpanded_uncertainty = {}", all(0), all(1));
    }
    let mut text = format!("bands_nm = {}\nspectrum = [\n", bands(file));
    for (of, [value, u]) in file.spectrum.iter().zip(means) {
        let nm = of.wavelength_nm;
        writeln!(
            text,
            "  {{ wavelength_nm = {nm}, value = {value}, expanded_uncertainty = {u} }},"
        )
        .expect("strings take everything");
    }
    text + "]"
}

/// Numbers as TOML has them in a list.
fn list(numbers: impl Iterator<Item = f64>) -> String {
    numbers
        .map(|number| number.to_string())
        .collect::<Vec<_>>()
        .join(", ")
}

/// The wavelengths of `bands_nm`.
fn bands(file: &CertificateFile) -> String {
    let each = file.bands_nm.iter().flatten();
    let each: Vec<String> = each
        .map(|band| format!("[{}]", list(band.iter().copied())))
        .collect();
    format!("[{}]", each.join(", "))
}
