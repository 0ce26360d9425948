//! `controller` with the simulated trigger box.

use serde_json::Value;

use crate::answers::number;
use crate::command::{refuses, run};

fn controller(arguments: &[&str]) -> Value {
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
    for figure in ["per_s", "mean_us", "slowest_us"] {
        assert!(number(&bench, figure) > 0.0, "{figure}");
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
        ("--exposure-ms", "-1"),
        ("--exposure-ms", "nan"),
        ("--exposure-ms", "1e9"),
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
}
