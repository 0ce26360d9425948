//! The client of the trigger box: requests with time-outs and retries, and events.
//!
//! # Design
//! A request is sent, and sent again under the same number if no answer comes; the controller executes it
//! once however often it arrives. Every request ends as a value or a named error within
//! `attempts × timeout` on the link's clock. Events that arrive meanwhile are kept for
//! [`Device::next_event`].
//!
//! Events may be lost on a bad link; [`Device::status`] always tells how things stand.

use std::collections::VecDeque;
use std::time::Duration;

use rcg_protocol::{
    Decoder, Event, Fault, Identity, Info, MAX_FRAME, PROTOCOL_VERSION, Program, Reply, Request, Response,
    RunId, SCHEMA_HASH, STEPS_PER_APPEND, Seq, SessionId, Status, Step, ToDevice, ToHost, encode,
};

use crate::link::{Link, LinkError};

/// How patient the client is.
#[derive(Clone, Copy, Debug)]
pub struct Patience {
    /// How long one attempt waits for its answer.
    pub timeout: Duration,
    /// How often a request is sent, at least once.
    pub attempts: u32,
}

impl Default for Patience {
    /// Ten times 200 ms: a USB hub that stalls recovers, a dead box is noticed in two seconds.
    fn default() -> Self {
        Self {
            timeout: Duration::from_millis(200),
            attempts: 10,
        }
    }
}

