//! What the budget of a value states is what a Monte Carlo calculation finds: inputs drawn as they are stated, through calibration,
//! capture and assembly (GUM, supplement 1: JCGM 101:2008).

use std::path::Path;

use rcg::base::progress::Silent;
use rcg::calibrate::{geometry, photometry};
use rcg::hemisphere::incident::Grid;
use rcg::instrument::calibration::Calibration;
use rcg::measure::gum::{self, Budget};
use rcg::measure::{assemble_measurement, capture, prepare};
use rcg::plan::{Request, Virtual};
use rcg::virtual_rig::setup::Setup;
use rcg_tests::is_full;
use rcg_tests::measurements::coarse;

/// Relative standard uncertainty of the reflectance of each standard.
const STANDARD: f64 = 0.005;
/// Light and view of the values: polar angle and azimuth, degrees.
const PAIRS: [[(f64, f64); 2]; 3] = [
    [(30.0, 0.0), (50.0, 120.0)],
    [(45.0, 0.0), (50.0, 110.0)],
    [(30.0, 300.0), (60.0, 60.0)],
];

/// Frames of the targets of a calibration, in `dir`, and its geometry.
fn captured(dir: &Path) {
    let rig = coarse("rcg-1-16bit");
    let world = |seed| {
        let virtual_rig = Virtual {
            seed,
            ..Virtual::default()
        };
        Setup::from(virtual_rig).world().unwrap()
    };
    let request = geometry::Request {
        rig,
        tilts: vec![[0.0, 0.0], [15.0, 0.0], [15.0, 120.0], [15.0, 240.0]],
        image_size: 64,
        tilt_uncertainty_deg: 0.05,
    };
    geometry::capture(&request, dir, &world(1), &Silent).unwrap();
    geometry::calibrate(dir, &geometry::Said::default()).unwrap();
    let request = photometry::Request {
        standard: "lambert:0.98".to_owned(),
        second_standard: Some("lambert:0.2".to_owned()),
        tilts: Vec::new(),
        exposure_s: None,
        image_size: 24,
    };
    photometry::capture(&request, dir, &world(2), &Silent).unwrap();
}

/// The calibration in `dir` whose standards are said to be brighter by these factors.
fn said(dir: &Path, [first, second]: [f64; 2]) -> Calibration {
    let said = photometry::Said {
        standard: Some(format!("lambert:{:.9}", 0.98 * first)),
        second_standard: Some(format!("lambert:{:.9}", 0.2 * second)),
        ..photometry::Said::default()
    };
    photometry::calibrate(dir, &said, &photometry::Trust::assumed(STANDARD)).unwrap();
    Calibration::open(dir, &coarse("rcg-1-16bit")).unwrap()
}

/// The budgets of the pairs in the first channel, measured with a `calibration` and chance of its own.
fn measured(dir: &Path, calibration: Calibration, sample: &str, seed: u64) -> Vec<Budget> {
    let mut directions_deg: Vec<[f64; 2]> = PAIRS.iter().map(|[(theta, phi), _]| [*theta, *phi]).collect();
    directions_deg.push([60.0, 200.0]);
    let request = Request {
        grid: Grid::List { directions_deg },
        image_size: 24,
        // Short, so that noise is a part of it.
        exposure_s: Some(5e-4),
        ..Request::default()
    };
    let rig = calibration.rig.clone();
    let setup = Setup {
        calibration: Some(calibration),
        ..Setup::from(Virtual {
            sample: sample.to_owned(),
            seed,
            ..Virtual::default()
        })
    };
    let (job, measurement) = prepare(&dir.join("m"), &rig, request, &setup, &Silent).unwrap();
    capture(&measurement, &job, &Silent).unwrap();
    assemble_measurement(&measurement, &Silent).unwrap();
    let at = |pair| gum::at(&measurement, pair, &dir.join("scratch"), &Silent).unwrap();
    PAIRS.map(|pair| at(pair).swap_remove(0)).to_vec()
}

/// Deviates of the standard normal distribution at the middles of `count` parts of equal probability, shuffled by `step`, which has no
/// divisor with `count` in common: so a few of them have its variance.
fn deviates(count: usize, step: usize) -> Vec<f64> {
    let quantile = |share: f64| {
        // Found by halving: Φ rises.
        let (mut low, mut high) = (-8.0_f64, 8.0_f64);
        for _ in 0..60 {
            let middle = f64::midpoint(low, high);
            if normal(middle) < share {
                low = middle;
            } else {
                high = middle;
            }
        }
        f64::midpoint(low, high)
    };
    (0..count)
        .map(|at| quantile(((at * step) % count) as f64 / count as f64 + 0.5 / count as f64))
        .collect()
}

/// Φ, by Simpson's rule from −8 on.
fn normal(x: f64) -> f64 {
    let (steps, from) = (400, -8.0);
    let width = (x - from) / f64::from(steps);
    let density = |x: f64| (-0.5 * x * x).exp() / (2.0 * std::f64::consts::PI).sqrt();
    let sum: f64 = (0..=steps)
        .map(|at| {
            let weight = match at {
                0 => 1.0,
                at if at == steps => 1.0,
                at if at % 2 == 1 => 4.0,
                _ => 2.0,
            };
            weight * density(from + f64::from(at) * width)
        })
        .sum();
    sum * width / 3.0
}

/// Root of the sum of the squares of these causes' contributions.
fn contribution(budget: &Budget, causes: &[&str]) -> f64 {
    let rows = budget.rows.iter().filter(|row| causes.contains(&row.cause.name));
    rows.map(|row| row.contribution.powi(2)).sum::<f64>().sqrt()
}

#[test]
fn noise_and_standards_make_of_a_value_what_its_budget_states() {
    let folder = tempfile::tempdir().unwrap();
    captured(folder.path());
    let count = if is_full() { 47 } else { 17 };
    // As bright as neither standard: what each is off by counts otherwise.
    let sample = "lambert:0.5";
    let (first, second) = (deviates(count, 1), deviates(count, 5));
    let draws: Vec<Vec<Budget>> = (0..count)
        .map(|draw| {
            let dir = tempfile::tempdir().unwrap();
            let factors = [first[draw], second[draw]].map(|z| 1.0 + STANDARD * z);
            measured(dir.path(), said(folder.path(), factors), sample, draw as u64)
        })
        .collect();
    // The calibration's frames are the same in all: what these leave open in the interreflection is no part of what scatters.
    let nominal = said(folder.path(), [1.0; 2]);
    let share = nominal.photometry.as_ref().unwrap().interreflection.unwrap();
    let (mut found2, mut stated2) = (0.0, 0.0);
    for pair in 0..PAIRS.len() {
        let values: Vec<f64> = draws.iter().map(|draw| draw[pair].value).collect();
        let mean = values.iter().sum::<f64>() / count as f64;
        let scatter2 = values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / (count - 1) as f64;
        let stated = contribution(&draws[0][pair], &["noise", "standard"]);
        let noise = contribution(&draws[0][pair], &["noise"]);
        println!(
            "pair {pair}: f {mean:.5}, scatter {:.3} %, stated {:.3} %, of that noise {:.3} %; interreflection {share:?}",
            100.0 * scatter2.sqrt() / mean,
            100.0 * stated / mean,
            100.0 * noise / mean
        );
        found2 += scatter2 / mean.powi(2);
        stated2 += (stated / mean).powi(2);
    }
    let ratio = (found2 / stated2).sqrt();
    println!("Monte Carlo over budget: {ratio:.3}");
    assert!((ratio - 1.0).abs() < 0.1, "{ratio}");
}
