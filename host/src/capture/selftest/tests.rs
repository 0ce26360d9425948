//! Law: each way to get two jumpers wrong has its name, and wires that are right have none.

use std::collections::VecDeque;
use std::time::Duration;

use rcg_firmware::pulse::Edge;
use rcg_firmware::virtual_time::{Pins, StrobeEdge, VirtualBox};
use rcg_protocol::{Input, Level, Line, Polarity, Ticks};

use super::findings::End;
use super::{Finding, Rest, Settings, Tested, selftest};
use crate::capture::device::{Device, Patience};
use crate::capture::link::{Link, LinkError};
use crate::capture::steps::Output;

const CLOCK_HZ: u32 = 125_000_000;
const MS: u64 = 125_000;

/// What an input is wired to.
#[derive(Clone, Copy, Debug)]
enum Wire {
    Nothing,
    /// An output, by something that is `late` and lasts for so long, or as long as the pulse; `rings` more pulses follow.
    Output {
        outputs: &'static [Line],
        late: u64,
        lasts: Option<u64>,
        inverted: bool,
        rings: u64,
    },
    Held(bool),
    /// A square wave of this period.
    Free(u64),
}

const fn jumper(outputs: &'static [Line]) -> Wire {
    Wire::Output {
        outputs,
        late: 0,
        lasts: None,
        inverted: false,
        rings: 0,
    }
}

const PROJ: &[Line] = &[Line::Proj];
const CAM: &[Line] = &[Line::Cam];
const BOTH: &[Line] = &[Line::Proj, Line::Cam];

/// Wires at the pins: SYNC's and STROBE's. Levels are those of a voltmeter.
struct Wires {
    polarity: Polarity,
    inputs: [Wire; 2],
    /// Pulses of each output.
    pulses: Vec<(Line, Ticks, Option<Ticks>)>,
}

impl Wires {
    fn pulse_level(&self, line: Line) -> bool {
        let low = match line {
            Line::Proj => self.polarity.proj_active_low,
            _ => self.polarity.cam_active_low,
        };
        !low
    }

    /// The level at the start, and the times of all changes up to `now`.
    fn edges(&self, wire: Wire, now: Ticks, pulled_up: bool) -> (bool, Vec<u64>) {
        let mut edges = Vec::new();
        let mut level = pulled_up;
        match wire {
            Wire::Nothing => {}
            Wire::Held(high) => level = high,
            Wire::Free(period) => {
                level = false;
                edges.extend((1..=now.0 / (period / 2)).map(|half| half * (period / 2)));
            }
            Wire::Output {
                outputs,
                late,
                lasts,
                inverted,
                rings,
            } => {
                level = self.pulse_level(outputs[0]) == inverted;
                for (_, from, to) in self.pulses.iter().filter(|(line, ..)| outputs.contains(line)) {
                    let from = from.0 + late;
                    edges.push(from);
                    let to = lasts.map(|lasts| from + lasts).or(to.map(|to| to.0 + late));
                    edges.extend(to);
                    edges.extend(
                        to.into_iter()
                            .flat_map(|to| (1..=2 * rings).map(move |k| to + 10 * k)),
                    );
                }
            }
        }
        edges.retain(|at| *at <= now.0);
        (level, edges)
    }
}

impl Pins for Wires {
    fn edge(&mut self, edge: Edge) -> Option<StrobeEdge> {
        if edge.level == Level::Active {
            self.pulses.push((edge.line, edge.at, None));
        } else if let Some(pulse) = self.pulses.iter_mut().rev().find(|pulse| pulse.0 == edge.line) {
            pulse.2.get_or_insert(edge.at);
        }
        None
    }

    fn next_sync(&mut self, _: Ticks) -> Option<Ticks> {
        None
    }

    fn input(&mut self, line: Line, since: Ticks, now: Ticks, active_low: bool) -> Option<Input> {
        let wire = self.inputs[usize::from(line == Line::Strobe)];
        let (level, edges) = self.edges(wire, now, active_low);
        let counted: Vec<u64> = edges.iter().copied().filter(|at| *at >= since.0).collect();
        let back = |k: usize| counted.len().checked_sub(k).map(|at| Ticks(counted[at]));
        Some(Input {
            high: level ^ (edges.len() % 2 == 1),
            pulled_up: active_low,
            edges: Some(counted.len() as u32),
            last: [back(2), back(1)],
        })
    }
}

/// A box with wires, in virtual time.
struct Wired {
    unit: VirtualBox<Wires>,
    to_host: VecDeque<u8>,
}

impl Link for Wired {
    fn send(&mut self, bytes: &[u8]) -> Result<(), LinkError> {
        self.unit.hear(bytes, |frame| self.to_host.extend(frame));
        Ok(())
    }

    fn receive(&mut self, buffer: &mut [u8], timeout: Duration) -> Result<usize, LinkError> {
        let deadline = self.unit.now() + Ticks((timeout.as_secs_f64() * f64::from(CLOCK_HZ)).ceil() as u64);
        while self.to_host.is_empty() && self.unit.now() < deadline {
            self.unit.advance(deadline);
            self.unit.poll();
            self.unit.act(|frame| self.to_host.extend(frame));
        }
        let count = self.to_host.len().min(buffer.len());
        for (to, byte) in buffer.iter_mut().zip(self.to_host.drain(..count)) {
            *to = byte;
        }
        Ok(count)
    }

