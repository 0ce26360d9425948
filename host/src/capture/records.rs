//! Step records as lines of a file, for people and other programs.
//!
//! CSV with a header line (`.csv`), or one JSON object a line (`.jsonl`), as the name of the file ends; whole or not
//! there, like every file. Columns: `step` (from 0),
//! `trigger_ticks` (from the start of the run), `strobe_delay_ticks` (from the trigger) and `strobe_width_ticks` (empty
//! or null where STROBE stayed at rest), `flags` (names with a blank between them).

use std::io::{self, BufWriter, Write as _};
use std::path::{Path, PathBuf};

use rcg_protocol::{PhotoPulse, StepFlags, StepRecord};
use serde_json::json;

use crate::base::blame::Blame;
use crate::base::file_format::{FormatError, RECORDS};
use crate::store::whole_file::WholeFile;

/// A file of step records that cannot be written.
#[derive(Debug, thiserror::Error)]
pub enum RecordsError {
    /// The name of the file says that it is none.
    #[error(transparent)]
    Format(#[from] FormatError),
    /// The file.
    #[error("{}: expected a file that can be written, found: {source}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        source: io::Error,
    },
}

impl Blame for RecordsError {
    fn is_input(&self) -> bool {
        matches!(self, Self::Format(_))
    }
}

/// A file of step records. It appears with [`finish`](Self::finish); until then what stood there before is there.
#[derive(Debug)]
pub struct RecordFile {
    path: PathBuf,
    out: BufWriter<WholeFile>,
    json: bool,
}

impl RecordFile {
    /// Begins the file.
    ///
    /// # Errors
    /// [`RecordsError`].
    pub fn create(path: &Path) -> Result<Self, RecordsError> {
        Self::begin(
            path,
            "step,trigger_ticks,strobe_delay_ticks,strobe_width_ticks,flags",
        )
    }

    fn begin(path: &Path, header: &str) -> Result<Self, RecordsError> {
        let json = RECORDS.of(path)? == "jsonl";
        let failed = |source| RecordsError::File {
            path: path.to_owned(),
            source,
        };
        let mut out = BufWriter::new(WholeFile::create(path).map_err(failed)?);
        if !json {
            writeln!(out, "{header}").map_err(failed)?;
        }
        Ok(Self {
            path: path.to_owned(),
            out,
            json,
        })
    }

    /// Adds a record.
    ///
    /// # Errors
    /// [`RecordsError`].
    pub fn write(&mut self, record: &StepRecord) -> Result<(), RecordsError> {
        let (step, trigger) = (record.step.0, record.trigger.0);
        let flags = flag_names(record.flags).join(" ");
        let (delay, width) = record
            .strobe
            .map(|strobe| (strobe.delay.0, strobe.width.0))
            .unzip();
        let written = if self.json {
            let line = json!({
                "step": step, "trigger_ticks": trigger,
                "strobe_delay_ticks": delay, "strobe_width_ticks": width, "flags": flags,
            });
            writeln!(self.out, "{line}")
        } else {
            let cell = |ticks: Option<u64>| ticks.map_or(String::new(), |ticks| ticks.to_string());
            writeln!(
                self.out,
                "{step},{trigger},{},{},{flags}",
                cell(delay),
                cell(width)
            )
        };
        self.checked(written)
    }

    /// Puts the file under its name, in place of an older one.
    ///
    /// # Errors
    /// [`RecordsError`]; the older one is still there then.
    pub fn finish(self) -> Result<(), RecordsError> {
        let finished = match self.out.into_inner() {
            Ok(file) => file.finish(),
            Err(error) => Err(error.into_error()),
        };
        finished.map_err(|source| RecordsError::File {
            path: self.path,
            source,
        })
    }

    fn checked(&self, result: io::Result<()>) -> Result<(), RecordsError> {
        result.map_err(|source| RecordsError::File {
            path: self.path.clone(),
            source,
        })
    }
}

