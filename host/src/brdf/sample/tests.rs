//! Laws that hold for every material, and the messages for wrong specifications.

use std::f64::consts::{FRAC_PI_2, TAU};

use proptest::prelude::*;

use super::*;
use crate::hemisphere::direction::{from_angles, from_degrees};

/// A direction of the upper hemisphere, 1e-4 rad and more above the horizon.
fn upper() -> impl Strategy<Value = DVec3> {
    (0.0..FRAC_PI_2 - 1e-4, 0.0..TAU).prop_map(|(theta_rad, phi_rad)| from_angles(theta_rad, phi_rad))
}

fn analytic() -> Vec<Box<dyn Sample>> {
    [
        "lambert:0.7",
        "ward:brass",
        "ward:rd=0,rs=0.9,ax=0.3,ay=0.2",
        "ggx",
        "ggx:satin",
        "ggx:plastic",
        "velvet",
        "satin",
    ]
    .iter()
    .map(|spec| parse(spec).expect("valid"))
    .collect()
}

fn turned(w: DVec3, angle_rad: f64) -> DVec3 {
    glam::DQuat::from_rotation_z(angle_rad) * w
}

proptest! {
    #[test]
    fn analytic_models_are_reciprocal(a in upper(), b in upper()) {
        for sample in analytic() {
            let (ab, ba) = (sample.f(a, b)[0], sample.f(b, a)[0]);
            // Values that are not normal numbers have no twelve digits.
            let tolerance = 1e-12 * ab.max(ba) + f64::MIN_POSITIVE;
            prop_assert!((ab - ba).abs() <= tolerance, "{sample:?}: {ab} {ba}");
            prop_assert!(ab.is_finite() && ab >= 0.0);
        }
    }

    #[test]
    fn isotropic_models_do_not_change_when_turned(a in upper(), b in upper(), angle_rad in 0.0..TAU) {
        for spec in ["lambert:0.3", "ward:ax=0.2,ay=0.2", "ggx:plastic"] {
            let sample = parse(spec).expect("valid");
            prop_assert!(sample.is_isotropic());
            let (before, after) = (sample.f(a, b)[1], sample.f(turned(a, angle_rad), turned(b, angle_rad))[1]);
            // The exponential amplifies the rounding of the rotation where it is far down its tail.
            prop_assert!((before - after).abs() <= 1e-9 * before + f64::MIN_POSITIVE, "{sample:?}: {before} {after}");
        }
    }

    #[test]
    fn no_text_makes_parse_panic(spec in "(lambert|ward|ggx|velvet|satin|[a-z]{0,3}):?[-=,.:a-z0-9]{0,12}") {
        let _ = parse(&spec);
    }
}

#[test]
fn anisotropic_models_change_when_turned() {
    for spec in ["ward:brass", "ggx:satin", "velvet", "satin"] {
        let sample = parse(spec).expect("valid");
        assert!(!sample.is_isotropic());
        // A highlight's flank, and for velvet, whose facets look sideways, both on the same side.
        let pairs = [
            (from_degrees(30.0, 0.0), from_degrees(20.0, 180.0)),
            (from_degrees(60.0, 0.0), from_degrees(60.0, 0.0)),
        ];
        let change = |(a, b)| {
            let after = sample.f(turned(a, FRAC_PI_2), turned(b, FRAC_PI_2))[0];
            (after / sample.f(a, b)[0] - 1.0).abs()
        };
        assert!(pairs.into_iter().map(change).fold(0.0, f64::max) > 0.01, "{spec}");
    }
}

/// Directional albedo ∫ f cosθo dω by the midpoint rule in (sin²θo, φo).
fn albedo(sample: &dyn Sample, wi: DVec3) -> f64 {
    let (n_sin2, n_phi) = (1200_u32, 1200_u32);
    let lit = sample.incident(wi);
    let mut sum = 0.0;
    for i in 0..n_sin2 {
        // Finer near the horizon, where lobes at grazing incidence are narrow in sin²θ: sin²θ = 1 − t².
        let t = (f64::from(i) + 0.5) / f64::from(n_sin2);
        let r = (1.0 - t * t).sqrt();
        for j in 0..n_phi {
            let (sin, cos) = ((f64::from(j) + 0.5) / f64::from(n_phi) * TAU).sin_cos();
            // cosθ dω = d(sin²θ) dφ / 2 = t dt dφ.
            sum += lit.f(DVec3::new(r * cos, r * sin, t))[0] * t;
        }
    }
    sum * TAU / f64::from(n_sin2) / f64::from(n_phi)
}

#[test]
fn lambert_reflects_its_albedo() {
    let found = albedo(&Lambert { albedo: [0.7; 3] }, from_degrees(60.0, 10.0));
    assert!((found - 0.7).abs() < 1e-6, "{found}");
}

#[test]
fn ggx_never_reflects_more_than_it_receives() {
    let white = Ggx {
        f0: 1.0,
        alpha_x: 0.3,
        alpha_y: 0.5,
        rho_d: 0.0,
    };
    for sample in [white, Ggx::METAL, Ggx::SATIN, Ggx::PLASTIC] {
        for theta_deg in [0.0, 45.0, 75.0, 85.0, 88.0] {
            let found = albedo(&sample, from_degrees(theta_deg, 30.0));
            assert!(found <= 1.0, "{sample:?} at {theta_deg}: {found}");
            // Nor much less, or the model loses light that it should not.
            assert!(
                found > 0.7 * (sample.f0 + sample.rho_d),
                "{sample:?} at {theta_deg}: {found}"
            );
        }
    }
}

