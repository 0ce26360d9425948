//! What concerns the virtual rig alone stands together: under one heading of the help, in one table of the plan.

use std::fs;

use crate::command::{run, text};

const FLAGS: [&str; 7] = [
    "--sample",
    "--truth",
    "--noise",
    "--seed",
    "--missed-triggers",
    "--dropped-frames",
    "--doubled-frames",
];

#[test]
fn one_heading_of_the_help_has_all_of_the_virtual_rig_and_nothing_else() {
    for (command, flags) in [
        (vec!["measure"], &FLAGS[..]),
        (vec!["plan"], &FLAGS[..]),
        (vec!["multiplex"], &FLAGS[..]),
        (vec!["calibrate", "geometry"], &FLAGS[1..]),
        (vec!["calibrate", "photometry"], &FLAGS[1..]),
        (vec!["capture"], &FLAGS[4..]),
    ] {
        let help = run(&[&command[..], &["--help"]].concat(), "");
        let (_, below) = help.done().split_once("Virtual rig:\n").expect("the heading");
        let section = below.split("\n\n").take_while(|part| part.starts_with("  "));
        let found: Vec<&str> = section
            .flat_map(str::lines)
            .filter_map(|line| line.trim_start().strip_prefix("--").map(|_| line.trim_start()))
            .map(|line| line.split(' ').next().unwrap_or(line))
            .collect();
        assert_eq!(found, flags, "{command:?}");
    }
}

#[test]
fn the_plan_has_one_table_for_it_and_a_capture_may_have_other_faults() {
    let scratch = tempfile::tempdir().unwrap();
    let out = scratch.path().join("m");
    let out = text(&out);
    let asked = "--step 30 --image-size 16 --exposure-ms 4 --sample-name plate --sample-description ground \
                 --sample lambert:0.3 --noise off --seed 9 --missed-triggers 1";
    let arguments: Vec<&str> = ["plan", "--out", out]
        .into_iter()
        .chain(asked.split(' '))
        .collect();
    run(&arguments, "").done();
    let plan = fs::read_to_string(scratch.path().join("m/plan.toml")).unwrap();
    let (request, virtual_rig) = plan.split_once("\n[virtual]\n").expect("one table");
    for part in [
        "sample = \"lambert:0.3\"",
        "noise = false",
        "seed = 9",
        "missed_triggers = 1.0",
    ] {
        assert!(
            virtual_rig.contains(part) && !request.contains(part),
            "{part} in {plan}"
        );
    }
    for part in ["sample_name = \"plate\"", "sample_description = \"ground\""] {
        assert!(request.contains(part), "{part} in {plan}");
    }

    let ending = run(&["capture", out], "");
    ending.complains(1, &["trigger"]);
    let captured = run(&["capture", out, "--missed-triggers", "0", "--json"], "").object();
    assert_eq!(captured["missed_triggers"], 0, "{captured}");
    run(&["measure", "--out", out, "--resume", "--seed", "8"], "").complains(2, &["seed", "9", "8"]);
    let name = ["measure", "--out", out, "--resume", "--sample-name", "other"];
    run(&name, "").complains(2, &["sample-name", "plate", "other"]);
}

#[test]
fn a_measurement_is_compared_with_what_stands_in_the_rig_or_with_what_is_asked_for() {
    let scratch = tempfile::tempdir().unwrap();
    for (name, reference, median) in [("own", None, 0.0), ("other", Some("lambert:0.3"), 1.0)] {
        let out = scratch.path().join(name);
        let mut arguments = vec!["measure", "--out", text(&out), "--json", "--noise", "off"];
        arguments.extend(["--step", "30", "--image-size", "16", "--sample", "lambert:0.6"]);
        arguments.extend(reference.iter().flat_map(|reference| ["--reference", reference]));
        let summary = run(&arguments, "").object();
        let against = &summary["evaluation"]["against_reference"];
        assert_eq!(against["reference"], reference.unwrap_or("lambert:0.6"));
        let found = against["relative_error"]["median"].as_f64().unwrap();
        assert!((found - median).abs() < 0.05, "{found} instead of {median}");
        assert_eq!(summary["sample"], "lambert:0.6");
    }
    let out = scratch.path().join("bad");
    let bad = run(&["measure", "--out", text(&out), "--reference", "gold:1"], "");
    bad.complains(2, &["gold"]);
    assert!(!out.exists());
}
