//! `rcg plot`

use std::path::PathBuf;

use rcg::base::file_format::CHART_OR_TABLE;
use rcg::brdf::reflectance::Reflectance;
use rcg::brdf::sample::Sample;
use rcg::brdf::{KnownBrdf, Source};
use rcg::hemisphere::direction::{from_degrees, is_above_horizon};
use rcg::judge::chart::{Lobes, Sheet as _};
use rcg::judge::outgoing_map::{Asked, OutgoingMaps, Shown};
use rcg::judge::scan::{Along, INCIDENT_DEG, Scan, THETA_R_DEG, chart, csv};
use serde_json::json;

use crate::Done;
use crate::failure::Failure;
use crate::output::{Output, to_write};
use crate::render::angles;
use crate::value::QuantityArg;

/// Plot reflectance against the azimuth of the outgoing direction, in the plane of incidence, or over the outgoing hemisphere.
///
/// One curve per BRDF and incident direction, at one outgoing polar angle or in the plane of incidence; or, with --hemisphere, a map for
/// each, in which the hole, wires and what else has no value are drawn by their reasons, and what was filled in is hatched by its origin.
/// Directions that were not measured are gaps. The chart shows the luma (BT.601), of a measurement with its interval of k = 2; the table (.csv) has all channels, of a
/// measurement with their standard uncertainties (k = 1) and provenance, and why there is no value where there is none.
#[derive(Debug, clap::Args)]
#[expect(clippy::struct_excessive_bools, reason = "each is an option of the command")]
pub(crate) struct Args {
    /// A brdf.zarr, a measured file, or a model such as ward:brass; several stand in one chart
    #[arg(value_name = "BRDF", required = true)]
    brdf: Vec<String>,
    /// What to write: a chart (.svg, .pdf, .png) or a table (.csv)
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
    /// The plane of incidence as lobes: the angle around the middle is the outgoing polar angle, the distance from it the value
    #[arg(long, conflicts_with = "hemisphere")]
    polar: bool,
    /// Maps of the outgoing hemisphere instead, equal areas for equal solid angles
    #[arg(long, conflicts_with_all = ["theta_r", "azimuths", "in_plane"])]
    hemisphere: bool,
    /// What the maps show: the quantity, its relative standard uncertainty (k = 1), or its relative error against --reference [default: value]
    #[arg(long, value_enum)]
    show: Option<Show>,
    /// The BRDF, model or measured file that --show error compares with
    #[arg(long, value_name = "BRDF")]
    reference: Option<String>,
    /// A logarithmic axis; what is not above 0 is a gap
    #[arg(long)]
    log: bool,
    #[command(flatten)]
    quantity: QuantityArg,
    /// Azimuths around the circle
    #[arg(long, value_name = "N", default_value_t = 360, value_parser = clap::value_parser!(u32).range(4..=36000))]
    azimuths: u32,
}

/// What maps show.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Show {
    /// The quantity
    Value,
    /// Its relative standard uncertainty
    Uncertainty,
    /// Its relative error
    Error,
}

