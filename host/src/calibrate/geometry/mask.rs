//! A mask by hand: pixels of the camera's image in which nothing is to be measured.
//!
//! # Design
//! A picture that is white where something is before the mirror, painted over the picture of the diffuse standard that each calibration
//! writes. It may have any number of pixels; it covers the camera's image. Once the geometry is known, what is white becomes obstacles
//! of the calibrated rig, as what is found to be dark does ([`super::shadows`]), and no match and no edge there takes part in the fit. The mask
//! stays in the directory of the calibration and holds whenever it is fitted again.

use std::path::Path;

use glam::DVec2;
use image::{GrayImage, ImageReader, Limits};

use super::outlines::{connected, outlines};
use super::sightings::Sightings;
use crate::calibrate::CalibrateError;
use crate::instrument::frame_format::pixel_centre;
use crate::instrument::optics::View;
use crate::instrument::parts::Obstacle;
use crate::instrument::rig::Rig;
use crate::judge::render::save;

/// Name of the mask in the directory of a calibration.
const MASK: &str = "mask.png";
/// Pixels a side at most, and bytes that reading one may take.
const MOST_PX: u32 = 4096;
const MOST_BYTES: u64 = 1 << 28;
/// Grey values from this on are white.
const WHITE: u8 = 128;
/// Outlines of a mask at most: each is asked for every ray.
const MOST_OUTLINES: usize = 200;
/// Pixels around what is white that may see a part of it.
const BESIDE_PX: f64 = 2.0;

/// Which pixels are hidden.
#[derive(Clone, Debug, PartialEq)]
pub struct Mask {
    picture: GrayImage,
}

impl Mask {
    /// The mask that the picture (PNG) at `path` is.
    ///
    /// # Errors
    /// [`CalibrateError::Mask`] if it is none: not square, too large, nothing white, or nothing else.
    pub fn read(path: &Path) -> Result<Self, CalibrateError> {
        let fail = |expected: String, found: String| CalibrateError::Mask {
            path: path.display().to_string(),
            expected,
            found,
        };
        let none = |error: &dyn std::fmt::Display| fail("a picture (PNG)".to_owned(), error.to_string());
        let mut reader = ImageReader::open(path).map_err(|error| none(&error))?;
        let mut limits = Limits::default();
        limits.max_alloc = Some(MOST_BYTES);
        reader.set_format(image::ImageFormat::Png);
        reader.limits(limits);
        let picture = reader.decode().map_err(|error| none(&error))?.into_luma8();
        let (width, height) = picture.dimensions();
        if width != height || width > MOST_PX {
            return Err(fail(
                format!("as many rows as columns, at most {MOST_PX}, as the camera's image has"),
                format!("{width} × {height} pixels"),
            ));
        }
        let white = picture.as_raw().iter().filter(|grey| **grey >= WHITE).count();
        if white == 0 || white == picture.as_raw().len() {
            return Err(fail(
                "white where something is before the mirror, and black elsewhere".to_owned(),
                format!("nothing {}", if white == 0 { "white" } else { "black" }),
            ));
        }
        Ok(Self { picture })
    }

    /// That in the directory `dir` of a calibration, if there is one.
    pub(super) fn of(dir: &Path) -> Result<Option<Self>, CalibrateError> {
        let path = dir.join(MASK);
        path.exists().then(|| Self::read(&path)).transpose()
    }

    /// Puts it into the directory `dir` of a calibration.
    pub(super) fn keep(&self, dir: &Path) -> Result<(), CalibrateError> {
        Ok(save(&self.picture, &dir.join(MASK))?)
    }

    /// Whether something white is within so many pixels of a position in an image `width` pixels wide.
    fn is_near(&self, at_px: DVec2, width: usize, within_px: f64) -> bool {
        let side = i64::from(self.picture.width());
        let scale = side as f64 / width as f64;
        let first = ((at_px - within_px) * scale).floor().as_i64vec2();
        let last = ((at_px + within_px) * scale).ceil().as_i64vec2();
        let along = |first: i64, last: i64| first.clamp(0, side - 1)..last.clamp(1, side);
        along(first.y, last.y)
            .any(|y| along(first.x, last.x).any(|x| self.picture.get_pixel(x as u32, y as u32).0[0] >= WHITE))
    }

    /// Takes what may be behind it out of what was `seen`.
    pub(super) fn apply(&self, seen: &mut Sightings) {
        let width = seen.width;
        let is_clear = |at: DVec2| !self.is_near(at, width, BESIDE_PX);
        seen.matches.retain(|found| is_clear(found.camera_px));
        seen.edges_px.retain(|at| is_clear(*at));
    }

