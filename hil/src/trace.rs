//! Traces of edges, and how they compare with a schedule.
//!
//! # Design
//! What is expected is computed from the steps alone (start, pulse, period), not from the firmware's words, so that it
//! is independent of the code under test. A comparison pairs the k-th expected edge with the k-th found one: another
//! line or level is a difference, another time is jitter.

use std::fmt;

use rcg_protocol::{Aux, AuxPulse, Line, Polarity, Pulse, Step, Ticks};

/// A change of level of a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Edge {
    /// The cycle from which on the level is seen.
    pub at: u64,
    /// The line.
    pub line: Line,
    /// The level after the edge.
    pub high: bool,
}

impl fmt::Display for Edge {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { at, line, high } = self;
        write!(f, "{line:?} to {} at cycle {at}", u8::from(*high))
    }
}

/// The edges of PROJ and CAM when the steps begin at the given cycles; `steps` in the order of time.
pub fn schedule(polarity: Polarity, steps: impl IntoIterator<Item = (u64, Step)>) -> Vec<Edge> {
    schedule_with(polarity, &Aux::default(), steps)
}

/// What `aux` makes of `step`.
fn aux_pulse(aux: AuxPulse, step: &Step) -> Pulse {
    match aux {
        AuxPulse::Off => Pulse::NONE,
        AuxPulse::InStep(pulse) => pulse,
        AuxPulse::WithCam { .. } if step.cam.width == Ticks::ZERO => Pulse::NONE,
        AuxPulse::WithCam { after, width } => Pulse {
            at: step.cam.at + after,
            width: if width == Ticks::ZERO {
                step.cam.width
            } else {
                width
            },
        },
    }
}

/// The edges of all outputs when the steps begin at the given cycles; `steps` in the order of time.
pub fn schedule_with(
    polarity: Polarity,
    aux: &Aux,
    steps: impl IntoIterator<Item = (u64, Step)>,
) -> Vec<Edge> {
    let mut edges = Vec::new();
    let mut steps_edges = Vec::new();
    // A pulse that begins where the one before it ended is one pulse: no edge between them.
    let mut pending: [Option<Edge>; 4] = [None; 4];
    for (start, step) in steps {
        steps_edges.clear();
        let lines = [
            (Line::Proj, step.proj, polarity.proj_active_low),
            (Line::Cam, step.cam, polarity.cam_active_low),
            (Line::AuxA, aux_pulse(aux.a, &step), aux.polarity.a_active_low),
            (Line::AuxB, aux_pulse(aux.b, &step), aux.polarity.b_active_low),
        ];
        for (last, (line, pulse, active_low)) in pending.iter_mut().zip(lines) {
            let Pulse { at, width } = pulse;
            if width.0 == 0 {
                steps_edges.extend(last.take());
                continue;
            }
            let rises = start + at.0;
            let falls = Edge {
                at: rises + width.0,
                line,
                high: active_low,
            };
            match last.replace(falls) {
                Some(before) if before.at == rises => {}
                before => {
                    steps_edges.extend(before);
                    steps_edges.push(Edge {
                        at: rises,
                        line,
                        high: !active_low,
                    });
                }
            }
        }
        edges.append(&mut steps_edges);
    }
    edges.extend(pending.into_iter().flatten());
    edges.sort_unstable();
    edges
}

/// The cycles at which the steps of a free run begin that starts at `start`.
pub fn free_run(start: u64, steps: impl IntoIterator<Item = Step>) -> impl Iterator<Item = (u64, Step)> {
    steps.into_iter().scan(start, |at, step| {
        let begins = *at;
        *at += step.period.0;
        Some((begins, step))
    })
}

/// How a trace compares with what was expected, when every edge is there.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Comparison {
    /// Edges that were compared.
    pub edges: usize,
    /// Farthest that one of them is off, in cycles.
    pub jitter: u64,
}

