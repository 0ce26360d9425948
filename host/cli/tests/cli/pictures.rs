//! `patterns` and `render`: pictures of the asked size that show what they should.

use std::fs;

use crate::answers::number;
use crate::command::{quick_measurement, run, text};

#[test]
fn patterns_light_as_many_pixels_as_the_table_says() {
    let scratch = tempfile::tempdir().unwrap();
    let out = scratch.path().join("patterns");
    let answer = run(&["patterns", "--out", text(&out), "--step", "22.5", "--json"], "").object();
    assert_eq!(answer["out"], text(&out));
    assert_eq!(
        (number(&answer, "width_px"), number(&answer, "height_px")),
        (1024.0, 768.0)
    );

    let table = fs::read_to_string(out.join("patterns.csv")).unwrap();
    let mut rows = table.lines();
    let header: Vec<&str> = rows.next().unwrap().split(',').collect();
    assert_eq!(header[..4], ["index", "theta_deg", "phi_deg", "pixels"]);
    let mut patterns = 0;
    for row in rows {
        let cells: Vec<&str> = row.split(',').collect();
        assert_eq!(cells.len(), header.len(), "{row}");
        let index: usize = cells[0].parse().unwrap();
        let image = image::open(out.join(format!("pattern-{index:05}.png")))
            .unwrap()
            .into_luma8();
        assert_eq!(image.dimensions(), (1024, 768));
        assert!(
            image.pixels().all(|pixel| matches!(pixel.0[0], 0 | 255)),
            "black and white"
        );
        let lit = image.pixels().filter(|pixel| pixel.0[0] == 255).count();
        assert_eq!(lit, cells[3].parse::<usize>().unwrap(), "{row}");
        assert!(lit > 0);
        patterns += 1;
    }
    assert_eq!(number(&answer, "patterns"), f64::from(patterns));
    // The innermost ring, at 11.25°, is in the hole; two of the others' 48 directions meet the wire at most.
    assert!((45..=48).contains(&patterns), "{patterns}");
    let files = fs::read_dir(&out).unwrap().count();
    assert_eq!(files, patterns as usize + 1);
}

#[test]
fn sheets_hold_the_patterns_where_the_table_says() {
    let scratch = tempfile::tempdir().unwrap();
    let [alone, sheets] = ["alone", "sheets"].map(|name| scratch.path().join(name));
    run(&["patterns", "--out", text(&alone), "--step", "22.5"], "").done();
    let arguments = [
        "patterns",
        "--out",
        text(&sheets),
        "--step",
        "22.5",
        "--sheets",
        "grb",
    ];
    run(&arguments, "").done();
    let table = fs::read_to_string(sheets.join("patterns.csv")).unwrap();
    assert!(table.lines().next().unwrap().ends_with(",sheet,plane"), "{table}");
    let read = |name: String| image::open(scratch.path().join(name)).unwrap().into_rgb8();
    for row in table.lines().skip(1).step_by(7) {
        let cells: Vec<usize> = row.split(',').filter_map(|cell| cell.parse().ok()).collect();
        let [index, .., sheet, plane] = cells[..] else {
            panic!("{row}")
        };
        let sheet = read(format!("sheets/sheet-{sheet:05}.png"));
        let pattern = read(format!("alone/pattern-{index:05}.png"));
        let colour = [1, 0, 2][plane / 8];
        let is_lit = |pixel: &image::Rgb<u8>| pixel.0[colour] >> (plane % 8) & 1 != 0;
        assert!(
            sheet
                .pixels()
                .map(is_lit)
                .eq(pattern.pixels().map(|pixel| pixel.0[0] != 0)),
            "{row}"
        );
    }
    let files = fs::read_dir(&sheets).unwrap().count();
    assert_eq!(files, (table.lines().count() - 1).div_ceil(24) + 1);
}

#[test]
fn a_sphere_is_as_large_as_asked_and_lit_from_where_it_should() {
    let scratch = tempfile::tempdir().unwrap();
    let picture = scratch.path().join("sphere.png");
    for size in [8, 64, 201] {
        let arguments = [
            "render",
            "lambert:0.5",
            "--out",
            text(&picture),
            "--json",
            "--size",
        ];
        let size_text = size.to_string();
        let answer = run(&[&arguments[..], &[&size_text]].concat(), "").object();
        assert_eq!(number(&answer, "size"), f64::from(size));
        assert!(number(&answer, "exposure") > 0.0);
        assert_eq!(
            image::open(&picture).unwrap().into_rgb8().dimensions(),
            (size, size)
        );
    }
    let brightness = |light: &str| {
        let arguments = [
            "render",
            "lambert:0.5",
            "--out",
            text(&picture),
            "--size",
            "64",
            "--light",
            light,
        ];
        run(&arguments, "").done();
        let image = image::open(&picture).unwrap().into_luma8();
        let level = |x, y| image.get_pixel(x, y).0[0];
        [level(32, 8), level(56, 32), level(32, 56), level(8, 32)]
    };
    // Azimuth 90 is above: top, right, bottom, left.
    let [top, right, bottom, left] = brightness("60,90");
    assert!(
        top > right && right > bottom && left > bottom && bottom == 0,
        "{top} {right} {bottom} {left}"
    );
    let [top, right, bottom, left] = brightness("60,0");
    assert!(
        right > top && top > left && bottom > left && left == 0,
        "{top} {right} {bottom} {left}"
    );
}

#[test]
fn a_measurement_is_rendered() {
    let scratch = tempfile::tempdir().unwrap();
    let out = scratch.path().join("out");
    quick_measurement(&out);
    let picture = scratch.path().join("sphere.png");
    let brdf = out.join("brdf.zarr");
    let told = run(
        &["render", text(&brdf), "--out", text(&picture), "--size", "100"],
        "",
    );
    // Where φ = 0 lies stands in the file, too.
    let zero = "on the sample, φ = 0 is +x of the sample holder";
    assert!(told.done().contains(zero));
    for picture in [&picture, &out.join("figures/sphere.png")] {
        let bytes = fs::read(picture).unwrap();
        assert!(bytes.windows(zero.len()).any(|window| window == zero.as_bytes()));
    }
    assert_eq!(
        image::open(&picture).unwrap().into_rgb8().dimensions(),
        (100, 100)
    );
}

#[test]
fn an_exposure_or_light_that_is_none_is_refused() {
    let scratch = tempfile::tempdir().unwrap();
    let picture = scratch.path().join("sphere.png");
    for (name, value) in [
        ("--exposure", "0"),
        ("--exposure", "nan"),
        ("--exposure", "inf"),
        ("--light", "45"),
        ("--light", "200,0"),
        ("--light", "45,nan"),
        ("--size", "7"),
        ("--size", "100000"),
    ] {
        let arguments = ["render", "lambert", "--out", text(&picture), name, value];
        crate::command::refuses(
            &arguments,
            "",
            2,
            &[
                name,
                "expected",
                "found",
                if value == "nan" { "N" } else { value },
            ],
        );
    }
    assert!(!picture.exists());
}
