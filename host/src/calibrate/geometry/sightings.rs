//! What the frames of the views say: matches of camera and projector, and edges of the mirror.

use glam::DVec2;

use super::super::brightness;
use super::Views;
use crate::instrument::frame_format::{FrameFormat, pixel_centre};
use crate::plan::stripes::Stripes;
use crate::store::{RawStore, Segment, StoreError};

/// Matches of one view that take part, at most.
const MATCHES: usize = 1500;
/// Edge positions that take part, at most.
const EDGES: usize = 2000;
/// What is brighter than this share of the usual brightness of the diffuse standard is seen.
const SEEN: f32 = 0.4;

/// A pixel that is darker than this share of those beside it is cut by an edge; one that is darker than [`DARK`] sees nothing.
const WHOLE: f32 = 0.87;
const DARK: f64 = 0.1;
/// Pixels that an edge across a line may cut, and then one without light.
const FADE: usize = 3;
/// Pixels in which a wire may be seen as a whole.
const NARROW: usize = 3;

/// A camera position that sees a projector position in the flat mirror, both pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Match {
    /// Index of the view.
    pub(super) view: usize,
    pub(super) camera_px: DVec2,
    pub(super) projector_px: DVec2,
}

/// All that was seen.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Sightings {
    pub(super) matches: Vec<Match>,
    /// Camera positions at which the diffuse standard ceases to be seen.
    pub(super) edges_px: Vec<DVec2>,
    /// The light of the diffuse standard, row by row, and the width of that image.
    pub(super) standard: Vec<f32>,
    pub(super) width: usize,
}

impl Sightings {
    /// What the frames `raw` of `views` say.
    pub(super) fn read(views: &Views, raw: &RawStore) -> Result<Self, StoreError> {
        let (layout, stripes) = (*raw.layout(), views.stripes());
        let mut sightings = Self::default();
        for index in 0..raw.segments() {
            let length = layout.height * layout.width * layout.channels;
            let frames = Self::frames(&raw.read_segment(index)?, length, layout.channels);
            if index < views.tilts.len() {
                sightings.add_matches(index, &stripes, &frames, layout.width);
            } else {
                sightings.add_edges(&frames, layout.width);
            }
        }
        Ok(sightings)
    }

    /// Coarse matches, `most` of them, of a view of the flat mirror that is `taken` with images of this `format`.
    pub(super) fn coarse(
        views: &Views,
        format: FrameFormat,
        view: usize,
        taken: &Segment,
        most: usize,
    ) -> Vec<Match> {
        let frames = Self::frames(taken, format.len(), format.channels);
        let positions = views.stripes().decode_coarsely(&frames);
        let matches = positions.iter().enumerate().filter_map(|(pixel, position)| {
            Some(Match {
                view,
                camera_px: pixel_centre(pixel, format.width_px),
                projector_px: (*position)?,
            })
        });
        thinned(&matches.collect::<Vec<_>>(), most)
    }

    /// The brightness of the frames of a `segment`, each of so many values.
    pub(super) fn frames(segment: &Segment, length: usize, channels: usize) -> Vec<Vec<f32>> {
        let frames = segment.frames.chunks_exact(length);
        frames.map(|frame| brightness(frame, channels)).collect()
    }

    /// No more than so many matches of each view, and no edges.
    pub(super) fn thinned(&self, most: usize) -> Self {
        let views = self.matches.last().map_or(0, |last| last.view + 1);
        let of_view = |view: usize| -> Vec<Match> {
            self.matches
                .iter()
                .copied()
                .filter(|found| found.view == view)
                .collect()
        };
        Self {
            matches: (0..views)
                .flat_map(|view| thinned(&of_view(view), most))
                .collect(),
            ..Self::default()
        }
    }

    fn add_matches(&mut self, view: usize, stripes: &Stripes, frames: &[Vec<f32>], width: usize) {
        let positions = stripes.decode(frames);
        let height = positions.len() / width;
        // A pixel on an edge sees only a part of what it would see: its neighbours tell.
        let inner = |pixel: usize| {
            let (x, y) = (pixel % width, pixel / width);
            (1..width - 1).contains(&x)
                && (1..height - 1).contains(&y)
                && (y - 1..=y + 1).all(|y| (x - 1..=x + 1).all(|x| positions[y * width + x].is_some()))
        };
        let found: Vec<Match> = (0..positions.len())
            .filter(|&pixel| inner(pixel))
            .filter_map(|pixel| {
                Some(Match {
                    view,
                    camera_px: pixel_centre(pixel, width),
                    projector_px: positions[pixel]?,
                })
            })
            .collect();
        self.matches.extend(thinned(&found, MATCHES));
    }

