//! The seam to cameras: frames with the camera's own number and time.
//!
//! # Design
//! A frame is told by its number and time-stamp, never by when it arrives. Numbers count exposures since
//! [`Camera::arm`], those included whose frames were lost on the way, so a gap is a dropped frame.

use std::time::Duration;

use crate::base::blame::Blame;
use crate::instrument::frame_format::FrameFormat;

/// One image.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// Exposures since the camera was armed, starting at 0.
    pub id: u64,
    /// Start of the exposure on the camera's own clock, in seconds.
    pub timestamp_s: f64,
    /// Digital numbers, [row, column, channel].
    pub dn: Vec<u16>,
}

/// An exposure that is going to be taken.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Planned {
    /// Its number in the measurement.
    pub index: usize,
    /// Code of what is lit, as in [`ExposureRecord::incident`](crate::store::ExposureRecord::incident).
    pub incident: i64,
    /// Exposure time, s.
    pub exposure_s: f64,
    /// Solid angle that is lit, at the sample, sr; 0 for a black pattern.
    pub lit_solid_angle_sr: f64,
}

/// An exposure that was taken.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fired {
    /// Number in the segment of the image that it is a part of.
    pub exposure: usize,
    /// Which band of that it is, where the projector shows one after the other; 0 else.
    pub band: usize,
    /// When it began on the trigger box's clock, s from the start of the run.
    pub on_s: f64,
}

/// What a camera could not do.
#[derive(Debug, thiserror::Error)]
pub enum CameraError {
    /// The camera does not make exposures of this length.
    #[error(
        "camera {camera}: expected an exposure time in s from {shortest_s} to {longest_s}, found {asked_s}"
    )]
    Exposure {
        /// The camera.
        camera: String,
        /// The limit below.
        shortest_s: f64,
        /// The limit above.
        longest_s: f64,
        /// What was asked for.
        asked_s: f64,
    },
    /// There is no such camera, or more than one.
    #[error("camera {camera}: expected {expected}, found {found}")]
    Which {
        /// How it was asked for.
        camera: String,
        /// What should be there.
        expected: &'static str,
        /// What is.
        found: String,
    },
    /// The camera does not work.
    #[error("camera {camera}: {reason}")]
    Failed {
        /// The camera.
        camera: String,
        /// Why not.
        reason: String,
    },
    /// The camera is gone.
    #[error("camera {camera}: the connection has ended")]
    Disconnected {
        /// The camera.
        camera: String,
    },
}

impl Blame for CameraError {
    fn is_input(&self) -> bool {
        matches!(self, Self::Exposure { .. } | Self::Which { .. })
    }
}

/// A camera that exposes when its trigger line says so, for as long as the line is active.
pub trait Camera: Send {
    /// What a person knows it by.
    fn name(&self) -> &str;

    /// Shape of the frames.
    fn format(&self) -> FrameFormat;

    /// How it is set and what else it could be, in words: what one compares with the rig file and the wires.
    fn settings(&self) -> Vec<String> {
        Vec::new()
    }

    /// Makes ready for triggered exposures and begins to count them from 0; frames of before are forgotten.
    ///
    /// # Errors
    /// [`CameraError`].
    fn arm(&mut self) -> Result<(), CameraError>;

    /// Told before each part of a measurement that is captured as a whole: how many parts before it show just the same. A
    /// simulated camera draws its noise from that, so that it depends on what is captured and not on when.
    fn begin_part(&mut self, _same_before: u64) {}

    /// Told before a segment which exposures are going to be taken, in the order of its steps. One that shows again what was compares.
    ///
    /// # Errors
    /// [`CameraError`] if it has other ones.
    fn expect(&mut self, _planned: &[Planned]) -> Result<(), CameraError> {
        Ok(())
    }

    /// Told behind each run what the trigger box has strobes of, in their order. A camera that sees its trigger need not listen.
    ///
    /// # Errors
    /// [`CameraError`].
    fn fired(&mut self, _fired: &[Fired]) -> Result<(), CameraError> {
        Ok(())
    }

    /// The next frame in the order of arrival, waiting at most `timeout`; `None` if none came.
    ///
    /// # Errors
    /// [`CameraError::Disconnected`].
    fn next_frame(&mut self, timeout: Duration) -> Result<Option<Frame>, CameraError>;
}
