//! Colours and patterns of a map.

use plotters::style::RGBColor;
use plotters::style::colors::colormaps::ViridisRGB;

use super::{Shown, Spot};
use crate::brdf::reflectance::Missing;
use crate::instrument::optics::Unmeasurable;
use crate::judge::chart::{Axis, Scale};
use crate::store::provenance::Provenance;

/// Ends and middle of the colours of what has a sign.
const BELOW: [u8; 3] = [49, 84, 188];
const ZERO: [u8; 3] = [243, 243, 243];
const ABOVE: [u8; 3] = [178, 24, 43];

/// The colour at `share` of the scale, 0 to 1.
pub(super) fn colour(shown: Shown, share: f64) -> [u8; 3] {
    let share = share.clamp(0.0, 1.0);
    if shown != Shown::Error {
        let RGBColor(r, g, b) = ViridisRGB::get_color_normalized(share as f32, 0.0, 1.0);
        return [r, g, b];
    }
    let (end, part) = if share < 0.5 {
        (BELOW, 1.0 - 2.0 * share)
    } else {
        (ABOVE, 2.0 * share - 1.0)
    };
    std::array::from_fn(|at| {
        (f64::from(ZERO[at]) + part * (f64::from(end[at]) - f64::from(ZERO[at]))).round() as u8
    })
}

/// What a place of the map looks like beside its colour.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Look {
    /// A value that was measured, or that of a model.
    Plain,
    /// Values that were filled in, by their origin.
    Reciprocal,
    Interpolated,
    Modelled,
    /// Values that a logarithmic scale has no place for.
    NotPositive,
    /// Nothing, by the reason.
    Hole,
    BeyondRim,
    OutsideImage,
    Occluded,
    OffSample,
    Saturated,
    Incident,
    Unknown,
    NoReference,
}

impl Look {
    /// That of a place; `None` beside the map.
    pub(super) fn of(spot: &Spot, axis: &Axis) -> Option<Self> {
        Some(match spot {
            Spot::Beside => return None,
            Spot::NoReference => Self::NoReference,
            Spot::Missing(reason) => match reason {
                Missing::Saturated => Self::Saturated,
                Missing::Unknown => Self::Unknown,
                Missing::Incident(_) => Self::Incident,
                Missing::Outgoing(reason) => match reason {
                    Unmeasurable::Hole => Self::Hole,
                    Unmeasurable::BeyondRim => Self::BeyondRim,
                    Unmeasurable::OutsideImage | Unmeasurable::BelowHorizon => Self::OutsideImage,
                    Unmeasurable::Occluded => Self::Occluded,
                    Unmeasurable::OffSample => Self::OffSample,
                },
            },
            Spot::Shown(value, _) if axis.scale == Scale::Logarithmic && *value <= 0.0 => Self::NotPositive,
            Spot::Shown(_, origin) => match origin {
                Some(Provenance::Reciprocal) => Self::Reciprocal,
                Some(Provenance::Interpolated) => Self::Interpolated,
                Some(Provenance::Modelled) => Self::Modelled,
                _ => Self::Plain,
            },
        })
    }

    /// Its words in the legend; plain ones need none.
    pub(super) const fn words(self) -> &'static str {
        match self {
            Self::Plain => "measured",
            Self::Reciprocal => "from the exchanged pair",
            Self::Interpolated => "from its neighbours",
            Self::Modelled => "from a model",
            Self::NotPositive => "not above 0",
            Self::Hole => "hole of the mirror",
            Self::BeyondRim => "beyond the rim",
            Self::OutsideImage => "outside the image",
            Self::Occluded => "occluded (wire, obstacles)",
            Self::OffSample => "off the sample",
            Self::Saturated => "saturated",
            Self::Incident => "incident direction not captured",
            Self::Unknown => "no value in the file",
            Self::NoReference => "no reference",
        }
    }

    /// The colour of a pixel at (`x`, `y`), where the value has `colour`.
    pub(super) fn pixel(self, colour: [u8; 3], x: usize, y: usize) -> [u8; 3] {
        let (rising, falling) = ((x + y) % 14 < 2, (x + 14 * y - y) % 14 < 2);
        let stripes = |is_line: bool, line: u8, ground: u8| [if is_line { line } else { ground }; 3];
        match self {
            Self::Reciprocal if rising => against(colour),
            Self::Interpolated if falling => against(colour),
            Self::Modelled if rising || falling => against(colour),
            Self::Plain | Self::Reciprocal | Self::Interpolated | Self::Modelled => colour,
            Self::Hole => [150; 3],
            Self::Occluded => [60; 3],
            Self::BeyondRim => stripes(y % 10 < 2, 150, 225),
            Self::OutsideImage => [225; 3],
            Self::OffSample => stripes(rising, 110, 205),
            Self::Saturated => stripes(x % 8 < 4 && y % 8 < 4, 255, 90),
            Self::Incident => stripes(x % 10 < 2 && y % 10 < 2, 60, 215),
            Self::Unknown => stripes(x % 10 < 2, 150, 225),
            Self::NotPositive => stripes(falling, 40, 110),
            Self::NoReference => stripes(falling, 150, 225),
        }
    }
}

/// Black or white, whichever is seen on `colour`.
fn against(colour: [u8; 3]) -> [u8; 3] {
    let [r, g, b] = colour.map(f64::from);
    let is_dark = 0.299 * r + 0.587 * g + 0.114 * b < 140.0;
    if is_dark { [255; 3] } else { [0; 3] }
}
