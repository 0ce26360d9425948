//! Values of a BRDF at arrays of directions.

use glam::DVec3;
use numpy::{IntoPyArray as _, PyArray1, PyReadonlyArray1};
use pyo3::prelude::*;
use rayon::prelude::*;
use rcg::brdf::Stated;
use rcg::brdf::interpolation::Interpolation;
use rcg::brdf::reflectance::{Missing, Reflectance as _, Value};
use rcg::brdf::sample::Sample;
use rcg::brdf::{HeldBrdf, Source};
use rcg::instrument::optics::Unmeasurable;

use crate::failure::Failure;

/// Pairs that are answered between two looks at signals: some tenths of a second, and so many that they can be answered in the order of
/// memory.
const BATCH: usize = 1 << 20;
/// How far from 1 the length of a direction may be: more than single precision rounds.
const UNIT: f64 = 1e-5;
/// Codes after those of [`Unmeasurable`].
const SATURATED: u8 = 7;
const UNKNOWN: u8 = 8;

type Pair = (DVec3, DVec3);

/// Where the values come from.
enum Values {
    /// A `brdf.zarr` in memory.
    Held(Box<HeldBrdf>),
    /// A `brdf.zarr` that stays on disk.
    OnDisk(Box<rcg::brdf::Brdf>, Interpolation),
    /// A known sample.
    Known(Box<dyn Sample>),
}

impl Values {
    fn of(&self, pairs: &[Pair]) -> Result<Vec<Value>, Failure> {
        Ok(match self {
            Self::Held(held) => held.values(pairs)?,
            Self::OnDisk(brdf, interpolation) => brdf.interpolated(pairs, *interpolation)?,
            Self::Known(sample) => sample.values(pairs)?,
        })
    }
}

/// A BRDF.
#[pyclass(frozen, module = "rcg._rcg")]
pub(crate) struct Brdf {
    spec: String,
    values: Values,
}

#[pymethods]
impl Brdf {
    #[new]
    fn new(py: Python<'_>, spec: &str, interpolation: &str, in_memory: bool) -> PyResult<Self> {
        let interpolation = Interpolation::named(interpolation).ok_or_else(|| {
            let names = Interpolation::ALL.map(Interpolation::name).join(", ");
            Failure::input(format!(
                "interpolation: expected one of {names}, found {interpolation}"
            ))
        })?;
        let opened = py.detach(|| -> Result<Values, Failure> {
            Ok(match Source::open(spec)? {
                Source::Measured(brdf) if in_memory => {
                    Values::Held(Box::new(HeldBrdf::read(*brdf, interpolation)?))
                }
                Source::Measured(brdf) => Values::OnDisk(brdf, interpolation),
                Source::Known(sample) => Values::Known(sample),
            })
        })?;
        Ok(Self {
            spec: spec.to_owned(),
            values: opened,
        })
    }

    /// 1 or 3.
    #[getter]
    fn channels(&self) -> usize {
        self.measured().map_or(3, rcg::brdf::Brdf::channels)
    }

    /// f, [pair, channel], one after the other; directions are too, [pair, axis].
    fn eval<'py>(
        &self,
        py: Python<'py>,
        wi: PyReadonlyArray1<'py, f64>,
        wo: PyReadonlyArray1<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let shape = self.channels();
        answered(py, [&wi, &wo], shape, |pairs, out| {
            let rows = out.par_chunks_exact_mut(shape).zip(self.values.of(pairs)?);
            rows.for_each(|(row, value)| write(row, value.ok()));
            Ok(())
        })
    }

    /// Standard uncertainties of f, as [`eval`](Self::eval).
    fn sigma<'py>(
        &self,
        py: Python<'py>,
        wi: PyReadonlyArray1<'py, f64>,
        wo: PyReadonlyArray1<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let Some(brdf) = self.measured() else {
            let expected = "expected a brdf.zarr, which states how uncertain it is";
            return Err(Failure::input(format!("sigma: {expected}, found {}", self.spec)).into());
        };
        let shape = brdf.channels();
        answered(py, [&wi, &wo], shape, |pairs, out| {
            let rows = out.chunks_exact_mut(shape).zip(brdf.stated(pairs)?);
            let sigma = |stated: Stated| stated.sigma;
            rows.for_each(|(row, stated)| write(row, stated.ok().map(sigma)));
            Ok(())
        })
    }

    /// Codes of why there is no value, 0 where there is one, [pair].
    fn reason<'py>(
        &self,
        py: Python<'py>,
        wi: PyReadonlyArray1<'py, f64>,
        wo: PyReadonlyArray1<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray1<u8>>> {
        answered(py, [&wi, &wo], 1, |pairs, out| {
            for (out, value) in out.iter_mut().zip(self.values.of(pairs)?) {
                *out = value.err().map_or(0, code);
            }
            Ok(())
        })
    }
}

