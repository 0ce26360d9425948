//! Law: what reaches the host of the records of a link that breaks off, and what is counted as lost, are all of them.

use proptest::prelude::*;
use rcg_firmware::packets::{PACKET, Packets};
use rcg_protocol::{Decoder, Event, MAX_FRAME, StepFlags, StepId, StepRecord, Strobe, Ticks, ToHost, encode};

/// Records from `first` on, with numbers of all lengths.
fn records(first: u64, count: usize) -> ToHost {
    let record = |step: u64| StepRecord {
        step: StepId(step),
        trigger: Ticks(step * 130_003),
        strobe: (!step.is_multiple_of(3)).then_some(Strobe {
            delay: Ticks(step % 300),
            width: Ticks(100),
        }),
        flags: StepFlags(0),
    };
    let records = (first..).take(count).map(record).collect();
    ToHost::Event(Event::Records { run: 1, records })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]
    #[test]
    fn records_arrive_or_are_counted(
        batches in proptest::collection::vec(0..=8_usize, 1..60),
        taken in proptest::collection::vec(prop_oneof![9 => Just(true), 1 => Just(false)], 50..400),
    ) {
        let (mut packets, mut decoder) = (Packets::new(), Decoder::new());
        let (mut batches, mut made) = (batches.into_iter(), 0_u64);
        let (mut arrived, mut lost, mut cut) = (Vec::new(), 0_u64, false);
        for taken in taken.into_iter().chain(std::iter::repeat_n(true, 800)) {
            packets.fill(|room| {
                // What lacks its delimiter only comes with the next frame, whenever there is one.
                let count = match batches.next() {
                    Some(count) => count,
                    None if cut => 0,
                    None => return (0, 0),
                };
                cut = false;
                let message = if count == 0 {
                    ToHost::Event(Event::Room { run: 1, steps: 7 })
                } else {
                    records(made, count)
                };
                made += count as u64;
                let mut frame = [0; MAX_FRAME];
                let frame = encode(&message, &mut frame).expect("it fits");
                room[..frame.len()].copy_from_slice(frame);
                (frame.len(), count as u32)
            });
            let Some(packet) = packets.packet() else { continue };
            prop_assert!(packet.len() <= PACKET);
            if !taken {
                lost += u64::from(packets.lost());
                cut = true;
                continue;
            }
            for &byte in packet {
                if let Some(Ok(ToHost::Event(Event::Records { records, .. }))) = decoder.push::<ToHost>(byte) {
                    arrived.extend(records.iter().map(|record| record.step.0));
                }
            }
            packets.sent();
        }
        prop_assert_eq!(arrived.len() as u64 + lost, made);
        prop_assert!(arrived.is_sorted());
    }
}
