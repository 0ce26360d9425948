//! A single pair has the value that its incident direction, prepared, gives towards its outgoing direction.

use std::f32;
use std::ops::Range;

use super::*;

/// Extents of the tables: `vndf`, `rgb`, and in between those of `ndf` and `sigma`; no two alike.
const VNDF: [usize; 2] = [7, 9];
const RGB: [usize; 2] = [6, 5];

/// Tabulated φi: isotropic, isotropic by convention with two different tables, all around, half and a quarter.
const PHI_I_RAD: [&[f32]; 5] = [
    &[0.0],
    &[0.0, 1.0],
    &[-f32::consts::PI, -1.0, 0.5, 2.0, f32::consts::PI],
    &[0.0, 0.7, 1.9, f32::consts::PI],
    &[0.0, 0.4, f32::consts::FRAC_PI_2],
];
const THETA_I_RAD: [f32; 4] = [0.0, 0.3, 0.8, 1.5];

/// Contents of the tables of as many slices as any of the files has; each file takes what it needs.
#[derive(Debug)]
struct Tables {
    vndf: Vec<f32>,
    rgb: Vec<f32>,
    facets: Vec<f32>,
}

/// Single-precision numbers of `range`, drawn in double precision: proptest 1.12 panics in about one of 10⁸ draws from a
/// range of `f32` ("assertion failed: self.low - result < initial.step"), and a case here draws thousands.
fn singles(range: Range<f64>) -> impl Strategy<Value = f32> {
    range.prop_map(|value| value as f32)
}

fn tables() -> impl Strategy<Value = Tables> {
    let slices = 5 * THETA_I_RAD.len();
    // Warps with valleys of zero density between peaks; values below zero, as measured files have some.
    let vndf = prop::collection::vec(
        prop_oneof![1 => Just(0.0_f32), 6 => singles(0.01..30.0)],
        slices * 63,
    );
    let rgb = prop::collection::vec(singles(-0.2..1.0), slices * 3 * 30);
    let facets = prop::collection::vec(singles(0.1..5.0), 20);
    (vndf, rgb, facets).prop_map(|(vndf, rgb, facets)| Tables { vndf, rgb, facets })
}

impl Tables {
    /// The file with these tabulated `phi_i`; with `rgb` = 1 everywhere if `even`.
    fn sample(&self, phi_i: &[f32], even: bool) -> MeasuredRgl {
        let slices = phi_i.len() * THETA_I_RAD.len();
        let ones = vec![1.0; slices * 3 * 30];
        let rgb = if even { &ones } else { &self.rgb[..slices * 3 * 30] };
        let (p, t) = (phi_i.len() as u64, THETA_I_RAD.len() as u64);
        let ([vndf_rows, vndf_columns], [rgb_rows, rgb_columns]) =
            (VNDF.map(|n| n as u64), RGB.map(|n| n as u64));
        let bytes = write(&[
            ("phi_i", &[p], Data::F32(phi_i)),
            ("theta_i", &[t], Data::F32(&THETA_I_RAD)),
            ("ndf", &[5, 4], Data::F32(&self.facets)),
            ("sigma", &[2, 8], Data::F32(&self.facets[..16])),
            (
                "vndf",
                &[p, t, vndf_rows, vndf_columns],
                Data::F32(&self.vndf[..slices * 63]),
            ),
            ("rgb", &[p, t, 3, rgb_rows, rgb_columns], Data::F32(rgb)),
            ("jacobian", &[1], Data::U8(&[1])),
        ]);
        read(&bytes).expect("valid")
    }
}

/// Angles in rad; the incident ones may be tabulated, where fewer slices take part.
fn incident_angles() -> impl Strategy<Value = (f64, f64)> {
    let tabulated = |angles: &'static [f32]| prop::sample::select(angles).prop_map(f64::from);
    let theta = prop_oneof![0.0..FRAC_PI_2, tabulated(&THETA_I_RAD)];
    let phi = prop_oneof![-PI..PI, tabulated(PHI_I_RAD[2])];
    (theta, phi)
}

proptest! {
    #[test]
    fn a_pair_is_worth_what_the_prepared_direction_gives(
        tables in tables(),
        pairs in prop::collection::vec((incident_angles(), (0.0..FRAC_PI_2, -PI..PI)), 20),
    ) {
        for phi_i in PHI_I_RAD {
            let (sample, even) = (tables.sample(phi_i, false), tables.sample(phi_i, true));
            for ((theta_i, phi_i), (theta_o, phi_o)) in &pairs {
                let (wi, wo) = (from_angles(*theta_i, *phi_i), from_angles(*theta_o, *phi_o));
                let (found, expected) = (sample.f(wi, wo), sample.incident(wi).f(wo));
                // Prepared tables of rgb have single precision: an error of that of the largest value, which is 1.
                let allowed = 1e-6 * even.f(wi, wo)[0];
                for (found, expected) in found.into_iter().zip(expected) {
                    prop_assert!((found - expected).abs() <= allowed, "{wi} {wo}: {found}, {expected}");
                }
            }
        }
    }
}

#[test]
fn pairs_below_the_horizon_have_no_value() {
    let sample = small_lambert().sample();
    let (up, level) = (DVec3::Z, DVec3::X);
    for (wi, wo) in [(up, -up), (-up, up), (up, level), (level, up)] {
        assert!(sample.f(wi, wo).iter().all(|f| *f == 0.0), "{wi} {wo}");
    }
}
