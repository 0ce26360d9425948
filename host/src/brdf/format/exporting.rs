//! What is exported: values of a source, and what a file says of them.

use std::io::{BufWriter, Write as _};
use std::path::Path;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU64, Ordering};

use glam::DVec3;

use super::ExportError;
use super::round_trip::Trial;
use super::table::BATCH;
use crate::base::progress::Progress;
use crate::brdf::sample::MeasuredRgl;
use crate::brdf::{MEASUREMENT, METHOD, Source, Stated};
use crate::instrument::bands::{Bands, VISIBLE_NM};
use crate::store::provenance::Provenance;
use crate::store::whole_file::{FileError, WholeFile};

/// What a file says of where it comes from.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct About {
    /// The source as it was named.
    pub name: String,
    /// When it is written, as RFC 3339 has it.
    pub written: String,
}

/// One pair of directions as files have it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Entry {
    /// f in sr⁻¹ per channel.
    pub(super) f: [f32; 3],
    /// Standard uncertainty (k = 1) in sr⁻¹; NaN where nobody states one.
    pub(super) sigma: [f32; 3],
    /// Where it is from; `None` of a model or of a file that does not say.
    pub(super) provenance: Option<Provenance>,
}

impl Entry {
    /// Name of its origin.
    pub(super) fn origin(&self) -> &'static str {
        self.provenance.map_or("known", Provenance::name)
    }
}

/// A source that is written to a file.
pub(super) struct Exporting<'a> {
    source: &'a Source,
    pub(super) about: &'a About,
    pub(super) out: &'a Path,
    pub(super) progress: &'a dyn Progress,
    pairs: AtomicU64,
    missing: AtomicU64,
    trial: OnceLock<Trial>,
}

impl<'a> Exporting<'a> {
    pub(super) fn new(
        source: &'a Source,
        about: &'a About,
        out: &'a Path,
        progress: &'a dyn Progress,
    ) -> Self {
        Self {
            source,
            about,
            out,
            progress,
            pairs: AtomicU64::new(0),
            missing: AtomicU64::new(0),
            trial: OnceLock::new(),
        }
    }

    /// Whether f depends on the azimuths only through their difference, as far as the source itself says so.
    pub(super) fn is_isotropic(&self) -> bool {
        match self.source {
            Source::Measured(_) => false,
            Source::Known(sample) => sample.is_isotropic(),
        }
    }

    /// The tensor file that it is; `None` of anything else.
    pub(super) fn tensor(&self) -> Option<&MeasuredRgl> {
        match self.source {
            Source::Measured(_) => None,
            Source::Known(sample) => sample.tensor(),
        }
    }

    /// Channels that differ.
    pub(super) fn channels(&self) -> usize {
        match self.source {
            Source::Measured(brdf) => brdf.channels(),
            Source::Known(_) => 3,
        }
    }

    /// Step of the incident directions that the source has itself, degrees; `None` of one that has none.
    pub(super) fn own_step_deg(&self) -> Option<f64> {
        match self.source {
            Source::Measured(brdf) => brdf
                .attributes()
                .get("step_deg")
                .and_then(serde_json::Value::as_f64),
            Source::Known(_) => None,
        }
    }

    /// Whether each asking reads a file.
    pub(super) fn is_read_each_time(&self) -> bool {
        self.brdf().is_some_and(|brdf| brdf.at_once().is_some())
    }

    /// How many pairs are best asked for together.
    pub(super) fn at_once(&self) -> usize {
        self.brdf().and_then(crate::brdf::Brdf::at_once).unwrap_or(BATCH)
    }

    /// The pairs at which a file is compared with this.
    pub(super) fn trial(&self) -> Result<&Trial, ExportError> {
        if let Some(trial) = self.trial.get() {
            return Ok(trial);
        }
        let trial = Trial::of(self)?;
        Ok(self.trial.get_or_init(|| trial))
    }

    /// f in sr⁻¹ for pairs of unit vectors (incident, outgoing) in the order asked; `None` where there is no value.
    pub(super) fn values(&self, pairs: &[(DVec3, DVec3)]) -> Result<Vec<Option<[f32; 3]>>, ExportError> {
        let values = self.peek(pairs)?;
        self.count(&values);
        Ok(values)
    }

    /// As [`values`](Self::values), without counting what is missing.
    pub(super) fn peek(&self, pairs: &[(DVec3, DVec3)]) -> Result<Vec<Option<[f32; 3]>>, ExportError> {
        let values = self.source.reflectance().values(pairs)?;
        Ok(values.into_iter().map(Result::ok).collect())
    }

    /// As [`values`](Self::values), with uncertainty and provenance.
    pub(super) fn entries(&self, pairs: &[(DVec3, DVec3)]) -> Result<Vec<Option<Entry>>, ExportError> {
        let entries = self.peek_entries(pairs)?;
        self.count(&entries);
        Ok(entries)
    }

