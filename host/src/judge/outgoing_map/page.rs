//! Maps, their scale and their legend on one page.

use std::collections::BTreeMap;
use std::path::Path;

use image::{Rgb, RgbImage};
use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::colours::{Look, colour};
use super::{Map, OutgoingMaps, SIDE, Spot};
use crate::base::file_format::CHART_OR_TABLE;
use crate::hemisphere::direction::from_degrees;
use crate::hemisphere::disk::Disk;
use crate::judge::chart::{Axis, ChartError, Sheet};
use crate::store::whole_file::write_whole;

/// Pixels of a place of a map, and of a map.
const ZOOM: usize = 2;
const MAP: i32 = (SIDE * ZOOM) as i32;
/// Pixels around a map: its title stands above it.
const BESIDE: i32 = 80;
const ABOVE: i32 = 130;
const BELOW: i32 = 50;
/// Maps beside each other at most.
const COLUMNS: usize = 3;
/// Pixels of the title, of the column of scale and legend, and of the scale.
const TITLE: i32 = 90;
const SIDEBAR: i32 = 760;
const BAR: (i32, i32) = (46, 480);
/// Pixels of a row of the legend.
const ROW: i32 = 52;
/// Polar angles that have a ring, degrees.
const RINGS_DEG: [f64; 3] = [30.0, 60.0, 90.0];

type Drawn<DB> = Result<(), DrawingAreaErrorKind<<DB as DrawingBackend>::ErrorType>>;

/// Writes `maps` as the name of `path` ends.
pub(super) fn save(maps: &OutgoingMaps, title: &str, path: &Path) -> Result<(), ChartError> {
    if CHART_OR_TABLE.of(path)? == "csv" {
        return Ok(write_whole(path, maps.csv().as_bytes())?);
    }
    Page::new(maps, title).save(path)
}

/// A page with maps.
struct Page<'a> {
    maps: &'a OutgoingMaps,
    title: &'a str,
    axis: Axis,
    columns: usize,
}

impl Sheet for Page<'_> {
    fn title(&self) -> &str {
        self.title
    }

    fn size(&self) -> (u32, u32) {
        let rows = self.maps.maps.len().div_ceil(self.columns) as i32;
        let width = self.columns as i32 * (MAP + 2 * BESIDE) + SIDEBAR;
        let legend = ABOVE + BAR.1 + 100 + (self.legend().len() as i32 + 2) * ROW;
        let height = TITLE + (rows * (MAP + ABOVE + BELOW)).max(legend);
        (width as u32, height as u32)
    }

    fn pictures(&self) -> Vec<((i32, i32), RgbImage)> {
        let all = self.maps.maps.iter().enumerate();
        all.map(|(index, map)| (self.corner(index), self.picture(map)))
            .collect()
    }

    fn draw<DB: DrawingBackend>(&self, root: &DrawingArea<DB, Shift>) -> Drawn<DB> {
        root.draw(&text(self.title, (BESIDE, 56), 44, HPos::Left))?;
        for (index, map) in self.maps.maps.iter().enumerate() {
            grid(root, self.corner(index), map)?;
        }
        let left = self.columns as i32 * (MAP + 2 * BESIDE) + 20;
        self.bar(root, (left, TITLE + ABOVE))?;
        self.words(root, (left, TITLE + ABOVE + BAR.1 + 80))
    }
}

impl<'a> Page<'a> {
    fn new(maps: &'a OutgoingMaps, title: &'a str) -> Self {
        Self {
            maps,
            title,
            axis: maps.axis(),
            columns: maps.maps.len().clamp(1, COLUMNS),
        }
    }

    /// Upper left corner of a map.
    fn corner(&self, index: usize) -> (i32, i32) {
        let (column, row) = ((index % self.columns) as i32, (index / self.columns) as i32);
        (
            column * (MAP + 2 * BESIDE) + BESIDE,
            TITLE + row * (MAP + ABOVE + BELOW) + ABOVE,
        )
    }

    /// The pixels of a map.
    fn picture(&self, map: &Map) -> RgbImage {
        let side = self.maps.side;
        RgbImage::from_fn(MAP as u32, MAP as u32, |x, y| {
            let (x, y) = (x as usize, y as usize);
            // The first row of the disk is that of −y.
            let spot = &map.spots[(side - 1 - y / ZOOM) * side + x / ZOOM];
            let value = match spot {
                Spot::Shown(value, _) => colour(self.maps.shown, self.axis.share(*value)),
                _ => [255; 3],
            };
            Rgb(Look::of(spot, &self.axis).map_or([255; 3], |look| look.pixel(value, x, y)))
        })
    }

