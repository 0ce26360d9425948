//! A run whose end the host is not told of: the status says so, and what was sent before is not lost.

use std::time::Duration;

use rcg::device::{Device, DeviceError, Patience};
use rcg::link::{Link, LinkError, MemoryLink, memory_pair};
use rcg_protocol::{
    Decoder, Event, Identity, Info, MAX_FRAME, PROTOCOL_VERSION, Reply, Request, Response, SCHEMA_HASH,
    SessionId, State, Status, StepFlags, StepId, StepRecord, Ticks, ToDevice, ToHost, encode,
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
