//! The firmware's log: defmt frames from RTT, decoded with the ELF file that they came from.

use std::fmt::Write as _;

use defmt_decoder::{DecodeError, Table};

/// The log as text, one line a message; what cannot be decoded is said in a line of its own.
#[must_use]
pub fn decode(elf: &[u8], rtt: &[u8]) -> String {
    let table = match Table::parse(elf) {
        Ok(Some(table)) => table,
        Ok(None) => return "(the image has no defmt section)\n".to_owned(),
        Err(error) => return format!("(the image's defmt section: {error})\n"),
    };
    let mut decoder = table.new_stream_decoder();
    decoder.received(rtt);
    let mut text = String::new();
    loop {
        match decoder.decode() {
            Ok(frame) => {
                let level = frame.level().map_or("", |level| level.as_str());
                let timestamp = frame.display_timestamp().map(|t| t.to_string());
                let timestamp = timestamp.unwrap_or_default();
                let message = frame.display_message();
                writeln!(text, "{timestamp:>10} {level:5} {message}").expect("a string takes everything");
            }
            // A reset cuts a frame off; the encoding finds the next one.
            Err(DecodeError::Malformed) if table.encoding().can_recover() => text.push_str("(cut off)\n"),
            Err(DecodeError::Malformed | DecodeError::UnexpectedEof) => return text,
        }
    }
}
