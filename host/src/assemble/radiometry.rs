//! From the digital numbers of one frame to f on the disk.

use glam::Vec4;
use half::f16;
use half::slice::HalfFloatSliceExt as _;

use crate::provenance::Provenance;
use crate::resample::Resampling;
use crate::rig::Rig;
use crate::store::{BrdfRows, Segment};

/// Numbers that turn a frame into f, the same for all frames.
pub(super) struct Radiometry {
    /// Mean of the black frames, [pixel, channel].
    pub(super) dark: Vec<f32>,
    /// Variance of a dark-corrected number without light, in DN².
    pub(super) dark_variance: f32,
    /// Variance per DN of signal, in DN.
    pub(super) shot_per_dn: f32,
    /// f per (DN / (s × irradiance)).
    pub(super) scale: f64,
    pub(super) saturation: u16,
}

impl Radiometry {
    pub(super) fn new(rig: &Rig, segment: &Segment, pixels: usize) -> Result<Self, String> {
        let gain = rig.gain_e_per_dn();
        let mut sum = vec![0_u64; pixels];
        let mut count = 0_u32;
        for (record, frame) in segment.records.iter().zip(segment.frames.chunks_exact(pixels)) {
            if record.incident < 0 {
                count += 1;
                for (sum, &dn) in sum.iter_mut().zip(frame) {
                    *sum += u64::from(dn);
                }
            }
        }
        if count == 0 {
            return Err("expected black exposures in the first segment, found none".to_owned());
        }
        let read_dn = rig.camera.read_noise_e / gain;
        let one = read_dn * read_dn + 1.0 / 12.0;
        Ok(Self {
            dark: sum
                .into_iter()
                .map(|sum| (sum as f64 / f64::from(count)) as f32)
                .collect(),
            dark_variance: (one * (1.0 + 1.0 / f64::from(count))) as f32,
            shot_per_dn: (1.0 / gain) as f32,
            scale: gain / rig.sensitivity_e(),
            saturation: rig.saturation_dn(),
        })
    }
}

/// What one worker keeps from chunk to chunk.
#[derive(Default)]
pub(super) struct Work {
    /// Dark-corrected signal of each pixel in DN, its channels in the lanes; NaN where it saturated.
    pub(super) signal: Vec<Vec4>,
    /// Standard uncertainties of a row, before they are halved in width.
    pub(super) sigma: Vec<f32>,
    pub(super) rows: BrdfRows,
}

/// One frame onto the disk: writes f, sigma and provenance of one incident direction, at the cells that have
/// taps. Returns how many of them were measured and how many saturated.
pub(super) fn project<const CHANNELS: usize>(
    frame: &[u16],
    factor: f32,
    radiometry: &Radiometry,
    resampling: &Resampling,
    (signal, sigma): (&mut Vec<Vec4>, &mut [f32]),
    (out_f, out_sigma, out_provenance): (&mut [f32], &mut [f16], &mut [u8]),
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
                        f32::from(dn[channel]) - dark[channel]
                    };
                }
                Vec4::from_array(lanes)
            }),
    );
    let (mut measured, mut saturated) = (0, 0);
    for taps in &resampling.taps {
        let cell = taps.cell as usize;
        let mut sum = Vec4::ZERO;
        let mut variance = Vec4::ZERO;
        for (&pixel, &weight) in taps.pixel.iter().zip(&taps.weight) {
            let signal = signal[pixel as usize];
            let shot = signal.max(Vec4::ZERO) * radiometry.shot_per_dn;
            sum += signal * weight;
            variance += (shot + radiometry.dark_variance) * (weight * weight);
        }
        let clear = !sum.is_nan();
        let (f, uncertainty) = if clear {
            // The largest number of f16 stands for "useless".
            let root = Vec4::from_array(variance.to_array().map(f32::sqrt));
            (sum * factor, (root * factor).min(Vec4::splat(65_504.0)))
        } else {
            (Vec4::ZERO, Vec4::ZERO)
        };
        let at = cell * CHANNELS;
        out_f[at..at + CHANNELS].copy_from_slice(&f.to_array()[..CHANNELS]);
        sigma[at..at + CHANNELS].copy_from_slice(&uncertainty.to_array()[..CHANNELS]);
        out_provenance[cell] = if clear {
            Provenance::Measured.code()
        } else {
            Provenance::Missing.code()
        };
        measured += u64::from(clear);
        saturated += u64::from(!clear);
    }
    out_sigma.convert_from_f32_slice(sigma);
    (measured, saturated)
}
