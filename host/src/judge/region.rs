//! Regions of pairs of directions, in which errors are much the same: bands of both polar angles, and where the view lies, seen from
//! the light.

use glam::DVec3;
use serde::Serialize;

use crate::brdf::BANDS_DEG;
use crate::brdf::budget::{band, span};
use crate::hemisphere::direction::{azimuth_cosine, to_degrees};

/// Samples without which a region is not judged.
pub(super) const ENOUGH: u64 = 30;
/// Values that have their noise in common: cells are interpolated between the pixels around, which serve up to so many.
pub(super) const NEIGHBOURS: f64 = 4.0;
/// Where the view lies, seen from the light: azimuth between them up to 60°, to 120°, and beyond.
const SECTORS: [&str; 3] = ["backward", "sideward", "forward"];
const BANDS: usize = BANDS_DEG.len();
/// Bands of light × bands of view × sectors.
pub(crate) const REGIONS: usize = BANDS * BANDS * SECTORS.len();

/// Some pairs of directions.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Region {
    /// Incident and outgoing polar angles, from and to, degrees.
    pub incident_deg: [f64; 2],
    /// See `incident_deg`.
    pub outgoing_deg: [f64; 2],
    /// Where the view lies, seen from the light: backward (azimuths up to 60° apart), sideward, forward (120° and more).
    pub azimuth: &'static str,
}

impl Region {
    /// The region with this number, below [`REGIONS`].
    pub(crate) fn numbered(number: usize) -> Self {
        Self {
            incident_deg: span(number / SECTORS.len() / BANDS),
            outgoing_deg: span(number / SECTORS.len() % BANDS),
            azimuth: SECTORS[number % SECTORS.len()],
        }
    }

    /// The number of the region of the unit vectors of a judged pair.
    pub(crate) fn number_of(wi: DVec3, wo: DVec3) -> usize {
        // Rounding at the last band's end.
        let band_of = |w: DVec3| band(to_degrees(w).0).unwrap_or(BANDS - 1);
        let cos = azimuth_cosine(wi, wo);
        let sector = usize::from(cos < 0.5) + usize::from(cos <= -0.5);
        (band_of(wi) * BANDS + band_of(wo)) * SECTORS.len() + sector
    }

    /// Its directions in words: incident, outgoing, azimuth.
    #[must_use]
    pub fn name(&self) -> String {
        let span = |[from, to]: [f64; 2]| format!("{from:.0}-{to:.0}°");
        format!(
            "{} → {} {}",
            span(self.incident_deg),
            span(self.outgoing_deg),
            self.azimuth
        )
    }
}
