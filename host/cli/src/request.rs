//! Arguments that say what is measured.

use std::fmt::Display;
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use rcg::hemisphere::incident::Grid;
use rcg::instrument::calibration::Calibration;
use rcg::instrument::rig::{Rig, Tilt};
use rcg::plan::brackets::Brackets;
use rcg::plan::light::Light;
use rcg::plan::schedule::EXPOSURES_S;
use rcg::plan::{Faults, IMAGE_SIZES_PX, PlanError, Request, SPOTS_DEG, Virtual};
use rcg::virtual_rig::setup::TriggerBox;

use crate::failure::Failure;

/// Incident directions.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct GridArgs {
    /// Incident directions: theta-phi (rings of equally many), equal-solid-angle (rings of directions that are at most
    /// a step apart), or a text file of lines `θ φ` in degrees [default: theta-phi]
    #[arg(long, value_name = "theta-phi|equal-solid-angle|FILE")]
    grid: Option<String>,
    /// Degrees between rings of incident directions; must divide 90 [default: 3; 15 for patterns]
    #[arg(long, value_name = "DEG", allow_negative_numbers = true)]
    step: Option<f64>,
}

impl GridArgs {
    /// The incident directions if any were asked for.
    pub(crate) fn given(&self) -> Result<Option<Grid>, Failure> {
        let is_given = self.grid.is_some() || self.step.is_some();
        is_given.then(|| self.grid(None, 3.0)).transpose()
    }

    /// The incident directions: what is not given is as in `before`, or a θ × φ grid of `default_step_deg`.
    pub(crate) fn grid(&self, before: Option<&Grid>, default_step_deg: f64) -> Result<Grid, Failure> {
        let step_deg = self
            .step
            .or_else(|| before.and_then(Grid::step_deg))
            .unwrap_or(default_step_deg);
        let kind = self.grid.as_deref().or_else(|| before.map(Grid::kind));
        let list = match (kind, before) {
            (None | Some("theta-phi"), _) => return Ok(Grid::ThetaPhi { step_deg }),
            (Some("equal-solid-angle"), _) => return Ok(Grid::EqualSolidAngle { step_deg }),
            (Some(_), Some(before)) if self.grid.is_none() => before.clone(),
            (Some(file), _) => Grid::read_list(Path::new(file)).map_err(PlanError::from)?,
        };
        match self.step {
            None => Ok(list),
            Some(step_deg) => Err(Failure::input(format!(
                "--step: expected none with a list of directions, found {step_deg}"
            ))),
        }
    }
}

/// What is measured. An argument that is not given has its default, or on `--resume` the value of before.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct RequestArgs {
    #[command(flatten)]
    grid: GridArgs,
    /// Camera image and outgoing grid: pixels a side [default: 96]
    #[arg(long, value_name = "N", value_parser = image_size)]
    image_size: Option<u32>,
    /// Exposure time in milliseconds [default: found by a pilot capture]
    #[arg(long, value_name = "MS", allow_negative_numbers = true, value_parser = exposure_ms)]
    exposure_ms: Option<f64>,
    /// Opening of the cone that each pattern lights, degrees: the wider, the more light beside that of the black pixels, and
    /// the more blur; auto lets a pilot capture choose it [default: that of the rig, but no wider than the step]
    #[arg(long, value_name = "DEG|auto", allow_negative_numbers = true, value_parser = spot)]
    spot: Option<Spot>,
    /// Exposures of each pattern, merged for high dynamic range: as many as a pilot capture proposes (auto), so many of
    /// its choice, or these times in milliseconds [default: 1]
    #[arg(long, value_name = "auto|N|MS,MS,...", allow_hyphen_values = true)]
    brackets: Option<Brackets>,
    /// How light is made: one direction per pattern (single), codes that light many directions at once, from which what each
    /// shows is computed (multiplexed, or complement with every pattern inverted too; multiplexed:63 lights blocks of at most 63
    /// directions), or what a pilot capture finds to leave the least noise in the same time (auto) [default: single]
    #[arg(long, value_name = "single|multiplexed|complement|auto")]
    light: Option<Light>,
    /// Fuse each pixel with what its surroundings say of it, where the image is smooth: less noise, at the price of computing; its
    /// standard uncertainty says by how much [default: off]
    #[arg(long, value_name = "on|off", value_parser = ["on", "off"])]
    estimate: Option<String>,
    /// Tilt of the sample by its holder, about the sample's centre: the normal leans by TILT towards the azimuth TOWARDS of
    /// the untilted sample, the sample is turned by TURN about it, degrees; for captures that `rcg fill` merges [default:
    /// none]
    #[arg(long, value_name = "TILT:TOWARDS[:TURN]", allow_hyphen_values = true)]
    tilt: Option<Tilt>,
    /// Keep every bit of f and its standard uncertainty, in a brdf.zarr of about three times the size [default: f is rounded by at most a
    /// tenth of its standard uncertainty]
    #[arg(long)]
    lossless: bool,
    /// What you call the sample, for the report [default: as --sample]
    #[arg(long, value_name = "TEXT", value_parser = words)]
    sample_name: Option<String>,
    /// What else there is to say of the sample: batch, finish, how it lies in the holder
    #[arg(long, value_name = "TEXT", value_parser = words)]
    sample_description: Option<String>,
}

