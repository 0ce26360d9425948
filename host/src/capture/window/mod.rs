//! A projector that is a monitor, such as one at HDMI: a window fills it, and a photodiode tells when it shows what.
//!
//! # Design
//! Nothing triggers such a projector, and nothing but its light says when it shows a picture. So the window leads
//! ([`Leading`]): it shows a picture and lights a *patch* of the image whose light passes beside the mirror. A photodiode there
//! is wired to SYNC of the trigger box, where its edge begins a step: the picture settles, the camera is fired. Only when the
//! box says that the step is over the patch goes dark, for a display frame at least, and comes back with the next picture. So
//! each picture makes one edge, and no edge is made while a picture goes that was not exposed. The patch is lit in all
//! exposures alike, black ones too: what of its light comes into the camera is the same in all of them and goes with the black ones.
//! It does not go on and off while a picture stands: an edge there would begin the next step with the picture of this one.
//!
//! The display says when each picture appeared, the box when each step began. What lies between two pictures must be the same by
//! both; where it is not, display frames were shown again or left out, or an edge was none of the patch's, and the exposure is
//! taken again ([`capture`](crate::capture)). Before the first picture of a run it is shown once without an exposure, so that
//! this holds for all of them.
//!
//! Pixels are exact: one of the image is one of the monitor, whatever scale desktops give their windows, as the X server knows
//! no other pixels; 8 bits of each primary; no transformation, rotation or gamma ramp, which the server tells. What the window
//! itself may not know is whether the projector scales or corrects: set it to its native resolution.
//!
//! The window speaks the X protocol itself (`x11rb`, MIT OR Apache-2.0, pure Rust: nothing to install, a few seconds to build). The
//! Present extension shows a picture in the vertical blank and says in which, by the kernel's own time-stamp. OpenGL swaps say
//! when a program may go on, through queues of each driver's own, and would need its library. Where a program looks at the
//! display in place of a photodiode, as in tests, that program may say when display frames begin (`pace = "messages"`): it
//! sends the window a client message of type [`FRAME`] with the number of the frame, which shows what was drawn before.
//!
//! # Tradeoffs
//! Wayland's compositors scale, correct colours and let nobody choose pixels; they are refused, Xwayland too. The round trip to the box
//! and the dark frame cost two to four display frames for each picture: 15 to 20 pictures a second at 60 Hz.
//!
//! Unproven: the vertical blank of a real monitor, and any photodiode.

mod monitor;
mod picture;
mod surface;

use crate::capture::projector::{Leading, Projector, ProjectorError, check_resolution, check_room};
use crate::instrument::drivers::Window;
use crate::instrument::rig::Rig;
use crate::plan::pattern::BitPattern;

pub use monitor::{Monitor, monitors};
pub use surface::FRAME;

use picture::Picture;
use surface::Surface;

/// How many patterns can be loaded: with the picture before the first of them a table of the trigger box takes as many.
const CAPACITY: usize = 4000;

