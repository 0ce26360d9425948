//! From the digital numbers of one pattern's frames to f on the disk.

use glam::Vec4;
use half::f16;
use half::slice::HalfFloatSliceExt as _;

use super::merge::{Merge, Merged, lanes};
use crate::assemble::resample::{Resampling, Taps};
use crate::instrument::calibration::CameraFound;
use crate::instrument::calibration::stray::{PROJECTOR_TERMS, Removal, Room};
use crate::instrument::rig::{ROUNDING_DN2, Rig};
use crate::store::provenance::Provenance;
use crate::store::{BrdfRows, LEAST_SIGMA, Segment, USELESS_SIGMA};

/// Numbers that turn a frame into f, the same for all frames of one exposure time.
pub(super) struct Radiometry {
    /// Exposure time in s.
    pub(super) exposure_s: f64,
    /// What each digital number would be if the camera were linear; nothing if it is.
    pub(super) linear: Option<Vec<f32>>,
    /// Mean of the black frames, [pixel, channel], linear.
    pub(super) dark: Vec<f32>,
    /// Digital number without any charge.
    pub(super) level: f32,
    /// 1 + 1/number of black frames: whose mean's variance counts too.
    pub(super) means: f32,
    /// Variance of a dark-corrected number by reading out and rounding, in DN².
    pub(super) dark_variance: f32,
    /// Variance of what all dark-corrected numbers of an image's row have in common, in DN².
    pub(super) row_variance: f32,
    /// Standard deviation of the response of pixels, relative.
    pub(super) prnu: f32,
    /// Variance per DN of signal, in DN.
    pub(super) shot_per_dn: f32,
    /// f per (DN / (s × irradiance)).
    pub(super) scale: f64,
    pub(super) saturation: u16,
}

impl Radiometry {
    /// From the black exposures of `exposure_s` seconds in `segments`; `camera` is what calibration found, if it did.
    pub(super) fn new(
        rig: &Rig,
        camera: Option<&CameraFound>,
        segments: &[Segment],
        exposure_s: f64,
        pixels: usize,
    ) -> Result<Self, String> {
        let camera = camera.map(|camera| camera.of_image(&rig.camera.binned));
        let gain = camera.map_or_else(|| rig.gain_e_per_dn(), |camera| camera.gain_e_per_dn);
        let read_noise_e = camera.map_or(rig.camera.read_noise_e, |camera| camera.read_noise_e);
        let level = camera.map_or(rig.camera.dark_dn, |camera| camera.dark_dn);
        let saturation = rig.saturation_dn();
        let linear: Option<Vec<f32>> = camera.map(|camera| {
            let range = f64::from(saturation) - level;
            let of = |dn: u16| {
                let signal = f64::from(dn) - level;
                (level + signal * (1.0 + camera.nonlinearity * signal / range)) as f32
            };
            (0..=saturation).map(of).collect()
        });
        let mut sum = vec![0_f64; pixels];
        let mut count = 0_u32;
        for segment in segments {
            for (record, frame) in segment.records.iter().zip(segment.frames.chunks_exact(pixels)) {
                if record.incident < 0 && record.exposure_s.total_cmp(&exposure_s).is_eq() {
                    count += 1;
                    for (sum, &dn) in sum.iter_mut().zip(frame) {
                        *sum += f64::from(linear_of(linear.as_deref(), dn));
                    }
                }
            }
        }
        if count == 0 {
            return Err(format!(
                "expected black exposures of {} ms in the first segments, found none",
                exposure_s * 1e3
            ));
        }
        let read_dn = read_noise_e / gain;
        let one = read_dn * read_dn + ROUNDING_DN2;
        let means = 1.0 + 1.0 / f64::from(count);
        Ok(Self {
            exposure_s,
            linear,
            dark: sum
                .into_iter()
                .map(|sum| (sum / f64::from(count)) as f32)
                .collect(),
            level: level as f32,
            means: means as f32,
            dark_variance: (one * means) as f32,
            row_variance: camera.map_or(0.0, |camera| camera.row_variance_dn2() * means) as f32,
            prnu: camera.map_or(0.0, |camera| camera.prnu) as f32,
            shot_per_dn: (1.0 / gain) as f32,
            scale: rig.gain_e_per_dn() / rig.sensitivity_e(),
            saturation,
        })
    }

    /// The digital number as a linear camera would give it.
    #[inline]
    pub(super) fn linear(&self, dn: u16) -> f32 {
        linear_of(self.linear.as_deref(), dn)
    }

    /// Variance by the shot noise of what a black frame holds, dark current and stray light, in DN²; `dark` are its
    /// numbers.
    #[inline]
    pub(super) fn dark_shot_variance(&self, dark: Vec4) -> Vec4 {
        (dark - Vec4::splat(self.level)).max(Vec4::ZERO) * (self.shot_per_dn * self.means)
    }
}

