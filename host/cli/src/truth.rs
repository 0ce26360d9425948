//! `rcg truth`

use std::path::PathBuf;

use rcg::base::file_format::TRUTH;
use rcg::instrument::rig::Rig;
use rcg::store::whole_file::write_whole;
use rcg::virtual_rig::{Tolerances, Truth};
use serde_json::json;

use crate::Done;
use crate::failure::Failure;
use crate::output::{Output, to_write};

/// Draw by chance how a virtual rig really is, where it differs from its rig file.
///
/// Camera, projector, sample and mirror are displaced and turned, lenses distorted; light and throughput are not uniform;
/// black is not quite black, the camera not quite linear. Measurements and calibrations with `--truth FILE` are taken on
/// that rig and are not told.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// The file to write (TOML)
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Standard deviation of each coordinate of a position, millimetres
    #[arg(long, value_name = "MM", default_value_t = 0.5)]
    position_mm: f64,
    /// Standard deviation of each angle, degrees
    #[arg(long, value_name = "DEG", default_value_t = 0.3)]
    angle_deg: f64,
    /// Light and throughput each vary by plus and minus this many percent
    #[arg(long, value_name = "PERCENT", default_value_t = 30.0)]
    field_percent: f64,
    /// Seed of the draw
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
}

pub(crate) fn run(args: &Args, rig: &str, output: &Output) -> Done {
    let in_range = |name: &str, found: f64, high: f64| {
        if (0.0..=high).contains(&found) {
            return Ok(());
        }
        Err(Failure::input(format!(
            "--{name}: expected a number from 0 to {high}, found {found}"
        )))
    };
    in_range("position-mm", args.position_mm, 10.0)?;
    in_range("angle-deg", args.angle_deg, 10.0)?;
    in_range("field-percent", args.field_percent, 90.0)?;
    let tolerances = Tolerances {
        position_m: args.position_mm * 1e-3,
        angle_deg: args.angle_deg,
        field: args.field_percent / 100.0,
    };
    to_write(&args.out, TRUTH)?;
    let truth = Truth::drawn(&Rig::load(rig)?, tolerances, args.seed)?;
    write_whole(&args.out, truth.to_toml().as_bytes())?;
    output.print(&json!({ "out": args.out, "truth": truth }), || {
        format!("{}\n", args.out.display())
    })
}
