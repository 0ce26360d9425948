//! What is wrong with a command line, in one sentence like every other complaint.

use std::error::Error as _;
use std::process::ExitCode;

use clap::error::{ContextKind, ContextValue, Error, ErrorKind};

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
    // What follows a bad argument was not parsed.
    let json = std::env::args_os().any(|argument| argument == "--json");
    complain(
        &sentence(error),
        BAD_USAGE,
        json.then_some(serde_json::Value::Null),
    );
    ExitCode::from(BAD_USAGE)
}

fn sentence(error: &Error) -> String {
    let text = |kind| match error.get(kind) {
        Some(ContextValue::String(text)) => Some(text.as_str()),
        _ => None,
    };
    let (argument, found) = (text(ContextKind::InvalidArg), text(ContextKind::InvalidValue));
    let choices = match error.get(ContextKind::ValidValue) {
        Some(ContextValue::Strings(choices)) if !choices.is_empty() => Some(choices.join(" or ")),
        _ => None,
    };
    let reason = error.source().map(ToString::to_string);
    match (argument, found, choices, reason) {
        (Some(argument), Some(found), Some(choices), _) if !found.is_empty() => {
            format!("{argument}: expected {choices}, found `{found}`")
        }
        (Some(argument), Some(found), None, Some(reason)) if reason.starts_with("expected ") => {
            format!("{argument}: {reason}, found `{found}`")
        }
        (Some(argument), Some(found), None, Some(reason)) => {
            format!("{argument}: expected a value that fits, found `{found}` ({reason})")
        }
        _ => in_one_line(&error.to_string()),
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
