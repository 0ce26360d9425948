//! What can go wrong between the client and the trigger box.

use rcg_protocol::{Fault, PROTOCOL_VERSION, SCHEMA_HASH};

use crate::base::blame::Blame;
use crate::capture::link::LinkError;

/// Why a request has no answer.
#[derive(Debug, thiserror::Error)]
pub enum DeviceError {
    /// The link failed.
    #[error(transparent)]
    Link(#[from] LinkError),
    /// Nothing answered.
    #[error(
        "port {peer}: expected {}, found {} after {attempts} attempts in {waited_s:.1} s",
        wanted(request), instead(request, *heard)
    )]
    Timeout {
        /// The peer.
        peer: String,
        /// What was asked.
        request: &'static str,
        /// How often.
        attempts: u32,
        /// How long, in seconds.
        waited_s: f64,
        /// Bytes that came meanwhile.
        heard: u64,
    },
    /// The controller refused.
    #[error("port {peer}: the controller refused `{request}`: {fault}")]
    Refused {
        /// The peer.
        peer: String,
        /// What was asked.
        request: &'static str,
        /// Why not.
        fault: Fault,
    },
    /// The controller speaks another version.
    #[error(
        "port {peer}: expected protocol version {PROTOCOL_VERSION} (schema {SCHEMA_HASH:016x}) or one before it, found version \
         {version} (schema {schema:016x}): flash the firmware that belongs to this program"
    )]
    OtherVersion {
        /// The peer.
        peer: String,
        /// Its version.
        version: u16,
        /// Its schema.
        schema: u64,
    },
    /// The controller speaks an older version, which cannot do this.
    #[error(
        "port {peer}: expected a firmware that {what} (protocol version {since} or later), found version {version}: flash \
         the firmware that belongs to this program"
    )]
    Older {
        /// The peer.
        peer: String,
        /// What was wanted.
        what: &'static str,
        /// The first version that can.
        since: u16,
        /// Its version.
        version: u16,
    },
    /// The answer does not fit the question: a defect of the peer.
    #[error("port {peer}: the answer to `{request}` is of another kind: {reply}")]
    WrongReply {
        /// The peer.
        peer: String,
        /// What was asked.
        request: &'static str,
        /// What came.
        reply: &'static str,
    },
    /// What the box was to keep, or to forget, is not in its memory as it should be.
    #[error(
        "port {peer}: expected the box to keep what it was sent, and no more, found that its flash does not: try again, or take another box"
    )]
    NotStored {
        /// The peer.
        peer: String,
    },
    /// A batch of steps that the controller has no room for.
    #[error("port {peer}: expected a schedule of at most {limit} steps, found {found}")]
    TooLong {
        /// The peer.
        peer: String,
        /// The controller's limit.
        limit: u32,
        /// Steps of the schedule.
        found: usize,
    },
}

impl Blame for DeviceError {
    fn is_input(&self) -> bool {
        match self {
            Self::Link(error) => error.is_input(),
            Self::TooLong { .. } => true,
            Self::Refused { fault, .. } => {
                use rcg_protocol::Fault;
                matches!(
                    fault,
                    Fault::EdgesTooClose { .. }
                        | Fault::PulseOutsidePeriod { .. }
                        | Fault::PeriodTooLong { .. }
                        | Fault::EmptySchedule
                        | Fault::TooManySteps { .. }
                        | Fault::TooManyWords { .. }
                )
            }
            _ => false,
        }
    }
}

/// Before `hello` is answered nothing says that a trigger box is there at all.
fn wanted(request: &str) -> String {
    match request {
        "hello" => "an RCG trigger box".to_owned(),
        _ => format!("an answer to `{request}`"),
    }
}

fn instead(request: &str, heard: u64) -> String {
    match (request, heard) {
        ("hello", 0) => "nothing that answers".to_owned(),
        ("hello", _) => format!("something else: {heard} bytes, none of them an answer,"),
        _ => "none".to_owned(),
    }
}

impl DeviceError {
    /// The controller's fault, if that is what it is.
    #[must_use]
    pub const fn fault(&self) -> Option<Fault> {
        match self {
            Self::Refused { fault, .. } => Some(*fault),
            _ => None,
        }
    }
}
