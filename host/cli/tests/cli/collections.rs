//! Many measurements: one catalogue, which says what is there and what has changed, and a queue that fills it.

use std::fs;
use std::path::Path;

use serde_json::Value;

use crate::command::{makers, quick, quick_measurement, refuses, run, text};
use crate::tree::{copy, files};

/// A collection with a measurement in it that was added.
fn collection(at: &Path) {
    run(&["collection", "init", text(at)], "").done();
    quick_measurement(&at.join("a/brass"));
    let told = run(&["collection", "add", text(at), "--json"], "").object();
    assert_eq!(told["added"], serde_json::json!(["a/brass"]), "{told}");
}

/// Arguments that measure the samples of the list `queue` into the folder `out`.
fn queued(queue: &Path, out: &Path, more: &[&str]) -> Vec<String> {
    let places = ["measure", "--queue", text(queue), "--out", text(out)];
    let size = ["--step", "30", "--image-size", "16", "--exposure-ms", "4"];
    [&places[..], &size, more]
        .concat()
        .into_iter()
        .map(str::to_owned)
        .collect()
}

fn rows(at: &Path, more: &[&str]) -> Vec<Value> {
    let told = run(&[&["collection", "query", text(at), "--json"], more].concat(), "").object();
    told["measurements"].as_array().unwrap().clone()
}

/// A chunk of f of the result of the measurement in `dir`.
fn chunk(dir: &Path) -> std::path::PathBuf {
    let mut all: Vec<_> = fs::read_dir(dir.join("brdf.zarr/f"))
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| !path.ends_with("zarr.json"))
        .collect();
    all.sort();
    all.swap_remove(0)
}

#[test]
fn what_is_added_is_found_again_and_what_changes_is_told() {
    let scratch = tempfile::tempdir().unwrap();
    let at = scratch.path().join("c");
    collection(&at);
    let evaluated = run(
        &[
            "evaluate",
            text(&at.join("a/brass/brdf.zarr")),
            "--reference",
            "ward:brass",
            "--json",
        ],
        "",
    )
    .object();
    let row = &rows(&at, &[])[0];
    assert_eq!(row["path"], "a/brass");
    assert_eq!(row["sample"], "ward:brass");
    assert_eq!(row["date"], "2023-11-14T22:13:20Z");
    assert_eq!(row["coverage"], evaluated["coverage"]);
    assert_eq!(
        row["error"],
        evaluated["against_reference"]["relative_error"]["median"]
    );
    assert_eq!(row["reciprocity"], evaluated["reciprocity_residual_median"]);

    // Again: nothing changes, to the bit.
    let before = files(&at);
    let told = run(
        &[
            "collection",
            "add",
            text(&at),
            text(&at.join("a/brass")),
            "--json",
        ],
        "",
    )
    .object();
    assert_eq!(told["unchanged"], 1, "{told}");
    assert!(files(&at) == before);
    let status = |more: &[&str]| {
        run(
            &[&["collection", "status", text(&at), "--json"], more].concat(),
            "",
        )
        .object()
    };
    let told = status(&["--verify"]);
    assert_eq!(
        told,
        serde_json::json!({ "done": 1, "missing": [], "stale": [], "not_added": [] })
    );

    // Another result, one that was moved away, and one that is new.
    run(&["assemble", text(&at.join("a/brass")), "--lossless"], "").done();
    assert_eq!(status(&[])["stale"], serde_json::json!(["a/brass"]));
    let told = run(&["collection", "add", text(&at), "--json"], "").object();
    assert_eq!(told["changed"], serde_json::json!(["a/brass"]), "{told}");
    fs::rename(at.join("a/brass"), at.join("b")).unwrap();
    let told = status(&[]);
    assert_eq!(told["missing"], serde_json::json!(["a/brass"]));
    assert_eq!(told["not_added"], serde_json::json!(["b"]));
    // The same bits with other times are the same.
    fs::create_dir(at.join("c")).unwrap();
    copy(&at.join("b"), &at.join("a/brass"));
    assert_eq!(status(&[])["done"], 1);
}

