//! The universal BRDF format of the European metrology projects 16NRM08 (`BiRD`) and 18SIB03 (`.brdf`, `.json`): one JSON document.
//!
//! Lanevski et al., Color Research and Application 47, 1177 (2022), and the projects' schema. No validator of theirs is asked; what is written
//! keeps these rules of the schema, as they are read here, and a test walks a file by them:
//! - All keys of `metadata` below are there and none is null or empty, but that of an environment nobody recorded; what nobody knows of the
//!   instrument is left out.
//! - Each list of `data` has a `unit` of those below and `values`, finite numbers as many as in each other list, and there are some.
//!   In degrees, as the schema has azimuths in radians end at π.
//! - f and its uncertainty are not negative where the source is not.
//! - Each list of `data.adhoc_variables` says in `description` what it is.
//!
//! | key | content |
//! |---|---|
//! | `metadata` | `schema`, `id`, `type` "BRDF", `timestamp`, `provenance`, `description`, `method` (measurement or simulation), `instrumentation`, `software`, `sample`, `environment` |
//! | `data.theta_i`, `phi_i`, `theta_r`, `phi_r` | `unit` (deg, °, or rad when read) and `values`, one for each entry: θ below 90°, φ below 360° |
//! | `data.BRDF` | `unit` 1/sr (or `sr^-1`) and `values`: f, no cosine in it |
//! | `data.uBRDF` | the same, its standard uncertainty (k = 1); absent where nobody states one |
//! | `data.wavelength_i`, `wavelength_r` | `unit` nm and the centre of each entry's band; absent where nobody states bands |
//! | `data.adhoc_variables` | `channel` (0 red, 1 green, 2 blue; absent of one channel) and `provenance` of each entry |
//!
//! Pairs of directions without a value are left out. All channels of a pair follow each other. What is read has to be a table: all pairs
//! of some angles, those left out excepted.

use std::collections::BTreeMap;
use std::io::{BufWriter, Write as _};
use std::path::Path;

use serde_json::{Value, json};

use super::table::{Axes, Tabulated};
use super::{ExportError, Exporting, Resolution, reading};
use crate::base::text::shown;
use crate::brdf::sample::SampleError;

/// Step of the angles if nobody says otherwise, degrees; never finer than the source.
const STEP_DEG: f64 = 15.0;
/// Most pairs of directions: text is for small tables.
const MOST_PAIRS: usize = 1_000_000;
/// Bytes of the largest file that is read.
const MOST_BYTES: u64 = 500_000_000;
/// Angles are the same within this, degrees.
const SAME_DEG: f64 = 1e-6;
/// What is written of angles, which may not reach 360°.
const ANGLES: [&str; 4] = ["theta_i", "phi_i", "theta_r", "phi_r"];

/// Lists of one file, all equally long.
struct Lists {
    /// Degrees: θi, φi, θr, φr.
    angles: [Vec<f64>; 4],
    f: Vec<f64>,
    channel: Option<Vec<f64>>,
}

