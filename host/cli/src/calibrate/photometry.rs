//! `rcg calibrate photometry`

use std::path::PathBuf;
use std::time::{SystemTime, UNIX_EPOCH};

use rcg::base::date::Date;
use rcg::base::progress::Progress as _;
use rcg::brdf::sample::parse;
use rcg::calibrate::photometry::{
    ByHand, Height, NONE, Request, Said, Trust, Views, Weakness, calibrate, capture, height, standards,
    weaknesses,
};
use rcg::instrument::calibration::{CameraFound, LampFound, Photometry, RIG, Standard};
use rcg::instrument::rig::{Rig, Tilt};
use rcg::store::Lock;
use rcg::store::whole_file::write_whole;

use super::Site;
use super::hands::{HandArgs, Lines, is_stopped};
use crate::Done;
use crate::failure::Failure;
use crate::output::{Output, table};
use crate::request::{ConditionArgs, PortArgs, exposure_ms, image_size};
use crate::session::SessionArgs;

/// Find camera, projector's response, light, throughput and interreflection with reflectance standards.
///
/// Goes into the directory of a geometric calibration; without one, that of the rig as its file says is taken for the true
/// one. Writes photometry.json. Where the directory holds the captures already, they are fitted again.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// The directory of the calibration
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// The reflectance standard: its certificate (a .toml file, see `rcg standard`), a .bsdf file or a model such as lambert:0.98; captures
    /// that are there already are fitted again with it [default: as when captured, else lambert:0.98]
    #[arg(long, value_name = "SAMPLE")]
    standard: Option<String>,
    /// A second standard, darker by 0.3 or more, which shows the interreflection; none to do without [default: lambert:0.2, none
    /// for a camera whose steps are coarser than 4 times its noise, as of 8 bits]
    #[arg(long, value_name = "SAMPLE")]
    second_standard: Option<String>,
    /// Tilts at which the standard is captured too: all those of `rcg measure --tilt`, whose samples are seen in other parts
    /// of the images
    #[arg(
        long,
        value_name = "TILT:TOWARDS[:TURN],...",
        value_delimiter = ',',
        allow_hyphen_values = true
    )]
    tilts: Vec<Tilt>,
    /// Standard uncertainty (k = 1) of the reflectance of standards without a certificate, percent [default: 0.25]
    #[arg(long, value_name = "PERCENT", allow_negative_numbers = true)]
    standard_uncertainty_percent: Option<f64>,
    /// The day on which the standards are captured, or were, on which their certificates have to hold [default: today, universal
    /// time]
    #[arg(long, value_name = "YYYY-MM-DD")]
    date: Option<String>,
    /// Take a certificate that has expired too; all documents say so
    #[arg(long)]
    standard_expired: bool,
    /// Longest exposure time in milliseconds [default: the longest that does not saturate]
    #[arg(long, value_name = "MS", allow_negative_numbers = true, value_parser = exposure_ms)]
    exposure_ms: Option<f64>,
    /// Pixels a side of the camera's image [default: 96]
    #[arg(long, value_name = "N", value_parser = image_size)]
    image_size: Option<u32>,
    #[command(flatten)]
    hands: HandArgs,
    #[command(flatten)]
    conditions: ConditionArgs,
    #[command(flatten)]
    port: PortArgs,
    #[command(flatten)]
    session: SessionArgs,
}

/// What stands in the holder if nobody says, and pixels a side of its images.
const STANDARD: &str = "lambert:0.98";
const IMAGE_SIZE: u32 = 96;

pub(crate) fn run(args: &Args, rig: &str, output: &Output) -> Done {
    let Some(photometry) = calibrated(args, rig, output)? else {
        return Ok(());
    };
    let rig = Rig::load(&args.out.join(RIG).display().to_string())?;
    let summary = Summary {
        weaknesses: weaknesses(&photometry, &rig)?,
        height: height(&photometry, &rig)?,
        photometry,
    };
    output.print(&summary, || text(&summary))?;
    let warnings = summary.photometry.standards.iter().filter_map(Standard::warning);
    output.warn(&warnings.collect::<Vec<_>>());
    Ok(())
}

