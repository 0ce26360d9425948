//! `multiplex`: what it says, and what it refuses.

use crate::command::{refuses, run, text};

const SMALL: [&str; 7] = [
    "multiplex",
    "--sample",
    "lambert:0.05",
    "--step",
    "15",
    "--image-size",
    "32",
];

#[test]
fn it_picks_the_smallest_uncertainty_and_says_why() {
    for (read_noise, verdict) in [
        ("0", "do not multiplex: photon noise rules"),
        ("100", "multiplex with order "),
    ] {
        let arguments = [&SMALL[..], &["--read-noise", read_noise]].concat();
        let answer = run(&[&arguments[..], &["--json"]].concat(), "").object();
        let alternatives = answer["alternatives"].as_array().unwrap();
        let uncertainty = |at: usize| alternatives[at]["uncertainty"].as_f64().unwrap();
        let pick = answer["pick"].as_u64().unwrap() as usize;
        assert!(
            (0..alternatives.len()).all(|at| uncertainty(pick) <= uncertainty(at)),
            "{answer}"
        );
        assert!(
            answer["verdict"].as_str().unwrap().starts_with(verdict),
            "{answer}"
        );

        let outcome = run(&arguments, "");
        let table = outcome.done();
        assert!(table.lines().last().unwrap().starts_with(verdict), "{table}");
        assert_eq!(table.matches("<- pick").count(), 1, "{table}");
        assert_eq!(run(&arguments, "").done(), table, "the same seed, the same table");
    }
}

#[test]
fn what_cannot_be_multiplexed_is_refused() {
    for (change, parts) in [
        (["--order", "0"], ["order", "from 1 to 4095", "found 0"]),
        (
            ["--order", "4000"],
            ["order", "expected at most the", "found 4000"],
        ),
        (["--order", "5000"], ["order", "from 1 to 4095", "found 5000"]),
        (
            ["--order", "many"],
            ["--order", "expected auto or a whole number", "many"],
        ),
        (
            ["--read-noise", "-1"],
            ["camera.read_noise_e", "expected", "found -1"],
        ),
        (
            ["--read-noise", "nan"],
            ["camera.read_noise_e", "expected", "found NaN"],
        ),
        (["--sample", "phong"], ["model", "expected lambert", "'phong'"]),
    ] {
        let mut arguments: Vec<&str> = SMALL[..1].to_vec();
        for pair in SMALL[1..].chunks(2) {
            if pair[0] != change[0] {
                arguments.extend(pair);
            }
        }
        arguments.extend(change);
        refuses(&arguments, "", 2, &parts);
    }
}

#[test]
fn cells_that_overlap_are_refused() {
    let scratch = tempfile::tempdir().unwrap();
    let list = scratch.path().join("close.txt");
    // A spot of 1° on directions 0.3° apart.
    let lines: Vec<String> = (0..9)
        .map(|at| {
            format!(
                "{} {}",
                60.0 + 0.3 * f64::from(at % 3),
                20.0 + 0.3 * f64::from(at / 3)
            )
        })
        .collect();
    std::fs::write(&list, lines.join("\n")).unwrap();
    let arguments = [
        "multiplex",
        "--grid",
        text(&list),
        "--image-size",
        "16",
        "--order",
        "9",
    ];
    refuses(
        &arguments,
        "",
        2,
        &["cells of one block", "disjoint", "light.spot_deg"],
    );
}
