//! `plot`, `study` and scenes of `render`: what cannot be drawn or studied is refused, and nothing is left.

use crate::command::{refuses, text};

#[test]
fn a_study_that_cannot_be_is_refused() {
    let scratch = tempfile::tempdir().unwrap();
    let out = scratch.path().join("study");
    for (arguments, parts) in [
        (["--intervals", "10,7"], ["intervals", "divides 90", "found 7"]),
        (["--intervals", "0"], ["intervals", "divides 90", "found 0"]),
        (
            ["--coarse-intervals", "11"],
            ["intervals", "divides 90", "found 11"],
        ),
        (["--intervals", "10,x"], ["--intervals", "expected", "`x`"]),
        (["--image-sizes", "32,4"], ["image-sizes", "8 to 4096", "found 4"]),
        (
            ["--image-sizes", "100000"],
            ["image-sizes", "8 to 4096", "found 100000"],
        ),
        (
            ["--interpolation", "cubic"],
            ["--interpolation", "expected direct", "`cubic`"],
        ),
        (
            ["--interpolation", "blended"],
            ["interval 1° with 256 pixels", "at most 8 GB", "found 25 GB"],
        ),
        (["--grid", "hexagonal"], ["--grid", "theta-phi", "`hexagonal`"]),
        (["--exposure", "0"], ["exposure", "positive", "found 0"]),
        (["--exposure", "nan"], ["exposure", "positive", "found NaN"]),
        (["--sample", "phong"], ["model", "expected lambert", "'phong'"]),
        (
            ["--sample", "no/such.bsdf"],
            ["no/such.bsdf", "expected a readable file", "found"],
        ),
    ] {
        let all = [&["study", "--out", text(&out)][..], &arguments].concat();
        refuses(&all, "", 2, &parts);
        assert!(!out.exists(), "{arguments:?}");
    }
}

#[test]
fn a_study_that_has_no_place_fails_with_the_path() {
    let scratch = tempfile::tempdir().unwrap();
    let file = scratch.path().join("notes.txt");
    std::fs::write(&file, "mine").unwrap();
    let small = [
        "study",
        "--sample",
        "lambert",
        "--intervals",
        "45",
        "--coarse-intervals",
        "45",
        "--image-sizes",
        "8",
        "--out",
    ];
    refuses(&[&small[..], &[text(&file)]].concat(), "", 1, &[text(&file)]);
    assert_eq!(std::fs::read_to_string(&file).unwrap(), "mine");
}

#[test]
fn a_plot_of_what_is_not_there_is_refused() {
    let scratch = tempfile::tempdir().unwrap();
    let out = |name: &str| text(&scratch.path().join(name)).to_owned();
    let plot = |arguments: &[&str], code, parts: &[&str]| {
        refuses(&[&["plot"][..], arguments].concat(), "", code, parts);
        assert_eq!(
            std::fs::read_dir(scratch.path()).unwrap().count(),
            0,
            "{arguments:?}"
        );
    };
    for name in ["plot.bmp", "plot", ".svg"] {
        plot(
            &["satin", "--out", &out(name)],
            2,
            &[&out(name), "expected", ".svg, .pdf, .png or .csv"],
        );
    }
    for name in ["none/plot.svg", "none/plot.png", "none/plot.csv"] {
        plot(&["satin", "--out", &out(name)], 1, &["none/plot"]);
    }
    let svg = out("plot.svg");
    plot(
        &["no/such.bsdf", "--out", &svg],
        2,
        &["no/such.bsdf", "expected", "found"],
    );
    plot(
        &["satin", "--out", &svg, "--incident", "95,0"],
        2,
        &["--incident", "below 90", "found 95"],
    );
    plot(
        &["satin", "--out", &svg, "--incident", "30"],
        2,
        &["--incident", "expected two angles", "`30`"],
    );
    plot(
        &["satin", "--out", &svg, "--theta-r", "90"],
        2,
        &["--theta-r", "below 90", "found 90"],
    );
    plot(
        &["satin", "--out", &svg, "--azimuths", "3"],
        2,
        &["--azimuths", "expected", "`3`"],
    );
}

