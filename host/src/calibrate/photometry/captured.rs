//! The frames of a calibration, and what each of them is for.

use std::path::Path;

use super::camera::Times;
use super::capture::{SEGMENT, Shows, VIEWS, Views, primary};
use super::crosstalk::Colours;
use super::frames::{Frames, Lit};
use super::interreflection::{interreflected, interreflection};
use super::linear::Linear;
use super::pixels::{self, Layout, every_second};
use super::rank_one::Seen;
use super::{CalibrateError, capture};
use crate::base::text::by;
use crate::brdf::sample::Sample;
use crate::instrument::calibration::photometry::COMMAND;
use crate::instrument::calibration::stray::Removal;
use crate::instrument::calibration::{CalibrationError, Crosstalk, Interreflection, LampFound, Stray};
use crate::instrument::rig::Rig;
use crate::plan::Exposure;
use crate::store::{RawStore, Segment};

/// Mean black frames of a stand, linear digital numbers above the dark level.
pub(super) struct Black {
    /// With what watches the lamp, as in all other frames, and without.
    pub(super) light: Vec<f64>,
    pub(super) unwatched: Vec<f64>,
    /// Frames of both.
    pub(super) counts: [usize; 2],
}

/// What of the light in frames is not the spot's, or not the lamp's as it was.
#[derive(Clone, Copy)]
pub(super) struct OtherLight<'a> {
    pub(super) stray: &'a Stray,
    pub(super) lamp: &'a LampFound,
}

/// All frames of the views, by what they show.
pub(super) struct Captured<'a> {
    views: &'a Views,
    /// What each segment shows.
    shows: Vec<Shows>,
    segments: Vec<Segment>,
    /// Digital numbers of a frame.
    length: usize,
}

impl<'a> Captured<'a> {
    /// The frames in `raw` of the `views` in `dir`; `rig` has the camera's image as captured.
    pub(super) fn read(
        dir: &Path,
        views: &'a Views,
        raw: &RawStore,
        rig: &Rig,
    ) -> Result<Self, CalibrateError> {
        let shows = views.segments();
        let format = rig.frame_format();
        let layout = raw.layout();
        let expected = [
            shows.len() * SEGMENT,
            SEGMENT,
            format.height_px,
            format.width_px,
            format.channels,
        ];
        let found = [
            layout.exposures,
            layout.segment,
            layout.height,
            layout.width,
            layout.channels,
        ];
        if expected != found {
            return Err(CalibrationError::Content {
                path: dir.join(capture::RAW).display().to_string(),
                field: "exposures × segment × rows × columns × channels".to_owned(),
                expected: format!(
                    "{} as {VIEWS} says; of another version? `{COMMAND}` captures again",
                    by(&expected)
                ),
                found: by(&found),
            }
            .into());
        }
        let segments: Vec<Segment> = (0..raw.segments())
            .map(|index| raw.read_segment(index))
            .collect::<Result<_, _>>()?;
        Ok(Self {
            views,
            shows,
            segments,
            length: format.len(),
        })
    }

    /// The frames of the segment that shows what is `wanted`; none if there is none.
    fn frames(&self, wanted: Shows) -> Vec<&[u16]> {
        let at = self.shows.iter().position(|shows| *shows == wanted);
        at.map(|at| self.segments[at].frames.chunks_exact(self.length).collect())
            .unwrap_or_default()
    }

    /// What the black segment shows that is `wanted`.
    pub(super) fn black(&self, wanted: Shows, linear: &Linear) -> Black {
        let (watched, others): (Vec<_>, Vec<_>) = self
            .frames(wanted)
            .into_iter()
            .enumerate()
            .partition(|(exposure, _)| Exposure::black(*exposure) == Exposure::Black);
        let mean = |frames: Vec<(usize, &[u16])>| {
            let frames: Vec<&[u16]> = frames.into_iter().map(|(_, frame)| frame).collect();
            linear.mean(&frames)
        };
        Black {
            counts: [watched.len(), others.len()],
            light: mean(watched),
            unwatched: mean(others),
        }
    }

