//! Who measured, what, when and with what, on the page of a report.

use std::fmt::Write as _;
use std::path::Path;

use time::OffsetDateTime;
use time::format_description::well_known::Rfc3339;

use super::embedded;
use crate::capture::directory::{Measurement, MeasurementError};
use crate::capture::session::{ATTACHMENTS, Attachment, CalibrationUsed, Record, Session, TriggerBoxFacts};
use crate::measure::report::escape;
use crate::store::checksum::{sum_of, sum_of_tree};
use crate::store::whole_file::FileError;

/// Endings of files that a page shows.
const PICTURES: [&str; 4] = ["png", "jpg", "jpeg", "webp"];

/// The section of the page.
///
/// # Errors
/// [`MeasurementError`].
pub(super) fn record_html(measurement: &Measurement) -> Result<String, MeasurementError> {
    let record = measurement.record()?.unwrap_or_default();
    let mut rows = Vec::new();
    if record.sessions.is_empty() {
        rows.push((
            "session",
            "nobody said who measured, when and with what".to_owned(),
        ));
    }
    rows.extend(record.sessions.iter().flat_map(session_rows));
    if let Some(calibration) = &record.calibration {
        rows.extend(calibration_rows(calibration, record.sessions.first()));
    }
    rows.extend(
        record
            .trigger_boxes
            .iter()
            .map(|facts| ("trigger box", box_text(facts))),
    );
    rows.extend(
        measurement
            .rig
            .bands
            .as_ref()
            .map(|bands| ("bands", bands.words())),
    );
    let mut html = format!("<h2>Who, what, when</h2>\n<table>\n{}</table>\n", table(&rows));
    html.push_str(&attachments_html(measurement, &record));
    html.push_str(&sums_html(measurement)?);
    Ok(html)
}

fn table(rows: &[(&str, String)]) -> String {
    let row = |(what, text): &(&str, String)| {
        format!("<tr><th>{}</th><td>{}</td></tr>\n", escape(what), escape(text))
    };
    rows.iter().map(row).collect()
}

/// What there is to say of a session.
fn session_rows(session: &Session) -> Vec<(&'static str, String)> {
    let said = &session.said;
    let revision = session
        .revision
        .as_ref()
        .map_or_else(String::new, |revision| format!(", {revision}"));
    let host = session
        .host
        .as_ref()
        .map_or_else(String::new, |host| format!(" on {host}"));
    let mut rows = vec![(
        "began",
        format!(
            "{}: rcg {} ({}{revision}){host}",
            session.began, session.command, session.program
        ),
    )];
    let mut put = |what, text: Option<String>| rows.extend(text.map(|text| (what, text)));
    put("operator", said.operator.clone());
    put("laboratory", said.laboratory.clone());
    put(
        "temperature",
        said.temperature_c.map(|celsius| format!("{celsius} °C")),
    );
    put(
        "relative humidity",
        said.humidity_percent.map(|percent| format!("{percent} %")),
    );
    for (part, serial) in said.instruments.named() {
        put(part, Some(format!("serial number {serial}")));
    }
    for note in &said.notes {
        put("note", Some(note.clone()));
    }
    rows
}

/// What there is to say of the calibration of a measurement that began with `first`.
fn calibration_rows(used: &CalibrationUsed, first: Option<&Session>) -> Vec<(&'static str, String)> {
    let mut rows = Vec::new();
    if used.made.is_empty() {
        rows.push((
            "calibration",
            "it does not say when it was made, and by whom".to_owned(),
        ));
    }
    for made in &used.made {
        let age = first.and_then(|first| days_between(&made.began, &first.began));
        let age = age.map_or_else(String::new, |days| format!(", {days:.1} days before"));
        let by = made
            .said
            .operator
            .as_ref()
            .map_or_else(String::new, |name| format!(", by {name}"));
        rows.push(("calibration", format!("{} {}{age}{by}", made.command, made.began)));
    }
    rows.extend(used.standards.iter().map(|one| ("standard", one.clone())));
    for (name, sum) in &used.sha256 {
        rows.push(("calibration's file", format!("{name}: SHA-256 {sum}")));
    }
    rows
}

/// Days from one moment to another, both as RFC 3339 writes them.
fn days_between(from: &str, to: &str) -> Option<f64> {
    let [from, to] = [from, to].map(|text| OffsetDateTime::parse(text, &Rfc3339).ok());
    Some((to? - from?).as_seconds_f64() / 86_400.0)
}

