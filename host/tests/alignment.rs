//! Somebody follows the advice of the alignment aid: from 3 mm and 2° off the rig comes to where its file has it.

use rand::{RngExt as _, SeedableRng as _};
use rand_distr::StandardNormal;
use rand_xoshiro::Xoshiro256PlusPlus;
use rcg::base::progress::Silent;
use rcg::calibrate::by_hand::{Answer, Asked, Hands};
use rcg::calibrate::geometry::alignment::{ALIGNED_DEG, ALIGNED_MM, Advice, advise, offset_mm};
use rcg::calibrate::live::{Settings, Shown, Table};
use rcg::hemisphere::direction::angle_between;
use rcg::instrument::optics::View;
use rcg::instrument::rig::Rig;
use rcg::plan::Virtual;
use rcg::virtual_rig::setup::World;

/// Directions up to this angle from the normal are judged, degrees.
const JUDGED_DEG: f64 = 80.0;
/// Rounds in which it has to be done.
const ROUNDS: usize = 5;

/// Nobody: the virtual rig holds by itself what is asked for.
struct Nobody;

impl Hands for Nobody {
    fn change(&mut self, _asked: &Asked) -> Answer {
        panic!("the virtual rig asks nobody");
    }
}

/// A preset with a projector of so many pixels to one: its stripes are fewer, and drawn faster.
fn coarse(preset: &str, times: u32) -> Rig {
    let mut rig = Rig::load(preset).unwrap();
    let lens = &mut rig.projector.lens;
    (lens.width_px, lens.height_px) = (lens.width_px / times, lens.height_px / times);
    lens.focal_px /= f64::from(times);
    lens.centre_px = lens.centre_px.map(|px| px / f64::from(times));
    rig
}

/// RMS error over camera and projector, degrees, of directions that `nominal` has and `truth` does not, and the larger lateral offset,
/// millimetres.
fn errors(truth: &Rig, nominal: &Rig) -> (f64, f64) {
    let mut squares = Vec::new();
    for view in [View::camera as fn(&Rig) -> View, View::projector] {
        let (truth, nominal) = (view(truth), view(nominal));
        let (width, height) = nominal.size_px();
        let mut of_device = Vec::new();
        for at in 0..400 {
            let (column, row) = (f64::from(at % 20) + 0.5, f64::from(at / 20) + 0.5);
            let (u, v) = (column / 20.0 * width as f64, row / 20.0 * height as f64);
            if let (Ok(stated), Some(true_one)) = (nominal.direction(u, v), truth.sight(u, v))
                && stated.z >= JUDGED_DEG.to_radians().cos()
            {
                of_device.push(angle_between(stated, true_one).to_degrees().powi(2));
            }
        }
        assert!(of_device.len() > 50);
        squares.push(of_device.iter().sum::<f64>() / of_device.len() as f64);
    }
    let lenses = |rig: &Rig| [rig.camera.lens.clone(), rig.projector.lens.clone()];
    let lateral = lenses(truth)
        .into_iter()
        .zip(lenses(nominal))
        .map(|(lens, nominal)| {
            let [right, down, _] = offset_mm(&lens, &nominal);
            right.hypot(down)
        });
    (
        (squares.iter().sum::<f64>() / 2.0).sqrt(),
        lateral.fold(0.0, f64::max),
    )
}

/// Follows the advice on a rig that is drawn by `seed`, with hands that miss by a twentieth of a move and 0.03 mm or degrees. Returns the errors
/// before and after each round, and the last advice.
fn align(nominal: &Rig, seed: u64) -> (Vec<(f64, f64)>, Advice) {
    let spec = Virtual {
        seed,
        ..Virtual::default()
    };
    let settings = Settings {
        shown: Shown::Black,
        exposure_s: nominal.camera.exposure_s,
        gain: None,
        held: "nothing".to_owned(),
    };
    let world = World::read(&spec, None).unwrap();
    let mut table = Table::new((nominal, nominal), 16, Some(world), settings).unwrap();
    table.misalign(seed, 3.0, 2.0).unwrap();
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed);
    let folder = tempfile::tempdir().unwrap();
    let mut found = vec![errors(&table.truth().unwrap().rig, nominal)];
    loop {
        let dir = folder.path().join(found.len().to_string());
        assert!(table.views(&dir, None, &mut Nobody, &Silent).unwrap());
        let advice = advise(&dir).unwrap();
        if std::env::var("RCG_ALIGNMENT").is_ok() {
            println!(
                "{:.3}° {:.3} mm as advised: {:?}",
                advice.directions_deg, advice.lateral_mm, advice.undetermined
            );
            for one in &advice.moves {
                println!("  {} {}", one.words, one.is_combined);
            }
        }
        if advice.is_aligned || found.len() > ROUNDS {
            return (found, advice);
        }
        for one in advice.moves.iter().filter(|one| one.is_clear) {
            let [part, step]: [f64; 2] = [rng.sample(StandardNormal), rng.sample(StandardNormal)];
            let by = one.by * (1.0 + 0.05 * part) + 0.03 * step;
            table.move_part(one.part, one.motion, by).unwrap();
        }
        found.push(errors(&table.truth().unwrap().rig, nominal));
        println!("rig {seed}: {:.2?} in ° and mm", found.last().unwrap());
    }
}

/// Rigs that are drawn by `seeds`, of which none is said to be aligned better than it is. Returns how many stand within what is asked for.
fn aligned(nominal: &Rig, seeds: std::ops::Range<u64>) -> usize {
    let mut within = 0;
    for seed in seeds {
        let (found, advice) = align(nominal, seed);
        println!("rig {seed}: {found:.2?}, {} rounds", found.len() - 1);
        let (deg, mm) = *found.last().unwrap();
        assert!(found[0].0 > 1.0, "rig {seed} was aligned before: {found:?}");
        // As near as it is said to be; of two devices the farther counts, along two axes.
        let told_mm = advice.lateral_mm + 4.0 * advice.lateral_uncertainty_mm;
        assert!(
            !advice.is_aligned || (deg < 1.2 * ALIGNED_DEG && mm < told_mm),
            "rig {seed}: {found:?} {told_mm}"
        );
        within += usize::from(advice.is_aligned && deg < ALIGNED_DEG && mm < ALIGNED_MM);
        let untold: Vec<&str> = advice.undetermined.iter().map(|one| one.what.as_str()).collect();
        for what in [
            "sample",
            "camera, forward",
            "projector, forward",
            "camera, turned",
            "projector, turned",
        ] {
            assert!(untold.iter().any(|untold| untold.starts_with(what)), "{untold:?}");
        }
    }
    within
}

#[test]
fn who_follows_the_advice_brings_a_rig_from_3_mm_and_2_degrees_to_its_file() {
    assert_eq!(aligned(&coarse("rcg-3", 4), 1..2), 1);
}

#[test]
#[ignore = "long: ./test.sh full runs it"]
fn of_ten_rigs_most_are_aligned_in_five_rounds() {
    let within = aligned(&coarse("rcg-3", 2), 1..11);
    println!("{within} of 10 within {ALIGNED_DEG}° and {ALIGNED_MM} mm");
    // Hands that miss by 0.03° in each turn come to rest at 0.3°, and of some rigs the views tell the centres to no better than 0.3 mm.
    assert!(within >= 5, "{within} of 10");
}
