//! A schedule that the box keeps, and runs without a host.
//!
//! # Design
//! What is sent are the requests that a host would make, as frames, page by page. The box has to accept the schedule before: what is wrong
//! with it is said now, and not to nobody at the next power-up. The description is written last, and the box tells it again only if all that
//! it keeps has the sum that the description says.

use rcg_protocol::{
    Aux, Extent, FIRST_PAGE, MAX_FRAME, Micros, PAGE_BYTES, PAGES, Program, Reply, Request, STEPS_PER_APPEND,
    Seq, SessionId, Step, Stored, Ticks, ToDevice, checksum, encode,
};

use super::{Device, DeviceError};
use crate::capture::link::Link;

/// The version that keeps a schedule.
const STORED_SINCE: u16 = 5;

/// What a box does without a host, from each power-up on.
#[derive(Clone, Debug)]
pub struct Standalone {
    /// What begins a run, and how long it is: a table. Its dead-man time is not looked at.
    pub program: Program,
    /// Its steps.
    pub steps: Vec<Step>,
    /// What the further lines do.
    pub aux: Aux,
    /// What of STROBE is shorter is a glitch.
    pub shortest_strobe: Ticks,
    /// Runs after each power-up; 0 for ever.
    pub runs: u32,
}

impl Standalone {
    /// Steps of a run; `None` if that is no number, as in a stream.
    fn steps_of_a_run(&self) -> Option<u32> {
        match self.program.extent {
            Extent::Table { steps, cycles } => steps.checked_mul(cycles),
            Extent::Stream => None,
        }
    }

    /// The requests, as frames.
    fn requests(&self) -> Vec<u8> {
        let batches = self.steps.chunks(STEPS_PER_APPEND).enumerate();
        let appends = batches.map(|(batch, steps)| Request::Append {
            first: (batch * STEPS_PER_APPEND) as u64,
            steps: steps.iter().copied().collect(),
            last: false, // a table says so by its length
        });
        let program = Program {
            dead_man: Micros(0),
            ..self.program
        };
        let before = [
            Request::Filter {
                strobe: self.shortest_strobe,
            },
            Request::Aux(self.aux),
            Request::Repeat { runs: self.runs },
            Request::Load(program),
        ];
        let all = before
            .into_iter()
            .chain(appends)
            .chain([Request::Arm, Request::Start]);
        all.flat_map(|request| {
            frame(&ToDevice {
                session: SessionId(0),
                seq: Seq(0),
                request,
            })
        })
        .collect()
    }
}

fn frame(message: &impl serde::Serialize) -> Vec<u8> {
    let mut buffer = [0; MAX_FRAME];
    encode(message, &mut buffer)
        .expect("MAX_FRAME holds every message")
        .to_vec()
}

impl<L: Link> Device<L> {
    /// Lets the box keep `standalone` over resets, in the place of what it kept before, and run it from the next power-up on. The schedule
    /// is loaded, too, and can be tried.
    ///
    /// # Errors
    /// [`DeviceError`]; [`DeviceError::Older`] if the firmware is too old for it, [`DeviceError::TooLong`], a refusal of the schedule or
    /// while a run goes on, and [`DeviceError::NotStored`]; nothing is kept then, or what was kept before.
    pub fn store(&mut self, standalone: &Standalone) -> Result<Stored, DeviceError> {
        self.stored()?; // before anything is changed
        let requests = standalone.requests();
        let pages = requests.chunks(PAGE_BYTES);
        let (Some(steps), true) = (
            standalone.steps_of_a_run(),
            pages.len() <= usize::from(PAGES - FIRST_PAGE),
        ) else {
            return Err(DeviceError::TooLong {
                peer: self.link.peer().to_owned(),
                limit: self.info().max_steps,
                found: standalone.steps.len(),
            });
        };
        self.aux(&standalone.aux)?;
        self.load(&standalone.program, &standalone.steps)?;
        let stored = Stored {
            clock_hz: self.info().clock_hz,
            steps,
            start: standalone.program.start,
            runs: standalone.runs,
            length: requests.len() as u32,
            sum: checksum(&requests),
        };
        self.store_page(0, &[])?;
        for (page, bytes) in (FIRST_PAGE..).zip(pages) {
            self.store_page(page, bytes)?;
        }
        self.store_page(0, &frame(&stored))?;
        if self.stored()? == Some(stored) {
            Ok(stored)
        } else {
            Err(DeviceError::NotStored {
                peer: self.link.peer().to_owned(),
            })
        }
    }

    /// Lets the box keep no schedule any more.
    ///
    /// # Errors
    /// [`DeviceError`]; [`DeviceError::Older`] if the firmware is too old to keep one, a refusal while a run goes on, and
    /// [`DeviceError::NotStored`] if it keeps it all the same.
    pub fn forget(&mut self) -> Result<(), DeviceError> {
        self.needs(STORED_SINCE, "keeps a schedule")?;
        self.store_page(0, &[])?;
        match self.stored()? {
            None => Ok(()),
            Some(_) => Err(DeviceError::NotStored {
                peer: self.link.peer().to_owned(),
            }),
        }
    }

    /// What the box keeps to be run without a host.
    ///
    /// # Errors
    /// [`DeviceError`]; [`DeviceError::Older`] if the firmware is too old to keep anything.
    pub fn stored(&mut self) -> Result<Option<Stored>, DeviceError> {
        self.needs(STORED_SINCE, "keeps a schedule")?;
        match self.ask(&Request::Stored)? {
            Reply::Stored(stored) => Ok(stored),
            other => Err(self.wrong_reply("stored", &other)),
        }
    }

    fn store_page(&mut self, page: u16, bytes: &[u8]) -> Result<(), DeviceError> {
        let bytes = bytes.iter().copied().collect();
        self.ask_status(&Request::Store { page, bytes }).map(|_| ())
    }
}
