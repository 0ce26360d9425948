//! Edges in, exposures out, by hand.

use super::*;
use crate::instrument::rig::Rig;
use crate::plan::Faults;
use crate::virtual_rig::Noise;
use crate::virtual_rig::light::{AtSample, Light, Spot};

const CLOCK_HZ: u32 = 125_000_000;

fn light(irradiance: f64) -> Glow {
    let nodes = [glam::DVec3::Z; 4];
    Glow {
        at_sample: AtSample::Spots(
            [Spot {
                light: Light { irradiance, nodes },
                area: None,
                axis: glam::DVec3::X,
            }]
            .into(),
        ),
        direct: 0.0,
        colour: [1.0; 3],
    }
}

fn spots(light: &Glow) -> &[Spot] {
    match &light.at_sample {
        AtSample::Spots(spots) => spots,
        AtSample::Image(_) => &[],
    }
}

/// A stage with patterns of irradiance 1, 2, 3 …; settling 33.3 ms, camera delay 5 µs, read-out 26 ms.
fn stage() -> Stage {
    let behaviour = Behaviour {
        noise: Noise::Off,
        seed: 1,
        faults: Faults::default(),
        lamp_h: 0.0,
    };
    let mut stage = Stage::new(
        &Truth::of(&Rig::load("rcg-1-16bit").unwrap()),
        behaviour,
        CLOCK_HZ,
    );
    for index in 1..=4 {
        stage.load_pattern(&[index], (u8::MAX, None), light(f64::from(index)));
    }
    stage.arm_camera();
    stage
}

fn ticks(at_s: f64) -> Ticks {
    Ticks((at_s * f64::from(CLOCK_HZ)).round() as u64)
}

fn pulse(stage: &mut Stage, line: Line, at_s: f64, width_s: f64) -> [Option<StrobeEdge>; 2] {
    [
        stage.edge(line, Level::Active, ticks(at_s)),
        stage.edge(line, Level::Inactive, ticks(at_s + width_s)),
    ]
}

fn seen(shots: &[Shot]) -> Vec<Vec<(f64, f64)>> {
    let one = |shot: &Shot| {
        shot.seen
            .iter()
            .map(|(light, s)| (spots(&light.glow)[0].light.irradiance, (s * 1e6).round()))
            .collect()
    };
    shots.iter().map(one).collect()
}

#[test]
fn a_trigger_in_time_sees_one_pattern_and_strobes_for_its_exposure() {
    let mut stage = stage();
    pulse(&mut stage, Line::Proj, 0.0, 5e-6);
    let [on, off] = pulse(&mut stage, Line::Cam, 0.0333, 0.01).map(Option::unwrap);
    assert!(on.active && !off.active);
    assert_eq!((on.at, off.at), (ticks(0.033_305), ticks(0.043_305)));
    assert_eq!(seen(&stage.take_shots(usize::MAX)), [[(1.0, 10_000.0)]]);
}

#[test]
fn an_early_trigger_straddles_two_patterns() {
    let mut stage = stage();
    pulse(&mut stage, Line::Proj, 0.0, 5e-6);
    pulse(&mut stage, Line::Proj, 0.1, 5e-6);
    // Pattern 2 is stable at 133.3 ms: 4 ms of this exposure come before.
    pulse(&mut stage, Line::Cam, 0.1293 - 5e-6, 0.01);
    assert_eq!(
        seen(&stage.take_shots(usize::MAX)),
        [[(1.0, 4_000.0), (2.0, 6_000.0)]]
    );
}

#[test]
fn a_little_of_the_pattern_before_is_left_and_the_own_lacks_as_much() {
    let mut stage = stage();
    stage.lag.share = 0.01;
    for step in 0..2 {
        let at_s = 0.1 * f64::from(step);
        pulse(&mut stage, Line::Proj, at_s, 5e-6);
        pulse(&mut stage, Line::Cam, at_s + 0.0333, 0.01);
    }
    let shots = stage.take_shots(usize::MAX);
    // Before the first one nothing is shown.
    let left_s = stage.lag.left_s(0.0333, 5e-6, 0.010_005);
    assert!((0.4e-4..0.6e-4).contains(&left_s), "{left_s}");
    let us = |s: f64| (s * 1e6).round();
    assert_eq!(
        seen(&shots),
        [
            vec![(1.0, us(0.01 - left_s))],
            vec![(1.0, us(left_s)), (2.0, us(0.01 - left_s))]
        ]
    );
}

#[test]
fn before_the_first_pattern_and_after_the_last_it_is_dark() {
    let mut stage = stage();
    pulse(&mut stage, Line::Cam, 0.0, 0.01);
    for step in 0..5 {
        pulse(&mut stage, Line::Proj, 0.1 * f64::from(step + 1), 5e-6);
    }
    pulse(&mut stage, Line::Cam, 0.6, 0.01);
    assert_eq!(seen(&stage.take_shots(usize::MAX)), [[], []]);
}

