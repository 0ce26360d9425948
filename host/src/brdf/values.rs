//! Look-ups in a file.

use std::ops::Range;

use glam::DVec3;
use rayon::prelude::*;

use super::Brdf;
use super::held::Busy;
use crate::brdf::interpolation::{
    Blend, BranchErrors, Captures, Cells, Image, ImageOf, Interpolation, Lookup, captured, learn, look_up,
    walk,
};
use crate::brdf::reflectance::{Missing, Value};
use crate::hemisphere::direction::{is_above_horizon, to_degrees};
use crate::hemisphere::incident::IncidentSet;
use crate::instrument::optics::Unmeasurable;
use crate::store::provenance::Provenance;
use crate::store::{BrdfRows, StoreError};

/// Pairs for which a file is read once, where many are asked: each takes some 60 bytes meanwhile.
const AT_ONCE: usize = 1 << 22;
/// As that, of pairs that are answered with their uncertainties: each takes some 800 bytes.
const STATED_AT_ONCE: usize = 1 << 18;
/// As that, of what was measured itself: some 250 bytes.
const SEEN_AT_ONCE: usize = 1 << 20;
/// Bytes of the file that are in memory at a time, about.
const GROUP_BYTES: usize = 1 << 28;

/// What a file says of a pair of directions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stated {
    /// f in sr⁻¹ per channel; a single channel is repeated.
    pub f: [f32; 3],
    /// Its standard uncertainty (k = 1) in sr⁻¹: that of the captured values as if the errors of neighbours were the same, and that of
    /// interpolation between them.
    pub sigma: [f32; 3],
    /// What of that interpolation makes, sr⁻¹.
    pub interpolation: [f32; 3],
    /// What of it all values of the file have in common, sr⁻¹: standards, lamp and stray light.
    pub common: [f32; 3],
    /// The weakest origin of what took part, in the order of [`Provenance::ALL`].
    pub provenance: Provenance,
}

impl Stated {
    /// Share of the variance, 0 to 1, that all values of the file have in common, the largest of the channels.
    #[must_use]
    pub fn common_share(&self) -> f32 {
        let shares = self.common.iter().zip(self.sigma);
        shares.fold(0.0, |most, (common, sigma)| {
            most.max((common / sigma).powi(2).min(1.0))
        })
    }
}

impl Brdf {
    /// f with its uncertainty for pairs of unit vectors (incident, outgoing), both away from the surface, in the order asked: the
    /// values are those of [`values`](Self::values).
    ///
    /// # Errors
    /// [`StoreError`].
    pub fn stated(&self, pairs: &[(DVec3, DVec3)]) -> Result<Vec<Result<Stated, Missing>>, StoreError> {
        let blend = Blend::new(Interpolation::Blended, self.errors.as_ref());
        let mut all = Vec::with_capacity(pairs.len());
        for batch in pairs.chunks(STATED_AT_ONCE) {
            let found = above_the_horizon(batch, |above| {
                let both = Lookup::all(&self.grid, &blend, above, true);
                let [values, sigmas] = self.both(both, &|provenance| provenance)?;
                let both = values.iter().zip(&sigmas).zip(above);
                Ok(both
                    .map(|((value, sigma), pair)| {
                        let stated = self.stated_of(value, sigma, *pair);
                        Some(stated.ok_or(f64::from(value.saturated())))
                    })
                    .collect())
            })?;
            all.extend(batch.iter().zip(found).map(|(&(wi, wo), found)| {
                found
                    .unwrap_or(Err(0.0))
                    .map_err(|saturated| self.missing(wi, wo, saturated))
            }));
        }
        Ok(all)
    }

