//! `plot`, `study` and scenes of `render`: what they draw and say.

use std::fs;

use crate::answers::number;
use crate::command::{refuses, run, text};

#[test]
#[ignore = "long: ./test.sh full runs it"]
fn a_study_writes_what_it_says() {
    let scratch = tempfile::tempdir().unwrap();
    let out = scratch.path().join("study");
    let sizes = [
        "--intervals",
        "30,10",
        "--image-sizes",
        "16,48",
        "--coarse-intervals",
        "45,30",
    ];
    let arguments = [
        &["study", "--exposure", "2", "--json", "--out", text(&out)][..],
        &sizes,
    ]
    .concat();
    let answer = run(&arguments, "").object();
    assert_eq!(
        (number(&answer, "exposure"), number(&answer, "sphere_px")),
        (2.0, 160.0)
    );
    let rows = answer["rows"].as_array().unwrap();
    let whole = |name: &str| {
        rows.iter()
            .map(|row| row[name].as_f64().unwrap())
            .collect::<Vec<_>>()
    };
    assert_eq!(whole("interval_deg"), [30.0, 30.0, 10.0, 10.0]);
    assert_eq!(whole("image_size"), [16.0, 48.0, 16.0, 48.0]);
    assert_eq!(whole("captures"), [36.0, 36.0, 324.0, 324.0]);
    let y = whole("psnr_y_db");
    assert!(y[3] > y[1] + 3.0, "finer intervals are better: {y:?}");
    for row in rows {
        assert_eq!(row["interpolation"], "direct");
        assert!(
            row["psnr_cb_db"].is_null() && row["psnr_cr_db"].is_null(),
            "brass is grey: {row}"
        );
    }
    let methods = answer["methods"].as_array().unwrap();
    assert!(methods.iter().all(|row| row["image_size"] == 96), "{methods:?}");
    let captures: Vec<_> = methods
        .iter()
        .filter(|row| row["interpolation"] == "direct")
        .collect();
    assert_eq!(
        (&captures[0]["captures"], &captures[1]["captures"]),
        (&16.into(), &36.into())
    );
    assert_eq!(
        fs::read_to_string(out.join("methods.csv"))
            .unwrap()
            .lines()
            .count(),
        1 + methods.len()
    );
    let table = fs::read_to_string(out.join("study.csv")).unwrap();
    let mut lines = table.lines();
    assert_eq!(
        lines.next().unwrap(),
        "interval_deg,image_size,captures,interpolation,psnr_y_db,psnr_cb_db,psnr_cr_db,exact,scored_share"
    );
    assert!(lines.next().unwrap().starts_with("30,16,36,direct,"));
    assert_eq!(lines.count(), 3);
    let file: serde_json::Value =
        serde_json::from_str(&fs::read_to_string(out.join("study.json")).unwrap()).unwrap();
    assert_eq!(file["rows"], answer["rows"]);
    for chart in ["psnr-interval", "psnr-image-size", "psnr-captures"] {
        let svg = fs::read_to_string(out.join(chart).with_extension("svg")).unwrap();
        assert!(svg.starts_with("<svg") && svg.contains("PSNR"), "{chart}");
        assert!(
            image::open(out.join(chart).with_extension("png"))
                .unwrap()
                .width()
                >= 1000
        );
    }
    let comparison = image::open(out.join("comparison.png")).unwrap();
    assert_eq!(comparison.width(), 3 * 256);
}

#[test]
fn a_plot_has_a_curve_for_each_incident_direction() {
    let scratch = tempfile::tempdir().unwrap();
    let table = scratch.path().join("satin.csv");
    let lights = [
        "--incident",
        "40,10",
        "--incident",
        "60,20",
        "--theta-r",
        "50",
        "--azimuths",
        "36",
    ];
    let answer = run(
        &[&["plot", "satin", "--json", "--out", text(&table)][..], &lights].concat(),
        "",
    )
    .object();
    assert_eq!(number(&answer, "without_value"), 0.0);
    let rows = fs::read_to_string(&table).unwrap();
    assert_eq!(rows.lines().count(), 1 + 2 * 37);
    // The same numbers as `value` gives.
    let row = rows.lines().nth(5).unwrap();
    let cells: Vec<&str> = row.split(',').collect();
    let value = run(
        &["value", "satin"],
        &format!("{} {} {} {}\n", cells[0], cells[1], cells[2], cells[3]),
    );
    assert_eq!(value.done().split_whitespace().next().unwrap(), cells[4]);
    for name in ["satin.svg", "satin.png"] {
        let out = scratch.path().join(name);
        run(&["plot", "satin", "--out", text(&out)], "").done();
        assert!(fs::metadata(out).unwrap().len() > 1000);
    }
}

