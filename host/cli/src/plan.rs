//! `rcg plan`

use std::path::PathBuf;

use rcg::base::text::duration;
use rcg::instrument::rig::Rig;
use rcg::measure::adaptive::{self, Goal};
use rcg::measure::{Forecast, Job, prepare};
use rcg::plan::Plan;
use rcg::plan::brackets::milliseconds;
use rcg::plan::light::{Coding, Light};
use rcg::plan::schedule::Bound;
use rcg::virtual_rig::setup::Setup;
use serde_json::json;

use crate::Done;
use crate::adaptive::AdaptiveArgs;
use crate::failure::Failure;
use crate::output::{Output, table};
use crate::request::{CalibrationArgs, PortArgs, RequestArgs, VirtualArgs};
use crate::session::SessionArgs;

/// Show what a measurement would take, or write its plan.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Write rig.toml and plan.toml into this new directory, for `rcg capture`
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    #[command(flatten)]
    request: RequestArgs,
    #[command(flatten)]
    adaptive: AdaptiveArgs,
    #[command(flatten)]
    calibration: CalibrationArgs,
    #[command(flatten)]
    virtual_rig: VirtualArgs,
    #[command(flatten)]
    port: PortArgs,
    #[command(flatten)]
    session: SessionArgs,
}

pub(crate) fn run(args: &Args, rig: &str, output: &Output) -> Done {
    if let (Some(option), None) = (args.session.given(), &args.out) {
        return Err(Failure::input(format!(
            "{option}: expected --out beside it, found none"
        )));
    }
    let rig = args.port.real(Rig::load(rig)?)?;
    args.virtual_rig.check(&rig)?;
    let trigger_box = args.port.trigger_box(&rig)?;
    let (rig, calibration) = args.calibration.rig(rig)?;
    let used = args.calibration.dir().zip(calibration.as_ref());
    let setup = Setup {
        session: Some(args.session.opening("plan", used)?),
        virtual_rig: args.virtual_rig.virtual_rig(None),
        trigger_box,
        calibration,
    };
    let mut request = args.request.request(None)?;
    let goal = if args.adaptive.check(&args.request)? {
        if args.out.is_some() {
            return Err(Failure::input(
                "--adaptive: expected no --out, as there are no directions to write before the measurement has chosen them, found one",
            ));
        }
        let (_, goal) = args.adaptive.asked(&args.request, None)?;
        request = adaptive::at_most(&rig, &request, goal)?;
        Some(goal)
    } else {
        None
    };
    let mut plan = if let Some(out) = &args.out {
        let (job, measurement) = prepare(out, &rig, request, &setup, output)?;
        output.log_into(measurement.dir());
        job.plan
    } else {
        Job::planned(&rig, request, &setup, output)?.plan
    };
    if goal.is_some() {
        plan = adaptive::in_batches(plan);
    }
    let rig = plan.request.rig(&rig)?;
    let forecast = Forecast::of(&plan, &rig)?;
    let mut value = json!(forecast);
    value["adaptive"] = json!(goal);
    value["out"] = json!(args.out);
    output.print(&value, || {
        let mut lines = lines(&plan, &forecast);
        if let Some(goal) = goal {
            lines[0].1 = adaptive_directions(&plan, goal);
            lines.retain(|(name, _)| *name != "whole grid");
        }
        let on_disk = format!(
            "{} of frames, at most {} of BRDF",
            bytes(forecast.disk_space.raw_bytes),
            bytes(forecast.disk_space.brdf_bytes)
        );
        lines.push(("disk space", on_disk));
        table(&lines)
    })
}

/// The directions of an adaptive measurement, in words.
fn adaptive_directions(plan: &Plan, goal: Goal) -> String {
    let most = plan.direction_count;
    let end = goal.target_db.map_or_else(String::new, |db| {
        format!(", fewer where {db} dB are reached before; all figures are of as many")
    });
    format!("at most {most}, chosen on the way{end}")
}

fn bytes(count: usize) -> String {
    match count as f64 {
        count if count < 1e6 => format!("{:.1} kB", count * 1e-3),
        count if count < 1e9 => format!("{:.1} MB", count * 1e-6),
        count => format!("{:.1} GB", count * 1e-9),
    }
}

fn lines(plan: &Plan, forecast: &Forecast) -> Vec<(&'static str, String)> {
    let pace = &forecast.time;
    let mut lines = vec![
        (
            "incident directions",
            format!(
                "{} ({}), {} in reach",
                forecast.grid_directions, plan.request.grid, plan.direction_count
            ),
        ),
        (
            "exposures",
            format!(
                "{}{} of {} ms every {}, {:.0} per second",
                plan.len(),
                if plan.bands > 1 {
                    format!(" in each of {} bands,", plan.bands)
                } else {
                    String::new()
                },
                milliseconds(&forecast.exposures_s),
                duration(pace.period_s),
                pace.rate_hz
            ),
        ),
        ("light", light(plan)),
        (
            "dynamic range",
            rcg::measure::report::dynamic_range(forecast.dynamic_range),
        ),
        (
            "time",
            format!(
                "{} on {}: {} with light, {} with black patterns",
                duration(pace.instrument_s),
                forecast.rig,
                duration(pace.lit_s),
                duration(pace.black_s)
            ),
        ),
        (
            "display",
            pace.display_frames.map_or_else(String::new, |frames| {
                format!("{frames:.1} display frames for each exposure, a dark one among them (projector.window.refresh_hz, 60 Hz where \
                     it is not said)")
            }),
        ),
        (
            "not counted",
            format!("{} times that patterns are loaded into the projector", pace.loads),
        ),
        (
            "whole grid",
            format!(
                "{}, those directions included that are out of reach",
                duration(pace.grid_s)
            ),
        ),
    ];
    lines.retain(|(_, line)| !line.is_empty());
    let what = match forecast.bound_by {
        Bound::Camera => "settling, exposing and reading out",
        Bound::Projector => "the projector's pattern rate",
    };
    lines.push(("bound by", what.to_owned()));
    for cost in &pace.costs {
        lines.push((
            "what would help",
            format!("{}: {}", cost.limit.remedy(), duration(cost.instrument_without_s)),
        ));
    }
    lines
}

/// How light is made, in words.
fn light(plan: &Plan) -> String {
    plan.code_patterns().map_or_else(
        || "single: one direction per pattern".to_owned(),
        |codes| {
            let inverted = if codes.are_inverted_too() {
                ", half of them inverted"
            } else {
                ""
            };
            format!(
                "{}: {} code patterns{inverted} for {} blocks of directions",
                plan.code.map_or(Light::Single, Coding::light),
                codes.len(),
                codes.blocks().count()
            )
        },
    )
}
