//! `rcg live`
//!
//! # Design
//! | file | does |
//! |---|---|
//! | `once` | one picture, or one round of advice, in the terminal |
//! | `wish` | what can be asked for |
//! | `state` | what every page shows |
//! | `worker` | the thread that has the instrument: pictures, and what is wished |
//! | `watch` | how far a measurement in a directory is |
//! | `server`, `guard` | the page, on the loopback address (feature `live`) |
//!
//! The state lives in the worker: pages come and go, and all show the same.

#[cfg(feature = "live")]
mod guard;
mod once;
#[cfg(feature = "live")]
mod server;
#[cfg(feature = "live")]
mod state;
#[cfg(feature = "live")]
mod watch;
#[cfg(feature = "live")]
mod wish;
#[cfg(feature = "live")]
mod worker;

use std::path::PathBuf;

use rcg::calibrate::live::{Settings, Shown, Table};
use rcg::instrument::rig::Rig;
use rcg::virtual_rig::setup::World;

use crate::Done;
use crate::failure::Failure;
use crate::output::Output;
use crate::request::{CalibrationArgs, ConditionArgs, PortArgs, exposure_ms, image_size};

/// Pixels a side of the camera's image.
const IMAGE_SIZE: u32 = 256;

/// Align the instrument in a browser: what the camera sees beside what it should see, and by how much to move what.
///
/// Serves a page on the loopback address and prints where; the page is open to those alone who have that address with its token. It chooses
/// what the projector shows, exposure and gain, shows the camera's image with its histogram and the outlines that are expected in it, fires
/// single triggers and shows STROBE, and advises moves of camera, projector and sample from a flat mirror at four tilts and a white standard.
/// Without hardware it does so on the virtual rig, whose parts the page moves.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// What the projector shows first: black, white, cross, stripes, or 'spot THETA PHI' (degrees)
    #[arg(long, value_name = "PICTURE", default_value = "white", value_parser = shown)]
    show: Shown,
    /// Exposure time in milliseconds at first [default: what fills the camera's range]
    #[arg(long, value_name = "MS", allow_negative_numbers = true, value_parser = exposure_ms)]
    exposure_ms: Option<f64>,
    /// Gain: decibels of the virtual camera (0 to 24), the camera's own unit of a real one [default: as it is set]
    #[arg(long, value_name = "GAIN", allow_negative_numbers = true)]
    gain: Option<f64>,
    /// What stands in the holder at first: 'mirror TILT AZIMUTH' (degrees), nothing, or a sample such as lambert:0.9; the virtual rig holds
    /// it, of a real one it is believed
    #[arg(long, value_name = "WHAT", default_value = "lambert:0.9")]
    holder: String,
    /// Pixels a side of the camera's image
    #[arg(long, value_name = "N", value_parser = image_size, default_value_t = IMAGE_SIZE)]
    image_size: u32,
    /// No page: take one picture, print its figures and what is seen in it
    #[arg(long)]
    once: bool,
    /// No page: take the views of a flat mirror and a white standard, and print by how much to move what; targets are asked for on stderr
    /// where the instrument is real
    #[arg(long, conflicts_with = "once")]
    advise: bool,
    /// Port of the page on the loopback address [default: one that is free]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1024..))]
    page_port: Option<u16>,
    /// Open no browser
    #[arg(long)]
    no_open: bool,
    /// Show how far the measurement in this directory is, its newest frame, and its report when it is done
    #[arg(long, value_name = "DIR", conflicts_with_all = ["once", "advise"])]
    measurement: Option<PathBuf>,
    /// Where the page's calibration of the geometry goes, with the truth of the virtual rig [default: nowhere, the page calibrates nothing]
    #[arg(long, value_name = "DIR", conflicts_with_all = ["once", "advise"])]
    out: Option<PathBuf>,
    #[command(flatten)]
    calibration: CalibrationArgs,
    #[command(flatten)]
    conditions: ConditionArgs,
    #[command(flatten)]
    port: PortArgs,
}

fn shown(text: &str) -> Result<Shown, String> {
    text.parse()
}

impl Args {
    /// The instrument as it is asked for, of the rig file or preset `rig`.
    fn table(&self, rig: &str) -> Result<Table, Failure> {
        let nominal = self.port.real(Rig::load(rig)?)?;
        let world = if nominal.is_real() {
            self.conditions.check(&nominal)?;
            None
        } else {
            Some(World::read(
                &self.conditions.virtual_rig(None),
                self.port.bridged()?,
            )?)
        };
        let (known, _) = self.calibration.rig(nominal.clone())?;
        let settings = Settings {
            shown: self.show,
            exposure_s: self.exposure_ms.map_or(nominal.camera.exposure_s, |ms| ms * 1e-3),
            gain: self.gain,
            held: self.holder.clone(),
        };
        Ok(Table::new((&nominal, &known), self.image_size, world, settings)?)
    }
}

pub(crate) fn run(args: &Args, rig: &str, output: &Output) -> Done {
    if let Some(dir) = args.measurement.as_deref().filter(|dir| !dir.is_dir()) {
        return Err(Failure::input(format!(
            "{}: expected the directory of a measurement, found none",
            dir.display()
        )));
    }
    let table = args.table(rig)?;
    if args.once {
        return once::picture(table, args.exposure_ms.is_none(), output);
    }
    if args.advise {
        return once::advice(table, output);
    }
    #[cfg(feature = "live")]
    return server::run(args, table, output);
    #[cfg(not(feature = "live"))]
    Err(Failure::input(
        "live: expected a program that was built with its page, found one without; build with `--features live`, or ask for --once or \
         --advise",
    ))
}