#[test]
fn several_brdfs_stand_in_one_plot_of_the_plane_of_incidence() {
    let scratch = tempfile::tempdir().unwrap();
    let out = scratch.path().join("m");
    crate::command::quick_measurement(&out);
    let table = scratch.path().join("plane.csv");
    let plane = ["--in-plane", "--incident", "45,0", "--log", "--out", text(&table)];
    let sources = ["plot", text(&out), "ward:brass"];
    let answer = run(&[&sources[..], &plane, &["--json"]].concat(), "").object();
    assert_eq!(answer["in_plane"], true);
    let content = fs::read_to_string(&table).unwrap();
    assert_eq!(content.lines().count(), 1 + 2 * 357);
    assert!(content.starts_with("source,theta_i_deg,"), "{content}");
    // θr = 30° on the mirror's side, as `value` has it.
    let row = content
        .lines()
        .find(|row| row.starts_with("\"ward:brass\",45,0,30,180,"))
        .unwrap();
    let value = run(&["value", "ward:brass"], "45 0 30 180\n");
    assert_eq!(row.split(',').nth(5), value.done().split_whitespace().next());
    assert!(row.ends_with(",,,,"), "a model states no uncertainty: {row}");
    let measured = content
        .lines()
        .find(|row| row.contains("/m\",45,0,60,180,"))
        .unwrap();
    assert!(measured.ends_with(",measured"), "{measured}");
    refuses(
        &[&sources[..], &plane, &["--theta-r", "20"]].concat(),
        "",
        2,
        &["--theta-r", "--in-plane"],
    );
    let picture = scratch.path().join("plane.svg");
    run(
        &[&sources[..], &["--in-plane", "--out", text(&picture)]].concat(),
        "",
    )
    .done();
    // What is uncertain is shaded.
    assert!(fs::read_to_string(&picture).unwrap().contains("<polygon"));
}

#[test]
fn a_measured_plot_has_gaps_where_the_mirror_has_its_hole() {
    let scratch = tempfile::tempdir().unwrap();
    let out = scratch.path().join("m");
    crate::command::quick_measurement(&out);
    let (brdf, table) = (out.join("brdf.zarr"), scratch.path().join("m.csv"));
    let arguments = [
        "plot",
        text(&brdf),
        "--out",
        text(&table),
        "--theta-r",
        "15",
        "--json",
    ];
    let answer = run(&arguments, "").object();
    assert_eq!(number(&answer, "without_value"), 3.0 * 361.0);
    let rows = fs::read_to_string(&table).unwrap();
    assert!(
        rows.lines().skip(1).all(|row| row.ends_with(",,,hole,,,,")),
        "{}",
        rows.lines().nth(1).unwrap()
    );
}

#[test]
fn maps_of_the_hemisphere_show_values_their_uncertainty_and_error_and_what_is_missing() {
    let scratch = tempfile::tempdir().unwrap();
    let out = scratch.path().join("m");
    crate::command::quick_measurement(&out);
    let (brdf, table) = (out.join("brdf.zarr"), scratch.path().join("map.csv"));
    let rows = |show: &[&str]| -> Vec<[String; 3]> {
        let plot = [
            "plot",
            text(&brdf),
            "--hemisphere",
            "--incident",
            "45,30",
            "--out",
            text(&table),
        ];
        let answer = run(&[&plot[..], show, &["--json"]].concat(), "").object();
        let rows: Vec<[String; 3]> = fs::read_to_string(&table)
            .unwrap()
            .lines()
            .skip(1)
            .map(|row| {
                row.split(',')
                    .map(str::to_owned)
                    .collect::<Vec<_>>()
                    .split_off(5)
                    .try_into()
                    .unwrap()
            })
            .collect();
        let without = rows.iter().filter(|row| row[0].is_empty()).count();
        assert_eq!(number(&answer, "without_value"), without as f64);
        rows
    };
    let values = rows(&[]);
    // The mirror of the rig has a hole, in which a tenth of the hemisphere lies.
    let hole = values.iter().filter(|row| row[1] == "hole").count();
    assert!(
        (0.05..0.25).contains(&(hole as f64 / values.len() as f64)),
        "{hole}"
    );
    let of =
        |rows: &[[String; 3]]| -> Vec<f64> { rows.iter().filter_map(|row| row[0].parse().ok()).collect() };
    assert!(
        of(&values).len() > 500
            && values
                .iter()
                .any(|row| row[2] == "measured" || row[2] == "merged")
    );
    let uncertain = of(&rows(&["--show", "uncertainty"]));
    assert!(uncertain.iter().all(|percent| *percent > 0.0) && uncertain.len() == of(&values).len());
    // Against a white standard the error says what the values are.
    let errors = of(&rows(&["--show", "error", "--reference", "lambert:1"]));
    for (value, error) in of(&values).into_iter().zip(errors) {
        assert!(
            (value * std::f64::consts::PI - 1.0 - error / 100.0).abs() < 1e-4,
            "{value} {error}"
        );
    }
    for ending in ["svg", "png", "pdf"] {
        let picture = scratch.path().join(format!("map.{ending}"));
        run(
            &[
                "plot",
                "lambert",
                "--hemisphere",
                "--incident",
                "45,30",
                "--out",
                text(&picture),
            ],
            "",
        )
        .done();
        assert!(fs::metadata(&picture).unwrap().len() > 2000, "{ending}");
    }
}

