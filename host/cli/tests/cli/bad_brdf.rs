//! A `brdf.zarr` that is damaged or not what it says.

use std::fs;
use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use crate::command::{quick_measurement, refuses, run, text};

/// A pair in the middle of what rcg-1-16bit reaches.
const PAIR: &str = "52.5 90 50 200\n";

fn measured(scratch: &Path) -> PathBuf {
    let out = scratch.join("out");
    quick_measurement(&out);
    out.join("brdf.zarr")
}

/// Refused by all that read a BRDF; no picture is made.
fn refused(brdf: &Path, parts: &[&str]) {
    let picture = brdf.with_file_name("sphere.png");
    let parts: Vec<&str> = [text(brdf), "expected", "found"]
        .into_iter()
        .chain(parts.iter().copied())
        .collect();
    refuses(&["value", text(brdf)], PAIR, 2, &parts);
    refuses(&["evaluate", text(brdf)], "", 2, &parts);
    refuses(
        &["evaluate", text(brdf), "--reference", "ward:brass"],
        "",
        2,
        &parts,
    );
    let render = ["render", text(brdf), "--size", "64", "--out", text(&picture)];
    refuses(&render, "", 2, &parts);
    assert!(!picture.exists());
}

/// Sets what stands at `pointer` in the JSON file `path` while `test` runs.
fn with_edit(path: &Path, pointer: &str, value: &Value, test: impl Fn()) {
    let before = fs::read_to_string(path).unwrap();
    let mut metadata: Value = serde_json::from_str(&before).unwrap();
    let place = metadata.pointer_mut(pointer);
    *place.unwrap_or_else(|| panic!("{} has {pointer}", path.display())) = value.clone();
    // Of what stands there on purpose there is no other sum.
    if let Some(attributes) = metadata["attributes"].as_object_mut() {
        attributes.shift_remove("rcg_checksum");
    }
    fs::write(path, metadata.to_string()).unwrap();
    test();
    fs::write(path, before).unwrap();
}

/// The chunk of `array` that holds the incident direction of [`PAIR`]: ring 3 of 24 sectors each, so index 78, in
/// chunks of 32.
fn chunk(brdf: &Path, array: &str) -> PathBuf {
    let folder = brdf.join(array);
    let names = fs::read_dir(&folder)
        .unwrap()
        .flatten()
        .map(|entry| entry.file_name());
    let name = names
        .into_iter()
        .find(|name| name.to_string_lossy().starts_with("c.2."));
    folder.join(name.expect("the chunk was measured"))
}

#[test]
fn a_sound_file_is_answered() {
    let scratch = tempfile::tempdir().unwrap();
    let brdf = measured(scratch.path());
    assert_eq!(
        run(&["value", text(&brdf)], PAIR)
            .done()
            .split_whitespace()
            .count(),
        3
    );
}

#[test]
fn a_truncated_or_altered_chunk_is_refused() {
    let scratch = tempfile::tempdir().unwrap();
    let brdf = measured(scratch.path());
    for array in ["f", "sigma", "provenance"] {
        let path = chunk(&brdf, array);
        let whole = fs::read(&path).unwrap();
        for length in [0, 3, whole.len() / 2, whole.len() - 1] {
            fs::write(&path, &whole[..length]).unwrap();
            refused(&brdf, &[text(&path), "chunk 2", array]);
        }
        let mut altered = whole.clone();
        altered[whole.len() / 2] ^= 1;
        fs::write(&path, &altered).unwrap();
        refused(&brdf, &[text(&path), "chunk 2", array, "CRC"]);
        // What is lost of a chunk is damage; only a chunk of which there is nothing is missing.
        fs::remove_file(&path).unwrap();
        refused(&brdf, &[text(&path), "chunk 2", array]);
        fs::write(&path, whole).unwrap();
    }
    assert!(
        run(&["evaluate", text(&brdf)], "").code == Some(0),
        "it is whole again"
    );
}

#[test]
fn a_missing_array_is_refused() {
    let scratch = tempfile::tempdir().unwrap();
    let brdf = measured(scratch.path());
    for array in [
        "f",
        "sigma",
        "provenance",
        "incident_reason",
        "outgoing_reason",
        "outgoing_pixel",
    ] {
        let aside = scratch.path().join("aside");
        fs::rename(brdf.join(array), &aside).unwrap();
        refused(&brdf, &[array]);
        fs::rename(&aside, brdf.join(array)).unwrap();
    }
}

