//! `rcg study`

use std::fmt::Write as _;
use std::path::PathBuf;

use rcg::brdf::interpolation::Interpolation;
use rcg::brdf::sample::parse;
use rcg::study::{Settings, Study, study};

use crate::Done;
use crate::output::Output;

/// Study how finely a sample must be captured: PSNR of rendered spheres by sampling interval and image size.
///
/// A known sample is captured by an ideal instrument (no hole, no noise), on a grid of incident directions;
/// spheres of 160x160 pixels under 19x10 lights (theta 0 to 90, 10 azimuths) are rendered from the captures
/// and from the sample itself. Pictures are f cos(theta_i) times the exposure, clipped to 1; PSNR (peak 1) counts the
/// whole picture, and the worst of the lights is given for Y, Cb and Cr (BT.601). What has no error at all, as Cb and Cr of a
/// grey sample, is exact (null, empty in the table); where pictures show nothing of the sample there is no PSNR.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// A model such as ward:brass, or a measured .bsdf file
    #[arg(long, value_name = "SAMPLE", default_value = "ward:brass")]
    sample: String,
    /// Factor from radiance (light of unit irradiance) to white
    #[arg(
        long,
        value_name = "FACTOR",
        default_value_t = 1.0,
        allow_negative_numbers = true
    )]
    exposure: f32,
    /// Degrees between incident directions; each must divide 90 [default: 10,5,3,2,1,0.5]
    #[arg(
        long,
        value_name = "DEG,...",
        value_delimiter = ',',
        allow_negative_numbers = true
    )]
    intervals: Vec<f64>,
    /// Pixels a side of a capture [default: 32,48,64,96,128,256]
    #[arg(long, value_name = "N,...", value_delimiter = ',')]
    image_sizes: Vec<usize>,
    /// Degrees between the incident directions of coarse captures by which all interpolations are compared, at 96 pixels
    /// [default: 30,15,10]
    #[arg(
        long,
        value_name = "DEG,...",
        value_delimiter = ',',
        allow_negative_numbers = true
    )]
    coarse_intervals: Vec<f64>,
    /// How values between captured directions are found
    #[arg(long, value_enum, default_value_t = Rule::Direct)]
    interpolation: Rule,
    /// Grid of the incident directions
    #[arg(long, value_enum, default_value_t = GridKind::ThetaPhi)]
    grid: GridKind,
    /// Directory for the table (CSV, JSON), the charts (SVG, PNG) and spheres to compare
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

/// Names of the interpolations on the command line.
#[derive(Clone, Copy, Debug, clap::ValueEnum)]
enum Rule {
    /// Linear in all four angles
    Direct,
    /// Linear in the incident direction at constant half vector: a highlight moves
    HalfVector,
    /// Whatever predicts left-out captures best, region by region; reciprocity included
    Blended,
}

/// Names of the grids on the command line.
#[derive(Clone, Copy, Debug, PartialEq, clap::ValueEnum)]
enum GridKind {
    /// Rings of equally many directions, as in the paper
    ThetaPhi,
    /// Rings of as many directions as keep the gap within the interval
    EqualSolidAngle,
}

pub(crate) fn run(args: &Args, output: &Output) -> Done {
    let sample = parse(&args.sample)?;
    let mut settings = Settings {
        exposure: args.exposure,
        interpolation: match args.interpolation {
            Rule::Direct => Interpolation::Direct,
            Rule::HalfVector => Interpolation::HalfVector,
            Rule::Blended => Interpolation::Blended,
        },
        equal_solid_angle: args.grid == GridKind::EqualSolidAngle,
        ..Settings::default()
    };
    for (field, given) in [
        (&mut settings.intervals_deg, &args.intervals),
        (&mut settings.coarse_intervals_deg, &args.coarse_intervals),
    ] {
        if !given.is_empty() {
            field.clone_from(given);
        }
    }
    if !args.image_sizes.is_empty() {
        settings.image_sizes.clone_from(&args.image_sizes);
    }
    let found = study(
        &args.sample,
        sample.as_ref(),
        &settings,
        args.out.as_deref(),
        output,
    )?;
    output.print(&found, || text(&found))?;
    output.warn(&found.warnings);
    Ok(())
}

fn text(found: &Study) -> String {
    let mut text = format!(
        "{}, exposure {}: smallest PSNR in dB over {}x{} lights, sphere of {} pixels\n\
         interval  size  captures  interpolation      Y     Cb     Cr\n",
        found.sample, found.exposure, found.lights[0], found.lights[1], found.sphere_px
    );
    let break_at = found.rows.len();
    for (index, row) in found.rows.iter().chain(&found.methods).enumerate() {
        if index == break_at {
            text.push_str("interpolations of coarse captures\n");
        }
        let without = if found.shows_something() { "exact" } else { "none" };
        let db = |db: Option<f64>| db.map_or_else(|| without.to_owned(), |db| format!("{db:.1}"));
        let [y, cb, cr] = [row.psnr.psnr_y_db, row.psnr.psnr_cb_db, row.psnr.psnr_cr_db].map(db);
        writeln!(
            text,
            "{:>7}°  {:>4}  {:>8}  {:<13}  {y:>5}  {cb:>5}  {cr:>5}",
            row.interval_deg,
            row.image_size,
            row.captures,
            row.interpolation.name()
        )
        .expect("strings take everything");
    }
    text
}