/// Why a window does not show what it should: the reason of a [`ProjectorError::Failed`].
#[derive(Debug, thiserror::Error)]
enum WindowError {
    /// There is no display.
    #[error("expected an X display in projector.window.display or the variable DISPLAY, found {0}")]
    NoDisplay(&'static str),
    /// Nobody answers there.
    #[error("expected an X server that answers, found: {0}")]
    NoServer(String),
    /// The connection failed.
    #[error("the connection to the X server has ended: {0}")]
    Connection(#[from] x11rb::errors::ConnectionError),
    /// The server refused a request.
    #[error("expected an X server that does what it is asked, found that it refuses {0}")]
    Refused(String),
    /// The monitor, or what happened to the window.
    #[error("{0}")]
    Said(String),
}

impl WindowError {
    fn refused(error: &x11rb::x11_utils::X11Error) -> Self {
        let request = error.request_name.unwrap_or("a request");
        Self::Refused(format!(
            "{request} (error {} of the X protocol)",
            error.error_code
        ))
    }
}

impl From<x11rb::errors::ReplyError> for WindowError {
    fn from(error: x11rb::errors::ReplyError) -> Self {
        match error {
            x11rb::errors::ReplyError::ConnectionError(error) => error.into(),
            x11rb::errors::ReplyError::X11Error(error) => Self::refused(&error),
        }
    }
}

impl From<x11rb::errors::ReplyOrIdError> for WindowError {
    fn from(error: x11rb::errors::ReplyOrIdError) -> Self {
        match error {
            x11rb::errors::ReplyOrIdError::IdsExhausted => Self::Refused("further windows".to_owned()),
            x11rb::errors::ReplyOrIdError::ConnectionError(error) => error.into(),
            x11rb::errors::ReplyOrIdError::X11Error(error) => Self::refused(&error),
        }
    }
}

/// Shows patterns in a window that fills a monitor.
pub struct WindowProjector {
    name: String,
    size_px: (usize, usize),
    surface: Surface,
    loaded: Vec<Picture>,
}

impl WindowProjector {
    /// Fills the monitor of the driver `window` of `rig` with black.
    ///
    /// # Errors
    /// [`ProjectorError`] where there is no such monitor, or one that does not show the pixels of `projector.lens` as they are.
    pub fn open(rig: &Rig) -> Result<Self, ProjectorError> {
        let (name, settings) = of(rig)?;
        let failed = |error: WindowError| ProjectorError::Failed {
            projector: name.clone(),
            reason: error.to_string(),
        };
        let screen = monitor::Screen::find(settings, rig).map_err(failed)?;
        let name_of_monitor = screen.name();
        let surface = Surface::open(screen, settings).map_err(failed)?;
        Ok(Self {
            name: name_of_monitor,
            size_px: (
                rig.projector.lens.width_px as usize,
                rig.projector.lens.height_px as usize,
            ),
            surface,
            loaded: Vec::new(),
        })
    }

    fn failed(&self, error: &WindowError) -> ProjectorError {
        ProjectorError::Failed {
            projector: self.name.clone(),
            reason: error.to_string(),
        }
    }
}

/// What is found of the monitor of the driver `window` of `rig`, without showing anything.
///
/// # Errors
/// As [`WindowProjector::open`].
pub fn look(rig: &Rig) -> Result<String, ProjectorError> {
    let (name, settings) = of(rig)?;
    let screen = monitor::Screen::find(settings, rig).map_err(|error| ProjectorError::Failed {
        projector: name,
        reason: error.to_string(),
    })?;
    let [x, y, width, height] = settings.patch_px;
    Ok(format!(
        "{}, {}×{} pixels at {:.3} Hz, the photodiode's patch of {width}×{height} pixels at ({x}, {y})",
        screen.name(),
        screen.monitor.size_px.0,
        screen.monitor.size_px.1,
        1.0 / screen.frame_s,
    ))
}

/// Name and settings of the window of `rig`.
fn of(rig: &Rig) -> Result<(String, &Window), ProjectorError> {
    let failed = |reason: String| ProjectorError::Failed {
        projector: "window".to_owned(),
        reason,
    };
    let settings = rig.projector.window.as_ref();
    let settings =
        settings.ok_or_else(|| failed("expected a table [projector.window], found none".to_owned()))?;
    // What calibration found of the lens counts.
    rig.photodiode_beside_mirror(settings.patch_px)
        .map_err(|(expected, found)| failed(format!("patch_px: expected {expected}, found {found}")))?;
    let name = match &settings.monitor {
        Some(monitor) => format!("window on {monitor}"),
        None => "window".to_owned(),
    };
    Ok((name, settings))
}

impl Projector for WindowProjector {
    fn name(&self) -> &str {
        &self.name
    }

    fn size_px(&self) -> (usize, usize) {
        self.size_px
    }

    fn capacity(&self) -> usize {
        CAPACITY
    }

    fn clear(&mut self) -> Result<(), ProjectorError> {
        self.loaded.clear();
        self.surface.blank().map_err(|error| self.failed(&error))
    }

    fn load(&mut self, pattern: &BitPattern) -> Result<(), ProjectorError> {
        check_resolution(&self.name, self.size_px, pattern)?;
        check_room(&self.name, self.loaded.len(), CAPACITY)?;
        self.loaded.push(Picture::of(pattern));
        Ok(())
    }

    fn leading(&mut self) -> Option<&mut dyn Leading> {
        Some(self)
    }
}

impl Leading for WindowProjector {
    fn frame_s(&self) -> f64 {
        self.surface.frame_s()
    }

    fn show(&mut self, number: usize) -> Result<f64, ProjectorError> {
        let Some(picture) = self.loaded.get(number) else {
            let found = self.loaded.len();
            let reason =
                format!("expected pattern {number} among those that are loaded, found {found} of them");
            return Err(self.failed(&WindowError::Said(reason)));
        };
        self.surface.show(picture).map_err(|error| self.failed(&error))
    }

    fn finish(&mut self) -> Result<(), ProjectorError> {
        self.surface.look().map_err(|error| self.failed(&error))
    }
}