#[test]
fn a_sphere_in_light_from_everywhere_is_that_light_in_the_colours_of_a_chart() {
    let scratch = tempfile::tempdir().unwrap();
    let at = |name: &str| text(&scratch.path().join(name)).to_owned();
    let map = |width: usize, pixel: [u8; 4]| {
        let head = format!("#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 8 +X {width}\n");
        [head.into_bytes(), pixel.repeat(8 * width)].concat()
    };
    // Radiance 0.5.
    fs::write(at("even.hdr"), map(16, [64, 64, 64, 129])).unwrap();
    fs::write(at("square.hdr"), map(8, [64, 64, 64, 129])).unwrap();
    fs::write(at("dark.hdr"), map(16, [0; 4])).unwrap();
    // Red and blue of this camera are those of the screen the other way round.
    let chart = "r,g,b,sR,sG,sB\n1,0,0,0,0,255\n0,1,0,0,255,0\n0,0,1,255,0,0\n1,1,1,255,255,255\n";
    fs::write(at("chart.csv"), chart).unwrap();
    let render = ["render", "lambert:1", "--size", "16", "--exposure", "1", "--out"];
    let picture = at("a.png");
    let around = at("even.hdr");
    let arguments = [
        &picture[..],
        "--environment",
        &around,
        "--colours",
        &at("chart.csv"),
        "--json",
    ];
    let answer = run(&[&render[..], &arguments].concat(), "").object();
    assert!(answer["environment"]["largest_error"].as_f64().unwrap() < 1e-5);
    assert!(answer["colours"]["delta_e"][1].as_f64().unwrap() < 1e-3);
    let matrix = &answer["colours"]["matrix"];
    assert!(matrix[0][2].as_f64().unwrap() > 0.999 && matrix[0][0].as_f64().unwrap().abs() < 1e-6);
    // sRGB of 0.5 is 188.
    let image = image::open(&picture).unwrap().into_rgb8();
    assert_eq!(image.get_pixel(8, 8).0, [188; 3]);
    // Objects that hide a part of it from themselves are darker there.
    for (scene, size) in [("torus", [16, 16]), ("corrugated", [16, 16]), ("both", [16, 32])] {
        let answer = run(&[&render[..], &arguments, &["--scene", scene]].concat(), "").object();
        assert!(
            answer["environment"]["largest_error"].as_f64().unwrap() < 0.05,
            "{scene}: {answer}"
        );
        let image = image::open(&picture).unwrap().into_rgb8();
        assert_eq!(image.dimensions(), size.into());
        let greens = || image.pixels().map(|pixel| pixel.0[1]).filter(|green| *green > 26);
        let [least, most] = [greens().min().unwrap(), greens().max().unwrap()];
        assert!(
            (100..185).contains(&least) && (185..=188).contains(&most),
            "{scene}: {least} {most}"
        );
    }
    for (name, parts) in [
        ("square.hdr", ["size", "twice as wide as high", "8 × 8"]),
        ("dark.hdr", ["radiance", "some light", "none"]),
        ("chart.csv", ["file", "Radiance", ".csv"]),
    ] {
        let arguments = [&picture[..], "--environment", &at(name)];
        refuses(
            &[&render[..], &arguments].concat(),
            "",
            2,
            &[&[name][..], &parts].concat(),
        );
    }
    for (chart, part) in [
        ("r,g,b\n1,1,1\n", "columns r,g,b"),
        ("r,g,b,X,Y,Z\n1,1,1,1,1,1\n", "at least 4 patches"),
        ("r,g,b,X,Y,Z\n1,1,x,1,1,1\n", "line 2"),
        ("r,g,b,X,Y,Z\n1,1,1,95,100,108\n", "Y = 1"),
    ] {
        fs::write(at("bad.csv"), chart).unwrap();
        let arguments = [&picture[..], "--colours", &at("bad.csv")];
        refuses(
            &[&render[..], &arguments].concat(),
            "",
            2,
            &["bad.csv", part, "found"],
        );
    }
}

#[test]
fn cloth_in_folds_is_drawn_beside_the_sphere() {
    let scratch = tempfile::tempdir().unwrap();
    let picture = scratch.path().join("cloth.png");
    for (scene, width, height) in [("corrugated", 192, 64), ("both", 192, 128), ("sphere", 192, 64)] {
        let lights = ["--light", "45,90", "--light", "60,0", "--light", "70,180"];
        let arguments = [
            "render",
            "velvet",
            "--out",
            text(&picture),
            "--size",
            "64",
            "--scene",
            scene,
        ];
        run(&[&arguments[..], &lights].concat(), "").done();
        assert_eq!(
            image::open(&picture).unwrap().into_rgb8().dimensions(),
            (width, height),
            "{scene}"
        );
    }
    // A sheet that is lit from the right has its left slopes in shadow.
    let sheet = [
        "render",
        "lambert",
        "--out",
        text(&picture),
        "--size",
        "256",
        "--scene",
        "corrugated",
    ];
    run(&[&sheet[..], &["--light", "70,0", "--tilt", "0"]].concat(), "").done();
    let image = image::open(&picture).unwrap().into_luma8();
    let black = (0..256).filter(|&x| image.get_pixel(x, 128).0[0] == 0).count();
    assert!((60..200).contains(&black), "{black}");
}
