//! From a rig that is 3 mm and 2° off the true one is found, and views that do not determine it are refused.

use super::*;
use glam::DVec3;

use crate::base::progress::Silent;
use crate::hemisphere::direction::angle_between;
use crate::instrument::optics::SampleFrame;
use crate::plan::Virtual;
use crate::virtual_rig::setup::Setup;
use crate::virtual_rig::{Figure, Tolerances, Truth};

/// Captures and calibrates in `folder` a rig that strays from `nominal` by as much as the tolerances say, and by what `change` does,
/// with a mirror of this figure and tilts that are as stated.
fn calibrated(
    nominal: &Rig,
    seed: u64,
    figure_rad: f64,
    change: fn(&mut Rig),
    folder: &Path,
) -> (Truth, Geometry, Rig) {
    let tolerances = Tolerances {
        mirror_deg: Some(0.0),
        position_m: parameters::POSITION_M,
        angle_deg: parameters::ANGLE_DEG,
        field: 0.3,
        standard: 0.0,
        figure_rad: Some(figure_rad),
        ..Tolerances::DRAWN
    };
    let mut truth = Truth::drawn(nominal, tolerances, seed).unwrap();
    change(&mut truth.rig);
    let path = folder.join("truth.toml");
    std::fs::write(&path, truth.to_toml()).unwrap();
    let request = Request {
        rig: nominal.clone(),
        tilts: TILTS.to_vec(),
        image_size: 160,
        tilt_uncertainty_deg: 0.05,
    };
    let setup = Setup::from(Virtual {
        truth: Some(path.display().to_string()),
        seed,
        ..Virtual::default()
    });
    let dir = folder.join("calibration");
    capture(&request, &dir, &setup.world().unwrap(), &Silent).unwrap();
    let geometry = calibrate(&dir, &Said::default()).unwrap_or_else(|error| panic!("{error}"));
    let rig = Rig::load(&dir.join(RIG).display().to_string()).unwrap();
    (truth, geometry, rig)
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

/// Where the wire of `rig` is against its sample, azimuth in degrees.
fn wire_deg(rig: &Rig) -> f64 {
    let azimuth_rad = rig.wire.as_ref().unwrap().azimuth_deg.to_radians();
    let along = SampleFrame::of(&rig.sample).to_sample(DVec3::new(azimuth_rad.cos(), azimuth_rad.sin(), 0.0));
    along.y.atan2(along.x).to_degrees()
}

#[test]
fn a_rig_that_is_3_mm_and_2_degrees_off_is_found_whichever_way_its_images_are_turned() {
    // Others are calibrated by the command's tests.
    let nominal = Rig::load("rcg-2").unwrap();
    let turn = |rig: &mut Rig| {
        rig.camera.lens.rotation_deg[2] += 90.0;
        rig.projector.lens.mirrored = true;
    };
    let folder = tempfile::tempdir().unwrap();
    let (truth, geometry, rig) = calibrated(&nominal, 3, 0.0, turn, folder.path());
    assert_eq!(geometry.images, ["turned by 90°", "mirrored left to right"]);
    assert!(rig.obstacles.is_empty(), "{:?}", rig.obstacles);
    let mut turned = nominal.clone();
    turn(&mut turned);
    let none = Figure::default();
    for (device, view) in [
        ("camera", View::camera as fn(&Rig) -> View),
        ("projector", View::projector),
    ] {
        let (before_deg, _) = errors_deg((&truth.rig, &none), &turned, view);
        let (rms_deg, max_deg) = errors_deg((&truth.rig, &none), &rig, view);
        println!("{device}: before {before_deg:.2}, rms {rms_deg:.4}, max {max_deg:.4}; {geometry:?}");
        assert!(before_deg > 0.5, "{device}: {before_deg}");
        assert!(
            rms_deg <= 0.05 && max_deg <= 0.15,
            "{device}: {rms_deg} {max_deg}"
        );
    }

    // The same captures with a tilt that is stated wrongly.
    let dir = folder.path().join("calibration");
    let said = |tilts: [[f64; 2]; 4]| Said {
        tilts: Some(tilts.to_vec()),
        ..Said::default()
    };
    for (view, off) in [(0, [0.5, 0.0]), (1, [0.5, 0.0]), (2, [0.0, 1.0])] {
        let mut tilts = TILTS;
        tilts[view] = [0, 1].map(|axis| TILTS[view][axis] + off[axis]);
        let error = calibrate(&dir, &said(tilts)).unwrap_err().to_string();
        let named = format!("view {} ({}:{})", view + 1, tilts[view][0], tilts[view][1]);
        assert!(error.contains(&named), "{named}: {error}");
    }
}

#[test]
fn what_a_mirror_that_is_no_ellipsoid_leaves_is_stated_and_a_wire_is_found_wherever_it_is() {
    let nominal = Rig::load("rcg-1-16bit").unwrap();
    let folder = tempfile::tempdir().unwrap();
    let move_wire = |rig: &mut Rig| rig.wire.as_mut().unwrap().azimuth_deg = 135.0;
    let (truth, geometry, rig) = calibrated(&nominal, 4, 5e-4, move_wire, folder.path());
    let off_deg = (wire_deg(&rig) - wire_deg(&truth.rig) + 180.0).rem_euclid(360.0) - 180.0;
    println!("wire {off_deg:+.3}° off, edges to {:.3}°", geometry.edge_deg());
    assert!(off_deg.abs() < 3.0 * geometry.edge_deg().min(0.3), "{off_deg}");
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
