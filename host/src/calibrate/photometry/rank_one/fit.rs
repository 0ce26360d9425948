//! The least squares: both fields, the sensitivities, and what part of the standard is seen.

use std::collections::HashMap;

use glam::DVec3;
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::height::unknown_axes;
use super::{Pair, Seen, dot};
use crate::base::linear_fit::least_squares;
use crate::instrument::calibration::{
    CameraFound, HIGHEST, SeenPart, SmoothField, TERMS, UNKNOWNS, Unknowns, degree, terms,
};

/// What was found.
#[derive(Clone)]
pub(in super::super) struct Fields {
    /// By how much the unknowns of [`SeenPart`] differ from what was taken for them, and their covariance, in tolerances.
    pub(in super::super) part: Option<(Unknowns, [Unknowns; UNKNOWNS])>,
    /// How far each pair of each stand is to be trusted in the next fit; nothing if all are.
    pub(super) trust: Vec<Vec<f64>>,
    pub(in super::super) sensitivity: Vec<f64>,
    pub(in super::super) throughput: SmoothField,
    pub(in super::super) intensity: SmoothField,
    pub(in super::super) uncertainty: f64,
    pub(in super::super) residual: f64,
    /// Relative standard uncertainty (k = 1) of all of it by the lamp of the stands.
    pub(in super::super) by_lamp: f64,
}

impl Fields {
    /// What pair and fields differ by beside the noise and the response of the pixels of the image's `camera`: that is each
    /// pixel's own, and not common to all that is measured.
    pub(in super::super) fn residual_beside(&self, camera: &CameraFound) -> f64 {
        let known = if camera.prnu_is_assumed { 0.0 } else { camera.prnu };
        (self.residual.powi(2) - known.powi(2)).max(0.0).sqrt()
    }
}

/// How the coefficients of the fields are held where the pairs do not determine them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in super::super) enum Held {
    /// Smooth: of a degree d within 0.5 · 0.6^d (k = 1).
    Smooth,
    /// Within 1: only so that unlit corners of the images do not make them infinite.
    Loosely,
}

impl Held {
    /// Weight with which the coefficient `term` is pulled to 0.
    fn weight(self, term: usize) -> f64 {
        match self {
            Self::Smooth => (0.5 * 0.6_f64.powi(degree(term) as i32)).powi(-2),
            Self::Loosely => 1.0,
        }
    }
}

/// Pairs count less the farther they are from the fields, in so many standard deviations, where one is at least this.
const FAR: f64 = 4.0;
const LEAST_FAR: f64 = 5e-3;
/// Pairs whose edges models have wrong alike, which count as one against what is thought of falloff.
const ALIKE: f64 = 100.0;
/// Weight that holds the standard where it is along its plane, and pupils as wide as they are said to be: light and lenses that differ a
/// little from their models would push them, farther than they are off.
const STAYS: f64 = 1e10;
/// Which of the unknowns pupils are.
const PUPILS: std::ops::Range<usize> = 3..5;

