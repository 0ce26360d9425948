//! `controller` with the simulated trigger box.

use std::path::Path;

use serde_json::Value;

use crate::answers::number;
use crate::command::{refuses, run, text};

pub(crate) fn controller(arguments: &[&str]) -> Value {
    run(
        &[&["controller", "--port", "sim", "--json"], arguments].concat(),
        "",
    )
    .object()
}

#[test]
fn info_tells_what_it_is() {
    let info = controller(&["info"]);
    assert_eq!(
        number(&info, "protocol"),
        f64::from(rcg_protocol::PROTOCOL_VERSION)
    );
    let clock_hz = number(&info, "clock_hz");
    assert!((number(&info, "tick_ns") * clock_hz / 1e9 - 1.0).abs() < 1e-12);
    for limit in [
        "max_steps",
        "max_words",
        "shortest_pulse_ticks",
        "shortest_pulse_with_sync_ticks",
    ] {
        assert!(number(&info, limit) > 0.0, "{limit}");
    }
    assert!(number(&info, "longest_period_s") > 1.0);
    assert_eq!(info["firmware"].as_str().unwrap().split('.').count(), 3);
    assert!(info["port"].is_string());
    assert_eq!(info["chip"], "simulated");
    assert!(info["serial"].is_null(), "it has none");
    assert!(info["stored"].is_null(), "it keeps none unless it is asked to");
}

#[test]
fn a_schedule_is_kept_as_it_was_asked_for() {
    let kept = controller(&[
        "store",
        "--steps",
        "6",
        "--exposure",
        "1ms,4ms",
        "--start-on-line",
    ]);
    assert_eq!(number(&kept, "stored.steps"), 6.0);
    assert!(
        kept["stored"]["begins"] == "on an edge of START" && kept["stored"]["runs"].is_null(),
        "{kept}"
    );
    let kept = controller(&["store", "--steps", "4", "--repeat", "3", "--rig", "dmd"]);
    assert!(
        kept["stored"]["begins"] == "at once" && number(&kept, "stored.runs") > 2.9,
        "{kept}"
    );
    assert!(controller(&["forget"])["stored"].is_null());
    for (words, parts) in [
        (&["--exposure", "1ns"][..], &["--exposure", "24 ns"][..]),
        (
            &["--steps", "3", "--exposure", "1ms,2ms"],
            &["--steps", "multiple of 2"],
        ),
        (&["--stream"], &["--stream"]),
        (&["--dead-man", "1s"], &["--dead-man"]),
        (&["--repeat", "0"], &["--repeat"]),
    ] {
        refuses(
            &[&["controller", "store", "--port", "sim"], words].concat(),
            "",
            2,
            parts,
        );
    }
}

#[test]
fn a_box_that_was_just_switched_on_is_idle_whatever_is_ended() {
    for action in ["status", "abort"] {
        let status = controller(&[action]);
        assert_eq!(number(&status, "steps_done"), 0.0, "{action}");
        assert_eq!(status["fault"], Value::Null, "{action}");
        assert_eq!(number(&status, "counters.corrupt"), 0.0);
        assert!(number(&status, "counters.executed") >= 1.0);
        assert!(status["state"].is_string());
    }
}

#[test]
fn run_fires_every_step_in_the_papers_time() {
    let done = controller(&["run", "--steps", "1000"]);
    for count in ["steps_done", "records", "strobes"] {
        assert_eq!(number(&done, count), 1000.0, "{count}");
    }
    assert_eq!(done["state"], "done");
    assert_eq!(done["fault"], Value::Null);
    let clock_hz = number(&controller(&["info"]), "clock_hz");
    let period_s = number(&done, "period_ticks") / clock_hz;
    assert!((period_s - 0.0926).abs() < 5e-5, "{period_s}");
    assert!(
        (number(&done, "duration_s") / (1000.0 * period_s) - 1.0).abs() < 1e-3,
        "{done}"
    );

    let fast = controller(&["run", "--steps", "5000", "--rig", "dmd"]);
    assert_eq!(number(&fast, "steps_done"), 5000.0);
    assert!((number(&fast, "period_ticks") / clock_hz - 105e-6).abs() < 1e-7);
}

#[test]
fn bench_counts_its_round_trips() {
    let bench = controller(&["bench", "--count", "200"]);
    assert_eq!(number(&bench, "round_trips"), 200.0);
    assert_eq!(number(&bench, "streamed_steps"), 4096.0);
    for figure in ["per_s", "mean_us", "slowest_us", "streamed_steps_per_s"] {
        assert!(number(&bench, figure) > 0.0, "{figure}");
    }
}

