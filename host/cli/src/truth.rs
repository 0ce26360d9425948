//! `rcg truth`

use std::path::PathBuf;

use rcg::base::file_format::TRUTH;
use rcg::instrument::rig::Rig;
use rcg::store::whole_file::write_whole;
use rcg::virtual_rig::{Flaws, PixelTolerances, Tolerances, Truth};
use serde_json::json;

use crate::Done;
use crate::failure::Failure;
use crate::output::{Output, to_write};

/// Draw by chance how a virtual rig really is, where it differs from its rig file.
///
/// Camera, projector, sample and mirror are displaced and turned, lenses distorted, the mirror is no ellipsoid; light and
/// throughput are not uniform; black is not black, the camera not quite linear, its pixels differ, the light is not steady; glare,
/// the beam splitter's ghost and direct light come on top. Measurements and calibrations with `--truth FILE` are taken on that
/// rig and are not told.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// The file to write (TOML)
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// How large flaws are that no other option says: drawn between good and bad, as usual, or as bad as one meets them
    #[arg(long, value_enum, value_name = "SIZE", default_value_t = Size::Drawn)]
    flaws: Size,
    /// Standard deviation of each coordinate of a position, millimetres [default: 0.5; 3 with --flaws bad]
    #[arg(long, value_name = "MM", allow_negative_numbers = true)]
    position_mm: Option<f64>,
    /// Standard deviation of each angle, degrees [default: 0.3; 2 with --flaws bad]
    #[arg(long, value_name = "DEG", allow_negative_numbers = true)]
    angle_deg: Option<f64>,
    /// Light and throughput each vary by plus and minus this many percent
    #[arg(long, value_name = "PERCENT", default_value_t = 30.0)]
    field_percent: f64,
    /// Light of a lit projector pixel over that of a black one [default: drawn between 400 and 3000; 1500 or 400]
    #[arg(long, value_name = "RATIO", allow_negative_numbers = true)]
    contrast: Option<f64>,
    /// Light that is thrown aside on the way to the camera, percent [default: drawn between 0.1 and 1; 0.3 or 1]
    #[arg(long, value_name = "PERCENT", allow_negative_numbers = true)]
    glare_percent: Option<f64>,
    /// Light of the beam splitter's ghost over that of the image, percent [default: drawn between 0.5 and 4; 1 or 4]
    #[arg(long, value_name = "PERCENT", allow_negative_numbers = true)]
    ghost_percent: Option<f64>,
    /// Change of the light in an hour, percent [default: drawn between 0.2 and 2; 0.5 or 2]
    #[arg(long, value_name = "PERCENT", allow_negative_numbers = true)]
    drift_percent: Option<f64>,
    /// Standard deviation of the light from exposure to exposure, percent [default: drawn between 0.05 and 0.5; 0.1 or 0.5]
    #[arg(long, value_name = "PERCENT", allow_negative_numbers = true)]
    flicker_percent: Option<f64>,
    /// By how much the light of the projector's pupil is dimmer at its edge than in its middle, percent; what it lights of the
    /// sample is its image [default: drawn between 2 and 20; 5 or 20]
    #[arg(long, value_name = "PERCENT", allow_negative_numbers = true)]
    falloff_percent: Option<f64>,
    /// RMS of the slopes by which the mirror is no ellipsoid, milliradians [default: drawn between 0.05 and 0.5; 0.15 or 0.5]
    #[arg(long, value_name = "MRAD", allow_negative_numbers = true)]
    figure_mrad: Option<f64>,
    /// Light at the full well that the camera does not show because its response bends near it, percent [default: drawn between
    /// 0.3 and 3; 1 or 3]
    #[arg(long, value_name = "PERCENT", allow_negative_numbers = true)]
    knee_percent: Option<f64>,
    /// Charge that a green pixel of the camera's mosaic loses to its neighbours, red and blue ones, percent [default: drawn between
    /// 0.5 and 3; 1 or 3]
    #[arg(long, value_name = "PERCENT", allow_negative_numbers = true)]
    crosstalk_percent: Option<f64>,
    /// Share of a change of light that is left when a new pattern counts as settled, of projectors with liquid crystals, percent
    /// [default: drawn between 0.2 and 2; 0.5 or 2]
    #[arg(long, value_name = "PERCENT", allow_negative_numbers = true)]
    lag_percent: Option<f64>,
    /// How far the projector's light is polarised, and how far the camera prefers polarised light, behind depolarisers, percent
    /// [default: drawn between 0.2 and 2 each; 0.5 or 2]
    #[arg(long, value_name = "PERCENT", allow_negative_numbers = true)]
    polarisation_percent: Option<f64>,
    /// Standard deviation of the height at which whatever is put into the holder, or tilted, comes to lie, millimetres; over 0.1 m that
    /// of how it leans [default: drawn between 0.02 and 0.1; 0.05 or 0.1]
    #[arg(long, value_name = "MM", allow_negative_numbers = true)]
    seating_mm: Option<f64>,
    /// Standard deviation of how far the flat mirror leans from the tilt that was set, in its plane and across it, degrees [default:
    /// drawn between 0.01 and 0.05; 0.025 or 0.05]
    #[arg(long, value_name = "DEG", allow_negative_numbers = true)]
    mirror_deg: Option<f64>,
    /// Standard deviation of where the light of a projector pixel goes, by defocus and leaks into its neighbours, projector pixels
    /// [default: drawn between 0.3 and 0.8; 0.4 or 0.8]
    #[arg(long, value_name = "PX", allow_negative_numbers = true)]
    blur_px: Option<f64>,
    /// Standard deviation over the sensor's pixels of what each shows of the same light, percent; how their dark signals
    /// differ is drawn along [default: drawn between 0.2 and 1; 0.5 or 1]
    #[arg(long, value_name = "PERCENT", allow_negative_numbers = true)]
    prnu_percent: Option<f64>,
    /// Standard deviation of what all pixels of a row of the sensor have in common in one frame, electrons [default: drawn
    /// between 0.1 and 1; 0.3 or 1]
    #[arg(long, value_name = "E", allow_negative_numbers = true)]
    row_noise_e: Option<f64>,
    /// Standard deviation of what the camera's black level is off by over the hours, electrons [default: drawn between 0.1 and 1;
    /// 0.3 or 1]
    #[arg(long, value_name = "E", allow_negative_numbers = true)]
    wander_e: Option<f64>,
    /// Standard deviation of the reflectance of each standard from what is stated, percent
    #[arg(
        long,
        value_name = "PERCENT",
        default_value_t = 0.25,
        allow_negative_numbers = true
    )]
    standard_percent: f64,
    /// Flaws that are left out, to see what each of them does
    #[arg(long, value_name = "FLAW,...", value_delimiter = ',')]
    without: Vec<Flaw>,
    /// Seed of the draw
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
}

