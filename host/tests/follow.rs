//! Following a run: the host keeps the box alive while it waits, and notices an end that it is not told of.

use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::time::Duration;

use proptest::prelude::*;
use rcg::capture::device::{Device, DeviceError, Patience};
use rcg::capture::link::{Link, LinkError, MemoryLink, memory_pair};
use rcg::instrument::rig::Rig;
use rcg::virtual_rig::VirtualController;
use rcg_protocol::{
    Decoder, Event, Extent, Fault, Identity, Info, MAX_FRAME, Micros, PROTOCOL_VERSION, Pace, Program, Pulse,
    Reply, Request, Response, SCHEMA_HASH, SessionId, Start, State, Status, Step, StepFlags, StepId,
    StepRecord, Ticks, ToDevice, ToHost, encode,
};

const RUN: u32 = 7;

fn send(link: &mut MemoryLink, message: &ToHost) -> Result<(), LinkError> {
    let mut buffer = [0; MAX_FRAME];
    link.send(encode(message, &mut buffer).expect("fits"))
}

fn records(run: u32, step: u64) -> ToHost {
    let record = StepRecord {
        step: StepId(step),
        trigger: Ticks(step),
        strobe: None,
        flags: StepFlags::MISSED,
    };
    ToHost::Event(Event::Records {
        run,
        records: [record].into_iter().collect(),
    })
}

/// A controller that is done, and whose `Ended` was lost. Before its status come the records of three steps, one of
/// them of a former run.
fn forgetful(mut link: MemoryLink) {
    let mut decoder = Decoder::new();
    let mut buffer = [0; 64];
    // Ends when the host drops its end.
    while let Ok(count) = link.receive(&mut buffer, Duration::from_secs(10)) {
        for &byte in &buffer[..count] {
            let Some(Ok(ToDevice {
                session,
                seq,
                request,
            })) = decoder.push(byte)
            else {
                continue;
            };
            let reply = match request {
                Request::Hello { nonce } => Reply::Identity(Identity {
                    protocol: PROTOCOL_VERSION,
                    schema: SCHEMA_HASH,
                    nonce,
                    session: SessionId(1),
                }),
                Request::Describe => Reply::Info(Info {
                    firmware: (0, 0, 0),
                    clock_hz: 125_000_000,
                    max_steps: 1,
                    max_words: 1,
                    shortest_free: 3,
                    shortest_sync: 5,
                    longest_period: Ticks(1),
                }),
                _ => Reply::Status(Status {
                    state: State::Done,
                    steps_done: 3,
                    ..Status::default()
                }),
            };
            let asked_status = matches!(reply, Reply::Status(_));
            let mut sent = Ok(());
            if asked_status {
                // On the wire before the answer, as on a link that keeps its order.
                for (run, step) in [(RUN, 0), (RUN, 1), (RUN - 1, 9), (RUN, 2)] {
                    sent = sent.and_then(|()| send(&mut link, &records(run, step)));
                }
            }
            let response = ToHost::Response(Response {
                session,
                seq,
                result: Ok(reply),
            });
            let sent = sent.and_then(|()| send(&mut link, &response));
            if sent.is_err() {
                return;
            }
        }
    }
}

#[test]
fn a_lost_end_is_noticed_and_the_records_before_it_are_taken_in() {
    let (host, controller) = memory_pair();
    let peer = std::thread::spawn(move || forgetful(controller));
    // Patient, as the machine may be busy.
    let patience = Patience {
        timeout: Duration::from_secs(10),
        attempts: 1,
    };
    let mut device = Device::connect(host, 1, patience).expect("it answers");
    let mut steps = Vec::new();
    let ending = device
        .follow(RUN, |event| -> Result<(), DeviceError> {
            if let Some(Event::Records { records, .. }) = event {
                steps.extend(records.iter().map(|record| record.step.0));
            }
            Ok(())
        })
        .expect("it ends");
    assert_eq!(
        (ending.state, ending.steps_done, ending.at),
        (State::Done, 3, None)
    );
    assert_eq!(steps, [0, 1, 2]);
    drop(device);
    peer.join().expect("the peer ends with the link");
}

