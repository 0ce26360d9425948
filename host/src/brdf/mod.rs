//! A measured BRDF: look-up with interpolation, from files larger than memory.
//!
//! # Design
//! Between incident directions [`crate::brdf::interpolation`] decides, by the errors that were found when the file was made.
//! Samples without a value take no part; if they would carry half of the weight or more, the answer is the reason
//! why, never a guess. Queries come in batches and are answered chunk by chunk in the order of the file, so
//! memory holds some chunks however large the table is.

pub mod format;
pub mod interpolation;
pub(crate) mod quadrature;
pub mod reflectance;
pub mod sample;

use std::path::{Path, PathBuf};

use crate::base::blame::Blame;
use crate::brdf::interpolation::{BranchErrors, Cells};
use crate::hemisphere::disk::Disk;
use crate::hemisphere::incident::{Grid, IncidentError, IncidentSet};
use crate::instrument::bands::Bands;
use crate::instrument::calibration::{MeasuredArea, Standard};
use crate::instrument::optics::Unmeasurable;
use crate::store::{BrdfReader, BrdfRows, StoreError};

mod agreement;
mod azimuth;
mod bands;
pub(crate) mod budget;
pub mod cause;
pub(crate) mod evidence;
mod held;
mod images;
mod known;
mod source;
mod values;

pub use azimuth::Azimuth;
pub use budget::{BANDS_DEG, CAUSES, RegionBudget};
use held::Busy;
pub use held::HeldBrdf;
pub use known::KnownBrdf;
pub use source::{Source, SourceError};
pub use values::Stated;

/// Attribute of `brdf.zarr` for what [`Brdf::uncalibrated`] tells.
/// Attribute of a part of a result: its number and how many there are.
pub(crate) const PART: &str = "part";
pub(crate) const UNCALIBRATED: &str = "uncalibrated";
/// Attribute of `brdf.zarr`: whether it was measured or simulated, as the next two say.
pub(crate) const METHOD: &str = "method";
/// Something that is there was measured.
pub(crate) const MEASUREMENT: &str = "measurement";
/// The virtual rig was measured.
pub(crate) const SIMULATION: &str = "simulation";
/// Attribute of `brdf.zarr`: where it comes from.
pub(crate) const LINEAGE: &str = "lineage";
/// Attribute of `brdf.zarr`: light of the lamp over that of the calibration.
pub(crate) const LAMP_LIGHT: &str = "lamp_light";
/// Attribute of `brdf.zarr` for what [`Brdf::common_uncertainty`] tells.
pub(crate) const COMMON_UNCERTAINTY: &str = "common_uncertainty";
/// Attribute of `brdf.zarr` for what [`Brdf::field_uncertainty`] tells.
pub(crate) const FIELD_UNCERTAINTY: &str = "field_uncertainty";
/// Attribute of `brdf.zarr` for what [`Brdf::direction_uncertainty_deg`] tells.
pub(crate) const DIRECTION_UNCERTAINTY: &str = "direction_uncertainty_deg";

/// Attribute of `brdf.zarr` for what [`Brdf::measured_area`] tells.
pub(crate) const MEASURED_AREA: &str = "measured_area";
/// Attribute of `brdf.zarr` for what [`Brdf::bands`] tells.
pub(crate) const BANDS: &str = "bands";
/// Attribute of `brdf.zarr` for what [`Brdf::standards`] tells.
pub(crate) const STANDARDS: &str = "standards";

/// Least part of σ that a value has for itself: half floats keep three digits.
const OWN_PART: f64 = 0.1;

/// Variance that is left of `sigma`² of a value `f` without the part that is `common` to all, relative.
pub(crate) fn own_variance(f: f64, sigma: f64, common: f64) -> f64 {
    (sigma.powi(2) - (common * f).powi(2)).max((OWN_PART * sigma).powi(2))
}

/// Array of the errors by which interpolation is chosen, [region, branch], relative to white.
pub(crate) const ERRORS: &str = "interpolation_error";

/// Why a BRDF cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum BrdfError {
    /// The store.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// Its coordinates make no sense.
    #[error("{path}: {field}: expected {expected}, found {found}")]
    Content {
        /// The file.
        path: String,
        /// Array or attribute.
        field: &'static str,
        /// What was expected.
        expected: String,
        /// What is there.
        found: String,
    },
}

impl Blame for BrdfError {
    fn is_input(&self) -> bool {
        match self {
            Self::Store(error) => error.is_input(),
            Self::Content { .. } => true,
        }
    }
}

