//! `map`: directions to pixels.

use serde_json::Value;

use crate::command::run;

/// The answers to `theta phi` lines.
fn map(rig: &str, directions: &[(f64, f64)]) -> Vec<String> {
    let lines: Vec<String> = directions
        .iter()
        .map(|(theta, phi)| format!("{theta} {phi}"))
        .collect();
    let answers: Vec<String> = run(&["map", "--rig", rig], &lines.join("\n"))
        .done()
        .lines()
        .map(str::to_owned)
        .collect();
    assert_eq!(answers.len(), directions.len());
    answers
}

/// The four numbers of an answer.
fn pixels(answer: &str) -> [f64; 4] {
    let numbers: Vec<f64> = answer
        .split(' ')
        .map(|word| word.parse().expect(answer))
        .collect();
    numbers.try_into().expect(answer)
}

/// Widths and heights of camera and projector.
fn sizes(rig: &str) -> [f64; 4] {
    let camera = if rig == "dmd" { 512.0 } else { 2048.0 };
    [camera, camera, 1024.0, 768.0]
}

#[test]
fn the_rigs_on_the_axis_have_a_hole_and_the_tilted_one_has_not() {
    for rig in ["rcg-1-16bit", "dmd"] {
        assert_eq!(map(rig, &[(0.0, 0.0), (26.9, 80.0)]), ["- hole", "- hole"]);
        pixels(&map(rig, &[(27.1, 80.0)])[0]);
    }
    pixels(&map("rcg-2", &[(0.0, 0.0)])[0]);
}

#[test]
fn nothing_is_seen_below_the_horizon() {
    for rig in ["rcg-1-16bit", "rcg-2", "dmd"] {
        let answers = map(rig, &[(95.0, 0.0), (180.0, 0.0), (90.1, 271.0)]);
        assert!(
            answers.iter().all(|answer| answer == "- below horizon"),
            "{rig}: {answers:?}"
        );
    }
}

#[test]
fn the_wire_hides_what_is_behind_it() {
    assert_eq!(map("rcg-1-16bit", &[(45.0, 270.0)]), ["- occluded"]);
    pixels(&map("rcg-1-16bit", &[(45.0, 272.0)])[0]);
}

#[test]
fn what_can_be_measured_is_inside_both_images() {
    let directions: Vec<(f64, f64)> = (0..72).map(|i| (45.0, 2.0 + 5.0 * f64::from(i))).collect();
    for rig in ["rcg-1-16bit", "rcg-2", "dmd"] {
        for answer in map(rig, &directions) {
            for (pixel, size) in pixels(&answer).into_iter().zip(sizes(rig)) {
                assert!((0.0..size).contains(&pixel), "{rig}: {answer}");
            }
        }
    }
}

#[test]
fn on_the_axis_the_image_is_the_formulas_and_turns_with_the_azimuth() {
    // tan(ψ/2) = (b − c)/(b + c) · tan(θ/2) with b = 0.25 m, c = 0.2 m; both lenses have their θ = 90° (tangent
    // 0.225) at 0.96 of half their height.
    let radius = |theta_deg: f64, height: f64| {
        let psi = 2.0 * (0.05 / 0.45 * (theta_deg.to_radians() / 2.0).tan()).atan();
        psi.tan() / 0.225 * 0.96 * height / 2.0
    };
    for rig in ["rcg-1-16bit", "dmd"] {
        let [width, height, proj_width, proj_height] = sizes(rig);
        for theta in [30.0, 45.0, 60.0, 85.0] {
            let directions: Vec<(f64, f64)> = (0..24).map(|i| (theta, 2.0 + 15.0 * f64::from(i))).collect();
            let answers = map(rig, &directions);
            let at = |answer: &String| {
                let [u, v, proj_u, proj_v] = pixels(answer);
                [
                    (u - width / 2.0, v - height / 2.0),
                    (proj_u - proj_width / 2.0, proj_v - proj_height / 2.0),
                ]
            };
            for (device, height) in [height, proj_height].into_iter().enumerate() {
                let points: Vec<(f64, f64)> = answers.iter().map(|answer| at(answer)[device]).collect();
                for &(x, y) in &points {
                    assert!(
                        (x.hypot(y) - radius(theta, height)).abs() < 1e-5,
                        "{rig} {theta}: {x} {y}"
                    );
                }
                let turns: Vec<f64> = points
                    .windows(2)
                    .map(|pair| {
                        let [(ax, ay), (bx, by)] = [pair[0], pair[1]];
                        (ax * by - ay * bx).atan2(ax * bx + ay * by).to_degrees()
                    })
                    .collect();
                // Either sense is right, but it is the same all around.
                assert!(
                    turns.iter().all(|turn| (turn.abs() - 15.0).abs() < 1e-4),
                    "{turns:?}"
                );
                assert!(
                    turns.iter().all(|turn| turn.signum() == turns[0].signum()),
                    "{turns:?}"
                );
            }
        }
    }
}

#[test]
fn an_image_of_another_size_is_the_same_image() {
    let full = pixels(&map("rcg-1-16bit", &[(50.0, 33.0)])[0]);
    let small = pixels(run(&["map", "--image-size", "64"], "50 33\n").done().trim_end());
    for axis in 0..2 {
        assert!(
            (small[axis] * 32.0 - full[axis]).abs() < 1e-4,
            "{small:?} {full:?}"
        );
        assert!(
            (small[axis + 2] - full[axis + 2]).abs() < 1e-9,
            "the projector stays as it is"
        );
    }
}

#[test]
fn json_says_the_same() {
    let lines = "45 10\n0 0\n";
    let object = run(&["map", "--json"], lines).object();
    assert_eq!(object["rig"], "rcg-1-16bit");
    let directions = object["directions"].as_array().unwrap();
    let [cam_u, cam_v, proj_u, proj_v] = pixels(&map("rcg-1-16bit", &[(45.0, 10.0)])[0]);
    for (path, expected) in [
        ("/cam_px/0", cam_u),
        ("/cam_px/1", cam_v),
        ("/proj_px/0", proj_u),
        ("/proj_px/1", proj_v),
    ] {
        let found = directions[0].pointer(path).and_then(Value::as_f64).unwrap();
        assert!((found - expected).abs() < 1e-6, "{path}");
    }
    assert_eq!(directions[0]["theta_deg"], 45.0);
    assert_eq!(directions[0]["phi_deg"], 10.0);
    assert_eq!(directions[1]["reason"], "hole");
}

#[test]
fn the_spread_tells_parallax_and_blur() {
    let outcome = run(&["map", "--spread"], "50 10\n");
    let answer = outcome.done();
    let numbers: Vec<f64> = answer
        .split_whitespace()
        .map(|word| word.parse().expect(answer))
        .collect();
    let [_, _, _, _, parallax_mm, cam_deg, cam_mm, proj_deg, proj_mm] = numbers[..] else {
        panic!("nine numbers: {answer}")
    };
    // An aligned rig: everything meets at the focus. The hemisphere's 180° over 1,966 and 737 pixels.
    assert!(parallax_mm.abs() + cam_mm + proj_mm < 1e-4, "{answer}");
    assert!(
        (0.05..0.2).contains(&cam_deg) && (0.15..0.5).contains(&proj_deg),
        "{answer}"
    );
    let object = run(&["map", "--spread", "--json"], "50 10\n").object();
    assert!(object["directions"][0]["spread"]["cam_deg"].is_number());
}
