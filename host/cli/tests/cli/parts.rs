//! Assembly in parts: in any order, again, at the same time; the whole is that of one process to the bit, or is refused.

use std::fs::{self, File};
use std::path::Path;

use crate::command::{refuses, run, text};
use crate::tree::assert_same;

/// Noise, and more chunks than one.
fn measured(out: &Path, more: &[&str]) {
    let size = ["--step", "15", "--image-size", "16", "--exposure-ms", "4"];
    run(&[&["measure", "--out", text(out)][..], &size, more].concat(), "").done();
}

#[test]
fn parts_in_any_order_come_to_what_one_process_comes_to() {
    let scratch = tempfile::tempdir().unwrap();
    let at = |name: &str| scratch.path().join(name);
    for (name, more) in [("single", &[][..]), ("coded", &["--light", "multiplexed"])] {
        let measurement = at(name);
        measured(&measurement, more);
        let whole = at(&format!("{name}-whole.zarr"));
        run(&["assemble", text(&measurement), "--out", text(&whole)], "").done();
        for parts in [&["1/1"][..], &["3/3", "1/3", "2/3", "1/3"]] {
            let out = at(&format!("{name}-{}.zarr", parts.len()));
            let assemble = ["assemble", text(&measurement), "--out", text(&out)];
            for part in parts {
                run(&[&assemble[..], &["--part", part]].concat(), "").done();
                assert!(!out.exists(), "{part}: looks whole");
            }
            let told = run(&[&assemble[..], &["--finish"]].concat(), "");
            assert!(told.done().contains("incident directions"), "{told:?}");
            assert_same(&out, &whole);
            assert!(!at(&format!("{name}-{}.zarr.parts", parts.len())).exists());
        }
        // The measurement's own result, too.
        for more in [["--part", "2/2"].as_slice(), &["--part", "1/2"], &["--finish"]] {
            run(&[&["assemble", text(&measurement)][..], more].concat(), "").done();
        }
        assert_same(&measurement.join("brdf.zarr"), &whole);
    }
}

#[test]
fn what_is_missing_or_of_another_measurement_is_refused() {
    let scratch = tempfile::tempdir().unwrap();
    let at = |name: &str| scratch.path().join(name);
    let (one, other, out) = (at("one"), at("other"), at("out.zarr"));
    measured(&one, &[]);
    measured(&other, &["--seed", "9"]);
    let assemble = |of: &Path, more: &[&str]| {
        let words = ["assemble", text(of), "--out", text(&out)];
        words
            .iter()
            .chain(more)
            .map(|word| (*word).to_owned())
            .collect::<Vec<_>>()
    };
    let parts = text(&out).to_owned() + ".parts";
    refuses(
        &assemble(&one, &["--finish"]),
        "",
        2,
        &[&parts, "--part K/N", "no such folder"],
    );
    run(&assemble(&one, &["--part", "1/2"]), "").done();
    let second = parts.clone() + "/2-of-2.zarr";
    refuses(&assemble(&one, &["--finish"]), "", 2, &[&second, "found nothing"]);
    // A part is no result.
    let first = parts.clone() + "/1-of-2.zarr";
    refuses(&["evaluate", &first], "", 2, &[&first, "part", "--finish"]);
    run(&assemble(&other, &["--part", "2/2"]), "").done();
    refuses(
        &assemble(&one, &["--finish"]),
        "",
        2,
        &[&second, "same frames", "others"],
    );
    run(&assemble(&one, &["--part", "2/2"]), "").done();
    fs::write(Path::new(&second).join("sums.json"), "[]").unwrap();
    refuses(&assemble(&one, &["--finish"]), "", 2, &[&second, "sums"]);
    run(&assemble(&one, &["--part", "2/2"]), "").done();
    let chunk = fs::read_dir(Path::new(&second).join("f")).unwrap().flatten();
    let chunk = chunk
        .map(|entry| entry.path())
        .find(|path| !path.ends_with("zarr.json"))
        .unwrap();
    for array in ["f", "sigma", "provenance"] {
        let name = chunk.file_name().unwrap().to_str().unwrap();
        let name = if array == "provenance" {
            name.strip_suffix(".0").unwrap()
        } else {
            name
        };
        fs::remove_file(Path::new(&second).join(array).join(name)).unwrap();
    }
    refuses(
        &assemble(&one, &["--finish"]),
        "",
        2,
        &[&second, "as sums.json says"],
    );
    run(&assemble(&one, &["--part", "2/2"]), "").done();
    run(&assemble(&one, &["--part", "1/3"]), "").done();
    refuses(
        &assemble(&one, &["--finish"]),
        "",
        2,
        &[&parts, "some of 2 and some of 3"],
    );
    assert!(!out.exists());
    for bad in ["0/2", "3/2", "1", "x/2"] {
        refuses(&assemble(&one, &["--part", bad]), "", 2, &["--part", bad, "K/N"]);
    }
}

#[test]
fn parts_keep_the_whole_out_and_the_whole_keeps_parts_out() {
    let scratch = tempfile::tempdir().unwrap();
    let (one, out) = (scratch.path().join("one"), scratch.path().join("out.zarr"));
    measured(&one, &[]);
    let with = |more: &[&str]| {
        let words = ["assemble", text(&one), "--out", text(&out)];
        words
            .iter()
            .chain(more)
            .map(|word| (*word).to_owned())
            .collect::<Vec<_>>()
    };
    let lock = text(&out).to_owned() + ".lock";
    {
        let held = File::create(&lock).unwrap();
        held.try_lock_shared().unwrap();
        run(&with(&["--part", "1/1"]), "").done();
        for more in [&[][..], &["--finish"]] {
            refuses(&with(more), "", 1, &[text(&out), "writing"]);
        }
    }
    {
        let held = File::create(&lock).unwrap();
        held.try_lock().unwrap();
        refuses(&with(&["--part", "1/1"]), "", 1, &[text(&out), "writing"]);
    }
    run(&with(&["--finish"]), "").done();
    assert!(!Path::new(&lock).exists());
}
