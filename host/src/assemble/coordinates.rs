//! What `brdf.zarr` says of itself: coordinates and attributes.

use serde_json::{Map, Value, json};

use crate::assemble::resample::Resampling;
use crate::brdf::budget::BudgetSums;
use crate::brdf::interpolation::{BRANCHES, BranchErrors, REGIONS};
use crate::brdf::{
    Azimuth, BANDS, DIRECTION_UNCERTAINTY, ERRORS, FIELD_UNCERTAINTY, LAMP_LIGHT, LINEAGE, MEASURED_AREA,
    MEASUREMENT, METHOD, SIMULATION, STANDARDS, UNCALIBRATED,
};
use crate::hemisphere::disk::Disk;
use crate::hemisphere::incident::{Grid, IncidentSet};
use crate::instrument::bands::Bands;
use crate::instrument::calibration::stray::Level;
use crate::instrument::calibration::{AppliedCalibration, MeasuredArea, Photometry};
use crate::instrument::frame_format::pixel_centre;
use crate::instrument::optics::{Unmeasurable, View};
use crate::instrument::rig::Rig;
use crate::plan::Plan;
use crate::plan::light::Coding;
use crate::store::{ROUNDED, ROUNDING, SmallArray, SmallData};

/// Words of the codes of reasons.
const REASONS: [(u8, &str); 7] = [
    (0, "measurable"),
    (1, "hole"),
    (2, "beyond rim"),
    (3, "outside image"),
    (4, "occluded"),
    (5, "below horizon"),
    (6, "off sample"),
];

/// The errors of the rules of interpolation, NaN if they are not known.
pub(crate) fn interpolation_errors(errors: Option<&BranchErrors>) -> SmallArray<'static> {
    let shape = vec![REGIONS, BRANCHES];
    let values = errors.map_or_else(
        || vec![f64::NAN; REGIONS * BRANCHES],
        |errors| errors.as_slice().to_vec(),
    );
    SmallArray {
        name: ERRORS,
        dims: &["region", "branch"],
        shape,
        data: SmallData::F64(values),
        units: "1",
        long_name: "expected error of each way to interpolate, relative to white",
        codes: &[],
    }
}

/// The coordinates of `brdf.zarr`: directions, why some of them cannot be had (`incident`, `outgoing`), the solid angle in
/// sr of the pixel of each cell (NaN where none sees it), what interpolation costs, and the budget of uncertainty.
pub(crate) fn coordinates(
    grid: &IncidentSet,
    incident: &[Option<Unmeasurable>],
    disk: Disk,
    outgoing: &[Option<Unmeasurable>],
    pixel_sr: &[f64],
) -> [SmallArray<'static>; 9] {
    let [shares, relative, shared] = BudgetSums::arrays(None);
    let angle = |pick: fn((f64, f64)) -> f64| (0..grid.len()).map(|i| pick(grid.angles_deg(i))).collect();
    let codes = |reasons: &[Option<Unmeasurable>]| {
        reasons
            .iter()
            .map(|reason| reason.map_or(0, Unmeasurable::code))
            .collect()
    };
    let small = |name, dims, shape, data, units, long_name| SmallArray {
        name,
        dims,
        shape,
        codes: if matches!(data, SmallData::U8(_)) {
            &REASONS
        } else {
            &[]
        },
        data,
        units,
        long_name,
    };
    [
        small(
            "incident_theta",
            &["incident"],
            vec![grid.len()],
            SmallData::F64(angle(|angles| angles.0)),
            "degree",
            "polar angle of the incident direction",
        ),
        small(
            "incident_phi",
            &["incident"],
            vec![grid.len()],
            SmallData::F64(angle(|angles| angles.1)),
            "degree",
            "azimuth of the incident direction",
        ),
        small(
            "incident_reason",
            &["incident"],
            vec![grid.len()],
            SmallData::U8(codes(incident)),
            "1",
            "why the incident direction cannot be lit",
        ),
        small(
            "outgoing_reason",
            &["y", "x"],
            vec![disk.size(), disk.size()],
            SmallData::U8(codes(outgoing)),
            "1",
            "why the outgoing direction cannot be seen",
        ),
        small(
            "outgoing_pixel",
            &["y", "x"],
            vec![disk.size(), disk.size()],
            SmallData::F64(pixel_sr.to_vec()),
            "sr",
            "solid angle of the camera pixel that sees the outgoing direction",
        ),
        interpolation_errors(None),
        shares,
        relative,
        shared,
    ]
}

/// The attribute of `brdf.zarr` that says what else than their own numbers values are made of: nothing (`off`), or [`SURROUNDINGS`].
const ESTIMATE: &str = "estimate";
/// The pixels around.
const SURROUNDINGS: &str = "surroundings";

