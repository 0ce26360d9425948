//! Laws of repeats: scatter is found as it is, and one that is off is named, not the others.

use std::path::Path;

use rand::SeedableRng as _;
use rand_distr::{Distribution as _, Normal};
use rand_xoshiro::Xoshiro256PlusPlus;

use super::*;
use crate::judge::evaluate::tests::file;
use crate::store::provenance::Provenance;

/// Writes a grey sample of 0.2/sr, `brighter` by this share, that scatters by 1 % and states 2 %.
fn repeat(folder: &Path, name: &str, brighter: f64, seed: u64) -> Repeat {
    let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
    let noise = Normal::new(0.0, 0.01).unwrap();
    let brdf = file(&folder.join(name), 1, &mut |_, _| {
        let f = 0.2 * (1.0 + brighter + noise.sample(&mut random));
        Some((vec![f as f32], 0.004, Provenance::Measured))
    });
    Repeat {
        name: name.to_owned(),
        brdf,
        began: None,
    }
}

#[test]
fn scatter_is_what_it_is_in_every_region() {
    let folder = tempfile::tempdir().unwrap();
    let repeats: Vec<Repeat> = (0..4)
        .map(|seed| repeat(folder.path(), &format!("r{seed}"), 0.0, seed))
        .collect();
    check_alike(&repeats).unwrap();
    let found = Repeats::of(&repeats).unwrap();
    assert!(
        found.scatter.len() > 10 && found.outliers.is_empty(),
        "{:?}",
        found.outliers
    );
    for one in &found.scatter {
        let chance = 5.0 * 0.01 / (6.0 * one.samples as f64).sqrt();
        assert!((one.scatter.unwrap() - 0.01).abs() < chance, "{one:?}");
        assert!((one.standard_uncertainty.unwrap() - 0.02).abs() < 2e-3 && !one.is_larger);
        // Without a budget nothing says what of σ is noise.
        assert_eq!(one.ratio, None);
    }
    let pairs: u64 = found.by_count.iter().sum();
    assert!(pairs > 0 && found.by_count[3] == pairs, "{:?}", found.by_count);
    assert!(found.drift.is_empty() && found.warnings[0].starts_with("drift: none, 4 of 4"));
}

#[test]
fn the_one_that_is_off_is_named_with_its_size_and_no_other() {
    let folder = tempfile::tempdir().unwrap();
    for (off, count) in [(0.0, 4), (0.2, 3), (-0.2, 3), (0.2, 5)] {
        let repeats: Vec<Repeat> = (0..count)
            .map(|number| {
                let brighter = if number == 1 { off } else { 0.0 };
                repeat(folder.path(), &format!("r{number}"), brighter, number)
            })
            .collect();
        let found = Repeats::of(&repeats).unwrap();
        let named: Vec<usize> = found.outliers.iter().map(|outlier| outlier.number).collect();
        if off == 0.0 {
            assert!(named.is_empty());
            continue;
        }
        assert_eq!(named, [1], "{off} {count}");
        // Relative to the others, which it has no part in.
        assert!(
            (found.outliers[0].departure.relative - off).abs() < 1e-2,
            "{:?}",
            found.outliers
        );
    }
    // Of two nobody can tell which.
    let two: Vec<Repeat> = [0.0, 0.2]
        .into_iter()
        .zip(0..)
        .map(|(off, seed)| repeat(folder.path(), &format!("t{seed}"), off, seed))
        .collect();
    let found = Repeats::of(&two).unwrap();
    assert!(
        found.outliers.is_empty() && found.scatter.iter().all(|one| one.is_larger),
        "{:?}",
        found.scatter
    );
    assert!(
        found
            .warnings
            .iter()
            .any(|warning| warning.contains("scatter by more than they state"))
    );
}

#[test]
fn what_is_no_repeat_is_refused_by_its_field() {
    let folder = tempfile::tempdir().unwrap();
    let one = || repeat(folder.path(), "one", 0.0, 1);
    let colours = Repeat {
        name: "colours".to_owned(),
        brdf: file(&folder.path().join("colours"), 3, &mut |_, _| {
            Some((vec![0.2; 3], 1e-3, Provenance::Measured))
        }),
        began: None,
    };
    for (other, field) in [
        (colours, "channels: expected 1 as in"),
        (one(), "captures: expected another"),
    ] {
        let error = check_alike(&[one(), other]).unwrap_err().to_string();
        assert!(error.contains(field), "{error}");
    }
}
