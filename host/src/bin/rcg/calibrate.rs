//! `rcg calibrate`

mod geometry;
mod photometry;

use clap::Subcommand;

use crate::Done;
use crate::output::Output;

/// What is calibrated.
#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    Geometry(geometry::Args),
    Photometry(photometry::Args),
}

pub(crate) fn run(command: &Command, rig: &str, output: &Output) -> Done {
    match command {
        Command::Geometry(args) => geometry::run(args, rig, output),
        Command::Photometry(args) => photometry::run(args, rig, output),
    }
}
