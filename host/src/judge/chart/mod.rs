//! Charts for print: curves over labelled axes, as SVG, PDF or PNG.
//!
//! # Design
//! One kind of chart serves all commands. Curves are told apart by colour, by dashes or the shape of their marks,
//! so that a grey print can still be read; the legend stands beside the plot and covers nothing. Where there is no
//! value a curve has a gap. Text of a PNG is drawn with a font that is built in: nothing needs to be installed.

mod axis;
mod captions;
mod font;
mod pdf;
mod polar;
mod sheet;

use std::path::Path;

use image::RgbImage;
use plotters::coord::Shift;
use plotters::prelude::*;

use crate::base::blame::Blame;
use crate::base::file_format::{CHART_OR_TABLE, FormatError};
use crate::judge::render::PictureError;
use crate::store::whole_file::{FileError, write_whole};

pub use axis::{Axis, Scale};
pub use captions::captioned;
pub use polar::Lobes;
pub use sheet::Sheet;

/// Pixels of SVG and PNG: points fall on whole ones, so they must be fine.
const SIZE: (u32, u32) = (2000, 1240);
/// Pixels of it that the legend takes.
const LEGEND: u32 = 380;
/// Dark enough for print, and of different lightness (after Okabe and Ito's palette for the colour blind).
const COLOURS: [RGBColor; 7] = [
    RGBColor(0, 0, 0),
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(230, 159, 0),
    RGBColor(86, 180, 233),
];
/// How much of its colour a band behind a curve has.
const SHADE: f64 = 0.2;
/// Dash and gap in pixels of curves without marks; the first is solid.
const DASHES: [(u32, u32); 4] = [(1, 0), (28, 12), (6, 10), (48, 8)];

/// Points in the order of x; `None` is a gap.
#[derive(Clone, Debug)]
pub struct Curve {
    /// Its name in the legend.
    pub label: String,
    /// (x, y) in the units of the axes.
    pub points: Vec<(f64, Option<f64>)>,
    /// What is shaded behind it: x, and from which y to which; `None` is a gap.
    pub band: Vec<(f64, Option<[f64; 2]>)>,
}

/// A chart.
#[derive(Clone, Debug)]
pub struct Chart {
    /// Above it.
    pub title: String,
    /// Horizontal axis.
    pub x: Axis,
    /// Vertical axis.
    pub y: Axis,
    /// Heading of the legend.
    pub legend: String,
    /// Whether every point has a mark; else curves are dashed.
    pub marks: bool,
    /// The curves.
    pub curves: Vec<Curve>,
}

/// Charts one above the other.
struct Charts<'a>(&'a [Chart]);

impl Sheet for Charts<'_> {
    fn title(&self) -> &str {
        self.0.first().map_or("", |chart| &chart.title)
    }

    fn size(&self) -> (u32, u32) {
        (SIZE.0, SIZE.1 * self.0.len() as u32)
    }

    fn draw<DB: DrawingBackend>(
        &self,
        root: &DrawingArea<DB, Shift>,
    ) -> Result<(), DrawingAreaErrorKind<DB::ErrorType>> {
        for (chart, area) in self.0.iter().zip(root.split_evenly((self.0.len(), 1))) {
            chart.draw(&area, root)?;
        }
        Ok(())
    }
}

/// Charts one above the other, as an SVG document.
#[must_use]
pub fn svg(charts: &[Chart]) -> String {
    Charts(charts).svg()
}

/// Charts one above the other, as pixels.
#[must_use]
pub fn picture(charts: &[Chart]) -> RgbImage {
    Charts(charts).picture()
}

/// Writes charts, one above the other: SVG, PDF or PNG, as the name of `path` ends.
///
/// # Errors
/// [`ChartError`].
pub fn save_all(charts: &[Chart], path: &Path) -> Result<(), ChartError> {
    Charts(charts).save(path)
}

impl Chart {
    /// Writes the chart: SVG, PDF or PNG, as the name of `path` ends.
    ///
    /// # Errors
    /// [`ChartError`].
    pub fn save(&self, path: &Path) -> Result<(), ChartError> {
        save_all(std::slice::from_ref(self), path)
    }

