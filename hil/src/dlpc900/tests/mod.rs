//! The host's driver against the emulated unit, and the unit against what no driver may do (`scripts`).

mod scripts;

use rand::{RngExt as _, SeedableRng as _};
use rand_xoshiro::Xoshiro256PlusPlus;
use rcg::capture::dlpc900::image::Planes;
use rcg::capture::dlpc900::packet::Commands;
use rcg::capture::dlpc900::unit::{Play, Unit};
use rcg::capture::dlpc900::{Dlpc900Projector, video};
use rcg::capture::projector::Projector as _;
use rcg::hemisphere::incident::Grid;
use rcg::instrument::drivers;
use rcg::instrument::optics::View;
use rcg::instrument::rig::Rig;
use rcg::plan::pattern::{BitPattern, PatternMaker};
use rcg::plan::schedule::Timing;
use rcg::plan::{Directions, Exposure, Plan, Request};

use super::{Dlpc900, Nature, pixels};

/// A unit with such mirrors.
fn unit(mirrors: u8) -> Dlpc900 {
    Dlpc900::new(Nature {
        mirrors,
        ..Nature::default()
    })
}

/// The driver of `unit`, which has lights in primaries.
fn driver(unit: &Dlpc900) -> Dlpc900Projector {
    let settings = drivers::Dlpc900 {
        primaries: true,
        ..drivers::Dlpc900::default()
    };
    Dlpc900Projector::over("mock", unit.reports(), &settings, 0.0).unwrap()
}

/// What the driver says of a unit that it cannot open.
fn refusal(nature: Nature) -> String {
    let settings = drivers::Dlpc900::default();
    let opened = Dlpc900Projector::over("mock", Dlpc900::new(nature).reports(), &settings, 0.0);
    opened.err().expect("it is refused").to_string()
}

/// A pattern with a rectangle, some pixels, and one row that is nowhere else.
fn drawn((width, height): (usize, usize), rng: &mut Xoshiro256PlusPlus) -> BitPattern {
    let mut pattern = BitPattern::black(width, height);
    let (left, top) = (rng.random_range(0..width), rng.random_range(0..height));
    let (wide, high) = (
        rng.random_range(1..=width - left),
        rng.random_range(1..=height - top).min(40),
    );
    let mut lit: Vec<u32> = (top..top + high)
        .flat_map(|y| (left..left + wide).map(move |x| (y * width + x) as u32))
        .collect();
    lit.extend((0..200).map(|_| rng.random_range(0..(width * height) as u32)));
    let row = rng.random_range(0..height) * width;
    lit.extend(
        (row..row + width)
            .filter(|_| rng.random_bool(0.5))
            .map(|pixel| pixel as u32),
    );
    pattern.light(&lit);
    pattern
}

/// What a pattern is as light: nothing of it where its level is 0.
fn light(pattern: &BitPattern) -> (Vec<u32>, u8, Option<u8>) {
    let lit = if pattern.level() == 0 {
        Vec::new()
    } else {
        pattern.lit()
    };
    if lit.is_empty() {
        (lit, u8::MAX, None)
    } else {
        (lit, pattern.level(), pattern.primary())
    }
}

/// Steps in which each of so many patterns is exposed once.
fn steps(count: usize, exposure_s: f64, period_s: f64) -> Vec<Timing> {
    let step = Timing {
        proj_width_s: 5e-6,
        cam_at_s: 200e-6,
        cam_width_s: exposure_s,
        period_s,
    };
    vec![step; count]
}

#[test]
fn what_is_packed_is_unpacked_whatever_is_drawn() {
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(3);
    for draw in 0..200 {
        let size = (rng.random_range(1..400), rng.random_range(1..12));
        let (depth, most) = if draw % 3 == 0 { (8, 3) } else { (1, 24) };
        let density: f64 = rng.random();
        let patterns: Vec<BitPattern> = (0..rng.random_range(1..=most))
            .map(|_| {
                let mut pattern = BitPattern::black(size.0, size.1);
                let stays = rng.random_bool(0.5);
                let lit = (0..size.0 * size.1).filter(|pixel| {
                    let row_alone = if stays { pixel % size.0 } else { *pixel };
                    (row_alone as f64 * 0.618_034).fract() < density.powi(4)
                        || rng.random_bool(density.powi(6))
                });
                pattern.light(&lit.map(|pixel| pixel as u32).collect::<Vec<_>>());
                pattern.set_level(if depth == 8 { rng.random() } else { 255 });
                pattern
            })
            .collect();
        let planes = Planes::of(&patterns, depth);
        let from = rng.random_range(0..size.0);
        let to = rng.random_range(from + 1..=size.0);
        let image = pixels::image(&planes.upload((from, to))).expect("an image");
        assert_eq!(image.size, (to - from, size.1), "{draw}");
        let mut row = vec![0; to - from];
        for y in 0..size.1 {
            planes.row(y, from, &mut row);
            assert_eq!(image.pixels[y * row.len()..][..row.len()], row, "{draw}, row {y}");
        }
    }
}

