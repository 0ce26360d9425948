//! Files made up for the purpose, whose f is known.

mod pairs;

use std::f64::consts::FRAC_PI_2;
use std::io::Cursor;
use std::path::Path;

use proptest::prelude::*;

use super::*;
use crate::brdf::sample::tensor_file::TensorFile;
use crate::brdf::sample::tensor_writer::{Data, Field, write};
use crate::brdf::sample::{Ggx, SampleError};
use crate::hemisphere::direction::{from_angles, from_degrees};

/// A file of identity warps: ndf = 1, sigma = 1/4, vndf = 1, and `rgb` (P × T × 3 × side × side) as it is.
struct Plain {
    phi_i: Vec<f32>,
    theta_i: Vec<f32>,
    side: usize,
    rgb: Vec<f32>,
}

impl Plain {
    /// The file that holds the BRDF `f`, where channels R, G and B are 1, 2 and 3 times `f`.
    fn of(phi_i: &[f32], theta_i: &[f32], side: usize, f: impl Fn(DVec3, DVec3) -> f64) -> Self {
        let mut rgb = Vec::new();
        for phi in phi_i {
            for theta in theta_i {
                // An isotropic file holds, at whatever azimuth, the values for φi = 0.
                let phi = if phi_i.len() <= 2 { 0.0 } else { *phi };
                let wi = from_angles(f64::from(*theta), f64::from(phi));
                for channel in 1..=3 {
                    for row in 0..side {
                        for column in 0..side {
                            let wo = mirrored(wi, vertex(row, column, side, 0.0));
                            // Continued below the horizon, so that interpolation near it stays right.
                            let horizon = DVec3::new(wo.x, wo.y, wo.z.abs().max(1e-6)).normalize();
                            rgb.push((f64::from(channel) * f(wi, horizon) * wo.z) as f32);
                        }
                    }
                }
            }
        }
        Self {
            phi_i: phi_i.to_vec(),
            theta_i: theta_i.to_vec(),
            side,
            rgb,
        }
    }

    /// The bytes of the file after `change` had its way with the fields.
    fn bytes(&self, change: impl FnOnce(&mut Vec<Field>)) -> Vec<u8> {
        let (p, t) = (self.phi_i.len() as u64, self.theta_i.len() as u64);
        let vndf = vec![1.0; (4 * p * t) as usize];
        let shapes: [&[u64]; 3] = [
            &[p, t],
            &[p, t, 2, 2],
            &[p, t, 3, self.side as u64, self.side as u64],
        ];
        let mut fields: Vec<Field> = vec![
            ("phi_i", &shapes[0][..1], Data::F32(&self.phi_i)),
            ("theta_i", &shapes[0][1..], Data::F32(&self.theta_i)),
            ("ndf", &[2, 2], Data::F32(&[1.0; 4])),
            ("sigma", &[2, 2], Data::F32(&[0.25; 4])),
            ("vndf", shapes[1], Data::F32(&vndf)),
            ("rgb", shapes[2], Data::F32(&self.rgb)),
            ("jacobian", &[1], Data::U8(&[1])),
        ];
        change(&mut fields);
        write(&fields)
    }

    fn sample(&self) -> MeasuredRgl {
        read(&self.bytes(|_| ())).expect("valid")
    }
}

/// A BRDF of (ωi, ωo) in sr⁻¹.
type Brdf<'a> = &'a dyn Fn(DVec3, DVec3) -> f64;

/// The half vector at a vertex of a `side` × `side` table whose azimuths count from `phi_zero_rad`.
fn vertex(row: usize, column: usize, side: usize, phi_zero_rad: f64) -> DVec3 {
    let (u, v) = (column as f64 / (side - 1) as f64, row as f64 / (side - 1) as f64);
    from_angles(u * u * FRAC_PI_2, (2.0 * v - 1.0) * PI + phi_zero_rad)
}

fn mirrored(w: DVec3, m: DVec3) -> DVec3 {
    2.0 * w.dot(m) * m - w
}

fn read(bytes: &[u8]) -> Result<MeasuredRgl, SampleError> {
    let path = Path::new("x.bsdf");
    MeasuredRgl::read(TensorFile::new(Cursor::new(bytes), path)?, path)
}

/// `n` equal steps from `first` to `last`, both included.
fn steps(first: f64, last: f64, n: usize) -> Vec<f32> {
    (0..=n)
        .map(|i| (first + (last - first) * i as f64 / n as f64) as f32)
        .collect()
}