/// How the incident directions of a list are described.
const LIST: &str = "any directions, interpolated on their spherical Delaunay triangulation";

/// The attributes of `brdf.zarr` that say that its incident directions are a list.
pub(crate) fn list_attributes() -> Map<String, Value> {
    let kind = Grid::List {
        directions_deg: Vec::new(),
    }
    .kind();
    let mut map = Map::new();
    map.insert("incident_grid".to_owned(), LIST.into());
    map.insert("incident_kind".to_owned(), kind.into());
    map
}

/// The relative standard uncertainty that all values have in common by the lamp, in the calibration and since, and what they `share`, as
/// [`common_uncertainty`](crate::brdf::Brdf::common_uncertainty) has it; `None` without a calibration.
pub(super) fn common_uncertainty(
    applied: &AppliedCalibration,
    lamp: Option<Level>,
    share: f64,
) -> Option<f64> {
    let found = applied.photometry.as_ref()?;
    let by_lamp = lamp.map_or(0.0, |level| f64::from(level.uncertainty));
    Some(by_lamp.hypot(found.lamp_uncertainty).hypot(share))
}

/// Area of the sample that the pixels see from which cells are made by `resampling`, if calibration found pupils.
fn measured_area(rig: &Rig, applied: &AppliedCalibration, resampling: &Resampling) -> Option<MeasuredArea> {
    let part = applied.photometry.as_ref()?.seen_part.as_ref()?;
    let (width_px, _) = View::camera(rig).size_px();
    let pixels = resampling.taps.iter().map(|taps| taps.heaviest().1);
    part.area(rig, pixels.map(|pixel| pixel_centre(pixel, width_px)))
}

/// The attributes of `brdf.zarr`, but for the common uncertainty, which only all values tell.
pub(super) fn attributes(
    rig: &Rig,
    plan: &Plan,
    applied: &AppliedCalibration,
    lamp: Option<Level>,
    resampling: &Resampling,
    lineage: Option<&Value>,
) -> Map<String, Value> {
    let is_known = applied.direction_deg.iter().all(|deg| *deg > 0.0);
    let unknown = [
        (!is_known).then_some("directions"),
        applied.photometry.is_none().then_some("light and throughput"),
    ];
    let incident = match plan.request.grid {
        Grid::ThetaPhi { .. } => {
            "theta = (ring + 1/2) step, phi = sector step, index = ring * (360/step) + sector"
        }
        Grid::EqualSolidAngle { .. } => {
            "theta = (ring + 1/2) step, ceil(360 sin(theta)/step) directions on each ring, from phi = 0 on"
        }
        Grid::List { .. } => LIST,
    };
    let attributes = json!({
        "title": "bidirectional reflectance distribution function f in 1/sr, without the cosine",
        "incident_grid": incident,
        "incident_kind": plan.request.grid.kind(),
        "step_deg": plan.request.grid.step_deg(),
        METHOD: if plan.virtual_rig.is_some() { SIMULATION } else { MEASUREMENT },
        "rig": rig.name,
        "spot_deg": plan.spot_deg,
        "exposure_s": plan.exposure_s,
        "light": plan.code.map(Coding::light),
        ESTIMATE: if resampling.surroundings.is_some() { SURROUNDINGS } else { "off" },
        ROUNDED: (!plan.request.lossless).then_some(ROUNDING),
        UNCALIBRATED: unknown.iter().flatten().collect::<Vec<_>>(),
        DIRECTION_UNCERTAINTY: is_known.then_some(applied.direction_deg),
        FIELD_UNCERTAINTY: applied.photometry.as_ref().map(Photometry::uncertainty_by_fields),
        MEASURED_AREA: measured_area(rig, applied, resampling),
        BANDS: rig.bands.as_ref().map(Bands::to_json),
        STANDARDS: applied.photometry.as_ref().map(|found| &found.standards),
        LAMP_LIGHT: lamp.map(|level| f64::from(level.light)),
        "source": concat!("rcg ", env!("CARGO_PKG_VERSION")),
        LINEAGE: lineage,
    });
    match attributes {
        Value::Object(mut map) => {
            map.extend(Azimuth::of_holder(applied.azimuth_deg).attributes());
            map.retain(|_, value| !value.is_null());
            map
        }
        _ => Map::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_words_of_the_codes_are_those_of_the_reasons() {
        let words = Unmeasurable::ALL.map(|reason| (reason.code(), reason.to_string()));
        let stated: Vec<_> = REASONS
            .iter()
            .map(|(code, word)| (*code, (*word).to_owned()))
            .collect();
        assert_eq!(stated[1..], words);
        assert_eq!(stated[0].0, 0);
    }
}
