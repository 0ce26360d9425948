//! Commands and their answers, cut into reports.
//!
//! # Design
//! A command is a stream of bytes that fills as many reports as it needs, the last one with zeros (DLPU018J, 1.2):
//!
//! | bytes | content |
//! |---|---|
//! | 0 | flags: 0x80 reads, 0x40 wants an answer; in an answer 0x20 tells of an error |
//! | 1 | sequence, which the answer repeats |
//! | 2–3 | length of what follows, least significant byte first as everywhere |
//! | 4–5 | number of the command; an answer has none |
//! | 6– | data |
//!
//! The unit's buffer holds 512 bytes. Every command here wants an answer, writes too: so a command that was refused is known at once,
//! and none is sent into a unit that is busy with the one before.

use std::time::Duration;

use super::reports::{REPORT, Reports};

/// What the buffer of a unit holds, bytes.
pub const BUFFER: usize = 512;
/// Flags, sequence, length.
const HEADER: usize = 4;
/// The answer was to be read.
const READ: u8 = 0x80;
/// An answer is wanted.
const ANSWER: u8 = 0x40;
/// The command failed.
const ERROR: u8 = 0x20;
/// How long an answer may take: a change of mode takes 0.3 s.
const PATIENCE: Duration = Duration::from_secs(2);
/// How many answers to others may come before the one that is waited for.
const STALE: usize = 16;

/// A code that stands for no error of its own.
const UNKNOWN: u8 = 254;
/// Number of the command that reads the last error.
const LAST_ERROR: u16 = 0x0100;

/// Why a command was not done.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CommandError {
    /// The connection.
    #[error("{0}")]
    Connection(String),
    /// No answer.
    #[error("expected an answer to command {command:04X} within {} s, found none", PATIENCE.as_secs())]
    Silent {
        /// The command.
        command: u16,
    },
    /// The unit refused it.
    #[error("expected command {command:04X} to be done, found error {code}: {}", error_text(*code))]
    Refused {
        /// The command.
        command: u16,
        /// Its code, by the table of command 0100.
        code: u8,
    },
    /// It does not change its mode.
    #[error("expected mode {expected} within 2 s, found {found}")]
    Mode {
        /// The mode that it was told.
        expected: &'static str,
        /// The one that it is in.
        found: &'static str,
    },
    /// Its hardware status.
    #[error("expected a hardware status without faults, found {}", .0.join(", "))]
    Faults(Vec<&'static str>),
    /// The answer is not what the command has.
    #[error("expected {expected} bytes or more in answer to command {command:04X}, found {found}")]
    Short {
        /// The command.
        command: u16,
        /// How many it has.
        expected: usize,
        /// How many came.
        found: usize,
    },
}

/// What an error code of a DLPC900 says (DLPU018J, 2.1.6).
#[must_use]
pub const fn error_text(code: u8) -> &'static str {
    match code {
        0 => "no error",
        1 => "checksum of a batch file",
        2 => "device failure",
        3 => "invalid command number",
        4 => "controller and mirrors do not fit",
        5 => "not allowed in this mode",
        6 => "invalid parameter",
        7 => "what it refers to is not there",
        8 => "out of memory",
        9 => "compression of the image not supported",
        10 => "bit position out of range",
        11 => "image not there",
        12 => "dark time out of range",
        13 => "delay out of range",
        14 => "exposure time out of range",
        15 => "number of the pattern out of range",
        16 => "invalid pattern",
        17 => "address of the image out of range",
        255 => "internal error",
        _ => "unknown",
    }
}

/// A unit's commands.
pub struct Commands {
    reports: Box<dyn Reports>,
    sequence: u8,
}

impl Commands {
    /// Over these reports.
    #[must_use]
    pub fn new(reports: Box<dyn Reports>) -> Self {
        Self { reports, sequence: 0 }
    }

    /// Writes `data`.
    ///
    /// # Errors
    /// [`CommandError`].
    pub fn write(&mut self, command: u16, data: &[u8]) -> Result<(), CommandError> {
        self.ask(ANSWER, command, data).map(|_| ())
    }

    /// Reads what is of this `command`, `expected` bytes or more.
    ///
    /// # Errors
    /// [`CommandError`].
    pub fn read(&mut self, command: u16, expected: usize) -> Result<Vec<u8>, CommandError> {
        let data = self.ask(READ | ANSWER, command, &[])?;
        if data.len() < expected {
            return Err(CommandError::Short {
                command,
                expected,
                found: data.len(),
            });
        }
        Ok(data)
    }

    fn ask(&mut self, flags: u8, command: u16, data: &[u8]) -> Result<Vec<u8>, CommandError> {
        let (failed, answer) = self.exchange(flags, command, data)?;
        if !failed {
            return Ok(answer);
        }
        let code = match self.exchange(READ | ANSWER, LAST_ERROR, &[]) {
            Ok((false, answer)) => answer.first().copied().unwrap_or(UNKNOWN),
            _ => UNKNOWN,
        };
        Err(CommandError::Refused { command, code })
    }

    /// Sends a command and takes its answer: whether it failed, and its data.
    fn exchange(&mut self, flags: u8, command: u16, data: &[u8]) -> Result<(bool, Vec<u8>), CommandError> {
        self.sequence = self.sequence.wrapping_add(1);
        let mut bytes = vec![flags, self.sequence];
        bytes.extend((data.len() as u16 + 2).to_le_bytes());
        bytes.extend(command.to_le_bytes());
        bytes.extend(data);
        for part in bytes.chunks(REPORT) {
            let mut report = [0; REPORT];
            report[..part.len()].copy_from_slice(part);
            self.reports.send(&report).map_err(CommandError::Connection)?;
        }
        for _ in 0..=STALE {
            let first = self.reports.take(PATIENCE).map_err(CommandError::Connection)?;
            let Some(first) = first else { break };
            let length = usize::from(u16::from_le_bytes([first[2], first[3]])).min(BUFFER - HEADER);
            let mut answer = first[HEADER..].to_vec();
            while answer.len() < length {
                let more = self.reports.take(PATIENCE).map_err(CommandError::Connection)?;
                answer.extend(more.ok_or(CommandError::Silent { command })?);
            }
            answer.truncate(length);
            // What came late of a command that was given up is nobody's.
            if first[1] == self.sequence {
                return Ok((first[0] & ERROR != 0, answer));
            }
        }
        Err(CommandError::Silent { command })
    }
}
