//! Pixels ↔ directions.

use divan::{Bencher, black_box, counter::ItemsCount};
use rcg::direction::from_degrees;
use rcg::optics::{DirectionMap, View};
use rcg::rig::Rig;

fn main() {
    divan::main();
}

#[divan::bench(sample_count = 10, sample_size = 1, args = ["rcg-1", "rcg-2"])]
fn direction_map_1024x768(bencher: Bencher, preset: &str) {
    let view = View::projector(&Rig::load(preset).expect("a preset"));
    bencher
        .counter(ItemsCount::new(1024_u32 * 768))
        .bench_local(|| DirectionMap::of(black_box(&view)));
}

#[divan::bench(args = ["rcg-1", "rcg-2"])]
fn direction_to_pixel(bencher: Bencher, preset: &str) {
    let view = View::camera(&Rig::load(preset).expect("a preset"));
    let w = from_degrees(50.0, 33.0);
    bencher
        .counter(ItemsCount::new(1_u32))
        .bench_local(|| view.pixel(black_box(w)));
}
