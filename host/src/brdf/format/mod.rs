//! Files of other programs: what is read, what is written, and what gets lost on the way.
//!
//! # Design
//! One module per format, with its table of bytes or keys. Readers make a [`Sample`] of a file, for which all commands then serve; writers ask an
//! `Exporting` for values and stream them. What a format cannot carry is told: missing values, uncertainty, provenance, azimuths that
//! were averaged away. An export is read back, and how far it is from its source is what [`export`] answers.
//!
//! | format | reads | writes | cosine in it | missing values | uncertainty | provenance |
//! |---|---|---|---|---|---|---|
//! | `bsdf` ([`bsdf`]) | yes | yes | yes | refused, or 0 | no | no |
//! | `merl` ([`merl`]) | yes | yes, isotropic | no | −1 | no | no |
//! | `ssdd` ([`ssdd`]) | yes | yes | no | NaN | no | no |
//! | `klems` ([`klems`]) | yes | yes | no | refused, or 0 | no | no |
//! | `zemax` ([`zemax`]) | yes | yes | no | refused, or 0 | no | no |
//! | `bird` ([`bird`]) | yes | yes | no | left out | yes | yes |
//! | `npy` ([`npy`]) | yes | yes | no | NaN | yes | yes |
//! | `csv` ([`csv`]) | no | yes | no | left out | yes | yes |
//! | `exr` ([`exr`]) | no | yes, one light | no | NaN | yes | yes |
//!
//! Directions in all of them are those of the sample frame, away from the surface; where a format counts otherwise its file says how.

pub mod bird;
pub mod bsdf;
pub mod csv;
mod exporting;
pub mod exr;
pub mod info;
pub mod klems;
pub mod merl;
pub mod npy;
mod reading;
mod round_trip;
pub mod ssdd;
mod table;
#[cfg(test)]
mod tests;
pub mod zemax;

use std::path::Path;

use serde::Serialize;

use crate::base::blame::Blame;
use crate::base::progress::Progress;
use crate::brdf::Source;
use crate::brdf::sample::{MeasuredRgl, Sample, SampleError};
use crate::store::StoreError;
use crate::store::whole_file::FileError;

pub use bsdf::{Form, Tabulation};
pub use exporting::About;
use exporting::Exporting;
pub use round_trip::RoundTrip;

/// Formats of other programs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Format {
    /// Tensor file of the RGL material database, which Mitsuba reads.
    Bsdf,
    /// MERL's table over half and difference angles.
    Merl,
    /// Surface scattering distribution data of libbsdf.
    Ssdd,
    /// LBNL's window data with Klems' patches.
    Klems,
    /// Zemax' tabular BSDF.
    Zemax,
    /// Universal BRDF format of the European metrology project `BiRD`.
    Bird,
    /// Records of NumPy.
    Npy,
    /// A table of text.
    Csv,
    /// A picture of the outgoing hemisphere.
    Exr,
}

impl Format {
    /// All of them.
    pub const ALL: [Self; 9] = [
        Self::Bsdf,
        Self::Merl,
        Self::Ssdd,
        Self::Klems,
        Self::Zemax,
        Self::Bird,
        Self::Npy,
        Self::Csv,
        Self::Exr,
    ];