#[test]
fn one_output_is_pulsed_or_held_by_itself() {
    // The camera of the rig is busy for 26 ms after an exposure.
    let five = ["--count", "5", "--width", "2ms", "--period", "100ms"];
    let pulsed = controller(&[&["pulse", "cam"][..], &five].concat());
    assert_eq!(pulsed["line"], "CAM");
    assert_eq!(number(&pulsed, "pulses"), 5.0);
    assert_eq!(number(&pulsed, "strobe.pulses"), 5.0);
    for [least, most] in [("delay_us", 0.0), ("width_us", 2000.0)].map(|(name, about)| {
        let range: Vec<f64> = serde_json::from_value(pulsed["strobe"][name].clone()).unwrap();
        [range[0] - about, range[1] - about]
    }) {
        assert!(least <= most && (-50.0..200.0).contains(&least), "{pulsed}");
    }
    assert!(
        (number(&pulsed, "period_s") - 0.1).abs() < 1e-9 && (number(&pulsed, "width_s") - 2e-3).abs() < 1e-9
    );
    // Nothing exposes where PROJ alone is pulsed.
    let shown = controller(&["pulse", "proj", "--width", "5us"]);
    assert!(
        shown["strobe"].is_null() && number(&shown, "period_s") < 1.1e-5,
        "{shown}"
    );
    for (line, level, rest) in [
        ("cam", "high", &[][..]),
        ("proj", "low", &["--active-low"]),
        ("cam", "low", &[]),
    ] {
        let held = controller(&[&["hold", line, level, "--for", "20s"][..], rest].concat());
        assert!(
            (number(&held, "held_s") - 20.0).abs() < 1e-9 && held["level"] == level,
            "{held}"
        );
    }
    for (words, parts) in [
        (&["pulse", "cam", "--width", "0s"][..], &["--width", "0 s"][..]),
        (&["pulse", "cam", "--width", "1ns"], &["--width", "0 ticks"]),
        (
            &["pulse", "proj", "--width", "2ms", "--period", "1ms"],
            &["PROJ", "end within the period"],
        ),
        (
            &["pulse", "proj", "--width", "200s"],
            &["period of", "found 400 s"],
        ),
        (&["pulse", "strobe"], &["`strobe`"]),
        (&["pulse", "cam", "--count", "0"], &["--count", "`0`"]),
        (&["hold", "cam", "high", "--for", "0s"], &["--for", "0 s"]),
        (&["hold", "cam", "up"], &["`up`"]),
    ] {
        refuses(
            &[&["controller", "--port", "sim"][..], words].concat(),
            "",
            2,
            &[&["expected", "found"][..], parts].concat(),
        );
    }
}

#[test]
fn every_action_has_words_too() {
    for action in ["info", "status", "run", "abort", "bench"] {
        let outcome = run(&["controller", action, "--port", "sim"], "");
        assert!(
            !outcome.done().is_empty() && outcome.stderr.is_empty(),
            "{action}: {outcome:?}"
        );
    }
}

#[test]
fn what_cannot_be_fired_is_refused() {
    for (name, value) in [
        ("--steps", "0"),
        ("--exposure", "-1ms"),
        ("--exposure", "nan s"),
        ("--exposure", "5"),
        ("--exposure", "1ms,2"),
        ("--exposure", "1e9ms"),
        ("--dead-man", "2h"),
        ("--sync-timeout", "5000s"),
        ("--strobe-filter", "2ms"),
        ("--strobe-filter", "-1us"),
    ] {
        let arguments = ["controller", "run", "--port", "sim", name, value];
        refuses(&arguments, "", 2, &["expected", "found"]);
    }
    refuses(
        &["controller", "bench", "--count", "0"],
        "",
        2,
        &["--count", "expected", "found `0`"],
    );
    let three_in_ten = ["--steps", "10", "--exposure", "1ms,2ms,3ms"];
    refuses(
        &[&["controller", "run", "--port", "sim"], &three_in_ten[..]].concat(),
        "",
        2,
        &["--steps", "expected a multiple of 3", "found 10"],
    );
}

/// Exposures that are shorter than what counts as one are none; the filter of one run is not that of the next.
#[test]
fn what_strobe_does_for_too_short_a_time_is_left_out() {
    let exposures = ["run", "--steps", "10", "--cam-at", "1s", "--exposure", "500us"];
    for (filter, strobes) in [
        (&["--strobe-filter", "600us"][..], 0.0),
        (&["--strobe-filter", "400us"], 10.0),
        (&[], 10.0),
    ] {
        let done = controller(&[&exposures[..], filter].concat());
        assert_eq!(number(&done, "records"), 10.0);
        assert_eq!(number(&done, "strobes"), strobes, "{filter:?}");
    }
}

