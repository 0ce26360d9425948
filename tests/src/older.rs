//! A controller of a version before: it says so, and does not understand what later ones have added.

use rcg_protocol::{Decoder, MAX_FRAME, Reply, Request, Response, SPOKEN, ToDevice, ToHost, encode};

use crate::controller::Controller;
use crate::world::Peer;

/// The logic of this version behind what one before it knows: all messages that both have mean the same.
#[derive(Debug)]
pub struct Older {
    inner: Controller,
    decoder: Decoder,
    frame: Vec<u8>,
    version: u16,
    /// Requests that it did not understand.
    pub misunderstood: u32,
}

impl Older {
    /// Just switched on. It speaks `version`.
    #[must_use]
    pub fn new(version: u16) -> Self {
        Self {
            inner: Controller::new(&[]),
            decoder: Decoder::new(),
            frame: Vec::new(),
            version,
            misunderstood: 0,
        }
    }
}

/// The version that `request` came with.
const fn since(request: &Request) -> u16 {
    match request {
        Request::Store { .. } | Request::Stored => 5,
        Request::Aux(_)
        | Request::KeepAux(_)
        | Request::KeptAux
        | Request::Photo
        | Request::Repeat { .. } => 4,
        Request::Watch | Request::Inputs | Request::Boot | Request::Keep(_) | Request::Kept => 3,
        Request::Identify | Request::Filter { .. } => 2,
        _ => 1,
    }
}

impl Peer for Older {
    fn byte(&mut self, now_ns: u64, byte: u8) {
        self.frame.push(byte);
        let message = self.decoder.push::<ToDevice>(byte);
        if byte != 0 {
            return;
        }
        let frame = std::mem::take(&mut self.frame);
        let newer = message
            .is_some_and(|message| message.is_ok_and(|message| since(&message.request) > self.version));
        self.misunderstood += u32::from(newer);
        if !newer {
            for byte in frame {
                self.inner.byte(now_ns, byte);
            }
        }
    }

    fn tick(&mut self, now_ns: u64) {
        self.inner.tick(now_ns);
    }

    fn next_tick_ns(&self) -> Option<u64> {
        self.inner.next_tick_ns()
    }

    fn say(&mut self) -> Option<Vec<u8>> {
        let mut frame = self.inner.say()?;
        let mut decoder = Decoder::new();
        let mut said = frame.iter().find_map(|&byte| decoder.push::<ToHost>(byte));
        if let Some(Ok(ToHost::Response(Response {
            result: Ok(Reply::Identity(identity)),
            ..
        }))) = &mut said
        {
            (identity.protocol, identity.schema) = SPOKEN[usize::from(self.version) - 1];
            let mut buffer = [0; MAX_FRAME];
            let said = said?.ok()?;
            frame = encode(&said, &mut buffer).ok()?.to_vec();
        }
        Some(frame)
    }
}
