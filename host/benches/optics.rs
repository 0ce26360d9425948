//! Pixels ↔ directions.

use divan::{Bencher, black_box, counter::ItemsCount};
use rcg::hemisphere::direction::from_degrees;
use rcg::instrument::optics::{DirectionMap, DirectionTable, View};
use rcg::instrument::rig::Rig;

fn main() {
    divan::main();
}

#[divan::bench(sample_count = 10, sample_size = 1, args = ["rcg-1-16bit", "rcg-2"])]
fn direction_map_1024x768(bencher: Bencher, preset: &str) {
    let view = View::projector(&Rig::load(preset).expect("a preset"));
    bencher
        .counter(ItemsCount::new(1024_u32 * 768))
        .bench_local(|| DirectionMap::of(black_box(&view)));
}

#[divan::bench(args = ["rcg-1-16bit", "rcg-2"])]
fn direction_to_pixel(bencher: Bencher, preset: &str) {
    let view = View::camera(&Rig::load(preset).expect("a preset"));
    let w = from_degrees(50.0, 33.0);
    bencher
        .counter(ItemsCount::new(1_u32))
        .bench_local(|| view.pixel(black_box(w)));
}

/// Positions of the camera's image that all see something, in no order.
fn positions(view: &View) -> Vec<(f64, f64)> {
    let size_px = f64::from(view.pinhole().width_px());
    (0..1 << 16)
        .map(|step| {
            (
                f64::from(step) * 0.618_034 % 1.0 * size_px,
                f64::from(step) / f64::from(1 << 16) * size_px,
            )
        })
        .filter(|&(u_px, v_px)| view.direction(u_px, v_px).is_ok())
        .collect()
}

/// The baseline of `pixel_to_direction_table`.
#[divan::bench(args = ["rcg-1-16bit", "rcg-2"])]
fn pixel_to_direction_traced(bencher: Bencher, preset: &str) {
    let view = View::camera(&Rig::load(preset).expect("a preset"));
    let positions = positions(&view);
    bencher.counter(ItemsCount::new(positions.len())).bench_local(|| {
        positions
            .iter()
            .filter(|(u, v)| view.direction(*u, *v).is_ok())
            .count()
    });
}

#[divan::bench(args = ["rcg-1-16bit", "rcg-2"])]
fn pixel_to_direction_table(bencher: Bencher, preset: &str) {
    let view = View::camera(&Rig::load(preset).expect("a preset"));
    let (table, positions) = (DirectionTable::new(&view, 1e-6), positions(&view));
    println!("{preset}: largest error {:.1e} rad", table.max_error_rad());
    bencher.counter(ItemsCount::new(positions.len())).bench_local(|| {
        positions
            .iter()
            .filter_map(|(u, v)| table.direction(*u, *v).ok())
            .sum::<glam::DVec3>()
    });
}
