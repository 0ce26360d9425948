//! What black frames tell, of frames made by hand.

use rand::{RngExt as _, SeedableRng as _};
use rand_distr::StandardNormal;
use rand_xoshiro::Xoshiro256PlusPlus;

use super::*;
use crate::store::ExposureRecord;

const LAMP: LampFound = LampFound {
    flicker: 0.005,
    monitor: None,
};

fn rig() -> Rig {
    let mut rig = Rig::load("rcg-3").unwrap().with_image_size(64).unwrap();
    rig.camera.dark_dn = 1000.0;
    rig
}

/// Adds a frame of `numbers` to the `segment`, of 10 ms, taken at the first attempt.
fn show(segment: &mut Segment, incident: i64, numbers: impl Iterator<Item = f64>) {
    segment.frames.extend(numbers.map(|dn| dn.round() as u16));
    segment.records.push(ExposureRecord {
        incident,
        exposure_s: 0.01,
        attempts: 1,
        ..ExposureRecord::default()
    });
}

/// A measurement with a black pattern at each of `black`, whose offset and lamp are as `of` says of the pattern.
fn found(black: &[usize], of: impl Fn(usize) -> [f64; 2]) -> Black {
    found_on(&rig(), black, |pattern, _| of(pattern))
}

/// The same on `rig`, where they are as `of` says of the pattern and the band.
fn found_on(rig: &Rig, black: &[usize], of: impl Fn(usize, usize) -> [f64; 2]) -> Black {
    let bands = rig.shown_bands();
    let values = 4096 * bands;
    let mut frames = BlackFrames::new(rig, (None, Some(&LAMP)), &[(0.01, 0.0)]);
    for pattern in black {
        let light = |at: usize, band: usize| {
            let share = (at / bands) as f64 / 4096.0;
            [1.0, 0.5, 0.2][band] * (10.0 + 2000.0 * share.powi(2))
        };
        let dn = |at: usize| {
            let [offset, lamp] = of(*pattern, at % bands);
            (1000.0 + offset + lamp * light(at, at % bands)).round() as u16
        };
        let segment = Segment {
            frames: (0..values).map(dn).collect(),
            records: vec![ExposureRecord {
                incident: -1,
                exposure_s: 0.01,
                ..ExposureRecord::default()
            }],
            ..Segment::default()
        };
        frames.add(*pattern, &segment, values);
    }
    let request = crate::plan::Request::default();
    let plan = Plan::new(request, rig, 0.01).unwrap();
    frames.finish(rig, &plan).unwrap()
}

#[test]
fn bands_in_turn_have_one_offset_and_lamps_of_their_own() {
    let mut rig = rig();
    rig.camera.channels = 1;
    rig.bands = Some(crate::instrument::bands::tests::in_turn());
    let true_dn = |pattern: usize| 3.0 + 0.02 * pattern as f64;
    let lamp = |pattern: usize, band: usize| 1.0 + 0.01 * ((pattern + 2 * band) as f64).sin();
    let found = found_on(&rig, &[0, 40, 80, 120], |pattern, band| {
        [true_dn(pattern), lamp(pattern, band)]
    });
    for pattern in [0, 40, 80, 120] {
        let error = f64::from(found.drift.of(pattern).dn) - (true_dn(pattern) - true_dn(60));
        assert!(error.abs() < 0.1, "{pattern}: off by {error} DN");
    }
}

#[test]
fn the_offset_is_found_between_black_patterns_whatever_the_lamp_does() {
    let true_dn = |pattern: usize| 3.0 + 0.02 * pattern as f64;
    let lamp = |pattern: usize| 1.0 + 0.01 * (pattern as f64).sin();
    let found = found(&[0, 40, 80, 120], |pattern| [true_dn(pattern), lamp(pattern)]).drift;
    for pattern in [0, 13, 40, 77, 80, 119, 120, 150] {
        let offset = found.of(pattern);
        // Beside the mean of the black ones, which are in the middle at 60; as after the last one.
        let expected = true_dn(pattern.min(120)) - true_dn(60);
        let error = f64::from(offset.dn) - expected;
        assert!(error.abs() < 0.1, "{pattern}: {offset:?} for {expected}");
        assert!(
            error.abs() < 3.0 * f64::from(offset.uncertainty),
            "{pattern}: {offset:?}"
        );
    }
}

