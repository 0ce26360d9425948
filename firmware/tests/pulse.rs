//! Law of the pulse engine: schedule → words → edges = schedule, to the tick.
//!
//! Two references stand against the code: the edges computed directly from the schedule, and a few lines
//! that execute the two PIO programs instruction by instruction.

use proptest::collection::vec;
use proptest::prelude::*;
use proptest::sample::Index;
use rcg_firmware::pulse::{
    Edge, LONGEST_PERIOD, Outline, Played, Reader, SYNC_LATENCY, SYNC_MASK, WAIT_LEAD, WordFormat,
};
use rcg_protocol::{Fault, Level, Line, Pace, Polarity, Pulse, Step, Ticks};

const PACES: [Pace; 2] = [Pace::FreeRunning, Pace::EachOnSync];

/// Overhead of the PIO program in ticks, and the longest word that it can play.
const fn limits(pace: Pace) -> (u64, u64) {
    match pace {
        Pace::FreeRunning => (3, (1 << 30) - 1 + 3),
        Pace::EachOnSync => (5, (1 << 29) - 1 + 5),
    }
}

fn polarity() -> impl Strategy<Value = Polarity> {
    any::<(bool, bool)>().prop_map(|(proj_active_low, cam_active_low)| Polarity {
        proj_active_low,
        cam_active_low,
        ..Polarity::default()
    })
}

/// The time between two borders: short, ordinary, about as long as one or two words can be, or very long.
fn gap(pace: Pace) -> impl Strategy<Value = u64> {
    let (shortest, longest) = limits(pace);
    prop_oneof![
        4 => shortest..shortest + 12,
        4 => shortest..100_000,
        2 => longest - 8..longest + 12,
        1 => 2 * longest - 12..2 * longest + 12,
        1 => shortest..2_900_000_000_u64,
    ]
}

/// Where a pulse begins and ends: at two of the borders of the step, or (zero width) anywhere at all.
#[derive(Clone, Debug)]
enum Between {
    Borders(Index, Index),
    Nowhere(u64),
}

fn between() -> impl Strategy<Value = Between> {
    prop_oneof![
        6 => any::<(Index, Index)>().prop_map(|(a, b)| Between::Borders(a, b)),
        1 => any::<u64>().prop_map(Between::Nowhere),
    ]
}

/// Any valid step. Pulses that touch the borders, overlap, are nested or identical occur often.
fn step(pace: Pace) -> impl Strategy<Value = Step> {
    (vec(gap(pace), 1..=5), between(), between()).prop_map(|(gaps, proj, cam)| {
        let mut borders = vec![0];
        for gap in gaps {
            borders.push(borders[borders.len() - 1] + gap);
        }
        let pulse = |between| match between {
            Between::Nowhere(at) => Pulse::new(at, 0),
            Between::Borders(a, b) => {
                let (a, b): (u64, u64) = (*a.get(&borders), *b.get(&borders));
                Pulse::new(a.min(b), a.abs_diff(b))
            }
        };
        Step {
            proj: pulse(proj),
            cam: pulse(cam),
            period: Ticks(borders[borders.len() - 1]),
        }
    })
}

/// The edges of steps that begin at the given times, from the schedule alone.
fn edges_of(steps: &[(u64, Step)]) -> Vec<Edge> {
    let mut edges: Vec<Edge> = Vec::new();
    for line in [Line::Proj, Line::Cam] {
        let mut of_line: Vec<Edge> = Vec::new();
        for (begins, step) in steps {
            let pulse = if line == Line::Proj { step.proj } else { step.cam };
            if pulse.is_none() {
                continue;
            }
            let on = Ticks(begins + pulse.at.0);
            // A pulse that begins where the one before it ends goes on with it.
            if of_line.last().is_some_and(|last| last.at == on) {
                of_line.pop();
            } else {
                of_line.push(Edge {
                    at: on,
                    line,
                    level: Level::Active,
                });
            }
            of_line.push(Edge {
                at: on + pulse.width,
                line,
                level: Level::Inactive,
            });
        }
        edges.extend(of_line);
    }
    edges.sort_by_key(|edge| (edge.at, edge.line));
    edges
}