/// A `brdf.zarr`.
#[derive(Debug)]
pub struct Brdf {
    path: PathBuf,
    reader: BrdfReader,
    grid: IncidentSet,
    disk: Disk,
    incident: Vec<Option<Unmeasurable>>,
    outgoing: Vec<Option<Unmeasurable>>,
    pixel_sr: Vec<f64>,
    spot_deg: f64,
    cells: Cells,
    /// What leaving images out said when the file was made; `None` in files of before.
    errors: Option<BranchErrors>,
    budget: Vec<RegionBudget>,
    azimuth: Azimuth,
    /// Of a file that may be held in memory.
    busy: Option<Busy>,
}

/// The file that `reader` reads, if it is a whole result and nothing has changed what it says of itself.
fn unchanged(reader: BrdfReader, path: &Path) -> Result<BrdfReader, BrdfError> {
    reader.check_attributes(path)?;
    match reader.attributes().get(PART) {
        None => Ok(reader),
        Some(part) => Err(BrdfError::Content {
            path: path.display().to_string(),
            field: PART,
            expected: "a whole result (`--finish` makes it of its parts)".to_owned(),
            found: format!("part {part}"),
        }),
    }
}

impl Brdf {
    /// Opens the BRDF at `path`.
    ///
    /// # Errors
    /// [`BrdfError`] with path, field, expected and found.
    pub fn open(path: &Path) -> Result<Self, BrdfError> {
        let reader = BrdfReader::open(path)?;
        let content = |field, expected: String, found: String| BrdfError::Content {
            path: path.display().to_string(),
            field,
            expected,
            found,
        };
        let azimuth = Azimuth::of(reader.attributes())
            .map_err(|(field, found)| content(field, "degrees from -360 to 360".to_owned(), found))?;
        let grid = incident_set(&reader, azimuth.deg, &content)?;
        let layout = *reader.layout();
        if grid.len() != layout.incident {
            let expected = format!("{} directions from step_deg", grid.len());
            return Err(content("incident", expected, layout.incident.to_string()));
        }
        if !matches!(layout.channels, 1 | 3) {
            return Err(content(
                "channel",
                "1 or 3 channels".to_owned(),
                layout.channels.to_string(),
            ));
        }
        let disk = Disk::new(layout.grid).turned(azimuth.deg);
        let reasons = |field, length: usize| -> Result<Vec<Option<Unmeasurable>>, BrdfError> {
            let data = reader.small(field)?;
            let codes = data.as_u8().unwrap_or_default();
            if codes.len() != length {
                return Err(content(
                    field,
                    format!("{length} codes of type uint8"),
                    format!("{}", codes.len()),
                ));
            }
            codes
                .iter()
                .map(|&code| match (code, Unmeasurable::from_code(code)) {
                    (0, _) => Ok(None),
                    (_, Some(reason)) => Ok(Some(reason)),
                    (code, None) => Err(content(field, "a known code".to_owned(), code.to_string())),
                })
                .collect()
        };
        let incident = reasons("incident_reason", grid.len())?;
        let outgoing = reasons("outgoing_reason", disk.len())?;
        let pixel_sr = match reader.small("outgoing_pixel")?.as_f64() {
            // Files of version 1 have 0 where no pixel looks.
            Some(pixels) if pixels.len() == disk.len() => {
                let known = pixels.iter().map(|&sr| if sr > 0.0 { sr } else { f64::NAN });
                known.collect::<Vec<f64>>()
            }
            _ => {
                let expected = format!("{} solid angles of type float64", disk.len());
                return Err(content("outgoing_pixel", expected, "something else".to_owned()));
            }
        };
        let spot = reader.attributes().get("spot_deg").cloned().unwrap_or_default();
        let spot_deg = spot
            .as_f64()
            .filter(|spot_deg| *spot_deg > 0.0)
            .ok_or_else(|| content("spot_deg", "degrees above 0".to_owned(), spot.to_string()))?;
        let errors = match reader.small(ERRORS) {
            Ok(data) => BranchErrors::from_values(data.as_f64().unwrap_or_default().to_vec()),
            Err(StoreError::ArrayMissing { .. }) => None,
            Err(error) => return Err(error.into()),
        };
        let budget = budget::read(&reader)?;
        Ok(Self {
            cells: Cells::new(disk, |cell| outgoing[cell].is_none()),
            path: path.to_owned(),
            reader: unchanged(reader, path)?,
            grid,
            disk,
            incident,
            outgoing,
            pixel_sr,
            spot_deg,
            errors,
            budget,
            azimuth,
            busy: None,
        })
    }

    /// The same file, which is held in memory once a quarter of a million values were asked of it, if it takes no more than 4 GB there: 20
    /// bytes for each incident direction and cell, 10 of a grey one. What it answers stays the same to the bit.
    #[must_use]
    pub fn held_when_busy(self) -> Self {
        Self {
            busy: Some(Busy::default()),
            ..self
        }
    }

