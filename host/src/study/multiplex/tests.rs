use proptest::prelude::*;

use super::cells::{check_disjoint, union};
use super::*;
use crate::brdf::sample::{Sample, parse};
use crate::hemisphere::direction::from_degrees;
use crate::instrument::optics::View;
use crate::instrument::rig::{ROUNDING_DN2, Rig};
use crate::plan::pattern::{LitSet, PatternMaker};
use crate::virtual_rig::{Noise, sense};

/// Coded exposures by the definition: y_i = Σ_j S_ij x_j, [exposure, pixel] from [cell, pixel].
fn multiplex(code: Code, cells: &[f32], pixels: usize) -> Vec<f32> {
    let mut coded = vec![0.0; code.order() * pixels];
    for (exposure, row) in coded.chunks_exact_mut(pixels).enumerate() {
        for (cell, x) in cells.chunks_exact(pixels).enumerate() {
            if code.lights(exposure, cell) {
                row.iter_mut().zip(x).for_each(|(y, x)| *y += x);
            }
        }
    }
    coded
}

#[test]
fn codes_are_s_matrices() {
    for cells in [1, 3, 7, 15, 63, 255] {
        let code = Code::for_cells(cells).unwrap();
        assert_eq!(code.order(), cells);
        for a in 0..cells {
            let ones = (0..cells).filter(|&i| code.lights(i, a)).count();
            assert_eq!(ones, cells.div_ceil(2));
            for b in 0..a {
                let both = (0..cells)
                    .filter(|&i| code.lights(i, a) && code.lights(i, b))
                    .count();
                assert_eq!(both, (cells + 1) / 4, "cells {a} and {b}");
            }
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 40, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn demultiplexing_undoes_multiplexing(cells in 1_usize..300, pixels in 1_usize..1100, seed in 0_u32..1000) {
        let code = Code::for_cells(cells).unwrap();
        let truth: Vec<f32> = (0..cells * pixels)
            .map(|i| ((i as u32).wrapping_mul(2_654_435_761).wrapping_add(seed) >> 12) as f32 / 1000.0)
            .collect();
        let mut frames = multiplex(code, &truth, pixels);
        let mut sums = vec![0.0; pixels];
        demultiplex(code, &mut frames, &mut sums);
        for (pixel, sum) in sums.iter().enumerate() {
            let total: f32 = (0..cells).map(|cell| truth[cell * pixels + pixel]).sum();
            let expected = total * (code.order() as f32 + 1.0) / 2.0;
            prop_assert!((sum - expected).abs() <= 1e-4 * expected, "pixel {pixel}: {sum} {expected}");
            for cell in 0..code.order() {
                let expected = if cell < cells { truth[cell * pixels + pixel] } else { 0.0 };
                prop_assert!((frames[cell * pixels + pixel] - expected).abs() < 3e-5 * total.max(1.0));
            }
        }
    }
}

#[test]
fn one_saturated_exposure_spoils_its_pixel_in_all_cells_and_no_other() {
    let code = Code::for_cells(31).unwrap();
    let pixels = 40;
    let mut frames = multiplex(code, &vec![2.0; 31 * pixels], pixels);
    frames[5 * pixels + 17] = f32::NAN;
    demultiplex(code, &mut frames, &mut vec![0.0; pixels]);
    for (at, value) in frames.iter().enumerate() {
        assert_eq!(value.is_nan(), at % pixels == 17, "{at}");
    }
}

/// 251 cells, 60 pixels: electrons of a sample whose incident directions run over the hemisphere, the brightest
/// `peak_e`.
fn electrons(sample: &dyn Sample, cells: usize, pixels: usize, peak_e: f64) -> Vec<f32> {
    let wo: Vec<_> = (0..pixels)
        .map(|pixel| from_degrees(10.0 + (pixel % 10) as f64 * 7.0, pixel as f64 * 36.6))
        .collect();
    let f: Vec<f64> = (0..cells)
        .flat_map(|cell| {
            let wi = from_degrees(5.0 + (cell % 16) as f64 * 5.0, cell as f64 * 137.5);
            let lobe = sample.incident(wi);
            wo.iter().map(|wo| lobe.f(*wo)[0] * wi.z).collect::<Vec<_>>()
        })
        .collect();
    let peak = f.iter().copied().fold(0.0, f64::max);
    f.iter().map(|f| (f / peak * peak_e) as f32).collect()
}

#[test]
fn the_measured_variance_is_the_predicted_one_at_251_cells() {
    const CELLS: usize = 251;
    const PIXELS: usize = 60;
    const TRIALS: u64 = 40;
    let code = Code::for_cells(CELLS).unwrap();
    for spec in ["lambert:0.5", "ward:brass"] {
        let truth = electrons(parse(spec).unwrap().as_ref(), CELLS, PIXELS, 400.0);
        let coded = multiplex(code, &truth, PIXELS);
        for read_noise_e in [0.0, 3.0, 10.0, 100.0] {
            let mut rig = Rig::load("rcg-1-16bit").unwrap();
            rig.camera.read_noise_e = read_noise_e;
            rig.camera.full_well_e = 1e6; // saturation is not what is tested here
            rig.camera.dark_dn = 2000.0; // nor is the converter's lower end
            rig.camera.dark_current_e_per_s = 0.0;
            let gain = rig.gain_e_per_dn();
            let read_variance = read_noise_e * read_noise_e + gain * gain * ROUNDING_DN2;
            let (mut measured, mut predicted, mut propagated) = (0.0, 0.0, 0.0);
            for trial in 0..TRIALS {
                let dn = sense(&rig, &coded, 0.01, Noise::On, 7 + trial);
                let mut frames: Vec<f32> = dn
                    .iter()
                    .map(|dn| (f32::from(*dn) - 2000.0) * gain as f32)
                    .collect();
                let mut sums = vec![0.0; PIXELS];
                demultiplex(code, &mut frames, &mut sums);
                for pixel in 0..PIXELS {
                    let total: f64 = (0..CELLS)
                        .map(|cell| f64::from(truth[cell * PIXELS + pixel]))
                        .sum();
                    // Each pixel has the same weight, bright or dim.
                    let expected = code.variance_of_cells(total, read_variance, 1.0);
                    predicted += 1.0;
                    propagated += code.variance(f64::from(sums[pixel]), read_variance, 1.0) / expected;
                    let squares: f64 = (0..CELLS)
                        .map(|cell| {
                            f64::from(frames[cell * PIXELS + pixel] - truth[cell * PIXELS + pixel]).powi(2)
                        })
                        .sum();
                    measured += squares / CELLS as f64 / expected;
                }
            }
            let ratio = measured / predicted;
            assert!(
                (ratio - 1.0).abs() < 0.05,
                "{spec}, {read_noise_e} e⁻: measured/predicted {ratio}"
            );
            let ratio = propagated / predicted;
            assert!(
                (ratio - 1.0).abs() < 0.01,
                "{spec}, {read_noise_e} e⁻: propagated/predicted {ratio}"
            );
        }
    }
}

fn lit_sets(spot_deg: f64, step_deg: f64) -> Vec<LitSet> {
    let rig = Rig::load("rcg-2").unwrap();
    let directions =
        crate::plan::Directions::new(&rig, &crate::hemisphere::incident::Grid::ThetaPhi { step_deg })
            .unwrap();
    let maker = PatternMaker::new(View::projector(&rig), spot_deg, 1.0);
    let lit = directions
        .measurable()
        .map(|index| maker.lit_set(directions.grid.direction(index)));
    lit.filter_map(Result::ok).collect()
}

#[test]
fn blocks_hold_every_direction_once_and_their_cells_are_disjoint() {
    let lit = lit_sets(1.0, 5.0);
    for order in [1, 7, 31, 100, 127] {
        let blocks = Blocks::new(lit.len(), order).unwrap();
        let mut seen = vec![0; lit.len()];
        for block in 0..blocks.count() {
            let cells: Vec<usize> = blocks.cells(block).collect();
            assert!(cells.len() <= order);
            check_disjoint(cells.iter().map(|&i| (i, &lit[i]))).unwrap();
            for &cell in &cells {
                seen[cell] += 1;
            }
            // Every cell is in (n + 1)/2 patterns.
            let code = blocks.code(block);
            let sets: Vec<&LitSet> = cells.iter().map(|&i| &lit[i]).collect();
            let pixels: usize = (0..code.order()).map(|e| union(code, e, &sets).len()).sum();
            let alone: usize = sets.iter().map(|set| set.pixels.len()).sum();
            assert_eq!(pixels, alone * code.order().div_ceil(2));
        }
        assert!(seen.iter().all(|&times| times == 1), "order {order}");
    }
}

#[test]
fn orders_and_cells_that_do_not_fit_are_refused_in_a_sentence() {
    assert_eq!(
        Blocks::new(100, 0).unwrap_err().to_string(),
        "order: expected a number of cells from 1 to 4095, found 0"
    );
    assert_eq!(
        Blocks::new(100, 101).unwrap_err().to_string(),
        "order: expected at most the 100 cells (incident directions that can be lit), found 101"
    );
    let lit = lit_sets(12.0, 5.0);
    let overlap = check_disjoint(lit.iter().enumerate()).unwrap_err();
    let CellError::Overlap { first, second, pixel } = overlap else {
        panic!("{overlap}")
    };
    assert!(lit[first].pixels.contains(&pixel) && lit[second].pixels.contains(&pixel));
    assert!(
        overlap
            .to_string()
            .contains(&format!("directions {first} and {second}")),
        "{overlap}"
    );
}