/// The first edge that is missing, additional or another one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("edge {index}: expected {}, found {}", shown(.expected.as_ref()), shown(.found.as_ref()))]
pub struct Difference {
    /// Its number, from 0.
    pub index: usize,
    /// What should be there.
    pub expected: Option<Edge>,
    /// What is.
    pub found: Option<Edge>,
}

fn shown(edge: Option<&Edge>) -> String {
    edge.map_or_else(|| "none".to_owned(), ToString::to_string)
}

/// Holds the output edges among `found` against `expected`, both in the order of time.
///
/// # Errors
/// [`Difference`], the first one.
pub fn compare(expected: &[Edge], found: &[Edge]) -> Result<Comparison, Difference> {
    let mut found = outputs(found);
    found.sort_unstable(); // by line where two change at once
    let mut comparison = Comparison::default();
    for index in 0..expected.len().max(found.len()) {
        let (want, have) = (expected.get(index).copied(), found.get(index).copied());
        match (want, have) {
            (Some(a), Some(b)) if (a.line, a.high) == (b.line, b.high) => {
                comparison.edges += 1;
                comparison.jitter = comparison.jitter.max(a.at.abs_diff(b.at));
            }
            _ => {
                return Err(Difference {
                    index,
                    expected: want,
                    found: have,
                });
            }
        }
    }
    Ok(comparison)
}

/// Where a run was cut: the cycles at which the first and the last of its lines came to rest.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Cut {
    /// The first line.
    pub first: u64,
    /// The last line.
    pub last: u64,
}

/// Holds the output edges among `found` against a run that was cut: each edge up to the cut is where it was expected,
/// at the cut those lines (active high) fall that are high, and nothing follows. If both were low already, the cut is
/// their last edge.
///
/// # Errors
/// [`Difference`], the first one.
pub fn cut(expected: &[Edge], found: &[Edge]) -> Result<Cut, Difference> {
    let mut found = outputs(found);
    found.sort_unstable();
    let same = expected.iter().zip(&found).take_while(|(a, b)| a == b).count();
    let mut high: Vec<Line> = Vec::new();
    for edge in &found[..same] {
        high.retain(|&line| line != edge.line);
        if edge.high {
            high.push(edge.line);
        }
    }
    let last = found.last().map_or(0, |edge| edge.at);
    let first = found.get(same).map_or(last, |edge| edge.at);
    let too_late = expected.get(same).is_some_and(|next| next.at < first);
    let difference = |index: usize| Difference {
        index,
        expected: expected.get(index).copied(),
        found: found.get(index).copied(),
    };
    for (index, edge) in found.iter().enumerate().skip(same) {
        if edge.high || !high.contains(&edge.line) || too_late {
            return Err(difference(index));
        }
        high.retain(|&line| line != edge.line);
    }
    if high.is_empty() {
        Ok(Cut { first, last })
    } else {
        Err(difference(found.len()))
    }
}

/// The edges of the outputs.
#[must_use]
pub fn outputs(edges: &[Edge]) -> Vec<Edge> {
    let output = |edge: &&Edge| matches!(edge.line, Line::Proj | Line::Cam | Line::AuxA | Line::AuxB);
    edges.iter().filter(output).copied().collect()
}

/// The cycles at which `line` rises.
#[must_use]
pub fn rises(edges: &[Edge], line: Line) -> Vec<u64> {
    let rises = edges.iter().filter(|edge| edge.line == line && edge.high);
    rises.map(|edge| edge.at).collect()
}

#[cfg(test)]
mod tests {
    use rcg_protocol::Ticks;

    use super::*;

    fn steps() -> Vec<Step> {
        let step = Step {
            proj: Pulse::new(0, 10),
            cam: Pulse::new(20, 30),
            period: Ticks(100),
        };
        vec![step; 3]
    }

    fn trace() -> Vec<Edge> {
        schedule(Polarity::default(), free_run(1000, steps()))
    }

