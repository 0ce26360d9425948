//! What calibration makes of assembled values, and their standard uncertainty.
//!
//! # Design
//! [`project`](super::radiometry::project) takes light and throughput as the rig file has them, which are uniform, and
//! knows noise only. Here follow, image by image:
//!
//! 1. light and throughput: f is divided by K·T_o·E_p as calibrated, where E_p is that of the pixels that were lit, and by the
//!    share that is lit of what the pixel sees of the sample; pairs of which too little is lit, or nobody knows how much, have
//!    no value;
//! 2. colours: what channels show of other primaries than theirs is taken apart (`colours`);
//! 3. interreflection: what returned onto the sample is subtracted (`interreflection`);
//! 4. the standard uncertainty: to the noise come, as independent contributions,
//!    - standards: what their reflectances make of light and of r together;
//!    - fields: the relative uncertainties that photometry states, by their covariance at the pixels that see and light,
//!      which grows where the standard was not seen, and with what nobody certified of how its f goes with direction;
//!    - seen part: that of the share;
//!    - crosstalk: that of what channels show of each other;
//!    - polarisation: what light that is polarised a little makes of gloss (`polarisation`);
//!    - interreflection: that of r by noise, and a quarter of the correction for its simple model;
//!    - directions (as they are known, and as far as whole projector pixels light beside them), interpolation and blur: what they make of
//!      an image that is not even (`shape`);
//!    - seating: sample and standard lean each a little, which changes cosθᵢ by tanθᵢ times that.
//!
//! # Tradeoffs
//! What is systematic (fields, directions) is correlated from sample to sample; the file has one number per sample.

use glam::DVec3;

use super::colours::Colours;
use super::interreflection::{Back, Returned};
use super::lit::{Lit, lit, pixel_sr, place, polar_deg};
use super::polarisation::Polarisation;
use super::probe::{Probe, Probed};
use super::radiometry::{Common, Radiometry};
use super::shape::{ByShape, Shape, hypot};
use crate::assemble::resample::{Resampling, Taps};
use crate::brdf::budget::{BudgetSums, Shared, band};
use crate::brdf::quadrature::spot_rad;
use crate::brdf::{BANDS_DEG, CAUSES};
use crate::hemisphere::disk::Disk;
use crate::instrument::calibration::stray::{Level, PROJECTOR_TERMS};
use crate::instrument::calibration::{AppliedCalibration, Photometry, Share, Shares, TwoStandards};
use crate::instrument::optics::View;
use crate::instrument::rig::Rig;
use crate::plan::{Directions, Plan};
use crate::store::provenance::Provenance;
use crate::store::{BrdfRows, stored_sigma};

/// Standard deviation of where the light of a projector pixel goes, pixels: nobody tells how sharp a projector is, and few show lines of
/// one pixel with more than a third of their contrast.
const BLUR_PX: f64 = 0.5;

/// What is done to every image.
pub(super) struct Correction {
    size: usize,
    channels: usize,
    /// Factor of f, [cell, channel].
    cells: Vec<f32>,
    /// What lights each incident direction.
    rows: Vec<Lit>,
    /// What the standards' reflectances may be off by, and relative variance of all f by what the fields leave.
    standards: TwoStandards,
    residual2: f32,
    /// Relative variance of all f by the lamp, in the calibration and since.
    lamp2: f32,
    /// Relative variance of f by the throughput of each cell.
    cell_relative2: Vec<f32>,
    /// What part of the sample pixels and incident directions have in common, if calibration found that, and the pixels of each
    /// cell.
    shares: Option<(Shares, Vec<Taps>)>,
    colours: Option<Colours>,
    returned: Option<Returned>,
    polarisation: Polarisation,
    shape: Shape,
    /// Band of the polar angle of each incident direction, and of each cell; `None` where it is not judged.
    row_bands: Vec<Option<usize>>,
    cell_bands: Vec<Option<usize>>,
}

