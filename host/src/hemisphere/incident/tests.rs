//! Laws that every kind of incident set keeps.

use glam::DVec3;
use rand::{RngExt as _, SeedableRng as _};
use rand_xoshiro::Xoshiro256PlusPlus;

use super::*;
use crate::hemisphere::direction::{angle_between, from_degrees, to_angles};

/// Directions of equal solid angle, in random order and moved a little so that no four lie on a circle.
fn scattered(step_deg: f64) -> Grid {
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(7);
    let rings = Rings::equal_solid_angle(step_deg).unwrap();
    let mut directions_deg: Vec<[f64; 2]> = (0..rings.len())
        .map(|index| {
            let (theta, phi) = rings.angles_deg(index);
            [theta + 0.2 * step_deg * rng.random_range(-1.0..1.0), phi]
        })
        .collect();
    for place in 1..directions_deg.len() {
        directions_deg.swap(place, rng.random_range(0..=place));
    }
    Grid::List { directions_deg }
}

fn kinds(step_deg: f64) -> [Grid; 3] {
    [
        Grid::ThetaPhi { step_deg },
        Grid::EqualSolidAngle { step_deg },
        scattered(step_deg),
    ]
}

/// Directions all over the hemisphere, the pole and the horizon among them.
fn places() -> impl Iterator<Item = DVec3> {
    (0..=180).flat_map(|theta| {
        (0..72).map(move |phi| from_degrees(f64::from(theta) * 0.5, f64::from(phi) * 5.0 + 0.3))
    })
}

#[test]
fn counts_are_the_papers_and_those_of_equal_solid_angle() {
    assert_eq!(Rings::theta_phi(1.0).unwrap().len(), 32_400);
    assert_eq!(Rings::theta_phi(15.0).unwrap().len(), 144);
    let rings = Rings::equal_solid_angle(1.0).unwrap();
    // 2π sr in squares of 1°.
    let squares = 360.0 * 180.0 / std::f64::consts::PI;
    assert!(
        (rings.len() as f64 / squares - 1.0).abs() < 0.005,
        "{}",
        rings.len()
    );
    let outside = (0..rings.len())
        .filter(|&index| rings.angles_deg(index).0 > 27.0)
        .count();
    assert!((18_300..18_500).contains(&outside), "{outside}");
}

#[test]
fn no_gap_of_equal_solid_angle_exceeds_the_step() {
    for step_deg in [1.0, 7.5, 45.0] {
        let rings = Rings::equal_solid_angle(step_deg).unwrap();
        for ring in 0..rings.rings() {
            let theta_deg = (ring as f64 + 0.5) * step_deg;
            let gap_deg = 360.0 / rings.count(ring) as f64 * theta_deg.to_radians().sin();
            assert!(gap_deg <= step_deg + 1e-9, "{step_deg}°, ring {ring}: {gap_deg}");
            // One direction fewer would be too few.
            let wider = 360.0 / (rings.count(ring) as f64 - 1.0) * theta_deg.to_radians().sin();
            assert!(wider > step_deg, "{step_deg}°, ring {ring}");
        }
    }
}

#[test]
fn a_step_that_does_not_divide_is_refused() {
    for step in [7.0, 0.0, -1.0, 60.0, f64::NAN, f64::INFINITY, 0.1] {
        assert!(Rings::theta_phi(step).is_err(), "{step}");
        assert!(Rings::equal_solid_angle(step).is_err(), "{step}");
    }
    assert!(Rings::theta_phi(7.5).is_ok());
}

#[test]
fn a_direction_is_its_own_neighbour() {
    for grid in kinds(5.0) {
        let set = grid.build().unwrap();
        for index in 0..set.len() {
            let neighbours = set.neighbours(set.direction(index));
            let own: f64 = neighbours.iter().filter(|n| n.0 == index).map(|n| n.1).sum();
            assert!(
                (own - 1.0).abs() < 1e-7,
                "{grid}: direction {index} has weight {own}"
            );
        }
    }
}

#[test]
fn weights_are_no_less_than_0_and_sum_to_1_and_neighbours_are_near() {
    for grid in kinds(5.0) {
        let set = grid.build().unwrap();
        for w in places() {
            let neighbours = set.neighbours(w);
            let sum: f64 = neighbours.iter().map(|n| n.1).sum();
            assert!((sum - 1.0).abs() < 1e-12, "{grid}: {sum}");
            for (index, weight) in neighbours {
                assert!(weight >= 0.0, "{grid}: {weight}");
                let away_deg = angle_between(set.direction(index), w).to_degrees();
                // The hull's edges are long where the outermost directions do not lie on one ring.
                let far = if to_angles(w).0.to_degrees() > 80.0 {
                    30.0
                } else {
                    11.0
                };
                assert!(away_deg < far || weight == 0.0, "{grid}: {away_deg}°");
            }
        }
    }
}

