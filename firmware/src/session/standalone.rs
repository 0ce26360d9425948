//! A schedule that is kept over resets, and made by the box as if a host had asked for it.

use rcg_protocol::{Command, FIRST_PAGE, Fault, Micros, PAGES, Program, Request, Stored, Ticks};

use super::Session;

impl Session {
    /// What is kept to be run without a host.
    pub fn set_stored(&mut self, stored: Option<Stored>) {
        self.stored = stored;
    }

    /// Whether a page is to be written: the request that brought it is none that came before.
    pub fn takes_page(&mut self) -> bool {
        core::mem::take(&mut self.takes_page)
    }

    pub(super) fn take_page(&mut self, page: u16) -> Result<(), Fault> {
        self.sequencer.check(Command::Store)?;
        // No host of this version asks for a page that there is not.
        self.takes_page = page == 0 || (FIRST_PAGE..PAGES).contains(&page);
        Ok(())
    }

    /// Does at `now` what a request that was kept asks for, unless it is none of those that make a schedule run. Nobody is answered, and
    /// nobody has to be heard while it runs. The schedule is forgotten if something is wrong with it.
    ///
    /// # Errors
    /// Why it was refused.
    pub fn recall(&mut self, now: Ticks, request: &Request) -> Result<(), Fault> {
        let done = match request {
            Request::Load(program) => {
                let program = Program {
                    dead_man: Micros(0),
                    ..*program
                };
                self.execute(now, &Request::Load(program))
            }
            Request::Filter { .. }
            | Request::Aux(_)
            | Request::Repeat { .. }
            | Request::Append { .. }
            | Request::Arm
            | Request::Start => self.execute(now, request),
            _ => Err(Fault::EmptySchedule),
        };
        if done.is_err() {
            self.sequencer.clear().ok(); // a run that goes on was not refused
        }
        done.map(|_| ())
    }
}