/// A file of pulses of PHOTO, as one of step records. Columns: `run` (from 1), `pulse` (from 0 in each run), `on_ticks` (from the start of the
/// run) and `width_ticks` (empty or null where the pulse had not ended when the run did).
#[derive(Debug)]
pub struct PhotoFile(RecordFile);

impl PhotoFile {
    /// Begins the file.
    ///
    /// # Errors
    /// [`RecordsError`].
    pub fn create(path: &Path) -> Result<Self, RecordsError> {
        RecordFile::begin(path, "run,pulse,on_ticks,width_ticks").map(Self)
    }

    /// Adds pulse `number` of the run.
    ///
    /// # Errors
    /// [`RecordsError`].
    pub fn write(&mut self, run: u64, number: u64, pulse: &PhotoPulse) -> Result<(), RecordsError> {
        let (on, width) = (pulse.on.0, pulse.width.map(|width| width.0));
        let written = if self.0.json {
            let line = json!({ "run": run, "pulse": number, "on_ticks": on, "width_ticks": width });
            writeln!(self.0.out, "{line}")
        } else {
            let width = width.map_or(String::new(), |width| width.to_string());
            writeln!(self.0.out, "{run},{number},{on},{width}")
        };
        self.0.checked(written)
    }

    /// Puts the file under its name, as [`RecordFile::finish`].
    ///
    /// # Errors
    /// [`RecordsError`].
    pub fn finish(self) -> Result<(), RecordsError> {
        self.0.finish()
    }
}

/// The names of what is set; a bit without a name has its value.
#[must_use]
pub fn flag_names(flags: StepFlags) -> Vec<String> {
    (0..8)
        .map(|bit| StepFlags(1 << bit))
        .filter(|&flag| flags.contains(flag))
        .map(|flag| match flag {
            StepFlags::MISSED => "missed".to_owned(),
            StepFlags::DOUBLE => "double".to_owned(),
            StepFlags::NO_TRIGGER => "no-trigger".to_owned(),
            StepFlags::OVERRUN => "overrun".to_owned(),
            StepFlags::SYNC_MISSED => "sync-missed".to_owned(),
            StepFlags::SYNC_EXTRA => "sync-extra".to_owned(),
            StepFlags(other) => format!("flag-{other}"),
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use rcg_protocol::{StepId, Strobe, Ticks};

    use super::*;

    #[test]
    fn lines_say_what_the_records_say() {
        let dir = tempfile::tempdir().unwrap();
        let records = [
            StepRecord {
                step: StepId(0),
                trigger: Ticks(4_162_500),
                strobe: Some(Strobe {
                    delay: Ticks(625),
                    width: Ticks(1_250_000),
                }),
                flags: StepFlags::default(),
            },
            StepRecord {
                step: StepId(1),
                trigger: Ticks(9_000_000_000),
                strobe: None,
                flags: StepFlags::MISSED.with(StepFlags(64)),
            },
        ];
        let write = |name: &str| {
            let path = dir.path().join(name);
            let mut file = RecordFile::create(&path).unwrap();
            for record in &records {
                file.write(record).unwrap();
            }
            file.finish().unwrap();
            std::fs::read_to_string(path).unwrap()
        };
        assert_eq!(
            write("r.csv"),
            "step,trigger_ticks,strobe_delay_ticks,strobe_width_ticks,flags\n\
             0,4162500,625,1250000,\n1,9000000000,,,missed flag-64\n"
        );
        let lines = write("r.jsonl");
        let lines: Vec<serde_json::Value> = lines
            .lines()
            .map(|line| serde_json::from_str(line).unwrap())
            .collect();
        assert_eq!(lines[0]["strobe_width_ticks"], 1_250_000);
        assert_eq!(lines[1]["strobe_delay_ticks"], serde_json::Value::Null);
        assert_eq!(lines[1]["flags"], "missed flag-64");
        let nowhere = dir.path().join("no/such/place.csv");
        let sentence = RecordFile::create(&nowhere).unwrap_err().to_string();
        assert!(
            sentence.contains("place.csv: expected a file that can be written"),
            "{sentence}"
        );
    }
}