/// Encodes and plays `steps`; returns when each began, and the edges.
fn play(format: WordFormat, start: u64, steps: &[Step], syncs: &[u64]) -> (Vec<u64>, Vec<Edge>) {
    let mut reader = Reader::new(format, Ticks(start));
    let (mut begins, mut edges) = (Vec::new(), Vec::new());
    for (index, step) in steps.iter().enumerate() {
        let words = format.encode(step, index as u64).expect("the step is valid");
        let mut waiting = words.iter().filter(|&&word| format.waits(word)).count();
        for word in words {
            if waiting == 0 && begins.len() == index {
                begins.push(reader.now().0);
            }
            let before = reader.now();
            let next_sync = |from: Ticks| syncs.iter().copied().find(|&sync| sync >= from.0).map(Ticks);
            let played = reader.play(word, next_sync, |edge| edges.push(edge));
            assert_eq!(played, Played::Through);
            if format.waits(word) {
                waiting -= 1;
            } else {
                assert!(
                    (reader.now() - before).0 >= u64::from(format.shortest()),
                    "word {word:#x} is too short"
                );
            }
        }
    }
    reader.halt(reader.now(), |edge| edges.push(edge));
    (begins, edges)
}

fn check_summary(format: WordFormat, steps: &[Step]) {
    for step in steps {
        let words = format.encode(step, 0).expect("the step is valid");
        let trigger = (!step.cam.is_none()).then_some(step.cam.at);
        assert_eq!(outline(format, &words), (trigger, step.period));
    }
}

fn outline(format: WordFormat, words: &[u32]) -> (Option<Ticks>, Ticks) {
    let mut outline = Outline::new(format);
    outline.add(words);
    (outline.trigger(), outline.period())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(3000))]

    #[test]
    fn free_running_edges_are_those_of_the_schedule(
        steps in vec(step(Pace::FreeRunning), 1..30),
        polarity in polarity(),
        start in 0..1_000_000_u64,
    ) {
        let format = WordFormat::new(Pace::FreeRunning, polarity);
        let (begins, edges) = play(format, start, &steps, &[]);
        let mut at = start;
        let mut placed = Vec::new();
        for step in &steps {
            placed.push((at, *step));
            at += step.period.0;
        }
        prop_assert_eq!(begins, placed.iter().map(|(at, _)| *at).collect::<Vec<_>>());
        prop_assert_eq!(edges, edges_of(&placed));
        check_summary(format, &steps);
    }

    #[test]
    fn paced_steps_begin_with_the_next_sync_edge_and_ignore_those_during_the_step(
        steps in vec(step(Pace::EachOnSync), 1..12),
        polarity in polarity(),
        start in 0..1_000_000_u64,
        gaps in vec(prop_oneof![2..40_u64, 2..200_000_u64], 1..60),
        at_end in any::<bool>(),
    ) {
        let format = WordFormat::new(Pace::EachOnSync, polarity);
        // SYNC edges at random; beyond them one edge after each step, as far off as the machine allows or nearer.
        let mut syncs = Vec::new();
        let mut at = start;
        for gap in gaps {
            at += gap;
            syncs.push(at);
        }
        let (mut ready, mut placed) = (start, Vec::new());
        for step in &steps {
            let from = ready + WAIT_LEAD;
            let edge = syncs.iter().copied().find(|&edge| edge >= from).unwrap_or_else(|| {
                let edge = if at_end { from } else { from + 1_000_000 };
                syncs.push(edge);
                edge
            });
            placed.push((edge + SYNC_LATENCY, *step));
            ready = edge + SYNC_LATENCY + step.period.0;
        }
        let (begins, edges) = play(format, start, &steps, &syncs);
        prop_assert_eq!(begins, placed.iter().map(|(at, _)| *at).collect::<Vec<_>>());
        prop_assert_eq!(edges, edges_of(&placed));
        check_summary(format, &steps);
    }
}

