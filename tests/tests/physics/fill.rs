//! Captures at several tilts, filled into one BRDF without gaps.

use std::path::{Path, PathBuf};

use rcg::assemble::fill::{FillError, Filled, Options, Way, fill};
use rcg::base::progress::Silent;
use rcg::brdf::Brdf;
use rcg::hemisphere::direction::from_degrees;
use rcg::hemisphere::incident::Grid;
use rcg::instrument::rig::Rig;
use rcg::judge::evaluate::evaluate;
use rcg::measure::{assemble_measurement, capture, prepare};
use rcg::plan::{Request, Virtual};
use rcg::virtual_rig::Truth;
use rcg::virtual_rig::setup::Setup;

const SAMPLE: &str = "ggx:satin";
/// Captures that leave hardly a pair of directions in a hole, a wire or beyond a rim in all of them: leaning away from the
/// wire by more than the hole is wide, with the sample turned one way and the other. Two tilts would do for infinitely small
/// pixels; those that an edge cuts take no part, and the third closes what they leave.
const TILTS: [Option<&str>; 4] = [None, Some("51:84:40"), Some("52:100:-44"), Some("54:45:60")];

fn measured(
    sample: &str,
    dir: &Path,
    rig: &Rig,
    step_deg: f64,
    truth: Option<&Truth>,
    tilt: Option<&str>,
    seed: u64,
) -> PathBuf {
    let truth = truth.map(|truth| {
        let path = dir.with_extension("toml");
        std::fs::write(&path, truth.to_toml()).unwrap();
        path.display().to_string()
    });
    let request = Request {
        grid: Grid::ThetaPhi { step_deg },
        image_size: 48,
        tilt: tilt.map(|tilt| tilt.parse().unwrap()),
        ..Request::default()
    };
    let setup = Setup::from(Virtual {
        sample: sample.to_owned(),
        truth,
        seed,
        ..Virtual::default()
    });
    let (job, measurement) = prepare(dir, rig, request, &setup, &Silent).unwrap();
    capture(&measurement, &job, &Silent).unwrap();
    assemble_measurement(&measurement, &Silent).unwrap();
    measurement.path("brdf.zarr")
}

fn share(filled: &Filled, provenance: &str) -> f64 {
    filled
        .shares
        .iter()
        .filter(|share| share.provenance == provenance)
        .map(|share| share.share)
        .sum()
}

#[test]
#[ignore = "long: ./test.sh full runs it"]
fn tilts_close_the_hole_and_every_origin_is_judged_by_itself() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let rig = Rig::load("rcg-1-16bit").unwrap();
    let files: Vec<PathBuf> = TILTS
        .iter()
        .enumerate()
        .map(|(index, tilt)| {
            measured(
                SAMPLE,
                &at(&index.to_string()),
                &rig,
                5.0,
                None,
                *tilt,
                index as u64,
            )
        })
        .collect();
    let out = at("whole.brdf.zarr");
    let filled = fill(&files[0], &files[1..], &out, &Options::default(), &Silent).unwrap();
    let seen = share(&filled, "measured") + share(&filled, "merged");
    println!(
        "measured or merged: {seen:.4} with three tilts; {:?}",
        filled.shares
    );
    assert!(seen >= 0.99, "{seen}");
    assert!(share(&filled, "missing") < 1e-9);
    for alignment in &filled.alignments {
        assert!(
            (alignment.scale - 1.0).abs() < 4.0 * alignment.scale_uncertainty + 2e-3,
            "{alignment:?}"
        );
    }

    // One capture alone has to lean on the model, and says so.
    let alone = at("alone.brdf.zarr");
    let filled = fill(&files[0], &[], &alone, &Options::default(), &Silent).unwrap();
    assert!(
        share(&filled, "modelled") > 0.15 && share(&filled, "interpolated") > 0.0,
        "{:?}",
        filled.shares
    );
    let sample = rcg::brdf::sample::parse(SAMPLE).unwrap();
    for path in [&alone, &out] {
        let found = evaluate(
            &Brdf::open(path).unwrap(),
            Some((SAMPLE, sample.as_ref())),
            &|_| {},
        )
        .unwrap();
        assert!(
            (found.coverage.unwrap() - 1.0).abs() < 1e-9,
            "{:?}",
            found.coverage
        );
        for origin in found.provenance.iter().filter(|origin| origin.share > 0.0) {
            let error = origin.relative_error.unwrap();
            println!("{} {:.4}: {error:?}", origin.provenance, origin.share);
            assert!(error.median.value().unwrap() < 0.06, "{origin:?}");
        }
    }
    // In the hole there is a value now.
    let inside = [(from_degrees(5.0, 10.0), from_degrees(20.0, 30.0))];
    let value = Brdf::open(&out).unwrap().values(&inside).unwrap()[0].unwrap();
    let truth = sample.f(inside[0].0, inside[0].1)[0];
    assert!(
        (f64::from(value[0]) / truth - 1.0).abs() < 0.15,
        "{value:?} {truth}"
    );
}

