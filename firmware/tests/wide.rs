//! Law of the further outputs: schedule → wide words → edges = schedule, to the tick; and what the width costs.

use proptest::collection::vec;
use proptest::prelude::*;
use proptest::sample::Index;
use rcg_firmware::block::Block;
use rcg_firmware::pulse::{Edge, Outline, Reader, SYNC_LATENCY, StepWords, WIDE_WORDS, WordFormat};
use rcg_protocol::{Aux, AuxPolarity, AuxPulse, Fault, Level, Line, Pace, Polarity, Pulse, Step, Ticks};

const LINES: [Line; 4] = [Line::Proj, Line::Cam, Line::AuxA, Line::AuxB];

/// Shortest distance of two edges, and the longest word.
const fn limits(pace: Pace) -> (u64, u64) {
    match pace {
        Pace::FreeRunning => (3, (1 << 26) - 1 + 3),
        Pace::EachOnSync => (5, (1 << 25) - 1 + 5),
    }
}

/// Borders of a step and, for each output, between which of them it pulses.
fn step(pace: Pace) -> impl Strategy<Value = (Vec<u64>, [(Index, Index); 4])> {
    let (shortest, longest) = limits(pace);
    let gap = prop_oneof![
        4 => shortest..shortest + 12,
        4 => shortest..100_000,
        1 => longest - 8..longest + 12,
        1 => 2 * longest - 12..2 * longest + 12,
    ];
    (vec(gap, 1..=7), any::<[(Index, Index); 4]>()).prop_map(|(gaps, pulses)| {
        let mut borders = vec![0];
        for gap in gaps {
            borders.push(borders[borders.len() - 1] + gap);
        }
        (borders, pulses)
    })
}

fn pulse(borders: &[u64], (a, b): (Index, Index)) -> Pulse {
    let (a, b): (u64, u64) = (*a.get(borders), *b.get(borders));
    Pulse::new(a.min(b), a.abs_diff(b))
}

/// The edges of four pulses in a step that begins at `begins`, from the times alone.
fn edges_of(begins: u64, pulses: [Pulse; 4]) -> Vec<Edge> {
    let mut edges = Vec::new();
    for (line, pulse) in LINES.into_iter().zip(pulses) {
        if pulse.width == Ticks::ZERO {
            continue;
        }
        let on = Ticks(begins) + pulse.at;
        edges.push(Edge {
            at: on,
            line,
            level: Level::Active,
        });
        edges.push(Edge {
            at: on + pulse.width,
            line,
            level: Level::Inactive,
        });
    }
    edges.sort_by_key(|edge| (edge.at, LINES.iter().position(|line| *line == edge.line)));
    edges
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    #[test]
    fn edges_of_four_outputs_are_those_of_the_schedule(
        (paced, (borders, drawn)) in any::<bool>().prop_flat_map(|paced| {
            let pace = if paced { Pace::EachOnSync } else { Pace::FreeRunning };
            (Just(pace), step(pace))
        }),
        low in any::<[bool; 4]>(),
        with_cam in any::<bool>(),
        sync_after in 40..10_000_u64,
        closed in any::<bool>(),
    ) {
        let [proj, cam, a, mut b] = drawn.map(|between| pulse(&borders, between));
        let period = Ticks(borders[borders.len() - 1]);
        let mut aux = Aux {
            polarity: AuxPolarity { a_active_low: low[2], b_active_low: low[3], ..AuxPolarity::default() },
            a: AuxPulse::InStep(a),
            b: AuxPulse::InStep(b),
            photo: false,
        };
        if with_cam {
            // As long as CAM, and with it.
            aux.b = AuxPulse::WithCam { after: Ticks::ZERO, width: Ticks::ZERO };
            b = cam;
        }
        let polarity = Polarity { proj_active_low: low[0], cam_active_low: low[1], ..Polarity::default() };
        let format = WordFormat::new(paced, polarity).with_aux(&aux);
        let mut words = StepWords::new();
        format.encode_into(&Step { proj, cam, period }, &aux, 0, &mut words).expect("a good step");
        let mut outline = Outline::new(format);
        outline.add(&words);
        prop_assert_eq!(outline.period(), period);
        prop_assert_eq!(outline.trigger(), (!cam.is_none()).then_some(cam.at));

        let mut block = Block::new();
        block.push(&words);
        block.end_step(period);
        if closed {
            block.close(format);
        }
        let mut reader = Reader::new(format, Ticks(5));
        let mut edges = Vec::new();
        let mut begins = 5;
        for &word in block.words() {
            let next_sync = |from: Ticks| {
                begins = from.0 + sync_after + SYNC_LATENCY;
                Some(from + Ticks(sync_after))
            };
            let _ = reader.play(word, next_sync, |edge| edges.push(edge));
        }
        reader.halt(reader.now(), |edge| edges.push(edge));
        prop_assert_eq!(reader.now(), Ticks(begins) + period);
        prop_assert_eq!(edges, edges_of(begins, [proj, cam, a, b]));
    }
}