impl Correction {
    /// For images of `rig` that `plan` made, resampled by `resampling`. Or what is wrong with `applied`.
    pub(super) fn new(
        rig: &Rig,
        plan: &Plan,
        directions: &Directions,
        applied: &AppliedCalibration,
        disk: Disk,
        resampling: &Resampling,
    ) -> Result<Self, String> {
        let channels = rig.channels();
        let mut cells = vec![1.0; disk.len() * channels];
        let mut cell_relative2 = vec![0.0; disk.len()];
        let (mut residual, mut by_lamp) = (0.0_f64, 0.0_f64);
        let mut standards = TwoStandards::default();
        if let Some(photometry) = &applied.photometry {
            if photometry.sensitivity.len() != channels {
                return Err(format!(
                    "photometry.sensitivity: expected {channels} channels as the camera has, found {}",
                    photometry.sensitivity.len()
                ));
            }
            (cells, cell_relative2) = throughput(rig, photometry, disk);
            (standards, residual) = (photometry.two_standards(), photometry.field_residual);
            by_lamp = photometry.lamp_uncertainty;
        }
        let lit = lit(rig, plan, directions, applied.photometry.as_ref());
        let [camera_deg, projector_deg] = applied.direction_deg;
        let band_of = |w: DVec3| band(polar_deg(w));
        Ok(Self {
            row_bands: (0..directions.grid.len())
                .map(|index| band_of(directions.grid.direction(index)))
                .collect(),
            cell_bands: (0..disk.len())
                .map(|cell| disk.direction(cell).and_then(band_of))
                .collect(),
            size: disk.size(),
            channels,
            cells,
            standards,
            residual2: residual.powi(2) as f32,
            lamp2: by_lamp.powi(2) as f32,
            cell_relative2,
            shares: shares(rig, directions, applied).map(|shares| (shares, resampling.taps.clone())),
            colours: applied
                .photometry
                .as_ref()
                .and_then(|found| found.crosstalk)
                .map(|found| Colours::new(found, &View::camera(rig), disk)),
            returned: applied
                .photometry
                .as_ref()
                .and_then(|found| found.interreflection)
                .map(|found| Returned::new(found, disk, channels)),
            // Who knows nothing of the light does not know that either.
            polarisation: Polarisation::new(
                applied
                    .photometry
                    .as_ref()
                    .map_or(0.0, |_| rig.light.polarisation),
                disk,
            ),
            shape: Shape::new(
                &View::camera(rig),
                disk,
                resampling,
                channels,
                spot_rad(plan.spot_deg).powi(2) + BLUR_PX.powi(2) * pixel_sr(&lit),
                // The stated angle is that of both axes together.
                f64::midpoint(
                    camera_deg.to_radians().powi(2),
                    projector_deg.to_radians().powi(2),
                ),
            ),
            rows: lit,
        })
    }

    /// The lamp was as in `level`, compared with the calibration.
    pub(super) fn set_lamp(&mut self, level: Level) {
        for cell in &mut self.cells {
            *cell /= level.light;
        }
        self.lamp2 += (level.uncertainty / level.light).powi(2);
    }

    /// Learns from the black frames of `radiometry`, one for each exposure time, how much of the light that falls on it the sample returns.
    pub(super) fn learn(
        &mut self,
        rig: &Rig,
        photometry: &Photometry,
        radiometry: &[Radiometry],
        resampling: &Resampling,
    ) {
        if let Some(returned) = &mut self.returned {
            returned.learn(rig, photometry, radiometry, resampling, &self.cells);
        }
    }

    /// Terms for direct light (see [`lit_terms`](crate::instrument::calibration::stray::lit_terms)) of the pixels that light each incident direction.
    pub(super) fn lit_terms(&self) -> Vec<[f64; PROJECTOR_TERMS]> {
        self.rows.iter().map(|lit| lit.terms).collect()
    }