#[test]
fn a_busy_camera_ignores_its_trigger_and_numbers_on() {
    let mut stage = stage();
    assert!(pulse(&mut stage, Line::Cam, 0.0, 0.01)[0].is_some());
    assert_eq!(pulse(&mut stage, Line::Cam, 0.02, 0.01), [None, None]);
    assert!(pulse(&mut stage, Line::Cam, 0.0361, 0.01)[0].is_some());
    let ids: Vec<u64> = stage.take_shots(usize::MAX).iter().map(|shot| shot.id).collect();
    assert_eq!(ids, [0, 1]);
}

#[test]
fn chance_is_the_same_for_the_same_patterns_and_another_for_a_repetition() {
    let seeds = |stage: &mut Stage| -> Vec<u64> {
        for shot in 0..3 {
            pulse(stage, Line::Cam, 0.1 * f64::from(shot), 0.01);
        }
        stage
            .take_shots(usize::MAX)
            .iter()
            .map(|shot| shot.seed)
            .collect()
    };
    let (mut first, mut second) = (stage(), stage());
    let drawn = seeds(&mut first);
    assert_eq!(drawn, seeds(&mut second));
    first.busy_until = Ticks::ZERO;
    first.arm_camera();
    assert!(seeds(&mut first).iter().all(|seed| !drawn.contains(seed)));
}

#[test]
fn images_do_not_know_when_their_run_began() {
    // An exposure of an odd number of ticks over two patterns, with a third of the triggers missed.
    let shots = |start: u64| {
        let mut stage = stage();
        stage.behaviour.faults.missed_triggers = 0.3;
        let mut shots = Vec::new();
        for step in 0..12 {
            let at = |offset: u64| Ticks(start + step * 11_574_999 + offset);
            let mut edge = |line, level, offset| stage.edge(line, level, at(offset));
            edge(Line::Proj, Level::Active, 0);
            edge(Line::Proj, Level::Inactive, 625);
            edge(Line::Cam, Level::Active, 3_999_997);
            edge(Line::Cam, Level::Inactive, 4_999_998);
        }
        for shot in stage.take_shots(usize::MAX) {
            let seen: Vec<_> = shot
                .seen
                .iter()
                .map(|(light, s)| (spots(&light.glow).to_vec(), s.to_bits()))
                .collect();
            shots.push((shot.id, shot.seed, shot.exposure_s.to_bits(), seen));
        }
        shots
    };
    let first = shots(0);
    assert!(first.len() < 12 && first.iter().any(|shot| shot.3.len() == 2));
    for start in [1, 7_654_321, 125_000_000_003, (1 << 50) + 1] {
        assert_eq!(shots(start), first, "from tick {start}");
    }
}

#[test]
fn a_rounded_schedule_never_meets_a_busy_camera() {
    let mut rig = Rig::load("rcg-1-16bit").unwrap();
    (rig.projector.settle_s, rig.camera.exposure_delay_s) = (0.0, 0.0);
    for n in 0..64 {
        // Half a tick each is the worst: 4 ns.
        let (readout_ns, exposure_ns) = (26_000_000 + n, 10_000_000 + n / 8);
        rig.camera.readout_s = f64::from(readout_ns) / 1e9;
        let timing = crate::plan::schedule::Timing::new(&rig, f64::from(exposure_ns) / 1e9).unwrap();
        let step = timing.step(CLOCK_HZ);
        let mut stage = Stage::new(&Truth::of(&rig), stage().behaviour, CLOCK_HZ);
        for start in [Ticks(3), Ticks(3) + step.period] {
            let opened = stage.edge(Line::Cam, Level::Active, start + step.cam.at);
            assert!(opened.is_some(), "{readout_ns} ns of read-out, {exposure_ns} ns");
            stage.edge(Line::Cam, Level::Inactive, start + step.cam.at + step.cam.width);
        }
    }
}

#[test]
fn the_lamp_drifts_by_the_hour_and_flickers_from_exposure_to_exposure() {
    let mut truth = Truth::of(&Rig::load("rcg-1-16bit").unwrap());
    truth.flaws.lamp = Lamp {
        change: 0.0,
        drift_per_h: -0.02,
        flicker: 0.003,
    };
    let levels = |lamp_h: f64| -> Vec<f64> {
        let behaviour = Behaviour {
            lamp_h,
            ..stage().behaviour
        };
        let mut stage = Stage::new(&truth, behaviour, CLOCK_HZ);
        stage.arm_camera();
        for index in 0..400 {
            let at = Ticks(u64::from(CLOCK_HZ) * index);
            stage.edge(Line::Cam, Level::Active, at);
            stage.edge(Line::Cam, Level::Inactive, at + Ticks(1000));
        }
        stage.take_shots(400).into_iter().map(|shot| shot.lamp).collect()
    };
    let moments = |levels: &[f64]| {
        let mean = levels.iter().sum::<f64>() / levels.len() as f64;
        let squares = levels.windows(2).map(|pair| (pair[1] - pair[0]).powi(2) / 2.0);
        (mean, (squares.sum::<f64>() / (levels.len() - 1) as f64).sqrt())
    };
    let ((early, flicker), (late, _)) = (moments(&levels(0.0)), moments(&levels(3.0)));
    assert!((late - early + 0.06).abs() < 0.003, "{early} {late}");
    assert!((flicker - 0.003).abs() < 0.0004, "{flicker}");
    assert_eq!(levels(0.5), levels(0.5));
}