fn small_lambert() -> Plain {
    Plain::of(&[0.0], &steps(0.0, FRAC_PI_2, 2), 3, |_, _| 0.2)
}

#[test]
fn spectra_are_read_as_the_colours_they_have() {
    // f is that of red, green and blue; as spectra the three bands reach as far as one sees them.
    let of = |change: &dyn Fn(&mut Vec<Field>)| {
        let plain = Plain::of(&[0.0], &steps(0.0, FRAC_PI_2, 2), 9, |_, _| 0.1);
        let bytes = plain.bytes(|fields| change(fields));
        read(&bytes)
    };
    let (wi, wo) = (from_degrees(30.0, 10.0), from_degrees(45.0, 100.0));
    let rgb = of(&|_| ()).unwrap();
    assert_eq!(rgb.colours(), None);
    let spectral = |wavelengths: &'static [f32], of_band: &dyn Fn(f32) -> f32| {
        let size = 81;
        let mut values = Vec::new();
        for theta in 0..3 {
            for nm in wavelengths {
                values.extend((0..size).map(|cell| of_band(*nm) * plain_value(theta, cell)));
            }
        }
        let shape = [1, 3, wavelengths.len() as u64, 9, 9];
        of(&|fields| {
            fields.retain(|(name, ..)| *name != "rgb");
            // The test ends before they do.
            let (shape, values) = (Vec::leak(shape.to_vec()), Vec::leak(values.clone()));
            fields.push(("spectra", shape, Data::F32(values)));
            fields.push((
                "wavelengths",
                Vec::leak(vec![wavelengths.len() as u64]),
                Data::F32(wavelengths),
            ));
        })
    };
    let grey = spectral(
        &[400.0, 440.0, 480.0, 520.0, 560.0, 600.0, 640.0, 680.0, 720.0],
        &|_| 1.0,
    )
    .unwrap();
    let [red, green, blue] = grey.f(wi, wo);
    let expected = rgb.f(wi, wo)[0];
    for channel in [red, green, blue] {
        assert!((channel / expected - 1.0).abs() < 1e-5, "{channel} {expected}");
    }
    assert!(
        grey.colours()
            .unwrap()
            .contains("9 wavelengths from 400 to 720 nm")
    );
    let reddish = spectral(
        &[400.0, 440.0, 480.0, 520.0, 560.0, 600.0, 640.0, 680.0, 720.0],
        &|nm| nm / 1000.0,
    )
    .unwrap();
    let [red, green, blue] = reddish.f(wi, wo).map(|f| f / expected);
    assert!(
        red > green && green > blue && (green - 0.55).abs() < 0.05,
        "{red} {green} {blue}"
    );
    let alone = spectral(&[650.0], &|_| 0.5).unwrap();
    assert!(alone.f(wi, wo).iter().all(|f| (f / expected - 0.5).abs() < 1e-5));
    let told = spectral(&[500.0, 550.0], &|_| 1.0).unwrap_err().to_string();
    assert!(
        told.contains("wavelengths") && told.contains("420 to 680"),
        "{told}"
    );
}

/// Entry `cell` of the red table of that polar angle of [`small_lambert`]'s kind, with f = 0.1 and 9 × 9 entries.
fn plain_value(theta: usize, cell: usize) -> f32 {
    let wi = from_angles(theta as f64 * FRAC_PI_2 / 2.0, 0.0);
    let wo = mirrored(wi, vertex(cell / 9, cell % 9, 9, 0.0));
    (0.1 * wo.z) as f32
}

