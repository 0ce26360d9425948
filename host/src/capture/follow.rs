//! Firing the trigger box and following its run to the end.

use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::time::Duration;

use rcg_protocol::{Event, Fault, Program, RunId, State, Status, Step, Ticks};

use crate::capture::device::{Device, DeviceError, Feed};
use crate::capture::link::Link;

/// While a run goes on, the host makes itself heard at least this often.
const KEEP_ALIVE: Duration = Duration::from_millis(400);
/// … and this many times within the dead-man time, of which one may go by with work and one with a lost answer.
const SIGNS_OF_LIFE: u32 = 5;

/// A step that is not over by then waits for an edge that does not come.
const LAST_STEP: Duration = Duration::from_secs(5);

/// How a run ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Ending {
    /// `Done`, `Stopped`, `Aborted` or `Fault`.
    pub state: State,
    /// Why, if `Fault`.
    pub fault: Option<Fault>,
    /// Steps that were fired whole.
    pub steps_done: u64,
    /// When, from the start of the run; `None` if the event that says so was lost.
    pub at: Option<Ticks>,
}

impl<L: Link> Device<L> {
    /// Waits for the end of `run` and tells `event` of each of its events before the end, and with `None` of each
    /// short while without one. Keeps the dead-man switch quiet.
    ///
    /// # Errors
    /// [`DeviceError`], or what `event` returns.
    pub fn follow<E: From<DeviceError>>(
        &mut self,
        run: RunId,
        event: impl FnMut(Option<&Event>) -> Result<(), E>,
    ) -> Result<Ending, E> {
        self.follow_while(run, |_| Ok(Duration::MAX), event)
    }

    /// Plays the table `steps` as `program` says. Tells `event` as [`follow`](Self::follow) does.
    ///
    /// # Errors
    /// [`DeviceError`], or what `event` returns; the run is aborted then.
    pub fn play<E: From<DeviceError>>(
        &mut self,
        program: &Program,
        steps: &[Step],
        event: impl FnMut(Option<&Event>) -> Result<(), E>,
    ) -> Result<Ending, E> {
        self.play_with(program, steps, |_| Ok(()), event)
    }

    /// As [`play`](Self::play), calling `work` at least as often as `event`. What it does shall end within a
    /// [`keep_alive`](Self::keep_alive).
    ///
    /// # Errors
    /// As [`play`](Self::play), or what `work` returns.
    pub fn play_with<E: From<DeviceError>>(
        &mut self,
        program: &Program,
        steps: &[Step],
        mut work: impl FnMut(&mut Self) -> Result<(), E>,
        event: impl FnMut(Option<&Event>) -> Result<(), E>,
    ) -> Result<Ending, E> {
        self.play_led(
            program,
            steps,
            |device| work(device).map(|()| Duration::MAX),
            event,
        )
    }

    /// As [`play_with`](Self::play_with), where `work` says after how long at most it wants to be called again.
    ///
    /// # Errors
    /// As [`play_with`](Self::play_with).
    pub fn play_led<E: From<DeviceError>>(
        &mut self,
        program: &Program,
        steps: &[Step],
        work: impl FnMut(&mut Self) -> Result<Duration, E>,
        event: impl FnMut(Option<&Event>) -> Result<(), E>,
    ) -> Result<Ending, E> {
        self.load(program, steps)?;
        self.fire(work, event)
    }

    /// Plays `steps`, a table, until `runs` runs of it are done, each of which begins by itself as `program` says, such as at an edge of
    /// START; 0 for ever. Between two the box needs some 2 ms. Tells `event` as [`follow`](Self::follow) does, of all of them. Returns how
    /// many were done, and how the last one ended: as done, or as one that did not come to its end.
    ///
    /// # Errors
    /// As [`play`](Self::play); [`DeviceError::Older`] if the firmware repeats no runs.
    pub fn play_series<E: From<DeviceError>>(
        &mut self,
        program: &Program,
        steps: &[Step],
        runs: u32,
        event: impl FnMut(Option<&Event>) -> Result<(), E>,
    ) -> Result<(u32, Ending), E> {
        self.repeat(runs)?;
        self.load(program, steps)?;
        let first = self.arm()?;
        self.start()?;
        let followed = self.or_halt(|device| device.follow_series(first, runs, |_| Ok(Duration::MAX), event));
        // What is armed next is a run by itself again.
        let forgotten = self.repeat(1);
        let followed = followed?;
        forgotten?;
        Ok(followed)
    }

    /// How often the host makes itself heard while a run goes on, so that the dead-man switch stays quiet.
    #[must_use]
    pub fn keep_alive(&self) -> Duration {
        match Duration::from_micros(u64::from(self.dead_man().0)) {
            Duration::ZERO => KEEP_ALIVE,
            dead_man => KEEP_ALIVE.min(dead_man / SIGNS_OF_LIFE),
        }
    }