#[test]
fn what_is_damaged_unfinished_or_elsewhere_is_refused() {
    let scratch = tempfile::tempdir().unwrap();
    let at = scratch.path().join("c");
    let (brass, add) = (at.join("a/brass"), ["collection", "add", text(&at)]);
    let with = |dir: &Path| {
        [&add[..], &[text(dir)]]
            .concat()
            .iter()
            .map(|word| (*word).to_owned())
            .collect::<Vec<_>>()
    };
    refuses(&add, "", 2, &[text(&at), "expected a collection", "init"]);
    collection(&at);
    refuses(
        &["collection", "init", text(&at)],
        "",
        2,
        &["collection.sqlite", "found one"],
    );
    let elsewhere = scratch.path().join("elsewhere");
    copy(&brass, &elsewhere);
    refuses(&with(&elsewhere), "", 2, &[text(&elsewhere), "below the folder"]);
    refuses(
        &with(&at.join("none")),
        "",
        2,
        &["none", "expected a measurement"],
    );

    let planned = at.join("planned");
    let [_, plan, _] = makers(&planned);
    run(&plan, "").done();
    refuses(&with(&planned), "", 2, &[text(&planned), "finished", "planned"]);
    let told = run(&[&add[..], &["--json"]].concat(), "").object();
    assert_eq!(told["unfinished"].as_array().unwrap().len(), 1, "{told}");

    // A chunk with a flipped bit, and one that is gone, which reads like one that was never measured.
    let row = rows(&at, &[]);
    let chunk = chunk(&brass);
    let whole = fs::read(&chunk).unwrap();
    let mut flipped = whole.clone();
    let middle = flipped.len() / 2;
    flipped[middle] ^= 1;
    fs::write(&chunk, flipped).unwrap();
    assert_eq!(run(&with(&brass), "").code, Some(2));
    for array in ["f", "sigma", "provenance"] {
        let name = chunk.file_name().unwrap().to_str().unwrap();
        let name = if array == "provenance" {
            name.strip_suffix(".0").unwrap()
        } else {
            name
        };
        fs::remove_file(brass.join("brdf.zarr").join(array).join(name)).unwrap();
    }
    refuses(&with(&brass), "", 2, &[text(&brass), "measured samples", "found"]);
    assert_eq!(rows(&at, &[]), row);

    let catalogue = at.join("collection.sqlite");
    fs::write(
        &catalogue,
        "not a catalogue, but a text that is long enough to be one of the pages of it",
    )
    .unwrap();
    for command in ["add", "status", "query"] {
        refuses(
            &["collection", command, text(&at)],
            "",
            2,
            &[text(&catalogue), "catalogue of this program"],
        );
    }
}

#[test]
fn a_query_finds_sorts_and_can_do_nothing_else() {
    let scratch = tempfile::tempdir().unwrap();
    let at = scratch.path().join("c");
    run(&["collection", "init", text(&at)], "").done();
    let queue = scratch.path().join("samples.csv");
    fs::write(
        &queue,
        "name,sample,sample_name\nb,ward:brass,\nw,lambert:0.5,\"tile, <b>white</b>\"\n",
    )
    .unwrap();
    let told = run(&queued(&queue, &at, &["--json"]), "").object();
    assert_eq!(told["measured"], serde_json::json!(["b", "w"]), "{told}");
    let paths = |more: &[&str]| {
        rows(&at, more)
            .iter()
            .map(|row| row["path"].as_str().unwrap().to_owned())
            .collect::<Vec<_>>()
    };
    assert_eq!(paths(&["--sort", "path desc"]), ["w", "b"]);
    assert_eq!(
        paths(&["--where", "sample like 'ward%' and not coverage is null"]),
        ["b"]
    );
    assert_eq!(paths(&["--where", "sigma < 0"]), [""; 0]);
    let table = run(
        &[
            "collection",
            "query",
            text(&at),
            "--format",
            "csv",
            "--sort",
            "path desc",
        ],
        "",
    );
    assert!(
        table
            .done()
            .lines()
            .nth(1)
            .unwrap()
            .starts_with("w,\"tile, <b>white</b>\",rcg-1-16bit,"),
        "{table:?}"
    );

    let before = files(&at);
    for bad in [
        "1; DELETE FROM measurements",
        "1) UNION SELECT 1 --",
        "thumbnail = 1",
        "path = ",
        "albeto > 1",
    ] {
        refuses(
            &["collection", "query", text(&at), "--where", bad],
            "",
            2,
            &["--where"],
        );
    }
    refuses(
        &["collection", "query", text(&at), "--sort", "albeto"],
        "",
        2,
        &["--sort", "albeto"],
    );
    assert!(files(&at) == before);
}

