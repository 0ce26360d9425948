//! Laws of the wire: what is encoded is decoded, and what was damaged is not.

use proptest::collection::vec;
use proptest::option;
use proptest::prelude::*;
use rcg_protocol::{
    Aux, AuxPolarity, AuxPulse, Chip, Command, Counters, Decoder, Event, Extent, Fault, Identity, Info,
    Input, Line, MAX_FRAME, Micros, Pace, Photo, PhotoPulse, Polarity, Program, Pulse, Reply, Request, Reset,
    Response, Seq, SessionId, Start, State, Status, Step, StepFlags, StepId, StepRecord, Stored, Strobe,
    Ticks, ToDevice, ToHost, Unit, encode,
};

fn cases(cases: u32) -> ProptestConfig {
    // Files of failed cases would lie about in the sources; a failure prints all that is needed.
    ProptestConfig {
        cases,
        failure_persistence: None,
        ..ProptestConfig::default()
    }
}

fn ticks() -> impl Strategy<Value = Ticks> {
    prop_oneof![any::<u64>(), 0..1000_u64].prop_map(Ticks)
}

fn pulse() -> impl Strategy<Value = Pulse> {
    (ticks(), ticks()).prop_map(|(at, width)| Pulse { at, width })
}

fn step() -> impl Strategy<Value = Step> {
    (pulse(), pulse(), ticks()).prop_map(|(proj, cam, period)| Step { proj, cam, period })
}

fn state() -> impl Strategy<Value = State> {
    prop_oneof![
        Just(State::Idle),
        Just(State::Loaded),
        Just(State::Armed),
        Just(State::Running),
        Just(State::Done),
        Just(State::Stopped),
        Just(State::Aborted),
        Just(State::Fault),
    ]
}

fn command() -> impl Strategy<Value = Command> {
    prop_oneof![
        Just(Command::Load),
        Just(Command::Append),
        Just(Command::Arm),
        Just(Command::Start),
        Just(Command::Stop),
        Just(Command::Clear),
    ]
}

fn fault() -> impl Strategy<Value = Fault> {
    prop_oneof![
        Just(Fault::StaleSession),
        (command(), state()).prop_map(|(command, state)| Fault::Refused { command, state }),
        Just(Fault::EmptySchedule),
        any::<u32>().prop_map(|limit| Fault::TooManySteps { limit }),
        any::<u32>().prop_map(|limit| Fault::TooManyWords { limit }),
        any::<(u64, u64)>().prop_map(|(expected, found)| Fault::StepsOutOfOrder { expected, found }),
        any::<u32>().prop_map(|free| Fault::StreamFull { free }),
        any::<(u64, u32)>().prop_map(|(step, shortest)| Fault::EdgesTooClose { step, shortest }),
        any::<u64>().prop_map(|step| Fault::PulseOutsidePeriod { step }),
        any::<u64>().prop_map(|step| Fault::PeriodTooLong { step }),
        any::<u64>().prop_map(|step| Fault::Underrun { step: StepId(step) }),
        any::<u64>().prop_map(|step| Fault::SyncTimeout { step: StepId(step) }),
        Just(Fault::HostLost),
        Just(Fault::Engine),
        Just(Fault::StartPaced),
        any::<u64>().prop_map(|step| Fault::SyncUnclear { step: StepId(step) }),
        prop_oneof![
            Just(Line::Sync),
            Just(Line::Strobe),
            Just(Line::Photo),
            Just(Line::Start)
        ]
        .prop_map(|line| Fault::InputTooFast { line }),
    ]
}

fn program() -> impl Strategy<Value = Program> {
    let extent = prop_oneof![
        any::<(u32, u32)>().prop_map(|(steps, cycles)| Extent::Table { steps, cycles }),
        Just(Extent::Stream)
    ];
    let start = prop_oneof![Just(Start::AtOnce), Just(Start::OnSync), Just(Start::OnStartLine)];
    let pace = prop_oneof![Just(Pace::FreeRunning), Just(Pace::EachOnSync)];
    (
        extent,
        start,
        pace,
        any::<(bool, bool, bool, bool)>(),
        any::<u32>(),
        any::<u32>(),
    )
        .prop_map(|(extent, start, pace, low, sync_timeout, dead_man)| Program {
            extent,
            start,
            pace,
            polarity: Polarity {
                proj_active_low: low.0,
                cam_active_low: low.1,
                sync_active_low: low.2,
                strobe_active_low: low.3,
            },
            sync_timeout: Micros(sync_timeout),
            dead_man: Micros(dead_man),
        })
}

