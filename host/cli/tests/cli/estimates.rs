//! Pixels that know of their surroundings.

use std::path::Path;

use rcg::brdf::sample;
use rcg::store::provenance::Provenance;

use crate::command::{refuses, run, text};
use crate::judge::{Scores, scores};

/// What was captured.
const SEEN: [Provenance; 1] = [Provenance::Measured];

fn judged(path: &Path, spec: &str) -> Scores {
    scores(path, sample::parse(spec).unwrap().as_ref(), &SEEN)
}

#[test]
fn surroundings_take_noise_from_what_is_even_and_leave_a_lobe_right() {
    let scratch = tempfile::tempdir().unwrap();
    // So short that noise is most of what values are off by.
    for (name, spec, least) in [
        ("even", "lambert:0.5", 3.0),
        ("lobe", "ggx:rd=0.1,f0=0.3,ax=0.2,ay=0.3", 1.7),
    ] {
        let out = scratch.path().join(name);
        let measure = [
            "measure",
            "--sample",
            spec,
            "--step",
            "30",
            "--image-size",
            "64",
            "--exposure-ms",
            "0.05",
            "--out",
            text(&out),
        ];
        run(&measure, "").done();
        let alone = out.join("brdf.zarr");
        let fused = scratch.path().join(format!("{name}.zarr"));
        let again = |estimate: &str, out: &Path| {
            let measured = text(&scratch.path().join(name)).to_owned();
            run(
                &["assemble", &measured, "--out", text(out), "--estimate", estimate],
                "",
            )
            .done();
        };
        again("on", &fused);
        let [alone, fused] = [&alone, &fused].map(|path| judged(path, spec));
        println!("{name}: {alone}; fused: {fused}");
        assert_eq!(alone.count, fused.count);
        assert!(
            fused.median_error * least < alone.median_error,
            "{alone}; {fused}"
        );
        assert!(fused.within_2 > 0.94 && fused.worst < 6.5, "{fused}");
    }
    // As it was begun, if nothing else is said.
    let begun = scratch.path().join("begun");
    let measure = |rest: &[&str]| {
        let all = [
            "measure",
            "--step",
            "45",
            "--image-size",
            "24",
            "--out",
            text(&begun),
        ];
        [&all[..], rest]
            .concat()
            .into_iter()
            .map(str::to_owned)
            .collect::<Vec<_>>()
    };
    run(&measure(&["--estimate", "on"]), "").done();
    let other = measure(&["--resume", "--estimate", "off"]);
    let other: Vec<&str> = other.iter().map(String::as_str).collect();
    refuses(&other, "", 2, &["estimate", "on", "off"]);
    refuses(&["assemble", text(&begun), "--estimate", "on"], "", 2, &["--out"]);
}