/// The heading in the help of what concerns the virtual rig alone.
const VIRTUAL: &str = "Virtual rig";

/// The virtual rig and what stands in it. An argument that is not given has its default, or on `--resume` the value of
/// before.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct VirtualArgs {
    /// What the virtual rig measures: lambert:0.5, lambert:0.6,0.3,0.06 (red, green, blue), ward:brass,
    /// ward:rd=0.1,rs=0.33,ax=0.05,ay=0.16, ggx:satin, velvet, satin, or a measured .bsdf file [default: ward:brass]
    #[arg(long, value_name = "SAMPLE", help_heading = VIRTUAL)]
    sample: Option<String>,
    #[command(flatten)]
    conditions: ConditionArgs,
}

/// How the virtual rig really is, whatever stands in it.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct ConditionArgs {
    /// How the virtual rig really is: a file that `rcg truth` writes [default: as the rig file says]
    #[arg(long, value_name = "FILE", help_heading = VIRTUAL)]
    truth: Option<String>,
    /// Switch shot and read noise of the virtual rig on or off [default: on]
    #[arg(long, value_name = "on|off", value_parser = ["on", "off"], help_heading = VIRTUAL)]
    noise: Option<String>,
    /// Seed of all chance of the virtual rig [default: 1]
    #[arg(long, value_name = "N", help_heading = VIRTUAL)]
    seed: Option<u64>,
    #[command(flatten)]
    faults: FaultArgs,
}

/// What goes wrong on the virtual rig on purpose.
#[derive(Clone, Copy, Debug, clap::Args)]
pub(crate) struct FaultArgs {
    /// Share of triggers that the virtual camera ignores, on purpose [default: 0]
    #[arg(long, value_name = "RATE", value_parser = rate, help_heading = VIRTUAL)]
    missed_triggers: Option<f64>,
    /// Share of frames that are lost on the way from the virtual camera, on purpose [default: 0]
    #[arg(long, value_name = "RATE", value_parser = rate, help_heading = VIRTUAL)]
    dropped_frames: Option<f64>,
    /// Share of frames that arrive twice from the virtual camera, on purpose [default: 0]
    #[arg(long, value_name = "RATE", value_parser = rate, help_heading = VIRTUAL)]
    doubled_frames: Option<f64>,
}

impl VirtualArgs {
    /// Lets this `sample` stand in the virtual rig, if one is named.
    pub(crate) fn hold(&mut self, sample: Option<&String>) {
        if sample.is_some() {
            self.sample = sample.cloned();
        }
    }

