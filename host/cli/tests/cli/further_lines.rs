//! `controller` and the further lines of the simulated trigger box.

use serde_json::Value;

use crate::answers::number;
use crate::command::{refuses, run, text};
use crate::trigger_box::controller;

#[test]
fn further_lines_pulse_with_each_step_and_runs_repeat() {
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("photo.csv");
    let ten = ["run", "--steps", "10", "--period", "100ms", "--exposure", "5ms"];
    let further = [
        "--aux-a",
        "0us+20us",
        "--aux-b",
        "cam+1us",
        "--photo",
        text(&file),
        "--active-low",
        "aux-a,photo",
    ];
    let plain = controller(&ten);
    let mut done = controller(&[&ten[..], &further].concat());
    // Nothing is wired there, and the other lines are as before.
    assert_eq!(done["photo"], serde_json::json!({ "pulses": 0, "lost": 0 }));
    assert_eq!(
        std::fs::read_to_string(&file).unwrap(),
        "run,pulse,on_ticks,width_ticks\n"
    );
    done.as_object_mut().unwrap().remove("photo");
    for figure in [
        "records",
        "strobes",
        "flags",
        "period_ticks",
        "duration_s",
        "steps_done",
    ] {
        assert_eq!(done[figure], plain[figure], "{figure}");
    }
    let series = controller(&[&ten[..], &["--repeat", "3"]].concat());
    assert_eq!((number(&series, "runs"), number(&series, "run")), (3.0, 3.0));
    assert_eq!(
        (number(&series, "records"), number(&series, "steps_done")),
        (30.0, 10.0)
    );
    for line in ["aux-a", "aux-b"] {
        let pulsed = controller(&["pulse", line, "--width", "5us", "--count", "3"]);
        assert_eq!(
            (&pulsed["line"], &pulsed["strobe"]),
            (&line.to_uppercase().into(), &Value::Null)
        );
        assert!((number(&pulsed, "width_s") - 5e-6).abs() < 1e-12, "{pulsed}");
        let held = controller(&["hold", line, "high", "--for", "10s", "--active-low"]);
        assert!((number(&held, "held_s") - 10.0).abs() < 1e-9, "{held}");
    }
}

#[test]
fn what_further_lines_cannot_do_is_refused_by_name() {
    let cases: &[(&[&str], &[&str])] = &[
        (&["run", "--aux-a", "5us"], &["--aux-a", "AT+WIDTH", "`5us`"]),
        (&["run", "--aux-b", "cam+1us+0us"], &["--aux-b", "more than 0"]),
        (&["run", "--aux-a", "0us+1ns"], &["--aux-a", "24 ns", "0 ticks"]),
        (
            &[
                "run",
                "--period",
                "1ms",
                "--exposure",
                "10us",
                "--aux-b",
                "1us+1ms",
            ],
            &["AUX-B", "step 0", "end within the period of 1 ms", "too long"],
        ),
        (
            &[
                "run",
                "--period",
                "1ms",
                "--exposure",
                "10us",
                "--cam-at",
                "50us",
                "--aux-a",
                "cam+1ticks",
            ],
            &["step 0", "AUX-A", "at least 24 ns", "found"],
        ),
        (
            &["run", "--exposure", "1s", "--period", "40s", "--aux-a", "cam"],
            &["step 0", "period", "found 40 s"],
        ),
        (
            &["run", "--each-on-sync", "--start-on-line"],
            &["--start-on-line", "--each-on-sync"],
        ),
        (&["run", "--stream", "--repeat", "2"], &["--stream", "--repeat"]),
        (&["run", "--repeat", "0"], &["--repeat", "0"]),
        (&["run", "--photo", "p.txt"], &["p.txt", "csv"]),
        (
            &["hold", "aux-a", "high", "--for", "40s"],
            &["period", "found 40"],
        ),
        (&["pulse", "photo"], &["photo"]),
        (&["selftest", "--photo", "cam"], &["--photo", "cam"]),
    ];
    for (words, parts) in cases {
        refuses(&[&["controller", "--port", "sim"], *words].concat(), "", 2, parts);
    }
}

#[test]
fn a_photodiode_that_sees_nothing_is_told_of() {
    let alone = [
        "controller",
        "selftest",
        "--port",
        "sim",
        "--count",
        "2",
        "--photo",
        "aux-b",
    ];
    run(&alone, "").complains(
        1,
        &[
            "AUX-B to reach PHOTO",
            "PHOTO does not answer AUX-B: something holds it low",
        ],
    );
}
