//! Files: what they are, and other programs' formats.

use std::path::{Path, PathBuf};

use pyo3::prelude::*;
use rcg::assemble::fill::{self as filling, Options, Way};
use rcg::base::file_format::Formats;
use rcg::brdf::Source;
use rcg::brdf::format::{self, About, Form, Format, Resolution};

use crate::failure::Failure;
use crate::long_work;

/// Answers as JSON.
pub(crate) fn json(answer: &impl serde::Serialize) -> String {
    serde_json::to_string(answer).expect("invariant: answers are made of names and numbers")
}

/// Names of formats and how their files end.
#[pyfunction]
pub(crate) fn formats() -> Vec<(&'static str, Vec<&'static str>)> {
    let both = |format: Format| (format.name(), format.endings().to_vec());
    Format::ALL.map(both).to_vec()
}

/// What a file or a model is, as JSON.
#[pyfunction]
pub(crate) fn info(py: Python<'_>, spec: &str) -> PyResult<String> {
    long_work::run(py, |_| {
        let source = Source::open(spec)?;
        Ok(json(&format::info::of(spec, &source)?))
    })
}

/// Writes a file of another program; what came of it as JSON.
#[pyfunction]
#[expect(clippy::too_many_arguments, reason = "each is one of Python's")]
pub(crate) fn export(
    py: Python<'_>,
    spec: &str,
    to: &str,
    out: PathBuf,
    step_deg: Option<f64>,
    resolution: Option<usize>,
    incident_deg: Option<[f64; 2]>,
    zeros: bool,
    table: Option<&str>,
    written: String,
) -> PyResult<String> {
    let known = Format::ALL.into_iter().find(|format| format.name() == to);
    let to = known.ok_or_else(|| {
        let names = Format::ALL.map(Format::name).join(", ");
        Failure::input(format!("to: expected one of {names}, found {to}"))
    })?;
    if let Some(step_deg) = step_deg.filter(|step| !(0.5..=45.0).contains(step)) {
        return Err(Failure::input(format!(
            "step_deg: expected degrees from 0.5 to 45, found {step_deg}"
        ))
        .into());
    }
    if incident_deg.is_some() && to != Format::Csv {
        return Err(Failure::input(format!("incident_deg: expected to=\"csv\", found {}", to.name())).into());
    }
    let is_direction = |[theta, phi]: &[f64; 2]| (0.0..90.0).contains(theta) && (0.0..360.0).contains(phi);
    if let Some([theta, phi]) = incident_deg.filter(|angles| !is_direction(angles)) {
        let expected = "a polar angle below 90 and an azimuth below 360, degrees";
        return Err(
            Failure::input(format!("incident_deg: expected {expected}, found {theta}, {phi}")).into(),
        );
    }
    if resolution.is_some() && to != Format::Bsdf {
        return Err(Failure::input(format!("resolution: expected to=\"bsdf\", found {}", to.name())).into());
    }
    let form = match table {
        None => None,
        Some(_) if to != Format::Bsdf => {
            return Err(Failure::input(format!("table: expected to=\"bsdf\", found {}", to.name())).into());
        }
        Some("dense") => Some(Form::Dense),
        Some("compact") => Some(Form::Compact),
        Some(other) => {
            return Err(Failure::input(format!("table: expected dense or compact, found {other}")).into());
        }
    };
    let resolution = Resolution {
        step_deg: step_deg.unwrap_or(0.0),
        side: resolution.unwrap_or(0),
        incident_deg,
        zeros,
        form,
    };
    long_work::run(py, |patience| {
        Formats::new(to.endings()).of(&out)?;
        let about = About {
            name: spec.to_owned(),
            written,
        };
        let source = Source::open(spec)?;
        Ok(json(&format::export(
            &source,
            &about,
            (to, resolution),
            &out,
            patience,
        )?))
    })
}

/// Fills what captures do not reach; what came of it as JSON.
#[pyfunction]
pub(crate) fn fill(
    py: Python<'_>,
    brdfs: Vec<PathBuf>,
    out: PathBuf,
    without: Vec<String>,
    any_scale: bool,
) -> PyResult<String> {
    let way = |name: &String| match name.as_str() {
        "reciprocity" => Ok(Way::Reciprocity),
        "wire" => Ok(Way::Wire),
        "model" => Ok(Way::Model),
        other => Err(Failure::input(format!(
            "without: expected reciprocity, wire or model, found {other}"
        ))),
    };
    let options = Options {
        without: without.iter().map(way).collect::<Result<_, _>>()?,
        is_any_scale: any_scale,
    };
    let brdfs: Vec<PathBuf> = brdfs.iter().map(|path| brdf_of(path)).collect();
    let Some((first, others)) = brdfs.split_first() else {
        return Err(Failure::input("brdfs: expected at least one, found none").into());
    };
    long_work::run(py, |patience| {
        Ok(json(&filling::fill(first, others, &out, &options, patience)?))
    })
}

/// The brdf.zarr at `path`, or that of the measurement there.
fn brdf_of(path: &Path) -> PathBuf {
    let own = path.join("brdf.zarr");
    if own.is_dir() { own } else { path.to_owned() }
}
