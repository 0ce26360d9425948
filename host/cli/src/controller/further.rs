//! What the further lines do in `rcg controller run`: AUX-A, AUX-B, PHOTO and START.

use std::path::Path;

use rcg::capture::records::PhotoFile;
use rcg::capture::steps::{AuxSpan, Limits, further};
use rcg_protocol::{Aux, AuxPolarity, AuxPulse, Event, Program, Step};

use crate::failure::Failure;

/// Options of the further lines.
#[derive(Debug, clap::Args)]
#[group(skip)]
pub(super) struct Args {
    /// Pulse AUX-A in every step: AT+WIDTH, both times, from the start of the step; or cam, cam+AFTER or cam+AFTER+WIDTH, from the
    /// leading edge of CAM and as long as CAM if no width is given
    #[arg(long, value_name = "PULSE", allow_hyphen_values = true)]
    aux_a: Option<AuxSpan>,
    /// Pulse AUX-B in every step, as --aux-a
    #[arg(long, value_name = "PULSE", allow_hyphen_values = true)]
    aux_b: Option<AuxSpan>,
    /// Begin at an edge of START
    #[arg(long, conflicts_with_all = ["start_on_sync", "each_on_sync"])]
    pub(super) start_on_line: bool,
}

impl Args {
    /// What the further lines do, if anything is said of them.
    pub(super) fn aux(
        &self,
        polarity: AuxPolarity,
        photo: bool,
        (steps, program): (&[Step], &Program),
        limits: Limits,
    ) -> Result<Option<Aux>, Failure> {
        let pulse =
            |option, span: Option<AuxSpan>| span.map_or(Ok(AuxPulse::Off), |span| span.pulse(option, limits));
        let aux = Aux {
            polarity,
            a: pulse("--aux-a", self.aux_a)?,
            b: pulse("--aux-b", self.aux_b)?,
            photo,
        };
        further(&aux, steps, program, limits)?;
        let told = aux != Aux::default() || self.start_on_line;
        Ok(told.then_some(aux))
    }
}

/// What PHOTO was told to do.
#[derive(Default)]
pub(super) struct Pulses {
    file: Option<PhotoFile>,
    run: u64,
    /// Number of the next pulse of the run.
    next: u64,
    pub(super) told: u64,
    pub(super) lost: u64,
    /// Runs of which the box has said how many pulses there were.
    pub(super) runs: u32,
}

impl Pulses {
    /// Writes them to `path`, if there is one.
    pub(super) fn to(path: Option<&Path>) -> Result<Self, Failure> {
        Ok(Self {
            file: path.map(PhotoFile::create).transpose()?,
            ..Self::default()
        })
    }

    pub(super) fn take(&mut self, event: &Event) -> Result<(), Failure> {
        match event {
            Event::Started { .. } => {
                self.run += 1;
                self.next = 0;
            }
            Event::Photo { first, pulses, .. } => {
                self.count(u64::from(*first));
                self.runs += u32::from(pulses.is_empty());
                for pulse in pulses {
                    self.told += 1;
                    if let Some(file) = &mut self.file {
                        file.write(self.run, self.next, pulse)?;
                    }
                    self.next += 1;
                }
            }
            _ => {}
        }
        Ok(())
    }

    /// There were so many in this run by now.
    pub(super) fn count(&mut self, pulses: u64) {
        self.lost += pulses.saturating_sub(self.next);
        self.next = self.next.max(pulses);
    }

    pub(super) fn finish(&mut self) -> Result<(), Failure> {
        Ok(self.file.take().map_or(Ok(()), PhotoFile::finish)?)
    }
}