/// `dn` by the table `linear`, which ends at saturation: what a file has above that is saturated too.
#[inline]
fn linear_of(linear: Option<&[f32]>, dn: u16) -> f32 {
    linear.map_or(f32::from(dn), |linear| {
        linear[usize::from(dn).min(linear.len() - 1)]
    })
}

/// What one worker keeps from chunk to chunk.
#[derive(Default)]
pub(super) struct Work {
    /// Dark-corrected signal of each pixel in DN, its channels in the lanes; NaN where it saturated.
    pub(super) signal: Vec<Vec4>,
    /// The same from several exposures.
    pub(super) merged: Merged,
    /// What of it came other ways.
    pub(super) room: Room,
    /// Standard uncertainties of a row, before they are halved in width.
    pub(super) sigma: Vec<f32>,
    /// What of them stray light makes, of all rows.
    pub(super) stray_sigma: Vec<f32>,
    pub(super) rows: BrdfRows,
}

/// Where f, sigma and provenance of one incident direction go.
pub(super) struct Out<'a> {
    pub(super) f: &'a mut [f32],
    pub(super) sigma: &'a mut [f16],
    pub(super) provenance: &'a mut [u8],
    /// Standard uncertainties before they are halved in width.
    pub(super) wide_sigma: &'a mut [f32],
    /// What of them stray light makes.
    pub(super) stray_sigma: &'a mut [f32],
}

/// How the frames of one pattern come onto the disk.
pub(super) struct Way<'a> {
    /// Σ E·cosθ·Δω of the lit pixels, in sr.
    pub(super) irradiance: f64,
    pub(super) resampling: &'a Resampling,
    /// How they lose stray light, and the terms of the lit pixels for it.
    pub(super) stray: Option<(&'a Removal, &'a [f64; PROJECTOR_TERMS])>,
}

impl Way<'_> {
    /// Takes stray light from the `signal` of exposures as in `radiometry`; what it was and how certain stays in `room`.
    fn clear(&self, signal: &mut [Vec4], radiometry: &Radiometry, room: &mut Room) {
        room.stray.clear();
        room.doubt.clear();
        let Some((removal, lit)) = self.stray else {
            return;
        };
        let saturation = radiometry.linear(radiometry.saturation) - radiometry.level;
        removal.find(signal, lit, radiometry.exposure_s, saturation, room);
        for (signal, stray) in signal.iter_mut().zip(&room.stray) {
            *signal -= *stray;
        }
    }
}

/// One frame onto the disk. Returns how many cells were measured and how many saturated.
pub(super) fn project<const CHANNELS: usize>(
    frame: &[u16],
    way: &Way<'_>,
    radiometry: &Radiometry,
    signal: &mut Vec<Vec4>,
    room: &mut Room,
    out: &mut Out<'_>,
) -> (u64, u64) {
    signal.clear();
    signal.extend(
        frame
            .chunks_exact(CHANNELS)
            .zip(radiometry.dark.chunks_exact(CHANNELS))
            .map(|(dn, dark)| {
                let mut lanes = [0.0; 4];
                for channel in 0..CHANNELS {
                    // A saturated pixel spoils every cell that it takes part in, and no other.
                    let saturated = dn[channel] >= radiometry.saturation;
                    lanes[channel] = if saturated {
                        f32::NAN
                    } else {
                        radiometry.linear(dn[channel]) - dark[channel]
                    };
                }
                Vec4::from_array(lanes)
            }),
    );
    way.clear(signal, radiometry, room);
    let factor = (radiometry.scale / (radiometry.exposure_s * way.irradiance)) as f32;
    let variance = |pixel: usize, signal: Vec4| {
        let dark = lanes::<CHANNELS, f32>(&radiometry.dark[pixel * CHANNELS..]);
        let stray = room.stray.get(pixel).copied().unwrap_or(Vec4::ZERO);
        let shown = signal + stray;
        let shot = shown.max(Vec4::ZERO) * radiometry.shot_per_dn;
        let response = shown * radiometry.prnu;
        shot + response * response + radiometry.dark_shot_variance(dark) + radiometry.dark_variance
    };
    let of_row = Vec4::splat(radiometry.row_variance.sqrt());
    resample::<CHANNELS>(
        (signal, &room.doubt),
        (variance, |_| of_row),
        |_| Provenance::Measured,
        factor,
        way.resampling,
        out,
    )
}