/// Executes the PIO programs of the module's page instruction by instruction, one tick each. `sync(t)` is
/// the level of SYNC in tick t. Returns the tick and the pins of every `out pins`, and when all was played.
fn execute(pace: Pace, words: &[u32], start: u64, sync: impl Fn(u64) -> bool) -> (Vec<(u64, u32)>, u64) {
    let mut now = start;
    let mut outs = Vec::new();
    for &word in words {
        outs.push((now, word & 0b11));
        now += 1; // out pins, 2
        let x = if pace == Pace::FreeRunning {
            now += 1; // out x, 30
            word >> 2
        } else {
            now += 3; // out y, 1; out x, 29; jmp y--
            if word >> 2 & 1 == 1 {
                // At rest, and at rest still when `jmp pin` looks; else from the start.
                let mut ticks = now..now + 10_000;
                let rests = ticks.find(|&tick| !sync(tick) && !sync(tick + 32));
                let rests = rests.expect("it repeats");
                let mut ticks = rests + 33..rests + 10_000;
                now = ticks.find(|&tick| sync(tick)).expect("it repeats") + 2; // wait 1; push
                continue;
            }
            word >> 3
        };
        now += u64::from(x) + 1; // jmp x--
    }
    (outs, now)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    #[test]
    fn the_reader_plays_words_as_the_pio_programs_do(
        gaps in vec((5..60_u64, 5..60_u64, 5..60_u64), 1..6),
        polarity in polarity(),
        paced in any::<bool>(),
        sync in vec((SYNC_MASK + 2..SYNC_MASK + 20, 1..20_u64), 1..40),
    ) {
        let pace = PACES[usize::from(paced)];
        let format = WordFormat::new(pace, polarity);
        let words: Vec<u32> = gaps
            .iter()
            .flat_map(|&(a, b, c)| {
                let step = Step { proj: Pulse::new(0, a), cam: Pulse::new(a, b), period: Ticks(a + b + c) };
                format.encode(&step, 0).expect("valid")
            })
            .collect();
        // The level of SYNC repeats, so that there is always a next edge.
        let length: u64 = sync.iter().map(|(low, high)| low + high).sum();
        let level = |tick: u64| {
            let mut left = tick % length;
            for &(low, high) in &sync {
                if left < low {
                    return false;
                }
                if left < low + high {
                    return true;
                }
                left -= low + high;
            }
            false
        };
        let start = 1000;
        let (outs, end) = execute(pace, &words, start, level);
        let mut expected = Vec::new();
        let mut pins = format.rest();
        for (at, new) in outs {
            for (bit, line, low) in [
                (1, Line::Proj, polarity.proj_active_low),
                (2, Line::Cam, polarity.cam_active_low),
            ] {
                if (new ^ pins) & bit != 0 {
                    let active = (new & bit != 0) != low;
                    let level = if active { Level::Active } else { Level::Inactive };
                    expected.push(Edge { at: Ticks(at), line, level });
                }
            }
            pins = new;
        }
        let mut reader = Reader::new(format, Ticks(start));
        let mut edges = Vec::new();
        for &word in &words {
            let next = |from: Ticks| (from.0..from.0 + 10_000).find(|&t| level(t) && !level(t - 1)).map(Ticks);
            prop_assert_eq!(reader.play(word, next, |edge| edges.push(edge)), Played::Through);
        }
        prop_assert_eq!(edges, expected);
        prop_assert_eq!(reader.now(), Ticks(end));
    }
}

#[test]
fn words_are_laid_out_as_the_pio_programs_read_them() {
    let step = Step {
        proj: Pulse::new(0, 10),
        cam: Pulse::new(20, 30),
        period: Ticks(100),
    };
    let free = WordFormat::new(Pace::FreeRunning, Polarity::default());
    assert_eq!(
        free.encode(&step, 0).unwrap(),
        [7 << 2 | 1, 7 << 2, 27 << 2 | 2, 47 << 2]
    );
    let low = Polarity {
        proj_active_low: true,
        ..Polarity::default()
    };
    let paced = WordFormat::new(Pace::EachOnSync, low);
    assert_eq!(
        paced.encode(&step, 0).unwrap(),
        [0b101, 5 << 3, 5 << 3 | 1, 25 << 3 | 3, 45 << 3 | 1]
    );
}

#[test]
fn the_longest_period_is_played_whole_and_one_tick_more_is_refused() {
    for pace in PACES {
        let format = WordFormat::new(pace, Polarity::default());
        // Five segments, so that every one may need a short word more.
        let fifth = LONGEST_PERIOD.0 / 5;
        let (proj, cam) = (Pulse::new(fifth, fifth), Pulse::new(3 * fifth, fifth));
        for period in [LONGEST_PERIOD, LONGEST_PERIOD + Ticks(1), Ticks(u64::MAX)] {
            let words = format.encode(&Step { proj, cam, period }, 42);
            if period == LONGEST_PERIOD {
                assert_eq!(outline(format, &words.unwrap()), (Some(cam.at), period));
            } else {
                assert_eq!(words, Err(Fault::PeriodTooLong { step: 42 }));
            }
        }
    }
}

