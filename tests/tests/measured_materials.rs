//! Real measured reflectance: the reader against another implementation, and the whole chain, noise off, which gives
//! back what the virtual rig was given.
//!
//! The files are not part of the project; without one its trials are ignored, and say so.

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Duration;

use libtest_mimic::{Arguments, Completion, Failed, Trial};
use rcg::base::progress::Silent;
use rcg::brdf::sample::{MeasuredRgl, Sample as _, parse};
use rcg::hemisphere::direction::from_degrees;
use rcg::hemisphere::incident::Grid;
use rcg::instrument::rig::Rig;
use rcg::measure::{complete, prepare};
use rcg::plan::{Request, Virtual};
use rcg::virtual_rig::setup::Setup;

const PAPER: &str = "paper_white_rgb.bsdf";
const SATIN: &str = "satin_rosaline_rgb.bsdf";
const NAPOLI: &str = "colodur_napoli_4f_rgb.bsdf";

/// θi, φi, θo, φo in degrees and f in sr⁻¹.
type Reference = ([f64; 4], [f64; 3]);

/// Computed with Mitsuba 3.9.1 in variant `scalar_rgb` (single precision): `eval()` of the BSDF plugin `measured`
/// with `si.wi` = ωi gives f cosθo, which was divided by cosθo in double precision. Where θi is 0 here, it was
/// 1e-5° there, because that program's choice of the azimuth of the normal varies.
const REFERENCES: [(&str, [Reference; 4]); 3] = [
    (
        SATIN,
        [
            ([0.0, 0.0, 35.0, 120.0], [0.183_035, 0.225_067, 0.207_949]),
            ([50.0, 30.0, 52.0, 205.0], [2.511_368, 1.802_482, 1.861_307]),
            ([80.0, 0.0, 75.0, 180.0], [100.163_270, 93.107_462, 86.616_107]),
            ([85.0, 45.0, 86.0, 220.0], [0.728_250, 0.499_237, 0.428_099]),
        ],
    ),
    (
        PAPER,
        [
            ([0.0, 0.0, 0.0, 0.0], [0.278_315, 0.282_663, 0.330_821]),
            ([25.0, 100.0, 40.0, 290.0], [0.279_311, 0.282_792, 0.327_939]),
            ([65.0, 200.0, 70.0, 25.0], [0.445_882, 0.441_980, 0.474_270]),
            ([88.0, 10.0, 30.0, 10.0], [0.268_569, 0.272_874, 0.322_100]),
        ],
    ),
    (
        NAPOLI,
        [
            ([0.0, 0.0, 35.0, 120.0], [0.076_709, 0.018_021, 0.019_309]),
            ([50.0, 30.0, 20.0, 75.0], [0.075_860, 0.015_384, 0.016_989]),
            ([10.0, -60.0, 80.0, 15.0], [0.078_572, 0.018_006, 0.019_382]),
            ([85.0, 45.0, 86.0, 220.0], [0.325_022, 0.241_435, 0.231_903]),
        ],
    ),
];

fn agrees_with_mitsuba(path: &Path) {
    let name = path.file_name().and_then(|name| name.to_str());
    let references = REFERENCES.into_iter().find(|(file, _)| Some(*file) == name);
    let sample = MeasuredRgl::open(path).unwrap();
    for ([theta_i, phi_i, theta_o, phi_o], expected) in references.unwrap().1 {
        let found = sample.f(from_degrees(theta_i, phi_i), from_degrees(theta_o, phi_o));
        for (found, expected) in found.into_iter().zip(expected) {
            let error = (found / expected - 1.0).abs();
            assert!(
                error < 1e-4,
                "{theta_i} {phi_i} {theta_o} {phi_o}: {found}, {expected}"
            );
        }
    }
}

fn a_pair_is_worth_what_the_prepared_direction_gives(path: &Path) {
    let sample = MeasuredRgl::open(path).unwrap();
    let (mut positive, mut largest) = (0, 0.0_f64);
    for i in 0..1500_u32 {
        let wi = from_degrees(f64::from(i * 7919 % 9000) / 100.0, f64::from(i * 31 % 360));
        let lit = sample.incident(wi);
        for k in 4 * i..4 * (i + 1) {
            let wo = from_degrees(f64::from(k * 104_729 % 9000) / 100.0, f64::from(k * 15_485 % 360));
            for (found, expected) in sample.f(wi, wo).into_iter().zip(lit.f(wo)) {
                if expected > 0.0 {
                    positive += 1;
                    largest = largest.max((found / expected - 1.0).abs());
                } else {
                    assert!(found < 1e-6, "{wi} {wo}: {found}, {expected}");
                }
            }
        }
    }
    assert!(positive > 10_000, "{positive}");
    assert!(largest < 1e-6, "{largest}");
}