#[test]
fn a_lambert_file_returns_its_constant() {
    for phi_i in [vec![0.0], vec![0.0, 1.0], steps(-PI, PI, 24)] {
        let (theta_i, side) = (steps(0.0, 1.4, 8), 33);
        let sample = Plain::of(&phi_i, &theta_i, side, |_, _| 0.25).sample();
        assert_eq!(sample.is_isotropic(), phi_i.len() <= 2);
        // At vertices of all tables nothing is interpolated.
        let (phi_rad, theta_rad) = (f64::from(phi_i[0]), f64::from(theta_i[2]));
        let wi = from_angles(theta_rad, phi_rad);
        let phi_zero_rad = if phi_i.len() <= 2 { phi_rad } else { 0.0 };
        let mut above = 0;
        for row in 0..side - 1 {
            for column in 0..side {
                let wo = mirrored(wi, vertex(row, column, side, phi_zero_rad));
                if wo.z > 0.05 {
                    above += 1;
                    for (channel, value) in sample.f(wi, wo).into_iter().enumerate() {
                        let expected = 0.25 * (channel + 1) as f64;
                        assert!((value / expected - 1.0).abs() < 1e-5, "{row} {column}: {value}");
                    }
                }
            }
        }
        assert!(above > 100);
        // Between them f cosθo is interpolated.
        for (theta_deg, phi_deg) in [(10.0, 20.0), (45.0, 170.0), (60.0, 300.0)] {
            let [red, ..] = sample.f(from_degrees(33.0, 75.0), from_degrees(theta_deg, phi_deg));
            assert!((red / 0.25 - 1.0).abs() < 0.03, "{theta_deg} {phi_deg}: {red}");
        }
    }
}

#[test]
fn anisotropic_files_cover_the_circle_by_their_symmetry() {
    let rough = Ggx {
        f0: 0.5,
        alpha_x: 0.5,
        alpha_y: 1.0,
        rho_d: 0.1,
    };
    // Turned by 25° a material keeps its symmetry under half a turn but has no mirror symmetry in x and y.
    let turn = |w: DVec3| glam::DQuat::from_rotation_z(0.436) * w;
    let skew = |wi: DVec3, wo: DVec3| rough.f(turn(wi), turn(wo))[0];
    let straight = |wi: DVec3, wo: DVec3| rough.f(wi, wo)[0];
    let theta_i = steps(0.0, FRAC_PI_2, 18);
    let files: [(&str, f64, f64, Brdf); 7] = [
        ("full from −π", -PI, PI, &skew),
        ("full from 0", 0.0, TAU, &skew),
        ("half below", -PI, 0.0, &skew),
        ("half around x", -FRAC_PI_2, FRAC_PI_2, &skew),
        ("third quadrant", -PI, -FRAC_PI_2, &straight),
        ("first quadrant", 0.0, FRAC_PI_2, &straight),
        ("fourth quadrant", 1.5 * PI, TAU, &straight),
    ];
    for (name, first, last, f) in files {
        let count = ((last - first) / 0.17).ceil() as usize;
        let sample = Plain::of(&steps(first, last, count), &theta_i, 33, f).sample();
        assert!(!sample.is_isotropic());
        for phi_i_deg in (5..360).step_by(50) {
            let wi = from_degrees(40.0, f64::from(phi_i_deg));
            for phi_o_deg in (15..360).step_by(60) {
                let wo = from_degrees(50.0, f64::from(phi_o_deg));
                let (found, expected) = (sample.f(wi, wo)[0], f(wi, wo));
                let error = (found / expected - 1.0).abs();
                assert!(
                    error < 0.03,
                    "{name}, {phi_i_deg} {phi_o_deg}: {found} instead of {expected}"
                );
            }
        }
    }
}

#[test]
fn isotropic_files_count_the_azimuth_from_the_incident_direction() {
    // Not symmetric about the plane of incidence, so that the sense of rotation matters.
    let handed = |wi: DVec3, wo: DVec3| 0.3 + 0.2 * wi.cross(wo).z;
    let sample = Plain::of(&[0.0], &steps(0.0, FRAC_PI_2, 18), 65, handed).sample();
    for phi_i_deg in [0.0, 100.0, 250.0] {
        for phi_o_deg in [20.0, 130.0, 300.0] {
            let (wi, wo) = (from_degrees(50.0, phi_i_deg), from_degrees(30.0, phi_o_deg));
            let (found, expected) = (sample.f(wi, wo)[0], handed(wi, wo));
            assert!(
                (found / expected - 1.0).abs() < 0.02,
                "{phi_i_deg} {phi_o_deg}: {found}, {expected}"
            );
        }
    }
}

#[test]
fn azimuths_that_cover_no_known_part_of_the_circle_are_refused() {
    for (first, last, text) in [(0.0, 2.0, "0 to 2"), (0.5, 0.5 + FRAC_PI_2, "0.5 to 2.07079")] {
        let message = read(&Plain::of(&steps(first, last, 2), &[0.0], 2, |_, _| 0.2).bytes(|_| ()))
            .expect_err("must be refused")
            .to_string();
        let start = format!("x.bsdf, phi_i: expected azimuths that span 2π, π or one quadrant, found {text}");
        assert!(message.starts_with(&start), "{message}");
    }
}