    /// Writes the chart (SVG, PDF or PNG) or its `table` (CSV), as the name of `path` ends.
    ///
    /// # Errors
    /// [`ChartError`].
    pub fn save_or_table(&self, table: impl FnOnce() -> String, path: &Path) -> Result<(), ChartError> {
        match CHART_OR_TABLE.of(path)? {
            "csv" => Ok(write_whole(path, table().as_bytes())?),
            _ => self.save(path),
        }
    }

    /// Writes `stem.svg` and `stem.png` into `dir`.
    ///
    /// # Errors
    /// [`ChartError`].
    pub fn save_both(&self, dir: &Path, stem: &str) -> Result<(), ChartError> {
        self.save(&dir.join(format!("{stem}.svg")))?;
        self.save(&dir.join(format!("{stem}.png")))
    }

    /// Draws the chart into an `area` of the whole picture.
    fn draw<DB: DrawingBackend>(
        &self,
        area: &DrawingArea<DB, Shift>,
        whole: &DrawingArea<DB, Shift>,
    ) -> Result<(), DrawingAreaErrorKind<DB::ErrorType>> {
        let (plot, legend) = area.split_horizontally(SIZE.0 - LEGEND);
        let mut chart = ChartBuilder::on(&plot)
            .caption(&self.title, ("sans-serif", 44))
            .margin(28)
            .x_label_area_size(116)
            .y_label_area_size(156)
            .build_cartesian_2d(self.x.clone(), self.y.clone())?;
        chart
            .configure_mesh()
            .x_desc(&self.x.label)
            .y_desc(&self.y.label)
            .axis_desc_style(("sans-serif", 40))
            .label_style(("sans-serif", 36))
            .bold_line_style(RGBColor(215, 215, 215).stroke_width(2))
            .axis_style(BLACK.stroke_width(2))
            .set_all_tick_mark_size(10)
            .light_line_style(TRANSPARENT)
            .x_labels(self.x.ticks.len())
            .y_labels(self.y.ticks.len())
            .draw()?;
        for (index, curve) in self.curves.iter().enumerate() {
            let colour = COLOURS[index % COLOURS.len()].mix(SHADE);
            for run in curve.band.split(|place| place.1.is_none()) {
                let run: Vec<(f64, [f64; 2])> = run.iter().filter_map(|&(x, y)| Some((x, y?))).collect();
                let above = run.iter().map(|&(x, [_, high])| (x, self.y.inside(high)));
                let below = run.iter().rev().map(|&(x, [low, _])| (x, self.y.inside(low)));
                let outline: Vec<(f64, f64)> = above.chain(below).collect();
                chart.draw_series(std::iter::once(Polygon::new(outline, colour)))?;
            }
        }
        for (index, curve) in self.curves.iter().enumerate() {
            let (colour, (dash, gap)) = (COLOURS[index % COLOURS.len()], DASHES[index % DASHES.len()]);
            for run in curve.points.split(|point| point.1.is_none()) {
                let run: Vec<(f64, f64)> = run.iter().filter_map(|&(x, y)| Some((x, y?))).collect();
                if self.marks || gap == 0 {
                    chart.draw_series(LineSeries::new(run.clone(), colour.stroke_width(4)))?;
                } else {
                    let style = colour.stroke_width(4);
                    chart.draw_series(DashedLineSeries::new(run.clone(), dash, gap, style))?;
                }
                if self.marks {
                    for at in &run {
                        whole.draw(&mark(index, chart.backend_coord(at)))?;
                    }
                }
            }
        }
        legend.draw(&Text::new(self.legend.clone(), (0, 112), ("sans-serif", 36)))?;
        for (index, curve) in self.curves.iter().enumerate() {
            let (colour, (dash, gap)) = (COLOURS[index % COLOURS.len()], DASHES[index % DASHES.len()]);
            let y = 192 + 56 * index as i32;
            let (dash, gap) = if self.marks { DASHES[0] } else { (dash, gap) };
            let mut x = 0;
            while x < 72 {
                let end = if gap == 0 { 72 } else { (x + dash as i32).min(72) };
                legend.draw(&PathElement::new(vec![(x, y), (end, y)], colour.stroke_width(4)))?;
                x = end + gap as i32;
            }
            if self.marks {
                legend.draw(&mark(index, (36, y)))?;
            }
            legend.draw(&Text::new(curve.label.clone(), (92, y - 16), ("sans-serif", 34)))?;
        }
        Ok(())
    }
}

