//! What the catalogue has of a measurement.

use std::fs;
use std::path::Path;

use rcg::base::progress::Progress as _;
use rcg::brdf::Brdf;
use rcg::capture::directory::{Measurement, MeasurementError};
use rcg::judge::evaluate::{Albedo, Evaluation, evaluate};
use rcg::judge::fit::{Fit, Model};
use rcg::judge::render::{automatic_exposure, save, sheet, sphere};
use rcg::measure::Job;
use rusqlite::types::Value;

use super::catalogue::{COLUMNS, Row};
use super::content::Content;
use crate::clock::now;
use crate::failure::Failure;
use crate::output::Output;

/// The incident angle whose albedo is wanted, degrees.
const ALBEDO_THETA_DEG: f64 = 45.0;
/// Pixels a side of the small picture …
const THUMBNAIL_PX: usize = 72;
/// … and the light in it, polar angle and azimuth in degrees, as reports have it.
const LIGHT_DEG: (f64, f64) = (45.0, 90.0);

/// The finished measurement in `dir`, refused in one sentence if it is not finished yet.
pub(super) fn finished(dir: &Path) -> Result<Measurement, Failure> {
    let measurement = Measurement::open(dir)?;
    let state: Option<String> = measurement.noted("state");
    let is_finished = matches!(state.as_deref(), Some("assembled" | "reported"));
    if !is_finished || !measurement.path("brdf.zarr").is_dir() {
        return Err(Failure::input(format!(
            "{}: expected a finished measurement, found one that is {} and has {} brdf.zarr; `rcg measure --resume` (or `capture` and \
             `assemble`) completes it",
            dir.display(),
            state.as_deref().unwrap_or("in no known state"),
            if measurement.path("brdf.zarr").is_dir() {
                "a"
            } else {
                "no"
            }
        )));
    }
    Ok(measurement)
}

/// The row of the `measurement`, which stands at `path` below the folder of the collection, with its `content`.
pub(super) fn row(
    measurement: &Measurement,
    path: &str,
    content: &Content<'_>,
    model: Model,
    output: &Output,
) -> Result<Row, Failure> {
    let sum = content.sum()?;
    let brdf = Brdf::open(&measurement.path("brdf.zarr"))?;
    // A sample that is gone is none to compare with.
    let reference = Job::of(measurement, None).ok().and_then(|job| job.reference);
    let against = reference
        .as_ref()
        .map(|known| (known.name.as_str(), known.sample.as_ref()));
    output.begin("evaluate", brdf.chunks(), "chunks");
    let found = evaluate(&brdf, against, &|done| output.reach(done))?;
    output.end();
    whole(measurement, &found)?;
    let fit = Fit::of_brdf(model, &brdf).ok().filter(|fit| fit.acceptable);
    let plan = &measurement.plan;
    let sessions = measurement
        .record()
        .map_err(Failure::from)?
        .map(|record| record.sessions);
    let date = sessions.and_then(|sessions| Some(sessions.first()?.began.clone()));
    let albedo = albedo(&found);
    let of_albedo = |figure: fn(&Albedo) -> Option<f64>| real(albedo.as_ref().and_then(figure));
    let error = found.against_reference.as_ref();
    let error = error.and_then(|against| against.relative_error.median.value());
    let parameter = |name: &str| real(fit.as_ref().and_then(|fit| mean(fit, name)));
    let count = |number: usize| Value::Integer(number as i64);
    let text = |text: &str| Value::Text(text.to_owned());
    let row = vec![
        text(path),
        text(plan.sample().unwrap_or_default()),
        text(&measurement.rig.name),
        date.map_or(Value::Null, Value::Text),
        count(brdf.grid().len()),
        count(plan.request.image_size as usize),
        real(found.coverage),
        real(error),
        real(found.median_relative_sigma.value()),
        of_albedo(|found| found.albedo),
        of_albedo(|found| found.standard_uncertainty),
        of_albedo(|found| Some(found.theta_deg)),
        real(found.reciprocity_residual_median),
        fit.as_ref().map_or(Value::Null, |_| text(name_of(model))),
        parameter("ax"),
        parameter("ay"),
        parameter("azimuth_deg"),
        parameter("rd"),
        parameter(strength_of(model)),
        count(found.warnings.len()),
        Value::Integer(content.bytes as i64),
        Value::Text(sum),
        Value::Text(now()?),
        text(&content.stamp),
        thumbnail(&brdf)?,
    ];
    debug_assert_eq!(row.len(), COLUMNS.len());
    Ok(row)
}

/// Refuses a result that has lost values: a chunk that is gone reads as one where nothing was measured.
fn whole(measurement: &Measurement, found: &Evaluation) -> Result<(), Failure> {
    let noted: Option<serde_json::Value> = measurement.noted("assembled");
    match noted.and_then(|assembled| assembled["measured"].as_u64()) {
        Some(noted) if noted != found.measured_samples => Err(MeasurementError::Changed {
            path: measurement.path("brdf.zarr").display().to_string(),
            expected: format!("{noted} measured samples"),
            found: format!("{} (`rcg assemble` makes it again)", found.measured_samples),
        }
        .into()),
        _ => Ok(()),
    }
}

/// What is not finite is not known.
fn real(number: Option<f64>) -> Value {
    number
        .filter(|number| number.is_finite())
        .map_or(Value::Null, Value::Real)
}

/// The albedo nearest to [`ALBEDO_THETA_DEG`].
fn albedo(found: &Evaluation) -> Option<Albedo> {
    let far = |albedo: &&Albedo| (albedo.theta_deg - ALBEDO_THETA_DEG).abs();
    let known = found.albedo.iter().filter(|albedo| albedo.albedo.is_some());
    known.min_by(|a, b| far(a).total_cmp(&far(b))).copied()
}

const fn name_of(model: Model) -> &'static str {
    match model {
        Model::Ward => "ward",
        Model::Ggx => "ggx",
    }
}

/// The parameter that says how strong the lobe is.
const fn strength_of(model: Model) -> &'static str {
    match model {
        Model::Ward => "rs",
        Model::Ggx => "f0",
    }
}

/// The parameter `name`, or the mean over its channels (`rd`, or `rd_r`, `rd_g`, `rd_b`).
fn mean(fit: &Fit, name: &str) -> Option<f64> {
    let is_of = |found: &str| {
        found
            .strip_prefix(name)
            .is_some_and(|rest| rest.is_empty() || rest.starts_with('_'))
    };
    let values: Vec<f64> = fit
        .parameters
        .iter()
        .filter(|one| is_of(&one.name))
        .map(|one| one.value)
        .collect();
    (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
}

/// A lit sphere as PNG.
fn thumbnail(brdf: &Brdf) -> Result<Value, Failure> {
    let failed = |error: std::io::Error| Failure::Failed(anyhow::anyhow!("thumbnail: {error}"));
    let rows = [vec![sphere(brdf, THUMBNAIL_PX, LIGHT_DEG)?]];
    let folder = tempfile::tempdir().map_err(failed)?;
    let path = folder.path().join("sphere.png");
    save(&sheet(&rows, automatic_exposure(&rows)), &path)?;
    Ok(Value::Blob(fs::read(&path).map_err(failed)?))
}