impl Lists {
    fn read(path: &Path) -> Result<Self, SampleError> {
        let text = reading::text(path, MOST_BYTES)?;
        let wrong = |field: &str, expected: &str, found: &str| reading::wrong(path, field, expected, found);
        let document: Value = serde_json::from_str(&text)
            .map_err(|error| wrong("document", "JSON", &shown(&error.to_string())))?;
        let kind = document["metadata"]["type"].as_str().unwrap_or("none");
        if kind != "BRDF" {
            return Err(wrong("metadata.type", "BRDF", &shown(kind)));
        }
        let data = &document["data"];
        let list = |value: &Value, field: &str| -> Result<Vec<f64>, SampleError> {
            let all = value["values"]
                .as_array()
                .ok_or_else(|| wrong(field, "a list of values", "none"))?;
            let numbers: Option<Vec<f64>> = all.iter().map(Value::as_f64).collect();
            numbers.ok_or_else(|| wrong(field, "numbers", "something else"))
        };
        let mut angles: [Vec<f64>; 4] = Default::default();
        for (name, angles) in ANGLES.into_iter().zip(&mut angles) {
            let field = format!("data.{name}");
            let unit = data[name]["unit"].as_str().unwrap_or("none");
            let factor = match unit {
                "deg" | "°" => 1.0,
                "rad" => 1_f64.to_degrees(),
                other => return Err(wrong(&format!("{field}.unit"), "deg, ° or rad", &shown(other))),
            };
            let last = if name.starts_with("theta") { 90.0 } else { 360.0 };
            *angles = list(&data[name], &field)?
                .into_iter()
                .map(|angle| angle * factor)
                .collect();
            if let Some(bad) = angles.iter().find(|deg| !(-last..=last).contains(*deg)) {
                return Err(wrong(&field, &format!("angles to {last}°"), &format!("{bad}°")));
            }
        }
        let unit = data["BRDF"]["unit"].as_str().unwrap_or("none");
        if !["1/sr", "sr^-1"].contains(&unit) {
            return Err(wrong("data.BRDF.unit", "1/sr", &shown(unit)));
        }
        let f = list(&data["BRDF"], "data.BRDF")?;
        let channel = &data["adhoc_variables"]["channel"];
        let lists = Self {
            angles,
            f,
            channel: (!channel.is_null())
                .then(|| list(channel, "data.adhoc_variables.channel"))
                .transpose()?,
        };
        let wavelengths = list(&data["wavelength_i"], "data.wavelength_i").unwrap_or_default();
        if lists.channel.is_none()
            && wavelengths
                .windows(2)
                .any(|two| two[0].to_bits() != two[1].to_bits())
        {
            return Err(wrong(
                "data.wavelength_i",
                "one wavelength, or channels",
                "several wavelengths",
            ));
        }
        let count = lists.f.len();
        let others = lists.angles.iter().chain(&lists.channel);
        if count == 0 || others.into_iter().any(|list| list.len() != count) {
            return Err(wrong("data", "equally long lists with entries", "others"));
        }
        Ok(lists)
    }
}

/// Reads the file at `path`.
pub(super) fn open(path: &Path) -> Result<Tabulated, SampleError> {
    let Lists {
        mut angles,
        f,
        channel,
    } = Lists::read(path)?;
    // A polar angle below 0 is one on the other side of the normal.
    let [theta_i, phi_i, theta_r, phi_r] = &mut angles;
    for (thetas, phis) in [(theta_i, phi_i), (theta_r, phi_r)] {
        for (theta, phi) in thetas.iter_mut().zip(phis) {
            let turn = if *theta < 0.0 { 180.0 } else { 0.0 };
            (*theta, *phi) = (theta.abs(), (*phi + turn).rem_euclid(360.0));
        }
    }
    let key = |deg: f64| (deg / SAME_DEG).round() as i64;
    let places: [BTreeMap<i64, usize>; 4] = std::array::from_fn(|axis| {
        let keys: std::collections::BTreeSet<i64> = angles[axis].iter().map(|deg| key(*deg)).collect();
        keys.into_iter()
            .enumerate()
            .map(|(place, key)| (key, place))
            .collect()
    });
    let axis = |at: usize| {
        places[at]
            .keys()
            .map(|key| *key as f64 * SAME_DEG)
            .collect::<Vec<f64>>()
    };
    let axes = Axes {
        theta_i: axis(0),
        phi_i: axis(1),
        theta_o: axis(2),
        phi_o: axis(3),
    };
    // A table that is mostly empty is none; the largest may not be larger than what is there by much.
    let channels = if channel.is_some() { 3 } else { 1 };
    if axes.len() > 20 * f.len().div_ceil(channels) {
        let found = format!("{} entries of {} pairs of their angles", f.len(), axes.len());
        return Err(reading::wrong(path, "data", "a table over four angles", &found));
    }
    if let Some(flaw) = axes.flaw() {
        return Err(reading::wrong(
            path,
            "data",
            "angles that can be interpolated between",
            &flaw,
        ));
    }
    let mut values = vec![[f32::NAN; 3]; axes.len()];
    let shape = axes.shape();
    for (entry, f) in f.iter().enumerate() {
        let number = (0..4).fold(0, |number, axis| {
            number * shape[axis] + places[axis][&key(angles[axis][entry])]
        });
        match channel.as_ref().map(|channel| channel[entry]) {
            None => values[number] = [*f as f32; 3],
            Some(channel)
                if [0.0_f64, 1.0, 2.0]
                    .iter()
                    .any(|known| known.to_bits() == channel.to_bits()) =>
            {
                values[number][channel as usize] = *f as f32;
            }
            Some(other) => {
                let found = other.to_string();
                return Err(reading::wrong(
                    path,
                    "data.adhoc_variables.channel",
                    "0, 1 or 2",
                    &found,
                ));
            }
        }
    }
    Ok(Tabulated::new(axes, values))
}