#[test]
fn a_page_holds_all_and_leads_to_the_reports() {
    let scratch = tempfile::tempdir().unwrap();
    let at = scratch.path().join("c");
    run(&["collection", "init", text(&at)], "").done();
    let mut measure = quick(&at.join("w w"));
    measure.extend(["--sample-name", "tile, <b>white</b>"].map(str::to_owned));
    run(&measure, "").done();
    run(&["collection", "add", text(&at)], "").done();
    let page = scratch.path().join("page.html");
    run(&["collection", "page", text(&at), "--out", text(&page)], "").done();
    let html = fs::read_to_string(&page).unwrap();
    assert!(
        html.contains("./c/w%20w/report.html") && html.contains("\\u003cb>white"),
        "{html}"
    );
    assert_eq!(html.matches("\"picture\":\"iVBOR").count(), 1);
    assert!(
        !html.contains("src=\"") && !html.contains("http"),
        "the page needs something else"
    );
}

#[test]
fn a_queue_goes_on_where_it_ended_and_refuses_what_it_cannot_do_before_it_begins() {
    let scratch = tempfile::tempdir().unwrap();
    let (queue, out) = (scratch.path().join("samples.toml"), scratch.path().join("all"));
    let measure = |more: &[&str]| queued(&queue, &out, more);
    for (list, parts) in [
        ("", &["samples.toml", "[[sample]]"][..]),
        (
            "[[sample]]\nname = \"a\"\ncolour = 1\n",
            &["samples.toml", "colour"],
        ),
        ("[[sample]]\nname = \"../a\"\n", &["sample 1: name", "`../a`"]),
        (
            "[[sample]]\nname = \"a\"\n[[sample]]\nname = \"A\"\n",
            &["sample 2: name", "another"],
        ),
        ("[[sample]]\nname = \"a\"\nrig = \"rcg-9\"\n", &["rcg-9"]),
    ] {
        fs::write(&queue, list).unwrap();
        refuses(&measure(&[]), "", 2, parts);
        assert!(!out.exists());
    }
    // The second cannot be measured: the first is kept.
    fs::write(
        &queue,
        "[[sample]]\nname = \"a\"\n[[sample]]\nname = \"b\"\nsample = \"ward:gold\"\n",
    )
    .unwrap();
    refuses(&measure(&[]), "", 2, &["ward:gold"]);
    let first = files(&out.join("a"));
    assert!(first.contains_key(Path::new("report.html")));
    fs::write(
        &queue,
        "[[sample]]\nname = \"a\"\n[[sample]]\nname = \"b\"\nsample = \"lambert\"\nrig = \"rcg-2\"\n",
    )
    .unwrap();
    let told = run(&measure(&["--json"]), "").object();
    assert_eq!(
        (&told["kept"], &told["measured"]),
        (&1.into(), &serde_json::json!(["b"])),
        "{told}"
    );
    assert!(files(&out.join("a")) == first);
    assert!(
        fs::read_to_string(out.join("b/plan.toml"))
            .unwrap()
            .contains("rcg-2")
    );
    // What is finished is no other sample.
    fs::write(&queue, "[[sample]]\nname = \"a\"\nsample = \"lambert\"\n").unwrap();
    refuses(&measure(&[]), "", 2, &[text(&out.join("a")), "sample"]);
    refuses(
        &["measure", "--yes", "--out", text(&scratch.path().join("x"))],
        "",
        2,
        &["--yes", "--queue"],
    );
}
