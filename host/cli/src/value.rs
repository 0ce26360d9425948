//! `rcg value`

use std::fmt::Write as _;
use std::io::{self, Write as _};

use clap::builder::{PossibleValuesParser, TypedValueParser};
use glam::DVec3;
use rayon::prelude::*;
use rcg::base::text::lines;
use rcg::brdf::reflectance::Missing;
use rcg::brdf::sample::MeasuredRgl;
use rcg::brdf::{Source, Stated};
use rcg::hemisphere::direction::from_degrees;
use rcg::judge::quantity::Quantity;
use serde_json::{Value as Json, json};

use crate::Done;
use crate::failure::Failure;
use crate::numbers::next_directions;
use crate::output::Output;

/// Lines that are answered together: large tables are read once for all of them.
const BATCH: usize = 1 << 18;
/// What a line holds.
const NAMES: &str = "theta_i phi_i theta_o phi_o in degrees";
/// Answers that one thread makes text of.
const TOGETHER: usize = 1 << 12;

/// Pairs of directions on stdin to values of a BRDF.
///
/// Reads lines `theta_i phi_i theta_o phi_o` (degrees; both directions point away from the surface; blank
/// lines and what follows a # are skipped) and answers each with `r g b` (f in 1/sr, without the
/// cosine), or with `- reason`. Of a `.bsdf` with spectra, r g b are linear sRGB as the CIE 1931 standard
/// observer (2°) sees them under D65.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// A brdf.zarr, a measured .bsdf file, or a model such as ward:brass
    #[arg(value_name = "BRDF")]
    brdf: String,
    #[command(flatten)]
    quantity: QuantityArg,
    /// Answer with `r g b`, their standard uncertainties `u_r u_g u_b` (k = 1, interpolation between captured directions
    /// included), the share of their variance that all values of the file have in common, and where the value is from
    #[arg(long)]
    uncertainty: bool,
}

/// The quantity in which reflectance is stated.
#[derive(Clone, Copy, Debug, clap::Args)]
pub(crate) struct QuantityArg {
    /// What is stated: f in 1/sr (brdf), f·cosθo in 1/sr (ccbrdf), or π·f, which is the reflectance factor and the radiance factor
    /// of small light and pixels
    #[arg(id = "quantity", long = "quantity", value_name = "brdf|ccbrdf|reflectance-factor|radiance-factor",
        default_value_t = Quantity::Brdf, value_parser = named())]
    pub(crate) is: Quantity,
}

/// The parser of a quantity's name.
fn named() -> impl TypedValueParser<Value = Quantity> {
    PossibleValuesParser::new(Quantity::ALL.map(Quantity::name))
        .map(|name| Quantity::named(&name).unwrap_or_default())
}

/// What is answered of one pair of directions: f per channel, with what is stated of it if that was asked.
type Answer = Result<([f32; 3], Option<Stated>), Missing>;

/// Answers pairs of directions (incident, outgoing) in the order asked.
type Answers<'a> = dyn Fn(&[(DVec3, DVec3)]) -> Result<Vec<Answer>, Failure> + 'a;

/// An answer as it is shown: the `quantity`, seen along `wo`.
fn scaled(quantity: Quantity, wo: DVec3, f: [f32; 3]) -> [f32; 3] {
    let factor = quantity.factor(wo) as f32;
    f.map(|f| factor * f)
}

/// The answer as an object.
fn object(quantity: Quantity, wo: DVec3, answer: Answer) -> Json {
    let (f, stated) = match answer {
        Ok(found) => found,
        Err(reason) => return json!({ "reason": reason.to_string() }),
    };
    let mut value = json!({ (quantity.key()): scaled(quantity, wo, f) });
    if let Some(stated) = stated {
        value["standard_uncertainty"] = json!(scaled(quantity, wo, stated.sigma));
        value["by_interpolation"] = json!(scaled(quantity, wo, stated.interpolation));
        value["common_share"] = json!(stated.common_share());
        value["provenance"] = json!(stated.provenance.name());
    }
    value
}

