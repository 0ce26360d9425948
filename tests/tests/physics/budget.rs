//! What the budget of a value states is what a Monte Carlo calculation finds: inputs drawn as they are stated, through calibration,
//! capture and assembly (GUM, supplement 1: JCGM 101:2008). The frames of the calibration are the same in all draws: what these leave open is
//! no part of what scatters here.

use std::path::Path;

use rcg::base::progress::Silent;
use rcg::calibrate::{geometry, photometry};
use rcg::hemisphere::incident::Grid;
use rcg::instrument::calibration::Calibration;
use rcg::measure::gum::{self, Budget};
use rcg::measure::{capture, prepare};
use rcg::plan::{Request, Virtual};
use rcg::virtual_rig::setup::Setup;
use rcg_tests::is_full;
use rcg_tests::measurements::coarse;

/// Relative standard uncertainty of the reflectance of each standard.
const STANDARD: f64 = 0.0025;
/// Light and view of the values: polar angle and azimuth, degrees.
const PAIRS: [[(f64, f64); 2]; 9] = [
    [(30.0, 0.0), (50.0, 120.0)],
    [(30.0, 0.0), (55.0, 100.0)],
    [(30.0, 0.0), (60.0, 60.0)],
    [(45.0, 0.0), (50.0, 110.0)],
    [(45.0, 0.0), (45.0, 130.0)],
    [(45.0, 0.0), (60.0, 90.0)],
    [(30.0, 300.0), (60.0, 60.0)],
    [(30.0, 300.0), (55.0, 110.0)],
    [(30.0, 300.0), (50.0, 80.0)],
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

/// What the first standard is said to be over what it is: so dark that much light seems to return onto it, and that nobody needs to know
/// that no less than nothing does. Else that would lessen what standards make of a value.
const DARKER: f64 = 0.98;

/// The calibration in `dir` whose standards are said to be brighter by these factors.
fn said(dir: &Path, [first, second]: [f64; 2]) -> Calibration {
    let said = photometry::Said {
        standard: Some(format!("lambert:{:.9}", 0.98 * DARKER * first)),
        second_standard: Some(format!("lambert:{:.9}", 0.2 * second)),
        ..photometry::Said::default()
    };
    photometry::calibrate(dir, &said, &photometry::Trust::assumed(STANDARD)).unwrap();
    Calibration::open(dir, &coarse("rcg-1-16bit")).unwrap()
}

/// The budgets of the pairs, of all channels, of a sample as bright as neither standard: what each of these is off by counts otherwise.
/// Measured with a `calibration`, and with chance of its own if there is a `seed`.
fn measured(calibration: &Calibration, seed: Option<u64>) -> Vec<Budget> {
    let dir = tempfile::tempdir().unwrap();
    let directions_deg = vec![[30.0, 0.0], [45.0, 0.0], [30.0, 300.0], [60.0, 200.0]];
    let request = Request {
        grid: Grid::List { directions_deg },
        image_size: 24,
        exposure_s: Some(8e-3),
        ..Request::default()
    };
    let rig = calibration.rig.clone();
    let setup = Setup {
        calibration: Some(calibration.clone()),
        ..Setup::from(Virtual {
            sample: "lambert:0.5".to_owned(),
            seed: seed.unwrap_or_default(),
            noise: seed.is_some(),
            ..Virtual::default()
        })
    };
    let (job, measurement) = prepare(&dir.path().join("m"), &rig, request, &setup, &Silent).unwrap();
    capture(&measurement, &job, &Silent).unwrap();
    let budgets = gum::at(&measurement, &PAIRS, &dir.path().join("scratch"), &Silent).unwrap();
    let empty = budgets.iter().position(Vec::is_empty);
    assert_eq!(empty.map(|at| PAIRS[at]), None, "a pair without a value");
    budgets.into_iter().flatten().collect()
}

/// Standard deviation of the values in all `draws` over what the budgets say that `cause` makes of them, root mean square over the values.
/// The mean of the draws is known, or found from them.
fn ratio(draws: &[Vec<Budget>], cause: &str, known: Option<&[Budget]>) -> f64 {
    let (mut found2, mut stated2) = (0.0, 0.0);
    for at in 0..draws[0].len() {
        let values: Vec<f64> = draws.iter().map(|draw| draw[at].value).collect();
        let (mean, free) = match known {
            Some(known) => (known[at].value, values.len()),
            None => (values.iter().sum::<f64>() / values.len() as f64, values.len() - 1),
        };
        found2 += values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / free as f64;
        let row = |budget: &Budget| {
            let mut rows = budget.rows.iter();
            rows.find(|row| row.cause.name == cause)
                .map_or(0.0, |row| row.contribution)
        };
        stated2 += draws.iter().map(|draw| row(&draw[at]).powi(2)).sum::<f64>() / draws.len() as f64;
    }
    (found2 / stated2).sqrt()
}

#[test]
fn standards_and_noise_make_of_a_value_what_its_budget_states() {
    let folder = tempfile::tempdir().unwrap();
    captured(folder.path());
    let nominal = said(folder.path(), [1.0; 2]);
    let without_noise = measured(&nominal, None);
    // Each one standard uncertainty up or down: a distribution of the stated variance, of which few draws have that too.
    let ways = [[-1.0, -1.0], [-1.0, 1.0], [1.0, -1.0], [1.0, 1.0]];
    let draws = ways.map(|way| {
        let factors = way.map(|up: f64| 1.0 + STANDARD * up);
        measured(&said(folder.path(), factors), None)
    });
    let by_standards = ratio(&draws, "standard", Some(&without_noise));
    let count = if is_full() { 96 } else { 8 };
    // Of light that returns, which is another cause, nothing is known.
    let mut without_return = nominal;
    if let Some(photometry) = &mut without_return.photometry {
        photometry.interreflection = None;
        photometry.standards.truncate(1);
    }
    let draws: Vec<Vec<Budget>> = (0..count)
        .map(|seed| measured(&without_return, Some(seed)))
        .collect();
    let by_noise = ratio(&draws, "noise", None);
    println!("Monte Carlo over budget: standards {by_standards:.3}, noise {by_noise:.3}");
    assert!((by_standards - 1.0).abs() < 0.1, "{by_standards}");
    assert!((by_noise - 1.0).abs() < 0.1, "{by_noise}");
}
