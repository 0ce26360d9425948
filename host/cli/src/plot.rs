//! `rcg plot`

use std::path::PathBuf;

use rcg::base::file_format::CHART_OR_TABLE;
use rcg::brdf::Source;
use rcg::hemisphere::direction::{from_degrees, is_above_horizon};
use rcg::judge::scan::{AzimuthScan, INCIDENT_DEG, THETA_R_DEG};
use serde_json::json;

use crate::Done;
use crate::failure::Failure;
use crate::output::{Output, to_write};
use crate::render::angles;
use crate::value::QuantityArg;

/// Plot reflectance against the azimuth of the outgoing direction.
///
/// One curve per incident direction, at one outgoing polar angle. Directions that were not measured are gaps. The chart
/// shows the luma (BT.601); the table (.csv) has all channels, of a measurement with their standard uncertainties (k = 1) and
/// provenance, and why there is no value where there is none.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// A brdf.zarr, a measured .bsdf file, or a model such as ward:brass
    #[arg(value_name = "BRDF")]
    brdf: String,
    /// What to write: a chart (.svg, .png) or a table (.csv)
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Polar angle and azimuth of an incident direction in degrees; may be repeated [default: 30,0 30,45 30,90]
    #[arg(long, value_name = "THETA,PHI", value_parser = angles)]
    incident: Vec<(f64, f64)>,
    /// Polar angle of the outgoing directions in degrees
    #[arg(long, value_name = "DEG", default_value_t = THETA_R_DEG)]
    theta_r: f64,
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
    let source = Source::open(&args.brdf)?;
    let scan = AzimuthScan::new(
        &source,
        args.quantity.is,
        incident,
        args.theta_r,
        args.azimuths as usize,
    )?;
    scan.save(&args.brdf, &args.out)?;
    let value = json!({
        "out": args.out, "incident_deg": incident, "theta_r_deg": args.theta_r, "quantity": args.quantity.is,
        "azimuths": args.azimuths, "without_value": scan.missing(),
    });
    output.print(&value, || {
        format!(
            "{} ({} directions without a value)\n",
            args.out.display(),
            scan.missing()
        )
    })?;
    if scan.missing() == incident.len() * scan.phi_r_deg.len() {
        output.warn(&["the scan shows nothing: none of its directions has a value".to_owned()]);
    }
    Ok(())
}