    /// What light and throughput make of the value at `cell` (with its channel) of the incident direction `row`.
    pub(super) fn factor(&self, row: usize, cell: usize) -> f32 {
        self.cells[cell] * self.rows[row].factor
    }

    /// Corrects the rows of the incident directions from `first` on, of whose uncertainties stray light and lamp make what
    /// is in `common`. What is missing stays NaN. A `probe` is shown what makes the uncertainties of its samples. Returns what makes them
    /// all.
    pub(super) fn apply(
        &self,
        first: usize,
        rows: &mut BrdfRows,
        common: &Common,
        probe: Option<&Probe>,
    ) -> BudgetSums {
        let (cells, values) = (self.size * self.size, self.cells.len());
        let mut budget = BudgetSums::default();
        let mut sigma = vec![0.0; values];
        let mut mixed = vec![0.0; values];
        let (mut room, mut polarised) = (ByShape::default(), Vec::new());
        let images = rows
            .f
            .chunks_exact_mut(values)
            .zip(rows.sigma.chunks_exact_mut(values))
            .zip(rows.provenance.chunks_exact(cells))
            .zip(common.stray.chunks_exact(values))
            .zip(common.lamp.chunks_exact(values));
        for (index, ((((f, half_sigma), provenance), stray), lamp)) in (first..).zip(images) {
            let lit = &self.rows[index];
            let shown = self.shown(index, provenance);
            let each = f.iter_mut().zip(sigma.iter_mut().zip(half_sigma.iter()));
            for (at, (f, (sigma, half))) in each.enumerate() {
                let factor = self.cells[at] * lit.factor * shown[at / self.channels].factor;
                *f *= factor;
                *sigma = half.to_f32() * factor;
            }
            let measured = |cell: usize| shown[cell].factor.is_finite();
            if let Some(colours) = &self.colours {
                colours.take_apart(f, &mut sigma, &mut mixed);
            }
            let surface = self.polarisation.of_surface(lit.direction);
            for channel in 0..self.channels {
                let returned = self.returned(lit.direction, f, &measured, channel);
                for (cell, back) in returned.iter().enumerate() {
                    f[cell * self.channels + channel] -= back.f;
                }
                self.shape
                    .uncertainties(f, &sigma, &measured, channel, lit.beside2, &mut room);
                Polarisation::variances(&surface, f, &measured, channel, &mut polarised);
                for cell in (0..cells).filter(|&cell| measured(cell)) {
                    let at = cell * self.channels + channel;
                    let factor = self.cells[at] * lit.factor * shown[cell].factor;
                    let [stray2, lamp2] = [stray, lamp].map(|of| (of[at] * factor).powi(2));
                    let value = Value {
                        f: f[at],
                        sigma: sigma[at],
                        mixed: mixed[at],
                        part: shown[cell].relative,
                        back: returned.get(cell).copied().unwrap_or_default(),
                        by_shape: room.total[cell],
                        directed: room.directed[cell],
                        polarised: polarised[cell],
                        stray2,
                        lamp2,
                    };
                    let all = self.variances(lit, cell, &value);
                    half_sigma[at] = stored_sigma(all.total);
                    if let Some(probe) = probe {
                        probe.take([index, cell], || Probed {
                            channel,
                            f: value.f,
                            returned: value.back.f,
                            variances: all.by_cause,
                        });
                    }
                    if let Some((row, column)) = self.row_bands[index].zip(self.cell_bands[cell]) {
                        let region = row * BANDS_DEG.len() + column;
                        budget.add(region, value.f, all.by_cause);
                        let lamp = lamp2.sqrt() * common.lamp_share[index - first];
                        let shared = self.shared(&value, all.standards2, lamp);
                        budget.add_shared(region, value.f, all.total * all.total, shared);
                    }
                }
            }
        }
        budget
    }