/// Trigger, strobe's delay and width of each step, in ticks, from a file of records.
fn records(path: &Path) -> Vec<[u64; 3]> {
    let text = std::fs::read_to_string(path).unwrap();
    let mut lines = text.lines();
    let header = "step,trigger_ticks,strobe_delay_ticks,strobe_width_ticks,flags";
    assert_eq!(lines.next(), Some(header));
    lines
        .enumerate()
        .map(|(step, line)| {
            let mut cells = line.split(',');
            let mut ticks = || cells.next().unwrap().parse().unwrap();
            assert_eq!(ticks(), step as u64);
            [ticks(), ticks(), ticks()]
        })
        .collect()
}

#[test]
fn a_bracket_is_fired_as_a_table_or_as_a_stream_and_recorded_step_by_step() {
    let scratch = tempfile::tempdir().unwrap();
    let fire = |name: &str, more: &[&str]| {
        let file = scratch.path().join(name);
        let bracket = [
            "run",
            "--steps",
            "6000",
            "--exposure",
            "2ms,1250ticks",
            "--period",
            "70ms",
        ];
        let done = controller(&[&bracket, more, &["--records", text(&file)]].concat());
        for count in ["steps_done", "records", "strobes"] {
            assert_eq!(number(&done, count), 6000.0, "{count} {more:?}");
        }
        assert_eq!(done["flags"], serde_json::json!({}), "{more:?}");
        records(&file)
    };
    let table = fire("table.csv", &[]);
    assert_eq!(table.len(), 6000);
    // RCG-1 settles for 33.3 ms; its camera is 5 µs late.
    for (step, record) in (0..).zip(&table) {
        let width = if step % 2 == 0 { 250_000 } else { 1250 };
        assert_eq!(*record, [4_162_500 + step * 8_750_000, 625, width], "step {step}");
    }
    assert_eq!(fire("stream.csv", &["--stream"]), table);
    let rest_high = ["--active-low", "proj,cam,sync,strobe", "--start-on-sync"];
    assert_eq!(fire("low.csv", &rest_high), table);
    // A SYNC of 60 Hz: 70 ms are more than four of its periods, so each step begins five after the one before.
    let paced = fire("paced.csv", &["--each-on-sync", "--sync-timeout", "1s"]);
    let sync_s = rcg::instrument::rig::Rig::load("rcg-1-16bit")
        .unwrap()
        .projector
        .min_period_s;
    let sync = (sync_s * 125e6).round() as u64;
    let between = 8_750_000_u64.div_ceil(sync) * sync;
    assert!(paced.windows(2).all(|pair| pair[1][0] - pair[0][0] == between));
}

#[test]
fn a_run_that_ends_with_a_fault_says_how_far_it_came_in_one_object() {
    // The projector of RCG-1 has its vsync every 16.7 ms.
    let arguments = [
        "controller",
        "run",
        "--port",
        "sim",
        "--each-on-sync",
        "--sync-timeout",
        "1ms",
    ];
    let reason = "no SYNC edge came";
    run(&arguments, "").complains(1, &["sim", "expected 100 steps", reason]);
    let outcome = run(&[&arguments[..], &["--json"]].concat(), "");
    outcome.complains(1, &[reason]);
    let object: Value = serde_json::from_str(&outcome.stdout).expect("stdout is one JSON value");
    assert_eq!(
        (&object["state"], &object["exit"]),
        (&Value::from("fault"), &Value::from(1))
    );
    assert!(object["error"].as_str().unwrap().contains(reason), "{object}");
    assert!(number(&object, "steps_done") < 100.0);
}

#[test]
fn steps_longer_than_the_dead_man_time_are_waited_for() {
    for long in [
        &["--exposure", "2s"][..],
        &["--exposure", "60s", "--stream"],
        &["--exposure", "1ms,59s", "--each-on-sync"],
        &["--exposure", "3s", "--dead-man", "20ms", "--start-on-sync"],
    ] {
        let done = controller(&[&["run", "--steps", "2"], long].concat());
        assert_eq!(number(&done, "strobes"), 2.0, "{long:?}");
        assert_eq!(done["state"], "done", "{long:?}");
    }
}