/// A mark at `at`: its shape changes faster than the colours repeat.
fn mark<'a, DB: DrawingBackend + 'a>(index: usize, at: (i32, i32)) -> DynElement<'a, DB, (i32, i32)> {
    let style = COLOURS[index % COLOURS.len()];
    let (x, y) = at;
    match index % 5 {
        0 => Circle::new(at, 10, style.filled()).into_dyn(),
        1 => Rectangle::new([(x - 9, y - 9), (x + 9, y + 9)], style.filled()).into_dyn(),
        2 => TriangleMarker::new(at, 13, style.filled()).into_dyn(),
        3 => Cross::new(at, 10, style.stroke_width(4)).into_dyn(),
        _ => Circle::new(at, 10, style.stroke_width(4)).into_dyn(),
    }
}

/// Why a chart cannot be saved.
#[derive(Debug, thiserror::Error)]
pub enum ChartError {
    /// The name of the file says nothing of its format.
    #[error(transparent)]
    Format(#[from] FormatError),
    /// The file.
    #[error(transparent)]
    File(#[from] FileError),
    /// The picture.
    #[error(transparent)]
    Picture(#[from] PictureError),
}

impl Blame for ChartError {
    fn is_input(&self) -> bool {
        match self {
            Self::Format(_) => true,
            Self::File(_) => false,
            Self::Picture(error) => error.is_input(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chart() -> Chart {
        Chart {
            title: "f < 1 & more".to_owned(),
            x: Axis {
                label: "x (°)".to_owned(),
                ticks: vec![1.0, 2.0, 4.0],
                scale: Scale::Logarithmic,
            },
            y: Axis::covering("y", [0.0, 0.7].into_iter()),
            legend: "curve".to_owned(),
            marks: false,
            curves: vec![Curve {
                band: Vec::new(),
                label: "a".to_owned(),
                points: vec![
                    (1.0, Some(0.1)),
                    (1.5, Some(0.1)),
                    (2.0, None),
                    (3.0, Some(0.7)),
                    (4.0, Some(0.7)),
                ],
            }],
        }
    }

    #[test]
    fn a_gap_is_not_drawn_across() {
        let polylines = |chart: &Chart| svg(std::slice::from_ref(chart)).matches("<polyline").count();
        let gap = polylines(&chart());
        let mut without = chart();
        without.curves[0].points.retain(|point| point.1.is_some());
        assert_eq!(gap, polylines(&without) + 1);
    }

    #[test]
    fn charts_stand_one_above_the_other() {
        let image = picture(&[chart(), chart()]);
        assert_eq!(image.dimensions(), (SIZE.0, 2 * SIZE.1));
        let half = image.as_raw().len() / 2;
        assert!(
            image.as_raw()[..half] == image.as_raw()[half..],
            "the second is not as the first"
        );
    }

    #[test]
    fn text_of_the_picture_is_drawn_with_the_font_that_is_built_in() {
        let dark = |title: &str| {
            let chart = Chart {
                title: title.to_owned(),
                ..chart()
            };
            let image = picture(&[chart]);
            assert_eq!(image.dimensions(), SIZE);
            // The caption's strip.
            image
                .rows()
                .take(80)
                .flatten()
                .filter(|pixel| pixel.0[0] < 128)
                .count()
        };
        let (full, empty) = (dark("f < 1 & more"), dark(""));
        assert!(full > empty + 100, "{full} {empty}");
    }
}
