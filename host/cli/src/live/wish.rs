//! What can be asked for: one JSON value each, on the page or by whoever has the token.

use rcg::calibrate::geometry::alignment::{Motion, Part};
use serde::Deserialize;

/// A wish.
#[derive(Clone, Debug, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub(crate) enum Wish {
    /// What the projector shows.
    Show(String),
    /// Exposure time, milliseconds.
    ExposureMs(f64),
    /// The exposure time that fills the camera's range.
    AutoExposure,
    /// Gain, decibels or the camera's unit.
    Gain(f64),
    /// What stands in the holder.
    Hold(String),
    /// One picture after the other, or none until a trigger is fired.
    Run(bool),
    /// One trigger.
    Fire,
    /// Moves a part of the virtual rig.
    Move {
        /// Which.
        part: Part,
        /// Along or about which axis.
        motion: Motion,
        /// Millimetres or degrees.
        by: f64,
    },
    /// Draws how the virtual rig stands.
    Misalign {
        /// Seed of the draw.
        seed: u64,
        /// Standard deviation of each coordinate, millimetres.
        position_mm: f64,
        /// Standard deviation of each angle, degrees.
        angle_deg: f64,
    },
    /// Plugs the virtual camera in, or out.
    Plug(bool),
    /// Takes the views by which moves are found.
    Advise,
    /// Makes all moves of the last advice that are clear, on the virtual rig.
    Follow,
    /// What somebody who was asked for a target says: ready, again, keep or stop.
    Answer(String),
    /// Calibrates the geometry.
    Calibrate,
}

impl Wish {
    /// The one in `text`.
    pub(crate) fn read(text: &[u8]) -> Result<Self, String> {
        serde_json::from_slice(text).map_err(|error| {
            format!("expected a wish such as {{\"show\":\"white\"}} or \"fire\", found another: {error}")
        })
    }
}