/// Largest error of interpolating x, y and z within the outermost directions.
fn linear_error(set: &IncidentSet, limit_deg: f64) -> f64 {
    places()
        .filter(|w| to_angles(*w).0.to_degrees() < limit_deg)
        .map(|w| {
            let found: DVec3 = set
                .neighbours(w)
                .iter()
                .map(|&(index, weight)| weight * set.direction(index))
                .sum();
            (found - w).abs().max_element()
        })
        .fold(0.0, f64::max)
}

#[test]
fn linear_functions_are_reproduced_to_second_order_in_the_spacing() {
    for (coarse, fine) in kinds(6.0).iter().zip(kinds(3.0)) {
        let (coarse_error, fine_error) = (
            linear_error(&coarse.build().unwrap(), 75.0),
            linear_error(&fine.build().unwrap(), 75.0),
        );
        assert!(
            fine_error < 0.75 * 3_f64.to_radians().powi(2),
            "{fine}: {fine_error}"
        );
        assert!(
            coarse_error / fine_error > 3.0,
            "{coarse}: {coarse_error}, {fine}: {fine_error}"
        );
    }
}

#[test]
fn interpolation_is_continuous_but_at_the_pole_of_rings() {
    for grid in kinds(10.0) {
        let set = grid.build().unwrap();
        let value = |w: DVec3| -> f64 {
            // A rough function: every direction has a value of its own.
            set.neighbours(w)
                .iter()
                .map(|&(index, weight)| weight * f64::from((index * 7919 % 101) as u32))
                .sum()
        };
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(3);
        for w in places().filter(|w| w.z > 0.05 && w.z < 1.0) {
            let near = (w + 1e-8 * DVec3::new(rng.random(), rng.random(), 0.0)).normalize();
            let jump = (value(near) - value(w)).abs();
            assert!(jump < 1e-3, "{grid}: {jump} at {:?}", to_angles(w));
        }
    }
}

#[test]
fn beyond_the_hull_of_a_list_the_nearest_place_of_the_hull_counts() {
    let grid = Grid::List {
        directions_deg: vec![[60.0, 0.0], [60.0, 90.0], [60.0, 180.0], [60.0, 270.0]],
    };
    let set = grid.build().unwrap();
    let heaviest = |w| {
        set.neighbours(w)
            .into_iter()
            .max_by(|a, b| a.1.total_cmp(&b.1))
            .unwrap()
    };
    for (index, phi_deg) in [0.0, 90.0, 180.0, 270.0].into_iter().enumerate() {
        for off in [-8.0, 0.0, 8.0] {
            let (nearest, weight) = heaviest(from_degrees(89.0, phi_deg + off));
            assert_eq!(nearest, index, "{phi_deg} {off}");
            assert!((weight - 1.0).abs() < 1e-12 || off != 0.0);
        }
    }
    let (_, middle) = heaviest(from_degrees(80.0, 45.0));
    assert!((middle - 0.5).abs() < 1e-9, "{middle}");
}

#[test]
fn adjacent_directions_are_near_mutual_and_around() {
    for grid in kinds(10.0) {
        let set = grid.build().unwrap();
        for index in 0..set.len() {
            let adjacent = set.adjacent(index);
            assert!(
                adjacent.len() >= 2 && !adjacent.contains(&index),
                "{grid}: {index}: {adjacent:?}"
            );
            let mut unique = adjacent.clone();
            unique.sort_unstable();
            unique.dedup();
            assert_eq!(unique.len(), adjacent.len(), "{grid}: {index}");
            let (theta_deg, _) = set.angles_deg(index);
            if theta_deg < 75.0 {
                // Within the sum of the weights of the rest: the direction lies inside of what is around it.
                let mean: DVec3 = adjacent.iter().map(|&other| set.direction(other)).sum();
                let away = angle_between(mean.normalize(), set.direction(index)).to_degrees();
                assert!(away < 8.0, "{grid}: {index}: {away}°");
            }
        }
    }
}

