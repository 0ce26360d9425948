//! Values of a BRDF at arrays of directions.

use glam::DVec3;
use numpy::ndarray::{Array2, ArrayView2};
use numpy::{IntoPyArray as _, PyArray2, PyReadonlyArray2};
use pyo3::prelude::*;
use rayon::prelude::*;
use rcg::brdf::Stated;
use rcg::brdf::interpolation::Interpolation;
use rcg::brdf::reflectance::{Missing, Reflectance as _, Value};
use rcg::brdf::sample::Sample;
use rcg::brdf::{HeldBrdf, Source};
use rcg::instrument::optics::Unmeasurable;

use crate::failure::Failure;

/// Pairs that are answered between two looks at signals: some tens of milliseconds.
const BATCH: usize = 1 << 17;
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

    /// f, [pair, channel].
    fn eval<'py>(
        &self,
        py: Python<'py>,
        wi: PyReadonlyArray2<'py, f64>,
        wo: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let shape = self.channels();
        answered(py, [wi.as_array(), wo.as_array()], shape, |pairs, out| {
            if let Values::Held(held) = &self.values {
                let rows = out.par_chunks_exact_mut(shape).zip(pairs);
                rows.for_each(|(row, &(wi, wo))| write(row, held.value(wi, wo).ok()));
                return Ok(());
            }
            let rows = out.chunks_exact_mut(shape).zip(self.values.of(pairs)?);
            rows.for_each(|(row, value)| write(row, value.ok()));
            Ok(())
        })
    }

    /// Standard uncertainties of f, [pair, channel].
    fn sigma<'py>(
        &self,
        py: Python<'py>,
        wi: PyReadonlyArray2<'py, f64>,
        wo: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let Some(brdf) = self.measured() else {
            let expected = "expected a brdf.zarr, which states how uncertain it is";
            return Err(Failure::input(format!("sigma: {expected}, found {}", self.spec)).into());
        };
        let shape = brdf.channels();
        answered(py, [wi.as_array(), wo.as_array()], shape, |pairs, out| {
            let rows = out.chunks_exact_mut(shape).zip(brdf.stated(pairs)?);
            let sigma = |stated: Stated| stated.sigma;
            rows.for_each(|(row, stated)| write(row, stated.ok().map(sigma)));
            Ok(())
        })
    }

    /// Codes of why there is no value, 0 where there is one, [pair, 1].
    fn reason<'py>(
        &self,
        py: Python<'py>,
        wi: PyReadonlyArray2<'py, f64>,
        wo: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray2<u8>>> {
        answered(py, [wi.as_array(), wo.as_array()], 1, |pairs, out| {
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

/// What `answer` writes for the pairs of the rows of `views` (incident, outgoing), [pair, `columns`]; without Python's lock, batch by
/// batch, so that signals are heard.
fn answered<'py, T: numpy::Element + Default + Copy>(
    py: Python<'py>,
    views: [ArrayView2<'_, f64>; 2],
    columns: usize,
    answer: impl Fn(&[Pair], &mut [T]) -> Result<(), Failure> + Send + Sync,
) -> PyResult<Bound<'py, PyArray2<T>>> {
    let rows = views[0].nrows();
    let mut all = vec![T::default(); rows * columns];
    for (batch, out) in all.chunks_mut(BATCH * columns).enumerate() {
        // With the lock: nobody writes to the arrays meanwhile.
        let pairs = pairs(&views, batch * BATCH, out.len() / columns)?;
        py.detach(|| answer(&pairs, out))?;
        py.check_signals()?;
    }
    let table = Array2::from_shape_vec((rows, columns), all).expect("invariant: so many were made");
    Ok(table.into_pyarray(py))
}

/// `count` pairs from the row `first` on.
fn pairs(views: &[ArrayView2<'_, f64>; 2], first: usize, count: usize) -> Result<Vec<Pair>, Failure> {
    let direction =
        |view: &ArrayView2<'_, f64>, row: usize| DVec3::from_array([0, 1, 2].map(|axis| view[[row, axis]]));
    let [wi, wo] = views;
    let pairs: Vec<Pair> = (first..first + count)
        .into_par_iter()
        .map(|row| (direction(wi, row), direction(wo, row)))
        .collect();
    let is_unit = |w: DVec3| (w.length() - 1.0).abs() <= UNIT;
    let bad = pairs
        .par_iter()
        .position_first(|&(wi, wo)| !is_unit(wi) || !is_unit(wo));
    match bad {
        None => Ok(pairs),
        Some(place) => {
            let (wi, wo) = pairs[place];
            let (name, w) = if is_unit(wi) { ("wo", wo) } else { ("wi", wi) };
            let row = first + place;
            Err(Failure::input(format!(
                "{name}[{row}]: expected a unit vector, found ({}, {}, {}), whose length is {}",
                w.x,
                w.y,
                w.z,
                w.length()
            )))
        }
    }
}
