//! Following a run of the trigger box to its end.

use std::time::Duration;

use rcg_protocol::{Event, Fault, RunId, State, Ticks};

use crate::device::{Device, DeviceError};
use crate::link::Link;

/// While a run goes on, the host makes itself heard this often, for the dead-man switch.
const KEEP_ALIVE: Duration = Duration::from_millis(400);

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
        mut event: impl FnMut(Option<&Event>) -> Result<(), E>,
    ) -> Result<Ending, E> {
        let mut heard = self.link().now();
        let mut over = None;
        loop {
            let next = match over {
                None => self.next_event(KEEP_ALIVE / 4)?,
                // What was sent before the end is still on its way.
                Some(ending) => match self.next_event(Duration::from_millis(1))? {
                    None => return Ok(ending),
                    next => next,
                },
            };
            let next = next.filter(|next| run_of(next) == run);
            if let Some(Event::Ended {
                state,
                fault,
                steps_done,
                at,
                ..
            }) = next
            {
                return Ok(Ending {
                    state,
                    fault,
                    steps_done,
                    at: Some(at),
                });
            }
            event(next.as_ref())?;
            if over.is_none() && self.link().now().saturating_sub(heard) >= KEEP_ALIVE {
                heard = self.link().now();
                // Notices an end whose event was lost, too.
                let status = self.status()?;
                over = (!matches!(status.state, State::Armed | State::Running)).then_some(Ending {
                    state: status.state,
                    fault: status.fault,
                    steps_done: status.steps_done,
                    at: None,
                });
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
        | Event::Ended { run, .. } => *run,
    }
}