    /// Refuses what is asked for of the virtual rig where `rig` is a real one.
    pub(crate) fn check(&self, rig: &Rig) -> Result<(), Failure> {
        if self.sample.is_some() && rig.is_real() {
            return Err(Failure::input(format!(
                "--sample: expected nothing of the virtual rig beside rig {}, whose camera and projector are real (--sample-name \
                 says what you call the sample)",
                rig.name
            )));
        }
        self.conditions.check(rig)
    }

    /// The virtual rig, with that of `before` in place of the defaults if there is one.
    pub(crate) fn virtual_rig(&self, before: Option<&Virtual>) -> Virtual {
        let mut asked = self.conditions.virtual_rig(before);
        if let Some(sample) = &self.sample {
            asked.sample.clone_from(sample);
        }
        asked.located()
    }
}

impl ConditionArgs {
    /// Refuses what is asked for of the virtual rig where `rig` is a real one.
    pub(crate) fn check(&self, rig: &Rig) -> Result<(), Failure> {
        match self.given().filter(|_| rig.is_real()) {
            None => Ok(()),
            Some(option) => Err(Failure::input(format!(
                "{option}: expected nothing of the virtual rig beside rig {}, whose camera and projector are real",
                rig.name
            ))),
        }
    }

    /// The first of these arguments that is given.
    fn given(&self) -> Option<&'static str> {
        first_given(&[
            ("--truth", self.truth.is_some()),
            ("--noise", self.noise.is_some()),
            ("--seed", self.seed.is_some()),
        ])
        .or_else(|| self.faults.given())
    }

    /// The virtual rig, with that of `before` in place of the defaults if there is one.
    pub(crate) fn virtual_rig(&self, before: Option<&Virtual>) -> Virtual {
        let before = before.cloned().unwrap_or_default();
        Virtual {
            truth: self.truth.clone().or(before.truth),
            noise: self.noise.as_ref().map_or(before.noise, |noise| noise == "on"),
            seed: self.seed.unwrap_or(before.seed),
            faults: self.faults.faults(before.faults),
            sample: before.sample,
        }
    }
}

/// The first of these options that is given.
fn first_given(options: &[(&'static str, bool)]) -> Option<&'static str> {
    options
        .iter()
        .find(|(_, is_given)| *is_given)
        .map(|(option, _)| *option)
}

impl FaultArgs {
    /// The first of these arguments that is given.
    pub(crate) fn given(self) -> Option<&'static str> {
        first_given(&[
            ("--missed-triggers", self.missed_triggers.is_some()),
            ("--dropped-frames", self.dropped_frames.is_some()),
            ("--doubled-frames", self.doubled_frames.is_some()),
        ])
    }

    /// The faults, those of `before` where none is given.
    pub(crate) fn faults(self, before: Faults) -> Faults {
        Faults {
            missed_triggers: self.missed_triggers.unwrap_or(before.missed_triggers),
            dropped_frames: self.dropped_frames.unwrap_or(before.dropped_frames),
            doubled_frames: self.doubled_frames.unwrap_or(before.doubled_frames),
        }
    }
}

/// What is known of the instrument.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct CalibrationArgs {
    /// Take the calibration in this directory into account; it must be one of the rig; none takes the rig to be as its file says
    /// [default: none; for `measure` with --truth, which calibrates that virtual rig first, the result of that, kept for further runs]
    #[arg(
        long,
        value_name = "DIR|none",
        env = "RCG_CALIBRATION",
        hide_env_values = true
    )]
    calibration: Option<PathBuf>,
}

/// In place of a directory: no calibration.
pub(crate) const NO_CALIBRATION: &str = "none";

impl CalibrationArgs {
    /// Its directory, if one was given.
    pub(crate) fn dir(&self) -> Option<&Path> {
        let given = self.calibration.as_deref();
        given.filter(|given| *given != Path::new(NO_CALIBRATION))
    }

    /// These, or the calibration in `dir` where nothing was said of one.
    pub(crate) fn or(&self, dir: Option<PathBuf>) -> Self {
        Self {
            calibration: self.calibration.clone().or(dir),
        }
    }