    /// Plays the stream `steps`, which is fed while the run goes on; `program` says that it is one. Tells `event` as
    /// [`follow`](Self::follow) does.
    ///
    /// # Errors
    /// [`DeviceError`], or what `event` returns; the run is aborted then.
    pub fn stream<E: From<DeviceError>>(
        &mut self,
        program: &Program,
        steps: impl Iterator<Item = Step>,
        event: impl FnMut(Option<&Event>) -> Result<(), E>,
    ) -> Result<Ending, E> {
        let mut feed = Feed::new(steps, self.begin(program)?);
        feed.fill(self)?;
        self.set_feeding(true);
        let ending = self.fire(|device| Ok(feed.advance(device).map(|()| Duration::MAX)?), event);
        self.set_feeding(false);
        ending
    }

    /// Fires what is loaded and follows it.
    fn fire<E: From<DeviceError>>(
        &mut self,
        work: impl FnMut(&mut Self) -> Result<Duration, E>,
        event: impl FnMut(Option<&Event>) -> Result<(), E>,
    ) -> Result<Ending, E> {
        let run = self.arm()?;
        self.start()?;
        self.or_halt(|device| device.follow_while(run, work, event))
    }

    /// Lets `follow` see a run to its end, which is brought about where that fails.
    fn or_halt<T, E: From<DeviceError>>(
        &mut self,
        follow: impl FnOnce(&mut Self) -> Result<T, E>,
    ) -> Result<T, E> {
        // Who is told of events may end by unwinding, where somebody has stopped the program.
        let followed = catch_unwind(AssertUnwindSafe(|| follow(self)));
        let ending = followed.unwrap_or_else(|unwinding| {
            self.halt();
            resume_unwind(unwinding)
        });
        if ending.is_err() {
            // Why it failed is told; that it cannot be aborted either is not news.
            self.abort().ok();
        }
        ending
    }

    /// Ends the run after the current step and waits for its end, so that the outputs are at rest. Nobody is left to hear what goes wrong
    /// here; the dead-man switch ends what does not answer.
    fn halt(&mut self) {
        let began = self.link().now();
        let mut status = self.stop();
        while let Ok(Status {
            state: State::Armed | State::Running,
            ..
        }) = status
        {
            status = if self.link().now().saturating_sub(began) < LAST_STEP {
                self.next_event(Duration::from_millis(10))
                    .and_then(|_| self.status())
            } else {
                self.abort()
            };
        }
        if status.is_err() {
            self.abort().ok();
        }
    }

    /// [`follow`](Self::follow), calling `work` at least as often as `event`, and as soon again as it says.
    fn follow_while<E: From<DeviceError>>(
        &mut self,
        run: RunId,
        work: impl FnMut(&mut Self) -> Result<Duration, E>,
        event: impl FnMut(Option<&Event>) -> Result<(), E>,
    ) -> Result<Ending, E> {
        Ok(self.follow_series(run, 1, work, event)?.1)
    }

    /// Follows the runs from `first` on, each of which begins when the one before it is done, until there were so many; 0 for ever. Calls
    /// `work` at least as often as `event`, and as soon again as it says. Returns how many were done, and how the last one ended.
    fn follow_series<E: From<DeviceError>>(
        &mut self,
        first: RunId,
        runs: u32,
        mut work: impl FnMut(&mut Self) -> Result<Duration, E>,
        mut event: impl FnMut(Option<&Event>) -> Result<(), E>,
    ) -> Result<(u32, Ending), E> {
        // Runs of before are behind by more than a series has.
        let most = if runs == 0 { RunId::MAX / 2 } else { runs };
        let keep_alive = self.keep_alive();
        let mut heard = self.link().now();
        let mut over = None;
        loop {
            let again = work(self)?;
            let next = match over {
                None => self.next_event(again.min(keep_alive / 4))?,
                // What was sent before the end is still on its way.
                Some(ended) => match self.next_event(Duration::from_millis(1))? {
                    None => return Ok(ended),
                    next => next,
                },
            };
            let number = next.as_ref().map_or(0, |next| run_of(next).wrapping_sub(first));
            let next = next.filter(|_| number < most);
            if let Some(Event::Ended {
                state,
                fault,
                steps_done,
                at,
                ..
            }) = next
            {
                let done = number + u32::from(state == State::Done);
                if state != State::Done || done == runs {
                    let ending = Ending {
                        state,
                        fault,
                        steps_done,
                        at: Some(at),
                    };
                    return Ok((done, ending));
                }
            }
            event(next.as_ref())?;
            if over.is_none() && self.link().now().saturating_sub(heard) >= keep_alive {
                heard = self.link().now();
                // Notices an end whose event was lost, too.
                let status = self.status()?;
                let done = status
                    .run
                    .wrapping_sub(first)
                    .wrapping_add(u32::from(status.state == State::Done));
                let ending = Ending {
                    state: status.state,
                    fault: status.fault,
                    steps_done: status.steps_done,
                    at: None,
                };
                over = (!matches!(status.state, State::Armed | State::Running)).then_some((done, ending));
            }
        }
    }
}

const fn run_of(event: &Event) -> RunId {
    match event {
        Event::Started { run, .. }
        | Event::Records { run, .. }
        | Event::SpuriousStrobe { run, .. }
        | Event::Room { run, .. }
        | Event::Ended { run, .. }
        | Event::Photo { run, .. } => *run,
    }
}
