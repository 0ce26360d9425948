//! The instrument while somebody aligns it: one picture after the other of what they choose to show, and what is to be seen in it.
//!
//! # Design
//! | file | holds |
//! |---|---|
//! | `shown` | what the projector shows |
//! | `look` | histogram, saturation, sharpness of a frame, and the frame as a picture |
//! | `outline` | where edges and the spot are expected in it, and how far from there they are seen |
//! | `checklist` | what is done on the way from first light to a calibration |
//!
//! A [`Table`] is the virtual rig or the real one behind the same seams as in a measurement: each picture is one trigger of the box. What
//! fails (a camera that is gone, a box that is unplugged) is an error of one picture; the next one opens the instrument anew. On
//! the virtual rig the parts can be moved as hands would.

mod checklist;
mod look;
mod outline;
mod shown;

use std::path::Path;

use serde::Serialize;

pub use checklist::{Item, Witness, checklist};
pub use look::{CLASSES, Look, Picture, SATURATED};
pub use outline::{Outline, Seen};
pub use shown::Shown;

use super::by_hand::{Hands, Place, RealBench, held_of};
use super::geometry::alignment::{Motion, Part, apply};
use super::geometry::{self, ByHand, Request, Said, TILT_UNCERTAINTY_DEG, TILTS};
use super::{CalibrateError, brightness};
use crate::base::progress::Progress;
use crate::capture::camera::CameraError;
use crate::capture::pilot::TestExposures;
use crate::capture::{CaptureError, Instrument, Tally, real};
use crate::instrument::frame_format::FrameFormat;
use crate::instrument::optics::View;
use crate::instrument::rig::Rig;
use crate::plan;
use crate::plan::pattern::PatternMaker;
use crate::plan::schedule::Timing;
use crate::virtual_rig::setup::{SetupError, World};
use crate::virtual_rig::{Held, Tolerances, Truth};

/// Pixels a side of the image in the views by which moves are found.
const VIEW_PX: u32 = 128;
/// Gains in decibels that a virtual camera has.
pub const GAINS_DB: std::ops::RangeInclusive<f64> = 0.0..=24.0;

/// What is chosen.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// What the projector shows.
    pub shown: Shown,
    /// Exposure time, s.
    pub exposure_s: f64,
    /// Gain: decibels of the virtual camera, the camera's own unit of a real one; `None` as it is set.
    pub gain: Option<f64>,
    /// What stands in the holder: `mirror TILT AZIMUTH` (degrees), `nothing`, or a sample.
    pub held: String,
}

/// Where the instrument stands.
#[derive(Clone, Debug)]
enum Site {
    /// Nowhere: how it really is, and whether its camera is plugged in.
    Virtual {
        world: Box<World>,
        truth: Box<Truth>,
        is_plugged: bool,
    },
    Real,
}

/// The instrument that is aligned.
pub struct Table {
    /// As its file has it.
    nominal: Rig,
    /// As its file or calibration has it, with images of the size that is looked at.
    rig: Rig,
    site: Site,
    settings: Settings,
    maker: PatternMaker,
    camera: View,
    lit: Vec<u32>,
    instrument: Option<Instrument>,
    pictures: u64,
    tally: Tally,
}

/// What STROBE said of an exposure.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Strobe {
    /// From the trigger at the camera to the beginning of the exposure, µs.
    pub delay_us: f64,
    /// How long the camera exposed, µs.
    pub width_us: f64,
}

/// One exposure and what it shows.
#[derive(Clone, Debug)]
pub struct Shot {
    /// How often the trigger was fired, at least once.
    pub attempts: u8,
    /// What STROBE said.
    pub strobe: Strobe,
    /// Its figures.
    pub look: Look,
    /// The frame for eyes.
    pub picture: Picture,
    /// What is expected in it, and seen.
    pub outlines: Vec<Outline>,
}

impl Table {
    /// That of a `nominal` rig, of which `known` is what a calibration found, or the same; images have `image_size` pixels a side. `world`
    /// is the virtual rig; `None` for the one on the table.
    ///
    /// # Errors
    /// [`CalibrateError`] if the settings cannot be.
    pub fn new(
        (nominal, known): (&Rig, &Rig),
        image_size: u32,
        world: Option<World>,
        settings: Settings,
    ) -> Result<Self, CalibrateError> {
        let rig = known.with_image_size(image_size)?;
        let site = world.map_or(Site::Real, |world| Site::Virtual {
            truth: Box::new(world.truth(nominal)),
            world: Box::new(world),
            is_plugged: true,
        });
        let mut table = Self {
            nominal: nominal.clone(),
            maker: PatternMaker::new(View::projector(&rig), rig.light.spot_deg, 1.0),
            camera: View::camera(&rig),
            rig,
            site,
            settings: settings.clone(),
            lit: Vec::new(),
            instrument: None,
            pictures: 0,
            tally: Tally::default(),
        };
        table.set(settings)?;
        Ok(table)
    }

    /// What is chosen.
    #[must_use]
    pub const fn settings(&self) -> &Settings {
        &self.settings
    }

