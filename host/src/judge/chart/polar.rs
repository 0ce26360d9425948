//! Lobes: the curves of a chart over an angle as a polar diagram.
//!
//! # Design
//! The angle of a point is its x in degrees, from −90 on the left over 0 upwards to 90 on the right; its distance from the middle of the
//! ground line is its y along the chart's axis, so that a logarithmic axis makes logarithmic lobes, whose middle is the first tick. What lies
//! below the first tick is a gap.

use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::{COLOURS, Chart, DASHES, Sheet};

/// Pixels of the page, the middle of the ground line, and the radius of the last tick.
const SIZE: (u32, u32) = (2000, 1160);
const MIDDLE: (i32, i32) = (790, 980);
const RADIUS: f64 = 690.0;
/// Left edge of the legend.
const LEGEND: i32 = 1620;
/// Angles that have a spoke, degrees.
const SPOKES_DEG: [i32; 7] = [-90, -60, -30, 0, 30, 60, 90];

/// The curves of a chart as lobes.
pub struct Lobes<'a>(pub &'a Chart);

impl Lobes<'_> {
    /// Where a point lies; `None` if that is below the first tick.
    fn place(&self, (angle_deg, value): (f64, f64)) -> Option<(i32, i32)> {
        let share = self.0.y.share(value);
        (share >= 0.0).then(|| at(angle_deg, share.min(1.0)))
    }

    fn grid<DB: DrawingBackend>(
        &self,
        root: &DrawingArea<DB, Shift>,
    ) -> Result<(), DrawingAreaErrorKind<DB::ErrorType>> {
        let grey = RGBColor(200, 200, 200).stroke_width(2);
        let axis = &self.0.y;
        for tick in &axis.ticks {
            let ring = (-90..=90).map(|deg| at(f64::from(deg), axis.share(*tick)));
            root.draw(&PathElement::new(ring.collect::<Vec<_>>(), grey))?;
            let (x, y) = at(90.0, axis.share(*tick));
            root.draw(&text(&axis.tick(*tick), (x, y + 30), 32, HPos::Center))?;
        }
        for deg in SPOKES_DEG {
            let spoke = vec![MIDDLE, at(f64::from(deg), 1.0)];
            root.draw(&PathElement::new(spoke, grey))?;
            let (x, y) = at(f64::from(deg), 1.0 + 40.0 / RADIUS);
            let y = if deg.abs() == 90 { y - 26 } else { y };
            root.draw(&text(&format!("{deg}°"), (x, y), 32, HPos::Center))?;
        }
        root.draw(&text(
            &self.0.x.label,
            (MIDDLE.0, MIDDLE.1 + 86),
            36,
            HPos::Center,
        ))?;
        root.draw(&text(&axis.label, (MIDDLE.0, MIDDLE.1 + 136), 36, HPos::Center))
    }
}

impl Sheet for Lobes<'_> {
    fn title(&self) -> &str {
        &self.0.title
    }

    fn size(&self) -> (u32, u32) {
        SIZE
    }

    fn draw<DB: DrawingBackend>(
        &self,
        root: &DrawingArea<DB, Shift>,
    ) -> Result<(), DrawingAreaErrorKind<DB::ErrorType>> {
        root.draw(&text(&self.0.title, (MIDDLE.0, 70), 44, HPos::Center))?;
        self.grid(root)?;
        root.draw(&text(&self.0.legend, (LEGEND, 150), 36, HPos::Left))?;
        for (index, curve) in self.0.curves.iter().enumerate() {
            let style = COLOURS[index % COLOURS.len()].stroke_width(4);
            let (dash, gap) = DASHES[index % DASHES.len()];
            let places: Vec<Option<(i32, i32)>> = curve
                .points
                .iter()
                .map(|&(angle, value)| self.place((angle, value?)))
                .collect();
            let y = 210 + 56 * index as i32;
            let sample: Vec<(i32, i32)> = (0..=72).map(|x| (LEGEND + x, y)).collect();
            let runs = places.split(Option::is_none);
            let runs = runs.map(|run| run.iter().copied().flatten().collect::<Vec<_>>());
            for run in runs.chain([sample]).filter(|run| run.len() > 1) {
                if gap == 0 {
                    root.draw(&PathElement::new(run, style))?;
                } else {
                    for piece in dashes(&run, f64::from(dash), f64::from(gap)) {
                        root.draw(&PathElement::new(piece, style))?;
                    }
                }
            }
            root.draw(&text(&curve.label, (LEGEND + 92, y), 34, HPos::Left))?;
        }
        Ok(())
    }
}

/// The place at `share` of the radius under an angle from the normal.
fn at(angle_deg: f64, share: f64) -> (i32, i32) {
    let (sin, cos) = angle_deg.to_radians().sin_cos();
    (
        MIDDLE.0 + (RADIUS * share * sin).round() as i32,
        MIDDLE.1 - (RADIUS * share * cos).round() as i32,
    )
}

/// The pieces of `path` that dashes and gaps of these lengths leave.
fn dashes(path: &[(i32, i32)], dash: f64, gap: f64) -> Vec<Vec<(i32, i32)>> {
    let (mut pieces, mut piece) = (Vec::new(), Vec::new());
    let mut along = 0.0;
    for step in path.windows(2) {
        let [from, to] = [step[0], step[1]];
        if along % (dash + gap) < dash {
            if piece.is_empty() {
                piece.push(from);
            }
            piece.push(to);
        } else if !piece.is_empty() {
            pieces.push(std::mem::take(&mut piece));
        }
        along += f64::from(to.0 - from.0).hypot(f64::from(to.1 - from.1));
    }
    pieces.push(piece);
    pieces.retain(|piece| piece.len() > 1);
    pieces
}

/// Words in the middle of a line at `at`.
fn text<'a>(words: &str, at: (i32, i32), size: i32, position: HPos) -> Text<'a, (i32, i32), String> {
    let style = TextStyle::from(("sans-serif", size).into_font()).pos(Pos::new(position, VPos::Center));
    Text::new(words.to_owned(), at, style)
}