    /// What makes the uncertainty of a `value` at `cell` in the light of `lit`.
    fn variances(&self, lit: &Lit, cell: usize, value: &Value) -> Variances {
        let Value { f, sigma, back, .. } = *value;
        let part2 = (value.part * f).powi(2);
        let field2 = (self.residual2 + lit.relative2 + self.cell_relative2[cell]) * f * f;
        let lamp_common2 = self.lamp2 * f * f;
        let standards2 = self.standards_variance(f, back.per_share);
        let leant2 = (lit.leant * f).powi(2);
        let systematic = (value.polarised + part2 + field2 + lamp_common2 + standards2 + leant2).sqrt();
        let total = [value.by_shape, systematic, value.mixed, back.uncertainty]
            .into_iter()
            .fold(sigma, hypot);
        let turned2 = value.directed.powi(2);
        Variances {
            total,
            standards2,
            by_cause: [
                (sigma.powi(2) - value.stray2 - value.lamp2).max(0.0),
                value.stray2,
                value.lamp2 + lamp_common2,
                standards2,
                field2,
                part2,
                turned2 + leant2,
                (value.by_shape.powi(2) - turned2).max(0.0),
                back.uncertainty.powi(2),
                value.mixed.powi(2),
                value.polarised,
            ],
        }
    }

    /// What of the uncertainty of a `value` all values share, of which `standards2` is the variance by both standards and `lamp` the
    /// standard uncertainty by the lamp in the black frames.
    fn shared(&self, value: &Value, standards2: f32, lamp: f32) -> Shared {
        // What standards make of light that returns is no factor.
        let factor2 = self.first_variance(value.f).min(standards2);
        Shared {
            standards: factor2.sqrt(),
            lamp,
            stray: value.stray2.sqrt(),
            returned: (standards2 - factor2 + value.back.uncertainty.powi(2)).sqrt(),
        }
    }

    /// What came back onto the sample with light from a `direction` and left it towards each cell, where `f` of this channel was `measured`;
    /// nothing if nobody knows.
    fn returned(
        &self,
        direction: DVec3,
        f: &[f32],
        measured: &dyn Fn(usize) -> bool,
        channel: usize,
    ) -> Vec<Back> {
        let of = |returned: &Returned| {
            let incoming = returned.incoming(direction, f, measured, channel);
            let of_cell = |cell| {
                if measured(cell) {
                    returned.back(&incoming, cell)
                } else {
                    Back::default()
                }
            };
            (0..self.size * self.size).map(of_cell).collect()
        };
        self.returned.as_ref().map_or_else(Vec::new, of)
    }

    /// What each cell of the incident direction `row` shows of what it would if all that its pixels see were lit; NaN where there
    /// is no value, as `provenance` says or because too little is lit.
    fn shown(&self, row: usize, provenance: &[u8]) -> Vec<Shown> {
        let Some((shares, taps)) = &self.shares else {
            let of = |code: &u8| {
                if *code == Provenance::Missing.code() {
                    Shown::NOTHING
                } else {
                    Shown::ALL
                }
            };
            return provenance.iter().map(of).collect();
        };
        let mut shown = vec![Shown::NOTHING; provenance.len()];
        // Pixels serve several cells.
        let mut of_pixels: Vec<Option<Share>> = Vec::new();
        for taps in taps {
            let cell = taps.cell as usize;
            if provenance[cell] == Provenance::Missing.code() {
                continue;
            }
            let mut mean = Share::default();
            for (pixel, weight) in taps.pixel.iter().zip(taps.weight) {
                let pixel = *pixel as usize;
                if of_pixels.len() <= pixel {
                    of_pixels.resize(pixel + 1, None);
                }
                let share = of_pixels[pixel].get_or_insert_with(|| shares.share(row, pixel));
                mean.add(share, weight);
            }
            if let Some((share, relative)) = mean.known() {
                shown[cell] = Shown {
                    factor: share.recip(),
                    relative,
                };
            }
        }
        shown
    }

