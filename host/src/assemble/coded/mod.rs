//! Code patterns, shared out again into what each incident direction would have shown alone.
//!
//! # Design
//! Each frame becomes an image as in single light: exposures merged, black light, stray light and the lamp's change taken away.
//! The images of a block, one for each row of its code, are held together and shared out
//! ([`demultiplex`]); then follow the steps of a single image. Nothing
//! but one block is in memory ([`spool`]).
//!
//! **Inverted patterns.** With S the code, x the cells and Σx their sum, the difference of a row's pattern and the inverted one
//! shows 2Sx − Σx and their sum shows Σx. So (difference + mean of all sums)/2 stands for the row, in which a leak that changes
//! slowly is left in the mean alone.
//!
//! **Uncertainty.** All entries of S⁻¹ are ±2/(n+1), so what frames do not have in common adds up to the same variance in all
//! cells: 4/(n+1)² times the sum of theirs. That is noise, and the lamp, which is compared frame by frame. What is a share of a
//! cell's own light stays one: the response of pixels, what is not known of stray light, and what levels of the lamp have in
//! common. The noise of the mean black frame is counted as if each frame had its own, of which a sixteenth of its variance is
//! too much.
//!
//! A pixel that saturates in any frame of a block has no value in all of its cells.

mod spool;

use glam::Vec4;
use rayon::prelude::*;

use super::merge::lanes;
use super::projection::Projection;
use super::radiometry::{Bench, Offset, Out, Radiometry, Way, Work, before, resample};
use super::window::Agree;
use crate::assemble::{AssembleError, Assembled};
use crate::instrument::calibration::stray::sqrt;
use crate::instrument::optics::Unmeasurable;
use crate::instrument::rig::Rig;
use crate::plan::light::{CodePatterns, demultiplex};
use crate::plan::{Directions, Exposure, Plan};
use crate::store::provenance::Provenance;
use crate::store::{RawStore, Segment, StoreError};
use spool::Spool;

/// Images that all cells of a block share: variance by noise of their own, by what rows have in common, by the lamp, by stray
/// light of frames that saturate, and whether exposures were merged.
const SHARED: usize = 5;

/// What the frames of a pattern show, [pixel, channel].
struct Shown {
    signal: Vec<f32>,
    /// As [`SHARED`] says.
    variances: [Vec<f32>; SHARED],
    /// Variance of the level of the lamp, and the part of it that all frames have in common.
    lamp2: [f32; 2],
}

/// A block on its way.
#[derive(Default)]
struct Block {
    /// [row of the code, value].
    rows: Vec<f32>,
    /// Sum of all frames.
    total: Vec<f32>,
    shared: Vec<f32>,
    lamp2: [f32; 2],
    frames: usize,
}

/// Images of the cells, and what they are made with.
pub(super) struct Cells {
    codes: CodePatterns,
    /// Index of the direction of each cell.
    directions: Vec<usize>,
    /// Number of the cell of each direction.
    places: Vec<Option<usize>>,
    /// Of each cell.
    irradiance: Vec<f64>,
    /// Standard uncertainty of the lamp in each block, which its frames may share, and the part of it that all do.
    lamp: Vec<[f32; 2]>,
    /// Numbers of an image.
    values: usize,
    spool: Spool,
}

impl Cells {
    /// Shares out the frames of `raw`, which `plan` made on `rig`, as `projection` makes images of them; what goes to disk
    /// stands in `folder`. `progress` is told the number of frames done. `None` if no pattern is a code.
    ///
    /// # Errors
    /// [`AssembleError`].
    pub(super) fn of(
        (rig, plan, directions): (&Rig, &Plan, &Directions),
        projection: &Projection,
        raw: &RawStore,
        agree: &Agree<'_>,
        folder: &std::path::Path,
        progress: &(dyn Fn(usize) + Sync),
    ) -> Result<Option<Self>, AssembleError> {
        let Some(codes) = plan.code_patterns() else {
            return Ok(None);
        };
        let values = projection.radiometry[0].dark.len();
        let mut places = vec![None; directions.grid.len()];
        let measurable: Vec<usize> = directions.measurable().collect();
        for (place, index) in measurable.iter().enumerate() {
            places[*index] = Some(place);
        }
        let sets = directions.lit_sets(rig, plan.spot_deg);
        let mut cells = Self {
            lamp: vec![[0.0; 2]; codes.blocks().count()],
            codes,
            directions: measurable,
            places,
            irradiance: sets.iter().map(|lit| lit.irradiance).collect(),
            values,
            spool: Spool::create(folder, values)?,
        };
        let patterns = plan.patterns(directions);
        let brackets = plan.brackets();
        let mut block = Block::default();
        let mut done = 0;
        for number in 0..raw.segments() {
            let segment = raw.read_segment(number)?;
            agree(number, &segment)?;
            let range = raw.segment_range(number);
            let shown = &patterns[range.start / brackets..range.end / brackets];
            cells.add((range.start, &segment), shown, projection, &mut block)?;
            done += brackets * shown.iter().filter(|shown| !shown.is_black()).count();
            progress(done);
        }
        Ok(Some(cells))
    }