    /// What is in the maps beside plain values, and its share of all places.
    fn legend(&self) -> Vec<(Look, f64)> {
        let mut counts = BTreeMap::new();
        let mut all = 0.0;
        for look in self.maps.places().filter_map(|spot| Look::of(spot, &self.axis)) {
            *counts.entry(look).or_insert(0.0) += 1.0;
            all += 1.0;
        }
        let looks = counts.into_iter().filter(|(look, _)| *look != Look::Plain);
        looks.map(|(look, count)| (look, count / all)).collect()
    }

    /// Share of the values that lie beyond the scale.
    fn beyond(&self) -> f64 {
        let (mut beyond, mut all) = (0.0, 0.0);
        for spot in self.maps.places() {
            if let Spot::Shown(value, _) = spot {
                all += 1.0;
                if !(-1e-9..=1.0 + 1e-9).contains(&self.axis.share(*value)) {
                    beyond += 1.0;
                }
            }
        }
        beyond / f64::max(all, 1.0)
    }

    /// The scale of colours with its ticks.
    fn bar<DB: DrawingBackend>(&self, root: &DrawingArea<DB, Shift>, (x, y): (i32, i32)) -> Drawn<DB> {
        let (width, height) = BAR;
        root.draw(&text(&self.axis.label, (x, y - 46), 34, HPos::Left))?;
        for row in 0..height / 2 {
            let [r, g, b] = colour(
                self.maps.shown,
                1.0 - (f64::from(2 * row) + 1.0) / f64::from(height),
            );
            let corners = [(x, y + 2 * row), (x + width, y + 2 * row + 2)];
            root.draw(&Rectangle::new(corners, RGBColor(r, g, b).filled()))?;
        }
        root.draw(&Rectangle::new(
            [(x, y), (x + width, y + height)],
            BLACK.stroke_width(2),
        ))?;
        for tick in &self.axis.ticks {
            let at = y + ((1.0 - self.axis.share(*tick)) * f64::from(height)).round() as i32;
            root.draw(&PathElement::new(
                vec![(x + width, at), (x + width + 12, at)],
                BLACK.stroke_width(2),
            ))?;
            root.draw(&text(
                &self.axis.tick(*tick),
                (x + width + 22, at),
                34,
                HPos::Left,
            ))?;
        }
        Ok(())
    }

    /// The legend.
    fn words<DB: DrawingBackend>(&self, root: &DrawingArea<DB, Shift>, (x, mut y): (i32, i32)) -> Drawn<DB> {
        for (mark, words) in [
            (Mark::Incident, "incident direction"),
            (Mark::Mirror, "mirror direction"),
        ] {
            mark.draw(root, (x + 23, y))?;
            root.draw(&text(words, (x + 68, y), 34, HPos::Left))?;
            y += ROW;
        }
        for (look, part) in self.legend() {
            // What covers the colour is shown as it is, what is hatched upon the middle of the scale.
            let ground = colour(self.maps.shown, 0.5);
            for (dx, dy) in (0..23).flat_map(|dx| (0..18).map(move |dy| (dx, dy))) {
                let [r, g, b] = look.pixel(ground, 2 * dx, 2 * dy);
                let at = (x + 2 * dx as i32, y - 18 + 2 * dy as i32);
                let corners = [at, (at.0 + 2, at.1 + 2)];
                root.draw(&Rectangle::new(corners, RGBColor(r, g, b).filled()))?;
            }
            root.draw(&Rectangle::new(
                [(x, y - 18), (x + 46, y + 18)],
                BLACK.stroke_width(1),
            ))?;
            let words = format!("{} ({})", look.words(), percent(part));
            root.draw(&text(&words, (x + 68, y), 34, HPos::Left))?;
            y += ROW;
        }
        let beyond = self.beyond();
        if beyond > 0.0 {
            let words = format!("beyond the scale: {}", percent(beyond));
            root.draw(&text(&words, (x, y), 34, HPos::Left))?;
        }
        Ok(())
    }
}

/// A share in words.
fn percent(share: f64) -> String {
    if share < 1e-4 {
        "below 0.01 %".to_owned()
    } else {
        format!("{:.2} %", 100.0 * share)
    }
}

