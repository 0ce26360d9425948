//! OpenEXR (`.exr`): a picture of the outgoing hemisphere under light from one direction, f in sr⁻¹ instead of colours.
//!
//! Kainz and Bogart, "Technical Introduction to OpenEXR" (Academy Software Foundation). One layer of half width 1: a square in Lambert's
//! azimuthal equal-area projection, x + iy = √2·sin(θ/2)·exp(iφ), −1 to 1 over the picture, +x to the right, **+y up**, as pictures are
//! looked at; beyond the horizon and where there is no value, NaN.
//!
//! | channel | type | content |
//! |---|---|---|
//! | `R`, `G`, `B` | 32-bit float | f in sr⁻¹ without the cosine |
//! | `sigma.R`, `sigma.G`, `sigma.B` | 32-bit float | its standard uncertainty (k = 1) in sr⁻¹; NaN where nobody states one |
//! | `provenance` | 32-bit float | code of the weakest origin ([`Provenance`]); 0 where there is no value, −1 of a model |
//!
//! The attribute `comments` says this and where it is from; `incidentThetaDeg` and `incidentPhiDeg` say where the light is. Only written.

use std::io::Cursor;

use exr::prelude::{
    AnyChannel, AnyChannels, AttributeValue, Encoding, FlatSamples, Image, Layer, LayerAttributes, SmallVec,
    Text, Vec2, WritableImage as _,
};
use glam::DVec3;

use super::exporting::Entry;
use super::{ExportError, Exporting, Resolution};
use crate::base::text::ascii;
use crate::hemisphere::direction::from_degrees;
use crate::hemisphere::disk::Disk;
use crate::store::provenance::Provenance;

/// Pixels a side if nobody says otherwise: fine enough to be looked at; never fewer than a measurement has.
const SIDE: usize = 256;
/// And at most.
const MOST_SIDE: usize = 1024;

/// Writes the picture under the light that `resolution` names.
pub(super) fn write(exporting: &Exporting, resolution: Resolution) -> Result<(), ExportError> {
    let Some([theta_deg, phi_deg]) = resolution.incident_deg else {
        let expected =
            "one incident direction, polar angle and azimuth in degrees, as a picture has one light";
        return Err(exporting.refused("slice", expected.to_owned(), "none".to_owned()));
    };
    let side = match (resolution.side, exporting.brdf()) {
        (0, Some(brdf)) => SIDE.max(brdf.disk().size()),
        (0, None) => SIDE,
        (side, _) => side,
    };
    if !(2..=MOST_SIDE).contains(&side) {
        return Err(exporting.refused(
            "resolution",
            format!("2 to {MOST_SIDE} pixels a side"),
            side.to_string(),
        ));
    }
    exporting.progress.begin("export", 1, "pictures");
    let wi = from_degrees(theta_deg, phi_deg);
    let disk = Disk::new(side);
    // Rows of pictures begin at the top.
    let views: Vec<Option<DVec3>> = (0..disk.len())
        .map(|place| disk.direction((side - 1 - place / side) * side + place % side))
        .collect();
    let pairs: Vec<(DVec3, DVec3)> = views.iter().flatten().map(|wo| (wi, *wo)).collect();
    let mut entries = exporting.entries(&pairs)?.into_iter();
    let found: Vec<Option<Entry>> = views
        .iter()
        .map(|view| view.and_then(|_| entries.next().flatten()))
        .collect();
    let channel = |name: &str, missing: f32, of: &dyn Fn(&Entry) -> f32| {
        let values = found.iter().map(|entry| entry.as_ref().map_or(missing, of));
        AnyChannel::new(name, FlatSamples::F32(values.collect()))
    };
    let mut channels = SmallVec::new();
    for (lane, name) in ["R", "G", "B"].into_iter().enumerate() {
        channels.push(channel(name, f32::NAN, &|entry| entry.f[lane]));
        channels.push(channel(&format!("sigma.{name}"), f32::NAN, &|entry| {
            entry.sigma[lane]
        }));
    }
    channels.push(channel("provenance", 0.0, &|entry| {
        entry
            .provenance
            .map_or(-1.0, |origin: Provenance| f32::from(origin.code()))
    }));
    let mut attributes = LayerAttributes::default();
    let comments = format!(
        "{}. f in 1/sr without the cosine; Lambert's azimuthal equal-area projection, x + iy = sqrt(2) sin(theta/2) exp(i phi), +x right, \
         +y up; NaN: no value. sigma: standard uncertainty (k = 1). provenance: {}",
        exporting.description(),
        Provenance::ALL
            .map(|origin| format!("{} {}", origin.code(), origin.name()))
            .join(", ")
    );
    // The format's texts are of Latin letters.
    attributes.comments = Text::new_or_none(ascii(&comments));
    for (name, deg) in [("incidentThetaDeg", theta_deg), ("incidentPhiDeg", phi_deg)] {
        attributes
            .other
            .insert(Text::new_or_panic(name), AttributeValue::F64(deg));
    }
    let layer = Layer::new(
        Vec2(side, side),
        attributes,
        Encoding::SMALL_LOSSLESS,
        AnyChannels::sort(channels),
    );
    let mut bytes = Cursor::new(Vec::new());
    Image::from_layer(layer)
        .write()
        .to_buffered(&mut bytes)
        .map_err(|error| exporting.failed(std::io::Error::other(error)))?;
    exporting.write_whole(bytes.get_ref())
}
