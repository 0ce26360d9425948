//! From the digital numbers of one pattern's frames to f on the disk.

mod bench;
mod black;
mod lag;
mod numbers;
mod shown;

use glam::Vec4;
use half::slice::HalfFloatSliceExt as _;

use super::merge::{Merge, Merged, by_lane, lanes};
use crate::assemble::resample::{Resampling, Taps};
use crate::instrument::calibration::stray::{
    Bias, ByBand, Levels, PROJECTOR_TERMS, Removal, Room, hypot, sqrt,
};
use crate::store::provenance::Provenance;
use crate::store::{LEAST_SIGMA, USELESS_SIGMA};

pub(super) use bench::{Bench, Common, Out, Work};
#[cfg(test)]
pub(super) use black::of_black;
pub(super) use black::{Black, BlackFrames, Drift, Offset};
pub(super) use lag::{Lag, before, usual as usual_lag};
pub(super) use numbers::Numbers;

/// Share of the range from which on a mean may hold saturated numbers.
const FULL: f32 = 0.95;

/// Numbers that turn a frame into f, the same for all frames of one exposure time.
pub(super) struct Radiometry {
    /// Exposure time in s.
    pub(super) exposure_s: f64,
    /// The same for all exposure times.
    pub(super) numbers: Numbers,
    /// Mean of the black frames, [pixel, channel], linear.
    pub(super) dark: Vec<f32>,
    /// What the patterns before them showed; empty if nothing is left of those.
    pub(super) before: Vec<f32>,
    /// Mean of those without what watches the lamp; empty if there are none.
    pub(super) unwatched: Vec<f32>,
    /// Frames of both means.
    pub(super) counts: [usize; 2],
    /// 1 + 1/number of black frames: whose mean's variance counts too.
    pub(super) means: f32,
    /// Variance of a dark-corrected number by reading out and rounding, in DN².
    pub(super) dark_variance: f32,
    /// Variance of what all dark-corrected numbers of an image's row have in common, in DN².
    pub(super) row_variance: f32,
    /// What frames still show of the pattern before.
    pub(super) lag: Lag,
}

impl Radiometry {
    /// The digital number as a linear camera would give it.
    #[inline]
    pub(super) fn linear(&self, dn: u16) -> f32 {
        self.numbers.linear(dn)
    }

    /// Light of the black pattern in a pixel, DN; dark current, which is little beside it, is taken for light.
    #[inline]
    pub(super) fn black_light<const CHANNELS: usize>(&self, pixel: usize) -> Vec4 {
        let mut lanes = [0.0; 4];
        for (lane, dark) in lanes.iter_mut().zip(&self.dark[pixel * CHANNELS..][..CHANNELS]) {
            *lane = dark - self.numbers.level;
        }
        Vec4::from_array(lanes)
    }

    /// What frames in which not even the lamp is watched show above the dark level, DN, the channels in the lanes; NaN where they may be
    /// saturated. The black ones if there are no others.
    pub(super) fn black_image(&self, channels: usize) -> Vec<Vec4> {
        let frame = if self.unwatched.is_empty() {
            &self.dark
        } else {
            &self.unwatched
        };
        self.unsaturated(frame, channels)
    }

    /// What black frames show of that which watches the lamp, and what the others show, as in [`black_image`](Self::black_image).
    /// `None` if all are alike.
    pub(super) fn watched_image(&self, channels: usize) -> Option<[Vec<Vec4>; 2]> {
        if self.unwatched.is_empty() {
            return None;
        }
        let others = self.black_image(channels);
        let mut more = self.unsaturated(&self.dark, channels);
        for (more, other) in more.iter_mut().zip(&others) {
            *more -= *other;
        }
        Some([more, others])
    }

    /// The mean `frame` above the dark level, the channels in the lanes; NaN where it may be saturated.
    fn unsaturated(&self, frame: &[f32], channels: usize) -> Vec<Vec4> {
        let full = (FULL * self.linear(self.numbers.saturation)).min(self.linear(self.numbers.trusted));
        let lanes = |dns: &[f32]| {
            let mut lanes = [0.0; 4];
            for (lane, dn) in lanes.iter_mut().zip(dns) {
                *lane = if *dn < full {
                    dn - self.numbers.level
                } else {
                    f32::NAN
                };
            }
            Vec4::from_array(lanes)
        };
        frame.chunks_exact(channels).map(lanes).collect()
    }

    /// Variance by the shot noise of what a black frame holds, dark current and stray light, in DN²; `dark` are its
    /// numbers.
    #[inline]
    pub(super) fn dark_shot_variance(&self, dark: Vec4) -> Vec4 {
        (dark - Vec4::splat(self.numbers.level)).max(Vec4::ZERO) * (self.numbers.shot_per_dn * self.means)
    }
}

