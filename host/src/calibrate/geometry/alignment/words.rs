//! Moves in words.

use super::{Motion, Part};

/// The word for a part in a rig file.
pub(super) const fn name(part: Part) -> &'static str {
    match part {
        Part::Camera => "camera",
        Part::Projector => "projector",
        Part::Sample => "sample",
    }
}

/// A move in words.
pub(super) fn words(part: Part, motion: Motion, by: f64, sigma: f64, is_clear: bool) -> String {
    let (verb, unit, [minus, plus]) = match motion {
        Motion::Shift(0) => ("move", "mm", ["to the left", "to the right"]),
        Motion::Shift(1) => ("move", "mm", ["up", "down"]),
        Motion::Shift(_) => ("move", "mm", ["back", "forward"]),
        Motion::Turn(0) if part == Part::Sample => ("roll", "°", ["less", "more"]),
        Motion::Turn(1) if part == Part::Sample => ("tilt", "°", ["less", "more"]),
        Motion::Turn(0) => ("turn", "°", ["down", "up"]),
        Motion::Turn(1) => ("turn", "°", ["left", "right"]),
        Motion::Turn(_) => ("turn", "°", ["counterclockwise", "clockwise"]),
    };
    let space = if unit == "mm" { " " } else { "" };
    let name = name(part);
    let way = if by < 0.0 { minus } else { plus };
    if is_clear {
        format!(
            "{verb} the {name} {:.2}{space}{unit} {way} (± {sigma:.2}{space}{unit})",
            by.abs()
        )
    } else {
        format!(
            "leave the {name} ({verb} {way} {:.2} ± {sigma:.2}{space}{unit})",
            by.abs()
        )
    }
}
