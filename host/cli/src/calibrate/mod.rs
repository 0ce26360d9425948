//! `rcg calibrate`

mod geometry;
mod hands;
mod photometry;

use clap::Subcommand;
use rcg::instrument::rig::Rig;
use rcg::virtual_rig::setup::World;

use crate::Done;
use crate::failure::Failure;
use crate::output::Output;
use crate::request::{ConditionArgs, PortArgs};

/// What is calibrated.
#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    Geometry(geometry::Args),
    Photometry(photometry::Args),
}

/// The virtual rig in which the views are captured; a file that cannot be read is refused before anything is made.
fn world(conditions: &ConditionArgs, port: &PortArgs) -> Result<World, Failure> {
    Ok(World::read(&conditions.virtual_rig(None), port.bridged()?)?)
}

/// `rig`, if it is a virtual one.
fn virtual_one(rig: Rig) -> Result<Rig, Failure> {
    if rig.is_real() {
        return Err(Failure::input(format!(
            "rig {}: expected a virtual rig, found one with a real camera and projector, which can measure but cannot be \
             calibrated by this program yet",
            rig.name
        )));
    }
    Ok(rig)
}

pub(crate) fn run(command: &Command, rig: &str, output: &Output) -> Done {
    match command {
        Command::Geometry(args) => geometry::run(args, rig, output),
        Command::Photometry(args) => photometry::run(args, rig, output),
    }
}
