//! Arguments that say who measures, and what else there is to say of a session.

use std::path::{Path, PathBuf};

use rcg::capture::session::{CalibrationUsed, Opening, Said, Session};
use rcg::instrument::calibration::Calibration;

use crate::clock;
use crate::failure::Failure;
use crate::request::words;

/// The heading in the help.
const SESSION: &str = "Session";
/// The state of the source, if whoever built this program said it.
const REVISION: Option<&str> = option_env!("RCG_REVISION");

/// What there is to say of a session; kept in session.json of what it makes, and shown in the report.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct SessionArgs {
    /// Who measures
    #[arg(long, value_name = "NAME", value_parser = words, help_heading = SESSION)]
    operator: Option<String>,
    /// Something worth knowing; can be given several times
    #[arg(long, value_name = "TEXT", value_parser = words, help_heading = SESSION)]
    note: Vec<String>,
    /// TOML file of what else there is to say, all of it optional: operator, laboratory, temperature_c, humidity_percent, notes,
    /// attachments (up to 20 files of at most 32 MiB, such as photographs, which are copied), and a table [instruments] of serial numbers:
    /// camera, projector, mirror, trigger_box
    #[arg(long, value_name = "FILE", help_heading = SESSION)]
    session: Option<PathBuf>,
}

impl SessionArgs {
    /// The first of them that was given.
    pub(crate) fn given(&self) -> Option<&'static str> {
        let all = [
            ("--operator", self.operator.is_some()),
            ("--note", !self.note.is_empty()),
            ("--session", self.session.is_some()),
        ];
        all.into_iter().find_map(|(name, given)| given.then_some(name))
    }

    /// A session of `command` that begins now, with the calibration in a directory if there is one.
    ///
    /// # Errors
    /// If what is said cannot be kept; nothing is written.
    pub(crate) fn opening(
        &self,
        command: &str,
        calibration: Option<(&Path, &Calibration)>,
    ) -> Result<Opening, Failure> {
        let mut said = match &self.session {
            Some(path) => Said::read(path)?,
            None => Said::default(),
        };
        said.operator = self.operator.clone().or(said.operator);
        said.notes.extend(self.note.iter().cloned());
        let session = Session {
            began: clock::now()?,
            command: command.to_owned(),
            program: concat!("rcg ", env!("CARGO_PKG_VERSION")).to_owned(),
            revision: REVISION.filter(|text| !text.is_empty()).map(str::to_owned),
            host: host(),
            ..Session::default()
        };
        let used = calibration.map(|(dir, found)| CalibrationUsed::read(dir, found.photometry.as_ref()));
        Ok(Opening {
            calibration: used.transpose()?,
            ..Opening::new(session, said)?
        })
    }
}

/// Name of this computer, as far as it says one.
fn host() -> Option<String> {
    let of_file = |path: &str| std::fs::read_to_string(path).ok();
    let of_variable = |name: &str| std::env::var(name).ok();
    let names = [
        of_file("/proc/sys/kernel/hostname"),
        of_file("/etc/hostname"),
        of_variable("COMPUTERNAME"),
        of_variable("HOSTNAME"),
    ];
    let plain = |name: String| words(&name).ok();
    names.into_iter().flatten().find_map(plain)
}