    /// Whether nothing was said of a calibration.
    pub(crate) fn is_open(&self) -> bool {
        self.calibration.is_none()
    }

    /// The rig to measure with: `rig`, or what the calibration made of it, and the calibration.
    pub(crate) fn rig(&self, rig: Rig) -> Result<(Rig, Option<Calibration>), Failure> {
        let Some(dir) = self.dir() else {
            return Ok((rig, None));
        };
        let calibration = Calibration::open(dir, &rig)?;
        Ok((
            calibration.rig.driven_as(&rig).with_bands_of(&rig),
            Some(calibration),
        ))
    }
}

impl RequestArgs {
    /// Takes over what a sample is called, and what else there is to say of it, where there is something.
    pub(crate) fn name(&mut self, name: Option<&String>, description: Option<&String>) {
        self.sample_name = name.or(self.sample_name.as_ref()).cloned();
        self.sample_description = description.or(self.sample_description.as_ref()).cloned();
    }

    /// Whether a pilot capture is to choose the spot.
    pub(crate) fn is_spot_auto(&self) -> bool {
        self.spot == Some(Spot::Auto)
    }

    /// The incident directions if any were asked for.
    pub(crate) fn given_grid(&self) -> Result<Option<Grid>, Failure> {
        self.grid.given()
    }

    /// The request, with `before` in place of the defaults if there is one.
    pub(crate) fn request(&self, before: Option<&Request>) -> Result<Request, Failure> {
        if let (Some(ms), Some(brackets)) = (self.exposure_ms, &self.brackets)
            && !brackets.is_one()
        {
            return Err(Failure::input(format!(
                "--exposure-ms: expected none beside --brackets {brackets}, which says how long each exposure of a pattern \
                 is (all times can be given there), found {ms}"
            )));
        }
        let before = before.cloned().unwrap_or_default();
        Ok(Request {
            grid: self.grid.grid(Some(&before.grid), 3.0)?,
            image_size: self.image_size.unwrap_or(before.image_size),
            exposure_s: match (self.exposure_ms, &self.brackets) {
                (Some(ms), _) => Some(ms * 1e-3),
                (None, Some(brackets)) if !brackets.is_one() => None,
                (None, _) => before.exposure_s,
            },
            brackets: match (&self.brackets, self.exposure_ms) {
                (Some(brackets), _) => brackets.clone(),
                (None, Some(_)) => Brackets::One,
                (None, None) => before.brackets,
            },
            spot_deg: match self.spot {
                None => before.spot_deg,
                Some(Spot::Auto) => None,
                Some(Spot::Deg(deg)) => Some(deg),
            },
            spot_auto: self.spot.map_or(before.spot_auto, |spot| spot == Spot::Auto),
            light: self.light.unwrap_or(before.light),
            estimate: self
                .estimate
                .as_ref()
                .map_or(before.estimate, |estimate| estimate == "on"),
            tilt: self.tilt.or(before.tilt),
            lossless: self.lossless || before.lossless,
            sample_name: self.sample_name.clone().or(before.sample_name),
            sample_description: self.sample_description.clone().or(before.sample_description),
            reference: before.reference,
        })
    }
}

/// Where the trigger box is.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct PortArgs {
    /// Port of the trigger box (/dev/ttyACM0, COM3), auto to look for it on USB, or sim for the simulated one, with the virtual
    /// rig [default: that of a real rig's file; sim for the virtual rig]
    #[arg(long, value_name = "PORT")]
    port: Option<String>,
    /// Where the lines of that trigger box end, if it drives the virtual rig: a bridge that tells its edges and takes SYNC and
    /// STROBE
    #[arg(long, value_name = "HOST:PORT")]
    wires: Option<String>,
}