    /// The rig as it is expected to be, with images as they are looked at.
    #[must_use]
    pub const fn rig(&self) -> &Rig {
        &self.rig
    }

    /// Whether it is the virtual rig.
    #[must_use]
    pub const fn is_virtual(&self) -> bool {
        matches!(self.site, Site::Virtual { .. })
    }

    /// Shape of its frames.
    #[must_use]
    pub fn format(&self) -> FrameFormat {
        self.rig.frame_format()
    }

    /// What was paired, missed and dropped so far.
    #[must_use]
    pub const fn tally(&self) -> &Tally {
        &self.tally
    }

    /// How the virtual rig really is.
    #[must_use]
    pub fn truth(&self) -> Option<&Truth> {
        match &self.site {
            Site::Virtual { truth, .. } => Some(truth),
            Site::Real => None,
        }
    }

    /// Chooses something else; all stays as it was if that cannot be.
    ///
    /// # Errors
    /// [`CalibrateError::Choice`] or that of the exposure time.
    pub fn set(&mut self, settings: Settings) -> Result<(), CalibrateError> {
        let lit = settings
            .shown
            .lit(&self.maker, self.rig.projector.lens.centre_px)
            .map_err(CalibrateError::Choice)?;
        Timing::new(&self.rig, settings.exposure_s).map_err(plan::PlanError::from)?;
        held_of(&settings.held, &self.rig)
            .map_err(|error| CalibrateError::Choice(error.replace("put ", "")))?;
        if let Some(gain) = settings.gain {
            let is_known = match self.site {
                Site::Virtual { .. } => GAINS_DB.contains(&gain),
                Site::Real => self.nominal.camera.genicam.is_some() && gain.is_finite(),
            };
            if !is_known {
                return Err(CalibrateError::Choice(format!(
                    "gain: expected {} to {} dB on the virtual rig, or what a GenICam camera has, found {gain}",
                    GAINS_DB.start(),
                    GAINS_DB.end()
                )));
            }
        }
        // What is shown and how long needs no other instrument.
        if settings.held != self.settings.held || settings.gain != self.settings.gain {
            self.instrument = None;
        }
        self.settings = settings;
        self.lit = lit;
        Ok(())
    }

    /// Takes a picture: one trigger.
    ///
    /// # Errors
    /// [`CalibrateError`]; the instrument is opened anew for the next one.
    pub fn shoot(&mut self) -> Result<Shot, CalibrateError> {
        let taken = self.taken();
        if taken.is_err() {
            self.instrument = None;
        }
        taken
    }

    fn taken(&mut self) -> Result<Shot, CalibrateError> {
        let timing = Timing::new(&self.rig, self.settings.exposure_s).map_err(plan::PlanError::from)?;
        if self.instrument.is_none() {
            self.instrument = Some(self.open()?);
        }
        let instrument = self.instrument.as_mut().expect("invariant: opened above");
        // No two pictures have the same noise.
        instrument.camera.begin_part(self.pictures);
        let lit = &self.lit;
        let mut shots =
            instrument.take(1, &[timing], |_, image| image.light(lit), &mut self.tally, |_| {})?;
        self.pictures += 1;
        let us = 1e6 / f64::from(instrument.device.info().clock_hz);
        let shot = shots.pop().expect("invariant: one picture of one pattern");
        let [trigger, on, off] = shot.ticks.map(|ticks| ticks.0 as f64 * us);
        let format = self.format();
        Ok(Shot {
            attempts: shot.attempts,
            strobe: Strobe {
                delay_us: on - trigger,
                width_us: off - on,
            },
            look: Look::of(&shot.dn, format, self.rig.camera.dark_dn),
            picture: Picture::of(&shot.dn, format),
            outlines: self.outlines(Some(&shot.dn)),
        })
    }

    /// What is expected in a frame, and seen in that of digital numbers `dn`, if there is one.
    #[must_use]
    pub fn outlines(&self, dn: Option<&[u16]>) -> Vec<Outline> {
        let format = self.format();
        let light = dn.map(|dn| brightness(dn, format.channels));
        let frame = light.as_ref().map(|light| outline::Brightness {
            light,
            width_px: format.width_px,
        });
        // In a mirror one sees the projector's image, whose edges are no edges of the rig.
        let mirror = match held_of(&self.settings.held, &self.rig) {
            Ok(Held::Mirror(mirror)) => Some(mirror.normal),
            _ => None,
        };
        let mut outlines = outline::edges(&self.camera, frame.filter(|_| mirror.is_none()));
        if let (Shown::Spot { theta_deg, phi_deg }, Some(mirror)) = (self.settings.shown, mirror) {
            let light = [theta_deg, phi_deg];
            outlines.extend(outline::spot(
                &self.camera,
                light,
                mirror,
                self.rig.light.spot_deg,
                frame,
            ));
        }
        outlines
    }

    /// The exposure time, s, that fills the camera's range with what is shown.
    ///
    /// # Errors
    /// [`CalibrateError`].
    pub fn auto_exposure_s(&mut self) -> Result<f64, CalibrateError> {
        let mut instrument = match self.instrument.take() {
            Some(instrument) => instrument,
            None => self.open()?,
        };
        let tests = TestExposures::take(&self.rig, std::slice::from_ref(&self.lit), &mut instrument)?;
        self.instrument = Some(instrument);
        Ok(tests.auto_s(&self.rig))
    }

