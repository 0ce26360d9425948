//! `rcg plot`

use std::path::PathBuf;

use rcg::base::file_format::CHART_OR_TABLE;
use rcg::brdf::Source;
use rcg::hemisphere::direction::{from_degrees, is_above_horizon};
use rcg::judge::scan::{Along, INCIDENT_DEG, Scan, THETA_R_DEG, chart, csv};
use serde_json::json;

use crate::Done;
use crate::failure::Failure;
use crate::output::{Output, to_write};
use crate::render::angles;
use crate::value::QuantityArg;

/// Plot reflectance against the azimuth of the outgoing direction, or in the plane of incidence.
///
/// One curve per BRDF and incident direction, at one outgoing polar angle or in the plane of incidence. Directions that were not measured
/// are gaps. The chart shows the luma (BT.601), of a measurement with its interval of k = 2; the table (.csv) has all channels, of a
/// measurement with their standard uncertainties (k = 1) and provenance, and why there is no value where there is none.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// A brdf.zarr, a measured file, or a model such as ward:brass; several stand in one chart
    #[arg(value_name = "BRDF", required = true)]
    brdf: Vec<String>,
    /// What to write: a chart (.svg, .png) or a table (.csv)
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Polar angle and azimuth of an incident direction in degrees; may be repeated [default: 30,0 30,45 30,90]
    #[arg(long, value_name = "THETA,PHI", value_parser = angles)]
    incident: Vec<(f64, f64)>,
    /// Polar angle of the outgoing directions in degrees
    #[arg(long, value_name = "DEG", default_value_t = THETA_R_DEG)]
    theta_r: f64,
    /// Outgoing polar angles from -89 to 89 degrees in the plane of incidence instead, positive on the side of the mirror direction
    #[arg(long, conflicts_with_all = ["theta_r", "azimuths"])]
    in_plane: bool,
    /// A logarithmic axis; what is not above 0 is a gap
    #[arg(long)]
    log: bool,
    #[command(flatten)]
    quantity: QuantityArg,
    /// Azimuths around the circle
    #[arg(long, value_name = "N", default_value_t = 360, value_parser = clap::value_parser!(u32).range(4..=36000))]
    azimuths: u32,
}

pub(crate) fn run(args: &Args, output: &Output) -> Done {
    let incident = if args.incident.is_empty() {
        &INCIDENT_DEG[..]
    } else {
        &args.incident
    };
    for (name, theta) in incident
        .iter()
        .map(|at| ("--incident", at.0))
        .chain([("--theta-r", args.theta_r)])
    {
        if !((0.0..90.0).contains(&theta) && is_above_horizon(from_degrees(theta, 0.0))) {
            return Err(Failure::input(format!(
                "{name}: expected a polar angle from 0 to below 90 degrees, found {theta}"
            )));
        }
    }
    to_write(&args.out, CHART_OR_TABLE)?;
    let along = if args.in_plane {
        Along::Plane
    } else {
        Along::Circle {
            theta_r_deg: args.theta_r,
            steps: args.azimuths as usize,
        }
    };
    let mut scans = Vec::with_capacity(args.brdf.len());
    for brdf in &args.brdf {
        let scan = Scan::new(&Source::open(brdf)?, args.quantity.is, incident, along)?;
        scans.push((brdf.as_str(), scan));
    }
    let title = args.brdf.join(", ");
    chart(&scans, &title, args.log).save_or_table(|| csv(&scans), &args.out)?;
    let missing: usize = scans.iter().map(|(_, scan)| scan.missing()).sum();
    let value = json!({
        "out": args.out, "incident_deg": incident, "theta_r_deg": (!args.in_plane).then_some(args.theta_r),
        "in_plane": args.in_plane, "quantity": args.quantity.is, "azimuths": (!args.in_plane).then_some(args.azimuths),
        "without_value": missing,
    });
    output.print(&value, || {
        format!("{} ({missing} directions without a value)\n", args.out.display())
    })?;
    for (brdf, scan) in &scans {
        if scan.missing() == scan.len() {
            output.warn(&[format!(
                "{brdf}: the scan shows nothing: none of its directions has a value"
            )]);
        }
    }
    Ok(())
}