    #[test]
    fn the_schedule_as_edges() {
        let edges = trace();
        let at: Vec<u64> = edges.iter().map(|edge| edge.at).collect();
        assert_eq!(
            at,
            [
                1000, 1010, 1020, 1050, 1100, 1110, 1120, 1150, 1200, 1210, 1220, 1250
            ]
        );
        assert!(edges[0].high && edges[0].line == Line::Proj);
        assert!(!edges[3].high && edges[3].line == Line::Cam);
        assert_eq!(rises(&edges, Line::Cam), [1020, 1120, 1220]);
    }

    #[test]
    fn pulses_that_touch_are_one() {
        let whole = Step {
            proj: Pulse::new(0, 100),
            cam: Pulse::NONE,
            period: Ticks(100),
        };
        let edges = schedule(Polarity::default(), free_run(0, [whole; 5]));
        assert_eq!(edges.iter().map(|edge| edge.at).collect::<Vec<_>>(), [0, 500]);
    }

    #[test]
    fn active_low_lines_fall_first() {
        let polarity = Polarity {
            cam_active_low: true,
            ..Polarity::default()
        };
        let edges = schedule(polarity, free_run(0, steps()));
        let cam = edges.iter().find(|edge| edge.line == Line::Cam).unwrap();
        assert!(!cam.high);
    }

    #[test]
    fn an_equal_trace_has_no_jitter() {
        let found = compare(&trace(), &trace()).unwrap();
        assert_eq!(found, Comparison { edges: 12, jitter: 0 });
    }

    #[test]
    fn inputs_are_not_compared() {
        let mut found = trace();
        found.insert(
            0,
            Edge {
                at: 1,
                line: Line::Sync,
                high: true,
            },
        );
        assert_eq!(compare(&trace(), &found).unwrap().edges, 12);
    }

    #[test]
    fn an_edge_that_is_one_tick_off_is_jitter() {
        for index in 0..12 {
            for later in [true, false] {
                let mut found = trace();
                found[index].at = found[index].at + 2 * u64::from(later) - 1;
                assert_eq!(compare(&trace(), &found).unwrap().jitter, 1, "edge {index}");
            }
        }
    }

    #[test]
    fn a_run_that_is_cut_ends_low() {
        let expected = trace();
        let falls = |at, line| Edge {
            at,
            line,
            high: false,
        };
        // CAM is high from 1120 to 1150.
        let mut found = expected[..7].to_vec();
        found.push(falls(1130, Line::Cam));
        let at = |cycle| {
            Ok(Cut {
                first: cycle,
                last: cycle,
            })
        };
        assert_eq!(cut(&expected, &found), at(1130));
        assert_eq!(
            cut(&expected, &expected[..8]),
            at(1150),
            "both were low when it was cut"
        );
        assert!(cut(&expected, &expected[..7]).is_err(), "CAM stays high");
        found[4].at += 1;
        assert_eq!(
            cut(&expected, &found).unwrap_err().index,
            4,
            "an edge before the cut moved"
        );
        found[4].at -= 1;
        found[7].at = 1170;
        assert!(
            cut(&expected, &found).is_err(),
            "CAM fell too late for the schedule"
        );
        found[7].at = 1130;
        found.push(expected[8]);
        assert!(cut(&expected, &found).is_err(), "it went on");
    }

    #[test]
    fn a_missing_edge_is_a_difference() {
        for index in 0..12 {
            let mut found = trace();
            found.remove(index);
            let difference = compare(&trace(), &found).unwrap_err();
            assert_eq!(difference.index, index);
        }
    }

    #[test]
    fn an_additional_edge_is_a_difference() {
        for index in 0..=12 {
            let mut found = trace();
            let at = found.get(index).map_or(2000, |edge| edge.at);
            let high = index % 2 == 1;
            let edge = Edge {
                at,
                line: Line::Cam,
                high,
            };
            found.insert(index, edge);
            assert!(compare(&trace(), &found).is_err(), "edge {index}");
        }
    }
}
