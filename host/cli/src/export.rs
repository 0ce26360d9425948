//! `rcg export`

use std::path::PathBuf;

use clap::builder::{PossibleValuesParser, TypedValueParser};
use rcg::base::file_format::Formats;
use rcg::brdf::Source;
use rcg::brdf::format::{About, Exported, Form, Format, Resolution, Tabulation, export};

use crate::Done;
use crate::clock::now;
use crate::failure::Failure;
use crate::output::{Output, table, to_write};

/// Write a BRDF as a file of another program.
///
/// The file is read back, and how far it is from its source is told: the relative difference of luminance at random pairs of directions
/// with θ ≤ 75° both ways where f is at least 1 % of its median. What a format cannot carry (uncertainty, provenance, missing values, azimuths
/// of the sample) is told too.
///
/// bsdf: RGL tensor file, for Mitsuba. merl: MERL's isotropic table. ssdd: dense table of libbsdf. klems: LBNL BSDF XML, for WINDOW and Radiance. zemax:
/// tabular BSDF of `OpticStudio`. bird: universal BRDF of the European metrology projects (JSON). npy: records of NumPy. csv: a table of text. exr: a
/// picture of the hemisphere under one light.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// A brdf.zarr or the directory of a measurement, a measured file, or a model such as ward:brass
    #[arg(value_name = "BRDF")]
    brdf: String,
    /// The format
    #[arg(long, value_name = "FORMAT", value_parser = named())]
    to: Format,
    /// The file to write; its name ends as the format's do (.bsdf, .binary, .ssdd, .xml, .brdf or .json, .npy, .csv, .exr)
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Step of the table's angles, degrees, 0.5 to 45; without it that of the source where the format takes it (bsdf: 3 and 5)
    #[arg(long, value_name = "DEG", value_parser = step)]
    step: Option<f64>,
    /// Points along each side of a .bsdf's table of half vectors, 2 to 1024 [default: 128 of a dense one, 192 of an isotropic sample; as few
    /// as are as good of a compact one], or of an .exr [default: 256, or as many as were measured]
    #[arg(long, value_name = "N")]
    resolution: Option<usize>,
    /// How a .bsdf tabulates half vectors: at equal steps (dense), or where the sample's facets are seen (compact) [default: compact where
    /// that is smaller and as good; a .bsdf that is exported keeps its own tables]
    #[arg(long, value_name = "dense|compact", value_parser = form())]
    table: Option<Form>,
    /// Write one incident direction only, polar angle and azimuth in degrees (csv; exr needs one)
    #[arg(long, value_name = "THETA,PHI", value_parser = direction)]
    slice: Option<[f64; 2]>,
    /// Write 0 where there is no value, in formats that have no missing ones; else that is refused
    #[arg(long)]
    zeros: bool,
}

/// The parser of a format's name.
fn named() -> impl TypedValueParser<Value = Format> {
    PossibleValuesParser::new(Format::ALL.map(Format::name)).map(|name| {
        let found = Format::ALL.into_iter().find(|format| format.name() == name);
        found.unwrap_or(Format::Bsdf)
    })
}

/// The parser of a form's name.
fn form() -> impl TypedValueParser<Value = Form> {
    PossibleValuesParser::new(["dense", "compact"]).map(|name| match name.as_str() {
        "dense" => Form::Dense,
        _ => Form::Compact,
    })
}

fn step(text: &str) -> Result<f64, String> {
    let step: Option<f64> = text.parse().ok().filter(|step| (0.5..=45.0).contains(step));
    step.ok_or_else(|| "expected degrees from 0.5 to 45".to_owned())
}

fn direction(text: &str) -> Result<[f64; 2], String> {
    let angles: Option<Vec<f64>> = text.split(',').map(|angle| angle.parse().ok()).collect();
    match angles.as_deref() {
        Some(&[theta, phi]) if (0.0..90.0).contains(&theta) && (0.0..360.0).contains(&phi) => {
            Ok([theta, phi])
        }
        _ => Err("expected a polar angle below 90 and an azimuth below 360, degrees, as in 30,0".to_owned()),
    }
}