fn aux_polarity() -> impl Strategy<Value = AuxPolarity> {
    any::<(bool, bool, bool, bool)>().prop_map(|(a, b, photo, start)| AuxPolarity {
        a_active_low: a,
        b_active_low: b,
        photo_active_low: photo,
        start_active_low: start,
    })
}

fn aux_pulse() -> impl Strategy<Value = AuxPulse> {
    prop_oneof![
        Just(AuxPulse::Off),
        any::<(u64, u64)>().prop_map(|(at, width)| AuxPulse::InStep(Pulse::new(at, width))),
        (ticks(), ticks()).prop_map(|(after, width)| AuxPulse::WithCam { after, width }),
    ]
}

fn request() -> impl Strategy<Value = Request> {
    prop_oneof![
        any::<u32>().prop_map(|nonce| Request::Hello { nonce }),
        Just(Request::Describe),
        any::<u32>().prop_map(Request::Ping),
        Just(Request::Status),
        program().prop_map(Request::Load),
        (any::<u64>(), vec(step(), 0..=8), any::<bool>()).prop_map(|(first, steps, last)| Request::Append {
            first,
            steps: steps.into_iter().collect(),
            last
        }),
        Just(Request::Arm),
        Just(Request::Start),
        Just(Request::Stop),
        Just(Request::Abort),
        Just(Request::Clear),
        Just(Request::Identify),
        any::<u64>().prop_map(|strobe| Request::Filter {
            strobe: Ticks(strobe)
        }),
        (aux_polarity(), aux_pulse(), aux_pulse(), any::<bool>()).prop_map(|(polarity, a, b, photo)| {
            Request::Aux(Aux {
                polarity,
                a,
                b,
                photo,
            })
        }),
        aux_polarity().prop_map(Request::KeepAux),
        Just(Request::KeptAux),
        Just(Request::Photo),
        any::<u32>().prop_map(|runs| Request::Repeat { runs }),
        (any::<u16>(), vec(any::<u8>(), 0..=256)).prop_map(|(page, bytes)| Request::Store {
            page,
            bytes: bytes.into_iter().collect(),
        }),
        Just(Request::Stored),
    ]
}

fn to_device() -> impl Strategy<Value = ToDevice> {
    (any::<u32>(), any::<u32>(), request()).prop_map(|(session, seq, request)| ToDevice {
        session: SessionId(session),
        seq: Seq(seq),
        request,
    })
}

fn status() -> impl Strategy<Value = Status> {
    (
        state(),
        any::<u32>(),
        any::<u64>(),
        option::of(fault()),
        ticks(),
        any::<[u32; 7]>(),
    )
        .prop_map(|(state, run, steps_done, fault, now, c)| Status {
            state,
            run,
            steps_done,
            fault,
            now,
            counters: Counters {
                frames: c[0],
                corrupt: c[1],
                repeated: c[2],
                stale: c[3],
                executed: c[4],
                records_lost: c[5],
                spurious_strobes: c[6],
            },
        })
}

fn reply() -> impl Strategy<Value = Reply> {
    prop_oneof![
        any::<(u16, u64, u32, u32)>().prop_map(|(protocol, schema, nonce, session)| Reply::Identity(
            Identity {
                protocol,
                schema,
                nonce,
                session: SessionId(session)
            }
        )),
        any::<((u8, u8, u8), [u32; 5], u64)>().prop_map(|(firmware, n, longest)| Reply::Info(Info {
            firmware,
            clock_hz: n[0],
            max_steps: n[1],
            max_words: n[2],
            shortest_free: n[3],
            shortest_sync: n[4],
            longest_period: Ticks(longest),
        })),
        any::<u32>().prop_map(Reply::Pong),
        status().prop_map(Reply::Status),
        any::<u32>().prop_map(|steps| Reply::Room { steps }),
        any::<u32>().prop_map(|run| Reply::Armed { run }),
        aux_polarity().prop_map(Reply::KeptAux),
        option::of(any::<[u32; 5]>()).prop_map(|stored| {
            Reply::Stored(stored.map(|[clock_hz, steps, runs, length, sum]| Stored {
                clock_hz,
                steps,
                start: Start::OnSync,
                runs,
                length,
                sum,
            }))
        }),
        any::<(bool, bool, Option<u32>, u32)>().prop_map(|(high, pulled_up, edges, pulses)| {
            let input = Input {
                high,
                pulled_up,
                edges,
                last: [Some(Ticks(u64::MAX)); 2],
            };
            Reply::Photo(Photo { input, pulses })
        }),
        (any::<u64>(), any::<u32>(), any::<bool>()).prop_map(|(serial, commit, modified)| {
            Reply::Unit(Unit {
                serial,
                commit,
                modified,
                chip: Chip::Rp2350,
                reset: Reset::UsbStuck,
            })
        }),
    ]
}

