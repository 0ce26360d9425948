//! What one chunk adds to the figures, and all of them together.

use std::f64::consts::PI;

use glam::DVec3;

use super::Albedo;
use super::histogram::LogHistogram;
use super::scoring::{Floor, channel_values};
use crate::brdf::Brdf;
use crate::brdf::sample::Sample;
use crate::hemisphere::incident::IncidentSet;
use crate::hemisphere::judged::is_judged;
use crate::store::StoreError;
use crate::store::provenance::Provenance;

/// Bins of the polar angle in degrees where the incident directions form no rings.
const LIST_BIN_DEG: f64 = 5.0;
/// Share of ∫ cosθo dωo that has to have values for an albedo: what is missing reflects nobody knows what.
const WHOLE: f64 = 0.99;

/// Bins of the incident polar angle: the rings of the grid, or a list's share of them.
pub(super) struct ThetaBins {
    width_deg: f64,
}

impl ThetaBins {
    pub(super) fn new(incident: &IncidentSet) -> Self {
        Self {
            width_deg: incident.step_deg().unwrap_or(LIST_BIN_DEG),
        }
    }

    pub(super) fn count(&self) -> usize {
        (90.0 / self.width_deg).round() as usize
    }

    fn of(&self, theta_deg: f64) -> usize {
        ((theta_deg / self.width_deg) as usize).min(self.count() - 1)
    }
}

/// The judged samples of one provenance.
#[derive(Clone)]
pub(super) struct OfOrigin {
    /// Pairs of directions.
    pub(super) pairs: u64,
    /// σ/f of all channels; infinite where f is 0 or less.
    pub(super) sigma: LogHistogram,
    /// |f − reference| / reference where that is scored.
    pub(super) errors: LogHistogram,
    /// Samples of all channels where the reference has a value.
    pub(super) compared: u64,
    /// Those that are scored and differ by at most two standard uncertainties.
    pub(super) within: u64,
    /// Sum over those of the squared difference of f·cosθi, clipped to 1.
    pub(super) squares: f64,
}

impl OfOrigin {
    fn new() -> Self {
        Self {
            pairs: 0,
            sigma: LogHistogram::new(),
            errors: LogHistogram::new(),
            compared: 0,
            within: 0,
            squares: 0.0,
        }
    }

    fn merge(self, other: &Self) -> Self {
        Self {
            pairs: self.pairs + other.pairs,
            sigma: self.sigma.merge(&other.sigma),
            errors: self.errors.merge(&other.errors),
            compared: self.compared + other.compared,
            within: self.within + other.within,
            squares: self.squares + other.squares,
        }
    }
}

/// What one chunk adds.
#[derive(Clone)]
pub(super) struct Part {
    /// Samples with a value.
    pub(super) measured: u64,
    /// Per bin of the incident polar angle.
    rings: Vec<Ring>,
    /// By code of provenance; what has no samples takes no memory.
    origins: [Option<Box<OfOrigin>>; Provenance::ALL.len()],
}

/// Sums over the incident directions of one bin of the polar angle.
#[derive(Clone, Copy, Default)]
struct Ring {
    reflected: f64,
    sigma: f64,
    /// ∫ cosθo dωo of the cells with a value, and of those that were measured themselves.
    known: f64,
    seen: f64,
    directions: u32,
}

/// What all chunks are read with.
pub(super) struct Judge<'a> {
    pub(super) brdf: &'a Brdf,
    /// Directions of the cells of the disk.
    pub(super) cells: &'a [Option<DVec3>],
    /// The reference and the least of it that is scored.
    pub(super) reference: Option<(&'a dyn Sample, Floor)>,
    pub(super) bins: &'a ThetaBins,
}

impl Part {
    pub(super) fn new(rings: usize) -> Self {
        Self {
            measured: 0,
            rings: vec![Ring::default(); rings],
            origins: Default::default(),
        }
    }

    pub(super) fn merge(mut self, other: Self) -> Self {
        self.measured += other.measured;
        for (a, b) in self.rings.iter_mut().zip(&other.rings) {
            a.reflected += b.reflected;
            a.sigma += b.sigma;
            a.known += b.known;
            a.seen += b.seen;
            a.directions += b.directions;
        }
        for (a, b) in self.origins.iter_mut().zip(other.origins) {
            *a = match (a.take(), b) {
                (Some(a), Some(b)) => Some(Box::new(a.merge(&b))),
                (a, b) => a.or(b),
            };
        }
        self
    }

    /// The judged samples of one provenance.
    pub(super) fn of(&self, provenance: Provenance) -> Option<&OfOrigin> {
        self.origins[usize::from(provenance.code())].as_deref()
    }

    /// The judged samples of all origins that are evidence.
    pub(super) fn seen(&self) -> OfOrigin {
        let seen = Provenance::ALL.into_iter().filter(|origin| origin.is_seen());
        seen.filter_map(|origin| self.of(origin))
            .fold(OfOrigin::new(), OfOrigin::merge)
    }