/// What was found; `None` if somebody who puts targets in stopped before all was captured.
pub(super) fn calibrated(args: &Args, rig: &str, output: &Output) -> Result<Option<Photometry>, Failure> {
    let trust = trust(args)?;
    let session = args.session.opening("calibrate photometry", None)?;
    let _lock = Lock::folder(&args.out)?;
    session.check(&args.out)?;
    let mut said = said(args);
    if let Some(redo) = args.hands.redo() {
        let site = Site::of(&full_rig(args, rig)?, &args.conditions, &args.port)?;
        let request = request(args, &said, rig, &trust, output)?;
        let by_hand = ByHand::open(&request, &said, &args.out, site.place(), redo)
            .map_err(|error| Failure::from(error).at(args.out.display()))?;
        // Each day is a session, however it ends.
        session.note(&args.out)?;
        let how_far = by_hand.take(site.bench().as_mut(), &mut Lines { output }, output)?;
        if is_stopped(&how_far, "photometry", &args.out, output)? {
            return Ok(None);
        }
    } else if Views::exist(&args.out) {
        output.remark(&format!(
            "{}: holds captures, which are fitted again",
            args.out.display()
        ));
    } else {
        let world = super::world(&full_rig(args, rig)?, &args.conditions, &args.port)?;
        let request = request(args, &said, rig, &trust, output)?;
        capture(&request, &args.out, &world, output)?;
        said = Said::default();
    }
    let photometry =
        calibrate(&args.out, &said, &trust).map_err(|error| Failure::from(error).at(args.out.display()))?;
    session.note(&args.out)?;
    Ok(Some(photometry))
}

/// What the arguments say of captures that are there already.
fn said(args: &Args) -> Said {
    Said {
        standard: args.standard.clone(),
        second_standard: args.second_standard.clone(),
        tilts: args.tilts.clone(),
        exposure_s: args.exposure_ms.map(|ms| ms * 1e-3),
        image_size: args.image_size,
    }
}

/// The rig of the calibration, which is `rig` if there is none yet.
fn full_rig(args: &Args, rig: &str) -> Result<Rig, Failure> {
    let kept = args.out.join(RIG);
    let full = Rig::load(&if kept.is_file() {
        kept.display().to_string()
    } else {
        rig.to_owned()
    })?;
    args.port.real(full)
}

/// What is to be captured, with the rig of the calibration, which is `rig` if there is none yet: then its file is written.
fn request(args: &Args, said: &Said, rig: &str, trust: &Trust, output: &Output) -> Result<Request, Failure> {
    let path = args.out.join(RIG);
    let is_new = !path.is_file();
    let full = full_rig(args, rig)?;
    let is_begun = Views::exist(&args.out);
    if full.is_real() && !is_begun && args.standard.is_none() {
        return Err(Failure::input(format!(
            "--standard: expected what is known of the standard (its certificate, or a model such as lambert:0.98) with the real rig {}, \
             found none",
            full.name
        )));
    }
    let request = Request {
        standard: args.standard.clone().unwrap_or_else(|| STANDARD.to_owned()),
        second_standard: (!is_begun)
            .then(|| second_standard(args, &full, output))
            .flatten(),
        tilts: args.tilts.clone(),
        exposure_s: said.exposure_s,
        image_size: args.image_size.unwrap_or(IMAGE_SIZE),
    };
    if !is_begun {
        for standard in std::iter::once(&request.standard).chain(&request.second_standard) {
            parse(standard)?;
        }
        let both = (request.standard.as_str(), request.second_standard.as_deref());
        standards(both, full.channels(), trust)?;
    }
    if is_new {
        write_whole(&path, full.to_toml().as_bytes())?;
    }
    Ok(request)
}

/// How far standards are trusted.
fn trust(args: &Args) -> Result<Trust, Failure> {
    let percent = args.standard_uncertainty_percent;
    if let Some(percent) = percent.filter(|percent| !(0.0..=50.0).contains(percent)) {
        return Err(Failure::input(format!(
            "--standard-uncertainty-percent: expected a number from 0 to 50, found {percent}"
        )));
    }
    let date = args.date.as_deref().map(str::parse).transpose();
    Ok(Trust {
        uncertainty: percent.map(|percent| percent / 100.0),
        captured: Some(
            date.map_err(|error| Failure::input(format!("--date: {error}")))?
                .unwrap_or_else(today),
        ),
        takes_expired: args.standard_expired,
    })
}

