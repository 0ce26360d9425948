//! Patterns per second on one core: choosing the lit pixels and drawing the packed 1024×768 image.
//!
//! The mark is 9,523 patterns/s, the rate of the DMD of preset `dmd`.

use divan::{Bencher, black_box, counter::ItemsCount};
use rcg::hemisphere::incident::Rings;
use rcg::instrument::optics::View;
use rcg::instrument::rig::Rig;
use rcg::plan::pattern::{BitPattern, PatternMaker};

fn main() {
    divan::main();
}

#[divan::bench(sample_count = 20, sample_size = 1, args = [1.0, 2.0])]
fn draw_1000(bencher: Bencher, step_deg: f64) {
    let rig = Rig::load("dmd").expect("a preset");
    let maker = PatternMaker::new(View::projector(&rig), rig.light.spot_deg, 1.0);
    let grid = Rings::theta_phi(step_deg).expect("divides 90");
    let (width_px, height_px) = maker.size_px();
    let mut image = BitPattern::black(width_px, height_px);
    let lit: Vec<_> = (0..grid.len())
        .map(|i| grid.direction(i))
        .filter(|w| maker.lit_set(*w).is_ok())
        .collect();
    let every = lit.len() / 1000;
    bencher.counter(ItemsCount::new(1000_u32)).bench_local(|| {
        for w in lit.iter().step_by(every).take(1000) {
            image.clear();
            image.light(&maker.lit_set(*w).expect("chosen so").pixels);
            black_box(image.bytes());
        }
    });
}