    /// Variance of f in sr⁻² by the reflectances of the standards; interreflection of share 1 adds `per_share`.
    fn standards_variance(&self, f: f32, per_share: f32) -> f32 {
        match self.returned.as_ref().map(Returned::found) {
            Some(found) => found.standards_variance(self.standards, f, per_share),
            None => self.first_variance(f),
        }
    }

    /// The same by the first standard alone, if all that is measured were as bright.
    fn first_variance(&self, f: f32) -> f32 {
        (self.standards.uncertainty[0] as f32 * f).powi(2)
    }
}

/// A corrected value and what is known of its errors, in sr⁻¹ and sr⁻².
#[derive(Clone, Copy, Debug)]
struct Value {
    f: f32,
    /// By noise, and by stray light and lamp in the black frames, of which the variances are `stray2` and `lamp2`.
    sigma: f32,
    /// By what channels show of each other.
    mixed: f32,
    /// Relative, by the part that is lit.
    part: f32,
    back: Back,
    /// By shape, and the part of that that directions make.
    by_shape: f32,
    directed: f32,
    /// Variance by polarisation.
    polarised: f32,
    stray2: f32,
    lamp2: f32,
}

/// What makes the uncertainty of a value.
#[derive(Clone, Copy, Debug)]
struct Variances {
    /// Standard uncertainty (k = 1) by all of it, sr⁻¹.
    total: f32,
    /// Variance by both standards, sr⁻².
    standards2: f32,
    /// Variance by each of the causes, sr⁻².
    by_cause: [f32; CAUSES.len()],
}

/// What the share that is lit of what a pixel sees makes of f.
#[derive(Clone, Copy, Debug)]
struct Shown {
    /// What f is to be multiplied with; NaN where there is no value.
    factor: f32,
    /// Relative standard uncertainty (k = 1) of it.
    relative: f32,
}

impl Shown {
    const ALL: Self = Self {
        factor: 1.0,
        relative: 0.0,
    };
    const NOTHING: Self = Self {
        factor: f32::NAN,
        relative: f32::NAN,
    };
}

/// What f is to be multiplied with for the throughput of the pixel that sees each cell, and for the sensitivity, and the
/// relative variance of the throughput of each cell.
fn throughput(rig: &Rig, photometry: &Photometry, disk: Disk) -> (Vec<f32>, Vec<f32>) {
    // Assembly has divided by this, in digital numbers.
    let assumed = rig.sensitivity_e() / rig.gain_e_per_dn();
    let camera = View::camera(rig);
    let fields = (0..disk.len()).map(|cell| {
        let at = disk.direction(cell).and_then(|w| camera.pixel(w).ok())?;
        let [x, y] = place(&camera, at);
        let field = &photometry.throughput;
        let relative2 = field.relative_uncertainty_at(x, y).powi(2);
        // What f of the standard is off by at its polar angle, the throughput has.
        let of_standard2 = photometry.standards[0]
            .angular
            .variance(1, polar_deg(disk.direction(cell)?));
        Some((field.at(x, y), relative2 + of_standard2))
    });
    let (mut factors, mut variances) = (Vec::new(), Vec::new());
    for field in fields {
        let (field, relative2) = field.unwrap_or((1.0, 0.0));
        factors.extend(
            photometry
                .sensitivity
                .iter()
                .map(|k| (assumed / (k * field)) as f32),
        );
        variances.push(relative2 as f32);
    }
    (factors, variances)
}

/// What part of the sample camera pixels and incident directions have in common.
fn shares(rig: &Rig, directions: &Directions, applied: &AppliedCalibration) -> Option<Shares> {
    let part = applied.photometry.as_ref()?.seen_part.as_ref()?;
    let lit: Vec<Option<DVec3>> = (0..directions.grid.len())
        .map(|index| {
            directions.reasons[index]
                .is_none()
                .then(|| directions.grid.direction(index))
        })
        .collect();
    Some(Shares::new(part, rig, &lit))
}
