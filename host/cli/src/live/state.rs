//! What every page shows.

use rcg::calibrate::geometry::alignment::Advice;
use rcg::calibrate::live::{Item, Look, Outline, Strobe};
use serde::Serialize;

use super::watch::HowFar;

/// Figures of focus that are kept.
pub(crate) const HISTORY: usize = 120;

/// The state of the instrument; all that a page needs but the picture.
#[derive(Clone, Debug, Default, Serialize)]
#[expect(
    clippy::struct_excessive_bools,
    reason = "each is what a page shows by itself"
)]
pub(crate) struct State {
    /// Name of the rig.
    pub(crate) rig: String,
    /// Whether it is the virtual one, whose parts the page moves.
    pub(crate) is_virtual: bool,
    /// Whether the virtual camera is plugged in.
    pub(crate) is_plugged: bool,
    /// Whether the page can calibrate.
    pub(crate) can_calibrate: bool,
    /// What is shown, held and how it is exposed.
    pub(crate) shown: String,
    pub(crate) held: String,
    pub(crate) exposure_ms: f64,
    pub(crate) gain: Option<f64>,
    /// Whether the exposure time is found anew for whatever is shown.
    pub(crate) is_automatic: bool,
    /// Whether pictures follow on each other.
    pub(crate) running: bool,
    /// What is the matter, if something is.
    pub(crate) problem: Option<String>,
    /// Pictures so far, and how many a second.
    pub(crate) number: u64,
    pub(crate) rate_hz: f64,
    /// Pixels of the frame, (width, height).
    pub(crate) size_px: (usize, usize),
    pub(crate) strobe: Option<Strobe>,
    pub(crate) look: Look,
    /// Figures of focus of the last pictures of the same kind.
    pub(crate) sharpness: Vec<f64>,
    pub(crate) outlines: Vec<Outline>,
    pub(crate) missed: u64,
    pub(crate) dropped: u64,
    pub(crate) checklist: Vec<Item>,
    pub(crate) advice: Option<Advice>,
    /// Rounds of advice so far.
    pub(crate) rounds: u64,
    pub(crate) task: Option<Task>,
    pub(crate) measurement: Option<HowFar>,
}

/// What takes longer.
#[derive(Clone, Debug, Default, Serialize)]
pub(crate) struct Task {
    pub(crate) what: String,
    pub(crate) done: usize,
    pub(crate) of: usize,
    /// What somebody is asked to put into the holder.
    pub(crate) asks: Option<Asks>,
}

/// A target that is asked for.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Asks {
    pub(crate) target: String,
    pub(crate) complaint: Option<String>,
    pub(crate) can_keep: bool,
}