    /// What the look-ups of a `value` and of its `sigma` say of a pair of directions.
    fn stated_of(&self, value: &Lookup, sigma: &Lookup, (wi, wo): (DVec3, DVec3)) -> Option<Stated> {
        let (f, captured) = (value.value()?, sigma.value()?);
        let interpolation = value.interpolation_error(self.errors.as_ref())?;
        let [theta_i, theta_o] = [wi, wo].map(|w| to_degrees(w).0);
        let offset = self.shared_part(theta_i, theta_o).sqrt();
        let factor = self.common_uncertainty().unwrap_or(0.0);
        let each = |of: &dyn Fn(usize) -> f32| [0, 1, 2].map(of);
        Some(Stated {
            f,
            sigma: each(&|channel| captured[channel].hypot(interpolation[channel])),
            interpolation,
            common: each(&|channel| {
                let all = (factor * f64::from(f[channel])).hypot(offset * f64::from(captured[channel]));
                (all as f32).min(captured[channel])
            }),
            provenance: Provenance::from_code(value.weakest())
                .filter(|origin| *origin != Provenance::Missing)?,
        })
    }

    /// How many pairs are best asked for together, if the file is read for each time that it is asked; `None` of one that will be held.
    pub(crate) fn at_once(&self) -> Option<usize> {
        let is_held = self.busy.is_some() && Busy::will_hold(self);
        (!is_held).then_some(AT_ONCE)
    }

    /// f for pairs of unit vectors (incident, outgoing), both away from the surface, in the order asked.
    ///
    /// # Errors
    /// [`StoreError`].
    pub fn values(&self, pairs: &[(DVec3, DVec3)]) -> Result<Vec<Value>, StoreError> {
        let held = self.busy.as_ref().map(|busy| busy.held(self, pairs.len()));
        match held.transpose()?.flatten() {
            Some(held) => Ok(held.values(self, pairs)),
            None => self.interpolated(pairs, Interpolation::Blended),
        }
    }

    /// As [`values`](Self::values), found by `interpolation`.
    ///
    /// # Errors
    /// [`StoreError`].
    pub fn interpolated(
        &self,
        pairs: &[(DVec3, DVec3)],
        interpolation: Interpolation,
    ) -> Result<Vec<Value>, StoreError> {
        let blend = Blend::new(interpolation, self.errors.as_ref());
        let mut values = Vec::with_capacity(pairs.len());
        for batch in pairs.chunks(AT_ONCE) {
            let value = |(wi, wo), found: Result<[f32; 3], f32>| {
                found.map_err(|saturated| self.missing(wi, wo, f64::from(saturated)))
            };
            values.extend(walk(self, &blend, batch, value)?);
        }
        Ok(values)
    }

    /// What leaving images out says of the rules of interpolation; `None` if there are too few. Values that were filled in
    /// have no part: each would be predicted by what it was made from.
    ///
    /// # Errors
    /// [`StoreError`].
    pub(crate) fn learn(&self) -> Result<Option<BranchErrors>, StoreError> {
        learn(&Seen(self))
    }

    /// f in sr⁻¹ for pairs of unit vectors (incident, outgoing) by direct interpolation of what was measured itself, not
    /// filled in; `None` where less than half of the weight was.
    ///
    /// # Errors
    /// [`StoreError`].
    pub(crate) fn measured(&self, pairs: &[(DVec3, DVec3)]) -> Result<Vec<Option<[f32; 3]>>, StoreError> {
        let mut values = Vec::with_capacity(pairs.len());
        for batch in pairs.chunks(SEEN_AT_ONCE) {
            values.extend(self.seen(batch)?);
        }
        Ok(values)
    }

    fn seen(&self, pairs: &[(DVec3, DVec3)]) -> Result<Vec<Option<[f32; 3]>>, StoreError> {
        let blend = Blend::new(Interpolation::Direct, None);
        above_the_horizon(pairs, |above| {
            Ok(look_up(&Seen(self), &blend, above)?
                .iter()
                .map(Lookup::value)
                .collect())
        })
    }