    /// Whether `other` is another capture than this one, so that both can be compared.
    ///
    /// # Errors
    /// [`BrdfError`] if both hold the same capture.
    pub fn check_apart(&self, other: &Self) -> Result<(), BrdfError> {
        evidence::check_apart(self, other)
    }

    /// The complaint that its incident directions make no set.
    pub(crate) fn content(&self, error: &IncidentError) -> BrdfError {
        BrdfError::Content {
            path: self.path.display().to_string(),
            field: "incident",
            expected: "directions that make a list with those of the others".to_owned(),
            found: error.to_string(),
        }
    }

    /// Where it was opened.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The incident directions.
    #[must_use]
    pub const fn grid(&self) -> &IncidentSet {
        &self.grid
    }

    /// The outgoing directions.
    #[must_use]
    pub const fn disk(&self) -> Disk {
        self.disk
    }

    /// Where φ = 0 lies on the sample.
    #[must_use]
    pub const fn azimuth(&self) -> &Azimuth {
        &self.azimuth
    }

    /// What each way to interpolate costs, if the file says it.
    pub(crate) const fn interpolation_errors(&self) -> Option<&BranchErrors> {
        self.errors.as_ref()
    }

    /// Colour channels, 1 or 3.
    #[must_use]
    pub fn channels(&self) -> usize {
        self.reader.layout().channels
    }

    /// Attributes of the file.
    #[must_use]
    pub fn attributes(&self) -> &serde_json::Map<String, serde_json::Value> {
        self.reader.attributes()
    }

    /// What was taken as the rig file has it, for want of a calibration: directions, light and throughput. It has no part in
    /// the uncertainty. `None` if the file does not say.
    #[must_use]
    pub fn uncalibrated(&self) -> Option<Vec<String>> {
        let stated = self.attributes().get(UNCALIBRATED)?;
        serde_json::from_value(stated.clone()).ok()
    }

    /// Relative standard uncertainty (k = 1) that all values have in common, by the standard and the lamp: one factor of all. It is a
    /// part of each σ, and no averaging lessens it. `None` if the file does not say.
    #[must_use]
    pub fn common_uncertainty(&self) -> Option<f64> {
        self.attributes().get(COMMON_UNCERTAINTY)?.as_f64()
    }

    /// Relative standard uncertainty (k = 1) of what the calibration's fields leave of what its standard showed, and of how f of the
    /// standard goes with direction, which neighbouring directions share. It is a part of each σ. `None` if the file does not say.
    #[must_use]
    pub fn field_uncertainty(&self) -> Option<f64> {
        self.attributes().get(FIELD_UNCERTAINTY)?.as_f64()
    }

    /// Standard uncertainty (k = 1) of the outgoing and of the incident directions, in degrees, both axes together. It is a
    /// part of each σ, and neighbouring directions share it. `None` if the file does not say.
    #[must_use]
    pub fn direction_uncertainty_deg(&self) -> Option<[f64; 2]> {
        let stated = self.attributes().get(DIRECTION_UNCERTAINTY)?;
        serde_json::from_value(stated.clone()).ok()
    }

    /// The reflectance standards of the calibration, of merged files those of all; empty if there was none, or the file does not say.
    #[must_use]
    pub fn standards(&self) -> Vec<Standard> {
        let stated = self.attributes().get(STANDARDS).cloned();
        stated
            .and_then(|stated| serde_json::from_value(stated).ok())
            .unwrap_or_default()
    }

    /// Bands of light that the channels stand for, in their order. `None` if the file does not say.
    #[must_use]
    pub fn bands(&self) -> Option<Bands> {
        Bands::of_json(self.attributes().get(BANDS)?, self.channels())
    }

    /// Area of the sample that the camera's pixels see. `None` if the file does not say.
    #[must_use]
    pub fn measured_area(&self) -> Option<MeasuredArea> {
        let stated = self.attributes().get(MEASURED_AREA)?;
        serde_json::from_value(stated.clone()).ok()
    }

    /// Diameter in degrees of the cone that one pattern lit.
    #[must_use]
    pub const fn spot_deg(&self) -> f64 {
        self.spot_deg
    }

    /// Which cause makes how much of σ, by regions of directions; empty if the file does not say.
    #[must_use]
    pub fn budget(&self) -> &[RegionBudget] {
        &self.budget
    }

    /// Share of the variance of a value that all values have in common beside a factor, at these polar angles of light and view in
    /// degrees; 0 where the [`budget`](Self::budget) says nothing.
    #[must_use]
    pub(crate) fn shared_part(&self, incident_deg: f64, outgoing_deg: f64) -> f64 {
        let of = self.region(incident_deg, outgoing_deg);
        of.map_or(0.0, |one| one.shared).clamp(0.0, 1.0)
    }