    /// What it hides from the camera of `rig`, as fitted, whose image is `width` pixels wide.
    ///
    /// # Errors
    /// [`CalibrateError::Mask`] if that is too many shapes.
    pub(super) fn obstacles(&self, rig: &Rig, width: usize) -> Result<Vec<Obstacle>, CalibrateError> {
        let camera = View::camera(&super::without_obstacles(rig));
        let is_seen = |at: DVec2| camera.trace(at.x, at.y).is_ok();
        // Half a pixel to each side is the pixel itself; what lies beside the mirror needs no outline.
        let is_hidden: Vec<bool> = (0..width * width)
            .map(|pixel| {
                let at = pixel_centre(pixel, width);
                self.is_near(at, width, 0.5)
                    && [DVec2::ZERO, DVec2::X, -DVec2::X, DVec2::Y, -DVec2::Y]
                        .iter()
                        .any(|step| is_seen(at + *step))
            })
            .collect();
        let outlines = outlines("mask", &connected(&is_hidden, width), width, &camera);
        if outlines.len() > MOST_OUTLINES {
            return Err(CalibrateError::Mask {
                path: MASK.to_owned(),
                expected: format!("shapes that at most {MOST_OUTLINES} polygons enclose"),
                found: outlines.len().to_string(),
            });
        }
        Ok(outlines)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A mask of so many pixels a side, white where `is_white` says so of a place between 0 and 1.
    fn mask(side: u32, is_white: impl Fn(DVec2) -> bool) -> Mask {
        let picture = GrayImage::from_fn(side, side, |x, y| {
            let at = (DVec2::new(f64::from(x), f64::from(y)) + 0.5) / f64::from(side);
            image::Luma([if is_white(at) { 255 } else { 0 }])
        });
        Mask { picture }
    }

    #[test]
    fn what_is_white_is_hidden_and_little_beside_whatever_the_size_of_the_picture() {
        let is_bar = |at: DVec2| (0.3..0.36).contains(&at.y) && at.x > 0.4;
        let is_disc = |at: DVec2| at.distance(DVec2::new(0.4, 0.7)) < 0.05;
        let is_half = |at: DVec2| at.x < 0.5;
        let shapes: [&dyn Fn(DVec2) -> bool; 3] = [&is_bar, &is_disc, &is_half];
        for (preset, size, side) in [("rcg-3", 96, 192), ("rcg-1", 64, 64), ("rcg-2", 128, 50)] {
            let rig = super::super::without_obstacles(&Rig::load(preset).unwrap())
                .with_image_size(size)
                .unwrap();
            let width = size as usize;
            let anyway = View::camera(&rig).cut_pixels(0.0);
            for (number, is_white) in shapes.iter().enumerate() {
                let mut masked = rig.clone();
                masked.obstacles = mask(side, is_white).obstacles(&rig, width).unwrap();
                let cut = View::camera(&masked).cut_pixels(0.0);
                let (mut missed, mut hidden, mut beside) = (0, 0, 0);
                for pixel in (0..cut.len()).filter(|pixel| anyway[*pixel].is_none()) {
                    let is_white = is_white(pixel_centre(pixel, width) / f64::from(size));
                    missed += usize::from(is_white && cut[pixel].is_none());
                    hidden += usize::from(is_white);
                    beside += usize::from(!is_white && cut[pixel].is_some());
                }
                println!(
                    "{preset}, shape {number}: {hidden} hidden, {beside} beside, {} outlines",
                    masked.obstacles.len()
                );
                assert!(
                    hidden > 5 && missed == 0,
                    "{preset}, shape {number}: {missed} of {hidden} missed"
                );
                assert!(
                    beside < 30 + 2 * hidden,
                    "{preset}, shape {number}: {beside} beside {hidden}"
                );
                masked.validate().unwrap();
            }
        }
    }

    #[test]
    fn matches_and_edges_behind_it_are_taken_out() {
        let at = |x, y| DVec2::new(x, y);
        let of = |camera_px| super::super::sightings::Match {
            view: 0,
            camera_px,
            projector_px: DVec2::ONE,
        };
        let mut seen = Sightings {
            matches: vec![of(at(5.5, 5.5)), of(at(11.0, 5.5)), of(at(25.5, 5.5))],
            edges_px: vec![at(9.0, 31.0), at(30.0, 30.0)],
            width: 32,
            ..Sightings::default()
        };
        mask(64, |at| at.x < 0.3).apply(&mut seen);
        assert_eq!(seen.matches, [of(at(25.5, 5.5))]);
        assert_eq!(seen.edges_px, [at(30.0, 30.0)]);
    }
}