    /// Its name on the command line.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Bsdf => "bsdf",
            Self::Merl => "merl",
            Self::Ssdd => "ssdd",
            Self::Klems => "klems",
            Self::Zemax => "zemax",
            Self::Bird => "bird",
            Self::Npy => "npy",
            Self::Csv => "csv",
            Self::Exr => "exr",
        }
    }

    /// How names of its files end.
    #[must_use]
    pub const fn endings(self) -> &'static [&'static str] {
        match self {
            Self::Bsdf | Self::Zemax => &["bsdf"],
            Self::Merl => &["binary"],
            Self::Ssdd => &["ssdd"],
            Self::Klems => &["xml"],
            Self::Bird => &["brdf", "json"],
            Self::Npy => &["npy"],
            Self::Csv => &["csv"],
            Self::Exr => &["exr"],
        }
    }

    /// What it is, in words.
    #[must_use]
    pub const fn words(self) -> &'static str {
        match self {
            Self::Bsdf => "RGL tensor file",
            Self::Merl => "MERL binary",
            Self::Ssdd => "surface scattering distribution data (SSDD)",
            Self::Klems => "LBNL BSDF XML with Klems' patches",
            Self::Zemax => "Zemax tabular BSDF",
            Self::Bird => "BiRD universal BRDF",
            Self::Npy => "NumPy records",
            Self::Csv => "table of text",
            Self::Exr => "OpenEXR picture of a hemisphere",
        }
    }

    /// Whether the name of `path` ends as those of one of them.
    #[must_use]
    pub fn is_named(path: &Path) -> bool {
        Self::named(path).is_some()
    }

    fn named(path: &Path) -> Option<Self> {
        let ending = path.extension()?.to_str()?;
        let is_known = |format: &Self| {
            format
                .endings()
                .iter()
                .any(|known| ending.eq_ignore_ascii_case(known))
        };
        Self::ALL.into_iter().find(is_known)
    }

    /// That of the file at `path` by its first bytes, or by its name where these say nothing; `None` of one that nobody here reads.
    ///
    /// # Errors
    /// What the system says of the file.
    pub fn of(path: &Path) -> std::io::Result<Option<Self>> {
        let head = reading::head(path)?;
        let begins = |with: &[u8]| head.starts_with(with);
        let text = String::from_utf8_lossy(&head);
        let holds = |words: &str| text.contains(words);
        Ok(if begins(b"tensor_file\0") {
            Some(Self::Bsdf)
        } else if begins(npy::MAGIC) {
            Some(Self::Npy)
        } else if merl::is_head(&head) {
            Some(Self::Merl)
        } else if holds("VERSION") && holds("DATA_TYPE") {
            Some(Self::Ssdd)
        } else if holds("<WindowElement") {
            Some(Self::Klems)
        } else if holds("Symmetry") && holds("ScatterType") || holds("\nSource\t") {
            Some(Self::Zemax)
        } else if begins(b"\x76\x2f\x31\x01") {
            Some(Self::Exr)
        } else if text.trim_start().starts_with('{') {
            Some(Self::Bird)
        } else {
            Self::named(path)
        })
    }
}

/// Opens a file of another program.
///
/// # Errors
/// [`SampleError`] with path, field, expected and found.
pub fn open(path: &Path) -> Result<Box<dyn Sample>, SampleError> {
    let format = Format::of(path).map_err(|cause| SampleError::Unreadable {
        path: path.to_owned(),
        cause,
    })?;
    Ok(match format {
        Some(Format::Merl) => Box::new(merl::Merl::open(path)?),
        Some(Format::Ssdd) => Box::new(ssdd::open(path)?),
        Some(Format::Klems) => Box::new(klems::Klems::open(path)?),
        Some(Format::Zemax) => Box::new(zemax::Zemax::open(path)?),
        Some(Format::Bird) => Box::new(bird::open(path)?),
        Some(Format::Npy) => Box::new(npy::open(path)?),
        Some(format @ (Format::Csv | Format::Exr)) => {
            return Err(reading::wrong(
                path,
                "format",
                "one that is read (bsdf, merl, ssdd, klems, zemax, bird, npy)",
                &format!("{}, which is written only", format.words()),
            ));
        }
        Some(Format::Bsdf) | None => Box::new(MeasuredRgl::open(path)?),
    })
}