/// Today, in universal time.
pub(crate) fn today() -> Date {
    let since = SystemTime::now().duration_since(UNIX_EPOCH);
    Date::of_unix_s(since.map_or(0, |since| since.as_secs()))
}

/// The second standard that is asked for, or serves on `rig`.
fn second_standard(args: &Args, rig: &Rig, output: &Output) -> Option<String> {
    let asked = args.second_standard.as_deref();
    let usual = Request::usual_second_standard(rig);
    if asked.or(usual).is_none() {
        output.remark(
            "no second standard: this camera's steps would hide what a dark one shows; interreflection stays unknown",
        );
    }
    asked.or(usual).filter(|spec| *spec != NONE).map(str::to_owned)
}

/// What was found, and what is weak in it.
#[derive(serde::Serialize)]
struct Summary {
    #[serde(flatten)]
    photometry: Photometry,
    /// The worst first.
    weaknesses: Vec<Weakness>,
    height: Option<Height>,
}

fn ghost(found: &Photometry) -> String {
    let Some(ghost) = &found.stray.ghost else {
        return "none that stands apart from what makes it".to_owned();
    };
    let share = ghost.share.iter().sum::<f64>() / ghost.share.len() as f64;
    let [x, y] = ghost.shift.map(|shift| 100.0 * shift);
    format!(
        "{:.2} % ± {:.2} % (k = 1), displaced by {x:.2}, {y:.2} % of half the image",
        100.0 * share,
        100.0 * ghost.standard_uncertainty
    )
}

fn seen_part(summary: &Summary) -> String {
    let Some((part, height)) = summary.photometry.seen_part.as_ref().zip(summary.height) else {
        return "of the sample: not asked for; the rig does not say how wide the pupils are".to_owned();
    };
    let mm = |m: f64| 1e3 * m;
    let [camera, projector] = part.pupils_m.map(mm);
    format!(
        "pupils of {camera:.1} and {projector:.0} mm; the edge of what is lit is {:.0} % darker; {:.0} % of the pairs of directions \
         have no value for it",
        100.0 * part.falloff,
        100.0 * height.lost
    )
}

/// Where the standard stood, and what to do if that is not where it should.
fn stood(height: &Height) -> String {
    let mm = 1e3 * height.height_m;
    let (side, remedy, other) = if mm > 0.0 {
        ("high", "lower", "raise")
    } else {
        ("low", "raise", "lower")
    };
    let uncertainty_mm = 1e3 * height.standard_uncertainty_m;
    if mm.abs() < 2.0 * uncertainty_mm {
        return format!("stood at its height, to {uncertainty_mm:.2} mm (k = 1)");
    }
    // Patches look nearly the same from as far above and below.
    format!(
        "stood {:.2} mm too {side} ± {uncertainty_mm:.2} mm (k = 1): {remedy} the holder by that; if it is farther off then, {other} it",
        mm.abs()
    )
}

/// What to mend first.
fn worst(weaknesses: &[Weakness]) -> String {
    weaknesses.first().map_or_else(String::new, |worst| {
        format!(
            "{}, {:.2} % of a white matte sample (k = 1); against it: {}",
            worst.name,
            100.0 * worst.left,
            worst.remedy
        )
    })
}

fn lamp(found: &Photometry) -> String {
    let flicker = format!(
        "flickers by {:.3} % from exposure to exposure",
        100.0 * found.lamp.flicker
    );
    match &found.lamp.monitor {
        Some(monitor) if monitor.standard_uncertainty < LampFound::UNWATCHED => format!(
            "{flicker}; watched in every frame, against this calibration to {:.3} % (k = 1)",
            100.0 * monitor.standard_uncertainty
        ),
        _ => format!(
            "{flicker}; too little light comes directly to watch it: ± {:.0} % for what it does until a measurement (k = 1)",
            100.0 * LampFound::UNWATCHED
        ),
    }
}