/// The frames of one pattern, of exposure times as in `radiometry`, merged and onto the disk. Returns as
/// [`project`] does.
pub(super) fn project_merged<const CHANNELS: usize>(
    frames: &[u16],
    way: &Way<'_>,
    radiometry: &[Radiometry],
    merged: &mut Merged,
    room: &mut Room,
    out: &mut Out<'_>,
) -> (u64, u64) {
    Merge::new(radiometry).frames::<CHANNELS>(frames, merged);
    let Merged {
        signal,
        variance,
        of_row,
        several,
    } = merged;
    way.clear(signal, &radiometry[0], room);
    let factor = (radiometry[0].scale / (radiometry[0].exposure_s * way.irradiance)) as f32;
    let provenance = |taps: &Taps| {
        if taps.pixel.iter().any(|&pixel| several[pixel as usize]) {
            Provenance::Merged
        } else {
            Provenance::Measured
        }
    };
    let variance = |pixel: usize, signal: Vec4| {
        let stray = room.stray.get(pixel).copied().unwrap_or(Vec4::ZERO);
        let response = (signal + stray) * radiometry[0].prnu;
        variance[pixel] + response * response
    };
    resample::<CHANNELS>(
        (signal, &room.doubt),
        (variance, |pixel| of_row[pixel]),
        provenance,
        factor,
        way.resampling,
        out,
    )
}