#[test]
fn after_each_trigger_the_pattern_is_that_which_was_loaded() {
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(5);
    // Mirrors, how many patterns, whether some are grey: one controller and two, one image and several, full ones and not.
    for (mirrors, count, is_grey) in [(5, 1, false), (5, 25, false), (5, 4, true), (4, 3, false)] {
        let unit = unit(mirrors);
        let mut projector = driver(&unit);
        // What was there before is gone.
        for round in 0..2 {
            let patterns: Vec<BitPattern> = (0..count - round.min(count - 1))
                .map(|number| {
                    let mut pattern = drawn(projector.size_px(), &mut rng);
                    if is_grey {
                        pattern.set_level((number * 17) as u8);
                    }
                    pattern.set_primary([None, Some(0), Some(1), Some(2)][rng.random_range(0..4)]);
                    pattern
                })
                .collect();
            projector.clear().unwrap();
            for pattern in &patterns {
                projector.load(pattern).unwrap();
            }
            projector.pace(&steps(patterns.len(), 5e-3, 6e-3)).unwrap();
            projector.ready().unwrap();
            assert_eq!(unit.after(0), None);
            let sequence = unit.sequence().unwrap();
            assert_eq!(sequence.len(), patterns.len());
            for (number, pattern) in patterns.iter().enumerate() {
                let shown = &sequence[number];
                assert_eq!(light(&shown.pattern), light(pattern), "{mirrors} {number}");
                let grey = is_grey && patterns.iter().any(|pattern| !matches!(pattern.level(), 0 | 255));
                // As long as the camera looks.
                let expected = if grey { (5000, 200) } else { (5095, 105) };
                assert_eq!((shown.exposure_us, shown.delay_us), expected);
                assert!(shown.waits && shown.holds != grey, "{number}");
            }
            assert_eq!(
                unit.after(count * 3),
                unit.after((count * 3 - 1) % patterns.len() + 1)
            );
            assert_eq!(unit.complaints(), [""; 0]);
        }
    }
}

#[test]
fn what_a_plan_says_is_what_is_shown() {
    for (preset, mirrors, step_deg, light) in [
        ("dmd", 5, 45.0, "multiplexed:3"),
        ("rcg-1-16bit", 5, 45.0, "complement:2"),
        ("rcg-3", 1, 45.0, "single"),
    ] {
        let mut rig = Rig::load(preset).unwrap();
        rig.projector.settle_s = rig.projector.settle_s.max(105e-6);
        rig.projector.min_period_s = rig.projector.min_period_s.max(210e-6);
        let grid = Grid::ThetaPhi { step_deg };
        let request = Request {
            grid: grid.clone(),
            light: light.parse().unwrap(),
            ..Request::default()
        };
        let plan = Plan::new(request, &rig, rig.camera.exposure_s).unwrap();
        let directions = Directions::new(&rig, &grid).unwrap();
        let maker = PatternMaker::new(View::projector(&rig), plan.spot_deg, 1.0);
        let measurable: Vec<usize> = directions.measurable().collect();
        let codes = plan.code_patterns();
        let unit = unit(mirrors);
        let mut projector = driver(&unit);
        projector.clear().unwrap();
        let mut expected = Vec::new();
        for exposure in plan.patterns(&directions) {
            let cells: Vec<usize> = match exposure {
                Exposure::Incident(index) => vec![index],
                Exposure::Coded(number) => codes
                    .iter()
                    .flat_map(|codes| codes.lit(number))
                    .map(|cell| measurable[cell])
                    .collect(),
                _ => Vec::new(),
            };
            let mut pattern = BitPattern::black(projector.size_px().0, projector.size_px().1);
            for index in cells {
                if let Ok(lit) = maker.lit_set(directions.grid.direction(index)) {
                    pattern.light(&lit.pixels);
                }
            }
            projector.load(&pattern).unwrap();
            expected.push(pattern);
        }
        projector.pace(&vec![plan.timings()[0]; expected.len()]).unwrap();
        projector.ready().unwrap();
        assert!(expected.len() > 10, "{preset}");
        // Unpacking takes long: of every image some planes.
        for (number, pattern) in expected.iter().enumerate().step_by(5) {
            assert_eq!(
                unit.after(number + 1).as_ref(),
                Some(pattern),
                "{preset} {number}"
            );
        }
        assert_eq!(unit.complaints(), [""; 0]);
    }
}