/// How the frames of one pattern come onto the disk.
pub(super) struct Way<'a> {
    /// Σ E·cosθ·Δω of the lit pixels, in sr.
    pub(super) irradiance: f64,
    pub(super) resampling: &'a Resampling,
    /// How they lose stray light, and the terms of the lit pixels for it.
    pub(super) stray: Option<(&'a Removal, &'a [f64; PROJECTOR_TERMS])>,
    /// What frames of each exposure time are off by alike; nothing of those that nobody knows of.
    pub(super) bias: &'a [ByBand<Bias>],
    /// By how much the camera's offset is another than in the black frames.
    pub(super) offset: Offset,
    /// Of each exposure, the frames of the pattern that was shown before; nothing if nobody knows.
    pub(super) before: Vec<Option<&'a [u16]>>,
}

impl Way<'_> {
    /// Takes stray light from the `signal` of exposures as in `radiometry`; what it was and how certain stays in `room`.
    fn clear(&self, signal: &mut [Vec4], radiometry: &Radiometry, room: &mut Room) {
        room.stray.clear();
        room.doubt.clear();
        let Some((removal, lit)) = self.stray else {
            return;
        };
        let saturation = radiometry.linear(radiometry.numbers.saturation) - radiometry.numbers.level;
        removal.find(signal, lit, radiometry.exposure_s, saturation, room);
        for (signal, stray) in signal.iter_mut().zip(&room.stray) {
            *signal -= *stray;
        }
    }

    /// Adds to what is uncertain in the `room` what the camera's offset makes, of which `share_of`(pixel) is in the signal, and what
    /// is `left`(pixel) of the pattern before.
    fn doubt(&self, room: &mut Room, share_of: impl Fn(usize) -> Vec4, left: impl Fn(usize) -> Vec4) {
        for (pixel, doubt) in room.doubt.iter_mut().enumerate() {
            let by_offset = self.offset.uncertainty * share_of(pixel);
            *doubt = hypot(hypot(*doubt, by_offset), left(pixel));
        }
    }
}

impl Way<'_> {
    /// The lamp in each exposure of one pattern that the `bench` shows, into it: told by pixels that no light of the sample reaches, where
    /// stray light is as in its room.
    fn compare<const CHANNELS: usize>(&self, radiometry: &[Radiometry], bench: &mut Bench<'_>) {
        let Bench {
            shown,
            room,
            levels,
            told,
            ..
        } = bench;
        levels.clear();
        told.clear();
        let Some((removal, _)) = self.stray else {
            levels.resize(radiometry.len(), Levels::SAME);
            return;
        };
        let samples = radiometry[0].dark.len();
        let by_offset = Vec4::splat(self.offset.uncertainty);
        let frames = shown.linear.chunks_exact(samples);
        for (exposure, (one, frame)) in radiometry.iter().zip(frames).enumerate() {
            let times = (one.exposure_s / radiometry[0].exposure_s) as f32;
            let by_frame = removal.told(
                |pixel| one.shown::<CHANNELS>(frame, pixel, self.offset) - room.stray[pixel] * times,
                |pixel| one.black_light::<CHANNELS>(pixel),
                |pixel| hypot(room.doubt[pixel] * times, by_offset),
            );
            // What is left of the pattern before no other frame shares.
            let left = shown.lamp_by_left::<CHANNELS>(exposure, removal, one);
            let by_frame = std::array::from_fn(|band| by_frame[band].map(|told| told.doubted_by(left[band])));
            let bias = self.bias.get(exposure).copied().unwrap_or_default();
            levels.push(removal.level(by_frame, bias));
            told.push(by_frame);
        }
    }
}

impl Radiometry {
    /// What a linear `frame` shows at a pixel more than the black ones, less the `offset`, DN, its channels in the lanes; NaN where it
    /// saturated: that spoils every cell that the pixel takes part in, and no other.
    #[inline]
    fn shown<const CHANNELS: usize>(&self, frame: &[f32], pixel: usize, offset: Offset) -> Vec4 {
        let at = pixel * CHANNELS;
        lanes::<CHANNELS, f32>(&frame[at..]) - lanes::<CHANNELS, f32>(&self.dark[at..]) - offset.dn
    }
}