/// Both fields and the sensitivities from all that was `seen`; `None` if the pairs do not determine them. What part of the
/// sample is seen is fitted along if it is `from` somewhere: how far, in tolerances, what is taken for it is from where it is
/// thought to be.
pub(in super::super) fn fit(seen: &[Seen], held: Held, from: Option<&Unknowns>) -> Option<Fields> {
    let channels = seen[0].channels;
    let fields = channels + 2 * TERMS;
    let unknowns = fields + from.map_or(0, |from| from.len());
    let rows: Vec<Rows> = seen.iter().map(Rows::of).collect();
    let pairs = || {
        rows.iter().flat_map(|rows| {
            rows.seen
                .pairs
                .iter()
                .filter(|pair| rows.seen.takes_part(pair))
                .filter_map(|pair| Some((rows.row(pair, unknowns)?, pair)))
        })
    };
    let one = |at: usize| {
        let mut row = vec![0.0; unknowns];
        row[at] = 1.0;
        row
    };
    let pull = (0..2 * TERMS).map(|term| (one(channels + term), 0.0, held.weight(term % TERMS)));
    let near = from.into_iter().flatten().enumerate().map(|(at, from)| {
        let weight = match at {
            0..3 => 1.0,
            at if PUPILS.contains(&at) => STAYS,
            _ => ALIKE,
        };
        (one(fields + at), -from, weight)
    });
    let aside: Vec<DVec3> = from.map_or_else(Vec::new, |_| unknown_axes(seen));
    let stays = aside.iter().map(|axis| {
        let mut row = vec![0.0; unknowns];
        row[fields..fields + 3].copy_from_slice(&axis.to_array());
        (row, 0.0, STAYS)
    });
    let weighted = pairs().map(|(row, pair)| (row, pair.target(), pair.weight()));
    let (found, by_noise) = least_squares(unknowns, weighted.chain(pull).chain(near).chain(stays))?;
    let by_lamp = by_lamp(&rows, &by_noise);
    let covariance = &by_noise + outer(&by_lamp);
    let (mut excess, mut count, mut sure) = (0.0, 0_u32, 0_u32);
    let (mut uncertainties, mut mean) = (Vec::new(), DVector::zeros(unknowns));
    let total: usize = seen.iter().map(|seen| seen.pairs.len()).sum();
    for (row, pair) in pairs().step_by(total.div_ceil(2000).max(1)) {
        let row = DVector::from_vec(row);
        mean += &row;
        count += 1;
        if pair.area.is_sure {
            excess += (row.dot(&found) - pair.target()).powi(2) - pair.variance;
            sure += 1;
        }
        uncertainties.push((&covariance * &row).dot(&row).max(0.0).sqrt());
    }
    uncertainties.sort_by(f64::total_cmp);
    mean /= f64::from(count.max(1));
    let last_step = last_step(&found, &by_noise, channels)?;
    let field = |first: usize| {
        let block = covariance.view((first, first), (TERMS, TERMS));
        SmoothField::new(
            found.rows(first, TERMS).iter().copied().collect(),
            mean.rows(first, TERMS).iter().copied().collect(),
            block
                .row_iter()
                .map(|row| row.iter().copied().collect())
                .collect(),
            last_step.rows(first, TERMS).iter().copied().collect(),
        )
    };
    Some(Fields {
        trust: from.map_or_else(Vec::new, |_| rows.iter().map(|rows| rows.trust(&found)).collect()),
        part: from.map(|_| part(&found, &covariance, fields, &aside)),
        sensitivity: (0..channels).map(|channel| found[channel].exp()).collect(),
        throughput: field(channels),
        intensity: field(channels + TERMS),
        uncertainty: *uncertainties.get(uncertainties.len() / 2)?,
        residual: (excess / f64::from(sure.max(1))).max(0.0).sqrt(),
        by_lamp: by_lamp
            .iter()
            .map(|off| off.dot(&mean).powi(2))
            .sum::<f64>()
            .sqrt(),
    })
}

/// Σ v·vᵀ of some vectors, of which there is one at least.
fn outer(vectors: &[DVector<f64>]) -> DMatrix<f64> {
    vectors.iter().map(|one| one * one.transpose()).sum()
}

/// By how much the unknowns, whose covariance by noise is `by_noise`, are off (k = 1) by the lamp of each stand: as it was in black
/// frames beside the calibration, and in all others beside those.
fn by_lamp(rows: &[Rows], by_noise: &DMatrix<f64>) -> Vec<DVector<f64>> {
    let unknowns = by_noise.nrows();
    let of = |rows: &Rows, uncertainty: &dyn Fn(&Pair) -> f64| {
        let mut sum = DVector::zeros(unknowns);
        for pair in rows.seen.pairs.iter().filter(|pair| rows.seen.takes_part(pair)) {
            if let Some(row) = rows.row(pair, unknowns) {
                sum.axpy(pair.weight() * uncertainty(pair), &DVector::from_vec(row), 1.0);
            }
        }
        by_noise * sum
    };
    rows.iter()
        .flat_map(|rows| [of(rows, &|pair| pair.common), of(rows, &|_| rows.seen.lamp[1])])
        .collect()
}