#[test]
fn a_unit_that_hangs_is_stopped_set_to_another_mode_and_back_once() {
    for nature in [
        // Nothing is answered at first, an answer comes late, the sequencer was aborted.
        Nature {
            silent: 1,
            ..Nature::default()
        },
        Nature {
            late: 4,
            ..Nature::default()
        },
        Nature {
            late: 11,
            ..Nature::default()
        },
        Nature {
            aborted: 1,
            ..Nature::default()
        },
    ] {
        let mirrors = Nature {
            mirrors: 5,
            ..nature.clone()
        };
        let unit = Dlpc900::new(mirrors);
        let mut projector = driver(&unit);
        let mut pattern = BitPattern::black(1024, 768);
        pattern.light(&[17]);
        projector.clear().unwrap();
        projector.load(&pattern).unwrap();
        projector.ready().unwrap();
        assert_eq!(unit.after(1).as_ref(), Some(&pattern), "{nature:?}");
    }
}

#[test]
fn a_unit_that_is_of_no_use_is_refused_by_name() {
    for (nature, expected) in [
        (
            Nature {
                aborted: 200,
                ..Nature::default()
            },
            "found the sequencer was aborted, after it was stopped",
        ),
        (
            Nature {
                silent: 99,
                ..Nature::default()
            },
            "expected an answer to command 0205 within 2 s, found none, after",
        ),
        (
            Nature {
                refuses: Some((0x0206, 2)),
                ..Nature::default()
            },
            "found error 2: device failure, after",
        ),
        (
            Nature {
                firmware: (2, 0, 0),
                ..Nature::default()
            },
            "expected firmware 3 to 6, whose commands this driver knows, found 2.0.0",
        ),
        (
            Nature {
                mirrors: 9,
                ..Nature::default()
            },
            "found mirrors of code 9",
        ),
    ] {
        let said = refusal(nature);
        assert!(
            said.starts_with("projector mock: ") && said.contains(expected),
            "{said}"
        );
    }
    // It begins well, and fails later.
    let unit = Dlpc900::new(Nature {
        refuses: Some((0x1A34, 14)),
        ..Nature::default()
    });
    let mut projector = driver(&unit);
    projector.load(&BitPattern::black(1920, 1080)).unwrap();
    let said = projector.ready().unwrap_err().to_string();
    assert!(
        said.contains("command 1A34 to be done, found error 14: exposure time out of range"),
        "{said}"
    );
}

#[test]
fn what_it_cannot_show_is_refused_in_a_sentence() {
    let unit = unit(5);
    let mut projector = driver(&unit);
    let size = projector.size_px();
    let said = projector
        .load(&BitPattern::black(1920, 1080))
        .unwrap_err()
        .to_string();
    assert!(
        said.contains("expected a pattern of 1024×768 pixels, found 1920×1080"),
        "{said}"
    );
    let plain = drivers::Dlpc900::default();
    let mut white = Dlpc900Projector::over("mock", unit.reports(), &plain, 0.0).unwrap();
    let mut red = BitPattern::black(size.0, size.1);
    red.set_primary(Some(0));
    let said = white.load(&red).unwrap_err().to_string();
    assert!(
        said.contains("found one in a primary") && said.contains("`primaries = true`"),
        "{said}"
    );

    let mut grey = BitPattern::black(size.0, size.1);
    grey.light(&[5]);
    grey.set_level(90);
    for _ in 0..54 {
        projector.load(&grey).unwrap();
    }
    let said = projector.load(&grey).unwrap_err().to_string();
    assert!(said.contains("expected at most 54 patterns at a time"), "{said}");
    for (steps, expected) in [
        (
            steps(54, 4e-3, 9e-3),
            "expected exposures of 4046 µs or more for levels of grey",
        ),
        (
            steps(54, 5e-3, 5.2e-3),
            "expected 5305 µs from trigger to trigger for levels of grey, found 5200 µs",
        ),
        (
            [steps(53, 5e-3, 9e-3), steps(1, 6e-3, 9e-3)].concat(),
            "found several",
        ),
    ] {
        let said = projector.pace(&steps).unwrap_err().to_string();
        assert!(said.contains(expected), "{said}");
    }
}

