//! What a file is.

use std::f64::consts::{PI, TAU};
use std::path::Path;

use glam::{DMat3, DVec3};
use rand::{RngExt as _, SeedableRng as _};
use rand_xoshiro::Xoshiro256PlusPlus;
use serde::Serialize;

use super::{Format, luminance};
use crate::base::median::median;
use crate::brdf::Source;
use crate::brdf::sample::{MeasuredRgl, file_of};
use crate::hemisphere::direction::{drawn, from_angles, from_degrees};
use crate::hemisphere::judged::RECIPROCAL_THETA_DEG;
use crate::store::StoreError;

/// Pairs of directions that are tried.
const PAIRS: usize = 4_000;
/// Differences up to this are none: of rounding, and of tables that are interpolated.
pub const ALIKE: f64 = 0.02;
/// Polar angles of light at which the energy is told, degrees.
const THETAS_DEG: [f64; 4] = [10.0, 30.0, 50.0, 70.0];
/// Directions of view over which it is summed: rings, and azimuths.
const RINGS: usize = 40;
const AZIMUTHS: usize = 36;
/// No energy is told where more of them have no value.
const GAPS: f64 = 0.05;

/// What a BRDF is, by random pairs of directions with θ ≤ 70° both ways; half of them have half vectors near the normal, where gloss is.
/// Symmetries are told by mean absolute differences over mean values, so that a lobe counts by its light.
#[derive(Clone, Debug, Serialize)]
pub struct Info {
    /// What kind of file or model.
    pub format: String,
    /// What it is made of, in words: name and content.
    pub facts: Vec<(String, String)>,
    /// Smallest, median and largest luminance of f, sr⁻¹; `None` of no value.
    pub range: Option<[f64; 3]>,
    /// Share of pairs without a value.
    pub missing: f64,
    /// Share of values with a channel below 0, and of those with one that is 0.
    pub negative: f64,
    /// See [`negative`](Self::negative).
    pub zero: f64,
    /// Difference over mean of pairs that are turned about the normal together: 0 of an isotropic sample.
    pub turned: Option<f64>,
    /// The same of pairs that are mirrored at the plane of +x and the normal: 0 of a bilateral sample.
    pub mirrored: Option<f64>,
    /// The same of pairs whose directions are exchanged: 0 of a reciprocal sample.
    pub exchanged: Option<f64>,
    /// Polar angle of light in degrees and directional albedo of each channel there, where nearly all is known.
    pub albedo: Vec<(f64, [f64; 3])>,
    /// What is to be known of it, in sentences.
    pub warnings: Vec<String>,
}

/// What `source` is that was named `spec`.
///
/// # Errors
/// [`StoreError`] if a file cannot be read.
pub fn of(spec: &str, source: &Source) -> Result<Info, StoreError> {
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(23);
    let mut draw = || drawn(&mut rng, RECIPROCAL_THETA_DEG);
    let mut pairs: Vec<(DVec3, DVec3)> = (0..PAIRS).map(|_| (draw(), draw())).collect();
    for pair in pairs.iter_mut().take(PAIRS / 2) {
        let wi = pair.0;
        // From a third of a degree to 45°, each octave alike.
        let lean_rad = 0.006 * 2_f64.powf(rng.random_range(0.0..7.0));
        let half = from_angles(lean_rad, rng.random_range(0.0..TAU));
        let wo = 2.0 * wi.dot(half) * half - wi;
        if wo.z >= RECIPROCAL_THETA_DEG.to_radians().cos() {
            pair.1 = wo;
        }
    }
    let ask = |of: &dyn Fn((DVec3, DVec3)) -> (DVec3, DVec3)| -> Result<Vec<Option<[f32; 3]>>, StoreError> {
        let asked: Vec<_> = pairs.iter().copied().map(of).collect();
        let values = source.reflectance().values(&asked)?;
        Ok(values.into_iter().map(Result::ok).collect())
    };
    let plain = ask(&|pair| pair)?;
    let turn = DMat3::from_rotation_z(37_f64.to_radians());
    let against = |other: Vec<Option<[f32; 3]>>| {
        let both = plain
            .iter()
            .zip(other)
            .filter_map(|(a, b)| Some((luminance((*a)?), luminance(b?))));
        let (off, all) = both.fold((0.0, 0.0), |(off, all), (a, b)| {
            (off + (a - b).abs(), all + (a + b).abs() / 2.0)
        });
        (all > 0.0).then(|| off / all)
    };
    let mirror = |w: DVec3| DVec3::new(w.x, -w.y, w.z);
    let turned = against(ask(&|(wi, wo)| (turn * wi, turn * wo))?);
    let mirrored = against(ask(&|(wi, wo)| (mirror(wi), mirror(wo)))?);
    let exchanged = against(ask(&|(wi, wo)| (wo, wi))?);
    let known: Vec<[f32; 3]> = plain.iter().flatten().copied().collect();
    let share = |of: &dyn Fn(f32) -> bool| {
        let count = known.iter().filter(|f| f.iter().any(|f| of(*f))).count();
        count as f64 / known.len().max(1) as f64
    };
    let mut info = Info {
        format: format_of(spec, source),
        facts: facts(source),
        range: range(&known),
        missing: 1.0 - known.len() as f64 / PAIRS as f64,
        negative: share(&|f| f < 0.0),
        zero: share(&|f| f == 0.0),
        turned,
        mirrored,
        exchanged,
        albedo: albedo(source)?,
        warnings: Vec::new(),
    };
    info.warnings = info.warnings();
    Ok(info)
}