    fn now(&self) -> Duration {
        Duration::from_secs_f64(self.unit.now().0 as f64 / f64::from(CLOCK_HZ))
    }

    fn peer(&self) -> &'static str {
        "wired"
    }
}

fn tried(sync: Wire, strobe: Wire, polarity: Polarity) -> Tested {
    let wires = Wires {
        polarity,
        inputs: [sync, strobe],
        pulses: Vec::new(),
    };
    let link = Wired {
        unit: VirtualBox::new(wires, CLOCK_HZ, 1, Ticks(1000)),
        to_host: VecDeque::new(),
    };
    let mut device = Device::connect(link, 1, Patience::default()).unwrap();
    let settings = Settings {
        polarity,
        width: "1ms".parse().unwrap(),
        period: "20ms".parse().unwrap(),
        count: 4,
    };
    selftest(&mut device, &settings).unwrap()
}

const PLAIN: Polarity = Polarity {
    proj_active_low: false,
    cam_active_low: false,
    sync_active_low: false,
    strobe_active_low: false,
};

fn slow(outputs: &'static [Line], late: u64, lasts: Option<u64>) -> Wire {
    Wire::Output {
        outputs,
        late,
        lasts,
        inverted: false,
        rings: 0,
    }
}

fn inverted(outputs: &'static [Line]) -> Wire {
    Wire::Output {
        outputs,
        late: 3,
        lasts: None,
        inverted: true,
        rings: 0,
    }
}

#[test]
fn two_jumpers_are_right_and_measured() {
    let tested = tried(jumper(PROJ), jumper(CAM), PLAIN);
    assert_eq!(tested.findings, []);
    for (seen, output) in tested.inputs.iter().zip([Output::Proj, Output::Cam]) {
        assert_eq!((seen.rest, seen.by_itself), (Rest::Low, 0));
        for (answer, width) in seen.of(output).iter().zip([MS, 2 * MS, MS, 2 * MS]) {
            assert_eq!(answer.delay_and_width, Some((Ticks(0), Ticks(width))));
        }
    }
    // So are a projector and a camera that answer later and for as long as they like, one of which runs freely.
    for (sync, strobe) in [
        (slow(PROJ, 400, Some(3 * MS)), slow(CAM, 700, None)),
        (Wire::Free(MS), slow(CAM, 5 * MS, Some(MS / 2))),
    ] {
        assert_eq!(tried(sync, strobe, PLAIN).findings, []);
    }
    let low = Polarity {
        proj_active_low: true,
        sync_active_low: true,
        strobe_active_low: true,
        ..PLAIN
    };
    assert_eq!(tried(jumper(PROJ), inverted(CAM), low).findings, []);
}

#[test]
fn each_way_to_get_two_jumpers_wrong_has_its_name() {
    use Finding::{Both, ByItself, Crossed, Inverted, Open, Rings, Silent, StaysActive, Wrong};
    let (sync, strobe) = (Line::Sync, Line::Strobe);
    let silent = |line, rest, output| Silent { line, rest, output };
    let rings = Wire::Output {
        outputs: CAM,
        late: 5,
        lasts: None,
        inverted: false,
        rings: 2,
    };
    let held = [
        silent(sync, Rest::Low, Line::Proj),
        silent(strobe, Rest::High, Line::Cam),
    ];
    let wrong = Wrong {
        line: strobe,
        answers: Line::Proj,
        output: Line::Cam,
    };
    let rests_high = |line| Inverted {
        line,
        rest: Rest::High,
    };
    let table: [(Wire, Wire, &[Finding]); 12] = [
        (jumper(CAM), jumper(PROJ), &[Crossed(End::Either)]),
        // A camera whose exposure is as long as its trigger, and a projector whose answer is not.
        (
            slow(CAM, 9, Some(700)),
            slow(PROJ, 50, None),
            &[Crossed(End::Outputs)],
        ),
        (
            slow(CAM, 50, None),
            slow(PROJ, 9, Some(700)),
            &[Crossed(End::Inputs)],
        ),
        (Wire::Nothing, jumper(CAM), &[Open(sync)]),
        (jumper(PROJ), Wire::Nothing, &[Open(strobe)]),
        (Wire::Nothing, Wire::Nothing, &[Open(sync), Open(strobe)]),
        (inverted(PROJ), jumper(CAM), &[rests_high(sync)]),
        (jumper(PROJ), inverted(CAM), &[rests_high(strobe)]),
        (jumper(BOTH), jumper(BOTH), &[Both(sync), Both(strobe)]),
        (jumper(PROJ), jumper(PROJ), &[wrong]),
        (Wire::Held(false), Wire::Held(true), &held),
        (
            jumper(PROJ),
            rings,
            &[Rings {
                line: strobe,
                edges: 6,
            }],
        ),
    ];
    for (sync, strobe, expected) in table {
        let found = tried(sync, strobe, PLAIN).findings;
        assert_eq!(found, expected, "{sync:?} and {strobe:?}");
        assert!(found.iter().all(|finding| !finding.to_string().is_empty()));
    }
    let found = tried(slow(PROJ, 0, Some(100 * MS)), Wire::Free(MS / 10), PLAIN).findings;
    let by_itself = ByItself {
        line: strobe,
        edges: 4000,
    };
    assert_eq!(found, [StaysActive(sync), by_itself]);
}
