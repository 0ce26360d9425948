//! What is looked up between captured directions is right within what is stated of it, where the grid resolves the lobe: what it does
//! not is blurred, and stated of the captured values.

use super::*;
use crate::hemisphere::direction::from_degrees;

/// Random pairs of directions with θ up to 75°, a third of them near the mirror's.
fn pairs(random: &mut Xoshiro256PlusPlus, count: usize) -> Vec<(DVec3, DVec3)> {
    let mut all = Vec::new();
    while all.len() < count {
        let mut angle = |to: f64| random.random_range(0.0..to);
        let (theta_i, phi_i) = (angle(75.0), angle(360.0));
        let (theta_o, phi_o) = if all.len() % 3 == 0 {
            (theta_i + angle(20.0) - 10.0, phi_i + 180.0 + angle(40.0) - 20.0)
        } else {
            (angle(75.0), angle(360.0))
        };
        if (0.0..75.0).contains(&theta_o) {
            all.push((from_degrees(theta_i, phi_i), from_degrees(theta_o, phi_o)));
        }
    }
    all
}

#[test]
fn interpolation_is_uncertain_by_what_it_is_wrong() {
    let scratch = tempfile::tempdir().unwrap();
    let grid = Grid::ThetaPhi { step_deg: STEP_DEG }.build().unwrap();
    let disk = Disk::new(SIZE);
    for (number, spec) in ["lambert:0.5", "velvet", "ward:rd=0.2,rs=0.1,ax=0.5,ay=0.4"]
        .into_iter()
        .enumerate()
    {
        let sample = parse(spec).unwrap();
        let captured = file(&scratch.path().join(number.to_string()), 3, &mut |row, cell| {
            let f = sample.f(grid.direction(row), disk.direction(cell)?);
            Some((
                f.map(|f| f as f32).to_vec(),
                1e-3 * f[0] as f32,
                Provenance::Merged,
            ))
        });
        let asked = pairs(&mut Xoshiro256PlusPlus::seed_from_u64(number as u64), 3000);
        let stated = captured.stated(&asked).unwrap();
        let values = captured.values(&asked).unwrap();
        let (mut within, mut far, mut all) = (0, 0, 0);
        for ((stated, value), (wi, wo)) in stated.iter().zip(&values).zip(&asked) {
            let stated = stated.as_ref().unwrap();
            assert_eq!(stated.f.map(f32::to_bits), value.unwrap().map(f32::to_bits));
            assert_eq!(stated.provenance, Provenance::Merged);
            let off = (f64::from(stated.f[0]) - sample.f(*wi, *wo)[0]).abs() / f64::from(stated.sigma[0]);
            all += 1;
            within += usize::from(off <= 2.0);
            far += usize::from(off > 6.0);
        }
        assert!(
            within * 100 >= all * 93 && far * 1000 <= all,
            "{spec}: {within} and {far} of {all}"
        );
    }
}

#[test]
fn beside_images_that_are_missing_f_may_go_on_in_any_way() {
    let scratch = tempfile::tempdir().unwrap();
    let grid = Grid::ThetaPhi { step_deg: STEP_DEG }.build().unwrap();
    let disk = Disk::new(SIZE);
    let sample = parse("velvet").unwrap();
    // Of rings at 11, 34, 56 and 79 degrees the second is hidden.
    let captured = file(&scratch.path().join("hidden"), 1, &mut |row, cell| {
        let is_hidden = (22.5..45.0).contains(&grid.angles_deg(row).0);
        let f = sample.f(grid.direction(row), disk.direction(cell)?)[0];
        (!is_hidden).then(|| (vec![f as f32], 1e-3 * f as f32, Provenance::Merged))
    });
    let mut random = Xoshiro256PlusPlus::seed_from_u64(9);
    let mut angle = |from: f64, to: f64| random.random_range(from..to);
    let asked: Vec<(DVec3, DVec3)> = (0..2000)
        .map(|_| {
            let wi = from_degrees(angle(46.0, 55.0), angle(0.0, 360.0));
            (wi, from_degrees(angle(0.0, 75.0), angle(0.0, 360.0)))
        })
        .collect();
    let stated = captured.stated(&asked).unwrap();
    let off = stated.iter().zip(&asked).filter_map(|(stated, (wi, wo))| {
        let stated = stated.as_ref().ok()?;
        Some((f64::from(stated.f[0]) - sample.f(*wi, *wo)[0]).abs() / f64::from(stated.sigma[0]))
    });
    let off: Vec<f64> = off.collect();
    let within = off.iter().filter(|off| **off <= 2.0).count();
    assert!(
        off.len() > 1000 && within * 100 >= off.len() * 95,
        "{within} of {}",
        off.len()
    );
    assert!(
        off.iter().all(|off| *off < 6.0),
        "{:?}",
        off.iter().copied().reduce(f64::max)
    );
}
