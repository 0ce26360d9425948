//! Demultiplexing in bytes of f32 input per second, all cores; 96×96×3 pixels, or fewer where the code is long.

use divan::{Bencher, counter::BytesCount};
use rcg::study::multiplex::{Code, demultiplex};

fn main() {
    divan::main();
}

#[divan::bench(sample_count = 10, sample_size = 1, args = [31, 255, 1023, 4095])]
fn demultiplex_frames(bencher: Bencher, order: usize) {
    let code = Code::for_cells(order).expect("a code");
    let pixels = if order > 255 { 32 * 32 * 3 } else { 96 * 96 * 3 };
    let mut frames: Vec<f32> = (0..order * pixels).map(|i| (i % 4099) as f32).collect();
    let mut sums = vec![0.0; pixels];
    bencher
        .counter(BytesCount::new(order * pixels * size_of::<f32>()))
        .bench_local(|| demultiplex(code, &mut frames, &mut sums));
}
