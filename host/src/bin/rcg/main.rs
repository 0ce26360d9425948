//! `rcg`: the command of the Rapid Catadioptric Gonioreflectometer.
//!
//! # Design
//! One file per subcommand: it parses, calls the library and prints. Data go to stdout, progress and logs to
//! stderr. Exit 0: done; 1: failed; 2: bad usage or input.

mod assemble;
mod calibrate;
mod capture;
mod controller;
mod evaluate;
mod failure;
mod fit;
mod map;
mod measure;
mod multiplex;
mod numbers;
mod output;
mod paper;
mod patterns;
mod plan;
mod plot;
mod render;
mod request;
mod study;
mod truth;
mod usage;
mod value;

use std::process::ExitCode;

use clap::{Parser, Subcommand};
use failure::Failure;
use output::Output;

/// Measures the four-angle BRDF of flat samples with an ellipsoidal mirror, a camera and a projector.
///
/// Without hardware everything runs on a virtual rig whose camera and projector are driven, edge by edge, by
/// the firmware's own logic. Angles are in degrees, f in 1/sr without the cosine.
#[derive(Debug, Parser)]
#[command(name = "rcg", version, max_term_width = 100, arg_required_else_help = true)]
struct Cli {
    /// The instrument: rcg-1, rcg-2, dmd, or a rig file (TOML)
    #[arg(long, global = true, default_value = "rcg-1", value_name = "FILE|PRESET")]
    rig: String,
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
    Fit(fit::Args),
    Render(render::Args),
    Plot(plot::Args),
    Study(study::Args),
    Paper(paper::Args),
    Multiplex(multiplex::Args),
    Truth(truth::Args),
    /// Talk to the trigger box
    Controller(controller::Args),
}

fn main() -> ExitCode {
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
        Err(error) => return usage::answer(&error),
    };
    let output = Output::new(cli.json, cli.quiet, cli.verbose);
    let done = match &cli.command {
        Command::Measure(args) => measure::run(args, &cli.rig, &output),
        Command::Plan(args) => plan::run(args, &cli.rig, &output),
        Command::Patterns(args) => patterns::run(args, &cli.rig, &output),
        Command::Capture(args) => capture::run(args, &output),
        Command::Calibrate(command) => calibrate::run(command, &cli.rig, &output),
        Command::Assemble(args) => assemble::run(args, &output),
        Command::Map(args) => map::run(args, &cli.rig, &output),
        Command::Value(args) => value::run(args, &output),
        Command::Evaluate(args) => evaluate::run(args, &output),
        Command::Fit(args) => fit::run(args, &output),
        Command::Render(args) => render::run(args, &output),
        Command::Plot(args) => plot::run(args, &output),
        Command::Study(args) => study::run(args, &output),
        Command::Multiplex(args) => multiplex::run(args, &cli.rig, &output),
        Command::Truth(args) => truth::run(args, &cli.rig, &output),
        Command::Paper(args) => paper::run(args, &output),
        Command::Controller(args) => controller::run(args, &cli.rig, &output),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) if failure.is_broken_pipe() => ExitCode::SUCCESS,
        Err(failure) => {
            output.fail(&failure);
            ExitCode::from(failure.exit_code())
        }
    }
}

type Done = Result<(), Failure>;