/// Why a BRDF is not exported.
#[derive(Debug, thiserror::Error)]
pub enum ExportError {
    /// The source.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The file that is written.
    #[error(transparent)]
    File(#[from] FileError),
    /// The file as it is read again.
    #[error(transparent)]
    Read(#[from] SampleError),
    /// What the format cannot carry, or nobody should write.
    #[error("{path}, {field}: expected {expected}, found {found}")]
    Content {
        /// The file that was to be written.
        path: String,
        /// What of it.
        field: &'static str,
        /// What the format takes.
        expected: String,
        /// What is there.
        found: String,
    },
}

impl Blame for ExportError {
    fn is_input(&self) -> bool {
        match self {
            Self::Store(error) => error.is_input(),
            Self::File(error) => error.is_input(),
            Self::Read(_) | Self::Content { .. } => true,
        }
    }
}

/// Luminance of R, G and B as those of Rec. 709.
fn luminance([r, g, b]: [f32; 3]) -> f64 {
    0.2126 * f64::from(r) + 0.7152 * f64::from(g) + 0.0722 * f64::from(b)
}

/// How fine a table is written; 0 is the format's own choice.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Resolution {
    /// Step of polar angles and azimuths, degrees.
    pub step_deg: f64,
    /// Points along each side of a table over outgoing directions.
    pub side: usize,
    /// The one incident direction that is written, polar angle and azimuth, degrees; `None` for all. Tables of text take it, pictures need
    /// it.
    pub incident_deg: Option<[f64; 2]>,
    /// Whether a format without missing values has 0 in their place, and is not refused.
    pub zeros: bool,
    /// How a `.bsdf` tabulates half vectors, dense or compact; `None` for the smaller of those that are as good.
    pub form: Option<Form>,
}

/// What was exported.
#[derive(Clone, Debug, Serialize)]
pub struct Exported {
    /// Of the file.
    pub format: Format,
    /// Bytes of it.
    pub bytes: u64,
    /// Pairs of directions that were asked for.
    pub pairs: u64,
    /// Share of them without a value.
    pub missing: f64,
    /// How half vectors are tabulated; `None` of formats that have no choice.
    pub table: Option<Tabulation>,
    /// Relative standard deviation over the azimuths of a sample that a format without them averaged away, which a tenth of the entries
    /// exceed; `None` if nothing was.
    pub averaged_azimuths: Option<f64>,
    /// How far the file is from its source, as it was read back; `None` of a format that is not read.
    pub round_trip: Option<RoundTrip>,
    /// What is to be known of it, in sentences.
    pub warnings: Vec<String>,
}

/// Writes `source` to `out` and reads it back. The file appears whole or not at all.
///
/// # Errors
/// [`ExportError`].
pub fn export(
    source: &Source,
    about: &About,
    (to, resolution): (Format, Resolution),
    out: &Path,
    progress: &dyn Progress,
) -> Result<Exported, ExportError> {
    let is_same = |out: std::path::PathBuf| {
        Path::new(&about.name)
            .canonicalize()
            .is_ok_and(|from| from == out)
    };
    if out.canonicalize().is_ok_and(is_same) {
        return Err(ExportError::Content {
            path: out.display().to_string(),
            field: "out",
            expected: "another file than the one that is read".to_owned(),
            found: "the same".to_owned(),
        });
    }
    let exporting = Exporting::new(source, about, out, progress);
    let mut table = None;
    let averaged_azimuths = match to {
        Format::Bsdf => bsdf::write(&exporting, resolution).map(|told| {
            table = Some(told);
            None
        }),
        Format::Merl => merl::write(&exporting),
        Format::Ssdd => ssdd::write(&exporting, resolution).map(|()| None),
        Format::Klems => klems::write(&exporting, resolution).map(|()| None),
        Format::Zemax => zemax::write(&exporting, resolution).map(|()| None),
        Format::Bird => bird::write(&exporting, resolution).map(|()| None),
        Format::Npy => npy::write(&exporting, resolution).map(|()| None),
        Format::Csv => csv::write(&exporting, resolution).map(|()| None),
        Format::Exr => exr::write(&exporting, resolution).map(|()| None),
    }?;
    progress.end();
    let colours = exporting.tensor().and_then(MeasuredRgl::colours);
    let mut warnings = Vec::from_iter(colours.map(|colours| format!("spectra: written are {colours}")));
    let round_trip = match to {
        Format::Csv | Format::Exr => None,
        // What is written is there all the same.
        _ => match open(out) {
            Ok(file) => Some(round_trip::of(&exporting, file.as_ref())?),
            Err(error) => {
                warnings.push(format!("read back: not possible, {error}"));
                None
            }
        },
    };
    let bytes = std::fs::metadata(out)
        .map_err(|error| FileError::at(out, error))?
        .len();
    let mut exported = Exported {
        format: to,
        bytes,
        pairs: exporting.pairs(),
        missing: exporting.missing(),
        table,
        averaged_azimuths,
        round_trip,
        warnings,
    };
    let told = exported.warnings();
    exported.warnings.extend(told);
    Ok(exported)
}

impl Exported {
    fn warnings(&self) -> Vec<String> {
        let mut warnings = Vec::new();
        if self.missing > 0.0 {
            let what = match self.format {
                Format::Bsdf | Format::Klems | Format::Zemax => {
                    "which are 0 there, as if all light were absorbed; `rcg fill` models them"
                }
                Format::Merl => "which are -1 there",
                Format::Ssdd | Format::Npy | Format::Exr => "which are NaN there",
                _ => "which are left out",
            };
            warnings.push(format!(
                "missing: {:.2} % of the pairs of directions have no value, {what}",
                100.0 * self.missing
            ));
        }
        if let Some(averaged) = self.averaged_azimuths.filter(|averaged| *averaged > 1e-3) {
            warnings.push(format!(
                "isotropic: azimuths of the sample were averaged, over which f differs by more than {:.1} % in a tenth of the table (standard deviation)",
                100.0 * averaged
            ));
        }
        warnings
    }
}
