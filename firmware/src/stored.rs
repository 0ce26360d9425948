//! A schedule that is kept over resets and run without a host.
//!
//! # Design
//! What is kept is what a host would say: frames of requests, as [`Stored`] describes. So an image that makes other words of a step
//! plays what one before has kept. The description is written last and has the sum of all, in a sector that is erased first: half a
//! schedule is none.

use rcg_protocol::{
    Decoder, FIRST_PAGE, Fault, MAX_FRAME, PAGE_BYTES, Request, Stored, ToDevice, checksum, decode,
};

/// What `memory` keeps for a clock of `clock_hz`, and its requests; `None` if that is nothing, or not whole.
#[must_use]
pub fn read(memory: &[u8], clock_hz: u32) -> Option<(Stored, &[u8])> {
    let mut decoder = Decoder::new();
    let frame = decoder.frame(&mut memory.get(..MAX_FRAME)?)?.ok()?;
    let stored: Stored = decode(frame).ok()?;
    let requests = memory.get(usize::from(FIRST_PAGE) * PAGE_BYTES..)?;
    let requests = requests.get(..stored.length as usize)?;
    let whole = stored.clock_hz == clock_hz && checksum(requests) == stored.sum;
    whole.then_some((stored, requests))
}

/// Makes the requests in `bytes` of `session`, one after the other.
///
/// # Errors
/// What is wrong with the first that is refused; none further is made then.
pub fn recall(bytes: &[u8], mut make: impl FnMut(&Request) -> Result<(), Fault>) -> Result<(), Fault> {
    let (mut bytes, mut decoder) = (bytes, Decoder::new());
    while let Some(frame) = decoder.frame(&mut bytes) {
        // The sum of all was right, so that a frame which is none was stored like that: by a host of another version.
        let Ok(message) = frame.and_then(decode::<ToDevice>) else {
            return Err(Fault::EmptySchedule);
        };
        make(&message.request)?;
    }
    Ok(())
}