#[test]
fn a_circumcentre_is_equally_far_from_its_corners_and_nothing_is_nearer() {
    let IncidentSet::List(list) = scattered(10.0).build().unwrap() else {
        unreachable!()
    };
    for triangle in list.triangles() {
        let centre = list.circumcentre(triangle);
        let radius = angle_between(centre, list.direction(triangle[0]));
        for corner in triangle {
            assert!((angle_between(centre, list.direction(corner)) - radius).abs() < 1e-9);
        }
        for other in 0..list.len() {
            assert!(
                angle_between(centre, list.direction(other)) > radius - 1e-9,
                "{triangle:?} {other}"
            );
        }
    }
}

#[test]
fn lists_that_make_no_triangles_are_refused() {
    let refused = |directions_deg: &[[f64; 2]], part: &str| {
        let error = DirectionList::new(directions_deg).unwrap_err().to_string();
        assert!(error.contains(part), "{error}");
    };
    refused(&[[10.0, 0.0], [20.0, 0.0]], "found 2");
    refused(&[[10.0, 0.0], [20.0, 0.0], [30.0, 180.0]], "great circle");
    refused(
        &[[10.0, 0.0], [20.0, 90.0], [90.0, 180.0]],
        "(90, 180) at place 3",
    );
    refused(
        &[[10.0, 0.0], [-20.0, 90.0], [50.0, 180.0]],
        "(-20, 90) at place 2",
    );
    refused(&[[10.0, 0.0], [20.0, f64::NAN], [50.0, 180.0]], "at place 2");
    refused(
        &[[10.0, 0.0], [20.0, 90.0], [50.0, 180.0], [10.0, 360.0]],
        "places 1 and 4",
    );
    refused(
        &[[0.0, 0.0], [20.0, 90.0], [50.0, 180.0], [0.0, 77.0]],
        "places 1 and 4",
    );
}

#[test]
fn a_list_file_is_read_and_its_faults_named() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("list.txt");
    let read = |text: &str| {
        std::fs::write(&path, text).unwrap();
        Grid::read_list(&path)
    };
    let grid = read("# θ φ\n10 0\n\n 20\t90.5 # a remark\n3e1 -120\n").unwrap();
    assert_eq!(
        grid,
        Grid::List {
            directions_deg: vec![[10.0, 0.0], [20.0, 90.5], [30.0, -120.0]]
        }
    );
    for (text, part) in [
        ("10 0\n20 90\n30\n", "line 3: expected two numbers"),
        (
            "10 0\n20 ninety\n",
            "line 2: expected two numbers, θ and φ in degrees, found `20 ninety`",
        ),
        ("10 0\n20 90\n", "found 2"),
        ("", "found 0"),
        ("10 0\n20 90\n95 180\n", "(95, 180) at place 3"),
    ] {
        let error = read(text).unwrap_err().to_string();
        assert!(error.contains(part) && error.contains("list.txt"), "{error}");
    }
    std::fs::write(&path, [0xff, 0xfe, 0x00]).unwrap();
    assert!(
        Grid::read_list(&path)
            .unwrap_err()
            .to_string()
            .contains("no readable text")
    );
}

#[test]
fn eight_look_ups_at_once_are_those_of_one() {
    let all: Vec<DVec3> = places().filter(|w| w.z > 1e-12).collect();
    for step_deg in [3.0, 10.0, 45.0] {
        let grids = kinds(step_deg).into_iter().flat_map(|grid| {
            let set = grid.build().unwrap();
            let turned = set.turned(17.3).unwrap();
            [(grid.clone(), set), (grid, turned)]
        });
        for (grid, set) in grids {
            for w in all.as_chunks().0 {
                let found = set.neighbours_of_eight(w, &Vectors::of(w));
                for lane in 0..LANES {
                    let mut off = std::collections::HashMap::new();
                    for (row, weight) in set.neighbours(w[lane]) {
                        *off.entry(row).or_insert(0.0) += weight;
                    }
                    let rows = found.rows.map(|rows| rows[lane]);
                    assert!(rows.is_sorted(), "{grid} {}: {rows:?}", w[lane]);
                    for (row, weight) in rows.into_iter().zip(found.weights) {
                        *off.entry(row as usize).or_insert(0.0) -= f64::from(weight[lane]);
                    }
                    let most = off.values().fold(0.0, |most, off| f64::max(most, off.abs()));
                    assert!(most < 3e-5, "{grid} {}: {off:?}", w[lane]);
                }
            }
        }
    }
}
