//! Feeding a stream of steps, with several batches under way at a time.
//!
//! # Design
//! One batch at a time would cost a round trip for every eight steps, which is too slow for a camera of 20,000 frames a
//! second. Several under way are safe because each names its first step: the controller takes them in order only, so
//! the answer to one vouches for all before it, and where one was lost the next is answered with
//! [`Fault::StepsOutOfOrder`], which says where to go on. A request that a later one has overtaken is never executed,
//! so what is sent again goes under new numbers.
//!
//! # Tradeoffs
//! A lost batch costs the ones behind it too: they are sent again.

use std::collections::VecDeque;
use std::time::Duration;

use rcg_protocol::{Command, Fault, MAX_FRAME, Reply, Request, Response, STEPS_PER_APPEND, Seq, State, Step};

use super::{Device, DeviceError, FeedEvent};
use crate::capture::link::Link;

/// Batches under way. The controller keeps as many places for answers free of telemetry.
const WINDOW: usize = 4;
/// After a full store the next batch is tried so much later, or when the controller says that there is room.
const FULL: Duration = Duration::from_millis(10);

/// A batch under way.
#[derive(Clone, Copy, Debug)]
struct Batch {
    seq: Seq,
    first: u64,
    end: u64,
    last: bool,
}

/// A stream of steps on its way to the controller.
#[derive(Debug)]
pub struct Feed<I> {
    steps: I,
    /// Drawn steps that the controller does not have for certain; the first of them is number `confirmed`.
    open: VecDeque<Step>,
    exhausted: bool,
    confirmed: u64,
    /// The next step to send.
    next: u64,
    under_way: VecDeque<Batch>,
    last_was_sent: bool,
    /// Steps that fitted when the controller last said so.
    room: u32,
    full_until: Option<Duration>,
    /// When the controller last got on, or sending began again.
    since: Duration,
    /// How often sending began again without the controller getting on.
    failures: u32,
    over: bool,
}

impl<I: Iterator<Item = Step>> Feed<I> {
    /// Nothing was sent yet; `room` steps fit.
    pub fn new(steps: I, room: u32) -> Self {
        Self {
            steps,
            open: VecDeque::new(),
            exhausted: false,
            confirmed: 0,
            next: 0,
            under_way: VecDeque::new(),
            last_was_sent: false,
            room,
            full_until: None,
            since: Duration::ZERO,
            failures: 0,
            over: false,
        }
    }

    /// Steps that the controller has for certain.
    #[must_use]
    pub const fn confirmed(&self) -> u64 {
        self.confirmed
    }

    /// Sends until the controller has everything, or no more fits.
    ///
    /// # Errors
    /// [`DeviceError`].
    pub fn fill<L: Link>(&mut self, device: &mut Device<L>) -> Result<(), DeviceError> {
        device.set_feeding(true);
        let filled = loop {
            if let Err(error) = self.advance(device) {
                break Err(error);
            }
            if self.over || self.under_way.is_empty() {
                break Ok(());
            }
            let waited = device.link.now().saturating_sub(self.since);
            let left = device.patience.timeout.saturating_sub(waited);
            if let Err(error) = device.receive(left, |_| false) {
                break Err(error);
            }
        };
        device.set_feeding(false);
        filled
    }

    /// Takes in what the controller has answered, and sends what can be sent. Does not wait.
    pub(crate) fn advance<L: Link>(&mut self, device: &mut Device<L>) -> Result<(), DeviceError> {
        while let Some(feed_events) = device.feed_events.pop_front() {
            match feed_events {
                FeedEvent::Room(steps) => {
                    self.room = steps;
                    self.full_until = None;
                }
                FeedEvent::Answer(response) => self.answer(device, &response)?,
            }
        }
        if self.over {
            return Ok(());
        }
        let now = device.link.now();
        if !self.under_way.is_empty() && now.saturating_sub(self.since) >= device.patience.timeout {
            // If a delimiter was lost, what comes now must not be glued to what went before.
            device.link.send(&[0])?;
            self.fail(device)?;
            self.go_back(now);
        }
        if self.full_until.is_some_and(|until| now < until) {
            return Ok(());
        }
        while self.under_way.len() < WINDOW && self.send_batch(device)? {}
        Ok(())
    }