/// What `found` says of what part of the standard is seen, whose unknowns are those from `first` on, and its covariance: along the axes
/// `aside` the standard is known as well as it was put there, and pupils as well as they are said to be.
fn part(
    found: &DVector<f64>,
    covariance: &DMatrix<f64>,
    first: usize,
    aside: &[DVec3],
) -> (Unknowns, [Unknowns; UNKNOWNS]) {
    let put = |row: usize, column: usize| -> f64 {
        if row.max(column) > 2 {
            return if row == column && PUPILS.contains(&row) {
                1.0
            } else {
                0.0
            };
        }
        let tolerances = SeenPart::TOLERANCES[row] * SeenPart::TOLERANCES[column];
        let of = |axis: &DVec3| axis[row] * axis[column] * SeenPart::ALONG_M.powi(2) / tolerances;
        aside.iter().map(of).sum()
    };
    let of = |row: usize, column: usize| covariance[(first + row, first + column)] + put(row, column);
    (
        std::array::from_fn(|at| found[first + at]),
        std::array::from_fn(|row| std::array::from_fn(|column| of(row, column))),
    )
}

/// By how much the unknowns `found` (sensitivities of the channels, then both fields) differ from those of a fit in which the
/// terms of the highest degree are 0.
fn last_step(found: &DVector<f64>, covariance: &DMatrix<f64>, channels: usize) -> Option<DVector<f64>> {
    let highest: Vec<usize> = [channels, channels + TERMS]
        .into_iter()
        .flat_map(|first| HIGHEST.map(move |term| first + term))
        .collect();
    let to_highest = covariance.select_columns(&highest);
    let own = to_highest.select_rows(&highest).cholesky()?;
    Some(to_highest * own.solve(&found.select_rows(&highest)))
}

/// The rows of least squares that pairs make.
struct Rows<'a> {
    seen: &'a Seen<'a>,
    /// Terms of throughput of each pixel that takes part, and of light of each place that does.
    throughput: HashMap<u32, [f64; TERMS]>,
    intensity: Vec<Option<[f64; TERMS]>>,
}

impl<'a> Rows<'a> {
    fn of(seen: &'a Seen<'a>) -> Self {
        let throughput = seen
            .pixels
            .iter()
            .map(|(index, [x, y], _)| (*index as u32, terms(*x, *y)));
        let intensity = seen.lit.iter().map(|lit| lit.map(|([x, y], _)| terms(x, y)));
        Self {
            seen,
            throughput: throughput.collect(),
            intensity: intensity.collect(),
        }
    }

    /// How far each pair is to be trusted beside what was `found`: edges that are not where they are thought to be must not
    /// bend the next fields.
    fn trust(&self, found: &DVector<f64>) -> Vec<f64> {
        let of = |pair: &Pair| {
            let row = self.row(pair, found.len())?;
            let far = (dot(&row, found) - pair.target()).powi(2);
            let expected = pair.weight.recip() + pair.area.variance + LEAST_FAR * LEAST_FAR;
            Some((1.0 + far / (FAR * FAR * expected)).recip())
        };
        self.seen
            .pairs
            .par_iter()
            .map(|pair| of(pair).unwrap_or(1.0))
            .collect()
    }

    /// Of so many `unknowns`; if they are more than those of the fields, they are those of what part of the sample is seen too.
    fn row(&self, pair: &Pair, unknowns: usize) -> Option<Vec<f64>> {
        let channels = self.seen.channels;
        let mut row = vec![0.0; unknowns];
        row[pair.channel as usize] = 1.0;
        row[channels..channels + TERMS].copy_from_slice(self.throughput.get(&pair.pixel)?);
        row[channels + TERMS..][..TERMS].copy_from_slice(self.intensity[pair.place as usize].as_ref()?);
        row[channels + 2 * TERMS..].copy_from_slice(&pair.area.slopes[..unknowns - channels - 2 * TERMS]);
        Some(row)
    }
}
