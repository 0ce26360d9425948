//! Laws of the comparison: the bias that is there is found, and uncertainties explain it or do not.

use rand::{RngExt as _, SeedableRng as _};
use rand_xoshiro::Xoshiro256PlusPlus;

use super::*;
use crate::brdf::sample::parse;
use crate::judge::evaluate::scoring::seen_by;
use crate::judge::evaluate::tests::file;
use crate::store::provenance::Provenance;

/// A grey sample that does not depend on the directions, `brighter` by this share, known to 1 %, of which a tenth scatters.
fn capture(path: &std::path::Path, brighter: f64, seed: u64) -> Brdf {
    let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
    file(path, 1, &mut |_, _| {
        let noise: f64 = random.random_range(-1e-3..1e-3);
        let f = 0.2 * (1.0 + brighter + noise);
        Some((vec![f as f32], 0.002, Provenance::Measured))
    })
}

#[test]
fn a_bias_is_found_and_its_e_n_is_that_of_both_uncertainties() {
    let scratch = tempfile::tempdir().unwrap();
    let at = |name: &str| scratch.path().join(name);
    let first = Source::Measured(Box::new(capture(&at("a"), 0.0, 1)));
    for (number, bias) in [(2, 0.0), (3, 0.01), (4, 0.05), (5, -0.05)] {
        let second = capture(&at(&number.to_string()), bias, number);
        let found = compare(&first, &second, false).unwrap();
        assert!(found.judged > 5 && found.share > Some(0.9), "{found:?}");
        for one in found
            .regions
            .iter()
            .flat_map(|region| &region.channels)
            .chain(&found.overall)
        {
            let (Some(relative), Some(u), Some(e_n)) = (one.relative_bias, one.standard_uncertainty, one.e_n)
            else {
                continue;
            };
            assert!(
                (relative - bias / (1.0 + bias / 2.0)).abs() < 5e-4,
                "{bias}: {one:?}"
            );
            // Nothing says that any of it is noise: no mean lessens it. Interpolation of noise adds a little.
            assert!((0.0135..0.0155).contains(&u), "{one:?}");
            assert!((e_n - relative.abs() / (2.0 * u)).abs() < 1e-12);
        }
        let agrees = bias.abs() < 0.02;
        assert_eq!(found.agreeing, if agrees { found.judged } else { 0 }, "{bias}");
        assert_eq!(found.warnings.is_empty(), agrees, "{:?}", found.warnings);
    }
}

#[test]
fn a_model_counts_as_exact_and_nothing_is_compared_with_itself() {
    let scratch = tempfile::tempdir().unwrap();
    let at = |name: &str| scratch.path().join(name);
    let capture = capture(&at("a"), 0.0, 1);
    // 0.2/sr, and a tenth more than that.
    for (albedo, agrees) in [
        (0.2 * std::f64::consts::PI, true),
        (0.22 * std::f64::consts::PI, false),
    ] {
        let model = Source::Known(parse(&format!("lambert:{albedo}")).unwrap());
        let found = compare(&model, &capture, false).unwrap();
        assert_eq!(found.agreeing == found.judged, agrees, "{found:?}");
        let u = found.overall[0].standard_uncertainty.unwrap();
        assert!(
            (u - 0.01 * if agrees { 1.0 } else { 0.2 / 0.21 }).abs() < 2e-4,
            "{u}"
        );
    }
    let itself = Source::Measured(Box::new(Brdf::open(&at("a")).unwrap()));
    assert!(matches!(
        compare(&itself, &capture, false),
        Err(BrdfError::Content { .. })
    ));
    let empty = file(&at("empty"), 1, &mut |_, _| None);
    let found = compare(&Source::Known(parse("lambert:0.5").unwrap()), &empty, false).unwrap();
    assert_eq!((found.judged, found.share), (0, None));
    assert!(
        found.warnings[0].contains("none, 0 pairs"),
        "{:?}",
        found.warnings
    );
}

#[test]
fn a_camera_without_colours_is_compared_with_what_it_sees_of_them() {
    let scratch = tempfile::tempdir().unwrap();
    let at = |name: &str| scratch.path().join(name);
    let model = || Source::Known(parse("lambert:0.6,0.3,0.1").unwrap());
    let [grey, ..] = seen_by(
        parse("lambert:0.6,0.3,0.1")
            .unwrap()
            .f(glam::DVec3::Z, glam::DVec3::Z),
        1,
    );
    let of = |channels: usize| {
        move |_: usize, _: usize| {
            let f = if channels == 1 {
                vec![grey as f32]
            } else {
                [0.6, 0.3, 0.1]
                    .map(|rho| (rho / std::f64::consts::PI) as f32)
                    .to_vec()
            };
            Some((f, 1e-3, Provenance::Measured))
        }
    };
    let (one, three) = (file(&at("one"), 1, &mut of(1)), file(&at("three"), 3, &mut of(3)));
    let coloured = Source::Measured(Box::new(Brdf::open(&at("three")).unwrap()));
    for a in [&model(), &coloured] {
        let found = compare(a, &one, false).unwrap();
        assert!(found.overall[0].relative_bias.unwrap().abs() < 1e-5, "{found:?}");
        assert_eq!(found.overall.len(), 1);
    }
    let found = compare(&model(), &three, false).unwrap();
    assert!(
        found.agreeing == found.judged && found.overall.len() == 3,
        "{found:?}"
    );
    let error = compare(&Source::Measured(Box::new(one)), &three, false).unwrap_err();
    assert!(
        error.to_string().contains("channel: expected 3 channels as in"),
        "{error}"
    );
}
