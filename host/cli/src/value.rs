//! `rcg value`

use std::io::{self, Write as _};

use rcg::brdf::Source;
use rcg::hemisphere::direction::from_degrees;
use serde_json::json;

use crate::Done;
use crate::numbers::directions_of;
use crate::output::Output;

/// Lines that are answered together: large tables are read once for all of them.
const BATCH: usize = 1 << 18;

/// Pairs of directions on stdin to values of a BRDF.
///
/// Reads lines `theta_i phi_i theta_o phi_o` (degrees; both directions point away from the surface; blank
/// lines and what follows a # are skipped) and answers each with `r g b` (f in 1/sr, without the
/// cosine), or with `- reason`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// A brdf.zarr, a measured .bsdf file, or a model such as ward:brass
    #[arg(value_name = "BRDF")]
    brdf: String,
}

pub(crate) fn run(args: &Args, output: &Output) -> Done {
    let source = Source::open(&args.brdf)?;
    let mut out = io::BufWriter::new(io::stdout().lock());
    let mut lines = directions_of(io::stdin().lock(), "theta_i phi_i theta_o phi_o in degrees");
    let mut answers = Vec::new();
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
        for value in source.reflectance().values(&pairs)? {
            match (value, output.is_json()) {
                (Ok([r, g, b]), false) => writeln!(out, "{r:.6e} {g:.6e} {b:.6e}")?,
                (Err(reason), false) => writeln!(out, "- {reason}")?,
                (Ok(f), true) => answers.push(json!({ "f_per_sr": f })),
                (Err(reason), true) => answers.push(json!({ "reason": reason.to_string() })),
            }
        }
        out.flush()?;
        if let Some(failure) = bad {
            return Err(failure);
        }
        if pairs.len() < BATCH {
            break;
        }
    }
    drop(out);
    let azimuth = match &source {
        Source::Measured(brdf) => Some(brdf.azimuth()),
        Source::Known(_) => None,
    };
    output.print(
        &json!({ "brdf": args.brdf, "azimuth": azimuth, "values": answers }),
        String::new,
    )
}
