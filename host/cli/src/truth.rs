//! `rcg truth`

use std::path::PathBuf;

use rcg::base::file_format::TRUTH;
use rcg::instrument::rig::Rig;
use rcg::store::whole_file::write_whole;
use rcg::virtual_rig::{Flaws, Tolerances, Truth};
use serde_json::json;

use crate::Done;
use crate::failure::Failure;
use crate::output::{Output, to_write};

/// Draw by chance how a virtual rig really is, where it differs from its rig file.
///
/// Camera, projector, sample and mirror are displaced and turned, lenses distorted; light and throughput are not uniform;
/// black is not black, the camera not quite linear. Measurements and calibrations with `--truth FILE` are taken on
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
    /// Light of a lit projector pixel over that of a black one [default: drawn between 400 and 3000]
    #[arg(long, value_name = "RATIO", allow_negative_numbers = true)]
    contrast: Option<f64>,
    /// Flaws that are left out, to see what each of them does
    #[arg(long, value_name = "FLAW,...", value_delimiter = ',')]
    without: Vec<Flaw>,
    /// Seed of the draw
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
}

/// What can be left out of a truth.
#[derive(Clone, Copy, Debug, clap::ValueEnum)]
enum Flaw {
    /// Poses, lenses, mirror and sample are as the rig file says
    Pose,
    /// The light is uniform over the projector's image
    Intensity,
    /// The throughput is uniform over the camera's image
    Throughput,
    /// Black projector pixels are black
    BlackLight,
    /// The projector's levels are linear
    Gamma,
    /// The camera is linear
    Nonlinearity,
    /// No light returns onto the sample
    Interreflection,
}

impl Flaw {
    fn leave_out(self, truth: &mut Truth, rig: &Rig) {
        let none = Flaws::default();
        let flaws = &mut truth.flaws;
        match self {
            Self::Pose => {
                // Light and camera are no poses.
                let true_rig = &truth.rig;
                let mut posed = rig.clone();
                posed.light.clone_from(&true_rig.light);
                posed.camera.read_noise_e = true_rig.camera.read_noise_e;
                posed.camera.full_well_e = true_rig.camera.full_well_e;
                truth.rig = posed;
            }
            Self::Intensity => flaws.intensity = none.intensity,
            Self::Throughput => flaws.throughput = none.throughput,
            Self::BlackLight => (flaws.black_level, flaws.black) = (none.black_level, none.black),
            Self::Gamma => flaws.gamma = none.gamma,
            Self::Nonlinearity => flaws.nonlinearity = none.nonlinearity,
            Self::Interreflection => flaws.interreflection = none.interreflection,
        }
    }
}

pub(crate) fn run(args: &Args, rig: &str, output: &Output) -> Done {
    let in_range = |name: &str, found: f64, low: f64, high: f64| {
        if (low..=high).contains(&found) {
            return Ok(());
        }
        Err(Failure::input(format!(
            "--{name}: expected a number from {low} to {high}, found {found}"
        )))
    };
    in_range("position-mm", args.position_mm, 0.0, 10.0)?;
    in_range("angle-deg", args.angle_deg, 0.0, 10.0)?;
    in_range("field-percent", args.field_percent, 0.0, 90.0)?;
    if let Some(contrast) = args.contrast {
        in_range("contrast", contrast, 10.0, 1e9)?;
    }
    let tolerances = Tolerances {
        position_m: args.position_mm * 1e-3,
        angle_deg: args.angle_deg,
        field: args.field_percent / 100.0,
        contrast: args.contrast,
    };
    to_write(&args.out, TRUTH)?;
    let rig = Rig::load(rig)?;
    let mut truth = Truth::drawn(&rig, tolerances, args.seed)?;
    for flaw in &args.without {
        flaw.leave_out(&mut truth, &rig);
    }
    write_whole(&args.out, truth.to_toml().as_bytes())?;
    output.print(&json!({ "out": args.out, "truth": truth }), || {
        format!("{}\n", args.out.display())
    })
}