/// One frame as an image: what it shows of the sample is in the signal of the `bench` then, the lamp as in the black frames, and
/// what came other ways in its room.
pub(super) fn image<const CHANNELS: usize>(
    frame: &[u16],
    way: &Way<'_>,
    radiometry: &Radiometry,
    bench: &mut Bench<'_>,
) {
    let values = radiometry.dark.len();
    let Bench {
        shown, signal, room, ..
    } = bench;
    shown.learn(frame, &way.before, std::slice::from_ref(radiometry));
    signal.clear();
    signal.extend(
        (0..values / CHANNELS).map(|pixel| radiometry.shown::<CHANNELS>(&shown.linear, pixel, way.offset)),
    );
    way.clear(signal, radiometry, room);
    way.compare::<CHANNELS>(std::slice::from_ref(radiometry), bench);
    let level = bench.levels[0];
    let Bench {
        shown, signal, room, ..
    } = bench;
    room.lamp.clear();
    for (pixel, signal) in signal.iter_mut().enumerate() {
        let black = radiometry.black_light::<CHANNELS>(pixel);
        *signal = level.steady(*signal, black);
        room.lamp.push((*signal + black).abs() * level.uncertainty);
    }
    way.doubt(
        room,
        |_| Vec4::ONE,
        |pixel| shown.left::<CHANNELS>(0, pixel, values),
    );
}

/// One frame onto the disk. Returns how many cells were measured and how many saturated.
pub(super) fn project<const CHANNELS: usize>(
    frame: &[u16],
    way: &Way<'_>,
    radiometry: &Radiometry,
    bench: &mut Bench<'_>,
    out: &mut Out<'_>,
) -> (u64, u64) {
    image::<CHANNELS>(frame, way, radiometry, bench);
    *out.lamp_share = bench.lamp_share();
    let Bench { signal, room, .. } = bench;
    let factor = (radiometry.numbers.scale / (radiometry.exposure_s * way.irradiance)) as f32;
    let variance = |pixel: usize, signal: Vec4| {
        let dark = lanes::<CHANNELS, f32>(&radiometry.dark[pixel * CHANNELS..]);
        let stray = room.stray.get(pixel).copied().unwrap_or(Vec4::ZERO);
        let shown = signal + stray;
        let shot = shown.max(Vec4::ZERO) * radiometry.numbers.shot_per_dn;
        let response = shown * radiometry.numbers.prnu;
        shot + response * response + radiometry.dark_shot_variance(dark) + radiometry.dark_variance
    };
    let of_row = Vec4::splat(radiometry.row_variance.sqrt());
    resample::<CHANNELS>(
        (signal, room),
        (variance, |_| of_row),
        |_| Provenance::Measured,
        factor,
        way.resampling,
        out,
    )
}

/// The frames of one pattern, of exposure times as in `radiometry`, merged into one image, as by [`image`].
pub(super) fn image_merged<const CHANNELS: usize>(
    frames: &[u16],
    way: &Way<'_>,
    radiometry: &[Radiometry],
    bench: &mut Bench<'_>,
) {
    let Bench {
        shown,
        merged,
        room,
        levels,
        ..
    } = bench;
    shown.learn(frames, &way.before, radiometry);
    let merge = Merge::new(radiometry);
    levels.clear();
    levels.resize(radiometry.len(), Levels::SAME);
    merge.frames::<CHANNELS>(&shown.linear, levels, way.offset, merged);
    way.clear(&mut merged.signal, &radiometry[0], room);
    room.lamp.clear();
    if way.stray.is_some() {
        way.compare::<CHANNELS>(radiometry, bench);
        let Bench {
            shown,
            merged,
            room,
            levels,
            ..
        } = bench;
        merge.frames::<CHANNELS>(&shown.linear, levels, way.offset, merged);
        for (pixel, (signal, heaviest)) in merged.signal.iter_mut().zip(&merged.heaviest).enumerate() {
            let [light, uncertainty] = [
                |levels: &Levels| levels.light,
                |levels: &Levels| levels.uncertainty,
            ]
            .map(|of| by_lane(*heaviest, |exposure, lane| of(&levels[exposure])[lane]));
            *signal -= room.stray[pixel] / light;
            let black = radiometry[0].black_light::<CHANNELS>(pixel);
            room.lamp.push((*signal + black).abs() * uncertainty);
        }
        let shares: Vec<f32> = radiometry
            .iter()
            .map(|one| (radiometry[0].exposure_s / one.exposure_s) as f32)
            .collect();
        let heaviest = |pixel: usize| merged.heaviest[pixel];
        way.doubt(
            room,
            |pixel| by_lane(heaviest(pixel), |exposure, _| shares[exposure]),
            |pixel| shown.left_of_merged::<CHANNELS>(heaviest(pixel), pixel, &shares),
        );
    }
}

