//! `rcg reflectance`

use std::fmt::Write as _;

use rcg::brdf::Source;
use rcg::judge::reflectance::{Geometry, Reflected, reflected};
use serde_json::json;

use crate::Done;
use crate::failure::Failure;
use crate::output::Output;

/// Reflectances of a BRDF: 8°/h, 0°/45°, 45°/0°, and by the polar angle of the light into the hemisphere, with uncertainties.
///
/// All are means over the azimuth. θ/h is ∫ f·cosθo dωo, the directional-hemispherical reflectance, gloss included; 0°/45° and 45°/0°
/// are reflectance factors π·f of rings. Where too little of the hemisphere (99 %) or of the ring (75 %) has values there is none.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// A brdf.zarr, a measured .bsdf file, or a model such as ward:brass
    #[arg(value_name = "BRDF")]
    brdf: String,
    /// Polar angles of light, degrees, in place of 15, 30, 45, 60 and 75
    #[arg(long, value_name = "DEG,...", value_delimiter = ',', default_values_t = [15.0, 30.0, 45.0, 60.0, 75.0], allow_negative_numbers = true)]
    theta: Vec<f64>,
}

pub(crate) fn run(args: &Args, output: &Output) -> Done {
    if let Some(theta) = args.theta.iter().find(|theta| !(0.0..90.0).contains(*theta)) {
        return Err(Failure::input(format!(
            "--theta: expected polar angles from 0 to below 90 degrees, found {theta}"
        )));
    }
    let source = Source::open(&args.brdf)?;
    let usual = [
        Geometry::Hemisphere(8.0),
        Geometry::Ring(0.0, 45.0),
        Geometry::Ring(45.0, 0.0),
    ];
    let asked = args.theta.iter().map(|theta| Geometry::Hemisphere(*theta));
    let all: Vec<Reflected> = usual
        .into_iter()
        .chain(asked)
        .map(|geometry| reflected(&source, geometry))
        .collect::<Result<_, _>>()?;
    output.print(&json!({ "brdf": args.brdf, "reflectances": all }), || text(&all))?;
    let without: Vec<&str> = all
        .iter()
        .filter(|one| one.value.is_none())
        .map(|one| one.geometry.as_str())
        .collect();
    if !without.is_empty() {
        output.warn(&[format!(
            "reflectance: none for {}, where too little has values; `fill` closes the gaps",
            without.join(", ")
        )]);
    }
    Ok(())
}

fn text(all: &[Reflected]) -> String {
    let numbers = |numbers: [f64; 3]| numbers.map(|number| format!("{number:.4}")).join(" ");
    let mut text = "light/view  reflectance r g b     standard uncertainty (k = 1)  seen\n".to_owned();
    for one in all {
        let value = one.value.map_or_else(|| "none".to_owned(), numbers);
        let sigma = one
            .standard_uncertainty
            .map_or_else(|| "none".to_owned(), numbers);
        writeln!(
            text,
            "{:11} {value:21} {sigma:29} {:.2} %",
            one.geometry,
            100.0 * one.seen
        )
        .expect("strings take everything");
    }
    text
}