/// A simulated trigger box with the rig `preset` at its pins.
fn simulated(preset: &str) -> Device<VirtualController> {
    let rig = Rig::load(preset).expect("a preset");
    Device::connect(VirtualController::alone(&rig), 1, Patience::default()).expect("it answers")
}

fn program(steps: u32, dead_man: Micros, start: Start, pace: Pace) -> Program {
    Program {
        dead_man,
        start,
        pace,
        ..Program::new(Extent::Table { steps, cycles: 1 })
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    /// A host that only waits keeps the box alive, however long a step or a wait for SYNC is and however short the
    /// dead-man time.
    #[test]
    fn waiting_is_no_silence(
        preset in 0..3_usize,
        dead_man_us in prop_oneof![Just(0), 20_000..3_000_000_u32],
        periods_s in proptest::collection::vec((-5.5..2.05_f64).prop_map(|exponent| 10_f64.powf(exponent)), 1..4),
        on_sync in any::<bool>(),
        paced in any::<bool>(),
        streams in any::<bool>(),
    ) {
        let mut device = simulated(rcg::instrument::rig::PRESETS[preset]);
        let steps: Vec<Step> = periods_s.iter().map(|s| {
            let period = (s * 125e6) as u64;
            Step { proj: Pulse::new(0, 10), cam: Pulse::new(20, period - 40), period: Ticks(period) }
        }).collect();
        let start = if on_sync { Start::OnSync } else { Start::AtOnce };
        let pace = if paced { Pace::EachOnSync } else { Pace::FreeRunning };
        let table = program(steps.len() as u32, Micros(dead_man_us), start, pace);
        let mut triggers = Vec::new();
        let take = |event: Option<&Event>| -> Result<(), DeviceError> {
            if let Some(Event::Records { records, .. }) = event {
                triggers.extend(records.iter().map(|record| record.trigger));
            }
            Ok(())
        };
        let ending = if streams {
            let stream = Program { extent: Extent::Stream, ..table };
            device.stream(&stream, steps.iter().copied(), take)
        } else {
            device.play(&table, &steps, take)
        }.expect("it ends");
        prop_assert_eq!((ending.state, ending.fault, ending.steps_done), (State::Done, None, steps.len() as u64));
        prop_assert_eq!(triggers.len(), steps.len());
        if !paced {
            let begins = steps.iter().scan(0, |at, step| { let begin = *at; *at += step.period.0; Some(begin) });
            let expected: Vec<Ticks> = begins.map(|begin| Ticks(begin + 20)).collect();
            prop_assert_eq!(triggers, expected);
        }
    }

    /// A host that is silent is missed in time, in the middle of a step too, and no edge comes after.
    #[test]
    fn silence_is_noticed_in_the_middle_of_a_step(
        dead_man_us in 20_000..3_000_000_u32,
        period_s in (-3.0..2.05_f64).prop_map(|exponent| 10_f64.powf(exponent)),
    ) {
        let mut device = simulated("rcg-1-16bit");
        let period = (period_s * 125e6) as u64;
        let step = Step { proj: Pulse::new(0, 10), cam: Pulse::new(20, period - 40), period: Ticks(period) };
        let program = Program {
            dead_man: Micros(dead_man_us),
            ..Program::new(Extent::Table { steps: 1, cycles: 100_000 })
        };
        device.load(&program, &[step]).expect("it fits");
        device.arm().expect("it is loaded");
        device.start().expect("it is armed");
        let ended = loop {
            match device.next_event(Duration::from_secs(200)).expect("the link holds") {
                Some(Event::Ended { state, fault, at, .. }) => break (state, fault, at),
                Some(_) => {}
                None => panic!("a host that is silent for 200 s is not missed"),
            }
        };
        prop_assert_eq!((ended.0, ended.1), (State::Fault, Some(Fault::HostLost)));
        let limit = u64::from(dead_man_us) * 125;
        prop_assert!((limit * 4 / 5..=limit).contains(&ended.2.0), "{:?} of {limit}", ended.2);
    }
}

#[test]
fn a_sync_that_does_not_come_in_time_is_a_fault_at_the_start_and_at_a_step() {
    for (start, pace) in [
        (Start::OnSync, Pace::FreeRunning),
        (Start::AtOnce, Pace::EachOnSync),
    ] {
        let mut rig = Rig::load("rcg-1-16bit").expect("a preset");
        rig.projector.min_period_s = 5.0;
        let link = VirtualController::alone(&rig);
        let mut device = Device::connect(link, 1, Patience::default()).expect("it answers");
        let step = Step {
            proj: Pulse::new(0, 10),
            cam: Pulse::new(20, 100),
            period: Ticks(1000),
        };
        for (timeout_us, state) in [
            (1_000_000, State::Fault),
            (6_000_000, State::Done),
            (0, State::Done),
        ] {
            let program = Program {
                sync_timeout: Micros(timeout_us),
                ..program(1, Micros::DEFAULT_DEAD_MAN, start, pace)
            };
            let ending = device
                .play(&program, &[step], |_| Ok::<(), DeviceError>(()))
                .expect("it ends");
            assert_eq!(ending.state, state, "{start:?} {pace:?} {timeout_us} us");
            let missing = (state == State::Fault).then_some(Fault::SyncTimeout { step: StepId(0) });
            assert_eq!(ending.fault, missing);
        }
    }
}

#[test]
fn who_unwinds_out_of_a_run_leaves_the_outputs_at_rest() {
    // A step that takes too long is not waited for.
    for (period_s, expected) in [(0.02, State::Stopped), (20.0, State::Aborted)] {
        let mut device = simulated("rcg-1-16bit");
        let period = (period_s * 125e6) as u64;
        let step = Step {
            proj: Pulse::new(0, 10),
            cam: Pulse::new(20, period - 40),
            period: Ticks(period),
        };
        let program = Program::new(Extent::Table {
            steps: 1,
            cycles: 1000,
        });
        let stopped = catch_unwind(AssertUnwindSafe(|| {
            device.play(&program, &[step], |event| -> Result<(), DeviceError> {
                if matches!(event, Some(Event::Records { .. })) {
                    resume_unwind(Box::new("somebody pressed Ctrl-C"));
                }
                Ok(())
            })
        }));
        assert!(stopped.is_err());
        let status = device.status().expect("it answers");
        assert_eq!(status.state, expected);
        assert!((1..1000).contains(&status.steps_done), "{}", status.steps_done);
        // And is there for the next run.
        let ending = device.play(&program, &[step], |_| Ok::<(), DeviceError>(()));
        assert_eq!(ending.expect("it ends").state, State::Done);
    }
}

/// A series is followed from run to run, and each event is of one of them, in order.
#[test]
fn a_series_of_runs_is_followed_to_its_end() {
    for (runs, start) in [(1, Start::AtOnce), (4, Start::AtOnce), (3, Start::OnSync)] {
        let mut device = simulated("rcg-1");
        let program = program(5, Micros::DEFAULT_DEAD_MAN, start, Pace::FreeRunning);
        let Extent::Table { steps, .. } = program.extent else {
            panic!("it is a table");
        };
        let step = Step {
            proj: Pulse::new(0, 1_000),
            cam: Pulse::NONE,
            period: Ticks(100_000),
        };
        let mut heard = Vec::new();
        let (done, ending) = device
            .play_series(
                &program,
                &vec![step; steps as usize],
                runs,
                |event| -> Result<(), DeviceError> {
                    match event {
                        Some(Event::Started { run, .. }) => heard.push((*run, 0)),
                        Some(Event::Records { run, records }) => {
                            let (last, count) = heard.last_mut().expect("it has begun");
                            assert_eq!(run, last);
                            *count += records.len();
                        }
                        _ => {}
                    }
                    Ok(())
                },
            )
            .expect("it comes to its end");
        assert_eq!(
            (done, ending.state, ending.steps_done),
            (runs, State::Done, ending.steps_done)
        );
        let each = ending.steps_done as usize;
        let expected: Vec<(u32, usize)> = (1..=runs).map(|run| (run, each)).collect();
        assert!(each > 0);
        assert_eq!(heard, expected);
        // What is played next is a run by itself.
        device
            .play(
                &program,
                &vec![step; steps as usize],
                |_| -> Result<(), DeviceError> { Ok(()) },
            )
            .expect("it ends");
        assert_eq!(device.status().expect("it answers").run, runs + 1);
    }
}
