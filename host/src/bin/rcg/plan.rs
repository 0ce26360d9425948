//! `rcg plan`

use std::path::PathBuf;

use rcg::measure::prepare;
use rcg::measurement::MeasurementError;
use rcg::plan::{Plan, PlanError};
use rcg::report::duration;
use rcg::rig::Rig;
use serde_json::json;

use crate::Done;
use crate::output::Output;
use crate::request::{MischiefArgs, RequestArgs};

/// Show what a measurement would take, or write its plan.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Write rig.toml and plan.toml into this new directory, for `rcg capture`
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    #[command(flatten)]
    request: RequestArgs,
    #[command(flatten)]
    mischief: MischiefArgs,
}

pub(crate) fn run(args: &Args, rig: &str, output: &Output) -> Done {
    let rig = Rig::load(rig)?;
    let request = args.request.request(None)?;
    let plan = if let Some(out) = &args.out {
        prepare(out, &rig, request, &args.mischief.setup(), output)?.plan
    } else {
        let exposure_s = request.exposure_s.unwrap_or(rig.camera.exposure_s);
        request.sample.as_deref().map(rcg::sample::parse).transpose()?;
        // Refuses sizes out of range before the rig is scaled to them.
        Plan::new(request.clone(), &rig, exposure_s)?;
        let scaled = rig
            .with_image_size(request.image_size)
            .map_err(MeasurementError::from)?;
        Plan::new(request, &scaled, exposure_s)?
    };
    let bound = plan.timing.bound(&rig);
    let grid = plan.request.grid.build().map_err(PlanError::from)?;
    let grid_s = grid.len() as f64 * plan.timing.period_s;
    let value = json!({
        "rig": rig.name,
        "exposures": plan.len(),
        "directions": plan.directions,
        "grid_directions": grid.len(),
        "grid_s": grid_s,
        "exposure_s": plan.exposure_s,
        "period_s": plan.timing.period_s,
        "instrument_s": plan.duration_s(),
        "bound_by": bound,
        "segment_exposures": plan.segment,
        "out": args.out,
    });
    output.print(&value, || {
        let what = match bound {
            rcg::schedule::Bound::Camera => "settling, exposing and reading out",
            rcg::schedule::Bound::Projector => "the projector's pattern rate",
        };
        format!(
            "{} exposures, {} of them lit, of {:.3} ms every {:.3} ms: {} on {}, bound by {what}\n\
             (all {} directions of the grid, those included that are out of reach: {})\n",
            plan.len(),
            plan.directions,
            plan.exposure_s * 1e3,
            plan.timing.period_s * 1e3,
            duration(plan.duration_s()),
            rig.name,
            grid.len(),
            duration(grid_s),
        )
    })
}
