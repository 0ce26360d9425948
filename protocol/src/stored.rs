//! What a controller keeps of a schedule that it runs without a host.

use postcard_schema::Schema;
use serde::{Deserialize, Serialize};

use crate::schedule::Start;

/// Bytes of a page of the memory that schedules are kept in.
pub const PAGE_BYTES: usize = 256;

/// The page with which the requests of a kept schedule begin: those before it are erased together with the first.
pub const FIRST_PAGE: u16 = 16;

/// Pages of that memory: room for 4,096 steps of five numbers of five bytes, each eight of them with 20 bytes around them.
pub const PAGES: u16 = 512;

const _: () = assert!(
    (PAGES - FIRST_PAGE) as usize * PAGE_BYTES
        > 4096 / crate::STEPS_PER_APPEND * (crate::STEPS_PER_APPEND * 25 + 20)
);

/// A schedule that is kept over resets, to be run without a host. Since version 5.
///
/// Its requests are frames of [`ToDevice`](crate::ToDevice), whose session and number nobody looks at: [`Filter`](crate::Request::Filter), [`Aux`](crate::Request::Aux),
/// [`Repeat`](crate::Request::Repeat), [`Load`](crate::Request::Load), [`Append`](crate::Request::Append), [`Arm`](crate::Request::Arm) and [`Start`](crate::Request::Start). At power-up, and after no
/// other reset, they are carried out as if a host had made them, but for the dead-man time, which is none.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[cfg_attr(target_os = "none", derive(defmt::Format))]
pub struct Stored {
    /// The clock that its times are in. It is run at no other.
    pub clock_hz: u32,
    /// Steps of a run.
    pub steps: u32,
    /// What begins a run.
    pub start: Start,
    /// How often it is run after each power-up; 0 for ever.
    pub runs: u32,
    /// Bytes of its requests.
    pub length: u32,
    /// [`checksum`](crate::checksum) of these.
    pub sum: u32,
}