pub(crate) fn run(args: &Args, output: &Output) -> Done {
    to_write(&args.out, Formats::new(args.to.endings()))?;
    if args.slice.is_some() && !matches!(args.to, Format::Csv | Format::Exr) {
        return Err(Failure::input(format!(
            "--slice: expected --to csv or exr, found --to {}",
            args.to.name()
        )));
    }
    if args.slice.is_none() && args.to == Format::Exr {
        return Err(Failure::input(
            "--slice: expected one incident direction as in --slice 30,0, because a picture has one light, found none",
        ));
    }
    if args.step.is_some() && args.to == Format::Exr {
        return Err(Failure::input(
            "--step: expected --resolution for an exr, found degrees",
        ));
    }
    if args.resolution.is_some() && !matches!(args.to, Format::Bsdf | Format::Exr) {
        return Err(Failure::input(format!(
            "--resolution: expected --to bsdf or exr, found --to {}",
            args.to.name()
        )));
    }
    if args.table.is_some() && args.to != Format::Bsdf {
        return Err(Failure::input(format!(
            "--table: expected --to bsdf, found --to {}",
            args.to.name()
        )));
    }
    let source = Source::open(&args.brdf)?;
    let about = About {
        name: args.brdf.clone(),
        written: now()?,
    };
    let resolution = Resolution {
        step_deg: args.step.unwrap_or(0.0),
        side: args.resolution.unwrap_or(0),
        incident_deg: args.slice,
        zeros: args.zeros,
        form: args.table,
    };
    let exported = export(&source, &about, (args.to, resolution), &args.out, output)?;
    output.print(&exported, || text(&exported, args))?;
    output.warn(&exported.warnings);
    Ok(())
}

fn text(exported: &Exported, args: &Args) -> String {
    let mut lines = vec![
        ("written", format!("{}, {}", args.out.display(), args.to.words())),
        (
            "size",
            format!("{} bytes, {} pairs of directions", exported.bytes, exported.pairs),
        ),
        (
            "missing",
            format!("{:.2} % of them have no value", 100.0 * exported.missing),
        ),
    ];
    if let Some(table) = &exported.table {
        lines.push(("table", tabulated(table)));
    }
    if let Some(averaged) = exported.averaged_azimuths {
        lines.push((
            "azimuths",
            format!(
                "averaged away; f differs over them by more than {:.2} % in a tenth of the table (standard deviation)",
                100.0 * averaged
            ),
        ));
    }
    lines.push(("read back", read_back(exported)));
    table(&lines)
}

fn tabulated(table: &Tabulation) -> String {
    let form = match table.form {
        Form::Dense => "dense",
        Form::Compact => "compact",
        Form::Own => "the file's own",
    };
    let [azimuths, polar] = table.incident;
    format!(
        "{form}, {side} × {side} half vectors under light from {azimuths} azimuths × {polar} polar angles: {}",
        table.why,
        side = table.side
    )
}

fn read_back(exported: &Exported) -> String {
    let Some(trip) = exported.round_trip else {
        return "no".to_owned();
    };
    let within = trip.within_half_sigma.map_or_else(String::new, |share| {
        format!(
            ", {:.2} % of them within half of the standard uncertainty",
            100.0 * share
        )
    });
    match (trip.median, trip.below_99, trip.largest) {
        (Some(median), Some(most), Some(largest)) => format!(
            "differs by {:.3} % (median), 99 % below {:.2} %, at most {:.2} %, from {} pairs{within}; {} have no value there",
            100.0 * median,
            100.0 * most,
            100.0 * largest,
            trip.pairs,
            trip.lost
        ),
        _ => "no pair of directions to compare".to_owned(),
    }
}
