//! Law: what a box keeps it runs from each power-up on as a host would have it run, until that is forgotten; half of it, or what was
//! damaged, it does not run.

use std::collections::VecDeque;
use std::time::Duration;

use rcg::capture::device::{Device, DeviceError, Patience, Standalone};
use rcg::capture::link::{Link, LinkError};
use rcg_firmware::pulse::Edge;
use rcg_firmware::virtual_flash::VirtualFlash;
use rcg_firmware::virtual_time::{Pins, StrobeEdge, VirtualBox};
use rcg_protocol::{
    Aux, AuxPulse, Command, Extent, FIRST_PAGE, Fault, Level, Line, Micros, PAGE_BYTES, Program, Pulse,
    Start, State, Step, Ticks,
};

const CLOCK_HZ: u32 = 125_000_000;
const MS: u64 = 125_000;

/// Pins that nothing hangs at but an edge of START every 50 ms.
#[derive(Default)]
struct Bare {
    edges: Vec<Edge>,
}

impl Pins for Bare {
    fn edge(&mut self, edge: Edge) -> Option<StrobeEdge> {
        self.edges.push(edge);
        None
    }

    fn next_sync(&mut self, _: Ticks) -> Option<Ticks> {
        None
    }

    fn next_start(&mut self, from: Ticks) -> Option<Ticks> {
        Some(Ticks(from.0.next_multiple_of(50 * MS)))
    }
}

/// A box, and what it says.
struct Cabled {
    unit: VirtualBox<Bare>,
    said: VecDeque<u8>,
}

impl Cabled {
    /// Just switched on, with what is kept in `memory`.
    fn on(memory: VirtualFlash, clock_hz: u32) -> (Self, Result<(), Fault>) {
        let mut said = VecDeque::new();
        let unit = VirtualBox::new(Bare::default(), clock_hz, 1, Ticks(1000));
        let (unit, made) = unit.switched_on(memory, |frame| said.extend(frame));
        (Self { unit, said }, made)
    }

    /// Lets so many milliseconds pass; returns when CAM and AUX-A became active, in ticks.
    fn wait(&mut self, ms: u64) -> [Vec<u64>; 2] {
        let until = self.unit.now() + Ticks(ms * MS);
        self.unit.pins().edges.clear();
        while self.unit.now() < until {
            self.unit.advance(until);
            self.unit.poll();
            self.unit.act(|frame| self.said.extend(frame));
        }
        let edges = &self.unit.pins().edges;
        [Line::Cam, Line::AuxA].map(|line| {
            let on = edges
                .iter()
                .filter(|edge| edge.line == line && edge.level == Level::Active);
            on.map(|edge| edge.at.0).collect()
        })
    }
}

impl Link for Cabled {
    fn send(&mut self, bytes: &[u8]) -> Result<(), LinkError> {
        self.unit.hear(bytes, |frame| self.said.extend(frame));
        Ok(())
    }

    fn receive(&mut self, buffer: &mut [u8], timeout: Duration) -> Result<usize, LinkError> {
        if self.said.is_empty() {
            self.wait(u64::from(!timeout.is_zero()));
        }
        let count = self.said.len().min(buffer.len());
        for (to, byte) in buffer.iter_mut().zip(self.said.drain(..count)) {
            *to = byte;
        }
        Ok(count)
    }

    fn now(&self) -> Duration {
        Duration::from_secs_f64(self.unit.now().0 as f64 / f64::from(CLOCK_HZ))
    }

    fn peer(&self) -> &'static str {
        "cabled"
    }
}

fn device(memory: VirtualFlash) -> Device<Cabled> {
    let (cabled, made) = Cabled::on(memory, CLOCK_HZ);
    assert_eq!(made, Ok(()));
    Device::connect(cabled, 1, Patience::default()).unwrap()
}