fn record() -> impl Strategy<Value = StepRecord> {
    (any::<u64>(), ticks(), option::of((ticks(), ticks())), any::<u8>()).prop_map(
        |(step, trigger, strobe, flags)| StepRecord {
            step: StepId(step),
            trigger,
            strobe: strobe.map(|(delay, width)| Strobe { delay, width }),
            flags: StepFlags(flags),
        },
    )
}

fn event() -> impl Strategy<Value = Event> {
    prop_oneof![
        (any::<u32>(), ticks()).prop_map(|(run, at)| Event::Started { run, at }),
        (any::<u32>(), vec(record(), 0..=8)).prop_map(|(run, records)| Event::Records {
            run,
            records: records.into_iter().collect()
        }),
        (any::<u32>(), ticks()).prop_map(|(run, on)| Event::SpuriousStrobe { run, on }),
        any::<(u32, u32)>().prop_map(|(run, steps)| Event::Room { run, steps }),
        (any::<(u32, u32)>(), vec((ticks(), option::of(ticks())), 0..=8)).prop_map(
            |((run, first), pulses)| {
                let pulses = pulses.into_iter().map(|(on, width)| PhotoPulse { on, width });
                Event::Photo {
                    run,
                    first,
                    pulses: pulses.collect(),
                }
            }
        ),
        (any::<u32>(), state(), option::of(fault()), any::<u64>(), ticks()).prop_map(
            |(run, state, fault, steps_done, at)| Event::Ended {
                run,
                state,
                fault,
                steps_done,
                at
            }
        ),
    ]
}

fn to_host() -> impl Strategy<Value = ToHost> {
    let result = prop_oneof![reply().prop_map(Ok), fault().prop_map(Err)];
    let response = (any::<u32>(), any::<u32>(), result).prop_map(|(session, seq, result)| {
        ToHost::Response(Response {
            session: SessionId(session),
            seq: Seq(seq),
            result,
        })
    });
    prop_oneof![response, event().prop_map(ToHost::Event)]
}

/// Everything that a fresh decoder makes of `bytes`.
fn accepted<T: serde::de::DeserializeOwned>(bytes: &[u8]) -> Vec<T> {
    let mut decoder = Decoder::new();
    bytes
        .iter()
        .filter_map(|&byte| decoder.push::<T>(byte))
        .filter_map(Result::ok)
        .collect()
}

proptest! {
    #![proptest_config(cases(2000))]

    #[test]
    fn any_request_round_trips(message in to_device()) {
        let mut buffer = [0; MAX_FRAME];
        let frame = encode(&message, &mut buffer).expect("every message fits a frame");
        prop_assert_eq!(frame.iter().position(|b| *b == 0), Some(frame.len() - 1));
        prop_assert_eq!(accepted::<ToDevice>(frame), vec![message]);
    }

    #[test]
    fn any_answer_or_event_round_trips(message in to_host()) {
        let mut buffer = [0; MAX_FRAME];
        let frame = encode(&message, &mut buffer).expect("every message fits a frame");
        prop_assert_eq!(accepted::<ToHost>(frame), vec![message]);
    }

    #[test]
    fn a_frame_is_what_other_libraries_make_of_the_message(message in to_device()) {
        let mut buffer = [0; MAX_FRAME];
        let frame = encode(&message, &mut buffer).expect("every message fits a frame");
        let mut bytes = [0; MAX_FRAME];
        let report = cobs::decode(frame, &mut bytes).expect("it is COBS");
        let mut plain = [0; MAX_FRAME];
        let body = postcard::to_slice(&message, &mut plain).expect("it has room");
        let crc = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC).checksum(body);
        let (decoded, tail) = bytes[..report.frame_size()].split_last_chunk().expect("a CRC");
        prop_assert_eq!((decoded, u32::from_le_bytes(*tail)), (&*body, crc));
    }

    #[test]
    fn any_bytes_decode_without_panic(bytes in vec(any::<u8>(), 0..2000)) {
        // Random bytes carry no valid CRC but once in 2^32 frames.
        prop_assert!(accepted::<ToDevice>(&bytes).is_empty());
        prop_assert!(accepted::<ToHost>(&bytes).is_empty());
    }

    #[test]
    fn right_crc_around_any_bytes_decodes_without_panic(bytes in vec(any::<u8>(), 0..200)) {
        let mut buffer = [0; MAX_FRAME];
        // A tuple of bytes is encoded as the bare bytes, without a length.
        for chunk in bytes.chunks_exact(8) {
            let raw: [u8; 8] = chunk.try_into().expect("chunks of 8");
            let frame = encode(&raw, &mut buffer).expect("short");
            let _ = accepted::<ToDevice>(frame);
            let _ = accepted::<ToHost>(frame);
        }
    }

    #[test]
    fn a_frame_after_garbage_is_found(message in to_device(), garbage in vec(any::<u8>(), 0..1000)) {
        let mut buffer = [0; MAX_FRAME];
        let frame = encode(&message, &mut buffer).expect("fits");
        let mut stream = garbage;
        stream.push(0);
        stream.extend_from_slice(frame);
        prop_assert_eq!(accepted::<ToDevice>(&stream), vec![message]);
    }
}