/// How large flaws are.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Size {
    Drawn,
    Typical,
    Bad,
}

impl Size {
    /// What of three is meant: nothing where it is to be drawn.
    fn pick(self, typical: f64, bad: f64) -> Option<f64> {
        match self {
            Self::Drawn => None,
            Self::Typical => Some(typical),
            Self::Bad => Some(bad),
        }
    }
}

/// What can be left out of a truth.
#[derive(Clone, Copy, Debug, clap::ValueEnum)]
enum Flaw {
    /// Poses, lenses, mirror and sample are as the rig file says
    Pose,
    /// The light is uniform over the projector's image
    Intensity,
    /// The throughput is uniform over the camera's image
    Throughput,
    /// Black projector pixels are black
    BlackLight,
    /// The projector's levels are linear
    Gamma,
    /// The camera is linear
    Nonlinearity,
    /// The camera's response does not bend near its full well
    Knee,
    /// No charge leaks from one colour to another
    Crosstalk,
    /// Nothing is left of the pattern before
    Lag,
    /// Light is not polarised
    Polarisation,
    /// No light returns onto the sample
    Interreflection,
    /// The standards reflect what is stated
    Standards,
    /// No light is thrown aside
    Glare,
    /// The beam splitter shows no second image
    Ghost,
    /// No light goes from the projector to the camera without the sample
    DirectLight,
    /// The light does not change over time
    Drift,
    /// The light is the same in every exposure
    Flicker,
    /// The camera's pixels are alike, and none is hot; rows have no noise of their own
    Pixels,
    /// All of the sample is lit, and a point of it seen
    Pupils,
    /// The mirror is an ellipsoid
    Figure,
    /// Samples and standards lie as they should
    Seating,
    /// The flat mirror stands as it was set
    MirrorTilt,
    /// The projector's image is sharp
    Focus,
    /// The camera's black level stays
    Wander,
}

