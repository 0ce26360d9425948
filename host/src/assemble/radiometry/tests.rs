//! Numbers of the camera as f, and how certain that is.

use half::f16;
use rand::{RngExt as _, SeedableRng as _};
use rand_distr::StandardNormal;
use rand_xoshiro::Xoshiro256PlusPlus;

use super::*;
use crate::instrument::calibration::CameraFound;
use crate::instrument::rig::Rig;
use crate::store::{ExposureRecord, Segment};

/// A camera whose pixels are alike.
const LINEAR: CameraFound = CameraFound {
    dark_dn: 0.0,
    dark_dn_per_s: 0.0,
    gain_e_per_dn: 1.0,
    read_noise_e: 3.0,
    nonlinearity: 0.0,
    linearity_residual: 0.0,
    linear_to: 1.0,
    prnu: 0.0,
    prnu_is_assumed: false,
    row_noise_e: 0.0,
    dsnu_e: 0.0,
    hot: 0.0,
};

#[test]
fn numbers_above_saturation_are_saturated_in_black_and_lit_frames_alike() {
    let mut rig = Rig::load("rcg-1-16bit").unwrap();
    (rig.camera.bits, rig.camera.dark_dn) = (12, 16.0);
    let camera = CameraFound {
        dark_dn: 16.0,
        gain_e_per_dn: rig.gain_e_per_dn(),
        nonlinearity: 0.01,
        ..LINEAR
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
            let radiometry = of_black(&rig, camera, &black, 0.01, 2).unwrap();
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

/// f and its standard uncertainty at the one cell to which `way` leads.
fn onto_one_cell(frames: &[u16], way: &Way<'_>, radiometry: &[Radiometry]) -> [f32; 2] {
    let (mut f, mut sigma, mut wide) = ([0.0], [f16::ZERO], [0.0]);
    let out = &mut Out {
        f: &mut f,
        sigma: &mut sigma,
        provenance: &mut [0],
        wide_sigma: &mut wide,
        stray_sigma: &mut [0.0],
        lamp_sigma: &mut [0.0],
        lamp_share: &mut 0.0,
    };
    let work = &mut Work::default();
    let bench = &mut Bench::of(work).0;
    match radiometry {
        [one] => project::<1>(frames, way, one, bench, out),
        several => project_merged::<1>(frames, way, several, bench, out),
    };
    [f[0], wide[0]]
}

#[test]
fn responses_and_rows_are_stated_by_as_much_as_they_scatter() {
    let rig = Rig::load("rcg-1-16bit").unwrap();
    let camera = |prnu: f64, row_noise_e: f64| CameraFound {
        dark_dn: rig.camera.dark_dn,
        gain_e_per_dn: rig.gain_e_per_dn(),
        prnu,
        row_noise_e,
        ..LINEAR
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
        surroundings: None,
    };
    let way = Way {
        irradiance: 1.0,
        resampling: &resampling,
        stray: None,
        bias: &[],
        offset: Offset::default(),
        before: Vec::new(),
    };
    for (prnu, row_noise_e, light_e) in [(0.02, 0.0, 4e5), (0.0, 20.0, 1e4), (0.01, 10.0, 1e5)] {
        let camera = camera(prnu, row_noise_e);
        let radiometry = times_s.map(|time_s| of_black(&rig, Some(&camera), &black, time_s, 4).unwrap());
        for brackets in [1, 2] {
            let (mut sum, mut squares, mut stated) = (0.0, 0.0, 0.0);
            let draws = 4000;
            for draw in 0..draws {
                let frames = drawn(&rig, &camera, light_e, &times_s[..brackets], draw);
                let [f, wide] = onto_one_cell(&frames, &way, &radiometry[..brackets]);
                sum += f64::from(f);
                squares += f64::from(f).powi(2);
                stated += f64::from(wide).powi(2);
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