#[test]
fn wide_words_have_two_bits_for_nobody_and_are_made_only_where_an_output_needs_them() {
    let step = Step {
        proj: Pulse::new(0, 10),
        cam: Pulse::new(20, 30),
        period: Ticks(100),
    };
    let aux = Aux {
        polarity: AuxPolarity {
            b_active_low: true,
            ..AuxPolarity::default()
        },
        a: AuxPulse::WithCam {
            after: Ticks(10),
            width: Ticks(20),
        },
        ..Aux::default()
    };
    let words = |pace, aux: &Aux| {
        let mut words = StepWords::new();
        let format = WordFormat::new(pace, Polarity::default()).with_aux(aux);
        format
            .encode_into(&step, aux, 0, &mut words)
            .map(|()| words.to_vec())
    };
    let b = 0b10_0000;
    assert_eq!(
        words(Pace::FreeRunning, &aux).unwrap(),
        [
            7 << 6 | b | 1,
            7 << 6 | b,
            7 << 6 | b | 2,
            17 << 6 | b | 0b01_0010,
            47 << 6 | b
        ]
    );
    assert_eq!(
        words(Pace::EachOnSync, &aux).unwrap(),
        [
            b | 1 << 6,
            5 << 7 | b | 1,
            5 << 7 | b,
            5 << 7 | b | 2,
            15 << 7 | b | 0b01_0010,
            45 << 7 | b
        ]
    );
    // At rest both cost nothing, whatever their polarity.
    let resting = Aux::resting(aux.polarity);
    assert_eq!(
        words(Pace::FreeRunning, &resting).unwrap(),
        [7 << 2 | 1, 7 << 2, 27 << 2 | 2, 47 << 2]
    );
}

#[test]
fn the_longest_wide_step_is_played_whole_and_one_tick_more_is_refused() {
    for pace in [Pace::FreeRunning, Pace::EachOnSync] {
        let longest = Ticks((WIDE_WORDS as u64) << if pace == Pace::FreeRunning { 26 } else { 25 });
        // Nine segments, so that every one may need a short word more.
        let ninth = longest.0 / 9;
        let aux = Aux {
            a: AuxPulse::InStep(Pulse::new(3 * ninth, 3 * ninth)),
            b: AuxPulse::InStep(Pulse::new(4 * ninth, 4 * ninth)),
            ..Aux::default()
        };
        let format = WordFormat::new(pace, Polarity::default()).with_aux(&aux);
        assert_eq!(format.longest_period(), longest);
        for period in [longest, longest + Ticks(1)] {
            let step = Step {
                proj: Pulse::new(ninth, 4 * ninth),
                cam: Pulse::new(2 * ninth, 5 * ninth),
                period,
            };
            let mut words = StepWords::new();
            let encoded = format.encode_into(&step, &aux, 42, &mut words);
            if period == longest {
                let mut outline = Outline::new(format);
                outline.add(&words);
                assert_eq!((encoded, outline.period()), (Ok(()), period));
            } else {
                assert_eq!(encoded, Err(Fault::PeriodTooLong { step: 42 }));
            }
        }
    }
}