    /// As [`entries`](Self::entries), without counting what is missing.
    pub(super) fn peek_entries(&self, pairs: &[(DVec3, DVec3)]) -> Result<Vec<Option<Entry>>, ExportError> {
        let entries: Vec<Option<Entry>> = match self.source {
            Source::Measured(brdf) => {
                let of = |stated: Stated| Entry {
                    f: stated.f,
                    sigma: stated.sigma,
                    provenance: Some(stated.provenance),
                };
                let all = brdf.stated(pairs)?;
                all.into_iter().map(|stated| stated.ok().map(of)).collect()
            }
            Source::Known(_) => {
                let of = |f: [f32; 3]| Entry {
                    f,
                    sigma: [f32::NAN; 3],
                    provenance: None,
                };
                self.peek(pairs)?.into_iter().map(|f| f.map(of)).collect()
            }
        };
        Ok(entries)
    }

    fn count<T>(&self, found: &[Option<T>]) {
        let missing = found.iter().filter(|one| one.is_none()).count();
        self.pairs.fetch_add(found.len() as u64, Ordering::Relaxed);
        self.missing.fetch_add(missing as u64, Ordering::Relaxed);
    }

    /// Counts pairs that are written as they were read.
    pub(super) fn counted(&self, pairs: usize) {
        self.pairs.fetch_add(pairs as u64, Ordering::Relaxed);
    }

    /// Pairs that were asked for.
    pub(super) fn pairs(&self) -> u64 {
        self.pairs.load(Ordering::Relaxed)
    }

    /// Share of them without a value.
    pub(super) fn missing(&self) -> f64 {
        self.missing.load(Ordering::Relaxed) as f64 / self.pairs().max(1) as f64
    }

    /// One sentence that says what the file is made from.
    pub(super) fn description(&self) -> String {
        let bands = self
            .bands()
            .map_or_else(String::new, |bands| format!("; bands: {}", bands.words()));
        format!(
            "{}, exported by rcg {} ({}){bands}",
            self.about.name,
            env!("CARGO_PKG_VERSION"),
            self.about.written
        )
    }

    /// What light its channels stand for, if it says so.
    pub(super) fn bands(&self) -> Option<Bands> {
        self.brdf()?.bands()
    }

    /// Refuses bands that nobody sees in a format whose one number is a luminance.
    pub(super) fn check_visible(&self) -> Result<(), ExportError> {
        let Some(bands) = self.bands() else {
            return Ok(());
        };
        let [from, to] = [VISIBLE_NM.start(), VISIBLE_NM.end()];
        bands.invisible().map_or(Ok(()), |_| {
            let expected =
                format!("bands of {from} to {to} nm, as the format's one number is the luminance of all");
            Err(self.refused("bands", expected, bands.words()))
        })
    }

    /// Whether the source was measured.
    pub(super) fn brdf(&self) -> Option<&crate::brdf::Brdf> {
        match self.source {
            Source::Measured(brdf) => Some(brdf),
            Source::Known(_) => None,
        }
    }

    /// Puts a file that was written under its name.
    pub(super) fn finish(&self, file: BufWriter<WholeFile>) -> Result<(), ExportError> {
        let file = file.into_inner().map_err(std::io::IntoInnerError::into_error);
        file.and_then(WholeFile::finish)
            .map_err(|error| self.failed(error))
    }

    /// Writes a whole file.
    pub(super) fn write_whole(&self, content: &[u8]) -> Result<(), ExportError> {
        let mut file = BufWriter::new(self.create()?);
        file.write_all(content).map_err(|error| self.failed(error))?;
        self.finish(file)
    }

    /// Whether the source is a measurement of something that is there, and not of a virtual rig or a model.
    pub(super) fn is_measurement(&self) -> bool {
        let method = self.brdf().and_then(|brdf| brdf.attributes().get(METHOD));
        method.and_then(serde_json::Value::as_str) == Some(MEASUREMENT)
    }

    /// The file that is written.
    pub(super) fn create(&self) -> Result<WholeFile, ExportError> {
        WholeFile::create(self.out).map_err(|error| self.failed(error))
    }

    /// Refuses a file with gaps in a format that has no missing values, unless they are to be zeros.
    pub(super) fn check_whole(&self, zeros: bool) -> Result<(), ExportError> {
        if zeros || self.missing() == 0.0 {
            return Ok(());
        }
        Err(self.refused(
            "f",
            "a value for every pair of directions, as the format has no missing ones (`rcg fill` models them, --zeros writes 0)".to_owned(),
            format!("none for {:.2} % of them", 100.0 * self.missing()),
        ))
    }

    /// What the system says of the file that is written.
    pub(super) fn failed(&self, error: std::io::Error) -> ExportError {
        FileError::at(self.out, error).into()
    }

    /// What the format cannot carry.
    pub(super) fn refused(&self, field: &'static str, expected: String, found: String) -> ExportError {
        ExportError::Content {
            path: self.out.display().to_string(),
            field,
            expected,
            found,
        }
    }
}
