//! `rcg calibrate`

pub(crate) mod first;
mod geometry;
pub(crate) mod hands;
mod photometry;

use clap::Subcommand;
use rcg::calibrate::by_hand::{Bench, Place, RealBench, VirtualBench};
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

/// Where views are captured by hand.
enum Site {
    /// In the virtual rig.
    Virtual(Box<World>),
    /// On the table of this rig.
    Real(Box<Rig>),
}

/// The virtual rig in which what is asked for stands by itself; a file that cannot be read is refused before anything is made.
fn world(rig: &Rig, conditions: &ConditionArgs, port: &PortArgs) -> Result<World, Failure> {
    if rig.is_real() {
        return Err(Failure::input(format!(
            "rig {}: expected --by-hand with a real camera and projector, found none: somebody has to put the targets into the holder",
            rig.name
        )));
    }
    Ok(World::read(&conditions.virtual_rig(None), port.bridged()?)?)
}

impl Site {
    /// That of `rig`.
    fn of(rig: &Rig, conditions: &ConditionArgs, port: &PortArgs) -> Result<Self, Failure> {
        if rig.is_real() {
            conditions.check(rig)?;
            return Ok(Self::Real(Box::new(rig.clone())));
        }
        Ok(Self::Virtual(Box::new(world(rig, conditions, port)?)))
    }

    fn place(&self) -> Place<'_> {
        match self {
            Self::Virtual(world) => Place::Virtual(world),
            Self::Real(rig) => Place::Real(rig),
        }
    }

    fn bench(&self) -> Box<dyn Bench + '_> {
        match self {
            Self::Virtual(world) => Box::new(VirtualBench::new(world)),
            Self::Real(rig) => Box::new(RealBench { rig }),
        }
    }
}

pub(crate) fn run(command: &Command, rig: &str, output: &Output) -> Done {
    match command {
        Command::Geometry(args) => geometry::run(args, rig, output),
        Command::Photometry(args) => photometry::run(args, rig, output),
    }
}