    fn open(&self) -> Result<Instrument, CalibrateError> {
        match &self.site {
            Site::Virtual {
                world,
                truth,
                is_plugged,
            } => {
                if !is_plugged {
                    let camera = "virtual".to_owned();
                    return Err(CaptureError::from(CameraError::Disconnected { camera }).into());
                }
                let held = held_of(&self.settings.held, &self.rig).map_err(CalibrateError::Choice)?;
                let mut truth = Truth::clone(truth);
                // So many decibels fill the converter with fewer electrons.
                truth.rig.camera.full_well_e /= 10_f64.powf(self.settings.gain.unwrap_or(0.0) / 20.0);
                Ok(world.moved(truth).open_held(&self.rig, held, None)?)
            }
            Site::Real => {
                let mut rig = self.rig.clone();
                if let (Some(genicam), Some(gain)) = (&mut rig.camera.genicam, self.settings.gain) {
                    genicam.gain = Some(gain);
                }
                Ok(real::open(&rig).map_err(SetupError::from)?)
            }
        }
    }

    /// Changes how the virtual rig really is, as hands would.
    ///
    /// # Errors
    /// [`CalibrateError::Choice`] on a real one, or where no such rig can be.
    fn change(
        &mut self,
        change: impl FnOnce(&mut Truth) -> Result<(), CalibrateError>,
    ) -> Result<(), CalibrateError> {
        let Site::Virtual { truth, .. } = &mut self.site else {
            return Err(CalibrateError::Choice(
                "expected hands to move a real instrument, found a command, which moves the virtual rig alone".to_owned(),
            ));
        };
        let mut changed = truth.clone();
        change(&mut changed)?;
        changed.rig.validate()?;
        *truth = changed;
        self.instrument = None;
        Ok(())
    }

    /// Moves a part of the virtual rig by so many millimetres or degrees.
    ///
    /// # Errors
    /// [`CalibrateError::Choice`] on a real rig; [`CalibrateError::Rig`] where no such rig can be.
    pub fn move_part(&mut self, part: Part, motion: Motion, by: f64) -> Result<(), CalibrateError> {
        self.change(|truth| {
            apply(&mut truth.rig, part, motion, by);
            Ok(())
        })
    }

    /// Draws by `seed` how the virtual rig stands: each coordinate of a position off by `position_mm` (k = 1), each angle by `angle_deg`.
    /// The sample lies where it should: its place no direction tells, and a frame is dark where what is lit is not what is seen.
    ///
    /// # Errors
    /// As [`move_part`](Self::move_part).
    pub fn misalign(&mut self, seed: u64, position_mm: f64, angle_deg: f64) -> Result<(), CalibrateError> {
        let nominal = self.nominal.clone();
        self.change(|truth| {
            let tolerances = Tolerances {
                position_m: position_mm * 1e-3,
                angle_deg,
                ..Tolerances::DRAWN
            };
            *truth = Truth::drawn(&nominal, tolerances, seed)?;
            truth.rig.sample.offset_m = nominal.sample.offset_m;
            Ok(())
        })
    }

    /// Plugs the virtual camera in, or out.
    ///
    /// # Errors
    /// [`CalibrateError::Choice`] on a real rig.
    pub fn plug(&mut self, is_in: bool) -> Result<(), CalibrateError> {
        self.change(|_| Ok(()))?;
        if let Site::Virtual { is_plugged, .. } = &mut self.site {
            *is_plugged = is_in;
        }
        Ok(())
    }

    /// Captures the views of a flat mirror and a diffuse standard by which moves, or a calibration, are found, into the directory `dir`;
    /// whether all were taken. The virtual rig holds by itself what is asked for, `hands` put it into a real one.
    ///
    /// # Errors
    /// [`CalibrateError`].
    pub fn views(
        &mut self,
        dir: &Path,
        image_size: Option<u32>,
        hands: &mut dyn Hands,
        progress: &dyn Progress,
    ) -> Result<bool, CalibrateError> {
        // Its port and its camera are wanted.
        self.instrument = None;
        let request = Request {
            rig: self.nominal.clone(),
            tilts: TILTS.to_vec(),
            image_size: image_size.unwrap_or(VIEW_PX),
            tilt_uncertainty_deg: TILT_UNCERTAINTY_DEG,
        };
        match &self.site {
            Site::Virtual {
                is_plugged: false, ..
            } => self.open().map(|_| true),
            Site::Virtual { world, truth, .. } => {
                let world = world.moved(Truth::clone(truth));
                geometry::capture(&request, dir, &world, progress)?;
                Ok(true)
            }
            Site::Real => {
                let place = Place::Real(&self.nominal);
                let mut by_hand = ByHand::open(&request, &Said::default(), dir, place, &[])?;
                let mut bench = RealBench { rig: &self.nominal };
                let how_far = by_hand.take(&mut bench, hands, progress)?;
                Ok(how_far.missing.is_empty())
            }
        }
    }
}
