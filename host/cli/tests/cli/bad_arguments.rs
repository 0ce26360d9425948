//! Arguments that no measurement can be made from.

use crate::command::{quick, refuses, text};

/// Refused with exit 2 and `parts`, and nothing is made.
fn refused(change: &[&str], parts: &[&str]) {
    let scratch = tempfile::tempdir().unwrap();
    let out = scratch.path().join("out");
    let mut arguments = quick(&out);
    for pair in change.chunks(2) {
        // The later of two would be refused for being the second.
        if let Some(at) = arguments.iter().position(|argument| argument == pair[0]) {
            arguments.drain(at..at + 2);
        }
        arguments.extend(pair.iter().map(|&argument| argument.to_owned()));
    }
    refuses(&arguments, "", 2, parts);
    assert!(!out.exists(), "{change:?} left {}", out.display());
}

#[test]
fn a_step_that_does_not_divide_90_degrees_is_refused() {
    for (step, found) in [
        ("7", "found 7"),
        ("0", "found 0"),
        ("-1", "found -1"),
        ("nan", "found NaN"),
    ] {
        refused(&["--step", step], &["step", "expected", "divides 90", found]);
    }
}

#[test]
fn an_image_size_out_of_range_is_refused() {
    for size in ["0", "7", "100000"] {
        let found = format!("found `{size}`");
        refused(
            &["--image-size", size],
            &["image-size", "expected", "8 to 4096", &found],
        );
    }
}

#[test]
fn an_exposure_time_that_is_none_is_refused() {
    for ms in ["0", "-1", "nan", "inf", "0.0009", "60001", "4ms"] {
        let found = format!("found `{ms}`");
        refused(
            &["--exposure-ms", ms],
            &[
                "--exposure-ms",
                "expected",
                "milliseconds from 0.001 to 60000",
                &found,
            ],
        );
    }
}

#[test]
fn values_that_the_command_line_itself_refuses_are_named_in_one_sentence() {
    refused(
        &["--noise", "maybe"],
        &["--noise", "expected on or off", "found `maybe`"],
    );
    refused(
        &["--missed-triggers", "2"],
        &["--missed-triggers", "expected a number from 0 to 1", "found `2`"],
    );
    refused(
        &["--image-size", "many"],
        &["--image-size", "expected", "found `many`"],
    );
    refused(
        &["--seed", "-1"],
        &[
            "--seed",
            "expected a whole number that is not negative",
            "found `-1`",
        ],
    );
    refuses(
        &["render", "lambert", "--out", "a.png", "--size", "7"],
        "",
        2,
        &["--size", "expected a whole number from 8 to 8192", "found `7`"],
    );
    refused(&["--stepp", "15"], &["--stepp", "--step"]);
}

#[test]
fn a_command_that_does_not_exist_is_refused_in_one_sentence() {
    refuses(&["measrue"], "", 2, &["measrue", "measure"]);
    refuses(&["measure"], "", 2, &["--out"]);
    refuses(&["value"], "", 2, &["BRDF"]);
}

#[test]
fn a_sample_that_does_not_exist_is_refused_before_anything_is_made() {
    let spec = |spec: &str, parts: &[&str]| {
        let parts: Vec<&str> = [spec, "expected", "found"].iter().chain(parts).copied().collect();
        refused(&["--sample", spec], &parts);
        refuses(&["value", spec], "", 2, &parts);
        refuses(&["plan", "--sample", spec], "", 2, &parts);
    };
    spec(
        "phong:0.5",
        &["model", "lambert, ward, ggx, velvet, satin", "phong"],
    );
    spec("ward:gold", &["brass", "gold"]);
    spec("ward:az=0.1", &["rd=, rs=, ax=, ay=", "az"]);
    spec("ward:ax=0", &["ax", "0.001 to 1"]);
    spec("ward:rd=0.9,rs=0.9", &["rd + rs", "at most 1", "1.8"]);
    spec("ward:ax=0.1,ax=0.2", &["ax", "once"]);
    spec("lambert:2", &["0 to 1"]);
    spec("lambert:nan", &["0 to 1"]);
    spec("ggx:f0=-1", &["f0"]);
    spec("no/such/file.bsdf", &["no/such/file.bsdf", "readable"]);
}

#[test]
fn a_measurement_that_cannot_succeed_leaves_nothing() {
    let scratch = tempfile::tempdir().unwrap();
    let out = scratch.path().join("out");
    let arguments = [
        "measure",
        "--out",
        text(&out),
        "--step",
        "15",
        "--image-size",
        "16",
    ];
    // Every trigger is missed, already in the pilot capture.
    let arguments = [&arguments[..], &["--missed-triggers", "1"]].concat();
    refuses(
        &arguments,
        "",
        1,
        &["exposure 0", "expected a frame", "found none"],
    );
    assert!(!out.exists());
}