#[test]
fn facet_statistics_scale_the_values_if_the_file_says_so() {
    let plain = small_lambert();
    let f_with = |sigma: f32, jacobian: u8| {
        let bytes = plain.bytes(|fields| {
            fields[3].2 = Data::F32(Box::leak(Box::new([sigma; 4])));
            fields[6].2 = Data::U8(Box::leak(Box::new([jacobian])));
        });
        read(&bytes).expect("valid").f(DVec3::Z, DVec3::Z)[1]
    };
    let near = |found: f64, expected: f64| assert!((found - expected).abs() < 1e-6, "{found}");
    near(f_with(0.25, 1), 0.4);
    near(f_with(0.5, 1), 0.2);
    near(f_with(0.5, 0), 0.4);
    near(f_with(0.0, 1), 0.0);
}

#[test]
fn values_below_zero_count_as_zero() {
    let sample = Plain::of(&[0.0], &[0.0], 2, |_, _| -0.2).sample();
    assert!(sample.f(DVec3::Z, DVec3::Z).iter().all(|value| *value == 0.0));
}

#[test]
fn a_wrong_field_is_named() {
    let plain = small_lambert();
    let message = |change: &dyn Fn(&mut Vec<Field>)| {
        read(&plain.bytes(change))
            .expect_err("must be refused")
            .to_string()
    };
    let names = ["phi_i", "theta_i", "ndf", "sigma", "vndf", "rgb", "jacobian"];
    for (index, name) in names.into_iter().enumerate() {
        let missing = message(&|fields| {
            fields.remove(index);
        });
        assert!(
            missing.starts_with(&format!("x.bsdf, {name}: expected ")),
            "{missing}"
        );
        let flat = message(&|fields| fields[index].1 = &[]);
        assert!(flat.starts_with(&format!("x.bsdf, {name}: expected ")), "{flat}");
        if name != "jacobian" {
            let integers = message(&|fields| fields[index].2 = Data::U8(&[0; 400]));
            assert!(integers.starts_with(&format!("x.bsdf, {name}: ")), "{integers}");
            assert!(integers.contains("found u8 ["), "{integers}");
        }
    }
    assert_eq!(
        message(&|fields| fields[2].2 = Data::F32(&[1.0, 1.0, -1.0, 1.0])),
        "x.bsdf, ndf, entry 2: expected a finite value of at least 0, found -1"
    );
    assert_eq!(
        message(&|fields| fields[4].2 = Data::F32(&[0.0; 12])),
        "x.bsdf, vndf, slice 0: expected a density, found zero everywhere"
    );
    assert_eq!(
        message(&|fields| fields[1].2 = Data::F32(&[0.0, 0.5, 0.5])),
        "x.bsdf, theta_i, entry 2: expected ascending angles, found 0.5 after 0.5"
    );
    assert_eq!(
        message(&|fields| fields[1].2 = Data::F32(&[0.0, 45.0, 90.0])),
        "x.bsdf, theta_i: expected angles from 0 to π/2, found 0 to 90"
    );
    let told = message(&|fields| fields[5].0 = "spectra");
    assert!(told.starts_with("x.bsdf, wavelengths: expected f32"), "{told}");
}

#[test]
fn refuses_the_file_cut_at_any_byte() {
    let bytes = small_lambert().bytes(|_| ());
    for length in 0..bytes.len() {
        assert!(
            read(&bytes[..length]).is_err(),
            "cut at {length} of {}",
            bytes.len()
        );
    }
    read(&bytes).expect("whole");
}

proptest! {
    #[test]
    fn never_panics_on_a_damaged_file(
        damage in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..8),
    ) {
        let mut bytes = Plain::of(&steps(-PI, PI, 4), &[0.0, 1.0], 2, |_, _| 0.2).bytes(|_| ());
        for (at, byte) in damage {
            let at = at.index(bytes.len());
            bytes[at] = byte;
        }
        if let Ok(sample) = read(&bytes) {
            for phi_deg in [0.0, 90.0, 200.0] {
                let f = sample.f(from_degrees(60.0, phi_deg), from_degrees(30.0, 10.0));
                prop_assert!(f.iter().all(|value| *value >= 0.0), "{f:?}");
            }
        }
    }
}