#[test]
fn times_that_round_to_nothing_or_do_not_fit_are_refused_by_name() {
    for (arguments, parts) in [
        (
            &["--exposure", "3ns"][..],
            &["--exposure", "24 ns (3 ticks)", "found 3 ns"][..],
        ),
        (
            &["--exposure", "8ns"],
            &["leading edge of CAM", "trailing edge of CAM", "(1 ticks)"],
        ),
        (&["--cam-at", "1ns"], &["--cam-at", "found 1 ns"]),
        (&["--proj-width", "3.9ns"], &["--proj-width", "found 3.9 ns"]),
        (&["--period", "1ns"], &["--period", "found 1 ns"]),
        (
            &["--sync-timeout", "400ns"],
            &["--sync-timeout", "0.001 ms", "found 400 ns"],
        ),
        (&["--strobe-filter", "1ns"], &["--strobe-filter", "found 1 ns"]),
        (&["--dead-man", "1ms"], &["--dead-man", "20 ms", "found 0.001 s"]),
        (
            &["--exposure", "3ms", "--period", "2ms"],
            &["step 0", "CAM pulse", "period of 2 ms", "1 ms too long"],
        ),
        (
            &["--exposure", "1us,3ms", "--cam-at", "1ms", "--period", "2ms"],
            &[
                "step 1",
                "CAM pulse",
                "begins at 1 ms and lasts 3 ms",
                "2 ms too long",
            ],
        ),
        (
            &["--period", "2ms", "--proj-width", "1s"],
            &["PROJ pulse", "998 ms too long"],
        ),
        (&["--period", "121s"], &["step 0", "120 s", "found 121 s"]),
    ] {
        let all = [&["controller", "run", "--port", "sim"], arguments].concat();
        refuses(&all, "", 2, &[&["expected", "found"], parts].concat());
    }
    // What was not given makes room for what was.
    let done = controller(&["run", "--steps", "10", "--period", "2ms", "--exposure", "500us"]);
    assert_eq!(number(&done, "records"), 10.0);
    // The camera still reads out the first frame at the other nine triggers.
    assert_eq!(number(&done, "strobes"), 1.0);
    assert_eq!(number(&done, "period_ticks"), 250_000.0);
    let done = controller(&["run", "--steps", "10", "--cam-at", "1s"]);
    assert_eq!(number(&done, "strobes"), 10.0);
}

#[test]
fn probe_and_selftest_tell_what_stands_at_the_inputs() {
    let probed = controller(&["probe", "--for", "100ms", "--every", "50ms"]);
    // A vsync at 60 Hz has two edges; CAM rests, and with it STROBE.
    assert!(
        (number(&probed, "SYNC.edges_per_s") - 120.0).abs() <= 20.0,
        "{probed}"
    );
    assert_eq!(number(&probed, "STROBE.edges"), 0.0);
    assert_eq!(probed["looks"].as_array().unwrap().len(), 2);
    let lines = run(
        &[
            "controller",
            "probe",
            "--port",
            "sim",
            "--for",
            "30ms",
            "--every",
            "10ms",
        ],
        "",
    );
    assert_eq!(lines.done().lines().count(), 3);

    let tested = controller(&["selftest", "--count", "2"]);
    assert_eq!(tested["findings"], serde_json::json!([]));
    assert_eq!(
        (
            &tested["STROBE"]["at_rest"],
            number(&tested, "STROBE.CAM.answered")
        ),
        (&"low".into(), 2.0)
    );
    assert_eq!(number(&tested, "STROBE.PROJ.answered"), 0.0);
    let widths: Vec<f64> = serde_json::from_value(tested["STROBE"]["CAM"]["width_us"].clone()).unwrap();
    assert_eq!(widths, [1000.0, 2000.0]);
    // The simulated camera's line rests low.
    let inverted = [
        "controller",
        "selftest",
        "--port",
        "sim",
        "--count",
        "2",
        "--active-low",
        "strobe",
    ];
    let outcome = run(&inverted, "");
    outcome.complains(
        1,
        &["port sim", "STROBE is inverted: it rests low and pulses high"],
    );
    for (words, parts) in [
        (
            &["selftest", "--width", "7ticks"][..],
            &["--width", "at least 8 ticks"][..],
        ),
        (&["selftest", "--width", "30ms"], &["50 ms"]),
        (&["probe", "--for", "1ms"], &["--for", "from 0.01 s"]),
        (&["probe", "--every", "1ms"], &["--every", "from 0.01 s"]),
        (&["update"], &["--file", "RCG_UF2"]),
        (
            &["update", "--file", "no.uf2"],
            &["no.uf2", "expected a UF2 file"],
        ),
        (
            &["update", "--file", "Cargo.toml"],
            &["Cargo.toml", "whole blocks of 512 bytes"],
        ),
    ] {
        refuses(&[&["controller", "--port", "sim"], words].concat(), "", 2, parts);
    }
}