#[test]
fn edges_closer_than_the_shortest_distance_are_refused_by_the_index_of_their_step() {
    for pace in PACES {
        let format = WordFormat::new(pace, Polarity::default());
        let shortest = limits(pace).0;
        assert_eq!(u64::from(format.shortest()), shortest);
        for g in 0..shortest + 3 {
            let cases = [
                (
                    "lead",
                    Step {
                        proj: Pulse::new(g, 50),
                        cam: Pulse::NONE,
                        period: Ticks(100),
                    },
                ),
                (
                    "tail",
                    Step {
                        proj: Pulse::NONE,
                        cam: Pulse::new(50, 50 - g),
                        period: Ticks(100),
                    },
                ),
                (
                    "width",
                    Step {
                        proj: Pulse::new(20, g),
                        cam: Pulse::new(50, 20),
                        period: Ticks(100),
                    },
                ),
                (
                    "between",
                    Step {
                        proj: Pulse::new(20, 20),
                        cam: Pulse::new(40 + g, 20),
                        period: Ticks(100),
                    },
                ),
                (
                    "leading",
                    Step {
                        proj: Pulse::new(20, 50),
                        cam: Pulse::new(20 + g, 60),
                        period: Ticks(100),
                    },
                ),
                (
                    "trailing",
                    Step {
                        proj: Pulse::new(20, 50 + g),
                        cam: Pulse::new(40, 30),
                        period: Ticks(100),
                    },
                ),
            ];
            for (name, step) in cases {
                let result = format.encode(&step, 7).map(|_| ());
                let expected = if g == 0 || g >= shortest {
                    Ok(())
                } else {
                    Err(Fault::EdgesTooClose {
                        step: 7,
                        shortest: shortest as u32,
                    })
                };
                assert_eq!(result, expected, "{name} of {g} ticks, {pace:?}");
            }
            // A step without pulses is one segment, and a step must last.
            let empty = Step {
                period: Ticks(g),
                ..Step::default()
            };
            assert_eq!(
                format.encode(&empty, 7).is_ok(),
                g >= shortest,
                "period of {g} ticks, {pace:?}"
            );
        }
    }
}

#[test]
fn pulses_outside_the_period_are_refused_by_the_index_of_their_step() {
    let late = [
        (90, 11),
        (101, 5),
        (0, 101),
        (u64::MAX, 1),
        (1, u64::MAX),
        (u64::MAX, u64::MAX),
    ];
    for pace in PACES {
        let format = WordFormat::new(pace, Polarity::default());
        for (at, width) in late {
            let good = Pulse::new(20, 30);
            for (proj, cam) in [(Pulse::new(at, width), good), (good, Pulse::new(at, width))] {
                let step = Step {
                    proj,
                    cam,
                    period: Ticks(100),
                };
                assert_eq!(
                    format.encode(&step, 9),
                    Err(Fault::PulseOutsidePeriod { step: 9 })
                );
            }
        }
    }
}

#[test]
fn without_a_sync_edge_a_paced_step_does_not_begin() {
    let format = WordFormat::new(Pace::EachOnSync, Polarity::default());
    let step = Step {
        proj: Pulse::new(0, 10),
        cam: Pulse::NONE,
        period: Ticks(100),
    };
    let words = format.encode(&step, 0).unwrap();
    let mut reader = Reader::new(format, Ticks(5));
    let mut edges = Vec::new();
    assert_eq!(
        reader.play(words[0], |_| None, |edge| edges.push(edge)),
        Played::NoSync
    );
    assert!(edges.is_empty());
}

#[test]
fn halting_in_mid_pulse_brings_both_lines_to_rest() {
    let polarity = Polarity {
        cam_active_low: true,
        ..Polarity::default()
    };
    let format = WordFormat::new(Pace::FreeRunning, polarity);
    let step = Step {
        proj: Pulse::new(0, 50),
        cam: Pulse::new(0, 60),
        period: Ticks(100),
    };
    let words = format.encode(&step, 0).unwrap();
    let mut reader = Reader::new(format, Ticks(0));
    let mut edges = Vec::new();
    let _ = reader.play(words[0], |_| None, |edge| edges.push(edge));
    edges.clear();
    reader.halt(Ticks(33), |edge| edges.push(edge));
    reader.halt(Ticks(34), |edge| edges.push(edge));
    let rest = |line| Edge {
        at: Ticks(33),
        line,
        level: Level::Inactive,
    };
    assert_eq!(edges, [rest(Line::Proj), rest(Line::Cam)]);
}