impl Flaw {
    fn leave_out(self, truth: &mut Truth, rig: &Rig) {
        let none = Flaws::default();
        let flaws = &mut truth.flaws;
        match self {
            Self::Pose => {
                // Light and camera are no poses.
                let true_rig = &truth.rig;
                let mut posed = rig.clone();
                posed.light.clone_from(&true_rig.light);
                posed.camera.read_noise_e = true_rig.camera.read_noise_e;
                posed.camera.full_well_e = true_rig.camera.full_well_e;
                truth.rig = posed;
            }
            Self::Intensity => flaws.intensity = none.intensity,
            Self::Throughput => flaws.throughput = none.throughput,
            Self::BlackLight => (flaws.black_level, flaws.black) = (none.black_level, none.black),
            Self::Gamma => flaws.gamma = none.gamma,
            Self::Nonlinearity => flaws.nonlinearity = none.nonlinearity,
            Self::Knee => flaws.knee = none.knee,
            Self::Crosstalk => flaws.crosstalk = none.crosstalk,
            Self::Lag => flaws.lag = none.lag,
            Self::Polarisation => flaws.polarisation = none.polarisation,
            Self::Interreflection => flaws.interreflection = none.interreflection,
            Self::Standards => flaws.standards = none.standards,
            Self::Glare => flaws.glare = none.glare,
            Self::Ghost => flaws.ghost = none.ghost,
            Self::DirectLight => flaws.direct = none.direct,
            Self::Drift => flaws.lamp.drift_per_h = none.lamp.drift_per_h,
            Self::Flicker => flaws.lamp.flicker = none.lamp.flicker,
            Self::Pixels => flaws.pixels = none.pixels,
            Self::Pupils => flaws.pupils = none.pupils,
            Self::Figure => flaws.figure = none.figure,
            Self::Seating => flaws.seating.height_m = none.seating.height_m,
            Self::MirrorTilt => flaws.seating.mirror_deg = none.seating.mirror_deg,
            Self::Focus => flaws.focus = none.focus,
            Self::Wander => flaws.pixels.wander_e = 0.0,
        }
    }
}

/// Refuses what is out of range.
fn check(args: &Args) -> Done {
    let given: [(&str, Option<f64>, f64, f64); 21] = [
        ("position-mm", args.position_mm, 0.0, 10.0),
        ("angle-deg", args.angle_deg, 0.0, 10.0),
        ("field-percent", Some(args.field_percent), 0.0, 90.0),
        ("standard-percent", Some(args.standard_percent), 0.0, 10.0),
        ("contrast", args.contrast, 10.0, 1e9),
        ("glare-percent", args.glare_percent, 0.0, 50.0),
        ("ghost-percent", args.ghost_percent, 0.0, 50.0),
        ("drift-percent", args.drift_percent, 0.0, 20.0),
        ("flicker-percent", args.flicker_percent, 0.0, 10.0),
        ("falloff-percent", args.falloff_percent, 0.0, 100.0),
        ("crosstalk-percent", args.crosstalk_percent, 0.0, 20.0),
        ("lag-percent", args.lag_percent, 0.0, 50.0),
        ("polarisation-percent", args.polarisation_percent, 0.0, 50.0),
        ("knee-percent", args.knee_percent, 0.0, 20.0),
        ("figure-mrad", args.figure_mrad, 0.0, 10.0),
        ("seating-mm", args.seating_mm, 0.0, 10.0),
        ("mirror-deg", args.mirror_deg, 0.0, 10.0),
        ("prnu-percent", args.prnu_percent, 0.0, 10.0),
        ("row-noise-e", args.row_noise_e, 0.0, 100.0),
        ("blur-px", args.blur_px, 0.0, 10.0),
        ("wander-e", args.wander_e, 0.0, 1000.0),
    ];
    for (name, found, low, high) in given {
        if let Some(found) = found
            && !(low..=high).contains(&found)
        {
            return Err(Failure::input(format!(
                "--{name}: expected a number from {low} to {high}, found {found}"
            )));
        }
    }
    Ok(())
}