    /// Why there is no value; `saturated` is the weight of the samples that saturated.
    pub(super) fn missing(&self, wi: DVec3, wo: DVec3, saturated: f64) -> Missing {
        if !is_above_horizon(wi) {
            return Missing::Incident(Unmeasurable::BelowHorizon);
        }
        // The heaviest neighbour that has a reason.
        let incident = heaviest(&self.grid.neighbours(wi), &self.incident);
        let outgoing = match self.disk.neighbours(wo) {
            // The cells beyond the rim of the disk are below the horizon; this direction is not.
            Some(cells) if is_above_horizon(wo) => {
                heaviest(&cells, &self.outgoing).map(|(weight, reason)| match reason {
                    Unmeasurable::BelowHorizon => (weight, Unmeasurable::OutsideImage),
                    reason => (weight, reason),
                })
            }
            _ => Some((1.0, Unmeasurable::BelowHorizon)),
        };
        match (incident, outgoing) {
            (Some((a, reason)), Some((b, _))) if a >= b => Missing::Incident(reason),
            (_, Some((weight, reason))) if weight > saturated => Missing::Outgoing(reason),
            (Some((weight, reason)), _) if weight > saturated => Missing::Incident(reason),
            _ => Missing::Saturated,
        }
    }
}

impl Captures for Brdf {
    fn set(&self) -> &IncidentSet {
        &self.grid
    }

    fn cells(&self) -> &Cells {
        &self.cells
    }

    fn is_captured(&self, row: usize) -> bool {
        self.incident[row].is_none()
    }

    fn scan(
        &self,
        wanted: &[bool],
        each: &mut dyn FnMut(Range<usize>, ImageOf<'_>),
    ) -> Result<(), StoreError> {
        let pick = |rows: BrdfRows| ([rows.f, Vec::new()], rows.provenance);
        self.scan_rows(wanted, &pick, &mut |group, [values, _]| each(group, values))
    }
}

/// What `find` finds of the pairs above the horizon, and nothing of the others, in the order asked.
fn above_the_horizon<T: Copy>(
    pairs: &[(DVec3, DVec3)],
    find: impl Fn(&[(DVec3, DVec3)]) -> Result<Vec<Option<T>>, StoreError>,
) -> Result<Vec<Option<T>>, StoreError> {
    let is_above = |pair: &(DVec3, DVec3)| Missing::at_horizon(pair.0, pair.1).is_none();
    let above: Vec<_> = pairs.iter().filter(|pair| is_above(pair)).copied().collect();
    let mut found = find(&above)?.into_iter();
    Ok(pairs
        .iter()
        .map(|pair| is_above(pair).then(|| found.next().flatten()).flatten())
        .collect())
}

/// Codes of provenance as if nothing but what was measured itself stood in the file.
fn only_seen(mut provenance: Vec<u8>) -> Vec<u8> {
    for code in &mut provenance {
        if !Provenance::from_code(*code).is_some_and(Provenance::is_seen) {
            *code = Provenance::Missing.code();
        }
    }
    provenance
}

/// What was measured itself, and nothing else.
struct Seen<'a>(&'a Brdf);

fn sigmas_of(rows: &BrdfRows) -> Vec<f32> {
    rows.sigma.iter().map(|sigma| sigma.to_f32()).collect()
}

impl Captures for Seen<'_> {
    fn set(&self) -> &IncidentSet {
        &self.0.grid
    }

    fn cells(&self) -> &Cells {
        &self.0.cells
    }

    fn is_captured(&self, row: usize) -> bool {
        self.0.is_captured(row)
    }

    fn scan(
        &self,
        wanted: &[bool],
        each: &mut dyn FnMut(Range<usize>, ImageOf<'_>),
    ) -> Result<(), StoreError> {
        let pick = |rows: BrdfRows| ([rows.f, Vec::new()], only_seen(rows.provenance));
        self.0
            .scan_rows(wanted, &pick, &mut |group, [values, _]| each(group, values))
    }
}

/// What is taken from the rows of a file: values, or standard uncertainties in their place, or both, [cell, channel]; and provenance.
type Taken = ([Vec<f32>; 2], Vec<u8>);

impl Brdf {
    /// f and its standard uncertainty in sr⁻¹ for pairs of unit vectors (incident, outgoing), found by direct
    /// interpolation of what was measured itself; `None` where there is no value, or the incident direction is in a gap
    /// between those that were captured.
    ///
    /// # Errors
    /// [`StoreError`].
    pub(crate) fn with_sigma(
        &self,
        pairs: &[(DVec3, DVec3)],
    ) -> Result<Vec<Option<[[f32; 3]; 2]>>, StoreError> {
        let blend = Blend::new(Interpolation::Direct, None);
        above_the_horizon(pairs, |above| {
            let both = Lookup::all(&self.grid, &blend, above, false);
            let [values, sigmas] = self.both(both, &only_seen)?;
            let both = values.iter().zip(&sigmas);
            Ok(both
                .zip(above)
                .map(|((value, sigma), (wi, _))| {
                    let both = [value.value()?, sigma.value()?];
                    self.grid.is_spanned(*wi).then_some(both)
                })
                .collect())
        })
    }

