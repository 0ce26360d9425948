//! Adaptive captures against uniform ones of the same number.

use glam::DVec3;
use rand::{RngExt as _, SeedableRng as _};
use rand_xoshiro::Xoshiro256PlusPlus;
use rayon::prelude::*;

use super::predict::{Image, judged_cells, mse};
use super::{Goal, measure};
use crate::base::progress::Silent;
use crate::brdf::sample::Sample;
use crate::hemisphere::direction::from_degrees;
use crate::hemisphere::disk::Disk;
use crate::hemisphere::incident::{Grid, IncidentSet};
use crate::instrument::optics::View;
use crate::instrument::rig::Rig;
use crate::plan::Virtual;
use crate::plan::pattern::PatternMaker;
use crate::plan::{Directions, Request};
use crate::virtual_rig::setup::Setup;

/// Incident directions at which interpolation is judged.
const JUDGED: usize = 300;

fn request() -> Request {
    Request {
        grid: Grid::ThetaPhi { step_deg: 15.0 },
        image_size: 48,
        ..Request::default()
    }
}

fn ideal(sample: &dyn Sample, w: DVec3, disk: Disk) -> Image {
    let lobe = sample.incident(w);
    let luminance = |wo: DVec3| {
        let [r, g, b] = lobe.f(wo);
        (0.299 * r + 0.587 * g + 0.114 * b) as f32
    };
    Image {
        f: (0..disk.len())
            .map(|cell| disk.direction(cell).map_or(f32::NAN, luminance))
            .collect(),
        noise: 0.0,
    }
}

/// In dB over all directions and of the worst one, and how many were judged.
type Psnr = (f64, f64, usize);

/// PSNR in dB of ideal captures at `set`, interpolated by the better of the two rules: (over all judged directions, of
/// the worst one), and how many were: none is where all captures beside it lie in the hole.
fn psnr_db(sample: &dyn Sample, set: &IncidentSet, usable: &[bool]) -> Psnr {
    let rig = Rig::load("rcg-1-16bit").unwrap();
    let maker = PatternMaker::new(View::projector(&rig), 1.0, 1.0);
    let disk = Disk::new(64);
    let cells = judged_cells(disk);
    let images: Vec<Option<Image>> = (0..set.len())
        .into_par_iter()
        .map(|index| usable[index].then(|| ideal(sample, set.direction(index), disk)))
        .collect();
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(11);
    let judged: Vec<DVec3> = std::iter::from_fn(|| {
        let z: f64 = rng.random_range(80_f64.to_radians().cos()..1.0);
        Some(from_degrees(z.acos().to_degrees(), rng.random_range(0.0..360.0)))
    })
    .filter(|w| maker.lit_set(*w).is_ok())
    .take(JUDGED)
    .collect();
    let errors: Vec<f64> = judged
        .par_iter()
        .filter_map(|&w| {
            let parts: Vec<(DVec3, &Image, f64)> = set
                .neighbours(w)
                .into_iter()
                .filter(|part| part.1 > 0.0)
                .filter_map(|(index, weight)| Some((set.direction(index), images[index].as_ref()?, weight)))
                .collect();
            mse(w, &ideal(sample, w, disk), &parts, disk, &cells)
        })
        .collect();
    let db = |mse: f64| -10.0 * mse.log10();
    (
        db(errors.iter().sum::<f64>() / errors.len() as f64),
        db(errors.iter().copied().fold(0.0, f64::max)),
        errors.len(),
    )
}

/// Captures, then PSNR of adaptive and uniform directions, each (mean, worst, judged), and the predicted one.
fn compared(spec: &str, step_deg: f64) -> (usize, Psnr, Psnr, f64) {
    let rig = Rig::load("rcg-1-16bit").unwrap();
    let sample = crate::brdf::sample::parse(spec).unwrap();
    let uniform = Directions::new(&rig, &Grid::EqualSolidAngle { step_deg }).unwrap();
    let budget = uniform.measurable().count();
    let usable: Vec<bool> = uniform.reasons.iter().map(Option::is_none).collect();
    let dir = tempfile::tempdir().unwrap();
    let goal = Goal::new(None, Some(budget)).unwrap();
    let setup = Setup::from(Virtual {
        sample: spec.to_owned(),
        ..Virtual::default()
    });
    let (_, measurement, adapted) = measure(
        &dir.path().join("m"),
        &rig,
        &request(),
        None,
        goal,
        &setup,
        false,
        &Silent,
    )
    .unwrap();
    let adaptive = psnr_db(sample.as_ref(), &measurement.directions.grid, &vec![true; budget]);
    let uniform = psnr_db(sample.as_ref(), &uniform.grid, &usable);
    (adapted.captures, adaptive, uniform, adapted.predicted_db.unwrap())
}

#[test]
fn adaptive_captures_beat_as_many_uniform_ones_and_the_prediction_holds() {
    let (captures, adaptive, uniform, predicted_db) = compared("ward:brass", 11.25);
    assert_eq!((captures, adaptive.2, uniform.2), (152, JUDGED, JUDGED));
    assert!(adaptive.0 > uniform.0, "{adaptive:?} dB, uniform {uniform:?} dB");
    assert!(
        (predicted_db - adaptive.0).abs() < 3.0,
        "{predicted_db} dB, true {adaptive:?} dB"
    );
}

#[test]
#[ignore = "prints a table, takes a minute"]
fn table_of_captures_and_psnr() {
    let data = concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/data");
    let measured = ["paper_white", "satin_rosaline", "colodur_napoli_4f"];
    let files = measured.map(|name| format!("{data}/{name}_rgb.bsdf"));
    let samples = files
        .into_iter()
        .filter(|file| std::path::Path::new(file).exists());
    println!("sample captures | adaptive mean worst | uniform mean worst | predicted  (dB) | judged");
    for spec in std::iter::once("ward:brass".to_owned()).chain(samples) {
        for step_deg in [11.25, 7.5, 5.0] {
            let (captures, a, u, predicted) = compared(&spec, step_deg);
            let name = spec.rsplit('/').next().unwrap_or(&spec);
            println!(
                "{name} {captures} | {:.1} {:.1} | {:.1} {:.1} | {predicted:.1} | {} {}",
                a.0, a.1, u.0, u.1, a.2, u.2
            );
        }
    }
}
