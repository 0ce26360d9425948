//! Laws of a whole view: focus to focus, there and back, solid angles, and where each reason applies.

use std::f64::consts::{FRAC_PI_2, TAU};

use glam::{DVec2, DVec3};
use proptest::prelude::*;

use super::{DirectionMap, Unmeasurable, View};
use crate::hemisphere::direction::{angle_between, from_angles, from_degrees};
use crate::instrument::rig::{PRESETS, Rig};

fn preset(name: &str) -> Rig {
    Rig::load(name).expect("presets are valid")
}

/// Camera and projector of a rig, each with its name for messages.
fn views(rig: &Rig) -> [(&'static str, View); 2] {
    [("camera", View::camera(rig)), ("projector", View::projector(rig))]
}

/// A rig whose devices are neither at F2 nor aligned nor free of distortion.
fn bent(name: &str) -> Rig {
    let mut rig = preset(name);
    for (lens, sign) in [(&mut rig.camera.lens, 1.0), (&mut rig.projector.lens, -1.0)] {
        lens.offset_m = [0.003 * sign, -0.002, 0.003 * sign];
        let aligned_deg = lens.rotation_deg;
        lens.rotation_deg = [2.0 * sign, aligned_deg[1] - 2.0, aligned_deg[2] + 2.0];
        lens.distortion = [-0.15, 0.08, 0.001 * sign, -0.0015, 0.02];
        // Room for the shift, so that most of the hemisphere stays in the image.
        lens.focal_px *= 0.75;
    }
    rig
}

/// Directions over the whole hemisphere, its pole and its horizon included.
fn hemisphere() -> Vec<DVec3> {
    let rings = (0..=90).step_by(3).map(f64::from);
    rings
        .flat_map(|theta| {
            (0..360)
                .step_by(5)
                .map(move |phi| from_degrees(theta, f64::from(phi)))
        })
        .collect()
}

/// Presets whose sample leans out of the way of the hole and of the wire.
const LEANING: [&str; 2] = ["rcg-2", "rcg-3"];

#[test]
fn there_and_back_is_the_identity_in_every_preset() {
    for name in PRESETS {
        for (device, view) in views(&preset(name)) {
            let mut measured = 0;
            for w in hemisphere() {
                let Ok(pixel) = view.pixel(w) else { continue };
                let trace = view
                    .trace(pixel.x, pixel.y)
                    .expect("a direction with a pixel has a trace");
                assert!(angle_between(trace.direction, w) < 1e-9, "{name} {device} {w}");
                assert!(
                    trace.hit_m.length() < 1e-9,
                    "{name} {device} {w}: {}",
                    trace.hit_m
                );
                measured += 1;
            }
            // All of the hemisphere where the sample leans; θ from 30° on, less the wire at 270°, elsewhere.
            let expected = if LEANING.contains(&name) { 31 * 72 } else { 21 * 71 };
            assert_eq!(measured, expected, "{name} {device}");
        }
    }
}

#[test]
fn there_and_back_is_the_identity_in_a_general_pose() {
    for name in PRESETS {
        for (device, view) in views(&bent(name)) {
            let (mut measured, mut farthest_m) = (0, 0.0_f64);
            for w in hemisphere() {
                let Ok(pixel) = view.pixel(w) else { continue };
                let trace = view
                    .trace(pixel.x, pixel.y)
                    .expect("a direction with a pixel has a trace");
                assert!(angle_between(trace.direction, w) < 1e-9, "{name} {device} {w}");
                assert!(
                    trace.hit_m.z.abs() < 1e-12,
                    "{name} {device} {w}: {}",
                    trace.hit_m
                );
                farthest_m = farthest_m.max(trace.hit_m.length());
                measured += 1;
            }
            assert!(measured > 1000, "{name} {device}: {measured}");
            assert!(
                farthest_m > 5e-4,
                "{name} {device}: the ray of a displaced device misses F1"
            );
        }
    }
}

#[test]
fn newton_agrees_with_the_closed_form_next_to_the_focus() {
    let ideal = preset("rcg-1-16bit");
    let mut near = ideal.clone();
    near.camera.lens.offset_m = [1e-12, 0.0, 0.0];
    let (ideal, near) = (View::camera(&ideal), View::camera(&near));
    // The edge of the hole (27°) may fall to either side, and a grazing ray may miss the sample.
    let edge_z = 27_f64.to_radians().cos();
    for w in hemisphere()
        .into_iter()
        .filter(|w| w.z > 0.01 && (w.z - edge_z).abs() > 1e-9)
    {
        match (ideal.pixel(w), near.pixel(w)) {
            (Ok(a), Ok(b)) => assert!((a - b).length() < 1e-6, "{w}"),
            (a, b) => assert_eq!(a, b, "{w}"),
        }
    }
}

#[test]
fn the_trace_obeys_the_law_of_reflection() {
    let rig = bent("rcg-1-16bit");
    let view = View::camera(&rig);
    let mirror = view.ellipsoid();
    let centre_m = mirror.f2() + DVec3::from_array(rig.camera.lens.offset_m);
    let mut traced = 0;
    for step in 0..400 {
        let (u_px, v_px) = (
            f64::from(step % 20) * 100.0 + 50.0,
            f64::from(step / 20) * 100.0 + 50.0,
        );
        let Ok(trace) = view.trace(u_px, v_px) else {
            continue;
        };
        let normal = mirror.normal(trace.mirror_m);
        let to_sample = (view.frame().to_mirror(trace.hit_m) + mirror.f1() - trace.mirror_m).normalize();
        let to_device = (centre_m - trace.mirror_m).normalize();
        assert!((to_sample.dot(normal) - to_device.dot(normal)).abs() < 1e-12);
        assert!(
            to_sample.cross(to_device).dot(normal).abs() < 1e-12,
            "the three lie in one plane"
        );
        assert!(angle_between(view.frame().to_mirror(trace.direction), -to_sample) < 1e-9);
        traced += 1;
    }
    assert!(traced > 100);
}

#[test]
fn a_device_turns_about_z_first_then_y_then_x() {
    // rcg-1-16bit without hole and wire; the middle of the image looks along the device's own +z, which a turn
    // about z leaves alone, a turn of 2° about y brings towards +x and one of 3° about x towards −y.
    let mut rig = preset("rcg-1-16bit");
    rig.mirror.hole_deg = 0.0;
    rig.wire = None;
    rig.camera.lens.rotation_deg = [3.0, 2.0, 30.0];
    let view = View::camera(&rig);
    let ((sin_x, cos_x), (sin_y, cos_y)) = (3_f64.to_radians().sin_cos(), 2_f64.to_radians().sin_cos());
    let along = DVec3::new(sin_y, -sin_x * cos_y, cos_x * cos_y);
    let trace = view.trace(1024.0, 1024.0).expect("measurable");
    assert!(angle_between((trace.mirror_m - view.ellipsoid().f2()).normalize(), along) < 1e-12);
    rig.camera.lens.rotation_deg = [0.0, 0.0, 30.0];
    let to_the_right = View::camera(&rig).direction(1500.0, 1024.0).expect("measurable");
    assert!((to_the_right.y.atan2(to_the_right.x) - 30_f64.to_radians()).abs() < 1e-12);
}

#[test]
fn pixels_lie_where_the_on_axis_relation_puts_them() {
    let view = View::camera(&preset("rcg-1-16bit"));
    let focal_px = 0.96 * 1024.0 / 0.225;
    for (theta_deg, phi_deg) in [(30.0, 0.0), (45.0, 100.0), (75.0, 200.0), (90.0, 359.0)] {
        let pixel = view.pixel(from_degrees(theta_deg, phi_deg)).expect("measurable");
        let radius_px = focal_px * view.ellipsoid().psi_rad(f64::to_radians(theta_deg)).tan();
        let expected = DVec2::splat(1024.0) + radius_px * DVec2::from_angle(f64::to_radians(phi_deg));
        assert!((pixel - expected).length() < 1e-9, "{theta_deg} {phi_deg}");
    }
    let edge = view
        .pixel(from_degrees(90.0, 90.0))
        .expect("grazing is measurable");
    assert!((edge - DVec2::new(1024.0, 1024.0 + 0.96 * 1024.0)).length() < 1e-9);
}

#[test]
fn the_tilted_hemisphere_is_a_disc_in_the_middle_of_the_image() {
    for (device, view) in views(&preset("rcg-2")) {
        let half_px = f64::from(view.pinhole().height_px()) / 2.0;
        let centre = DVec2::new(f64::from(view.pinhole().width_px()) / 2.0, half_px);
        for phi_deg in 0..360 {
            let pixel = view
                .pixel(from_degrees(90.0, f64::from(phi_deg)))
                .expect("the whole hemisphere");
            assert!(
                ((pixel - centre).length() - 0.96 * half_px).abs() < 1e-6,
                "{device} {phi_deg}"
            );
        }
    }
}

#[test]
fn solid_angles_sum_to_that_of_the_region() {
    let outside_hole_sr = TAU * 27_f64.to_radians().cos();
    // A strip of constant width ±0.6° from θ = 27° to 90°: 2 sin(0.6°) × 63°.
    let wire_sr = 2.0 * 0.6_f64.to_radians().sin() * 63_f64.to_radians();
    for name in PRESETS {
        let expected_sr = if LEANING.contains(&name) {
            TAU
        } else {
            outside_hole_sr - wire_sr
        };
        let rig = preset(name)
            .with_image_size(512)
            .expect("the central square sees the sample");
        for (device, view) in views(&rig) {
            let total_sr = DirectionMap::of(&view).total_sr();
            assert!(
                (total_sr / expected_sr - 1.0).abs() < 1e-3,
                "{name} {device}: {total_sr} {expected_sr}"
            );
        }
    }
}

#[test]
fn a_displaced_device_still_measures_the_whole_region() {
    // With another pose the map is distorted, but its solid angles must still fill the same region; the
    // reach of the sample is taken away, as grazing rays of a displaced device miss a small sample.
    let mut rig = bent("rcg-1-16bit");
    rig.sample.radius_m = 1.0;
    rig.wire = None;
    rig.camera.lens.focal_px *= 0.8;
    rig.camera.lens.offset_m = [1e-4, -2e-4, 3e-4];
    let rig = rig.with_image_size(512).expect("usable");
    let total_sr = DirectionMap::of(&View::camera(&rig)).total_sr();
    let expected_sr = TAU * 27_f64.to_radians().cos();
    assert!(
        (total_sr / expected_sr - 1.0).abs() < 5e-3,
        "{total_sr} {expected_sr}"
    );
}

#[test]
fn the_map_holds_what_the_view_says() {
    let rig = bent("rcg-1-16bit").with_image_size(96).expect("usable");
    let view = View::camera(&rig);
    let map = DirectionMap::of(&view);
    assert_eq!((map.width_px, map.height_px), (96, 96));
    assert_eq!(
        (map.directions.len(), map.solid_angles_sr.len()),
        (96 * 96, 96 * 96)
    );
    let codes = map.reason_codes();
    let mut measurable = map.measurable();
    for row in 0..96 {
        for column in 0..96 {
            let (u_px, v_px) = (column as f64 + 0.5, row as f64 + 0.5);
            let index = row * 96 + column;
            assert_eq!(map.direction(column, row), view.direction(u_px, v_px));
            assert_eq!(Unmeasurable::from_code(codes[index]), map.directions[index].err());
            if let Ok(sr) = view.solid_angle_sr(u_px, v_px) {
                assert!((sr - map.solid_angles_sr[index]).abs() < 1e-12 * sr);
                assert!(sr > 0.0);
                let (at, direction, listed_sr) = measurable.next().expect("as many as are measurable");
                assert_eq!((at, Ok(direction)), (index, map.directions[index]));
                assert!((listed_sr - sr).abs() < 1e-12 * sr);
            } else {
                assert!(map.solid_angles_sr[index] == 0.0);
            }
        }
    }
    assert_eq!(measurable.next(), None);
    assert_eq!(map.direction(96, 0), Err(Unmeasurable::OutsideImage));
    assert_eq!(map.direction(0, 96), Err(Unmeasurable::OutsideImage));
}

#[test]
fn the_solid_angle_of_a_small_square_is_that_of_the_pixel() {
    let view = View::camera(&bent("rcg-2"));
    for (u_px, v_px) in [(900.0, 1000.0), (1300.0, 800.0), (700.0, 1400.0)] {
        let whole_sr = view.solid_angle_sr(u_px, v_px).expect("measurable");
        let small_sr = view.small_square_sr(DVec2::new(u_px, v_px));
        assert!((small_sr / whole_sr - 1.0).abs() < 1e-5, "{small_sr} {whole_sr}");
    }
}

#[test]
fn each_reason_is_given_where_it_applies() {
    use Unmeasurable::{BelowHorizon, BeyondRim, Hole, Occluded, OffSample, OutsideImage};
    let rig = preset("rcg-1-16bit");
    let view = View::camera(&rig);
    let reason = |view: &View, theta, phi| view.pixel(from_degrees(theta, phi)).err();
    assert_eq!(reason(&view, 0.0, 0.0), Some(Hole));
    assert_eq!(reason(&view, 27.0, 200.0), Some(Hole));
    assert_eq!(reason(&view, 27.1, 200.0), None);
    assert_eq!(
        reason(&view, 10.0, 270.0),
        Some(Hole),
        "the hole comes before the wire"
    );
    assert_eq!(reason(&view, 50.0, 270.0), Some(Occluded));
    assert_eq!(reason(&view, 90.0, 270.5), Some(Occluded));
    assert_eq!(reason(&view, 90.0, 270.7), None);
    assert_eq!(reason(&view, 50.0, 90.0), None);
    assert_eq!(reason(&view, 90.1, 0.0), Some(BelowHorizon));
    assert_eq!(reason(&view, 180.0, 0.0), Some(BelowHorizon));
    // The image: its middle looks into the hole, its corner past the horizon, below it is the wire.
    assert_eq!(view.direction(1024.0, 1024.0).err(), Some(Hole));
    assert_eq!(view.direction(5.0, 5.0).err(), Some(BelowHorizon));
    assert_eq!(view.direction(1024.0, 200.0).err(), Some(Occluded));
    assert_eq!(view.direction(1024.0, 1848.0).err(), None);
    assert_eq!(view.direction(-0.5, 5.0).err(), Some(OutsideImage));
    assert_eq!(view.direction(f64::NAN, 5.0).err(), Some(OutsideImage));

    let mut high_rim = rig.clone();
    high_rim.mirror.rim_z_m = 0.22;
    let view = View::camera(&high_rim);
    assert_eq!(reason(&view, 85.0, 0.0), Some(BeyondRim));
    assert_eq!(
        reason(&view, 85.0, 270.0),
        Some(BeyondRim),
        "the rim comes before the wire"
    );
    assert_eq!(view.direction(1024.0, 1024.0 + 970.0).err(), Some(BeyondRim));

    let mut narrow = rig.clone();
    narrow.camera.lens.focal_px *= 2.0;
    let view = View::camera(&narrow);
    assert_eq!(reason(&view, 80.0, 0.0), Some(OutsideImage));
    assert_eq!(
        reason(&view, 80.0, 270.0),
        Some(Occluded),
        "the wire comes before the image"
    );

    let mut small = rig.clone();
    small.camera.lens.offset_m = [0.003, 0.0, 0.0];
    small.sample.radius_m = 1e-5;
    let view = View::camera(&small);
    assert_eq!(reason(&view, 60.0, 10.0), Some(OffSample));
    assert_eq!(view.direction(1500.0, 1500.0).err(), Some(OffSample));
}

#[test]
fn no_direction_makes_a_panic_or_a_nan() {
    let odd = [
        0.0,
        -0.0,
        1.0,
        -1.0,
        1e300,
        -1e300,
        f64::INFINITY,
        f64::NEG_INFINITY,
        f64::NAN,
    ];
    for rig in [preset("rcg-1-16bit"), bent("rcg-2")] {
        for (_, view) in views(&rig) {
            for x in odd {
                for y in odd {
                    for z in odd {
                        assert!(
                            view.pixel(DVec3::new(x, y, z))
                                .is_ok_and(DVec2::is_nan)
                                .eq(&false)
                        );
                    }
                    assert!(!view.direction(x, y).is_ok_and(DVec3::is_nan));
                    assert!(!view.solid_angle_sr(x, y).is_ok_and(f64::is_nan));
                }
            }
        }
    }
}

proptest! {
    #[test]
    fn any_measurable_pixel_is_found_again(
        name in prop::sample::select(PRESETS.to_vec()), straight in any::<bool>(),
        u in 0.0..1.0_f64, v in 0.0..1.0_f64,
    ) {
        let rig = if straight { preset(name) } else { bent(name) };
        for (_, view) in views(&rig) {
            let (width, height) = (view.pinhole().width_px(), view.pinhole().height_px());
            let pixel = DVec2::new(u * f64::from(width), v * f64::from(height));
            if let Ok(w) = view.direction(pixel.x, pixel.y) {
                let found = view.pixel(w);
                prop_assert!(found.is_ok_and(|found| (found - pixel).length() < 1e-6), "{found:?} {pixel}");
            }
        }
    }

    #[test]
    fn the_pixel_of_any_direction_sees_it(theta_rad in 0.0..FRAC_PI_2, phi_rad in 0.0..TAU) {
        let w = from_angles(theta_rad, phi_rad);
        for name in PRESETS {
            for rig in [preset(name), bent(name)] {
                for (_, view) in views(&rig) {
                    if let Ok(pixel) = view.pixel(w) {
                        let back = view.direction(pixel.x, pixel.y);
                        prop_assert!(back.is_ok_and(|back| angle_between(back, w) < 1e-9), "{name} {back:?}");
                    }
                }
            }
        }
    }
}
