//! Where data, progress and remarks go.

use std::io::{self, IsTerminal as _, Write as _};
use std::path::Path;
use std::sync::Mutex;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressState, ProgressStyle};
use rcg::base::file_format::Formats;
use rcg::base::progress::Progress;
use rcg::base::text::{cut, plain};
use rcg::store::whole_file::{self, FileError};
use serde::Serialize;
use serde_json::Value;
use tracing_subscriber::filter::Targets;
use tracing_subscriber::prelude::*;

use crate::failure::Failure;
use crate::interrupt::Wish;
use crate::log::Log;

/// Characters of the longest complaint: a few hundred say all, the rest is what somebody's input was.
const LONGEST_SENTENCE: usize = 1000;

/// What the log has of the program's own events.
const LOGGED: &str = "rcg=info,warn";

/// The command's voice.
pub(crate) struct Output {
    json: bool,
    quiet: bool,
    bar: Mutex<Option<ProgressBar>>,
    log: Log,
    /// The stage that is on, and since when.
    stage: Mutex<Option<(String, Instant)>>,
    /// That the command ends, told between two words of progress.
    wish: Wish,
}

impl Output {
    /// Sets logging up: warnings, or more with each `-v`; `RCG_LOG` overrides.
    pub(crate) fn new(json: bool, quiet: bool, verbose: u8, wish: Wish) -> Self {
        let level = match (quiet, verbose) {
            (true, _) => "error",
            (_, 0) => "warn",
            (_, 1) => "rcg=info,warn",
            _ => "rcg=debug,info",
        };
        let asked = std::env::var("RCG_LOG").ok();
        let filter: Option<Targets> = asked.and_then(|targets| targets.parse().ok());
        let filter = filter.unwrap_or_else(|| level.parse().expect("invariant: our own levels"));
        let voice = tracing_subscriber::fmt::layer()
            .with_writer(io::stderr)
            .with_target(false)
            // Else it would print to stderr that it cannot print to stderr.
            .log_internal_errors(false)
            .with_filter(filter);
        let log = Log::default();
        let kept = log.clone();
        let kept = tracing_subscriber::fmt::layer()
            .with_writer(move || kept.clone())
            .with_target(false)
            .with_ansi(false)
            .without_time()
            .log_internal_errors(false)
            .with_filter(LOGGED.parse::<Targets>().expect("invariant: our own levels"));
        tracing_subscriber::registry().with(voice).with(kept).init();
        Self {
            json,
            quiet,
            bar: Mutex::new(None),
            log,
            stage: Mutex::new(None),
            wish,
        }
    }

    /// Keeps what is said in the log of the measurement in `dir` from now on, and what was said before; the caller has the right to write
    /// there.
    pub(crate) fn log_into(&self, dir: &Path) {
        self.log.open(dir);
    }

    /// Keeps a line in the log, and nowhere else.
    pub(crate) fn log(&self, line: &str) {
        self.log.say(line);
    }

    /// Says, once, that nothing more is kept of what is said.
    fn complain_of_log(&self) {
        if let Some(complaint) = self.log.complaint().filter(|_| !self.quiet) {
            writeln!(
                io::stderr(),
                "rcg: warning: {complaint}; what is said is not kept"
            )
            .ok();
        }
    }

    fn stage(&self) -> std::sync::MutexGuard<'_, Option<(String, Instant)>> {
        self.stage
            .lock()
            .unwrap_or_else(std::sync::PoisonError::into_inner)
    }

    /// Whether `--json` was given.
    pub(crate) const fn is_json(&self) -> bool {
        self.json
    }

    /// Prints `value` as JSON if that was asked for, else `text`.
    pub(crate) fn print<T: Serialize>(
        &self,
        value: &T,
        text: impl FnOnce() -> String,
    ) -> Result<(), Failure> {
        let mut out = io::stdout().lock();
        if self.json {
            serde_json::to_writer_pretty(&mut out, value).map_err(io::Error::from)?;
            writeln!(out)?;
        } else {
            // Names of files and samples may hold what a terminal would obey.
            for line in text().split_inclusive('\n') {
                let end = if line.ends_with('\n') { "\n" } else { "" };
                write!(out, "{}{end}", plain(line.trim_end_matches('\n')))?;
            }
        }
        out.flush()?;
        Ok(())
    }

    /// Says what the answer does not hold, unless remarks are unwanted; it has to be in the answer itself too.
    pub(crate) fn warn(&self, sentences: &[String]) {
        for sentence in sentences {
            self.log(&format!("warning: {sentence}"));
        }
        self.complain_of_log();
        for sentence in sentences.iter().filter(|_| !self.quiet) {
            // A reader of stderr that has gone is no reason to fail.
            writeln!(io::stderr(), "rcg: warning: {sentence}").ok();
        }
    }

    /// Says why the command failed.
    pub(crate) fn fail(&self, failure: &Failure) {
        self.end();
        self.log(&format!("failed: {failure}"));
        complain(
            &failure.to_string(),
            failure.exit_code(),
            self.json.then(|| failure.facts()),
        );
    }

    fn bar(&self) -> std::sync::MutexGuard<'_, Option<ProgressBar>> {
        self.bar.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
    }
}

