//! `rcg value`

use std::fmt::Write as _;
use std::io::{self, Write as _};

use clap::builder::{PossibleValuesParser, TypedValueParser};
use glam::DVec3;
use rcg::brdf::reflectance::Missing;
use rcg::brdf::sample::MeasuredRgl;
use rcg::brdf::{Source, Stated};
use rcg::hemisphere::direction::from_degrees;
use rcg::judge::quantity::Quantity;
use serde_json::{Value as Json, json};

use crate::Done;
use crate::failure::Failure;
use crate::numbers::directions_of;
use crate::output::Output;

/// Lines that are answered together: large tables are read once for all of them.
const BATCH: usize = 1 << 18;

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

/// What is answered of one pair of directions.
type Answer = Result<(Json, String), Missing>;

/// Answers pairs of directions (incident, outgoing) in the order asked.
type Answers<'a> = dyn Fn(&[(DVec3, DVec3)]) -> Result<Vec<Answer>, Failure> + 'a;

/// The answer of a value in the `quantity`, seen along `wo`.
fn plain(quantity: Quantity, wo: DVec3, f: [f32; 3]) -> (Json, String) {
    let value = f.map(|f| quantity.factor(wo) as f32 * f);
    let [r, g, b] = value;
    (
        json!({ (quantity.key()): value }),
        format!("{r:.6e} {g:.6e} {b:.6e}"),
    )
}

/// The answer with its uncertainty.
fn with_uncertainty(quantity: Quantity, wo: DVec3, stated: &Stated) -> (Json, String) {
    let (mut value, mut line) = plain(quantity, wo, stated.f);
    let scaled = |sigma: [f32; 3]| sigma.map(|sigma| quantity.factor(wo) as f32 * sigma);
    let [r, g, b] = scaled(stated.sigma);
    let share = stated.common_share();
    value["standard_uncertainty"] = json!([r, g, b]);
    value["by_interpolation"] = json!(scaled(stated.interpolation));
    value["common_share"] = json!(share);
    value["provenance"] = json!(stated.provenance.name());
    write!(
        line,
        " {r:.3e} {g:.3e} {b:.3e} {share:.3} {}",
        stated.provenance.name()
    )
    .expect("strings take everything");
    (value, line)
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
            let stated = brdf.stated(pairs)?.into_iter().zip(pairs);
            let answer = |stated: &Stated, wo| with_uncertainty(quantity, wo, stated);
            stated
                .map(|(stated, (_, wo))| Ok(answer(&stated?, *wo)))
                .collect()
        } else {
            let values = source.reflectance().values(pairs)?.into_iter().zip(pairs);
            values.map(|(f, (_, wo))| Ok(plain(quantity, *wo, f?))).collect()
        })
    };
    let answered = answer(&answers, output.is_json())?;
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
fn answer(answers: &Answers<'_>, is_json: bool) -> Result<Vec<Json>, Failure> {
    let mut out = io::BufWriter::new(io::stdout().lock());
    let mut lines = directions_of(io::stdin().lock(), "theta_i phi_i theta_o phi_o in degrees");
    let mut all = Vec::new();
    loop {
        // What stands before a bad line is answered; then the line is named.
        let mut pairs = Vec::new();
        let mut bad = None;
        for line in lines.by_ref().take(BATCH) {
            match line {
                Ok([theta_i, phi_i, theta_o, phi_o]) => {
                    pairs.push((from_degrees(theta_i, phi_i), from_degrees(theta_o, phi_o)));
                }
                Err(failure) => {
                    bad = Some(failure);
                    break;
                }
            }
        }
        for answer in answers(&pairs)? {
            match (answer, is_json) {
                (Ok((_, line)), false) => writeln!(out, "{line}")?,
                (Err(reason), false) => writeln!(out, "- {reason}")?,
                (Ok((value, _)), true) => all.push(value),
                (Err(reason), true) => all.push(json!({ "reason": reason.to_string() })),
            }
        }
        out.flush()?;
        if let Some(failure) = bad {
            return Err(failure);
        }
        if pairs.len() < BATCH {
            return Ok(all);
        }
    }
}