    /// Adds the frames of a segment, which begins with the exposure of the number `first`, with these `patterns` to the `block` on
    /// its way, and shares it out when it is whole.
    fn add(
        &mut self,
        (first, segment): (usize, &Segment),
        patterns: &[Exposure],
        projection: &Projection,
        block: &mut Block,
    ) -> Result<(), StoreError> {
        let brackets = projection.radiometry.len();
        let places = (0..).step_by(brackets);
        let coded: Vec<(usize, usize)> = patterns
            .iter()
            .zip(places)
            .filter_map(|(pattern, place)| match pattern {
                Exposure::Coded(number) => Some((*number, place)),
                _ => None,
            })
            .collect();
        // As many images as are made at a time.
        for some in coded.chunks(2 * rayon::current_num_threads()) {
            let shown: Vec<Shown> = some
                .par_iter()
                .map_init(Work::default, |work, (number, place)| {
                    let lit = self.codes.lit(*number).map(|cell| self.directions[cell]);
                    let offset = projection.drift.of(first + place);
                    Shown::of((segment, *place, offset), lit, projection, work)
                })
                .collect();
            for ((number, ..), shown) in some.iter().zip(shown) {
                self.take_in(*number, &shown, block)?;
            }
        }
        Ok(())
    }

    /// Adds what the pattern of this `number` showed to its `block`.
    fn take_in(&mut self, number: usize, shown: &Shown, block: &mut Block) -> Result<(), StoreError> {
        let pattern = self.codes.pattern(number);
        let code = self.codes.blocks().code(pattern.block);
        let range = self.codes.of_block(pattern.block);
        if number == range.start {
            *block = Block::default();
            block.rows.resize(code.order() * self.values, 0.0);
            block.total.resize(self.values, 0.0);
            block.shared.resize(SHARED * self.values, 0.0);
        }
        let weight = match (self.codes.are_inverted_too(), pattern.is_inverted) {
            (false, _) => 1.0,
            (true, false) => 0.5,
            (true, true) => -0.5,
        };
        let row = &mut block.rows[pattern.row * self.values..][..self.values];
        for ((row, total), signal) in row.iter_mut().zip(&mut block.total).zip(&shown.signal) {
            *row += weight * signal;
            *total += signal;
        }
        for (sum, one) in block.shared.chunks_exact_mut(self.values).zip(&shown.variances) {
            for (sum, one) in sum.iter_mut().zip(one) {
                *sum += weight * weight * one;
            }
        }
        for (sum, one) in block.lamp2.iter_mut().zip(shown.lamp2) {
            *sum += one;
        }
        block.frames += 1;
        if number + 1 == range.end {
            self.share_out(pattern.block, block)?;
        }
        Ok(())
    }

    /// Shares out the whole `block` of this `number`.
    fn share_out(&mut self, number: usize, block: &mut Block) -> Result<(), StoreError> {
        let blocks = self.codes.blocks();
        let code = blocks.code(number);
        let n = code.order() as f32;
        let mut scale = 4.0 / (n + 1.0).powi(2);
        if self.codes.are_inverted_too() {
            for row in block.rows.chunks_exact_mut(self.values) {
                for (row, total) in row.iter_mut().zip(&block.total) {
                    *row += total / (2.0 * n);
                }
            }
            // The mean of all sums stands in every row: never more than this.
            scale *= 1.0 + 2.0 / n;
        }
        for shared in &mut block.shared {
            *shared *= scale;
        }
        self.lamp[number] = block.lamp2.map(|sum| (sum / block.frames as f32).sqrt());
        demultiplex(code, &mut block.rows, &mut block.total);
        for (column, cell) in self.codes.cells(number) {
            self.spool
                .write(cell, &block.rows[column * self.values..][..self.values])?;
        }
        self.spool
            .write(self.directions.len() + number * SHARED, &block.shared)
    }