    /// The budget of the region with these polar angles of light and view in degrees; `None` where the file does not say.
    #[must_use]
    pub fn region(&self, incident_deg: f64, outgoing_deg: f64) -> Option<&RegionBudget> {
        let is_in = |[_, end]: [f64; 2], deg: f64| budget::band(end) == budget::band(deg);
        self.budget
            .iter()
            .find(|one| is_in(one.incident_deg, incident_deg) && is_in(one.outgoing_deg, outgoing_deg))
    }

    /// Why incident direction `index` of the grid has no data; `None` if it has.
    #[must_use]
    pub fn incident_reason(&self, index: usize) -> Option<Unmeasurable> {
        self.incident[index]
    }

    /// Why cell `index` of the disk has no data; `None` if it has.
    #[must_use]
    pub fn outgoing_reason(&self, index: usize) -> Option<Unmeasurable> {
        self.outgoing[index]
    }

    /// Solid angle in sr of the camera pixel that sees cell `index`; NaN if none does.
    #[must_use]
    pub fn pixel_sr(&self, index: usize) -> f64 {
        self.pixel_sr[index]
    }

    /// Number of chunks of whole incident directions.
    #[must_use]
    pub fn chunks(&self) -> usize {
        self.reader.chunks()
    }

    /// That the file takes `bytes`, more than the `most` that are held in memory.
    fn too_large(&self, most: usize, bytes: usize) -> BrdfError {
        BrdfError::Content {
            path: self.path.display().to_string(),
            field: "f",
            expected: format!("at most {:.0} GB that are held in memory", most as f64 * 1e-9),
            found: format!("{:.1} GB", bytes as f64 * 1e-9),
        }
    }

    /// The incident directions of a chunk.
    #[must_use]
    pub fn chunk_range(&self, chunk: usize) -> std::ops::Range<usize> {
        self.reader.chunk_range(chunk)
    }

    /// The rows of a chunk, or `None` if nothing of it was measured.
    ///
    /// # Errors
    /// [`StoreError`], also if its arrays contradict each other.
    pub fn chunk(&self, chunk: usize) -> Result<Option<BrdfRows>, StoreError> {
        if !self.reader.chunk_is_present(chunk) {
            return Ok(None);
        }
        let rows = self.reader.read_chunk(chunk)?;
        agreement::check(self, chunk, &rows)?;
        Ok(Some(rows))
    }
}

/// The incident directions of a file whose φ = 0 lies at `azimuth_deg`; `content` makes the complaint from field, expected and found.
fn incident_set(
    reader: &BrdfReader,
    azimuth_deg: f64,
    content: &dyn Fn(&'static str, String, String) -> BrdfError,
) -> Result<IncidentSet, BrdfError> {
    let attribute = |name| reader.attributes().get(name).cloned().unwrap_or_default();
    let kind = attribute("incident_kind");
    let grid = match kind.as_str() {
        Some("list") => {
            let angles = |field| {
                reader.small(field)?.as_f64().map(<[f64]>::to_vec).ok_or_else(|| {
                    let found = "another type".to_owned();
                    content(field, "degrees of type float64".to_owned(), found)
                })
            };
            let (theta, phi): (Vec<f64>, Vec<f64>) = (angles("incident_theta")?, angles("incident_phi")?);
            Grid::List {
                directions_deg: theta.into_iter().zip(phi).map(<[f64; 2]>::from).collect(),
            }
        }
        // Files of before there was another kind do not say.
        None | Some("theta-phi" | "equal-solid-angle") => {
            let step = attribute("step_deg");
            let expected = || "degrees that divide 90".to_owned();
            let step_deg = step
                .as_f64()
                .ok_or_else(|| content("step_deg", expected(), step.to_string()))?;
            if kind == "equal-solid-angle" {
                Grid::EqualSolidAngle { step_deg }
            } else {
                Grid::ThetaPhi { step_deg }
            }
        }
        Some(_) => {
            let expected = "theta-phi, equal-solid-angle or list".to_owned();
            return Err(content("incident_kind", expected, kind.to_string()));
        }
    };
    let set = grid.build().map(|set| match set {
        IncidentSet::Rings(rings) => IncidentSet::Rings(rings.turned(azimuth_deg)),
        // A list has its azimuths in the file's own frame.
        list @ IncidentSet::List(_) => list,
    });
    set.map_err(|error| match error {
        IncidentError::Step { step_deg } => {
            let found = step_deg.to_string();
            content("step_deg", "degrees that divide 90".to_owned(), found)
        }
        IncidentError::List { expected, found } => {
            content("incident_theta, incident_phi", expected.to_owned(), found)
        }
        IncidentError::File { expected, found, .. } => content("incident", expected, found),
    })
}
