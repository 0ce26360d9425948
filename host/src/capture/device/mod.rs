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
    Decoder, Event, Fault, Identity, Info, MAX_FRAME, Micros, PROTOCOL_VERSION, Program, Reply, Request,
    Response, RunId, SPOKEN, STEPS_PER_APPEND, Seq, SessionId, Status, Step, ToDevice, ToHost, encode,
};

use crate::capture::link::{self, Link};

mod error;
mod feed;
mod newer;
mod standalone;

pub use error::DeviceError;
pub use feed::Feed;
pub use standalone::Standalone;

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
    /// Bytes that came so far.
    heard: u64,
    info: Option<Info>,
    /// Version that the controller speaks.
    protocol: u16,
    /// How long the host may be silent in a run of what was loaded last; zero for ever.
    dead_man: Micros,
    /// What a [`Feed`] wants to hear of; collected while there is one.
    feed_events: VecDeque<FeedEvent>,
    feeding: bool,
}

/// What came for a [`Feed`], in the order of arrival.
#[derive(Debug)]
enum FeedEvent {
    /// An answer that nobody else waits for.
    Answer(Response),
    /// Steps that fit.
    Room(u32),
}

impl Device<Box<dyn Link>> {
    /// Opens a session with the trigger box at `port`, as [`link::open`] takes it.
    ///
    /// # Errors
    /// As [`connect`](Self::connect), and where there is no such port.
    pub fn at(port: &str) -> Result<Self, DeviceError> {
        Self::connect(link::open(port)?, link::nonce(), Patience::default())
    }
}

impl<L: Link> Device<L> {
    /// Opens a session with the controller at the other end of `link`. `nonce` should differ from any that
    /// was used before.
    ///
    /// # Errors
    /// [`DeviceError`]; [`DeviceError::OtherVersion`] if the firmware speaks neither this host's version of the protocol nor one of those before.
    pub fn connect(link: L, nonce: u32, patience: Patience) -> Result<Self, DeviceError> {
        let mut device = Self {
            link,
            decoder: Decoder::new(),
            session: SessionId(0),
            seq: 0,
            patience,
            events: VecDeque::new(),
            corrupt: 0,
            heard: 0,
            info: None,
            protocol: PROTOCOL_VERSION,
            dead_man: Micros::DEFAULT_DEAD_MAN,
            feed_events: VecDeque::new(),
            feeding: false,
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
        if !SPOKEN.contains(&(protocol, schema)) {
            let peer = self.link.peer().to_owned();
            return Err(DeviceError::OtherVersion {
                peer,
                version: protocol,
                schema,
            });
        }
        self.session = session;
        self.protocol = protocol;
        match self.ask(&Request::Describe)? {
            Reply::Info(info) => self.info = Some(info),
            other => return Err(self.wrong_reply("describe", &other)),
        }
        Ok(())
    }

    /// Collects what a [`Feed`] wants to hear of, or not any more.
    pub(crate) fn set_feeding(&mut self, feeding: bool) {
        self.feeding = feeding;
        self.feed_events.clear();
    }

    /// What the controller is and can do.
    #[must_use]
    pub fn info(&self) -> Info {
        self.info
            .expect("connect and open_session end with a description")
    }

    /// The version of the protocol that the controller speaks: the host's own or one before it.
    #[must_use]
    pub const fn protocol(&self) -> u16 {
        self.protocol
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
        self.begin(program)?;
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
        let room = self.ask_room(&Request::Load(*program))?;
        self.dead_man = program.dead_man;
        Ok(room)
    }

    /// How long the host may be silent in a run of what was loaded last, zero for ever; the default if another host
    /// has loaded it.
    #[must_use]
    pub const fn dead_man(&self) -> Micros {
        self.dead_man
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

    /// The next event, waiting at most `timeout` for it, or until a [`Feed`] has something to do.
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
            self.receive(left, |_| false)?;
            let over = self.link.now() >= deadline || !self.feed_events.is_empty();
            if self.events.is_empty() && over {
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
        let mut buffer = [0; MAX_FRAME];
        let (session, seq, frame) = self.number(request.clone(), &mut buffer);
        let (began, heard) = (self.link.now(), self.heard);
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
            heard: self.heard - heard,
        })
    }

    /// `request` as a frame under the next number.
    fn number<'a>(&mut self, request: Request, buffer: &'a mut [u8]) -> (SessionId, Seq, &'a [u8]) {
        self.seq = self.seq.wrapping_add(1);
        let hello = matches!(request, Request::Hello { .. });
        let session = if hello { SessionId(0) } else { self.session };
        let seq = Seq(self.seq);
        let message = ToDevice {
            session,
            seq,
            request,
        };
        let frame = encode(&message, buffer).expect("MAX_FRAME holds every message");
        (session, seq, frame)
    }

    /// Takes in what comes within `timeout`; returns the result of the response that `wanted` accepts.
    fn receive(
        &mut self,
        timeout: Duration,
        wanted: impl Fn(&Response) -> bool,
    ) -> Result<Option<Result<Reply, Fault>>, DeviceError> {
        let mut buffer = [0; 512];
        let count = self.link.receive(&mut buffer, timeout)?;
        self.heard += count as u64;
        let mut found = None;
        for &byte in &buffer[..count] {
            match self.decoder.push::<ToHost>(byte) {
                Some(Ok(ToHost::Event(event))) => {
                    if let (Event::Room { steps, .. }, true) = (&event, self.feeding) {
                        self.feed_events.push_back(FeedEvent::Room(*steps));
                    }
                    self.events.push_back(event);
                }
                Some(Ok(ToHost::Response(response))) if wanted(&response) => found = Some(response.result),
                Some(Ok(ToHost::Response(response))) if self.feeding => {
                    self.feed_events.push_back(FeedEvent::Answer(response));
                }
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
            reply: name_of(reply),
        }
    }
}

const fn name_of(reply: &Reply) -> &'static str {
    match reply {
        Reply::Identity(_) => "identity",
        Reply::Info(_) => "info",
        Reply::Pong(_) => "pong",
        Reply::Status(_) => "status",
        Reply::Room { .. } => "room",
        Reply::Armed { .. } => "armed",
        Reply::Unit(_) => "unit",
        Reply::Inputs(_) => "inputs",
        Reply::Kept(_) => "kept",
        Reply::KeptAux(_) => "kept of further lines",
        Reply::Photo(_) => "photo",
        Reply::Stored(_) => "stored",
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
        Request::Identify => "identify",
        Request::Filter { .. } => "filter",
        Request::Watch => "watch",
        Request::Inputs => "inputs",
        Request::Boot => "boot",
        Request::Keep(_) => "keep",
        Request::Kept => "kept",
        Request::Aux(_) => "further lines",
        Request::KeepAux(_) => "keep of further lines",
        Request::KeptAux => "kept of further lines",
        Request::Photo => "photo",
        Request::Repeat { .. } => "repeat",
        Request::Store { .. } => "store",
        Request::Stored => "stored",
    }
}