    /// For each direction (0, number of its cell); `None` where one of `reasons` or a spot without a pixel leaves no value.
    pub(super) fn places(&self, reasons: &[Option<Unmeasurable>]) -> Vec<Option<(usize, usize)>> {
        let is_lit = |place: &usize| self.irradiance[*place] > 0.0;
        let places = self.places.iter().zip(reasons);
        places
            .map(|(place, reason)| {
                let place = place.filter(is_lit).filter(|_| reason.is_none())?;
                Some((0, place))
            })
            .collect()
    }

    /// Fills the rows of the incident directions from `first` on, whose cells are those of `places`.
    pub(super) fn rows(
        &self,
        first: usize,
        places: &[Option<(usize, usize)>],
        projection: &Projection,
        work: &mut Work,
    ) -> Result<Assembled, StoreError> {
        let mut failed = None;
        let counts = projection.fill(first, places.len(), work, |index, bench, out| {
            let at = (index, places[index - first]?.1);
            let projected = if projection.channels == 1 {
                self.project::<1>(at, projection, bench, out)
            } else {
                self.project::<3>(at, projection, bench, out)
            };
            projected.map_err(|error| failed = Some(error)).ok()
        });
        failed.map_or(Ok(counts), Err)
    }

    /// Puts the image of the cell at `place`, of the direction of this `index`, onto the disk. Returns how many cells of the
    /// disk were measured and how many saturated.
    fn project<const CHANNELS: usize>(
        &self,
        (index, place): (usize, usize),
        projection: &Projection,
        bench: &mut Bench<'_>,
        out: &mut Out<'_>,
    ) -> Result<(u64, u64), StoreError> {
        let blocks = self.codes.blocks();
        let block = place % blocks.count();
        let shared = self.spool.read(self.directions.len() + block * SHARED, SHARED)?;
        let of = |which: usize, pixel: usize| {
            lanes::<CHANNELS, f32>(&shared[which * self.values + pixel * CHANNELS..])
        };
        let cell = self.spool.read(place, 1)?;
        let Bench { signal, room, .. } = bench;
        signal.clear();
        signal.extend(cell.chunks_exact(CHANNELS).map(lanes::<CHANNELS, f32>));
        room.stray.clear();
        room.doubt.clear();
        room.lamp.clear();
        let one = &projection.radiometry[0];
        if let Some(stray) = &projection.stray {
            let (removal, lit) = stray.of(index);
            removal.of_clean(signal, lit, one.exposure_s, room);
            // Black light that all frames show otherwise is left with this share.
            let left = 2.0 / (blocks.code(block).order() as f32 + 1.0);
            let [uncertainty, of_all] = self.lamp[block];
            let (mut sum, mut sum_of_all) = (0.0, 0.0);
            for (pixel, (signal, doubt)) in signal.iter().zip(&mut room.doubt).enumerate() {
                *doubt = sqrt(*doubt * *doubt + of(3, pixel));
                let own = signal.abs() + one.black_light::<CHANNELS>(pixel).abs() * left;
                let common = own * uncertainty;
                let all = sqrt(common * common + of(2, pixel));
                if !all.is_nan() {
                    sum += all.element_sum();
                    sum_of_all += (own * of_all).element_sum();
                }
                room.lamp.push(all);
            }
            *out.lamp_share = sum_of_all / sum.max(f32::MIN_POSITIVE);
        }
        let factor = (one.numbers.scale / (one.exposure_s * self.irradiance[place])) as f32;
        let variance = |pixel: usize, signal: Vec4| {
            let stray = room.stray.get(pixel).copied().unwrap_or(Vec4::ZERO);
            let response = (signal + stray) * one.numbers.prnu;
            of(0, pixel) + response * response
        };
        let provenance = |taps: &super::resample::Taps| {
            if taps.pixel.iter().any(|&pixel| of(4, pixel as usize).x > 0.0) {
                Provenance::Merged
            } else {
                Provenance::Measured
            }
        };
        Ok(resample::<CHANNELS>(
            (signal, room),
            (variance, |pixel| sqrt(of(1, pixel))),
            provenance,
            factor,
            &projection.resampling,
            out,
        ))
    }