/// Says why the command ends with the code `exit`; with `facts` (an object or null) as an object on stdout too.
pub(crate) fn complain(sentence: &str, exit: u8, facts: Option<Value>) {
    let sentence = cut(&plain(sentence), LONGEST_SENTENCE);
    // Nobody is left to tell if this fails.
    if let Some(mut object) = facts {
        object["error"] = sentence.as_str().into();
        object["exit"] = exit.into();
        writeln!(io::stdout(), "{object}").ok();
    }
    writeln!(io::stderr(), "rcg: {sentence}").ok();
}

/// Refuses a file that cannot be written, before the work for it is done: its name must end in one of `formats`.
pub(crate) fn to_write(path: &Path, formats: Formats) -> Result<(), Failure> {
    formats.of(path)?;
    whole_file::check(path).map_err(|source| FileError::at(path, source).into())
}

/// Lines of (what, figure) as aligned text.
pub(crate) fn table(lines: &[(&str, String)]) -> String {
    lines
        .iter()
        .flat_map(|(what, figure)| [format!("{what:20} "), figure.clone(), "\n".to_owned()])
        .collect()
}

impl Progress for Output {
    fn begin(&self, stage: &str, total: usize, unit: &str) {
        self.wish.hear();
        self.log(&format!("{stage}: {total} {unit}"));
        *self.stage() = Some((stage.to_owned(), Instant::now()));
        if self.quiet {
            return;
        }
        // Lines where a bar cannot be drawn over itself.
        let is_dumb = std::env::var_os("TERM").is_some_and(|term| term == "dumb");
        if is_dumb || !io::stderr().is_terminal() {
            // A reader of stderr that has gone is no reason to stop measuring.
            writeln!(io::stderr(), "{stage}: {total} {unit}").ok();
            return;
        }
        let template =
            format!("{{msg:14}} {{bar:32}} {{human_pos}}/{{human_len}} {unit}  {{rate}}  {{eta}} left");
        let rate = |state: &ProgressState, out: &mut dyn std::fmt::Write| {
            // A bar that cannot be drawn is no reason to fail.
            write!(out, "{:.0}/s", state.per_sec()).ok();
        };
        let style = ProgressStyle::with_template(&template)
            .unwrap_or_else(|_| ProgressStyle::default_bar())
            .with_key("rate", rate);
        let bar = ProgressBar::with_draw_target(Some(total as u64), ProgressDrawTarget::stderr_with_hz(10));
        bar.set_style(style);
        bar.set_message(stage.to_owned());
        bar.enable_steady_tick(Duration::from_millis(250));
        *self.bar() = Some(bar);
    }

    fn reach(&self, done: usize) {
        self.wish.hear();
        if let Some(bar) = self.bar().as_ref() {
            bar.set_position(done as u64);
        }
    }

    fn remark(&self, line: &str) {
        self.log(line);
        if !self.quiet {
            // A reader of stderr that has gone is no reason to stop measuring.
            writeln!(io::stderr(), "{}", plain(line)).ok();
        }
    }

    fn begun(&self, dir: &Path) {
        self.log_into(dir);
    }

    fn end(&self) {
        if let Some((stage, began)) = self.stage().take() {
            self.log(&format!(
                "{stage}: over after {:.1} s",
                began.elapsed().as_secs_f64()
            ));
        }
        if let Some(bar) = self.bar().take() {
            bar.finish();
        }
    }
}