/// Three steps of 1, 2 and 3 ms, twice; AUX-A follows CAM.
fn standalone(start: Start, runs: u32) -> Standalone {
    let step = |ms: u64| Step {
        proj: Pulse::new(0, 500),
        cam: Pulse::new(1000, 5000),
        period: Ticks(ms * MS),
    };
    Standalone {
        program: Program {
            start,
            dead_man: Micros(20_000),
            ..Program::new(Extent::Table { steps: 3, cycles: 2 })
        },
        steps: [1, 2, 3].map(step).to_vec(),
        aux: Aux {
            a: AuxPulse::WithCam {
                after: Ticks(200),
                width: Ticks::ZERO,
            },
            ..Aux::default()
        },
        shortest_strobe: Ticks(50),
        runs,
    }
}

/// CAM and AUX-A in a run that begins at `at`.
fn run_at(at: u64) -> [Vec<u64>; 2] {
    let cam = [0, 1, 3, 6, 7, 9].map(|ms| at + ms * MS + 1000);
    [cam.to_vec(), cam.map(|at| at + 200).to_vec()]
}

fn memory_with(standalone: &Standalone) -> VirtualFlash {
    let mut device = device(VirtualFlash::default());
    device.store(standalone).unwrap();
    device.link_mut().unit.memory().clone()
}

#[test]
fn a_kept_schedule_runs_from_power_up_on_although_nobody_is_there() {
    let memory = memory_with(&standalone(Start::AtOnce, 1));
    let (mut unit, made) = Cabled::on(memory, CLOCK_HZ);
    assert_eq!(made, Ok(()));
    assert_eq!(
        unit.wait(200),
        run_at(1000),
        "once, and with no host for ten times its dead-man time"
    );
    // On edges of START, which come every 50 ms, as often as it should, or for ever.
    for (runs, seen) in [(3, 3), (0, 20)] {
        let (mut unit, made) = Cabled::on(memory_with(&standalone(Start::OnStartLine, runs)), CLOCK_HZ);
        assert_eq!(made, Ok(()));
        let [cam, aux] = unit.wait(1005 + 5);
        assert_eq!((cam.len(), aux.len()), (6 * seen, 6 * seen), "{runs}");
        let latency = cam[0] - 1000 - 50 * MS;
        assert!(latency < 10);
        for (k, run) in (1..).zip(cam.chunks(6)) {
            assert_eq!(run, run_at(k * 50 * MS + latency)[0]);
        }
    }
}

#[test]
fn a_host_finds_it_running_and_ends_it() {
    let memory = memory_with(&standalone(Start::OnStartLine, 0));
    let mut device = device(memory.clone());
    assert_eq!(device.status().unwrap().state, State::Running);
    let error = device.store(&standalone(Start::AtOnce, 1)).unwrap_err();
    assert!(
        matches!(
            error,
            DeviceError::Refused {
                fault: Fault::Refused {
                    command: Command::Load,
                    ..
                },
                ..
            }
        ),
        "{error}"
    );
    let error = device.forget().unwrap_err();
    assert!(
        error
            .to_string()
            .contains("cannot store a schedule while running"),
        "{error}"
    );
    // A host that has come and gone changes nothing.
    assert_eq!(device.link_mut().wait(1010)[0].len(), 6 * 20);
    assert_eq!(device.abort().unwrap().state, State::Aborted);
    assert!(device.link_mut().wait(200)[0].is_empty());
    assert!(
        device
            .stored()
            .unwrap()
            .is_some_and(|stored| stored.steps == 6 && stored.runs == 0)
    );
    device.forget().unwrap();
    assert_eq!(device.stored().unwrap(), None);
    let (mut unit, _) = Cabled::on(device.link().unit.memory().clone(), CLOCK_HZ);
    assert!(unit.wait(200)[0].is_empty(), "it is forgotten");
    // The box that was switched off before still had it.
    assert_eq!(Cabled::on(memory, CLOCK_HZ).0.wait(120)[0].len(), 6 * 2);
}