/// Adds the answer to `text` as a line.
fn line(text: &mut String, quantity: Quantity, wo: DVec3, answer: Answer) -> std::fmt::Result {
    let (f, stated) = match answer {
        Ok(found) => found,
        Err(reason) => return writeln!(text, "- {reason}"),
    };
    let [r, g, b] = scaled(quantity, wo, f);
    write!(text, "{r:.6e} {g:.6e} {b:.6e}")?;
    if let Some(stated) = stated {
        let [r, g, b] = scaled(quantity, wo, stated.sigma);
        let (share, origin) = (stated.common_share(), stated.provenance.name());
        write!(text, " {r:.3e} {g:.3e} {b:.3e} {share:.3} {origin}")?;
    }
    text.push('\n');
    Ok(())
}

pub(crate) fn run(args: &Args, output: &Output) -> Done {
    let source = Source::open(&args.brdf)?;
    let quantity = args.quantity.is;
    let measured = match &source {
        Source::Measured(brdf) => Some(brdf),
        Source::Known(_) => None,
    };
    if args.uncertainty && measured.is_none() {
        return Err(Failure::input(format!(
            "--uncertainty: expected a brdf.zarr, which states how uncertain it is, found {}",
            args.brdf
        )));
    }
    let answers = |pairs: &[(DVec3, DVec3)]| -> Result<Vec<Answer>, Failure> {
        Ok(if let Some(brdf) = measured.filter(|_| args.uncertainty) {
            let stated = brdf.stated(pairs)?.into_iter();
            stated
                .map(|stated| stated.map(|stated| (stated.f, Some(stated))))
                .collect()
        } else {
            let values = source.reflectance().values(pairs)?.into_iter();
            values.map(|f| f.map(|f| (f, None))).collect()
        })
    };
    let answered = answer(&answers, quantity, output.is_json())?;
    let colours = match &source {
        Source::Measured(_) => None,
        Source::Known(sample) => sample.tensor().and_then(MeasuredRgl::colours),
    };
    let value = json!({
        "brdf": args.brdf,
        "spectra": colours,
        "quantity": quantity,
        "azimuth": measured.map(|brdf| brdf.azimuth()),
        "common_uncertainty": measured.and_then(|brdf| brdf.common_uncertainty()),
        "values": answered,
    });
    output.print(&value, String::new)
}

/// Answers the lines on stdin by `answers`: at once, or, for `is_json`, all together.
fn answer(answers: &Answers<'_>, quantity: Quantity, is_json: bool) -> Result<Vec<Json>, Failure> {
    let mut out = io::stdout().lock();
    let mut lines = lines(io::stdin().lock());
    let mut all = Vec::new();
    loop {
        // What stands before a bad line is answered; then the line is named.
        let (angles, end) = next_directions(&mut lines, BATCH, NAMES);
        let pairs: Vec<(DVec3, DVec3)> = angles
            .par_iter()
            .map(|&[theta_i, phi_i, theta_o, phi_o]| {
                (from_degrees(theta_i, phi_i), from_degrees(theta_o, phi_o))
            })
            .collect();
        let answered = answers(&pairs)?;
        if is_json {
            let objects = answered.into_iter().zip(&pairs);
            all.extend(objects.map(|(answer, (_, wo))| object(quantity, *wo, answer)));
        } else {
            let texts: Vec<String> = answered
                .par_chunks(TOGETHER)
                .zip(pairs.par_chunks(TOGETHER))
                .map(|(answered, pairs)| {
                    let mut text = String::new();
                    for (answer, (_, wo)) in answered.iter().zip(pairs) {
                        line(&mut text, quantity, *wo, *answer).expect("strings take everything");
                    }
                    text
                })
                .collect();
            for text in texts {
                out.write_all(text.as_bytes())?;
            }
            out.flush()?;
        }
        match end {
            None => {}
            Some(Ok(())) => return Ok(all),
            Some(Err(failure)) => return Err(failure),
        }
    }
}
