//! Times, brackets, and what cannot be fired.

use proptest::collection;
use proptest::option::of;
use proptest::prelude::*;
use rcg_firmware::pulse::WordFormat;
use rcg_protocol::Polarity;

use super::*;

const CLOCK_HZ: u32 = 125_000_000;

#[test]
fn times_have_units() {
    for (text, ticks) in [
        ("5us", 625),
        ("5 \u{b5}s", 625),
        ("33.3ms", 4_162_500),
        ("1s", 125_000_000),
        ("24 ns", 3),
        ("3ticks", 3),
        ("0us", 0),
        ("2e-3s", 250_000),
    ] {
        assert_eq!(
            text.parse::<Span>().unwrap().ticks(CLOCK_HZ),
            Ticks(ticks),
            "{text}"
        );
    }
    for text in [
        "5",
        "",
        "us",
        "-1us",
        "1.5ticks",
        "5 minutes",
        "nan s",
        "infs",
        "5us6",
        "1e999s",
    ] {
        let error = text.parse::<Span>().unwrap_err();
        assert!(error.starts_with("expected a time with its unit"), "{text}");
    }
    assert_eq!(
        "2s".parse::<Span>().unwrap().micros(CLOCK_HZ),
        Some(Micros(2_000_000))
    );
    assert_eq!("5000s".parse::<Span>().unwrap().micros(CLOCK_HZ), None);
}

/// What a Pico makes when it runs free.
const LIMITS: Limits = Limits {
    clock_hz: CLOCK_HZ,
    shortest: Ticks(3),
    longest_period: Ticks(15_000_000_000),
};

#[test]
fn a_bracket_is_one_step_for_each_exposure_and_the_rigs_own_unless_told() {
    let rig = Rig::load("rcg-1-16bit").unwrap();
    let own = Timing::new(&rig, rig.camera.exposure_s).unwrap().step(CLOCK_HZ);
    assert_eq!(Bracket::default().steps(&rig, LIMITS).unwrap(), [own]);
    let exposures = vec![Span::Seconds(0.002), Span::Ticks(7), Span::Ticks(0)];
    let bracket = Bracket {
        exposures: exposures.clone(),
        ..Bracket::default()
    };
    let steps = bracket.steps(&rig, LIMITS).unwrap();
    let widths: Vec<u64> = steps.iter().map(|step| step.cam.width.0).collect();
    assert_eq!(widths, [250_000, 7, 0]);
    assert!(
        steps[0].period > steps[1].period,
        "each as short as the rig allows"
    );
    let told = Bracket {
        exposures,
        cam_at: Some(Span::Ticks(100)),
        proj_width: Some(Span::Ticks(0)),
        period: Some(Span::Seconds(0.0021)),
    };
    for step in told.steps(&rig, LIMITS).unwrap() {
        assert_eq!((step.cam.at, step.period), (Ticks(100), Ticks(262_500)));
        assert!(step.proj.is_none());
    }
}

/// A time from ticks to minutes, or one that cannot be.
fn any_span() -> impl Strategy<Value = Span> {
    prop_oneof![
        (0_u64..40).prop_map(Span::Ticks),
        (-10.0..2.3_f64).prop_map(|exponent| Span::Seconds(10_f64.powf(exponent))),
    ]
}