/// The frames of one pattern, of exposure times as in `radiometry`, merged and onto the disk. Returns as
/// [`project`] does.
pub(super) fn project_merged<const CHANNELS: usize>(
    frames: &[u16],
    way: &Way<'_>,
    radiometry: &[Radiometry],
    bench: &mut Bench<'_>,
    out: &mut Out<'_>,
) -> (u64, u64) {
    image_merged::<CHANNELS>(frames, way, radiometry, bench);
    *out.lamp_share = bench.lamp_share();
    let Bench { merged, room, .. } = bench;
    let Merged {
        signal,
        variance,
        of_row,
        several,
        ..
    } = &**merged;
    let factor = (radiometry[0].numbers.scale / (radiometry[0].exposure_s * way.irradiance)) as f32;
    let provenance = |taps: &Taps| {
        if taps.pixel.iter().any(|&pixel| several[pixel as usize]) {
            Provenance::Merged
        } else {
            Provenance::Measured
        }
    };
    let variance = |pixel: usize, signal: Vec4| {
        let stray = room.stray.get(pixel).copied().unwrap_or(Vec4::ZERO);
        let response = (signal + stray) * radiometry[0].numbers.prnu;
        variance[pixel] + response * response
    };
    resample::<CHANNELS>(
        (signal, room),
        (variance, |pixel| of_row[pixel]),
        provenance,
        factor,
        way.resampling,
        out,
    )
}

/// Writes f, sigma and provenance at the cells that have taps (NaN where a pixel saturated), from the signal of the pixels, its
/// standard uncertainties by stray light and by the lamp (nothing if there are none), which neighbours have in common, its variance
/// by noise and response, given the pixel and its signal, and the standard deviation of what its row has in common, given the
/// pixel. `factor` is f per signal. Pixels know of their surroundings if `resampling` has those. Returns as [`project`] does.
pub(super) fn resample<const CHANNELS: usize>(
    (signal, room): (&[Vec4], &Room),
    (variance_of, of_row): (impl Fn(usize, Vec4) -> Vec4, impl Fn(usize) -> Vec4),
    provenance_of: impl Fn(&Taps) -> Provenance,
    factor: f32,
    resampling: &Resampling,
    out: &mut Out<'_>,
) -> (u64, u64) {
    let (mut measured, mut saturated) = (0, 0);
    let fused = resampling.surroundings.as_ref();
    let fused = fused.map(|surroundings| surroundings.fuse(signal, &variance_of));
    let signal = fused.as_ref().map_or(signal, |fused| fused.signal.as_slice());
    for taps in &resampling.taps {
        let cell = taps.cell as usize;
        let mut sum = Vec4::ZERO;
        let (mut variance, mut stray, mut lamp) = (Vec4::ZERO, Vec4::ZERO, Vec4::ZERO);
        let mut shared = Vec4::ZERO;
        let mut rows = [Vec4::ZERO; 2];
        for (tap, (&pixel, &weight)) in taps.pixel.iter().zip(&taps.weight).enumerate() {
            let signal = signal[pixel as usize];
            sum += signal * weight;
            match &fused {
                None => variance += variance_of(pixel as usize, signal) * (weight * weight),
                Some(fused) => shared += fused.sigma[pixel as usize] * weight,
            }
            rows[tap / 2] += of_row(pixel as usize) * weight;
            for (sum, doubt) in [(&mut stray, &room.doubt), (&mut lamp, &room.lamp)] {
                if let Some(doubt) = doubt.get(pixel as usize) {
                    *sum += *doubt * weight;
                }
            }
        }
        variance += shared * shared + stray * stray + lamp * lamp + rows[0] * rows[0] + rows[1] * rows[1];
        let f = sum * factor;
        let clear = f.is_finite();
        let (f, uncertainty) = if clear {
            let stored = (sqrt(variance) * factor)
                .min(Vec4::splat(USELESS_SIGMA))
                .max(Vec4::splat(LEAST_SIGMA));
            (f, stored)
        } else {
            (Vec4::NAN, Vec4::NAN)
        };
        let at = cell * CHANNELS;
        out.f[at..at + CHANNELS].copy_from_slice(&f.to_array()[..CHANNELS]);
        out.wide_sigma[at..at + CHANNELS].copy_from_slice(&uncertainty.to_array()[..CHANNELS]);
        out.stray_sigma[at..at + CHANNELS].copy_from_slice(&(stray * factor).to_array()[..CHANNELS]);
        out.lamp_sigma[at..at + CHANNELS].copy_from_slice(&(lamp * factor).to_array()[..CHANNELS]);
        out.provenance[cell] = if clear {
            provenance_of(taps).code()
        } else {
            Provenance::Missing.code()
        };
        measured += u64::from(clear);
        saturated += u64::from(!clear);
    }
    out.sigma.convert_from_f32_slice(out.wide_sigma);
    (measured, saturated)
}

#[cfg(test)]
mod tests;
