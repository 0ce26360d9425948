//! What is wrong with a command line, in one sentence like every other complaint.

use std::error::Error as _;
use std::process::ExitCode;

use clap::error::{ContextKind, ContextValue, Error, ErrorKind};
use rcg::base::text::shown;

use crate::output::complain;

/// Exit code for bad usage.
const BAD_USAGE: u8 = 2;

/// Prints help or version where they were asked for, else says what is wrong.
pub(crate) fn answer(error: &Error) -> ExitCode {
    let help = matches!(
        error.kind(),
        ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand | ErrorKind::MissingSubcommand
    );
    if help || !error.use_stderr() {
        // Nobody is left to tell if this fails.
        error.print().ok();
        return ExitCode::from(u8::try_from(error.exit_code()).unwrap_or(BAD_USAGE));
    }
    refuse(&sentence(error))
}

/// Says what is wrong with the command line.
pub(crate) fn refuse(sentence: &str) -> ExitCode {
    // What follows a bad argument was not parsed.
    let json = std::env::args_os().any(|argument| argument == "--json");
    complain(sentence, BAD_USAGE, json.then_some(serde_json::Value::Null));
    ExitCode::from(BAD_USAGE)
}

fn sentence(error: &Error) -> String {
    let text = |kind| match error.get(kind) {
        Some(ContextValue::String(text)) => Some(text.as_str()),
        _ => None,
    };
    let argument = text(ContextKind::InvalidArg);
    let found = text(ContextKind::InvalidValue)
        .filter(|found| !found.is_empty())
        .map(shown);
    let choices = match error.get(ContextKind::ValidValue) {
        Some(ContextValue::Strings(choices)) if !choices.is_empty() => Some(choices.join(" or ")),
        _ => None,
    };
    let reason = error.source().map(ToString::to_string);
    match (argument, found, choices, reason) {
        (Some(argument), Some(found), Some(choices), _) => {
            format!("{argument}: expected {choices}, found {found}")
        }
        (Some(argument), Some(found), None, Some(reason)) => {
            format!("{argument}: expected {}, found {found}", expected(&reason))
        }
        _ => in_one_line(&error.to_string()),
    }
}

/// What was expected, from the reason why something else is refused: our own readers say it, others give hints.
fn expected(reason: &str) -> String {
    if let Some(expected) = reason.strip_prefix("expected ") {
        return expected.to_owned();
    }
    if let Some((_, range)) = reason.split_once(" is not in ") {
        return match range.split_once("..=") {
            Some((low, high)) => format!("a whole number from {low} to {high}"),
            None => format!("a whole number in {range}"),
        };
    }
    match reason {
        "invalid float literal" => "a number".to_owned(),
        "invalid digit found in string" => "a whole number that is not negative".to_owned(),
        "number too large to fit in target type" => format!("a whole number up to {}", u64::MAX),
        other => format!("a value that fits ({other})"),
    }
}

/// The parser's own words without its drawing of the usage.
fn in_one_line(rendered: &str) -> String {
    let end = ["\nUsage:", "\nFor more information"]
        .iter()
        .filter_map(|mark| rendered.find(mark))
        .min()
        .unwrap_or(rendered.len());
    let paragraphs: Vec<String> = rendered[..end]
        .trim_start_matches("error: ")
        .split("\n\n")
        .map(|paragraph| paragraph.split_whitespace().collect::<Vec<_>>().join(" "))
        .filter(|paragraph| !paragraph.is_empty())
        .collect();
    paragraphs.join("; ")
}
