//! `rcg standard`

use std::path::PathBuf;

use rcg::base::file_format::CERTIFICATE;
use rcg::brdf::sample::{Certified, Contribution, Sample as _, albedo, mean_of};
use rcg::hemisphere::direction::from_degrees;
use rcg::instrument::calibration::Standard;
use rcg::judge::quantity::Quantity;
use rcg::store::whole_file::write_whole;
use serde::Serialize;

use crate::Done;
use crate::failure::Failure;
use crate::output::{Output, table, to_write};

/// Show what the certificate of a reflectance standard says and what is made of it.
///
/// The file is one for `rcg calibrate photometry --standard`; docs/standard.toml in the sources is an example of it. Of several certificates of
/// one plate the weighted mean is made, a file like any other.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// The certificate (TOML), or several of one plate
    #[arg(value_name = "FILE", required = true)]
    files: Vec<PathBuf>,
    /// The certificate that the mean of several is written to (TOML)
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Several laboratories share no scale: their mean may be known better than by the best of them
    #[arg(long, requires = "out")]
    independent: bool,
}

/// Polar angles at which the uncertainty is shown, degrees.
const SHOWN_DEG: [f64; 6] = [0.0, 30.0, 45.0, 60.0, 70.0, 80.0];

/// What is made of a certificate.
#[derive(Serialize)]
struct Answer {
    #[serde(flatten)]
    standard: Standard,
    /// f in sr⁻¹ at 0/45 and at 45/0, red, green and blue.
    f_0_45: [f64; 3],
    f_45_0: [f64; 3],
    /// π·f at 0/45.
    reflectance_factor_0_45: [f64; 3],
    /// Reflectance for light at 8°.
    reflectance_8_hemisphere: [f64; 3],
    /// What makes the uncertainty that all directions share.
    contributions: Vec<Contribution>,
    /// Uncertainty of f in all by polar angle.
    by_angle: Vec<ByAngle>,
    /// Scatter of several certificates about their mean over what they state.
    #[serde(skip_serializing_if = "Option::is_none")]
    birge_ratio: Option<f64>,
}

/// Relative standard uncertainty (k = 1) of f where light, or view, or both are at a polar angle, the other at 0.
#[derive(Serialize)]
struct ByAngle {
    theta_deg: f64,
    light: f64,
    view: f64,
    both: f64,
}

/// The certificate that is shown, and the Birge ratio of those of which it is the mean.
fn certified(args: &Args) -> Result<(Certified, Option<f64>), Failure> {
    match (&args.files[..], &args.out) {
        ([file], None) => Ok((Certified::open(file)?, None)),
        ([_], Some(_)) => Err(Failure::input(
            "--out: expected several certificates, of which a mean is written, found one",
        )),
        (_, None) => Err(Failure::input(format!(
            "--out: expected a file for the mean of {} certificates, found none",
            args.files.len()
        ))),
        (files, Some(out)) => {
            to_write(out, CERTIFICATE)?;
            let same = |file: &PathBuf| file.canonicalize().ok().zip(out.canonicalize().ok());
            if files.iter().filter_map(same).any(|(file, out)| file == out) {
                return Err(Failure::input(format!(
                    "{}: expected another file than the certificates for their mean, found one of them",
                    out.display()
                )));
            }
            let mean = mean_of(files, args.independent)?;
            write_whole(out, mean.text.as_bytes())?;
            Ok((Certified::open(out)?, Some(mean.birge_ratio)))
        }
    }
}

pub(crate) fn run(args: &Args, output: &Output) -> Done {
    let (certified, birge_ratio) = certified(args)?;
    let standard = certified.standard().clone();
    let at = |deg: f64| from_degrees(deg, 0.0);
    let away = |deg: f64| from_degrees(deg, 180.0);
    let f_0_45 = certified.f(at(0.0), away(45.0));
    let factor = Quantity::ReflectanceFactor.factor(away(45.0));
    let by_angle = SHOWN_DEG.map(|theta_deg| {
        let variance = |end: usize, deg: f64| standard.angular.variance(end, deg);
        let all = |light_deg: f64, view_deg: f64| {
            let own = variance(0, light_deg) + variance(1, view_deg);
            standard.standard_uncertainty.hypot(own.sqrt())
        };
        ByAngle {
            theta_deg,
            light: all(theta_deg, 0.0),
            view: all(0.0, theta_deg),
            both: all(theta_deg, theta_deg),
        }
    });
    let answer = Answer {
        f_0_45,
        f_45_0: certified.f(at(45.0), away(0.0)),
        reflectance_factor_0_45: f_0_45.map(|f| factor * f),
        reflectance_8_hemisphere: albedo(&certified, at(8.0)),
        contributions: certified.contributions().to_vec(),
        by_angle: by_angle.into(),
        birge_ratio,
        standard,
    };
    output.print(&answer, || text(&answer))
}

fn text(answer: &Answer) -> String {
    let percent = |relative: f64| format!("{:.2} %", 100.0 * relative);
    let channels = |values: [f64; 3]| {
        let [red, green, blue] = values.map(|value| format!("{value:.4}"));
        if red == green && green == blue {
            red
        } else {
            format!("{red} {green} {blue}")
        }
    };
    let certificate = answer.standard.certificate.as_ref();
    let mut lines = vec![
        (
            "certificate",
            certificate.map_or_else(String::new, ToString::to_string),
        ),
        ("f at 0/45", format!("{} 1/sr", channels(answer.f_0_45))),
        ("f at 45/0", format!("{} 1/sr", channels(answer.f_45_0))),
        ("π f at 0/45", channels(answer.reflectance_factor_0_45)),
        ("reflectance at 8/h", channels(answer.reflectance_8_hemisphere)),
        (
            "all directions share",
            format!("{} (k = 1)", percent(answer.standard.standard_uncertainty)),
        ),
    ];
    if let Some(birge_ratio) = answer.birge_ratio {
        lines.push((
            "Birge ratio",
            format!("{birge_ratio:.2}: scatter of the certificates over what they state"),
        ));
    }
    for part in answer.contributions.iter().filter(|part| part.relative > 0.0) {
        lines.push(("", format!("{} {}", percent(part.relative), part.cause)));
    }
    let [light_deg, view_deg] = answer.standard.angular.known_to_deg;
    lines.push((
        "angular behaviour",
        if light_deg.max(view_deg) > 0.0 {
            format!("as stated up to θ = {light_deg}° of light and {view_deg}° of view; farther out by what is usual of matte plates")
        } else {
            "not stated: taken for Lambertian, to what is usual of matte plates".to_owned()
        },
    ));
    for at in &answer.by_angle {
        lines.push((
            "",
            format!(
                "f at θ = {:2}° of light {}, of view {}, of both {} (k = 1, all together)",
                at.theta_deg,
                percent(at.light),
                percent(at.view),
                percent(at.both)
            ),
        ));
    }
    table(&lines)
}
