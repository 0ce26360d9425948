//! Maps of the outgoing hemisphere under one incident direction: what is there, how uncertain it is, and how far from a reference.
//!
//! # Design
//! A map is the equal-area disk on which files have outgoing directions (Lambert's azimuthal projection, [`Disk`]), seen from above: +x to
//! the right, +y upwards, so that no part of the hemisphere looks larger than it is. Every place of the map is looked up as `rcg value`
//! does. What has no value is drawn by its reason (the hole, the wire, ...), and what was not measured itself but filled in is hatched by
//! its origin. All maps of a picture have one scale of colours.

mod colours;
mod page;

use std::fmt::Write as _;
use std::path::Path;

use glam::DVec3;

use crate::brdf::reflectance::{Missing, Reflectance, Value};
use crate::brdf::{Source, Stated};
use crate::hemisphere::direction::{from_degrees, to_degrees};
use crate::hemisphere::disk::Disk;
use crate::judge::chart::{Axis, ChartError};
use crate::judge::quantity::{Quantity, luma};
use crate::store::StoreError;
use crate::store::provenance::Provenance;

/// Places along a side of a map.
const SIDE: usize = 300;
/// Places along a side of what a table has: one for each degree or two.
const TABLE_SIDE: usize = 90;
/// Share of the places of all maps that may lie beyond the ends of the colours of uncertainties and errors.
const BEYOND: f64 = 0.005;
/// Decades of a logarithmic scale at most.
const DECADES: i32 = 6;

/// What a map shows of the luma (BT.601).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shown {
    /// The quantity itself.
    Value,
    /// Its relative standard uncertainty (k = 1), percent.
    Uncertainty,
    /// Its difference from a reference, relative to that, percent.
    Error,
}

/// One place of a map.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Spot {
    /// Beyond the horizon: beside the map.
    Beside,
    /// Why there is nothing.
    Missing(Missing),
    /// The reference has nothing to compare with.
    NoReference,
    /// What is shown, and where the value is from, if the source says so.
    Shown(f64, Option<Provenance>),
}

/// One map.
#[derive(Clone, Debug)]
struct Map {
    /// Above it.
    title: String,
    incident_deg: (f64, f64),
    /// [row, column]; rows run along +y.
    spots: Vec<Spot>,
}

/// Maps of one kind.
#[derive(Clone, Debug)]
pub struct OutgoingMaps {
    shown: Shown,
    quantity: Quantity,
    side: usize,
    is_log: bool,
    maps: Vec<Map>,
}

/// What is mapped.
#[derive(Clone, Copy)]
pub struct Asked<'a> {
    /// What is shown.
    pub shown: Shown,
    /// The quantity in which values are.
    pub quantity: Quantity,
    /// Incident directions (θ, φ) in degrees: one map for each.
    pub incident_deg: &'a [(f64, f64)],
    /// What is compared with, for [`Shown::Error`].
    pub reference: Option<&'a dyn Reflectance>,
    /// Whether the scale is logarithmic.
    pub is_log: bool,
    /// Whether it becomes a table, which has fewer places.
    pub is_table: bool,
}

impl OutgoingMaps {
    /// Maps `sources`, each with its name: a row of maps for each.
    ///
    /// # Errors
    /// [`StoreError`] if a BRDF cannot be read.
    pub fn new(sources: &[(&str, Source)], asked: &Asked<'_>) -> Result<Self, StoreError> {
        let side = if asked.is_table { TABLE_SIDE } else { SIDE };
        let disk = Disk::new(side);
        let mut maps = Vec::new();
        for (name, source) in sources {
            for &(theta_deg, phi_deg) in asked.incident_deg {
                let angles = format!("θi = {theta_deg}°, φi = {phi_deg}°");
                let title = if sources.len() > 1 {
                    format!("{}: {angles}", crate::judge::scan::shortened(name))
                } else {
                    angles
                };
                maps.push(Map {
                    title,
                    incident_deg: (theta_deg, phi_deg),
                    spots: spots(source, from_degrees(theta_deg, phi_deg), disk, asked)?,
                });
            }
        }
        Ok(Self {
            shown: asked.shown,
            quantity: asked.quantity,
            side,
            is_log: asked.is_log,
            maps,
        })
    }

    /// All places above the horizon.
    fn places(&self) -> impl Iterator<Item = &Spot> {
        let all = self.maps.iter().flat_map(|map| &map.spots);
        all.filter(|spot| !matches!(spot, Spot::Beside))
    }

    /// Number of places that were looked at.
    #[must_use]
    pub fn len(&self) -> usize {
        self.places().count()
    }

