//! From a rig that is 3 mm and 2° off the true one is found, and views that do not determine it are refused.

use super::*;
use crate::base::progress::Silent;
use crate::hemisphere::direction::angle_between;
use crate::plan::Virtual;
use crate::virtual_rig::setup::Setup;
use crate::virtual_rig::{Figure, Tolerances, Truth};

/// Captures and calibrates a rig that strays from `nominal` by as much as the tolerances say, with a mirror of this figure.
fn calibrated(
    nominal: &Rig,
    seed: u64,
    tilts: &[[f64; 2]],
    figure_rad: f64,
) -> (Truth, Result<(Geometry, Rig), CalibrateError>) {
    let tolerances = Tolerances {
        position_m: parameters::POSITION_M,
        angle_deg: parameters::ANGLE_DEG,
        field: 0.3,
        standard: 0.0,
        figure_rad: Some(figure_rad),
        ..Tolerances::DRAWN
    };
    let truth = Truth::drawn(nominal, tolerances, seed).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("truth.toml");
    std::fs::write(&path, truth.to_toml()).unwrap();
    let request = Request {
        rig: nominal.clone(),
        tilts: tilts.to_vec(),
        image_size: 160,
    };
    let setup = Setup::from(Virtual {
        truth: Some(path.display().to_string()),
        seed,
        ..Virtual::default()
    });
    let dir = folder.path().join("calibration");
    capture(&request, &dir, &setup.world().unwrap(), &Silent).unwrap();
    let found = calibrate(&dir).map(|geometry| {
        let rig = Rig::load(&dir.join(RIG).display().to_string()).unwrap();
        (geometry, rig)
    });
    (truth, found)
}

/// RMS and largest angle in degrees between what a device before a mirror with this figure truly sees and what that of `found`
/// does, where the true one can measure.
fn errors_deg((truth, figure): (&Rig, &Figure), found: &Rig, view: fn(&Rig) -> View) -> (f64, f64) {
    let (truth, found) = (view(truth).with_figure(figure.of(truth)), view(found));
    let (width, height) = (truth.pinhole().width_px(), truth.pinhole().height_px());
    let (mut squares, mut count, mut largest) = (0.0, 0_u32, 0.0_f64);
    for row in 0..64 {
        for column in 0..64 {
            let at = |index: u32, size: u32| (f64::from(index) + 0.5) / 64.0 * f64::from(size);
            let (u, v) = (at(column, width), at(row, height));
            let Ok(w) = truth.direction(u, v) else { continue };
            let error_deg = angle_between(found.sight(u, v).unwrap(), w).to_degrees();
            squares += error_deg * error_deg;
            count += 1;
            largest = largest.max(error_deg);
        }
    }
    assert!(count > 500, "{count}");
    ((squares / f64::from(count)).sqrt(), largest)
}

const TILTS: [[f64; 2]; 4] = [[0.0, 0.0], [15.0, 0.0], [15.0, 120.0], [15.0, 240.0]];

#[test]
fn a_rig_that_is_3_mm_and_2_degrees_off_is_found() {
    // Others are calibrated by the command's tests.
    {
        let (name, seed) = ("rcg-2", 3);
        let nominal = Rig::load(name).unwrap();
        let (truth, found) = calibrated(&nominal, seed, &TILTS, 0.0);
        let (geometry, rig) = found.unwrap_or_else(|error| panic!("{name} {seed}: {error}"));
        let none = Figure::default();
        for (device, view) in [
            ("camera", View::camera as fn(&Rig) -> View),
            ("projector", View::projector),
        ] {
            let (before_deg, _) = errors_deg((&truth.rig, &none), &nominal, view);
            let (rms_deg, max_deg) = errors_deg((&truth.rig, &none), &rig, view);
            println!(
                "{name} {seed} {device}: before {before_deg:.2}, rms {rms_deg:.4}, max {max_deg:.4}; states {:.4} {:.4}, residuals {:.4} {:?}",
                geometry.camera_deg,
                geometry.projector_deg,
                geometry.match_residual_deg,
                geometry.edge_residual_deg
            );
            assert!(before_deg > 0.5, "{name} {seed} {device}: {before_deg}");
            assert!(
                rms_deg <= 0.05 && max_deg <= 0.15,
                "{name} {seed} {device}: {rms_deg} {max_deg}"
            );
        }
    }
}

#[test]
fn what_a_mirror_that_is_no_ellipsoid_leaves_is_stated() {
    let nominal = Rig::load("rcg-1-16bit").unwrap();
    let (truth, found) = calibrated(&nominal, 4, &TILTS, 5e-4);
    let (geometry, rig) = found.unwrap();
    let real = (&truth.rig, &truth.flaws.figure);
    for (view, stated_deg) in [
        (View::camera as fn(&Rig) -> View, geometry.camera_deg),
        (View::projector, geometry.projector_deg),
    ] {
        let (rms_deg, max_deg) = errors_deg(real, &rig, view);
        println!("rms {rms_deg:.4}, max {max_deg:.4}; states {stated_deg:.4}");
        // What bends the light by 0.06° is neither taken for a lens nor passed over.
        assert!(
            rms_deg > 0.01 && rms_deg < 2.0 * stated_deg,
            "{rms_deg} {stated_deg}"
        );
        assert!(
            stated_deg < 0.08 && max_deg < 5.0 * stated_deg,
            "{max_deg} {stated_deg}"
        );
    }
}
