//! What is done on the way from first light to a calibration.

use serde::Serialize;

use super::{Look, Outline, Strobe};
use crate::calibrate::geometry::alignment::{ALIGNED_DEG, ALIGNED_MM, Advice};

/// A picture of white must be so many times as bright as one of black, its dark level included.
const LIT: f64 = 1.2;
/// Share of the range in which the brightest thousandth should lie, and of values that may saturate.
const EXPOSED: [f64; 2] = [0.3, 0.98];
const SATURATED: f64 = 0.001;
/// Share of the best figure of focus that counts as sharp, and pictures over which that is looked for.
const SHARP: f64 = 0.97;
const LOOKED: usize = 20;
/// Distance of expected and seen edges that will do, as a share of the image's width.
const NEAR: f64 = 0.01;

/// What was seen so far.
#[derive(Clone, Debug, Default)]
pub struct Witness {
    /// What STROBE said of the last exposure.
    pub strobe: Option<Strobe>,
    /// The exposure time that was asked for then, µs.
    pub exposure_us: f64,
    /// Median of the last picture of black and of white, digital numbers.
    pub black_dn: Option<f64>,
    /// See `black_dn`.
    pub white_dn: Option<f64>,
    /// The last picture's figures.
    pub look: Look,
    /// The figures of focus, the last one last.
    pub sharpness: Vec<f64>,
    /// What was expected and seen last of a lit standard.
    pub outlines: Vec<Outline>,
    /// Pixels a side of the image.
    pub width_px: usize,
    /// What the last views advise.
    pub advice: Option<Advice>,
    /// Whether the geometry was calibrated.
    pub is_calibrated: bool,
}

/// A line of the list.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Item {
    /// What is to be done.
    pub what: &'static str,
    /// Whether it is.
    pub done: bool,
    /// What was found, or what to do.
    pub hint: String,
}

/// The list after what `seen` has witnessed.
#[must_use]
pub fn checklist(seen: &Witness) -> Vec<Item> {
    vec![
        triggered(seen),
        lit(seen),
        exposed(seen),
        focused(seen),
        edges(seen),
        aligned(seen),
        calibrated(seen),
    ]
}

fn item(what: &'static str, done: bool, hint: String) -> Item {
    Item { what, done, hint }
}

fn triggered(seen: &Witness) -> Item {
    let (done, hint) = match seen.strobe {
        None => (
            false,
            "no picture yet: trigger box, camera and STROBE have to be there".to_owned(),
        ),
        Some(Strobe { delay_us, width_us }) => {
            let off = (width_us / seen.exposure_us - 1.0).abs();
            let found = format!("STROBE {delay_us:.1} µs after the trigger, {width_us:.1} µs long");
            if off < 0.05 || (width_us - seen.exposure_us).abs() < 5.0 {
                (true, found)
            } else {
                (
                    false,
                    format!(
                        "{found}, expected {:.1} µs: is it the camera's exposure-active line?",
                        seen.exposure_us
                    ),
                )
            }
        }
    };
    item("the trigger box fires and the camera answers", done, hint)
}

fn lit(seen: &Witness) -> Item {
    let (done, hint) = match (seen.black_dn, seen.white_dn) {
        (Some(black), Some(white)) => (
            white > LIT * black,
            format!("median of {white:.0} with white, {black:.0} with black (digital numbers)"),
        ),
        (None, _) => (false, "show black once".to_owned()),
        (_, None) => (
            false,
            "show white once, with a white standard in the holder".to_owned(),
        ),
    };
    item("first light: the camera sees the projector", done, hint)
}

fn exposed(seen: &Witness) -> Item {
    let look = &seen.look;
    let share = f64::from(look.bright_dn) / f64::from(look.full_dn.max(1));
    let saturated = look.saturated as f64 / look.values.max(1) as f64;
    let done = (EXPOSED[0]..EXPOSED[1]).contains(&share) && saturated <= SATURATED;
    let hint = format!(
        "brightest at {:.0} % of the range, {} values saturated{}",
        100.0 * share,
        look.saturated,
        match share {
            share if share < EXPOSED[0] => ": expose longer",
            _ if !done => ": expose shorter",
            _ => "",
        }
    );
    item(
        "well exposed: nothing saturated, nothing lost in the noise",
        done,
        hint,
    )
}

fn focused(seen: &Witness) -> Item {
    let best = seen.sharpness.iter().copied().fold(0.0, f64::max);
    let now = seen.sharpness.last().copied().unwrap_or(0.0);
    let done = seen.sharpness.len() >= LOOKED && now >= SHARP * best;
    let hint = if seen.sharpness.len() < LOOKED {
        "show stripes or a cross, and turn the focus through its best".to_owned()
    } else {
        format!(
            "focus figure {:.0} % of its best since this was shown",
            100.0 * now / best.max(f64::MIN_POSITIVE)
        )
    };
    item("in focus", done, hint)
}

fn edges(seen: &Witness) -> Item {
    let found: Vec<String> = seen
        .outlines
        .iter()
        .filter_map(|outline| Some(format!("{} {:.1} px", outline.name, outline.seen?.distance_px)))
        .collect();
    let farthest = seen
        .outlines
        .iter()
        .filter_map(|outline| outline.seen)
        .map(|seen| seen.distance_px);
    let farthest = farthest.fold(0.0, f64::max);
    let most = NEAR * seen.width_px as f64;
    let done = !found.is_empty() && farthest <= most;
    let hint = if found.is_empty() {
        "no edge is seen: show white, with a white standard in the holder".to_owned()
    } else {
        format!(
            "{} from where they are expected; at most {most:.1} px",
            found.join(", ")
        )
    };
    item("edges where they are expected", done, hint)
}

fn aligned(seen: &Witness) -> Item {
    let (done, hint) = match &seen.advice {
        None => (
            false,
            "ask for advice: views of a flat mirror at four tilts".to_owned(),
        ),
        Some(advice) => (
            advice.is_aligned,
            format!(
                "directions off by {:.2}° (RMS, at most {ALIGNED_DEG}°), centres by {:.2} ± {:.2} mm (at most {ALIGNED_MM} mm)",
                advice.directions_deg, advice.lateral_mm, advice.lateral_uncertainty_mm
            ),
        ),
    };
    item("aligned", done, hint)
}

fn calibrated(seen: &Witness) -> Item {
    let hint = if seen.is_calibrated {
        "calibrated: rcg calibrate photometry comes next"
    } else {
        "rcg calibrate geometry finds what screws leave"
    };
    item(
        "ready to calibrate",
        seen.is_calibrated || seen.advice.as_ref().is_some_and(|advice| advice.is_aligned),
        hint.to_owned(),
    )
}
