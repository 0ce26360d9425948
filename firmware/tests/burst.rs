//! A burst plays the table, all cycles of it, in slices that last long enough.

use proptest::prelude::*;
use rcg_firmware::burst::{Burst, Haste, Tally};
use rcg_firmware::pulse::WordFormat;
use rcg_firmware::store::{MAX_WORDS, Store};
use rcg_protocol::{Extent, Pace, Polarity, Pulse, Step, Ticks};

const FORMAT: WordFormat = WordFormat::new(
    Pace::FreeRunning,
    Polarity {
        proj_active_low: false,
        cam_active_low: true,
        sync_active_low: false,
        strobe_active_low: false,
    },
);

/// A step of 1 to 4 words, by which pulses it has.
fn step(pulses: u8, period: u64) -> Step {
    let pulse = |bit: u8, at| {
        if pulses & bit == 0 {
            Pulse::NONE
        } else {
            Pulse::new(at, 4)
        }
    };
    Step {
        proj: pulse(1, 0),
        cam: pulse(2, 5 + period / 8),
        period: Ticks(period),
    }
}

/// A table in its store, and the burst that plays it `cycles` times.
fn burst(table: &[Step], cycles: u32, slice_for: u64) -> (Store, Burst) {
    let steps = table.len() as u32;
    let mut store = Store::new();
    store.begin(Extent::Table { steps, cycles });
    let mut haste = Haste::new(Ticks::ZERO);
    for step in table {
        store.push(&FORMAT.encode(step, 0).unwrap()).unwrap();
        haste.add(step.period);
    }
    let burst = Burst::new(&mut store, &haste, cycles, Ticks(slice_for));
    (store, burst)
}

/// The words of all slices one after the other, and how many steps each slice has.
fn play(store: &Store, burst: &mut Burst) -> (Vec<u32>, Vec<u64>) {
    let (mut words, mut slices) = (Vec::new(), Vec::new());
    while let Some((range, steps)) = burst.next_slice(store) {
        words.extend_from_slice(store.slice(range));
        slices.push(steps);
    }
    (words, slices)
}

proptest! {
    #[test]
    fn slices_are_the_table_in_all_its_cycles_and_last_long_enough(
        table in prop::collection::vec((0..4_u8, 16..400_u64), 1..60),
        cycles in 1..40_u32,
        slice_for in 1..30_000_u64,
    ) {
        let table: Vec<Step> = table.into_iter().map(|(pulses, period)| step(pulses, period)).collect();
        let (store, mut burst) = burst(&table, cycles, slice_for);
        let (words, slices) = play(&store, &mut burst);
        prop_assert_eq!(words, store.table().repeat(cycles as usize));
        prop_assert_eq!(slices.iter().sum::<u64>(), table.len() as u64 * u64::from(cycles));

        let shortest = table.iter().map(|step| step.period.0).min().unwrap();
        let mut played = table.iter().map(|step| step.period.0).cycle();
        for &steps in &slices[..slices.len() - 1] {
            let lasts: u64 = played.by_ref().take(steps as usize).sum();
            prop_assert!(lasts >= slice_for, "{} steps last {} ticks", steps, lasts);
            let whole_passes = steps % table.len() as u64 == 0;
            prop_assert!(whole_passes || steps * shortest >= slice_for);
        }
    }

    #[test]
    fn times_agree_with_the_sum_of_the_periods(
        table in prop::collection::vec((0..4_u8, 16..400_u64), 1..20),
        cycles in 1..10_u32,
        steps in 0.0..=1.0_f64,
        early in 1..16_u64,
        piece in 1..9_u32,
    ) {
        let table: Vec<Step> = table.into_iter().map(|(pulses, period)| step(pulses, period)).collect();
        let (store, burst) = burst(&table, cycles, 1_000);
        let steps = (steps * table.len() as f64 * f64::from(cycles)) as u64;
        let ends: u64 = table.iter().cycle().take(steps as usize).map(|step| step.period.0).sum();
        // In pieces of some steps, none of which takes long.
        let tally = |mut tally: Tally| loop {
            if let Some(found) = tally.go_on(&burst, &store, FORMAT, piece) {
                break found;
            }
        };
        prop_assert_eq!(tally(burst.tally_of(steps)), (steps, Ticks(ends)));
        prop_assert_eq!(tally(burst.tally_by(Ticks(ends))), (steps, Ticks(ends)));
        prop_assert_eq!(tally(burst.tally_by(Ticks(ends + early - 1))), (steps, Ticks(ends)));
        if steps > 0 {
            prop_assert_eq!(tally(burst.tally_by(Ticks(ends - early))).0, steps - 1);
        }
    }
}

#[test]
fn a_slice_is_as_long_as_memory_allows() {
    let table = [step(2, 16)];
    let words = 3;
    let most = (MAX_WORDS / words) as u64;
    let (store, mut burst) = burst(&table, 12_000, 16 * 10_000);
    assert_eq!(store.table().len(), words);
    let (played, slices) = play(&store, &mut burst);
    assert_eq!(slices, [most, most, 12_000 - 2 * most]);
    assert_eq!(played, store.table().repeat(12_000));
}

#[test]
fn haste_is_the_most_that_the_cpu_is_behind() {
    let haste = |periods: &[u64]| {
        let mut haste = Haste::new(Ticks(40));
        for &period in periods {
            haste.add(Ticks(period));
        }
        haste
    };
    // As slow as the CPU, however many; or a little short now and then, with time to catch up.
    assert!(!haste(&[40; 1000]).exceeds(Ticks(0)));
    assert!(!haste(&[3, 100, 3, 100, 3, 100]).exceeds(Ticks(37)));
    // Many short ones in a row, though the whole is slow.
    let crowd: Vec<u64> = [[3; 100].as_slice(), &[100_000]].concat();
    assert!(haste(&crowd).exceeds(Ticks(100 * 37 - 1)) && !haste(&crowd).exceeds(Ticks(100 * 37)));
    // A little too short for ever: the table may have many cycles.
    assert!(haste(&[39]).exceeds(Ticks(1000)));
}