    /// Sends the next batch if there is one and it fits.
    fn send_batch<L: Link>(&mut self, device: &mut Device<L>) -> Result<bool, DeviceError> {
        let from = (self.next - self.confirmed) as usize;
        // One more than is sent, to know which batch is the last.
        while !self.exhausted && self.open.len() <= from + STEPS_PER_APPEND {
            match self.steps.next() {
                Some(step) => self.open.push_back(step),
                None => self.exhausted = true,
            }
        }
        let to = self.open.len().min(from + STEPS_PER_APPEND);
        let last = self.exhausted && to == self.open.len();
        let sent_all = last && self.under_way.back().is_some_and(|batch| batch.last);
        // All that is under way has to fit too.
        if sent_all || to > self.room as usize {
            return Ok(false);
        }
        let first = self.next;
        let request = Request::Append {
            first,
            steps: self.open.range(from..to).copied().collect(),
            last,
        };
        let mut buffer = [0; MAX_FRAME];
        let (_, seq, frame) = device.number(request, &mut buffer);
        device.link.send(frame)?;
        if self.under_way.is_empty() {
            self.since = device.link.now();
        }
        self.next = self.confirmed + to as u64;
        self.last_was_sent |= last;
        let end = self.next;
        self.under_way.push_back(Batch {
            seq,
            first,
            end,
            last,
        });
        Ok(true)
    }

    fn answer<L: Link>(&mut self, device: &Device<L>, response: &Response) -> Result<(), DeviceError> {
        let of = |batch: &Batch| batch.seq == response.seq && device.session == response.session;
        let Some(place) = self.under_way.iter().position(of) else {
            return Ok(()); // of a batch that was sent again
        };
        let batch = self.under_way[place];
        let now = device.link.now();
        match response.result {
            Ok(Reply::Room { steps }) => {
                self.under_way.drain(..=place);
                self.confirm(batch.end, now);
                self.room = steps;
                self.over = batch.last;
            }
            Err(Fault::StepsOutOfOrder { expected, .. })
                if (self.confirmed..=self.next).contains(&expected) =>
            {
                if expected == self.confirmed {
                    self.fail(device)?;
                }
                self.confirm(expected, now);
                self.go_back(now);
            }
            Err(Fault::StreamFull { free }) => {
                self.confirm(batch.first, now);
                self.room = free;
                self.full_until = Some(now + FULL);
                self.go_back(now);
            }
            // It has the last batch already, or its run is over.
            Err(Fault::Refused {
                command: Command::Append,
                state,
            }) if self.last_was_sent
                || matches!(
                    state,
                    State::Done | State::Stopped | State::Aborted | State::Fault
                ) =>
            {
                self.over = true;
            }
            Ok(other) => return Err(device.wrong_reply("append", &other)),
            Err(fault) => {
                let peer = device.link.peer().to_owned();
                return Err(DeviceError::Refused {
                    peer,
                    request: "append",
                    fault,
                });
            }
        }
        Ok(())
    }

    /// The controller has all steps before `end`.
    fn confirm(&mut self, end: u64, now: Duration) {
        if end > self.confirmed {
            self.open.drain(..(end - self.confirmed) as usize);
            self.confirmed = end;
            self.next = self.next.max(end);
            self.since = now;
            self.failures = 0;
        }
    }

    /// Begins again with the first step that the controller does not have for certain.
    fn go_back(&mut self, now: Duration) {
        self.under_way.clear();
        self.next = self.confirmed;
        self.since = now;
    }

    /// Something went wrong without the controller getting on.
    fn fail<L: Link>(&mut self, device: &Device<L>) -> Result<(), DeviceError> {
        self.failures += 1;
        let attempts = device.patience.attempts.max(1);
        if self.failures < attempts {
            return Ok(());
        }
        Err(DeviceError::Timeout {
            peer: device.link.peer().to_owned(),
            request: "append",
            attempts,
            waited_s: device.link.now().saturating_sub(self.since).as_secs_f64(),
            heard: 0,
        })
    }
}