fn pixels(camera: &CameraFound) -> String {
    let assumed = if camera.prnu_is_assumed {
        " (assumed: too few show it; take a larger --image-size)"
    } else {
        ""
    };
    format!(
        "differ by {:.2} % in response{assumed}, {:.2} e⁻ in the dark; {:.4} % or more are hot",
        100.0 * camera.prnu,
        camera.dsnu_e,
        100.0 * camera.hot
    )
}

fn crosstalk(found: &Photometry) -> String {
    let Some(crosstalk) = &found.crosstalk else {
        return "none: the camera has no colours".to_owned();
    };
    let uncertainty = crosstalk.standard_uncertainty.iter().flatten().copied();
    format!(
        "up to {:.2} % of a channel's light is of other primaries, known to {:.3} % (k = 1)",
        100.0 * crosstalk.most(),
        100.0 * uncertainty.fold(0.0, f64::max)
    )
}

fn interreflection(found: &Photometry) -> String {
    let percent = |share: f64| format!("{:.3} %", 100.0 * share);
    found.interreflection.map_or_else(
        || "not found: there was no second standard".to_owned(),
        |back| {
            format!(
                "{} ± {} by noise, ± {} by the standards (k = 1)",
                percent(back.share),
                percent(back.standard_uncertainty),
                percent(back.by_standards)
            )
        },
    )
}

/// The second standard, if there was one.
fn second(found: &Photometry) -> String {
    let second = found.standards.get(1);
    second.map_or_else(|| "none".to_owned(), Standard::to_string)
}

fn text(summary: &Summary) -> String {
    let found = &summary.photometry;
    let camera = &found.camera;
    let percent = |share: f64| format!("{:.3} %", 100.0 * share);
    table(&[
        (
            "dark level",
            format!("{:.2} DN + {:.2} DN/s", camera.dark_dn, camera.dark_dn_per_s),
        ),
        ("gain", format!("{:.4} e⁻/DN", camera.gain_e_per_dn)),
        (
            "read noise",
            format!(
                "{:.2} e⁻, of rows {:.2} e⁻",
                camera.read_noise_e, camera.row_noise_e
            ),
        ),
        ("pixels", pixels(camera)),
        (
            "nonlinearity",
            format!(
                "{} at saturation; left after correction {}; above {:.0} % of the range counts as saturated",
                percent(camera.nonlinearity),
                percent(camera.linearity_residual),
                100.0 * camera.linear_to
            ),
        ),
        ("colours", crosstalk(found)),
        (
            "contrast",
            found.contrast.map_or_else(
                || "no light of black pixels".to_owned(),
                |ratio| format!("{ratio:.0} : 1"),
            ),
        ),
        (
            "glare",
            format!(
                "{} of the light goes aside; known to {:.0} % of itself (k = 1)",
                percent(found.stray.glare()),
                100.0 * found.stray.halo_uncertainty
            ),
        ),
        ("ghost", ghost(found)),
        (
            "direct light",
            format!(
                "{:.2e} DN/s per projector pixel ± {:.1e} (k = 1)",
                found.stray.direct_mean(),
                found.stray.direct_uncertainty
            ),
        ),
        ("lamp", lamp(found)),
        ("projector", format!("level^{:.3}", found.gamma)),
        (
            "light × throughput",
            format!(
                "± {} by noise, {} left beyond it, ± {} by the lamp, ± {} by the standard (k = 1)",
                percent(found.field_uncertainty),
                percent(found.field_residual),
                percent(found.lamp_uncertainty),
                percent(found.standards[0].standard_uncertainty)
            ),
        ),
        ("seen part", seen_part(summary)),
        (
            "standard",
            summary
                .height
                .as_ref()
                .map_or_else(|| "its height was not asked for".to_owned(), stood),
        ),
        ("its reflectance", found.standards[0].to_string()),
        ("second standard", second(found)),
        ("interreflection", interreflection(found)),
        ("weakest", worst(&summary.weaknesses)),
    ])
}