fn an_isotropic_one_does_not_change_when_turned(path: &Path) {
    let sample = parse(path.to_str().unwrap()).unwrap();
    assert!(sample.is_isotropic());
    let f = |turn_deg: f64| sample.f(from_degrees(55.0, turn_deg), from_degrees(48.0, turn_deg + 165.0))[0];
    for turn_deg in [37.0, 120.0, 200.0, 355.0] {
        assert!((f(turn_deg) / f(0.0) - 1.0).abs() < 1e-9, "{turn_deg}");
    }
}

/// Samples of the text, found by counting its lines: rotation, incidence, radial angle in degrees, positive towards the
/// normal (azimuth 0) and negative away from it (azimuth 180°), and f in sr⁻¹.
const ZEMAX: [([f64; 3], f64); 5] = [
    ([0.0, 10.0, 5.0], 2.957e-3),
    ([200.0, 50.0, 20.0], 1.880e-3),
    ([200.0, 50.0, -20.0], 4.048e-3),
    ([350.0, 70.0, 60.0], 1.146e-3),
    ([90.0, 30.0, -40.0], 2.715e-3),
];

fn a_zemax_file_gives_what_its_lines_say(path: &Path) {
    let sample = parse(path.to_str().unwrap()).unwrap();
    assert!(!sample.is_isotropic());
    for ([rotation, incidence, radial], expected) in ZEMAX {
        // In the plane of incidence: from φ = rotation − 90°, mirrored to rotation + 90°.
        let wi = from_degrees(incidence, rotation - 90.0);
        let wo = from_degrees(incidence - radial, rotation + 90.0);
        let found = sample.f(wi, wo)[0];
        assert!(
            (found / expected - 1.0).abs() < 1e-6,
            "{rotation} {incidence} {radial}: {found}, {expected}"
        );
    }
}

/// The median relative error outside the hole, θ ≤ 80°, is at most `largest`.
fn comes_back(path: &Path, largest: f64) {
    let request = Request {
        grid: Grid::ThetaPhi { step_deg: 6.0 },
        image_size: 96,
        ..Request::default()
    };
    let setup = Setup::from(Virtual {
        sample: path.display().to_string(),
        noise: false,
        ..Virtual::default()
    });
    let dir = tempfile::tempdir().unwrap();
    let rig = Rig::load("rcg-1-16bit").unwrap();
    let (job, measurement) = prepare(&dir.path().join("m"), &rig, request, &setup, &Silent).unwrap();
    let summary = complete(&measurement, &job, &|| Duration::ZERO, &Silent).unwrap();
    let against = summary.evaluation.against_reference.unwrap();
    println!("{}: {:?}", path.display(), against.relative_error);
    let median = against.relative_error.median.value().unwrap();
    assert!(median <= largest, "{median}");
}

/// A trial that is ignored where `file` is not in the folder of measured materials.
fn trial(name: &str, file: &str, check: impl Fn(&Path) + Send + 'static) -> Trial {
    let path = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/data")).join(file);
    Trial::ignorable_test(name, move || {
        if !path.is_file() {
            let reason = format!("no measured material at {}", path.display());
            return Ok::<_, Failed>(Completion::ignored_with(reason));
        }
        check(&path);
        Ok(Completion::Completed)
    })
}

fn main() -> ExitCode {
    let mut trials = vec![
        trial(
            "satin_does_not_change_when_turned",
            SATIN,
            an_isotropic_one_does_not_change_when_turned,
        ),
        trial(
            "a_zemax_file_gives_what_its_lines_say",
            "IMX455.bsdf",
            a_zemax_file_gives_what_its_lines_say,
        ),
        trial("paper_comes_back", PAPER, |path| comes_back(path, 0.005)),
        trial("satin_comes_back", SATIN, |path| comes_back(path, 0.015)),
    ];
    for file in [SATIN, PAPER, NAPOLI] {
        let of = |what: &str| format!("{what}::{}", file.trim_end_matches("_rgb.bsdf"));
        trials.push(trial(&of("agrees_with_mitsuba"), file, agrees_with_mitsuba));
        let name = of("a_pair_is_worth_what_the_prepared_direction_gives");
        trials.push(trial(
            &name,
            file,
            a_pair_is_worth_what_the_prepared_direction_gives,
        ));
    }
    libtest_mimic::run(&Arguments::from_args(), trials).exit_code()
}