/// The tolerances from which a truth of `rig` is drawn.
fn tolerances(args: &Args, rig: &Rig) -> Tolerances {
    let [position_mm, angle_deg] = match args.flaws {
        Size::Bad => [3.0, 2.0],
        Size::Drawn | Size::Typical => [0.5, 0.3],
    };
    // What is given in a unit that is so large, or what is usual and bad.
    let of = |given: Option<f64>, unit: f64, typical: f64, bad: f64| {
        given.map(|found| found * unit).or(args.flaws.pick(typical, bad))
    };
    let share = |percent: Option<f64>, typical: f64, bad: f64| of(percent, 1e-2, typical, bad);
    Tolerances {
        position_m: args.position_mm.unwrap_or(position_mm) * 1e-3,
        angle_deg: args.angle_deg.unwrap_or(angle_deg),
        field: args.field_percent / 100.0,
        contrast: of(
            args.contrast,
            1.0,
            rig.projector.contrast.unwrap_or(1500.0),
            400.0,
        ),
        glare: share(args.glare_percent, 3e-3, 1e-2),
        ghost: share(args.ghost_percent, 1e-2, 4e-2),
        drift: share(args.drift_percent, 5e-3, 2e-2),
        flicker: share(args.flicker_percent, 1e-3, 5e-3),
        falloff: share(args.falloff_percent, 5e-2, 2e-1),
        crosstalk: share(args.crosstalk_percent, 1e-2, 3e-2),
        lag: share(args.lag_percent, 5e-3, 2e-2),
        polarisation: share(args.polarisation_percent, 5e-3, 2e-2),
        knee: share(args.knee_percent, 1e-2, 3e-2),
        figure_rad: of(args.figure_mrad, 1e-3, 1.5e-4, 5e-4),
        seating_m: of(args.seating_mm, 1e-3, 5e-5, 1e-4),
        mirror_deg: of(args.mirror_deg, 1.0, 0.025, 0.05),
        blur_px: of(args.blur_px, 1.0, 0.4, 0.8),
        standard: args.standard_percent / 100.0,
        direct: args.flaws.pick(7e-4, 3e-3),
        pixels: PixelTolerances {
            prnu: share(args.prnu_percent, 5e-3, 1e-2),
            dsnu_e: args.flaws.pick(1.0, 3.0),
            hot: args.flaws.pick(1e-4, 1e-3),
            row_noise_e: of(args.row_noise_e, 1.0, 0.3, 1.0),
            wander_e: of(args.wander_e, 1.0, 0.3, 1.0),
        },
    }
}

pub(crate) fn run(args: &Args, rig: &str, output: &Output) -> Done {
    check(args)?;
    let rig = Rig::load(rig)?;
    to_write(&args.out, TRUTH)?;
    let mut truth = Truth::drawn(&rig, tolerances(args, &rig), args.seed)?;
    for flaw in &args.without {
        flaw.leave_out(&mut truth, &rig);
    }
    write_whole(&args.out, truth.to_toml().as_bytes())?;
    output.print(&json!({ "out": args.out, "truth": truth }), || {
        format!("{}\n", args.out.display())
    })
}
