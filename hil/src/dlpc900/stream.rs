//! Reports, put together to commands.

use super::REPORT;

/// What the unit's buffer holds.
const BUFFER: usize = 512;

/// A command as it was sent.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Command {
    pub(super) flags: u8,
    pub(super) sequence: u8,
    pub(super) number: u16,
    pub(super) data: Vec<u8>,
}

impl Command {
    pub(super) const fn reads(&self) -> bool {
        self.flags & 0x80 != 0
    }

    pub(super) const fn wants_answer(&self) -> bool {
        self.flags & 0x40 != 0
    }
}

/// What has come of a command.
#[derive(Debug, Default)]
pub(super) struct Stream {
    begun: Vec<u8>,
    last: Option<u8>,
    /// What is not as the guide has it.
    pub(super) complaints: Vec<String>,
}

impl Stream {
    /// Takes one report; returns the command that is whole with it.
    pub(super) fn take(&mut self, report: &[u8; REPORT]) -> Option<Command> {
        self.begun.extend(report);
        let begun = &self.begun;
        let length = 4 + usize::from(u16::from_le_bytes([begun[2], begun[3]]));
        if !(6..=BUFFER).contains(&length) {
            let complaint = format!("a command of {length} bytes");
            self.complaints.push(complaint);
            self.begun.clear();
            return None;
        }
        if begun.len() < length {
            return None;
        }
        let bytes = std::mem::take(&mut self.begun);
        if bytes[length..].iter().any(|byte| *byte != 0) {
            self.complaints
                .push("a report that is not filled with zeros".to_owned());
        }
        if bytes[0] & 0x3F != 0 {
            self.complaints.push(format!("flags {:02x}", bytes[0]));
        }
        let sequence = bytes[1];
        // Whoever comes anew begins with 1.
        let follows = |last: u8| sequence == last.wrapping_add(1) || sequence == 1;
        if !self.last.is_none_or(follows) {
            self.complaints
                .push(format!("sequence {sequence} after another than the one before"));
        }
        self.last = Some(sequence);
        Some(Command {
            flags: bytes[0],
            sequence,
            number: u16::from_le_bytes([bytes[4], bytes[5]]),
            data: bytes[6..length].to_vec(),
        })
    }
}