    fn add_edges(&mut self, frames: &[Vec<f32>], width: usize) {
        let light: Vec<f32> = frames[0]
            .iter()
            .zip(&frames[1])
            .map(|(lit, dark)| lit - dark)
            .collect();
        self.width = width;
        self.standard.clone_from(&light);
        let highest = light.iter().copied().fold(0.0, f32::max);
        let mut bright: Vec<f32> = light.iter().copied().filter(|&dn| dn > 0.1 * highest).collect();
        if bright.is_empty() {
            return;
        }
        let middle = bright.len() / 2;
        let usual = *bright.select_nth_unstable_by(middle, f32::total_cmp).1;
        let height = light.len() / width;
        let mut found = Vec::new();
        for y in 0..height {
            let along = edges_along(&light[y * width..][..width], usual);
            found.extend(along.into_iter().map(|x| DVec2::new(x, y as f64 + 0.5)));
        }
        for x in 0..width {
            let column: Vec<f32> = light[x..].iter().step_by(width).copied().collect();
            let along = edges_along(&column, usual);
            found.extend(along.into_iter().map(|y| DVec2::new(x as f64 + 0.5, y)));
        }
        self.edges_px = thinned(&found, EDGES);
    }
}

/// Where light ends along one line of pixels of which `usual` is the usual brightness: positions in pixels, to a part of a
/// pixel.
///
/// A pixel that an edge cuts is as bright as the share of it that sees the standard, of the whole pixel beside it. What lies
/// between two whole pixels and is narrow (a wire) is as wide as its shares of darkness together, around their centroid.
fn edges_along(line: &[f32], usual: f32) -> Vec<f64> {
    let is_whole: Vec<bool> = (0..line.len())
        .map(|at| {
            let around = at.saturating_sub(2)..(at + 3).min(line.len());
            let highest = line[around].iter().copied().fold(0.0, f32::max);
            line[at] > SEEN * usual && line[at] > WHOLE * highest
        })
        .collect();
    let mut found = Vec::new();
    let mut at = 0;
    while at < line.len() {
        let first = at;
        while at < line.len() && is_whole[at] == is_whole[first] {
            at += 1;
        }
        if is_whole[first] {
            continue;
        }
        let dark = &line[first..at];
        let share = |value: f32, whole: f32| f64::from(value / whole).clamp(0.0, 1.0);
        let [before, after] = [first.checked_sub(1), Some(at)].map(|beside| line.get(beside?).copied());
        if let (Some(before), Some(after), true) = (before, after, dark.len() <= NARROW) {
            let whole = f32::midpoint(before, after);
            let missing = dark.iter().map(|&value| 1.0 - share(value, whole));
            let width: f64 = missing.clone().sum();
            let moment: f64 = missing
                .enumerate()
                .map(|(place, part)| part * (place as f64 + 0.5))
                .sum();
            let centre = first as f64 + moment / width;
            found.extend([centre - width / 2.0, centre + width / 2.0]);
            continue;
        }
        // What is left of the light, up to where there is none.
        let fade = |pixels: &mut dyn Iterator<Item = &f32>, whole: f32| {
            let mut left = 0.0;
            for &value in pixels.take(FADE) {
                let share = share(value, whole);
                if share < DARK {
                    return Some(left + share);
                }
                left += share;
            }
            None
        };
        if let Some(left) = before.and_then(|whole| fade(&mut dark.iter(), whole)) {
            found.push(first as f64 + left);
        }
        if let Some(left) = after.and_then(|whole| fade(&mut dark.iter().rev(), whole)) {
            found.push(at as f64 - left);
        }
    }
    found
}

/// Every so-manieth of `all`, so that about `most` are left.
fn thinned<T: Copy>(all: &[T], most: usize) -> Vec<T> {
    all.iter()
        .copied()
        .step_by(all.len().div_ceil(most).max(1))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Pixels of a line that is lit but from `from` to `to`, with a brightness that changes along it.
    fn line(from: f64, to: f64) -> Vec<f32> {
        (0..40)
            .map(|at| {
                let (low, high) = (f64::from(at), f64::from(at) + 1.0);
                let hidden = (to.min(high) - from.max(low)).max(0.0);
                ((1.0 - hidden) * (1000.0 + 10.0 * low)) as f32
            })
            .collect()
    }

    #[test]
    fn edges_are_found_to_a_part_of_a_pixel_and_wires_that_are_narrower_than_one() {
        for start in 0..10 {
            let from = 12.0 + 0.1 * f64::from(start);
            for width in [0.3, 0.6, 1.0, 1.7, 3.1, 8.0, 12.4] {
                let found = edges_along(&line(from, from + width), 1000.0);
                assert_eq!(found.len(), 2, "{from} {width}: {found:?}");
                let middle = f64::midpoint(found[0], found[1]) - from - width / 2.0;
                // Where in a pixel a wire is that is narrower nobody knows, nor what it hides of the next one, if that is little.
                let unknown = 0.5 * (1.0 - width) + 1.0 - f64::from(WHOLE) + 0.01;
                assert!(middle.abs() < unknown.max(0.2), "{from} {width}: {found:?}");
                assert!(
                    (found[1] - found[0] - width).abs() < 0.2,
                    "{from} {width}: {found:?}"
                );
            }
        }
        assert!(edges_along(&line(0.0, 0.0), 1000.0).is_empty());
        // Dark up to the border: one edge.
        let found = edges_along(&line(25.3, 50.0), 1000.0);
        assert!(found.len() == 1 && (found[0] - 25.3).abs() < 0.05, "{found:?}");
    }
}