/// Why a request has no answer.
#[derive(Debug, thiserror::Error)]
pub enum DeviceError {
    /// The link failed.
    #[error(transparent)]
    Link(#[from] LinkError),
    /// Nothing answered.
    #[error(
        "port {peer}: expected an answer to `{request}`, found none after {attempts} attempts in {waited_s:.1} s"
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
        "port {peer}: expected protocol version {PROTOCOL_VERSION} (schema {SCHEMA_HASH:016x}), found version \
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
    /// The answer does not fit the question: a defect of the peer.
    #[error("port {peer}: the answer to `{request}` is of another kind: {reply}")]
    WrongReply {
        /// The peer.
        peer: String,
        /// What was asked.
        request: &'static str,
        /// What came.
        reply: String,
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

/// A connected trigger box.
#[derive(Debug)]
pub struct Device<L> {
    link: L,
    decoder: Decoder,
    session: SessionId,
    seq: u32,
    patience: Patience,
    events: VecDeque<Event>,
    corrupt: u64,
    info: Option<Info>,
}

impl<L: Link> Device<L> {
    /// Opens a session with the controller at the other end of `link`. `nonce` should differ from any that
    /// was used before.
    ///
    /// # Errors
    /// [`DeviceError`]; [`DeviceError::OtherVersion`] if the firmware is of another protocol version.
    pub fn connect(link: L, nonce: u32, patience: Patience) -> Result<Self, DeviceError> {
        let mut device = Self {
            link,
            decoder: Decoder::new(),
            session: SessionId(0),
            seq: 0,
            patience,
            events: VecDeque::new(),
            corrupt: 0,
            info: None,
        };
        device.open_session(nonce)?;
        Ok(device)
    }

    /// Opens a new session on the same link, after a disconnect or a take-over.
    ///
    /// # Errors
    /// As [`connect`](Self::connect).
    pub fn open_session(&mut self, nonce: u32) -> Result<(), DeviceError> {
        // A delimiter first: whatever half a frame the peer may hold ends here.
        self.link.send(&[0])?;
        self.decoder.reset();
        let identity = match self.ask_where(&Request::Hello { nonce }, |reply| match reply {
            Reply::Identity(identity) => identity.nonce == nonce,
            _ => true,
        })? {
            Reply::Identity(identity) => identity,
            other => return Err(self.wrong_reply("hello", &other)),
        };
        let Identity {
            protocol,
            schema,
            session,
            ..
        } = identity;
        if protocol != PROTOCOL_VERSION || schema != SCHEMA_HASH {
            let peer = self.link.peer().to_owned();
            return Err(DeviceError::OtherVersion {
                peer,
                version: protocol,
                schema,
            });
        }
        self.session = session;
        match self.ask(&Request::Describe)? {
            Reply::Info(info) => self.info = Some(info),
            other => return Err(self.wrong_reply("describe", &other)),
        }
        Ok(())
    }

    /// What the controller is and can do.
    #[must_use]
    pub fn info(&self) -> Info {
        self.info
            .expect("connect and open_session end with a description")
    }

    /// Frames from the controller that were dropped because they were corrupt.
    #[must_use]
    pub const fn corrupt_frames(&self) -> u64 {
        self.corrupt
    }

    /// The link, for its clock and name.
    #[must_use]
    pub const fn link(&self) -> &L {
        &self.link
    }

    /// The link, to be put right by a test or after a disconnect.
    pub const fn link_mut(&mut self) -> &mut L {
        &mut self.link
    }

    /// Round trip of a number.
    ///
    /// # Errors
    /// [`DeviceError`].
    pub fn ping(&mut self, number: u32) -> Result<(), DeviceError> {
        match self.ask(&Request::Ping(number))? {
            Reply::Pong(answer) if answer == number => Ok(()),
            other => Err(self.wrong_reply("ping", &other)),
        }
    }

    /// How things stand.
    ///
    /// # Errors
    /// [`DeviceError`].
    pub fn status(&mut self) -> Result<Status, DeviceError> {
        self.ask_status(&Request::Status)
    }

    /// Loads a table: `program` with its `steps`.
    ///
    /// # Errors
    /// [`DeviceError`]; a refusal names the step.
    pub fn load(&mut self, program: &Program, steps: &[Step]) -> Result<(), DeviceError> {
        let limit = self.info().max_steps;
        if steps.len() > limit as usize {
            let peer = self.link.peer().to_owned();
            return Err(DeviceError::TooLong {
                peer,
                limit,
                found: steps.len(),
            });
        }
        self.ask_room(&Request::Load(*program))?;
        for (batch, chunk) in steps.chunks(STEPS_PER_APPEND).enumerate() {
            let last = (batch + 1) * STEPS_PER_APPEND >= steps.len();
            self.append((batch * STEPS_PER_APPEND) as u64, chunk, last)?;
        }
        Ok(())
    }

    /// Begins a schedule without sending its steps.
    ///
    /// # Errors
    /// [`DeviceError`].
    pub fn begin(&mut self, program: &Program) -> Result<u32, DeviceError> {
        self.ask_room(&Request::Load(*program))
    }

    /// Adds up to [`STEPS_PER_APPEND`] steps; returns how many more fit.
    ///
    /// # Errors
    /// [`DeviceError`]; nothing was added then.
    pub fn append(&mut self, first: u64, steps: &[Step], last: bool) -> Result<u32, DeviceError> {
        if steps.len() > STEPS_PER_APPEND {
            let peer = self.link.peer().to_owned();
            return Err(DeviceError::TooLong {
                peer,
                limit: STEPS_PER_APPEND as u32,
                found: steps.len(),
            });
        }
        let steps = steps.iter().copied().collect();
        self.ask_room(&Request::Append { first, steps, last })
    }

    /// Primes the pulse engine; returns the number of the run.
    ///
    /// # Errors
    /// [`DeviceError`].
    pub fn arm(&mut self) -> Result<RunId, DeviceError> {
        match self.ask(&Request::Arm)? {
            Reply::Armed { run } => Ok(run),
            other => Err(self.wrong_reply("arm", &other)),
        }
    }

    /// Fires.
    ///
    /// # Errors
    /// [`DeviceError`].
    pub fn start(&mut self) -> Result<Status, DeviceError> {
        self.ask_status(&Request::Start)
    }

    /// Ends the run after the current step. The run is over when the status says so.
    ///
    /// # Errors
    /// [`DeviceError`].
    pub fn stop(&mut self) -> Result<Status, DeviceError> {
        self.ask_status(&Request::Stop)
    }

    /// Ends the run at once.
    ///
    /// # Errors
    /// [`DeviceError`].
    pub fn abort(&mut self) -> Result<Status, DeviceError> {
        self.ask_status(&Request::Abort)
    }

    /// Forgets the schedule.
    ///
    /// # Errors
    /// [`DeviceError`].
    pub fn clear(&mut self) -> Result<Status, DeviceError> {
        self.ask_status(&Request::Clear)
    }

    /// The next event, waiting at most `timeout` for it.
    ///
    /// # Errors
    /// [`DeviceError::Link`].
    pub fn next_event(&mut self, timeout: Duration) -> Result<Option<Event>, DeviceError> {
        let deadline = self.link.now() + timeout;
        loop {
            if let Some(event) = self.events.pop_front() {
                return Ok(Some(event));
            }
            let left = deadline.saturating_sub(self.link.now());
            let nobody = |_: &Response| false;
            if self.receive(left, nobody)?.is_none() && self.events.is_empty() && self.link.now() >= deadline
            {
                return Ok(None);
            }
        }
    }

    fn ask_status(&mut self, request: &Request) -> Result<Status, DeviceError> {
        match self.ask(request)? {
            Reply::Status(status) => Ok(status),
            other => Err(self.wrong_reply(name(request), &other)),
        }
    }

    fn ask_room(&mut self, request: &Request) -> Result<u32, DeviceError> {
        match self.ask(request)? {
            Reply::Room { steps } => Ok(steps),
            other => Err(self.wrong_reply(name(request), &other)),
        }
    }

    fn ask(&mut self, request: &Request) -> Result<Reply, DeviceError> {
        self.ask_where(request, |_| true)
    }

    fn ask_where(&mut self, request: &Request, fits: impl Fn(&Reply) -> bool) -> Result<Reply, DeviceError> {
        self.seq = self.seq.wrapping_add(1);
        let hello = matches!(request, Request::Hello { .. });
        let session = if hello { SessionId(0) } else { self.session };
        let seq = Seq(self.seq);
        let mut buffer = [0; MAX_FRAME];
        let frame = encode(
            &ToDevice {
                session,
                seq,
                request: request.clone(),
            },
            &mut buffer,
        )
        .expect("MAX_FRAME holds every message");
        let began = self.link.now();
        for attempt in 0..self.patience.attempts.max(1) {
            if attempt > 0 {
                // If the delimiter before was lost, the retry must not be glued to what went before it.
                self.link.send(&[0])?;
            }
            self.link.send(frame)?;
            let deadline = self.link.now() + self.patience.timeout;
            while self.link.now() < deadline {
                let left = deadline.saturating_sub(self.link.now());
                let answer = self.receive(left, |response| {
                    response.session == session
                        && response.seq == seq
                        && response.result.as_ref().map_or(true, &fits)
                })?;
                match answer {
                    Some(Ok(reply)) => return Ok(reply),
                    Some(Err(fault)) => {
                        let peer = self.link.peer().to_owned();
                        return Err(DeviceError::Refused {
                            peer,
                            request: name(request),
                            fault,
                        });
                    }
                    None => {}
                }
            }
        }
        Err(DeviceError::Timeout {
            peer: self.link.peer().to_owned(),
            request: name(request),
            attempts: self.patience.attempts.max(1),
            waited_s: self.link.now().saturating_sub(began).as_secs_f64(),
        })
    }

    /// Takes in what comes within `timeout`; returns the result of the response that `wanted` accepts.
    fn receive(
        &mut self,
        timeout: Duration,
        wanted: impl Fn(&Response) -> bool,
    ) -> Result<Option<Result<Reply, Fault>>, DeviceError> {
        let mut buffer = [0; 512];
        let count = self.link.receive(&mut buffer, timeout)?;
        let mut found = None;
        for &byte in &buffer[..count] {
            match self.decoder.push::<ToHost>(byte) {
                Some(Ok(ToHost::Event(event))) => self.events.push_back(event),
                Some(Ok(ToHost::Response(response))) if wanted(&response) => found = Some(response.result),
                // The answer to an earlier attempt, or to a request that was given up.
                Some(Ok(ToHost::Response(_))) | None => {}
                Some(Err(_)) => self.corrupt += 1,
            }
        }
        Ok(found)
    }

    fn wrong_reply(&self, request: &'static str, reply: &Reply) -> DeviceError {
        DeviceError::WrongReply {
            peer: self.link.peer().to_owned(),
            request,
            reply: format!("{reply:?}"),
        }
    }
}

const fn name(request: &Request) -> &'static str {
    match request {
        Request::Hello { .. } => "hello",
        Request::Describe => "describe",
        Request::Ping(_) => "ping",
        Request::Status => "status",
        Request::Load(_) => "load",
        Request::Append { .. } => "append",
        Request::Arm => "arm",
        Request::Start => "start",
        Request::Stop => "stop",
        Request::Abort => "abort",
        Request::Clear => "clear",
    }
}
