//! Files that are made from a `brdf.zarr` and hold the same otherwise.

use std::path::Path;

use serde_json::{Map, Value, json};

use super::{coordinates, interpolation_errors};
use crate::brdf::budget::arrays_of;
use crate::brdf::{Brdf, BrdfError, LINEAGE, MEASURED_AREA, STANDARDS};
use crate::hemisphere::incident::IncidentSet;
use crate::instrument::calibration::{MeasuredArea, Standard};
use crate::instrument::optics::Unmeasurable;
use crate::store::checksum::sum_of_tree;
use crate::store::{BrdfLayout, BrdfWriter, StoreError};

/// What a file made from another has of its own: its incident directions, why incident and outgoing ones have no data, the solid angle in
/// sr of the pixel of each cell, and attributes; a null one takes away what the other has.
pub(super) struct Own<'a> {
    pub(super) grid: &'a IncidentSet,
    pub(super) incident: &'a [Option<Unmeasurable>],
    pub(super) outgoing: &'a [Option<Unmeasurable>],
    pub(super) pixel_sr: &'a [f64],
    pub(super) facts: Map<String, Value>,
}

/// A writer to `path` of a file like `brdf`, with its budget of uncertainty.
pub(super) fn writer_like(brdf: &Brdf, own: Own, path: &Path) -> Result<BrdfWriter, StoreError> {
    let disk = brdf.disk();
    let layout = BrdfLayout {
        incident: own.grid.len(),
        grid: disk.size(),
        channels: brdf.channels(),
        chunk: brdf.chunk_range(0).len(),
    };
    let mut attributes = brdf.attributes().clone();
    attributes.extend(own.facts);
    attributes.retain(|name, value| !name.starts_with("rcg_") && !value.is_null());
    let coordinates = coordinates(own.grid, own.incident, disk, own.outgoing, own.pixel_sr);
    let writer = BrdfWriter::create(path, layout, &coordinates, attributes, true)?;
    for array in arrays_of(brdf.budget()) {
        writer.rewrite(&array)?;
    }
    Ok(writer)
}

/// Gives the file of `writer` its name, with the errors of interpolation that it has.
pub(super) fn finish(writer: BrdfWriter) -> Result<(), BrdfError> {
    let errors = Brdf::open(writer.partial_path())?.learn()?;
    writer.rewrite(&interpolation_errors(errors.as_ref()))?;
    writer.finish()?;
    Ok(())
}

/// The lineage of what `command` makes of the files `inputs`: their contents, and their own lineages.
pub(super) fn lineage_of(command: &str, inputs: &[&Brdf]) -> Result<Value, StoreError> {
    let input = |brdf: &&Brdf| {
        let sum = sum_of_tree(brdf.path()).map_err(|error| StoreError::io(brdf.path(), "read", error))?;
        Ok(json!({ "sha256": sum, LINEAGE: brdf.attributes().get(LINEAGE) }))
    };
    let inputs: Vec<Value> = inputs.iter().map(input).collect::<Result<_, StoreError>>()?;
    Ok(json!({
        "program": concat!("rcg ", env!("CARGO_PKG_VERSION")),
        "command": command,
        "inputs": inputs,
    }))
}

/// The attributes of a file made from `all` that name their standards, each once, and tell which area of the sample they measured; nothing
/// of what they do not say.
pub(super) fn measured_with(all: &[&Brdf]) -> Map<String, Value> {
    let mut facts = Map::new();
    let mut standards: Vec<Standard> = Vec::new();
    for standard in all.iter().flat_map(|brdf| brdf.standards()) {
        if !standards.contains(&standard) {
            standards.push(standard);
        }
    }
    if !standards.is_empty() {
        facts.insert(STANDARDS.to_owned(), json!(standards));
    }
    let areas: Option<Vec<MeasuredArea>> = all.iter().map(|brdf| brdf.measured_area()).collect();
    let area = areas.and_then(|areas| MeasuredArea::of_all(&areas));
    facts.insert(MEASURED_AREA.to_owned(), json!(area));
    facts
}

/// Whether both paths lead to the same place, as far as that can be told.
pub(crate) fn is_same_place(one: &Path, other: &Path) -> bool {
    match (one.canonicalize(), other.canonicalize()) {
        (Ok(one), Ok(other)) => one == other,
        _ => one == other,
    }
}
