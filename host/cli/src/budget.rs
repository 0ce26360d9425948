//! `rcg budget`

use std::path::{Path, PathBuf};

use rcg::base::file_format::TABLE;
use rcg::brdf::Brdf;
use rcg::brdf::reflectance::Missing;
use rcg::capture::directory::Measurement;
use rcg::hemisphere::direction::from_degrees;
use rcg::measure::gum::{self, Budget};
use rcg::store::whole_file::write_whole;
use serde_json::json;

use crate::Done;
use crate::failure::Failure;
use crate::output::{Output, to_write};
use crate::render::angles;

/// The budget of uncertainty after the GUM: each source with its type, standard uncertainty, sensitivity and contribution.
///
/// Of a measurement and a pair of directions (--incident, --outgoing): the sample nearest to it, by channel, for which its frames are assembled once more
/// as far as it needs. Without a pair: of all regions of polar angles, or of the one that --region names, relative to f.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Directory of a measurement; without a pair of directions a brdf.zarr too
    #[arg(value_name = "DIR")]
    of: PathBuf,
    /// Light from this direction: polar angle and azimuth, degrees
    #[arg(long, value_name = "THETA,PHI", value_parser = angles, requires = "outgoing", allow_hyphen_values = true)]
    incident: Option<(f64, f64)>,
    /// View to this direction: polar angle and azimuth, degrees
    #[arg(long, value_name = "THETA,PHI", value_parser = angles, requires = "incident", allow_hyphen_values = true)]
    outgoing: Option<(f64, f64)>,
    /// The region of these polar angles of light and view, degrees
    #[arg(long, value_name = "THETA_I,THETA_O", value_parser = angles, conflicts_with = "incident")]
    region: Option<(f64, f64)>,
    /// Also write the table (.csv)
    #[arg(long, value_name = "FILE")]
    csv: Option<PathBuf>,
}

pub(crate) fn run(args: &Args, output: &Output) -> Done {
    if let Some(path) = &args.csv {
        to_write(path, TABLE)?;
    }
    let budgets = match args.incident.zip(args.outgoing) {
        Some((incident, outgoing)) => of_pair(&args.of, [incident, outgoing], output)?,
        None => of_regions(&args.of, args.region)?,
    };
    if let Some(path) = &args.csv {
        write_whole(path, gum::csv(&budgets).as_bytes())?;
    }
    output.print(&json!({ "of": args.of, "budgets": budgets }), || {
        gum::text(&budgets)
    })
}

fn of_pair(dir: &Path, pair: [(f64, f64); 2], output: &Output) -> Result<Vec<Budget>, Failure> {
    for (option, (theta, _)) in ["--incident", "--outgoing"].into_iter().zip(pair) {
        if !(0.0..90.0).contains(&theta) {
            return Err(Failure::input(format!(
                "{option}: expected a polar angle from 0 to below 90 degrees, found {theta}"
            )));
        }
    }
    let measurement = Measurement::open(dir)?;
    let scratch = tempfile::tempdir()?;
    let budgets = gum::at(&measurement, &[pair], scratch.path(), output)?;
    let budgets: Vec<Budget> = budgets.into_iter().flatten().collect();
    if budgets.is_empty() {
        let [(theta_i, phi_i), (theta_o, phi_o)] = pair;
        let why = reason(&measurement, pair).map_or_else(String::new, |why| format!(" ({why})"));
        return Err(Failure::input(format!(
            "{}: expected a value near light from ({theta_i}°, {phi_i}°) and view to ({theta_o}°, {phi_o}°), found none{why}",
            dir.display()
        )));
    }
    if budgets.iter().any(|budget| !budget.combined.is_finite()) {
        return Err(Failure::input(format!(
            "{}: expected a value that somebody knows how uncertain it is, found {} without a number: a frame saturated there, and nothing \
             tells how much light that threw aside (a shorter --exposure-ms, or --brackets auto)",
            dir.display(),
            budgets[0].of
        )));
    }
    Ok(budgets)
}

/// Why there is no value at a `pair` of directions, if the result says so.
fn reason(measurement: &Measurement, pair: [(f64, f64); 2]) -> Option<Missing> {
    let [wi, wo] = pair.map(|(theta, phi)| from_degrees(theta, phi));
    let brdf = Brdf::open(&measurement.path("brdf.zarr")).ok()?;
    brdf.stated(&[(wi, wo)]).ok()?.pop()?.err()
}

fn of_regions(path: &Path, region: Option<(f64, f64)>) -> Result<Vec<Budget>, Failure> {
    let path = if Measurement::exists(path) {
        path.join("brdf.zarr")
    } else {
        path.to_owned()
    };
    let brdf = Brdf::open(&path)?;
    let chosen = match region {
        Some((incident, outgoing)) => brdf
            .region(incident, outgoing)
            .map_or(&[][..], std::slice::from_ref),
        None => brdf.budget(),
    };
    let budgets: Vec<Budget> = chosen.iter().filter_map(Budget::of_region).collect();
    if budgets.is_empty() {
        let expected = match region {
            Some((incident, outgoing)) => {
                format!("uncertain values at polar angles {incident}° and {outgoing}°")
            }
            None => "a budget of uncertainty".to_owned(),
        };
        return Err(Failure::input(format!(
            "{}: expected {expected}, found none",
            path.display()
        )));
    }
    Ok(budgets)
}