    /// Whether nothing was looked at.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.maps.is_empty()
    }

    /// Number of places where nothing is shown.
    #[must_use]
    pub fn missing(&self) -> usize {
        self.places()
            .filter(|spot| !matches!(spot, Spot::Shown(..)))
            .count()
    }

    /// Root mean square over the places with a value of what is shown: of errors and uncertainties in percent; `None` without any.
    #[must_use]
    pub fn rms(&self) -> Option<f64> {
        let (mut sum, mut count) = (0.0, 0.0);
        for spot in self.places() {
            if let Spot::Shown(value, _) = spot {
                sum += value * value;
                count += 1.0;
            }
        }
        (count > 0.0).then(|| f64::sqrt(sum / count))
    }

    /// What colours mean.
    fn axis(&self) -> Axis {
        let mut values: Vec<f64> = self
            .places()
            .filter_map(|spot| match spot {
                Spot::Shown(value, _) => Some(*value),
                _ => None,
            })
            .collect();
        let label = match self.shown {
            Shown::Value => self.quantity.label(),
            Shown::Uncertainty => "relative standard uncertainty (k = 1), %".to_owned(),
            Shown::Error => "error relative to the reference, %".to_owned(),
        };
        if self.is_log {
            return Axis::decades(&label, values.into_iter(), DECADES);
        }
        match self.shown {
            Shown::Value => Axis::covering(&label, values.into_iter().chain([0.0])),
            Shown::Uncertainty | Shown::Error => {
                for value in &mut values {
                    *value = value.abs();
                }
                values.sort_by(f64::total_cmp);
                let last = values.get(((1.0 - BEYOND) * values.len() as f64) as usize);
                let last = last.or(values.last()).copied().unwrap_or(1.0);
                let low = if self.shown == Shown::Error { -last } else { 0.0 };
                Axis::covering(&label, [low, last].into_iter())
            }
        }
    }

    /// Writes the maps: SVG, PDF or PNG, or a table (CSV), as the name of `path` ends.
    ///
    /// # Errors
    /// [`ChartError`].
    pub fn save(&self, title: &str, path: &Path) -> Result<(), ChartError> {
        page::save(self, title, path)
    }

    /// The table: a row per map and place.
    #[must_use]
    pub fn csv(&self) -> String {
        let column = match self.shown {
            Shown::Value => format!("{}{}", self.quantity.column(), self.quantity.column_unit()),
            Shown::Uncertainty => "relative_standard_uncertainty_percent".to_owned(),
            Shown::Error => "error_percent".to_owned(),
        };
        let mut table =
            format!("map,theta_i_deg,phi_i_deg,theta_r_deg,phi_r_deg,{column},reason,provenance\n");
        let disk = Disk::new(self.side);
        for (number, map) in self.maps.iter().enumerate() {
            let (theta_i, phi_i) = map.incident_deg;
            for (cell, spot) in map.spots.iter().enumerate() {
                let Some((theta_r, phi_r)) = disk.direction(cell).map(to_degrees) else {
                    continue;
                };
                let place = format!("{},{theta_i},{phi_i},{theta_r:.4},{phi_r:.4}", number + 1);
                match spot {
                    Spot::Beside => Ok(()),
                    Spot::Missing(reason) => writeln!(table, "{place},,{reason},"),
                    Spot::NoReference => writeln!(table, "{place},,no reference,"),
                    Spot::Shown(value, origin) => {
                        let origin = origin.map_or("", Provenance::name);
                        writeln!(table, "{place},{value:.6e},,{origin}")
                    }
                }
                .expect("strings take everything");
            }
        }
        table
    }
}

/// What a map of `source` lit from `wi` has at the cells of `disk`.
fn spots(source: &Source, wi: DVec3, disk: Disk, asked: &Asked<'_>) -> Result<Vec<Spot>, StoreError> {
    let cells: Vec<usize> = (0..disk.len())
        .filter(|&cell| disk.direction(cell).is_some())
        .collect();
    let pairs: Vec<(DVec3, DVec3)> = cells
        .iter()
        .filter_map(|&cell| Some((wi, disk.direction(cell)?)))
        .collect();
    let found: Vec<(Value, Option<Stated>)> = match source {
        Source::Measured(brdf) => {
            let stated = brdf.stated(&pairs)?.into_iter();
            stated
                .map(|stated| (stated.map(|stated| stated.f), stated.ok()))
                .collect()
        }
        Source::Known(_) => {
            let values = source.reflectance().values(&pairs)?.into_iter();
            values.map(|value| (value, None)).collect()
        }
    };
    let reference = match asked.reference {
        Some(reference) => reference.values(&pairs)?.into_iter().map(Result::ok).collect(),
        None => vec![None; pairs.len()],
    };
    let mut spots = vec![Spot::Beside; disk.len()];
    for (((cell, pair), (value, stated)), reference) in
        cells.into_iter().zip(&pairs).zip(found).zip(reference)
    {
        spots[cell] = match value {
            Err(reason) => Spot::Missing(reason),
            Ok(f) => {
                let origin = stated.map(|stated| stated.provenance);
                let f = luma(f);
                match asked.shown {
                    Shown::Value => Spot::Shown(asked.quantity.factor(pair.1) * f, origin),
                    Shown::Uncertainty => match stated {
                        Some(stated) if f > 0.0 => Spot::Shown(100.0 * luma(stated.sigma) / f, origin),
                        _ => Spot::Missing(Missing::Unknown),
                    },
                    Shown::Error => match reference.map(luma).filter(|reference| *reference > 0.0) {
                        Some(reference) => Spot::Shown(100.0 * (f / reference - 1.0), origin),
                        None => Spot::NoReference,
                    },
                }
            }
        };
    }
    Ok(spots)
}