#[test]
fn the_next_one_takes_the_place_of_the_one_before() {
    let mut device = device(memory_with(&standalone(Start::OnStartLine, 7)));
    device.abort().unwrap();
    let stored = device.store(&standalone(Start::AtOnce, 1)).unwrap();
    assert_eq!((stored.runs, stored.start), (1, Start::AtOnce));
    let (mut unit, _) = Cabled::on(device.link().unit.memory().clone(), CLOCK_HZ);
    assert_eq!(unit.wait(200), run_at(1000));
}

#[test]
fn what_is_damaged_or_meant_for_another_clock_is_not_run() {
    let memory = memory_with(&standalone(Start::AtOnce, 1));
    assert!(Cabled::on(memory.clone(), CLOCK_HZ).0.wait(20)[0].len() == 6);
    assert!(Cabled::on(memory.clone(), 200_000_000).0.wait(20)[0].is_empty());
    let header = memory.bytes().iter().position(|&byte| byte == 0).unwrap() + 1;
    let first = usize::from(FIRST_PAGE) * PAGE_BYTES;
    let length = memory.bytes()[first..]
        .iter()
        .rposition(|&byte| byte != 0 && byte != u8::MAX);
    let used = (0..header - 1).chain(first..=first + length.unwrap());
    for at in used {
        for bit in 0..8 {
            let mut bytes = memory.bytes().to_vec();
            bytes[at] ^= 1 << bit;
            let (mut unit, _) = Cabled::on(VirtualFlash::from(bytes), CLOCK_HZ);
            assert!(unit.wait(20)[0].is_empty(), "bit {bit} of byte {at}");
        }
    }
}

/// A host that dies while it stores leaves nothing that runs, wherever that is.
#[test]
fn half_of_a_schedule_is_none() {
    let mut long = standalone(Start::AtOnce, 1);
    long.steps = vec![long.steps[0]; 100];
    long.program.extent = Extent::Table {
        steps: 100,
        cycles: 1,
    };
    let memory = memory_with(&long);
    let pages = (memory.bytes().len() / PAGE_BYTES) as u16;
    for written in FIRST_PAGE..pages {
        let mut cut = VirtualFlash::from(memory_with(&standalone(Start::AtOnce, 1)).bytes().to_vec());
        cut.store(0, &[]);
        for page in FIRST_PAGE..written {
            cut.store(
                page,
                &memory.bytes()[usize::from(page) * PAGE_BYTES..][..PAGE_BYTES],
            );
        }
        assert!(
            Cabled::on(cut, CLOCK_HZ).0.wait(20)[0].is_empty(),
            "{written} pages"
        );
    }
}

#[test]
fn what_the_box_cannot_play_is_refused_before_it_is_kept() {
    let mut device = device(VirtualFlash::default());
    let mut wrong = standalone(Start::AtOnce, 1);
    wrong.steps[1].cam.width = Ticks(1);
    let error = device.store(&wrong).unwrap_err();
    assert!(
        matches!(
            error,
            DeviceError::Refused {
                fault: Fault::EdgesTooClose { step: 1, .. },
                ..
            }
        ),
        "{error}"
    );
    let mut endless = standalone(Start::AtOnce, 1);
    endless.program.extent = Extent::Stream;
    assert!(matches!(device.store(&endless), Err(DeviceError::TooLong { .. })));
    assert_eq!(device.stored().unwrap(), None);
    // The longest there is.
    let mut longest = standalone(Start::AtOnce, 1);
    let step = Step {
        proj: Pulse::new(1_000_000_007, 1_000_000_007),
        cam: Pulse::new(3_000_000_019, 1_000_000_009),
        period: Ticks(4_000_000_033),
    };
    longest.steps = vec![step; 3276];
    longest.aux = Aux::default();
    longest.program.extent = Extent::Table {
        steps: 3276,
        cycles: 1,
    };
    device.store(&longest).unwrap();
}