/// Writes f, sigma and provenance at the cells that have taps (NaN where a pixel saturated), from the signal of the pixels, its
/// standard uncertainty by stray light (nothing if there is none), which neighbours have in common, its variance by noise and
/// response, given the pixel and its signal, and the standard deviation of what its row has in common, given the pixel.
/// `factor` is f per signal. Returns as [`project`] does.
fn resample<const CHANNELS: usize>(
    (signal, doubt): (&[Vec4], &[Vec4]),
    (variance_of, of_row): (impl Fn(usize, Vec4) -> Vec4, impl Fn(usize) -> Vec4),
    provenance_of: impl Fn(&Taps) -> Provenance,
    factor: f32,
    resampling: &Resampling,
    out: &mut Out<'_>,
) -> (u64, u64) {
    let (mut measured, mut saturated) = (0, 0);
    for taps in &resampling.taps {
        let cell = taps.cell as usize;
        let mut sum = Vec4::ZERO;
        let (mut variance, mut common) = (Vec4::ZERO, Vec4::ZERO);
        let mut rows = [Vec4::ZERO; 2];
        for (tap, (&pixel, &weight)) in taps.pixel.iter().zip(&taps.weight).enumerate() {
            let signal = signal[pixel as usize];
            sum += signal * weight;
            variance += variance_of(pixel as usize, signal) * (weight * weight);
            rows[tap / 2] += of_row(pixel as usize) * weight;
            if let Some(doubt) = doubt.get(pixel as usize) {
                common += *doubt * weight;
            }
        }
        variance += common * common + rows[0] * rows[0] + rows[1] * rows[1];
        let f = sum * factor;
        let clear = f.is_finite();
        let (f, uncertainty) = if clear {
            let root = Vec4::from_array(variance.to_array().map(f32::sqrt));
            let stored = (root * factor)
                .min(Vec4::splat(USELESS_SIGMA))
                .max(Vec4::splat(LEAST_SIGMA));
            (f, stored)
        } else {
            (Vec4::NAN, Vec4::NAN)
        };
        let at = cell * CHANNELS;
        out.f[at..at + CHANNELS].copy_from_slice(&f.to_array()[..CHANNELS]);
        out.wide_sigma[at..at + CHANNELS].copy_from_slice(&uncertainty.to_array()[..CHANNELS]);
        out.stray_sigma[at..at + CHANNELS].copy_from_slice(&(common * factor).to_array()[..CHANNELS]);
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
mod tests {
    use std::slice::from_ref;

    use rand::{RngExt as _, SeedableRng as _};
    use rand_distr::StandardNormal;
    use rand_xoshiro::Xoshiro256PlusPlus;

    use super::*;
    use crate::store::ExposureRecord;

    #[test]
    fn numbers_above_saturation_are_saturated_in_black_and_lit_frames_alike() {
        let mut rig = Rig::load("rcg-1").unwrap();
        (rig.camera.bits, rig.camera.dark_dn) = (12, 16.0);
        let camera = CameraFound {
            dark_dn: 16.0,
            dark_dn_per_s: 0.0,
            gain_e_per_dn: rig.gain_e_per_dn(),
            read_noise_e: 3.0,
            nonlinearity: 0.01,
            linearity_residual: 0.0,
            prnu: 0.0,
            prnu_is_assumed: false,
            row_noise_e: 0.0,
            dsnu_e: 0.0,
            hot: 0.0,
        };
        let record = ExposureRecord {
            incident: -1,
            exposure_s: 0.01,
            ..ExposureRecord::default()
        };
        // A file can hold any number of 16 bits, whatever the rig's camera can show.
        for dn in [4094, 4095, 4096, 4097, 8191, u16::MAX] {
            for camera in [None, Some(&camera)] {
                let black = Segment {
                    frames: vec![16, dn],
                    records: vec![record],
                    ..Segment::default()
                };
                let radiometry = Radiometry::new(&rig, camera, &[black], 0.01, 2).unwrap();
                assert!(radiometry.dark.iter().all(|dark| dark.is_finite()), "{dn}");
                assert!(radiometry.linear(dn).is_finite(), "{dn}");
                if camera.is_some() && dn >= 4095 {
                    assert!(
                        radiometry.linear(dn).total_cmp(&radiometry.linear(4095)).is_eq(),
                        "{dn}"
                    );
                }
            }
        }
    }

    /// Numbers of an image of 2 × 2 pixels that hold `light_e` electrons per second: their responses, rows and noise by chance.
    fn drawn(rig: &Rig, camera: &CameraFound, light_e: f64, times_s: &[f64], seed: u64) -> Vec<u16> {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed);
        let mut normal = || -> f64 { rng.sample(StandardNormal) };
        let response: [f64; 4] = std::array::from_fn(|_| 1.0 + camera.prnu * normal());
        let mut frames = Vec::new();
        for time_s in times_s {
            let rows = [normal(), normal()].map(|row| camera.row_noise_e * row);
            for (pixel, response) in response.iter().enumerate() {
                let mean_e = light_e * time_s * response;
                let noise_e = (mean_e + camera.read_noise_e.powi(2)).sqrt() * normal();
                let dn = (mean_e + noise_e + rows[pixel / 2]) / rig.gain_e_per_dn() + rig.camera.dark_dn;
                frames.push(dn.round() as u16);
            }
        }
        frames
    }

    #[test]
    fn responses_and_rows_are_stated_by_as_much_as_they_scatter() {
        let rig = Rig::load("rcg-1").unwrap();
        let camera = |prnu: f64, row_noise_e: f64| CameraFound {
            dark_dn: rig.camera.dark_dn,
            dark_dn_per_s: 0.0,
            gain_e_per_dn: rig.gain_e_per_dn(),
            read_noise_e: 3.0,
            nonlinearity: 0.0,
            linearity_residual: 0.0,
            prnu,
            prnu_is_assumed: false,
            row_noise_e,
            dsnu_e: 0.0,
            hot: 0.0,
        };
        let times_s = [0.01, 0.02];
        // So many black frames that their mean is known.
        let record = |exposure_s: f64| ExposureRecord {
            incident: -1,
            exposure_s,
            ..ExposureRecord::default()
        };
        let black = Segment {
            frames: vec![rig.camera.dark_dn as u16; 4 * 400],
            records: times_s
                .iter()
                .flat_map(|time_s| vec![record(*time_s); 200])
                .collect(),
            ..Segment::default()
        };
        let resampling = Resampling {
            taps: vec![Taps {
                cell: 0,
                pixel: [0, 1, 2, 3],
                weight: [0.3, 0.4, 0.1, 0.2],
            }],
            reasons: vec![None],
            pixel_sr: vec![1e-3],
        };
        let way = Way {
            irradiance: 1.0,
            resampling: &resampling,
            stray: None,
        };
        for (prnu, row_noise_e, light_e) in [(0.02, 0.0, 4e5), (0.0, 20.0, 1e4), (0.01, 10.0, 1e5)] {
            let camera = camera(prnu, row_noise_e);
            let radiometry = times_s
                .map(|time_s| Radiometry::new(&rig, Some(&camera), from_ref(&black), time_s, 4).unwrap());
            for brackets in [1, 2] {
                let (mut sum, mut squares, mut stated) = (0.0, 0.0, 0.0);
                let draws = 4000;
                for draw in 0..draws {
                    let frames = drawn(&rig, &camera, light_e, &times_s[..brackets], draw);
                    let (mut f, mut sigma, mut wide) = ([0.0], [f16::ZERO], [0.0]);
                    let out = &mut Out {
                        f: &mut f,
                        sigma: &mut sigma,
                        provenance: &mut [0],
                        wide_sigma: &mut wide,
                        stray_sigma: &mut [0.0],
                    };
                    let Work {
                        signal, merged, room, ..
                    } = &mut Work::default();
                    if brackets == 1 {
                        project::<1>(&frames, &way, &radiometry[0], signal, room, out);
                    } else {
                        project_merged::<1>(&frames, &way, &radiometry, merged, room, out);
                    }
                    sum += f64::from(f[0]);
                    squares += f64::from(f[0]).powi(2);
                    stated += f64::from(wide[0]).powi(2);
                }
                let mean = sum / f64::from(draws as u32);
                let ratio = ((squares - sum * mean) / stated).sqrt();
                assert!(
                    (ratio - 1.0).abs() < 0.05,
                    "{prnu} {row_noise_e} {brackets}: {ratio}"
                );
            }
        }
    }
}