#[test]
fn what_is_left_of_a_lobe_is_found_in_the_black_frames_and_taken_out_of_their_mean() {
    let rig = rig();
    let (values, share) = (4096, 1.5e-3);
    let mut frames = BlackFrames::new(&rig, (None, Some(&LAMP)), &[(0.01, 2e-3)]);
    let black = |at: usize| 10.0 + 200.0 * (at as f64 / values as f64).powi(2);
    // A lobe here and there, each before a black frame.
    let lit = |number: usize, at: usize| {
        let away = at as f64 - 100.0 - 300.0 * number as f64;
        20_000.0 * (-away * away / 800.0).exp()
    };
    // What watches the lamp shines over all of the image, in all frames but one.
    let watching = |at: usize| 600.0 * (1.0 - at as f64 / values as f64);
    let mut segment = Segment::default();
    let mut shows = |incident: i64, own: &dyn Fn(usize) -> f64, before: &dyn Fn(usize) -> f64| {
        let dn = |at: usize| 1000.0 + black(at) + (1.0 - share) * own(at) + share * before(at);
        show(&mut segment, incident, (0..values).map(dn));
    };
    // Before the first one nothing is shown.
    shows(-1, &watching, &|_| 0.0);
    for number in 0..12 {
        let lit = |at: usize| watching(at) + lit(number, at);
        shows(number as i64, &lit, &watching);
        shows(-1, &watching, &lit);
    }
    shows(-2, &|_| 0.0, &watching);
    frames.add(0, &segment, values);
    let radiometry = frames.radiometry().unwrap().remove(0);
    let cleared = radiometry.lag.clear(1000.0 + share as f32 * 1000.0, 2000.0);
    let doubt = radiometry.lag.doubt(cleared - 2000.0);
    assert!((cleared - 1000.0).abs() < 0.1, "{cleared}");
    assert!((0.2..0.6).contains(&doubt), "{doubt}");
    let farthest = |mean: &[f32], own: &dyn Fn(usize) -> f64| {
        let far = |at: usize| (f64::from(mean[at]) - 1000.0 - black(at) - own(at)).abs();
        (0..values).map(far).fold(0.0, f64::max)
    };
    // Of 30 digital numbers at the lobes, a thirteenth in the mean.
    let [dark, unwatched] = [
        farthest(&radiometry.dark, &watching),
        farthest(&radiometry.unwatched, &|_| 0.0),
    ];
    assert!(dark < 0.7 && unwatched < 0.8, "{dark} {unwatched}");
}

#[test]
fn what_saturated_does_not_pass_for_a_little_more_light() {
    let rig = rig();
    let (values, share) = (4096, 1e-3);
    let mut frames = BlackFrames::new(&rig, (None, Some(&LAMP)), &[(0.01, 2e-3)]);
    let mut segment = Segment::default();
    let mut shows = |incident: i64, light: &dyn Fn(usize) -> f64| {
        let black = |at: usize| 1200.0 + 300.0 * (at as f64 / 90.0).sin();
        show(
            &mut segment,
            incident,
            (0..values).map(|at| black(at) + light(at)),
        );
    };
    for number in 0..8 {
        // Of which the middle is ten times what the camera shows.
        let lit = |at: usize| {
            let away = (at as f64 - 400.0 - 450.0 * f64::from(number)) / 100.0;
            650_000.0 * (-away * away).exp()
        };
        shows(number.into(), &lit);
        shows(-1, &|at| share * lit(at));
    }
    frames.add(0, &segment, values);
    let lag = frames.radiometry().unwrap().remove(0).lag;
    let own = lag.clear(1000.0 + share as f32 * 1000.0, 2000.0);
    assert!((own - 1000.0).abs() < 0.1, "{own}");
}

#[test]
fn a_jump_somewhere_between_two_black_patterns_is_uncertain_by_as_much() {
    let found = found(&[0, 40, 80, 120], |pattern| {
        [if pattern > 40 { 12.0 } else { 0.0 }, 1.0]
    })
    .drift;
    let [still, within] = [20, 60].map(|pattern| found.of(pattern).uncertainty);
    assert!(
        (within - still - 12.0 / 12.0_f32.sqrt()).abs() < 1.0,
        "{still} {within}"
    );
}

#[test]
fn how_much_the_lamp_changes_is_found_whatever_the_offset_does() {
    let patterns: Vec<usize> = (0..12).map(|number| 10 * number).collect();
    let lamp = |pattern: usize| 0.004 * (pattern as f64).sin();
    let squares: f64 = patterns.iter().map(|pattern| lamp(*pattern).powi(2)).sum();
    let mean: f64 = patterns.iter().map(|pattern| lamp(*pattern)).sum::<f64>() / 12.0;
    let variance = (squares - 12.0 * mean * mean) / 11.0;
    let of = |pattern: usize| [0.1 * pattern as f64, 1.0 + lamp(pattern)];
    let all = found(&patterns, of).lamp_variance.unwrap();
    assert!((all / variance - 1.0).abs() < 0.2, "{all} {variance}");
    // Of too few nothing is said.
    assert_eq!(found(&patterns[..6], of).lamp_variance, None);
}

#[test]
fn noise_does_not_pass_for_less_of_the_pattern_before() {
    let rig = rig();
    let (values, share) = (4096, 0.02);
    let mut frames = BlackFrames::new(&rig, (None, Some(&LAMP)), &[(0.01, 0.02)]);
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(3);
    let mut segment = Segment::default();
    let mut shows = |incident: i64, light: &dyn Fn(usize) -> f64| {
        let dn = |at: usize| {
            let noise: f64 = rng.sample(StandardNormal);
            let black = 500.0 * at as f64 / values as f64;
            1200.0 + black + light(at) + 8.0 * noise
        };
        show(&mut segment, incident, (0..values).map(dn));
    };
    for number in 0..12 {
        // Hardly brighter than noise.
        let before = |at: usize| {
            let away = (at as f64 - 100.0 - 300.0 * f64::from(number)) / 400.0;
            200.0 * (-away * away).exp()
        };
        shows(number.into(), &before);
        shows(-1, &|at| share * before(at));
    }
    frames.add(0, &segment, values);
    let lag = frames.radiometry().unwrap().remove(0).lag;
    let own = lag.clear(share as f32 * 1000.0, 1000.0);
    let doubt = lag.doubt(own - 1000.0);
    assert!(own.abs() < 2.0 * doubt && doubt < 8.0, "{own} {doubt}");
    assert!(own.abs() < 5.0, "{own}");
}