/// So also of those lengths in which a COBS block is just full. Large numbers take ten bytes each.
#[test]
fn any_single_flipped_bit_is_rejected_in_frames_of_every_length() {
    let mut lengths = std::collections::BTreeSet::new();
    for steps in 0..=8 {
        for large in 0..=5 * steps {
            for first in [
                1,
                1 << 7,
                1 << 14,
                1 << 21,
                1 << 28,
                1 << 35,
                1 << 42,
                1 << 49,
                1 << 56,
            ] {
                let mut numbers = (0..5 * steps).map(|n| Ticks(if n < large { u64::MAX } else { 1 }));
                let mut next = || numbers.next().expect("five numbers a step");
                let steps = (0..steps).map(|_| Step {
                    proj: Pulse {
                        at: next(),
                        width: next(),
                    },
                    cam: Pulse {
                        at: next(),
                        width: next(),
                    },
                    period: next(),
                });
                let request = Request::Append {
                    first,
                    steps: steps.collect(),
                    last: true,
                };
                // No zero byte but what the CRC may hold, so that blocks fill up.
                let message = ToDevice {
                    session: SessionId(1),
                    seq: Seq(1),
                    request,
                };
                let mut buffer = [0; MAX_FRAME];
                let frame = encode(&message, &mut buffer).expect("fits").to_vec();
                if !lengths.insert(frame.len()) {
                    continue;
                }
                assert_eq!(accepted::<ToDevice>(&frame), [message]);
                for bit in 0..frame.len() * 8 {
                    let mut flipped = frame.clone();
                    flipped[bit / 8] ^= 1 << (bit % 8);
                    assert!(
                        accepted::<ToDevice>(&flipped).is_empty(),
                        "{} bytes, bit {bit}",
                        frame.len()
                    );
                }
            }
        }
    }
    // 253 bytes of payload and CRC make a frame of 255; 254 fill a block, and the empty one behind it makes 257.
    assert!(
        [254, 255, 257, 258].iter().all(|length| lengths.contains(length)),
        "{lengths:?}"
    );
}

proptest! {
    #![proptest_config(cases(200))]

    #[test]
    fn any_single_flipped_bit_is_rejected(message in to_device(), answer in to_host()) {
        let mut buffer = [0; MAX_FRAME];
        let frame = encode(&message, &mut buffer).expect("fits").to_vec();
        let mut other = [0; MAX_FRAME];
        let reply = encode(&answer, &mut other).expect("fits").to_vec();
        for bit in 0..frame.len() * 8 {
            let mut flipped = frame.clone();
            flipped[bit / 8] ^= 1 << (bit % 8);
            prop_assert!(accepted::<ToDevice>(&flipped).is_empty(), "bit {} was not noticed", bit);
        }
        for bit in 0..reply.len() * 8 {
            let mut flipped = reply.clone();
            flipped[bit / 8] ^= 1 << (bit % 8);
            prop_assert!(accepted::<ToHost>(&flipped).is_empty(), "bit {} was not noticed", bit);
        }
    }
}