/// Rings, spokes and marks of the `map` whose upper left corner is `corner`.
fn grid<DB: DrawingBackend>(root: &DrawingArea<DB, Shift>, corner: (i32, i32), map: &Map) -> Drawn<DB> {
    let half = f64::from(MAP) / 2.0;
    let (cx, cy) = (f64::from(corner.0) + half, f64::from(corner.1) + half);
    let at = |radius: f64, phi_deg: f64| {
        let (sin, cos) = phi_deg.to_radians().sin_cos();
        (
            (cx + radius * cos).round() as i32,
            (cy - radius * sin).round() as i32,
        )
    };
    let radius = |theta_deg: f64| half * 2_f64.sqrt() * (theta_deg.to_radians() / 2.0).sin();
    root.draw(&text(&map.title, (cx as i32, corner.1 - 84), 36, HPos::Center))?;
    for theta_deg in RINGS_DEG {
        let ring: Vec<(i32, i32)> = (0..=180)
            .map(|k| at(radius(theta_deg), 2.0 * f64::from(k)))
            .collect();
        let is_rim = theta_deg > 89.0;
        let style = if is_rim {
            BLACK.stroke_width(3)
        } else {
            BLACK.mix(0.55).stroke_width(1)
        };
        root.draw(&PathElement::new(ring, style))?;
        if !is_rim {
            let place = at(radius(theta_deg), 68.0);
            label(root, &format!("{theta_deg}°"), place)?;
        }
    }
    for phi_deg in [0.0, 90.0, 180.0, 270.0] {
        let spoke = vec![at(radius(10.0), phi_deg), at(half, phi_deg)];
        root.draw(&PathElement::new(spoke, BLACK.mix(0.55).stroke_width(1)))?;
        let (x, y) = at(half + 26.0, phi_deg);
        let position = match phi_deg as i32 {
            0 => HPos::Left,
            180 => HPos::Right,
            _ => HPos::Center,
        };
        let x = match position {
            HPos::Left => x - 18,
            HPos::Right => x + 18,
            HPos::Center => x,
        };
        root.draw(&text(&format!("{phi_deg}°"), (x, y), 26, position))?;
    }
    let disk = Disk::new(MAP as usize);
    let (theta_deg, phi_deg) = map.incident_deg;
    for (mark, phi_deg) in [(Mark::Incident, phi_deg), (Mark::Mirror, phi_deg + 180.0)] {
        if let Some(place) = disk.position(from_degrees(theta_deg, phi_deg)) {
            let at = (
                corner.0 + place.x.round() as i32,
                corner.1 + MAP - place.y.round() as i32,
            );
            mark.draw(root, at)?;
        }
    }
    Ok(())
}

/// What is marked on a map.
#[derive(Clone, Copy)]
enum Mark {
    Incident,
    Mirror,
}

impl Mark {
    /// Black upon white, so that it is seen on every colour.
    fn draw<DB: DrawingBackend>(self, root: &DrawingArea<DB, Shift>, at: (i32, i32)) -> Drawn<DB> {
        for (colour, width) in [(WHITE, 7), (BLACK, 3)] {
            match self {
                Self::Incident => {
                    let (x, y) = at;
                    for (from, to) in [((x - 11, y), (x + 12, y)), ((x, y - 11), (x, y + 12))] {
                        root.draw(&PathElement::new(vec![from, to], colour.stroke_width(width)))?;
                    }
                }
                Self::Mirror => {
                    let circle: Vec<(i32, i32)> = (0..=36)
                        .map(|k| f64::from(10 * k).to_radians().sin_cos())
                        .map(|(sin, cos)| {
                            (
                                at.0 + (12.0 * cos).round() as i32,
                                at.1 + (12.0 * sin).round() as i32,
                            )
                        })
                        .collect();
                    root.draw(&PathElement::new(circle, colour.stroke_width(width)))?;
                }
            }
        }
        Ok(())
    }
}

/// A label on white.
fn label<DB: DrawingBackend>(root: &DrawingArea<DB, Shift>, words: &str, (x, y): (i32, i32)) -> Drawn<DB> {
    root.draw(&Rectangle::new(
        [(x - 24, y - 14), (x + 24, y + 14)],
        WHITE.mix(0.8).filled(),
    ))?;
    root.draw(&text(words, (x, y), 26, HPos::Center))
}

/// Words in the middle of a line at `at`.
fn text<'a>(words: &str, at: (i32, i32), size: i32, position: HPos) -> Text<'a, (i32, i32), String> {
    let style = TextStyle::from(("sans-serif", size).into_font()).pos(Pos::new(position, VPos::Center));
    Text::new(words.to_owned(), at, style)
}