fn box_text(facts: &TriggerBoxFacts) -> String {
    let [steps, words] = facts.table;
    format!(
        "{}, firmware {}, protocol {}, clock {} MHz, table of {steps} steps and {words} words",
        if facts.port == "sim" {
            "simulated"
        } else {
            &facts.port
        },
        facts.firmware,
        facts.protocol,
        f64::from(facts.clock_hz) / 1e6
    )
}

/// What went along, as it is now; pictures are shown.
fn attachments_html(measurement: &Measurement, record: &Record) -> String {
    let folder = measurement.path(ATTACHMENTS);
    let mut all: Vec<&Attachment> = Vec::new();
    for one in record.sessions.iter().flat_map(|session| &session.attached) {
        if !all.contains(&one) {
            all.push(one);
        }
    }
    let mut html = String::new();
    for one in all {
        let link = format!("{ATTACHMENTS}/{}", encoded(&one.name));
        let is_same = sum_of(&folder.join(&one.name)).ok().as_ref() == Some(&one.sha256);
        let state = if is_same {
            ""
        } else {
            " — not there as it went along"
        };
        writeln!(
            html,
            "<p><a href=\"{link}\">{}</a>: {} bytes, SHA-256 {}{state}</p>",
            escape(&one.name),
            one.bytes,
            escape(&one.sha256)
        )
        .expect("strings take everything");
        let ending = Path::new(&one.name)
            .extension()
            .and_then(|ending| ending.to_str());
        let is_picture = ending.is_some_and(|ending| PICTURES.contains(&ending.to_lowercase().as_str()));
        if is_same && is_picture {
            // Small ones go along with the page.
            let source = embedded(&folder.join(&one.name)).unwrap_or(link);
            writeln!(
                html,
                "<img src=\"{source}\" alt=\"{}\">",
                escape(&one.name).replace('"', "&quot;")
            )
            .expect("strings take everything");
        }
    }
    html
}

/// A file's name as a part of an address.
fn encoded(name: &str) -> String {
    name.bytes().fold(String::new(), |mut text, byte| {
        if byte.is_ascii_alphanumeric() || b"-_.~".contains(&byte) {
            text.push(char::from(byte));
        } else {
            write!(text, "%{byte:02X}").expect("strings take everything");
        }
        text
    })
}

/// SHA-256 of all that decided the numbers, and of these.
fn sums_html(measurement: &Measurement) -> Result<String, MeasurementError> {
    let mut sums = measurement.sums(&measurement.raw()?)?;
    let brdf = measurement.path("brdf.zarr");
    let sum = sum_of_tree(&brdf).map_err(|source| FileError::at(&brdf, source))?;
    sums.insert("brdf.zarr".to_owned(), sum);
    let record = measurement.path(Record::FILE);
    if record.exists() {
        let sum = sum_of(&record).map_err(|source| FileError::at(&record, source))?;
        sums.insert(Record::FILE.to_owned(), sum);
    }
    let rows: Vec<(&str, String)> = sums
        .iter()
        .map(|(name, sum)| (name.as_str(), sum.clone()))
        .collect();
    Ok(format!(
        "<h3>SHA-256 of what decided the numbers, and of these</h3>\n<table>\n{}</table>\n\
         <p>That of brdf.zarr is the sum of the lines that <code>find . -type f -printf '%P\\n' | LC_ALL=C sort | xargs -d '\\n' \
         sha256sum</code> prints in it; that of raw.zarr is the one of the seals of its segments, which bind the checksums (CRC-32C) of all \
         chunks.</p>\n",
        table(&rows)
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_is_a_part_of_an_address_and_ages_are_days() {
        assert_eq!(encoded("set up#1 \"ä\".jpg"), "set%20up%231%20%22%C3%A4%22.jpg");
        let days = |from, to| days_between(from, to);
        assert_eq!(days("2024-02-28T12:00:00Z", "2024-03-01T00:00:00Z"), Some(1.5));
        assert_eq!(days("yesterday", "2024-03-01T00:00:00Z"), None);
    }

    #[test]
    fn what_people_say_is_text_on_the_page() {
        let mut session = Session::default();
        session.said.operator = Some("<b>A & B</b>".to_owned());
        let html = table(&session_rows(&session));
        assert!(html.contains("&lt;b&gt;A &amp; B&lt;/b&gt;"), "{html}");
    }
}