    /// Judged pairs of directions that have a value, whatever its origin.
    pub(super) fn pairs(&self) -> u64 {
        self.origins.iter().flatten().map(|origin| origin.pairs).sum()
    }

    /// The directional albedo of each bin that has incident directions; `whole` is ∫ cosθo dωo over all cells.
    pub(super) fn albedo(&self, bins: &ThetaBins, whole: f64) -> Vec<Albedo> {
        let mean = |at: usize, ring: &Ring| {
            let per = f64::from(ring.directions).recip();
            let known = ring.known * per / whole;
            let is_whole = known >= WHOLE;
            Albedo {
                theta_deg: (at as f64 + 0.5) * bins.width_deg,
                albedo: is_whole.then_some(ring.reflected * per),
                standard_uncertainty: is_whole.then_some(ring.sigma * per),
                measured_part: (ring.known > 0.0).then_some(ring.reflected * per),
                part_uncertainty: (ring.known > 0.0).then_some(ring.sigma * per),
                seen: known,
                filled: known - ring.seen * per / whole,
            }
        };
        let lit = self
            .rings
            .iter()
            .enumerate()
            .filter(|(_, ring)| ring.directions > 0);
        lit.map(|(at, ring)| mean(at, ring)).collect()
    }
}

impl Judge<'_> {
    /// What the chunk number `chunk` adds.
    ///
    /// # Errors
    /// [`StoreError`].
    pub(super) fn part(&self, chunk: usize) -> Result<Part, StoreError> {
        let (brdf, bins) = (self.brdf, self.bins);
        let mut part = Part::new(bins.count());
        let lit = |index: &usize| brdf.incident_reason(*index).is_none();
        let ring_of = |index: usize| bins.of(brdf.grid().angles_deg(index).0);
        let Some(rows) = brdf.chunk(chunk)? else {
            // Nothing was captured of these directions, which is no reason to forget them.
            for index in brdf.chunk_range(chunk).filter(lit) {
                part.rings[ring_of(index)].directions += 1;
            }
            return Ok(part);
        };
        let channels = brdf.channels();
        let count = brdf.disk().len();
        let cell_sr = brdf.disk().cell_sr();
        for (place, index) in brdf.chunk_range(chunk).enumerate() {
            if !lit(&index) {
                continue;
            }
            let wi = brdf.grid().direction(index);
            let judged_in = is_judged(wi);
            let lobe = self.reference.filter(|_| judged_in);
            let lobe = lobe.map(|(sample, floor)| (sample.incident(wi), floor));
            let mut sums = Ring::default();
            for (cell, wo) in self.cells.iter().enumerate() {
                let Some(wo) = *wo else { continue };
                let at = (place * count + cell) * channels;
                let f = &rows.f[at..at + channels];
                let origin = Provenance::from_code(rows.provenance[place * count + cell]);
                let Some(origin) = origin.filter(|origin| *origin != Provenance::Missing) else {
                    continue;
                };
                let sigma = &rows.sigma[at..at + channels];
                part.measured += 1;
                let projected_sr = wo.z * cell_sr;
                let mean = |sum: f64| projected_sr * sum / channels as f64;
                sums.reflected += mean(f.iter().map(|&f| f64::from(f)).sum());
                sums.sigma += mean(sigma.iter().map(|sigma| sigma.to_f64()).sum());
                sums.known += projected_sr / PI;
                if origin.is_seen() {
                    sums.seen += projected_sr / PI;
                }
                if !(judged_in && is_judged(wo)) {
                    continue;
                }
                let of =
                    part.origins[usize::from(origin.code())].get_or_insert_with(|| Box::new(OfOrigin::new()));
                of.pairs += 1;
                for (&f, sigma) in f.iter().zip(sigma) {
                    let f = f64::from(f);
                    of.sigma.add(if f > 0.0 {
                        sigma.to_f64() / f
                    } else {
                        f64::INFINITY
                    });
                }
                let Some((lobe, floor)) = &lobe else { continue };
                let truth = channel_values(lobe.f(wo), channels);
                for (channel, ((&f, sigma), truth)) in f.iter().zip(sigma).zip(truth).enumerate() {
                    if !truth.is_finite() {
                        continue;
                    }
                    let f = f64::from(f);
                    if let Some(error) = floor.error(f, truth, channel) {
                        of.errors.add(error);
                        of.within += u64::from((f - truth).abs() <= 2.0 * sigma.to_f64());
                    }
                    let clipped = |f: f64| (f * wi.z).clamp(0.0, 1.0);
                    of.squares += (clipped(f) - clipped(truth)).powi(2);
                    of.compared += 1;
                }
            }
            let ring = &mut part.rings[ring_of(index)];
            ring.reflected += sums.reflected;
            ring.sigma += sums.sigma;
            ring.known += sums.known;
            ring.seen += sums.seen;
            ring.directions += 1;
        }
        Ok(part)
    }
}