#[test]
fn cloth_never_reflects_more_than_it_receives() {
    // Presets, and the extremes of what is allowed.
    for spec in [
        "velvet",
        "velvet:rd=0,rs=1,ax=0.05,ay=0.05",
        "velvet:rd=0,rs=1,ax=0.3,ay=0.3",
        "velvet:rd=0,rs=1,ax=0.05,ay=2",
        "velvet:rd=0,rs=1,ax=2,ay=2",
        "velvet:rd=0.5,rs=0.5,ax=0.3,ay=1",
        "satin",
        "satin:f0=1,rd=0,along=0.3,across=1,weft=0.5",
    ] {
        let sample = parse(spec).expect("valid");
        for theta_deg in [0.0, 45.0, 75.0, 85.0, 88.0] {
            for phi_deg in [0.0, 90.0] {
                let found = albedo(sample.as_ref(), from_degrees(theta_deg, phi_deg));
                assert!(
                    (0.0..=1.0).contains(&found),
                    "{spec} at {theta_deg}, {phi_deg}: {found}"
                );
            }
        }
    }
}

#[test]
fn no_model_reflects_at_or_below_the_horizon() {
    let up = from_degrees(30.0, 40.0);
    for sample in analytic() {
        for bad in [from_degrees(90.0, 10.0), from_degrees(100.0, 10.0), DVec3::NAN] {
            for value in sample.f(up, bad).into_iter().chain(sample.f(bad, up)) {
                assert!(value == 0.0, "{sample:?}: {value}");
            }
        }
    }
}

#[test]
fn specifications_give_the_models_they_name() {
    let same = |a: &str, b: &str| {
        let debug = |spec: &str| format!("{:?}", parse(spec).expect("valid"));
        assert_eq!(debug(a), debug(b));
    };
    same("lambert", "lambert:0.5");
    same("ward", "ward:brass");
    same("ward:brass", "ward:rd=0.1,rs=0.33,ax=0.05,ay=0.16");
    same("ward:ay=0.2", "ward:brass,ay=0.2");
    same("ggx", "ggx:f0=0.9,ax=0.1,ay=0.2,rd=0.05");
    same("ggx:rd=0,f0=0.6", "ggx:metal,f0=0.6,rd=0");
    same("velvet", "velvet:pile,rd=0.03,rs=0.6,ax=0.7,ay=1.2");
    same(
        "satin",
        "satin:silk,f0=0.3,along=0.14,across=0.6,weft=0.2,rd=0.12",
    );
    assert_eq!(
        format!("{:?}", parse("ggx:satin").expect("valid")),
        format!("{:?}", Ggx::SATIN)
    );
}

#[test]
fn a_wrong_specification_is_answered_with_one_sentence() {
    let wrong = |spec: &str, expected: &str| {
        assert_eq!(parse(spec).expect_err("must be refused").to_string(), expected);
    };
    wrong(
        "lambrt:0.5",
        "sample 'lambrt:0.5', model: expected lambert, ward, ggx, velvet, satin or the path of a measured file (.bsdf, .binary, .ssdd, .xml, .brdf, .npy) or of a certificate (.toml), found 'lambrt'",
    );
    wrong(
        "",
        "sample '', model: expected lambert, ward, ggx, velvet, satin or the path of a measured file (.bsdf, .binary, .ssdd, .xml, .brdf, .npy) or of a certificate (.toml), found ''",
    );
    wrong(
        "lambert:",
        "sample 'lambert:', albedo: expected a number from 0 to 1, found ''",
    );
    wrong(
        "lambert:1.5",
        "sample 'lambert:1.5', albedo: expected a number from 0 to 1, found '1.5'",
    );
    wrong(
        "lambert:nan",
        "sample 'lambert:nan', albedo: expected a number from 0 to 1, found 'nan'",
    );
    wrong(
        "ward:ax=x",
        "sample 'ward:ax=x', ax: expected a number from 0.001 to 1, found 'x'",
    );
    wrong(
        "ward:ax=0",
        "sample 'ward:ax=0', ax: expected a number from 0.001 to 1, found '0'",
    );
    wrong(
        "ward:bras",
        "sample 'ward:bras', arguments: expected a leading preset (brass) or rd=, rs=, ax=, ay=, found 'bras'",
    );
    wrong(
        "ward:f0=1",
        "sample 'ward:f0=1', arguments: expected a leading preset (brass) or rd=, rs=, ax=, ay=, found 'f0'",
    );
    wrong(
        "ward:rd=0,rd=0",
        "sample 'ward:rd=0,rd=0', rd: expected the parameter once, found it twice",
    );
    wrong(
        "ward:rd=0.5,rs=0.75",
        "sample 'ward:rd=0.5,rs=0.75', rd + rs: expected at most 1, found 1.25",
    );
    wrong(
        "ggx:rd=0.5,f0=1",
        "sample 'ggx:rd=0.5,f0=1', f0 + rd: expected at most 1, found 1.5",
    );
    wrong(
        "velvet:rd=0.5,rs=0.75",
        "sample 'velvet:rd=0.5,rs=0.75', rd + rs: expected at most 1, found 1.25",
    );
    wrong(
        "satin:weft=2",
        "sample 'satin:weft=2', weft: expected a number from 0 to 1, found '2'",
    );
    let missing = parse("nowhere/x.bsdf").expect_err("must be refused").to_string();
    assert!(
        missing.starts_with("nowhere/x.bsdf: expected a readable file, found: No such file"),
        "{missing}"
    );
}
