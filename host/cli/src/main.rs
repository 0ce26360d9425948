//! `rcg`: the command of the Rapid Catadioptric Gonioreflectometer.
//!
//! # Design
//! One file per subcommand: it parses, calls the library and prints. Data go to stdout, progress and logs to
//! stderr. Exit 0: done; 1: failed; 2: bad usage or input.

mod adaptive;
mod arguments;
mod assemble;
mod bench;
mod budget;
mod calibrate;
mod camera;
mod capture;
mod clock;
mod collection;
mod combine;
mod compare;
mod controller;
mod evaluate;
mod export;
mod failure;
mod fill;
mod fit;
mod groups;
mod history;
mod info;
mod interrupt;
mod live;
mod log;
mod map;
mod measure;
mod multiplex;
mod numbers;
mod output;
mod paper;
mod patterns;
mod plan;
mod plot;
mod projector;
mod queue;
mod reflectance;
mod render;
mod report;
mod request;
mod rig;
mod session;
mod shell;
mod stage;
mod standard;
mod study;
mod truth;
mod turn;
mod usage;
mod value;
mod worlds;

use std::io::Write as _;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::process::ExitCode;

use clap::{CommandFactory as _, FromArgMatches as _, Parser, Subcommand};
use failure::Failure;
use interrupt::{Interrupted, Wish};
use output::Output;
use rcg::base::progress::Progress as _;
use rcg::instrument::rig::Rig;

/// The instrument, unless another is named …
const RIG: &str = "rcg-3";
/// … with the command or in this variable of the environment.
const RIG_VARIABLE: &str = "RCG_RIG";

/// Measures the four-angle BRDF of flat samples with an ellipsoidal mirror, a camera and a projector.
///
/// Without hardware everything runs on a virtual rig whose camera and projector are driven, edge by edge, by
/// the firmware's own logic. Angles are in degrees, f in 1/sr without the cosine.
#[derive(Debug, Parser)]
#[command(name = "rcg", version, max_term_width = 100, arg_required_else_help = true)]
struct Cli {
    /// The instrument: rcg-1, rcg-1-16bit, rcg-2, rcg-3, dmd, or a rig file (TOML) [default: that in RCG_RIG, else rcg-3]
    #[arg(long, global = true, value_name = "FILE|PRESET")]
    rig: Option<String>,
    /// Print one JSON object instead of text
    #[arg(long, global = true)]
    json: bool,
    /// No progress, no remarks
    #[arg(short, long, global = true, conflicts_with = "verbose")]
    quiet: bool,
    /// More remarks on stderr; twice for details
    #[arg(short, long, global = true, action = clap::ArgAction::Count)]
    verbose: u8,
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Plan, capture, assemble, evaluate and report in one go
    Measure(measure::Args),
    /// Show what a measurement would take, or write its plan
    Plan(plan::Args),
    /// Write the patterns that a measurement shows
    Patterns(patterns::Args),
    /// Capture the frames of a planned measurement, or what is missing of them
    Capture(capture::Args),
    /// Find out how the instrument really is, with targets in place of the sample
    #[command(subcommand)]
    Calibrate(calibrate::Command),
    /// Turn the captured frames of a measurement into brdf.zarr
    Assemble(assemble::Args),
    /// Directions on stdin to camera and projector pixels
    Map(map::Args),
    /// Pairs of directions on stdin to values of a BRDF
    Value(value::Args),
    /// Judge a BRDF by itself and against a known sample
    Evaluate(evaluate::Args),
    Compare(compare::Args),
    Info(info::Args),
    Export(export::Args),
    Fit(fit::Args),
    Combine(combine::Args),
    #[command(subcommand)]
    Collection(collection::Command),
    History(history::Args),
    Fill(fill::Args),
    Turn(turn::Args),
    Reflectance(reflectance::Args),
    Budget(budget::Args),
    Render(render::Args),
    Plot(plot::Args),
    Report(report::Args),
    Study(study::Args),
    Bench(bench::Args),
    Paper(paper::Args),
    Multiplex(multiplex::Args),
    Standard(standard::Args),
    Truth(truth::Args),
    Worlds(worlds::Args),
    /// Talk to the trigger box
    Controller(controller::Args),
    Camera(camera::Args),
    Projector(projector::Args),
    Rig(rig::Args),
    Live(live::Args),
    Completions(shell::Completions),
    Man(shell::Man),
}

impl Command {
    /// What there is to say to who stopped it.
    const fn goes_on(&self) -> &'static str {
        match self {
            Self::Measure(_) => "what was captured is kept: the same command with --resume goes on",
            Self::Capture(_) => "what was captured is kept: the same command goes on",
            Self::Calibrate(_) => {
                "no view that was captured is lost: the same command goes on, or begins again"
            }
            _ => "files are whole, or as they were",
        }
    }

    /// Whether it may fire a trigger box, and ends between two steps.
    const fn fires(&self) -> bool {
        matches!(self, Self::Measure(_) | Self::Capture(_) | Self::Calibrate(_))
    }

    /// Whether it takes the instrument from a file that it reads, or needs none.
    const fn takes_no_rig(&self) -> bool {
        matches!(
            self,
            Self::Capture(_)
                | Self::Assemble(_)
                | Self::Value(_)
                | Self::Budget(_)
                | Self::Evaluate(_)
                | Self::Compare(_)
                | Self::Info(_)
                | Self::Export(_)
                | Self::Combine(_)
                | Self::Collection(_)
                | Self::History(_)
                | Self::Fill(_)
                | Self::Turn(_)
                | Self::Fit(_)
                | Self::Reflectance(_)
                | Self::Standard(_)
                | Self::Render(_)
                | Self::Plot(_)
                | Self::Report(_)
                | Self::Study(_)
                | Self::Paper(_)
                | Self::Worlds(_)
                | Self::Completions(_)
                | Self::Man(_)
        )
    }
}

