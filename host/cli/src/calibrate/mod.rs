//! `rcg calibrate`

mod geometry;
mod photometry;

use std::path::Path;

use clap::Subcommand;
use rcg::calibrate::Conditions;
use rcg::virtual_rig::Truth;

use crate::Done;
use crate::failure::Failure;
use crate::output::Output;

/// What is calibrated.
#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    Geometry(geometry::Args),
    Photometry(photometry::Args),
}

/// How the views are captured.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct ConditionArgs {
    /// How the virtual rig really is: a file that `rcg truth` writes [default: as the rig file says]
    #[arg(long, value_name = "FILE")]
    truth: Option<String>,
    /// Switch shot and read noise of the virtual rig on or off
    #[arg(long, value_name = "on|off", value_parser = ["on", "off"], default_value = "on")]
    noise: String,
    /// Seed of all chance of the virtual rig
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
}

impl ConditionArgs {
    /// The conditions for images of `image_size` pixels a side; a truth that cannot be read is refused before anything is
    /// made.
    fn conditions(&self, image_size: u32) -> Result<Conditions, Failure> {
        if let Some(truth) = &self.truth {
            Truth::load(Path::new(truth))?;
        }
        Ok(Conditions {
            image_size,
            truth: self.truth.clone(),
            noise: self.noise == "on",
            seed: self.seed,
        })
    }
}

pub(crate) fn run(command: &Command, rig: &str, output: &Output) -> Done {
    match command {
        Command::Geometry(args) => geometry::run(args, rig, output),
        Command::Photometry(args) => photometry::run(args, rig, output),
    }
}