/// Writes the document.
pub(super) fn write(exporting: &Exporting, resolution: Resolution) -> Result<(), ExportError> {
    let mut axes = Axes::of(exporting, resolution, STEP_DEG, false)?;
    // An isotropic sample is written all around: the format has no azimuths that count from light.
    if axes.phi_i.len() == 1 {
        axes.phi_i.clone_from(&axes.phi_o);
    }
    if axes.len() > MOST_PAIRS {
        return Err(exporting.refused(
            "resolution",
            format!("at most {MOST_PAIRS} pairs of directions, as this is text"),
            format!("{}, which a wider step makes fewer", axes.len()),
        ));
    }
    let channels = exporting.channels();
    let mut angles: [Vec<f64>; 4] = Default::default();
    let (mut f, mut u, mut channel, mut origin) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    let bands = exporting.bands();
    axes.scan(exporting, |range, pairs| {
        for (place, entry) in range.zip(exporting.entries(pairs)?) {
            let Some(entry) = entry else { continue };
            for of in 0..channels {
                for (list, deg) in angles.iter_mut().zip(axes.angles(place)) {
                    list.push(deg);
                }
                f.push(entry.f[of]);
                u.push(entry.sigma[of]);
                channel.push(of);
                origin.push(entry.origin());
            }
        }
        Ok(())
    })?;
    let list = |unit: &str, values: Value| json!({ "unit": unit, "values": values });
    let mut data = serde_json::Map::new();
    for (name, angles) in ANGLES.into_iter().zip(angles) {
        data.insert(name.to_owned(), list("deg", json!(angles)));
    }
    data.insert("BRDF".to_owned(), list("1/sr", json!(f)));
    if u.iter().all(|u| u.is_finite()) {
        data.insert("uBRDF".to_owned(), list("1/sr", json!(u)));
    }
    if let Some(bands) = &bands {
        let of = |channel: &usize| bands.centre_nm[*channel];
        let wavelengths: Vec<f64> = channel.iter().map(of).collect();
        for name in ["wavelength_i", "wavelength_r"] {
            data.insert(name.to_owned(), list("nm", json!(wavelengths)));
        }
    }
    let mut adhoc = json!({ "provenance": { "description": "origin of each value", "values": origin } });
    if channels > 1 {
        let names = bands.map_or_else(
            || "0 red, 1 green, 2 blue of the camera".to_owned(),
            |bands| format!("0, 1 and 2: {}", bands.words()),
        );
        adhoc["channel"] = json!({ "description": names, "values": channel });
    }
    data.insert("adhoc_variables".to_owned(), adhoc);
    let document = json!({ "metadata": metadata(exporting), "data": data });
    let mut file = BufWriter::new(exporting.create()?);
    let failed = |error| exporting.failed(error);
    serde_json::to_writer(&mut file, &document).map_err(|error| failed(error.into()))?;
    file.write_all(b"\n").map_err(failed)?;
    exporting.finish(file)
}

fn metadata(exporting: &Exporting) -> Value {
    let attribute = |name: &str| {
        let brdf = exporting.brdf()?;
        brdf.attributes()
            .get(name)
            .filter(|value| !value.is_null())
            .cloned()
    };
    let software = format!("rcg {}", env!("CARGO_PKG_VERSION"));
    let mut instrumentation = json!({ "name": "RCG, rapid catadioptric gonioreflectometer" });
    for name in ["rig", "bands", "spot_deg", "standards", "measured_area"] {
        if let Some(known) = attribute(name) {
            instrumentation[name] = known;
        }
    }
    json!({
        "schema": "BiRD universal BRDF",
        "id": exporting.about.name,
        "type": "BRDF",
        "timestamp": exporting.about.written,
        "provenance": attribute("lineage").unwrap_or_else(|| json!({ "program": software })),
        "description": exporting.description(),
        "method": if exporting.is_measurement() { "measurement" } else { "simulation" },
        "instrumentation": instrumentation,
        "software": software,
        "sample": exporting.about.name,
        "environment": attribute("environment").unwrap_or_else(|| json!({})),
    })
}
