//! What the frames of the views say: matches of camera and projector, and edges of the mirror.

use glam::DVec2;

use super::Views;
use crate::store::{RawStore, StoreError};
use crate::stripes::Stripes;

/// Matches of one view that take part, at most.
const MATCHES: usize = 1500;
/// Edge positions that take part, at most.
const EDGES: usize = 2000;
/// Share of the usual brightness of the diffuse standard that divides seen from unseen.
const SEEN: f32 = 0.4;

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
    /// Camera positions between a pixel that sees the diffuse standard and one that does not.
    pub(super) edges_px: Vec<DVec2>,
}

impl Sightings {
    /// What the frames `raw` of `views` say.
    pub(super) fn read(views: &Views, raw: &RawStore) -> Result<Self, StoreError> {
        let (layout, stripes) = (*raw.layout(), views.stripes());
        let mut sightings = Self::default();
        for index in 0..raw.segments() {
            let frames: Vec<Vec<f32>> = raw
                .read_segment(index)?
                .frames
                .chunks_exact(layout.height * layout.width * layout.channels)
                .map(|frame| brightness(frame, layout.channels))
                .collect();
            if index < views.tilts.len() {
                sightings.add_matches(index, &stripes, &frames, layout.width);
            } else {
                sightings.add_edges(&frames, layout.width);
            }
        }
        Ok(sightings)
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
                    camera_px: centre(pixel, width),
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
        let highest = light.iter().copied().fold(0.0, f32::max);
        let mut bright: Vec<f32> = light.iter().copied().filter(|&dn| dn > 0.1 * highest).collect();
        if bright.is_empty() {
            return;
        }
        let middle = bright.len() / 2;
        let usual = *bright.select_nth_unstable_by(middle, f32::total_cmp).1;
        let is_seen = |pixel: usize| light[pixel] > SEEN * usual;
        let mut found = Vec::new();
        for pixel in 0..light.len() {
            let right = (pixel % width + 1 < width).then_some((pixel + 1, DVec2::X));
            let below = (pixel + width < light.len()).then_some((pixel + width, DVec2::Y));
            for (neighbour, step) in [right, below].into_iter().flatten() {
                if is_seen(pixel) != is_seen(neighbour) {
                    found.push(centre(pixel, width) + 0.5 * step);
                }
            }
        }
        self.edges_px = thinned(&found, EDGES);
    }
}

/// Position of a pixel's centre.
fn centre(pixel: usize, width: usize) -> DVec2 {
    DVec2::new((pixel % width) as f64 + 0.5, (pixel / width) as f64 + 0.5)
}

/// Every so-manieth of `all`, so that about `most` are left.
fn thinned<T: Copy>(all: &[T], most: usize) -> Vec<T> {
    all.iter()
        .copied()
        .step_by(all.len().div_ceil(most).max(1))
        .collect()
}

/// Mean over the channels of each pixel.
fn brightness(frame: &[u16], channels: usize) -> Vec<f32> {
    let pixels = frame.chunks_exact(channels);
    pixels
        .map(|dn| dn.iter().map(|&dn| f32::from(dn)).sum::<f32>() / channels as f32)
        .collect()
}