    /// Standard uncertainty of f in sr⁻¹ that comes from reading the exchanged pair of (`wi`, `wo`) in place of it, where f is
    /// about `f`: what that was wrong by where both were captured. 0 if nobody knows.
    pub(crate) fn exchange_error(&self, wi: DVec3, wo: DVec3, f: f64) -> f64 {
        self.errors
            .as_ref()
            .map_or(0.0, |errors| errors.of_exchange(wi, wo, f))
    }

    /// What values, and standard uncertainties in place of them, say of the same look-ups, by one walk through the file; `of` has the codes
    /// of provenance by which there is a value. Linear interpolation of uncertainties is that of fully correlated errors, the largest it can
    /// be.
    fn both(
        &self,
        mut values: Vec<Lookup>,
        of: &(dyn Fn(Vec<u8>) -> Vec<u8> + Sync),
    ) -> Result<[Vec<Lookup>; 2], StoreError> {
        let mut sigmas: Vec<Lookup> = values.iter().map(Lookup::plain).collect();
        let captured = captured(self);
        let wanted = Lookup::wanted(&values, self.grid.len());
        let pick = |rows: BrdfRows| {
            let sigmas = sigmas_of(&rows);
            ([rows.f, sigmas], of(rows.provenance))
        };
        self.scan_rows(&wanted, &pick, &mut |group, [f, sigma]| {
            Lookup::gather_all(&mut values, &self.cells, &captured, &group, f);
            Lookup::gather_all(&mut sigmas, &self.cells, &captured, &group, sigma);
        })?;
        Ok([values, sigmas])
    }

    /// [`Captures::scan`] of what `pick` takes from the rows, whose two kinds of images come side by side.
    fn scan_rows(
        &self,
        wanted: &[bool],
        pick: &(dyn Fn(BrdfRows) -> Taken + Sync),
        each: &mut dyn FnMut(Range<usize>, [ImageOf<'_>; 2]),
    ) -> Result<(), StoreError> {
        let (cells, channels) = (self.disk.len(), self.channels());
        let needed: Vec<usize> = (0..self.chunks())
            .filter(|&chunk| {
                let mut rows = self.chunk_range(chunk);
                rows.any(|row| wanted[row] && self.is_captured(row))
            })
            .collect();
        let chunk_rows = self.reader.layout().chunk;
        let at_once = (GROUP_BYTES / (chunk_rows * cells * (8 * channels + 1))).max(1);
        for group in needed.chunks(at_once) {
            let held: Vec<_> = group
                .par_iter()
                .map(|&chunk| Ok((chunk, self.chunk(chunk)?.map(pick))))
                .collect::<Result<_, StoreError>>()?;
            let image = |of: usize, row: usize| {
                let place = held
                    .binary_search_by_key(&(row / chunk_rows), |held| held.0)
                    .ok()?;
                let (values, provenance) = held[place].1.as_ref().filter(|_| self.is_captured(row))?;
                let row = row % chunk_rows;
                Some(Image {
                    f: &values[of][row * cells * channels..][..cells * channels],
                    provenance: Some(&provenance[row * cells..][..cells]),
                    channels,
                })
            };
            let first = self.chunk_range(group[0]).start;
            let last = self.chunk_range(group[group.len() - 1]).end;
            each(first..last, [&|row| image(0, row), &|row| image(1, row)]);
        }
        Ok(())
    }
}

fn heaviest(neighbours: &[(usize, f64)], reasons: &[Option<Unmeasurable>]) -> Option<(f64, Unmeasurable)> {
    neighbours
        .iter()
        .filter_map(|&(index, weight)| reasons[index].map(|reason| (weight, reason)))
        .max_by(|a, b| a.0.total_cmp(&b.0))
}