impl PortArgs {
    /// The `rig` with its trigger box where it is said to be, if it is a real one.
    pub(crate) fn real(&self, rig: Rig) -> Result<Rig, Failure> {
        if !rig.is_real() {
            return Ok(rig);
        }
        if let Some(wires) = &self.wires {
            return Err(Failure::input(format!(
                "--wires {wires}: expected none beside rig {}, whose camera and projector are real",
                rig.name
            )));
        }
        match self.port.as_deref() {
            None => Ok(rig),
            Some("sim") => Err(Failure::input(format!(
                "--port sim: expected the port of a trigger box beside rig {}, whose camera and projector are real",
                rig.name
            ))),
            Some(port) => Ok(rig.at_port(port)),
        }
    }

    /// As [`bridged`](Self::bridged) for a virtual `rig`; a real one names its own.
    pub(crate) fn trigger_box(&self, rig: &Rig) -> Result<Option<TriggerBox>, Failure> {
        if rig.is_real() { Ok(None) } else { self.bridged() }
    }

    /// The trigger box outside of this program that drives a virtual rig, if one is asked for.
    pub(crate) fn bridged(&self) -> Result<Option<TriggerBox>, Failure> {
        match (self.port.as_deref().unwrap_or("sim"), &self.wires) {
            ("sim", None) => Ok(None),
            ("sim", Some(wires)) => Err(Failure::input(format!(
                "--wires {wires}: expected the --port of the trigger box that they belong to, found the simulated one, \
                 which needs no wires"
            ))),
            (port, None) => Err(Failure::input(format!(
                "--port {port}: expected --wires HOST:PORT beside it, found none: the virtual rig has to be told of its edges \
                 (leave --port away to simulate the trigger box too, or name the drivers of a real camera and projector in \
                 the rig file)"
            ))),
            (port, Some(wires)) => Ok(Some(TriggerBox {
                port: port.to_owned(),
                wires: wires.clone(),
            })),
        }
    }
}

/// Pixels a side of an image.
pub(crate) fn image_size(text: &str) -> Result<u32, String> {
    number_of(text, "pixels", &IMAGE_SIZES_PX)
}

/// A number of `unit` within `range`.
fn number_of<T>(text: &str, unit: &str, range: &RangeInclusive<T>) -> Result<T, String>
where
    T: FromStr + PartialOrd + Display,
{
    let found = text.parse().ok().filter(|number| range.contains(number));
    found.ok_or_else(|| {
        format!(
            "expected a number of {unit} from {} to {}",
            range.start(),
            range.end()
        )
    })
}

/// An exposure time in milliseconds.
pub(crate) fn exposure_ms(text: &str) -> Result<f64, String> {
    let [low_ms, high_ms] = [EXPOSURES_S.start(), EXPOSURES_S.end()].map(|s| s * 1e3);
    match text.parse() {
        Ok(ms) if EXPOSURES_S.contains(&(ms * 1e-3)) => Ok(ms),
        _ => Err(format!(
            "expected a number of milliseconds from {low_ms} to {high_ms}"
        )),
    }
}

/// How wide the cone is that each pattern lights.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Spot {
    /// As a pilot capture says.
    Auto,
    /// This opening, degrees.
    Deg(f64),
}

fn spot(text: &str) -> Result<Spot, String> {
    if text == "auto" {
        return Ok(Spot::Auto);
    }
    spot_deg(text)
        .map(Spot::Deg)
        .map_err(|expected| format!("{expected}, or auto"))
}

/// The opening of a cone of light in degrees.
pub(crate) fn spot_deg(text: &str) -> Result<f64, String> {
    number_of(text, "degrees", &SPOTS_DEG)
}

/// Words on one line, which no terminal obeys.
pub(crate) fn words(text: &str) -> Result<String, String> {
    match text.trim() {
        words if !words.is_empty() && words.len() <= 1000 && !words.contains(char::is_control) => {
            Ok(words.to_owned())
        }
        _ => Err("expected some words on one line, of at most 1000 bytes".to_owned()),
    }
}

fn rate(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(rate) if (0.0..=1.0).contains(&rate) => Ok(rate),
        _ => Err("expected a number from 0 to 1".to_owned()),
    }
}