#[test]
fn the_scale_and_the_turn_of_a_capture_are_found() {
    let folder = tempfile::tempdir().unwrap();
    let rig = Rig::load("rcg-2").unwrap();
    let first = measured(SAMPLE, &folder.path().join("a"), &rig, 10.0, None, None, 1);
    // 3 % more light, and the sample leans by 0.4° more than anybody knows.
    let mut truth = Truth::of(&rig);
    truth.rig.light.full_scale_f_sr /= 1.03;
    truth.rig.sample.roll_deg = 0.4;
    let second = measured(
        SAMPLE,
        &folder.path().join("b"),
        &rig,
        10.0,
        Some(&truth),
        None,
        2,
    );
    let filled = fill(
        &first,
        &[second],
        &folder.path().join("out.brdf.zarr"),
        &Options::default(),
        &Silent,
    )
    .unwrap();
    let found = &filled.alignments[0];
    println!("{found:?}");
    assert!(
        (found.scale * 1.03 - 1.0).abs() < 3.0 * found.scale_uncertainty + 2e-3,
        "{found:?}"
    );
    let size = found.turn_deg.map(|deg| deg * deg).iter().sum::<f64>().sqrt();
    assert!((size - 0.4).abs() < 0.08, "{found:?}");
}

#[test]
fn another_sample_is_no_further_capture_unless_its_scale_is_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    let rig = Rig::load("rcg-2").unwrap();
    let [first, second] = ["0.5", "0.45"].map(|albedo| {
        let sample = format!("lambert:{albedo}");
        measured(&sample, &folder.path().join(albedo), &rig, 15.0, None, None, 1)
    });
    let out = folder.path().join("out.brdf.zarr");
    let filled = |options: &Options| fill(&first, std::slice::from_ref(&second), &out, options, &Silent);
    let error = filled(&Options::default()).unwrap_err().to_string();
    assert!(
        error.contains("0.45") && error.contains("1.11") && error.contains("--any-scale"),
        "{error}"
    );
    assert!(!out.exists());
    let options = Options {
        without: vec![Way::Reciprocity, Way::Wire, Way::Model],
        is_any_scale: true,
    };
    let found = filled(&options).unwrap();
    assert!((found.alignments[0].scale / (0.5 / 0.45) - 1.0).abs() < 0.01);
    // Merged, and nothing else.
    assert!(found.model.is_none() && share(&found, "missing") > 1e-3);
    for way in ["reciprocal", "interpolated", "modelled"] {
        assert!(share(&found, way) < 1e-12, "{way}: {:?}", found.shares);
    }
}

#[test]
fn files_that_do_not_go_together_are_refused_and_nothing_is_lost() {
    let folder = tempfile::tempdir().unwrap();
    let rig = Rig::load("rcg-2").unwrap();
    let file = measured(SAMPLE, &folder.path().join("a"), &rig, 15.0, None, None, 1);
    let error = fill(&file, &[], &file, &Options::default(), &Silent).unwrap_err();
    assert!(
        matches!(error, FillError::Differs { field: "output", .. }),
        "{error}"
    );
    Brdf::open(&file).expect("still there");
    // One capture is no evidence twice: not by itself, not as a copy, not through a link, not in what was made of it.
    let (copy, link) = (folder.path().join("copy"), folder.path().join("link"));
    copied(&file, &copy);
    std::os::unix::fs::symlink(&file, &link).unwrap();
    let out = folder.path().join("out.brdf.zarr");
    let filled = fill(&file, &[], &out, &Options::default(), &Silent).unwrap();
    // A tilted rig has no hole; cells beside the horizon have no pixels all around them.
    let measured = share(&filled, "measured");
    assert!(measured >= 0.98, "{measured}");
    let other = folder.path().join("other.brdf.zarr");
    for same in [&file, &copy, &link, &out] {
        let error = fill(
            &file,
            std::slice::from_ref(same),
            &other,
            &Options::default(),
            &Silent,
        )
        .unwrap_err()
        .to_string();
        let path = same.to_str().unwrap();
        assert!(error.contains(path) && error.contains("the same one"), "{error}");
        assert!(!other.exists());
    }
}

fn copied(from: &Path, to: &Path) {
    std::fs::create_dir(to).unwrap();
    for entry in std::fs::read_dir(from).unwrap().flatten() {
        let target = to.join(entry.file_name());
        if entry.path().is_dir() {
            copied(&entry.path(), &target);
        } else {
            std::fs::copy(entry.path(), target).unwrap();
        }
    }
}

#[test]
fn captures_without_common_directions_are_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    // Cameras that see one half of the mirror each.
    let half = |name: &str, centre_px: f64| {
        let mut rig = Rig::load("rcg-1-16bit").unwrap();
        rig.camera.lens.centre_px[0] = centre_px;
        measured(SAMPLE, &folder.path().join(name), &rig, 15.0, None, None, 1)
    };
    let (left, right) = (half("left", 0.0), half("right", 2048.0));
    let out = folder.path().join("out.brdf.zarr");
    let error = fill(
        &left,
        std::slice::from_ref(&right),
        &out,
        &Options::default(),
        &Silent,
    )
    .unwrap_err();
    assert!(matches!(error, FillError::NoOverlap { .. }), "{error}");
    let text = error.to_string();
    assert!(
        text.contains("right") && text.contains("capture the sample at tilts between the two"),
        "{text}"
    );
    assert!(!out.exists());
}