    /// The frames of each exposure time of the series.
    pub(super) fn series(&self) -> Vec<Times<'_>> {
        (0..self.views.times_s.len())
            .map(|index| {
                let mut lit = self.frames(Shows::Series(index));
                let black = lit.split_off(SEGMENT / 2);
                Times {
                    exposure_s: self.views.times_s[index],
                    lit,
                    black,
                    dark: self.frames(Shows::Dark(index)),
                    lamp: vec![1.0; self.views.rig.shown_bands()],
                }
            })
            .collect()
    }

    /// Light of each level, relative to the last, and what a black pattern adds to the darkness at the shortest time of the
    /// `series`, linear digital numbers.
    pub(super) fn levels(&self, linear: &Linear, series: &[Times]) -> (Vec<f64>, Vec<f64>) {
        let levels = self.frames(Shows::Levels);
        // Of level 0, which nothing else is beside.
        let black = linear.mean(&levels[..1]);
        let dark = linear.mean(&series[0].dark);
        let light = black.iter().zip(dark).map(|(black, dark)| black - dark);
        (linear.levels(&levels, &black), light.collect())
    }

    /// What the camera's colours show of each other, by the `standard` and a lamp with this `flicker`; `None` if it has none.
    ///
    /// # Errors
    /// [`CalibrateError::Views`] if there is too little light to tell.
    pub(super) fn crosstalk(
        &self,
        linear: &Linear,
        standard: &dyn Sample,
        flicker: f64,
    ) -> Result<Option<Crosstalk>, CalibrateError> {
        let frames = self.frames(Shows::Colours);
        if frames.is_empty() {
            return Ok(None);
        }
        let of = |wanted: Option<usize>| -> Vec<&[u16]> {
            let numbered = frames.iter().enumerate();
            let wanted = numbered.filter(|(exposure, _)| primary(*exposure) == wanted);
            wanted.map(|(_, frame)| *frame).collect()
        };
        let format = self.views.rig_of(0)?.frame_format();
        let colours = Colours {
            of_primary: std::array::from_fn(|primary| of(Some(primary))),
            black: of(None),
            size_px: [format.width_px, format.height_px],
            standard,
            flicker,
        };
        let found = colours.crosstalk(linear);
        found.map(Some).ok_or_else(|| CalibrateError::Views {
            expected: "frames of the standard in red, green and blue light".to_owned(),
            found: "too little light to tell what the camera's colours show of each other".to_owned(),
            advice: "is the standard in place, and lit?",
        })
    }

    /// What was seen of the `standard` at the stand of this index, and the frames of it; `black` is its black frame, linear.
    pub(super) fn standard_at<'b>(
        &'b self,
        stand: usize,
        linear: &'b Linear,
        black: &'b Black,
        other: OtherLight<'_>,
        standard: &'b dyn Sample,
    ) -> Result<(Seen<'b>, Frames<'b>), CalibrateError> {
        let mut seen = Seen::new(self.views, stand)?;
        let removal = self.removal(stand, other)?;
        seen.compare_lamp(&removal, black)?;
        let is_of_it = |shows: Shows| match shows {
            Shows::Directions(of, first) if of == stand => Some(first),
            _ => None,
        };
        let lit = self.lit(
            &mut seen,
            is_of_it,
            linear,
            black,
            &removal,
            (standard, &self.views.standard),
        )?;
        let frames = Frames {
            linear,
            black: &black.light,
            lit,
            standard,
        };
        Ok((seen, frames))
    }

    /// The frames of incident directions of a standard and its name, which `seen` takes: those of segments for which `first_of` says
    /// which place is the first.
    fn lit<'b>(
        &'b self,
        seen: &mut Seen<'b>,
        first_of: impl Fn(Shows) -> Option<usize>,
        linear: &Linear,
        black: &Black,
        removal: &Removal,
        (standard, spec): (&dyn Sample, &str),
    ) -> Result<Vec<Lit<'b>>, CalibrateError> {
        let dark = black.light.as_slice();
        let (mut places, mut lit) = (Vec::new(), Vec::new());
        for shows in self.shows.iter().copied() {
            if let Some(first) = first_of(shows) {
                let frames = seen.lit(first, &self.frames(shows), linear, dark, removal);
                places.push((first, frames.len()));
                lit.extend(frames);
            }
        }
        Seen::set_lamp(&mut lit, removal, black.counts[0]);
        let mut rest = lit.as_slice();
        for (first, count) in places {
            let frames;
            (frames, rest) = rest.split_at(count);
            seen.add(first, frames, linear, dark, standard, spec)?;
        }
        Ok(lit)
    }

    /// Standard deviation of the response over the sensor's pixels, from all that was `seen` of the standard; `None` if that is
    /// too little.
    pub(super) fn prnu(&self, seen: &[Seen], linear: &Linear, layout: &Layout) -> Option<f64> {
        // Of the exposure time of the standard.
        let dark = self.frames(Shows::Dark(self.views.times_s.len() - 1));
        let lit = seen.iter().enumerate().map(|(stand, seen)| {
            let is_of_it = |shows: &Shows| match shows {
                Shows::Black(of) | Shows::Directions(of, _) => *of == stand,
                _ => false,
            };
            let wanted = self.shows.iter().copied().filter(is_of_it);
            let frames: Vec<&[u16]> = wanted.flat_map(|shows| self.frames(shows)).collect();
            let half = |first: usize| {
                let [light, dark] = [&frames, &dark].map(|frames| linear.mean(&every_second(frames, first)));
                light
                    .into_iter()
                    .zip(dark)
                    .map(|(light, dark)| light - dark)
                    .collect()
            };
            pixels::Lit {
                is_whole: seen.whole_pixels(),
                halves: [half(0), half(1)],
            }
        });
        pixels::response(&lit.collect::<Vec<_>>(), layout)
    }

    /// How frames of the standard at the stand of this index lose `other` light.
    fn removal(&self, stand: usize, other: OtherLight) -> Result<Removal, CalibrateError> {
        let side = self.views.stray.watching_side;
        Ok(Removal::of(
            other.stray,
            other.lamp,
            side,
            &self.views.rig_of(stand)?,
        ))
    }

    /// The interreflection from the `second` standard, with its name, beside the `first`, which has its `own` (see
    /// [`interreflected`]); they are known to these relative standard uncertainties.
    pub(super) fn interreflection(
        &self,
        (second, spec): (&dyn Sample, &str),
        linear: &Linear,
        other: OtherLight,
        first: &Seen,
        (own, uncertainties): (f64, [f64; 2]),
    ) -> Result<Interreflection, CalibrateError> {
        let black = self.black(Shows::SecondBlack, linear);
        let removal = self.removal(0, other)?;
        let mut other = Seen::new(self.views, 0)?;
        other.compare_lamp(&removal, &black)?;
        other.judged = first.judged.clone();
        let is_of_it = |shows: Shows| match shows {
            Shows::SecondDirections(first) => Some(first),
            _ => None,
        };
        self.lit(&mut other, is_of_it, linear, &black, &removal, (second, spec))?;
        interreflection(first, &other, (own, interreflected(second)), uncertainties)
    }
}
