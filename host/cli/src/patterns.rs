//! `rcg patterns`

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use rcg::base::progress::Progress as _;
use rcg::capture::directory::Measurement;
use rcg::capture::dlpc900::image::PLANES;
use rcg::capture::dlpc900::sheet::{Order, sheet};
use rcg::instrument::optics::View;
use rcg::instrument::rig::{Rig, Tilt};
use rcg::judge::render::{PictureError, save};
use rcg::plan::pattern::{BitPattern, PatternMaker};
use rcg::plan::{Directions, PlanError, Request};
use rcg::store::Lock;
use rcg::store::whole_file::write_whole;
use serde_json::json;

use crate::Done;
use crate::failure::Failure;
use crate::output::Output;
use crate::request::{CalibrationArgs, GridArgs, spot_deg};

/// Write the patterns that a measurement shows.
///
/// One black and white PNG per incident direction that the projector reaches, in the projector's native resolution,
/// and patterns.csv with what each one lights; three of a colour each where the projector makes the bands. What a calibrated measurement lights beside the mirror in every pattern, to watch
/// the lamp, is left out.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// New or empty directory for the pictures
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    #[command(flatten)]
    grid: GridArgs,
    /// Opening of the cone that each pattern lights, degrees [default: that of the rig, but no wider than the step]
    #[arg(long, value_name = "DEG", allow_negative_numbers = true, value_parser = spot_deg)]
    spot: Option<f64>,
    /// Tilt of the sample by its holder, as in `rcg measure --tilt` [default: none]
    #[arg(long, value_name = "TILT:TOWARDS[:TURN]", allow_hyphen_values = true)]
    tilt: Option<Tilt>,
    /// Write sheets for programs that show 24 patterns in a frame, in place of single pictures: sheet-00000.png and so on, colours of 8
    /// bits whose bits are patterns. ORDER names the colours of the first, second and third eight: grb (DLPC350, DLPC900), rgb or bgr
    #[arg(long, value_name = "ORDER", value_parser = Order::parse)]
    sheets: Option<Order>,
    #[command(flatten)]
    calibration: CalibrationArgs,
}

pub(crate) fn run(args: &Args, rig: &str, output: &Output) -> Done {
    let (rig, _) = args.calibration.rig(Rig::load(rig)?)?;
    let rig = rig.tilted(args.tilt)?;
    let grid = args.grid.grid(None, 15.0)?;
    let directions = Directions::new(&rig, &grid).map_err(PlanError::from)?;
    if rig.shows_bands() && args.sheets.is_some() {
        return Err(Failure::input(format!(
            "--sheets: expected patterns in white, as a bit has no colour, found rig {}, whose projector makes the bands",
            rig.name
        )));
    }
    Measurement::check_new(&args.out)?;
    let _lock = Lock::folder(&args.out)?;
    Measurement::check_new(&args.out)?;
    let request = Request {
        grid: grid.clone(),
        spot_deg: args.spot,
        ..Request::default()
    };
    let spot_deg = request.spot_deg(&rig);
    let maker = PatternMaker::new(View::projector(&rig), spot_deg, rig.projector.irradiance);
    let (width, height) = maker.size_px();
    let mut image = BitPattern::black(width, height);
    let measurable: Vec<usize> = directions.measurable().collect();
    let mut table =
        "index,theta_deg,phi_deg,pixels,solid_angle_sr,irradiance,centroid_theta_deg,centroid_phi_deg"
            .to_owned();
    table += if args.sheets.is_some() {
        ",sheet,plane\n"
    } else {
        "\n"
    };
    output.begin("patterns", measurable.len(), "patterns");
    let mut pictures = Pictures {
        out: &args.out,
        sheets: args.sheets,
        bands: rig.shown_bands(),
        waiting: Vec::new(),
        written: 0,
    };
    for (done, &index) in measurable.iter().enumerate() {
        let Ok(lit) = maker.lit_set(directions.grid.direction(index)) else {
            continue;
        };
        let (theta_deg, phi_deg) = directions.grid.angles_deg(index);
        let (lit_theta_deg, lit_phi_deg) = rcg::hemisphere::direction::to_degrees(lit.centroid);
        write!(
            table,
            "{index},{theta_deg},{phi_deg},{},{:.8e},{:.8e},{:.5},{:.5}",
            lit.pixels.len(),
            lit.solid_angle_sr,
            lit.irradiance,
            lit_theta_deg,
            // What is written as 360.00000 is 0.
            (lit_phi_deg * 1e5).round() / 1e5 % 360.0
        )
        .expect("strings take everything");
        table += &pictures.place();
        image.clear();
        image.light(&lit.pixels);
        pictures.add(index, &image)?;
        output.reach(done + 1);
    }
    pictures.end()?;
    let written = pictures.written;
    // The table comes last: a directory that has it is whole.
    write_whole(&args.out.join("patterns.csv"), table.as_bytes())?;
    output.end();
    let value = json!({
        "out": args.out, "patterns": written, "width_px": width, "height_px": height, "spot_deg": spot_deg,
    });
    output.print(&value, || {
        format!(
            "{written} patterns of {width}×{height} pixels: {}\n",
            args.out.display()
        )
    })
}

/// The pictures that are written.
struct Pictures<'a> {
    out: &'a Path,
    sheets: Option<Order>,
    /// Primaries that each is shown in, 1 for white.
    bands: usize,
    /// Patterns of the next sheet.
    waiting: Vec<BitPattern>,
    /// Patterns that were added.
    written: usize,
}

impl Pictures<'_> {
    /// The end of the line of the next pattern in the table: where it is, if that is a sheet.
    fn place(&self) -> String {
        match self.sheets {
            Some(_) => format!(",{},{}\n", self.written / PLANES, self.written % PLANES),
            None => "\n".to_owned(),
        }
    }

    /// Writes the pattern of direction `index`, or lets it wait for its sheet.
    fn add(&mut self, index: usize, pattern: &BitPattern) -> Result<(), PictureError> {
        self.written += 1;
        if self.bands > 1 {
            let mut shown = pattern.clone();
            return (0..self.bands).try_for_each(|band| {
                shown.set_primary(Some(band as u8));
                let path = self.out.join(format!("pattern-{index:05}-{}.png", band + 1));
                save(&shown.to_coloured(), &path)
            });
        }
        if self.sheets.is_none() {
            let path = self.out.join(format!("pattern-{index:05}.png"));
            return save(&pattern.to_image(), &path);
        }
        self.waiting.push(pattern.clone());
        if self.waiting.len() == PLANES {
            self.end()?;
        }
        Ok(())
    }

    /// Writes the sheet of what still waits.
    fn end(&mut self) -> Result<(), PictureError> {
        let Some(order) = self.sheets.filter(|_| !self.waiting.is_empty()) else {
            return Ok(());
        };
        let number = (self.written - 1) / PLANES;
        let path = self.out.join(format!("sheet-{number:05}.png"));
        save(&sheet(&std::mem::take(&mut self.waiting), order), &path)
    }
}
