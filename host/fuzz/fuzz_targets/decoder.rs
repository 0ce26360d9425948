//! Whatever bytes come over the wire, both sides tell frames from noise, and a frame that is read is written as the same message again.
//!
//! `host/fuzz/fuzz.sh decoder`.

#![no_main]

use libfuzzer_sys::fuzz_target;
use rcg_protocol::{Decoder, MAX_FRAME, ToDevice, ToHost, encode};

fuzz_target!(|bytes: &[u8]| {
    let (mut device, mut host) = (Decoder::new(), Decoder::new());
    let mut buffer = [0; MAX_FRAME];
    for &byte in bytes {
        if let Some(Ok(message)) = device.push::<ToDevice>(byte) {
            let frame = encode(&message, &mut buffer).expect("MAX_FRAME holds every message").to_vec();
            let mut again = Decoder::new();
            let read = frame.iter().find_map(|&byte| again.push::<ToDevice>(byte));
            assert!(matches!(read, Some(Ok(read)) if read == message));
        }
        if let Some(Ok(message)) = host.push::<ToHost>(byte) {
            let frame = encode(&message, &mut buffer).expect("MAX_FRAME holds every message").to_vec();
            let mut again = Decoder::new();
            let read = frame.iter().find_map(|&byte| again.push::<ToHost>(byte));
            assert!(matches!(read, Some(Ok(read)) if read == message));
        }
    }
});