#[test]
fn attributes_that_make_no_sense_are_refused() {
    let scratch = tempfile::tempdir().unwrap();
    let brdf = measured(scratch.path());
    let group = brdf.join("zarr.json");
    for step in [
        json!("wide"),
        json!(-1),
        json!(7),
        json!(0),
        json!(1e300),
        json!(null),
    ] {
        with_edit(&group, "/attributes/step_deg", &step, || {
            refused(&brdf, &["step_deg"]);
        });
    }
    for spot in [json!(null), json!(0), json!(-1.0), json!("1 degree")] {
        with_edit(&group, "/attributes/spot_deg", &spot, || {
            refused(&brdf, &["spot_deg", "degrees above 0"]);
        });
    }
    with_edit(&group, "/attributes/step_deg", &json!(30.0), || {
        refused(&brdf, &["incident", "144"]);
    });
    with_edit(&group, "/attributes/incident_kind", &json!("hexagons"), || {
        refused(&brdf, &["incident_kind", "hexagons"]);
    });
    // As written before there was another kind.
    with_edit(&group, "/attributes/incident_kind", &json!(null), || {
        run(&["evaluate", text(&brdf)], "").done();
    });
    // The coordinates of any grid are a list.
    with_edit(&group, "/attributes/incident_kind", &json!("list"), || {
        run(&["evaluate", text(&brdf)], "").done();
    });
    with_edit(&group, "/attributes/rcg_format", &json!("raw"), || {
        refused(&brdf, &["rcg_format", "raw"]);
    });
    with_edit(&group, "/attributes/rcg_format_version", &json!(4), || {
        refused(&brdf, &["rcg_format_version", "expected 1 or 2 or 3", "found 4"]);
    });
    with_edit(&group, "/attributes", &json!([]), || {
        refused(&brdf, &["attributes"]);
    });
    let whole = fs::read(&group).unwrap();
    fs::write(&group, &whole[..whole.len() / 2]).unwrap();
    refused(&brdf, &["JSON"]);
}

#[test]
fn metadata_of_an_array_that_make_no_sense_are_refused() {
    let scratch = tempfile::tempdir().unwrap();
    let brdf = measured(scratch.path());
    let header = brdf.join("f/zarr.json");
    let huge = json!([4_611_686_018_427_387_904_u64, 16, 16, 3]);
    let wide = json!([144, 4_294_967_295_u64, 4_294_967_295_u64, 3]);
    for shape in [
        huge,
        wide,
        json!([0, 16, 16, 3]),
        json!([144, 16]),
        json!("all"),
        json!([-1, 16, 16, 3]),
    ] {
        with_edit(&header, "/shape", &shape, || {
            refused(&brdf, &["zarr.json", "shape"]);
        });
    }
    let chunk_shape = "/chunk_grid/configuration/chunk_shape";
    with_edit(&header, chunk_shape, &json!([0, 16, 16, 3]), || {
        refused(&brdf, &["shape"]);
    });
    with_edit(&header, "/data_type", &json!("complex256"), || {
        refused(&brdf, &["data_type", "complex256"]);
    });
    with_edit(&header, "/codecs", &json!([{ "name": "zip" }]), || {
        refused(&brdf, &["codecs", "zip"]);
    });
    with_edit(&header, "/dimension_names", &json!(["a", "b", "c", "d"]), || {
        refused(&brdf, &["dimension_names"]);
    });
}

#[test]
fn a_folder_or_name_of_another_kind_is_refused() {
    let scratch = tempfile::tempdir().unwrap();
    let brdf = measured(scratch.path());
    refused(scratch.path(), &["rcg_format"]);
    refused(&brdf.with_file_name("raw.zarr"), &["rcg_format", "raw"]);
    refused(&brdf.with_file_name("none.zarr"), &["found nothing"]);
}

#[test]
fn a_damaged_raw_file_is_refused_by_assembly_and_the_old_result_stays() {
    let scratch = tempfile::tempdir().unwrap();
    let brdf = measured(scratch.path());
    let out = brdf.parent().unwrap();
    let before = crate::tree::files(&brdf);
    let frames = out.join("raw.zarr/frames/c.0.0.0.0");
    let bytes = fs::read(&frames).unwrap();
    fs::write(&frames, &bytes[..bytes.len() / 2]).unwrap();
    refuses(
        &["assemble", text(out)],
        "",
        2,
        &[text(&frames), "expected", "found"],
    );
    assert!(crate::tree::files(&brdf) == before);
    // Capturing again mends it.
    run(&["measure", "--resume", "--out", text(out)], "").done();
    assert!(fs::read(&frames).unwrap() == bytes);
    assert!(crate::tree::files(&brdf) == before);
}