#[test]
fn exposures_without_the_whole_pattern_are_refused() {
    let (unit, plain) = (unit(5), drivers::Dlpc900::default());
    let mut let_go = drivers::Dlpc900 {
        hold: false,
        exposure_us: Some(1000),
        ..plain
    };
    for (late, steps, expected) in [
        (
            0.0,
            steps(3, 80e-6, 205e-6),
            Some("that the next trigger comes after 205 µs"),
        ),
        (
            -100e-6,
            steps(3, 80e-6, 1e-2),
            Some("looks 100 µs after the trigger, before"),
        ),
        (0.0, steps(3, 80e-6, 1e-2), None),
        (0.0, steps(3, 950e-6, 1e-2), None),
    ] {
        let mut projector = Dlpc900Projector::over("mock", unit.reports(), &plain_of(&let_go), late).unwrap();
        let said = projector.pace(&steps).err().map(|error| error.to_string());
        assert_eq!(said.is_some(), expected.is_some(), "{said:?}");
        assert!(
            said.iter().all(|said| said.contains(expected.unwrap())),
            "{said:?}"
        );
    }
    let mut projector = Dlpc900Projector::over("mock", unit.reports(), &let_go, 0.0).unwrap();
    let said = projector.pace(&steps(3, 950e-6, 1e-2)).unwrap_err().to_string();
    assert!(
        said.contains("looks until 1150 µs, when the pattern has gone (1105 µs): hold it"),
        "{said}"
    );
    let_go.exposure_us = None;
    let mut projector = Dlpc900Projector::over("mock", unit.reports(), &let_go, 0.0).unwrap();
    projector.pace(&steps(3, 950e-6, 1e-2)).unwrap();
}

/// These settings, with patterns that are held for as long as they take.
fn plain_of(settings: &drivers::Dlpc900) -> drivers::Dlpc900 {
    drivers::Dlpc900 {
        hold: true,
        exposure_us: Some(105),
        ..settings.clone()
    }
}

#[test]
fn planes_of_video_frames_want_a_source() {
    let start = |has_source| {
        let unit = Dlpc900::new(Nature {
            has_source,
            ..Nature::default()
        });
        let started = video::start(&mut Unit::new(Commands::new(unit.reports())), 24, 60.0);
        (started.map_err(|error| error.to_string()), unit)
    };
    let (started, unit) = start(true);
    assert_eq!(started.unwrap().exposure_us, 684);
    assert_eq!(unit.complaints(), [""; 0]);
    assert_eq!(unit.heard().last(), Some(&0x1A24));
    let (refused, _) = start(false);
    assert!(
        refused
            .unwrap_err()
            .contains("expected a locked source at the video port")
    );
    let unit = Dlpc900::new(Nature::default());
    Unit::new(Commands::new(unit.reports()))
        .play(Play::Start)
        .unwrap_err();
}

#[test]
fn over_tcp_it_is_the_same_unit() {
    let unit = unit(5);
    let served = unit.serve().unwrap();
    let settings = drivers::Dlpc900 {
        device: Some(served.device()),
        ..drivers::Dlpc900::default()
    };
    let mut pattern = BitPattern::black(1024, 768);
    pattern.light(&[1, 2, 700_000]);
    for _ in 0..2 {
        let mut projector = Dlpc900Projector::open(&settings, 0.0).unwrap();
        projector.load(&pattern).unwrap();
        projector.ready().unwrap();
        assert_eq!(unit.after(1).as_ref(), Some(&pattern));
        assert!(projector.name().starts_with("DLP5500 at tcp:127.0.0.1:"));
    }
    drop(served);
    let error = Dlpc900Projector::open(&settings, 0.0)
        .err()
        .expect("nobody is there")
        .to_string();
    assert!(
        error.contains("expected a unit's reports at a host and a port"),
        "{error}"
    );
}