    /// Removes what stands on disk.
    ///
    /// # Errors
    /// [`StoreError::Io`].
    pub(super) fn remove(self) -> Result<(), StoreError> {
        self.spool.remove()
    }
}

impl Shown {
    /// Of the pattern that lights the directions `lit`, whose first exposure has this `place` in `segment`, with this `offset` of the
    /// camera.
    fn of(
        (segment, place, offset): (&Segment, usize, Offset),
        lit: impl Iterator<Item = usize>,
        projection: &Projection,
        work: &mut Work,
    ) -> Self {
        let stray = projection.stray.as_ref().map(|stray| stray.of_all(lit));
        let (brackets, values) = (projection.radiometry.len(), projection.radiometry[0].dark.len());
        let way = &Way {
            irradiance: 1.0,
            resampling: &projection.resampling,
            stray: stray.as_ref().map(|(removal, lit)| (*removal, lit)),
            bias: projection.bias(),
            offset,
            before: before(segment, place, (brackets, values)),
        };
        let bench = &mut Bench::of(work).0;
        let frames = &segment.frames[place * values..][..brackets * values];
        projection.image(frames, way, bench);
        match (projection.channels, projection.radiometry.as_slice()) {
            (1, [one]) => Self::single::<1>(one, bench),
            (_, [one]) => Self::single::<3>(one, bench),
            (1, _) => Self::merged::<1>(bench),
            _ => Self::merged::<3>(bench),
        }
    }

    /// What the `bench` holds of one frame.
    fn single<const CHANNELS: usize>(one: &Radiometry, bench: &Bench<'_>) -> Self {
        let noise = |pixel: usize, signal: Vec4| {
            let stray = bench.room.stray.get(pixel).copied().unwrap_or(Vec4::ZERO);
            let dark = lanes::<CHANNELS, f32>(&one.dark[pixel * CHANNELS..]);
            let shot = (signal + stray).max(Vec4::ZERO) * one.numbers.shot_per_dn;
            [
                shot + one.dark_shot_variance(dark) + Vec4::splat(one.dark_variance),
                Vec4::splat(one.row_variance),
            ]
        };
        Self::with::<CHANNELS>(bench.signal, bench, noise, |_| false)
    }

    /// What the `bench` holds of several merged ones.
    fn merged<const CHANNELS: usize>(bench: &Bench<'_>) -> Self {
        let merged = &*bench.merged;
        let noise = |pixel: usize, _: Vec4| {
            let of_row = merged.of_row[pixel];
            [merged.variance[pixel], of_row * of_row]
        };
        Self::with::<CHANNELS>(&merged.signal, bench, noise, |pixel| merged.several[pixel])
    }

    fn with<const CHANNELS: usize>(
        signal: &[Vec4],
        bench: &Bench<'_>,
        noise: impl Fn(usize, Vec4) -> [Vec4; 2],
        are_several: impl Fn(usize) -> bool,
    ) -> Self {
        let is_saturated = signal.iter().any(|signal| signal.is_nan_mask().any());
        let room = &*bench.room;
        let of = |image: &[Vec4], pixel: usize| {
            let value = image.get(pixel).copied().unwrap_or(Vec4::ZERO);
            value * value
        };
        let mut shown = Self {
            signal: Vec::with_capacity(signal.len() * CHANNELS),
            variances: Default::default(),
            lamp2: bench
                .levels
                .iter()
                .map(|levels| [levels.uncertainty, levels.common].map(Vec4::max_element))
                .fold([0.0; 2], |most, one| {
                    std::array::from_fn(|part| most[part].max(one[part].powi(2)))
                }),
        };
        for (pixel, signal) in signal.iter().enumerate() {
            let [noise, of_row] = noise(pixel, *signal);
            // Without saturation doubts are shares of the cells' own light.
            let doubt = if is_saturated {
                of(&room.doubt, pixel)
            } else {
                Vec4::ZERO
            };
            let several = Vec4::splat(f32::from(u8::from(are_several(pixel))));
            let all = [noise, of_row, of(&room.lamp, pixel), doubt, several];
            shown.signal.extend_from_slice(&signal.to_array()[..CHANNELS]);
            for (image, value) in shown.variances.iter_mut().zip(all) {
                image.extend_from_slice(&value.to_array()[..CHANNELS]);
            }
        }
        shown
    }
}

#[cfg(test)]
mod tests;