proptest! {
    /// What is accepted is what was asked for, to the tick, and the engine makes it; what is refused, the engine could not
    /// make in any way, or it is no number of ticks, and the sentence has units.
    #[test]
    fn what_is_fired_is_what_was_asked_for_or_a_sentence(
        preset in 0..3_usize,
        exposures in collection::vec(any_span(), 0..3),
        [cam_at, proj_width, period] in [of(any_span()), of(any_span()), of(any_span())],
        paced in any::<bool>(),
    ) {
        let rig = Rig::load(crate::instrument::rig::PRESETS[preset]).unwrap();
        let (pace, shortest) = if paced {
            (Pace::EachOnSync, Ticks(5))
        } else {
            (Pace::FreeRunning, Ticks(3))
        };
        let limits = Limits { shortest, ..LIMITS };
        let bracket = Bracket { exposures, cam_at, proj_width, period };
        let exact = |span: Option<Span>, ticks: Ticks| span.is_none_or(|span| {
            (span.seconds(CLOCK_HZ) - ticks.0 as f64 / f64::from(CLOCK_HZ)).abs() < 4.001e-9
                && (span.seconds(CLOCK_HZ) > 0.0) == (ticks > Ticks::ZERO)
        });
        match bracket.steps(&rig, limits) {
            Ok(steps) => for (index, step) in steps.iter().enumerate() {
                let words = WordFormat::new(pace, Polarity::default()).encode(step, 0);
                prop_assert!(words.is_ok(), "{bracket:?} {step:?}: {words:?}");
                prop_assert!(exact(bracket.exposures.get(index).copied(), step.cam.width));
                prop_assert!(exact(cam_at, step.cam.at) && exact(proj_width, step.proj.width));
                prop_assert!(exact(period, step.period));
            },
            Err(error) => {
                let sentence = error.to_string();
                prop_assert!(sentence.contains("expected") && sentence.contains("found"), "{sentence}");
                let all = [cam_at, proj_width, period].into_iter().flatten().chain(bracket.exposures.iter().copied());
                if let Span::Seconds(longest) = all.clone().fold(Span::Seconds(0.0), |a, b| {
                    Span::Seconds(a.seconds(CLOCK_HZ).max(b.seconds(CLOCK_HZ)))
                }) {
                    let shortest = all.map(|span| span.seconds(CLOCK_HZ)).fold(f64::MAX, f64::min);
                    prop_assert!(
                        shortest < 1e-6 || longest > 60.0 || (period.is_some() || cam_at.is_some()),
                        "no reason to refuse {bracket:?}: {sentence}"
                    );
                }
            }
        }
    }
}

#[test]
fn refusals_name_the_pulse_and_by_how_much() {
    let rig = Rig::load("rcg-1-16bit").unwrap();
    let bracket = |exposure: &str, cam_at: &str, proj_width: &str, period: &str| {
        let span = |text: &str| (!text.is_empty()).then(|| text.parse().unwrap());
        Bracket {
            exposures: span(exposure).into_iter().collect(),
            cam_at: span(cam_at),
            proj_width: span(proj_width),
            period: span(period),
        }
        .steps(&rig, LIMITS)
    };
    // The rig settles for longer than this period; what was not given makes room.
    let steps = bracket("500us", "", "", "2ms").unwrap();
    assert_eq!(
        (steps[0].cam.at.0, steps[0].period.0),
        (250_000 - 62_500 - 3, 250_000)
    );
    for (refused, parts) in [
        (
            bracket("3ms", "", "", "2ms"),
            &["step 0", "CAM", "period of 2 ms", "lasts 3 ms", "1 ms too long"][..],
        ),
        (
            bracket("1ms", "1.5ms", "", "2ms"),
            &["CAM", "begins at 1.5 ms", "500 us too long"],
        ),
        (
            bracket("1us", "", "3ms", "2ms"),
            &["PROJ", "lasts 3 ms", "1 ms too long"],
        ),
        (
            bracket("3ns", "", "", ""),
            &["--exposure", "24 ns (3 ticks)", "found 3 ns", "0 ticks of 8 ns"],
        ),
        (bracket("1us", "3ns", "", ""), &["--cam-at", "found 3 ns"]),
        (bracket("1us", "", "0.1ns", ""), &["--proj-width", "found 0.1 ns"]),
        (bracket("1us", "", "", "1ns"), &["--period", "found 1 ns"]),
        (
            bracket("10ns", "", "", ""),
            &[
                "the leading edge of CAM",
                "the trailing edge of CAM",
                "found 8 ns (1 ticks)",
            ],
        ),
        (
            bracket("", "", "", "121s"),
            &["a period of", "120 s", "found 121 s"],
        ),
        (
            bracket("61s", "", "", ""),
            &["exposure time in ms", "60000", "found 61000"],
        ),
    ] {
        let sentence = refused.unwrap_err().to_string();
        for part in parts {
            assert!(sentence.contains(part), "{part}: {sentence}");
        }
    }
}
