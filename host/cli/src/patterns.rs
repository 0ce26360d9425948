//! `rcg patterns`

use std::fmt::Write as _;
use std::path::PathBuf;

use rcg::base::progress::Progress as _;
use rcg::capture::directory::Measurement;
use rcg::instrument::optics::View;
use rcg::instrument::rig::{Rig, Tilt};
use rcg::judge::render::save;
use rcg::plan::pattern::{BitPattern, PatternMaker};
use rcg::plan::{Directions, PlanError, Request};
use rcg::store::Lock;
use rcg::store::whole_file::write_whole;
use serde_json::json;

use crate::Done;
use crate::output::Output;
use crate::request::{CalibrationArgs, GridArgs, spot_deg};

/// Write the patterns that a measurement shows.
///
/// One black and white PNG per incident direction that the projector reaches, in the projector's native resolution,
/// and patterns.csv with what each one lights. What a calibrated measurement lights beside the mirror in every pattern, to watch
/// the lamp, is left out.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// New or empty directory for the pictures
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    #[command(flatten)]
    grid: GridArgs,
    /// Opening of the cone that each pattern lights, degrees [default: that of the rig, but no wider than the step]
    #[arg(long, value_name = "DEG", allow_negative_numbers = true, value_parser = spot_deg)]
    spot: Option<f64>,
    /// Tilt of the sample by its holder, as in `rcg measure --tilt` [default: none]
    #[arg(long, value_name = "TILT:TOWARDS[:TURN]", allow_hyphen_values = true)]
    tilt: Option<Tilt>,
    #[command(flatten)]
    calibration: CalibrationArgs,
}

pub(crate) fn run(args: &Args, rig: &str, output: &Output) -> Done {
    let (rig, _) = args.calibration.rig(Rig::load(rig)?)?;
    let rig = rig.tilted(args.tilt)?;
    let grid = args.grid.grid(None, 15.0)?;
    let directions = Directions::new(&rig, &grid).map_err(PlanError::from)?;
    Measurement::check_new(&args.out)?;
    let _lock = Lock::folder(&args.out)?;
    Measurement::check_new(&args.out)?;
    let request = Request {
        grid: grid.clone(),
        spot_deg: args.spot,
        ..Request::default()
    };
    let spot_deg = request.spot_deg(&rig);
    let maker = PatternMaker::new(View::projector(&rig), spot_deg, rig.projector.irradiance);
    let (width, height) = maker.size_px();
    let mut image = BitPattern::black(width, height);
    let measurable: Vec<usize> = directions.measurable().collect();
    let mut table =
        "index,theta_deg,phi_deg,pixels,solid_angle_sr,irradiance,centroid_theta_deg,centroid_phi_deg\n"
            .to_owned();
    output.begin("patterns", measurable.len(), "patterns");
    let mut written = 0;
    for (done, &index) in measurable.iter().enumerate() {
        let Ok(lit) = maker.lit_set(directions.grid.direction(index)) else {
            continue;
        };
        let (theta_deg, phi_deg) = directions.grid.angles_deg(index);
        let (lit_theta_deg, lit_phi_deg) = rcg::hemisphere::direction::to_degrees(lit.centroid);
        writeln!(
            table,
            "{index},{theta_deg},{phi_deg},{},{:.8e},{:.8e},{:.5},{:.5}",
            lit.pixels.len(),
            lit.solid_angle_sr,
            lit.irradiance,
            lit_theta_deg,
            // What is written as 360.00000 is 0.
            (lit_phi_deg * 1e5).round() / 1e5 % 360.0
        )
        .expect("strings take everything");
        image.clear();
        image.light(&lit.pixels);
        save(
            &image.to_image(),
            &args.out.join(format!("pattern-{index:05}.png")),
        )?;
        written += 1;
        output.reach(done + 1);
    }
    // The table comes last: a directory that has it is whole.
    write_whole(&args.out.join("patterns.csv"), table.as_bytes())?;
    output.end();
    let value = json!({
        "out": args.out, "patterns": written, "width_px": width, "height_px": height, "spot_deg": spot_deg,
    });
    output.print(&value, || {
        format!(
            "{written} patterns of {width}×{height} pixels: {}\n",
            args.out.display()
        )
    })
}