impl Brdf {
    fn measured(&self) -> Option<&rcg::brdf::Brdf> {
        match &self.values {
            Values::Held(held) => Some(held.brdf()),
            Values::OnDisk(brdf, _) => Some(brdf),
            Values::Known(_) => None,
        }
    }
}

/// Codes of [`Brdf::reason`] and their words.
#[pyfunction]
pub(crate) fn reasons() -> Vec<(u8, String)> {
    let instrument = Unmeasurable::ALL.map(Missing::Outgoing);
    let all = instrument
        .into_iter()
        .chain([Missing::Saturated, Missing::Unknown]);
    all.map(|missing| (code(missing), missing.to_string())).collect()
}

fn code(missing: Missing) -> u8 {
    match missing {
        Missing::Incident(reason) | Missing::Outgoing(reason) => reason.code(),
        Missing::Saturated => SATURATED,
        Missing::Unknown => UNKNOWN,
    }
}

/// Writes a value to a row of one or three channels, or NaN.
fn write(row: &mut [f64], value: Option<[f32; 3]>) {
    match value {
        Some(value) => row.iter_mut().zip(value).for_each(|(out, f)| *out = f64::from(f)),
        None => row.fill(f64::NAN),
    }
}

/// What `answer` writes for the pairs of `directions` (incident, outgoing), [pair, `columns`]; without Python's lock, batch by batch, so
/// that signals are heard.
fn answered<'py, T: numpy::Element + Default + Copy>(
    py: Python<'py>,
    directions: [&PyReadonlyArray1<'py, f64>; 2],
    columns: usize,
    answer: impl Fn(&[Pair], &mut [T]) -> Result<(), Failure> + Send + Sync,
) -> PyResult<Bound<'py, PyArray1<T>>> {
    let [wi, wo] = [directions[0].as_slice()?, directions[1].as_slice()?].map(triples);
    let mut all = vec![T::default(); wi.len() * columns];
    for (batch, out) in all.chunks_mut(BATCH * columns).enumerate() {
        let first = batch * BATCH;
        let rows = first..first + out.len() / columns;
        // With the lock: nobody writes to the arrays meanwhile.
        let pairs = pairs(&wi[rows.clone()], &wo[rows], first)?;
        py.detach(|| answer(&pairs, out))?;
        py.check_signals()?;
    }
    Ok(all.into_pyarray(py))
}

/// Numbers as vectors.
fn triples(numbers: &[f64]) -> &[[f64; 3]] {
    numbers.as_chunks().0
}

/// The pairs of `wi` and `wo`, the first of which is the one of this number.
fn pairs(wi: &[[f64; 3]], wo: &[[f64; 3]], first: usize) -> Result<Vec<Pair>, Failure> {
    let both = wi.par_iter().zip(wo);
    let pairs: Vec<Pair> = both
        .map(|(wi, wo)| (DVec3::from_array(*wi), DVec3::from_array(*wo)))
        .collect();
    let is_unit = |w: DVec3| (w.length() - 1.0).abs() <= UNIT;
    let bad = pairs
        .par_iter()
        .position_first(|&(wi, wo)| !is_unit(wi) || !is_unit(wo));
    let Some(place) = bad else {
        return Ok(pairs);
    };
    let (wi, wo) = pairs[place];
    let (name, w) = if is_unit(wi) { ("wo", wo) } else { ("wi", wi) };
    let (row, length) = (first + place, w.length());
    Err(Failure::input(format!(
        "{name}[{row}]: expected a unit vector, found ({}, {}, {}), whose length is {length}",
        w.x, w.y, w.z
    )))
}