fn main() -> ExitCode {
    if let Some(sentence) = arguments::complaint(std::env::args_os().skip(1)) {
        return usage::refuse(&sentence);
    }
    let parsed = described().try_get_matches();
    let cli = match parsed.and_then(|matches| Cli::from_arg_matches(&matches)) {
        Ok(cli) => cli,
        Err(error) => return usage::answer(&error),
    };
    let goes_on = cli.command.goes_on();
    let wish = Wish::default();
    let (asked, fires) = (wish.clone(), cli.command.fires());
    let stops = ctrlc::set_handler(move || {
        if !fires || !asked.want() {
            stop(goes_on);
        }
    });
    let output = Output::new(cli.json, cli.quiet, cli.verbose, wish);
    if let Err(error) = stops {
        output.remark(&format!("Ctrl-C will end the command without a word: {error}"));
    }
    output.log(&command_line());
    let ended = catch_unwind(AssertUnwindSafe(|| done(&cli, &output))).unwrap_or_else(|unwinding| {
        if unwinding.is::<Interrupted>() {
            stop(goes_on);
        }
        resume_unwind(unwinding)
    });
    match ended {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) if failure.is_broken_pipe() => ExitCode::SUCCESS,
        Err(failure) => {
            output.fail(&failure);
            ExitCode::from(failure.exit_code())
        }
    }
}

/// Ends the command at Ctrl-C, with the exit code of shells for it: files are whole or as they were, however it ends.
fn stop(goes_on: &str) -> ! {
    // Beside a progress bar, and after the ^C that a terminal shows.
    writeln!(std::io::stderr(), "\nrcg: stopped; {goes_on}").ok();
    std::process::exit(130);
}

/// The command with its arguments, as the log has it.
fn command_line() -> String {
    let quoted = |word: String| {
        if word.contains(char::is_whitespace) {
            format!("'{word}'")
        } else {
            word
        }
    };
    let words = std::env::args().skip(1).map(quoted);
    let words: Vec<String> = std::iter::once("rcg".to_owned()).chain(words).collect();
    format!("{} (version {})", words.join(" "), env!("CARGO_PKG_VERSION"))
}

fn done(cli: &Cli, output: &Output) -> Done {
    if let Some(rig) = &cli.rig
        && cli.command.takes_no_rig()
    {
        Rig::load(rig)?;
        output.remark(&format!("--rig {rig} has no part in this command"));
    }
    let usual = std::env::var(RIG_VARIABLE).unwrap_or_else(|_| RIG.to_owned());
    let rig = cli.rig.as_deref().unwrap_or(&usual);
    match &cli.command {
        Command::Measure(args) => measure::run(args, rig, output),
        Command::Plan(args) => plan::run(args, rig, output),
        Command::Patterns(args) => patterns::run(args, rig, output),
        Command::Capture(args) => capture::run(args, output),
        Command::Calibrate(command) => calibrate::run(command, rig, output),
        Command::Assemble(args) => assemble::run(args, output),
        Command::Map(args) => map::run(args, rig, output),
        Command::Value(args) => value::run(args, output),
        Command::Evaluate(args) => evaluate::run(args, output),
        Command::Compare(args) => compare::run(args, output),
        Command::Info(args) => info::run(args, output),
        Command::Export(args) => export::run(args, output),
        Command::Combine(args) => combine::run(args, output),
        Command::Collection(command) => collection::run(command, output),
        Command::History(args) => history::run(args, output),
        Command::Fill(args) => fill::run(args, output),
        Command::Turn(args) => turn::run(args, output),
        Command::Fit(args) => fit::run(args, output),
        Command::Reflectance(args) => reflectance::run(args, output),
        Command::Budget(args) => budget::run(args, output),
        Command::Render(args) => render::run(args, output),
        Command::Plot(args) => plot::run(args, output),
        Command::Report(args) => report::run(args, output),
        Command::Study(args) => study::run(args, output),
        Command::Bench(args) => bench::run(args, rig, output),
        Command::Multiplex(args) => multiplex::run(args, rig, output),
        Command::Standard(args) => standard::run(args, output),
        Command::Truth(args) => truth::run(args, rig, output),
        Command::Worlds(args) => worlds::run(args, output),
        Command::Paper(args) => paper::run(args, output),
        Command::Controller(args) => controller::run(args, rig, output),
        Command::Camera(args) => camera::run(args, rig, output),
        Command::Projector(args) => projector::run(args, rig, output),
        Command::Rig(args) => rig::run(args, rig, output),
        Command::Live(args) => live::run(args, rig, output),
        Command::Completions(args) => shell::completions(args, described(), output),
        Command::Man(args) => shell::man(args, described(), output),
    }
}

/// The command line that is understood.
fn described() -> clap::Command {
    groups::grouped(with_negative_numbers(Cli::command()))
}

/// `command` with options that take a negative number for their value, to say what is wrong with it, and not for an option
/// that does not exist.
fn with_negative_numbers(command: clap::Command) -> clap::Command {
    let names: Vec<String> = command
        .get_subcommands()
        .map(|below| below.get_name().to_owned())
        .collect();
    let command = command.mut_args(|argument| {
        let takes_value = argument.get_long().is_some() && argument.get_action().takes_values();
        argument.allow_negative_numbers(takes_value)
    });
    names.into_iter().fold(command, |command, name| {
        command.mut_subcommand(name, with_negative_numbers)
    })
}

type Done = Result<(), Failure>;