/// Maps of one picture at most.
const MAPS: usize = 24;

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
    // The parser asks for nothing that something else excludes.
    for (name, is_given, needed, is_there) in [
        ("--polar", args.polar, "--in-plane", args.in_plane),
        ("--show", args.show.is_some(), "--hemisphere", args.hemisphere),
        (
            "--reference",
            args.reference.is_some(),
            "--hemisphere",
            args.hemisphere,
        ),
    ] {
        if is_given && !is_there {
            return Err(Failure::input(format!(
                "{name}: expected {needed} beside it, found none"
            )));
        }
    }
    to_write(&args.out, CHART_OR_TABLE)?;
    if args.hemisphere {
        return maps(args, incident, output);
    }
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
    let chart = chart(&scans, &title, args.log);
    if args.polar && CHART_OR_TABLE.of(&args.out)? != "csv" {
        Lobes(&chart).save(&args.out)?;
    } else {
        chart.save_or_table(|| csv(&scans), &args.out)?;
    }
    let missing: usize = scans.iter().map(|(_, scan)| scan.missing()).sum();
    let value = json!({
        "out": args.out, "incident_deg": incident, "theta_r_deg": (!args.in_plane).then_some(args.theta_r),
        "in_plane": args.in_plane, "polar": args.polar, "quantity": args.quantity.is, "azimuths": (!args.in_plane).then_some(args.azimuths),
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

/// What the options of maps ask for, if they fit each other.
fn shown(args: &Args, maps: usize) -> Result<Shown, Failure> {
    let show = args.show.unwrap_or(Show::Value);
    if maps > MAPS {
        return Err(Failure::input(format!(
            "--incident: expected at most {MAPS} maps in all, found {maps}"
        )));
    }
    match (show, &args.reference) {
        (Show::Error, None) => Err(Failure::input(
            "--show error: expected --reference beside it, found none",
        )),
        (Show::Value | Show::Uncertainty, Some(reference)) => Err(Failure::input(format!(
            "--reference: expected --show error beside it, found {reference} without"
        ))),
        (Show::Error, Some(_)) if args.log => Err(Failure::input(
            "--log: expected --show value or uncertainty, because an error has a sign, found --show error",
        )),
        (Show::Error, Some(_)) => Ok(Shown::Error),
        (Show::Uncertainty, None) => Ok(Shown::Uncertainty),
        (Show::Value, None) => Ok(Shown::Value),
    }
}

/// What `sources` are compared with: another capture than each of them, or a known sample.
fn reference(spec: &str, sources: &[(&str, Source)]) -> Result<Box<dyn Sample>, Failure> {
    let other = match Source::open(spec)? {
        Source::Known(sample) => return Ok(sample),
        Source::Measured(other) => other,
    };
    for (_, source) in sources {
        if let Source::Measured(brdf) = source {
            brdf.check_apart(&other)?;
        }
    }
    Ok(Box::new(KnownBrdf::read(&other)?))
}

fn maps(args: &Args, incident: &[(f64, f64)], output: &Output) -> Done {
    let shown = shown(args, args.brdf.len() * incident.len())?;
    let mut sources = Vec::with_capacity(args.brdf.len());
    for brdf in &args.brdf {
        let source = Source::open(brdf)?;
        if shown == Shown::Uncertainty && matches!(source, Source::Known(_)) {
            return Err(Failure::input(format!(
                "--show uncertainty: expected a brdf.zarr, which states how uncertain it is, found {brdf}"
            )));
        }
        sources.push((brdf.as_str(), source));
    }
    let reference = match &args.reference {
        Some(spec) => Some(reference(spec, &sources)?),
        None => None,
    };
    let asked = Asked {
        shown,
        quantity: args.quantity.is,
        incident_deg: incident,
        reference: reference.as_ref().map(|reference| reference as &dyn Reflectance),
        is_log: args.log,
        is_table: CHART_OR_TABLE.of(&args.out)? == "csv",
    };
    let maps = OutgoingMaps::new(&sources, &asked)?;
    let mut title = args.brdf.join(", ");
    if let Some(reference) = &args.reference {
        title = format!("{title} against {reference}");
    }
    maps.save(&title, &args.out)?;
    let value = json!({
        "out": args.out, "incident_deg": incident, "hemisphere": true, "quantity": args.quantity.is, "reference": args.reference,
        "places": maps.len(), "without_value": maps.missing(), "rms": maps.rms(),
    });
    output.print(&value, || {
        format!(
            "{} ({} of {} places without a value)\n",
            args.out.display(),
            maps.missing(),
            maps.len()
        )
    })?;
    if maps.missing() == maps.len() {
        output.warn(&["the maps show nothing: no place has a value".to_owned()]);
    }
    Ok(())
}