impl Info {
    fn warnings(&self) -> Vec<String> {
        let mut warnings = Vec::new();
        if self.negative > 0.0 {
            let percent = 100.0 * self.negative;
            warnings.push(format!(
                "values: {percent:.2} % have a channel below 0, which no reflectance is"
            ));
        }
        let largest = self
            .albedo
            .iter()
            .flat_map(|(_, albedo)| *albedo)
            .fold(0.0, f64::max);
        if largest > 1.0 {
            warnings.push(format!(
                "energy: a directional albedo of {largest:.3} is more than all light"
            ));
        }
        warnings
    }
}

fn format_of(spec: &str, source: &Source) -> String {
    match (source, file_of(spec)) {
        (Source::Measured(_), _) => "brdf.zarr".to_owned(),
        (Source::Known(_), None) => "model".to_owned(),
        (Source::Known(_), Some(path))
            if path
                .extension()
                .is_some_and(|end| end.eq_ignore_ascii_case("toml")) =>
        {
            "certificate of a standard".to_owned()
        }
        (Source::Known(_), Some(path)) => {
            let format = Format::of(Path::new(path)).ok().flatten().unwrap_or(Format::Bsdf);
            format!("{} ({})", format.words(), format.name())
        }
    }
}

fn facts(source: &Source) -> Vec<(String, String)> {
    let mut facts = Vec::new();
    let mut add = |name: &str, content: String| facts.push((name.to_owned(), content));
    match source {
        Source::Measured(brdf) => {
            let attribute = |name: &str| {
                let value = brdf.attributes().get(name)?;
                Some(value.as_str().map_or_else(|| value.to_string(), str::to_owned))
            };
            add("channels", brdf.channels().to_string());
            if let Some(bands) = brdf.bands() {
                add("bands", bands.words());
            }
            add("incident", format!("{} directions", brdf.grid().len()));
            add("outgoing", format!("{} cells of a disk", brdf.disk().len()));
            for name in ["rig", "light", "step_deg", "spot_deg", "azimuth_zero", "source"] {
                if let Some(content) = attribute(name) {
                    add(name, content);
                }
            }
        }
        Source::Known(sample) => {
            add(
                "isotropic",
                if sample.is_isotropic() {
                    "as it is stored"
                } else {
                    "not as it is stored"
                }
                .to_owned(),
            );
            if let Some(colours) = sample.tensor().and_then(MeasuredRgl::colours) {
                add("spectra", colours);
            }
        }
    }
    facts
}

fn range(known: &[[f32; 3]]) -> Option<[f64; 3]> {
    let all: Vec<f64> = known.iter().map(|f| luminance(*f)).collect();
    let smallest = all.iter().copied().reduce(f64::min)?;
    let largest = all.iter().copied().reduce(f64::max)?;
    Some([smallest, median(all)?, largest])
}

fn albedo(source: &Source) -> Result<Vec<(f64, [f64; 3])>, StoreError> {
    let views: Vec<DVec3> = (0..RINGS * AZIMUTHS)
        .map(|number| {
            let sine2 = ((number / AZIMUTHS) as f64 + 0.5) / RINGS as f64;
            let phi_deg = (number % AZIMUTHS) as f64 * 360.0 / AZIMUTHS as f64;
            from_degrees(sine2.sqrt().asin().to_degrees(), phi_deg)
        })
        .collect();
    let mut found = Vec::new();
    for theta_deg in THETAS_DEG {
        let wi = from_degrees(theta_deg, 0.0);
        let pairs: Vec<_> = views.iter().map(|wo| (wi, *wo)).collect();
        let values = source.reflectance().values(&pairs)?;
        let known: Vec<[f32; 3]> = values.into_iter().filter_map(Result::ok).collect();
        if (known.len() as f64) < (1.0 - GAPS) * views.len() as f64 {
            continue;
        }
        let mean =
            |channel: usize| known.iter().map(|f| f64::from(f[channel])).sum::<f64>() / known.len() as f64;
        found.push((theta_deg, [0, 1, 2].map(|channel| PI * mean(channel))));
    }
    Ok(found)
}
