//! `rcg calibrate`

mod geometry;

use clap::Subcommand;

use crate::Done;
use crate::output::Output;

/// What is calibrated.
#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    Geometry(geometry::Args),
}

pub(crate) fn run(command: &Command, rig: &str, output: &Output) -> Done {
    match command {
        Command::Geometry(args) => geometry::run(args, rig, output),
    }
}
