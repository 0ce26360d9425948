//! Neighbours of a direction among about 20,000 incident directions: on rings, and on the Delaunay triangulation of a
//! list.

use divan::{Bencher, black_box};
use glam::DVec3;
use rcg::hemisphere::direction::from_degrees;
use rcg::hemisphere::incident::{Grid, IncidentSet};

fn main() {
    divan::main();
}

fn rings() -> IncidentSet {
    let grid = Grid::EqualSolidAngle { step_deg: 1.0 };
    grid.build().expect("divides 90")
}

fn list() -> IncidentSet {
    let rings = rings();
    let directions_deg = (0..rings.len()).map(|i| rings.angles_deg(i).into()).collect();
    Grid::List { directions_deg }
        .build()
        .expect("all over the hemisphere")
}

/// Directions without any order, so that no search begins where the last one ended.
fn places() -> Vec<DVec3> {
    let place = |i: u32| {
        from_degrees(
            f64::from(i * 7919 % 8900) / 100.0,
            f64::from(i * 104_729 % 36_000) / 100.0,
        )
    };
    (0..1000).map(place).collect()
}

#[divan::bench(args = ["rings", "list"])]
fn neighbours_of_1000(bencher: Bencher, kind: &str) {
    let set = if kind == "rings" { rings() } else { list() };
    let places = places();
    bencher
        .counter(divan::counter::ItemsCount::new(places.len()))
        .bench_local(|| {
            for &w in &places {
                black_box(set.neighbours(black_box(w)));
            }
        });
}

#[divan::bench(sample_count = 10)]
fn triangulate(bencher: Bencher) {
    bencher.bench_local(|| black_box(list()));
}