#[test]
fn maps_and_lobes_that_cannot_be_are_refused() {
    let scratch = tempfile::tempdir().unwrap();
    let svg = scratch.path().join("map.svg");
    for (arguments, parts) in [
        (&["--show", "error"][..], &["--show", "--hemisphere"][..]),
        (
            &["--reference", "lambert", "--azimuths", "8"],
            &["--reference", "--hemisphere"],
        ),
        (&["--polar", "--azimuths", "8"], &["--polar", "--in-plane"]),
        (&["--hemisphere", "--in-plane"], &["--in-plane", "--hemisphere"]),
        (
            &["--hemisphere", "--show", "error"],
            &["--show error", "--reference", "found none"],
        ),
        (
            &["--hemisphere", "--reference", "lambert"],
            &["--reference", "--show error", "found lambert"],
        ),
        (
            &[
                "--hemisphere",
                "--show",
                "error",
                "--reference",
                "lambert",
                "--log",
            ],
            &["--log", "found --show error"],
        ),
        (
            &["--hemisphere", "--show", "uncertainty"],
            &["--show uncertainty", "brdf.zarr", "found satin"],
        ),
        (
            &["--hemisphere", "--show", "error", "--reference", "no/such.bsdf"],
            &["no/such.bsdf", "expected", "found"],
        ),
    ] {
        refuses(
            &[&["plot", "satin", "--out", text(&svg)][..], arguments].concat(),
            "",
            2,
            parts,
        );
        assert!(!svg.exists(), "{arguments:?}");
    }
}

#[test]
fn a_scene_that_is_none_is_refused() {
    let scratch = tempfile::tempdir().unwrap();
    let picture = scratch.path().join("cloth.png");
    let render = ["render", "satin", "--out", text(&picture)];
    for (arguments, parts) in [
        (
            &["--scene", "teapot"][..],
            ["--scene", "sphere or corrugated or both", "`teapot`"],
        ),
        (
            &["--scene", "corrugated", "--tilt", "80"],
            ["--tilt", "0 to 75", "found 80"],
        ),
        (&["--tilt", "nan"], ["--tilt", "0 to 75", "found NaN"]),
        (
            &["--turn", "30"],
            ["--turn", "expected --environment", "found 30"],
        ),
        (
            &["--environment", "a.hdr", "--scene", "torus", "--tilt", "9"],
            ["--tilt", "--scene corrugated", "found 9"],
        ),
        (
            &["--environment", "a.hdr", "--turn", "361"],
            ["--turn", "-360 to 360", "found 361"],
        ),
        (
            &["--environment", "a.hdr", "--light", "9,9"],
            ["--environment", "--light", "cannot"],
        ),
        (&["--environment", "a.hdr"], ["a.hdr", "Radiance", "found"]),
        (&["--colours", "no.csv"], ["no.csv", "expected a table", "found"]),
        (
            &[
                "--size", "8192", "--scene", "both", "--light", "0,0", "--light", "9,9", "--light", "1,1",
            ],
            ["--size 8192", "expected at most", "found 6 pictures"],
        ),
    ] {
        refuses(&[&render[..], arguments].concat(), "", 2, &parts);
        assert!(!picture.exists(), "{arguments:?}");
    }
}

#[test]
fn a_page_that_cannot_be_made_is_refused_and_leaves_nothing() {
    let scratch = tempfile::tempdir().unwrap();
    let out = scratch.path().join("paper");
    let paper = ["paper", "--out", text(&out)];
    refuses(
        &[&paper[..], &["--step", "7"]].concat(),
        "",
        2,
        &["step", "divides 90", "found 7"],
    );
    refuses(
        &[&paper[..], &["--image-size", "4"]].concat(),
        "",
        2,
        &["image-size", "8 to 4096", "found `4`"],
    );
    assert!(!out.exists());
    std::fs::write(scratch.path().join("thesis.tex"), "all of it").unwrap();
    let parts = [
        text(scratch.path()),
        "expected a new or empty directory",
        "found one with files",
    ];
    refuses(&["paper", "--out", text(scratch.path())], "", 2, &parts);
    assert_eq!(std::fs::read_dir(scratch.path()).unwrap().count(), 1);
}
