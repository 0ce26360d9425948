//! A monitor without a panel: an X server that draws into memory, and a photodiode that looks at it.
//!
//! # Design
//! [`Xvfb`] is the server. A [`Display`] scans its picture out once a display frame, as a projector at its cable would: it tells the
//! window that the frame begins, and what it grabbed then is what is shown a frame later, to the last bit. The photodiode sees
//! the patch of the picture that is shown.
//!
//! A frame is grabbed and told of while the server listens to nobody else: what a window has drawn when it is told has been
//! grabbed.

use std::io::{BufRead as _, BufReader};
use std::process::{Child, Command, Stdio};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use image::{Rgb, RgbImage};
use rcg::capture::files::pattern_of;
use rcg::capture::projector::{Projector as _, ProjectorError};
use rcg::capture::window::FRAME;
use rcg::instrument::drivers::{Pace, Window as Settings};
use rcg::virtual_rig::VirtualProjector;
use x11rb::connection::Connection as _;
use x11rb::errors::{ConnectionError, ReplyError};
use x11rb::protocol::xproto::{
    Atom, ClientMessageEvent, ConnectionExt as _, EventMask, ImageFormat, MapState, Window,
};
use x11rb::rust_connection::RustConnection;

use crate::bridge::{Photodiode, Seen};
use crate::table::Screen;

/// Why nothing is shown.
#[derive(Debug, thiserror::Error)]
pub enum ScreenError {
    /// There is no server.
    #[error("Xvfb: expected an X server that starts, found: {0}")]
    Server(String),
    /// It does not answer.
    #[error("X server: {0}")]
    Connection(#[from] ConnectionError),
    /// It refuses.
    #[error("X server: {0}")]
    Reply(#[from] ReplyError),
    /// It shows what is no pattern.
    #[error("the picture on the screen: {0}")]
    Picture(String),
    /// The virtual projector does not take it.
    #[error(transparent)]
    Projector(#[from] ProjectorError),
}

/// An X server without a monitor. It ends when this is dropped.
#[derive(Debug)]
pub struct Xvfb {
    child: Child,
    display: String,
}

impl Xvfb {
    /// Starts one with a screen of `size_px` (width, height).
    ///
    /// # Errors
    /// [`ScreenError::Server`].
    pub fn start(size_px: (u32, u32)) -> Result<Self, ScreenError> {
        let failed = |error: &dyn std::fmt::Display| ScreenError::Server(error.to_string());
        let mut child = Command::new("Xvfb")
            .args(["-displayfd", "1", "-nolisten", "tcp", "-noreset", "-screen", "0"])
            .arg(format!("{}x{}x24", size_px.0, size_px.1))
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .map_err(|error| failed(&error))?;
        let mut number = String::new();
        let said = BufReader::new(child.stdout.take().expect("it was piped")).read_line(&mut number);
        let display = format!(":{}", number.trim());
        let server = Self { child, display };
        match said {
            Ok(count) if count > 1 => Ok(server),
            Ok(_) => Err(failed(&"it says no number of a display")),
            Err(error) => Err(failed(&error)),
        }
    }

    /// Whether there is one on this machine (Debian: xvfb).
    #[must_use]
    pub fn is_there() -> bool {
        // It has no option that ends it with 0.
        let asked = Command::new("Xvfb")
            .arg("-help")
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .status();
        asked.is_ok()
    }

    /// Name of the display, such as `:1`.
    #[must_use]
    pub fn display(&self) -> &str {
        &self.display
    }
}

impl Drop for Xvfb {
    fn drop(&mut self) {
        self.child.kill().ok();
        self.child.wait().ok();
    }
}

/// A connection to an X server, to look at its screen.
pub struct Eye {
    connection: RustConnection,
    root: Window,
    size_px: (u16, u16),
    frame: Atom,
}

impl Eye {
    /// Looks at the screen of the X display `display`.
    ///
    /// # Errors
    /// [`ScreenError`].
    pub fn open(display: &str) -> Result<Self, ScreenError> {
        let connected = RustConnection::connect(Some(display));
        let (connection, number) = connected.map_err(|error| ScreenError::Server(error.to_string()))?;
        let screen = &connection.setup().roots[number];
        let (root, size_px) = (screen.root, (screen.width_in_pixels, screen.height_in_pixels));
        let frame = connection.intern_atom(false, FRAME.as_bytes())?.reply()?.atom;
        Ok(Self {
            connection,
            root,
            size_px,
            frame,
        })
    }

    /// The connection, to do other things to the screen.
    #[must_use]
    pub const fn connection(&self) -> (&RustConnection, Window) {
        (&self.connection, self.root)
    }

    /// The window in front, if there is one.
    ///
    /// # Errors
    /// [`ScreenError`].
    pub fn window(&self) -> Result<Option<Window>, ScreenError> {
        for window in self
            .connection
            .query_tree(self.root)?
            .reply()?
            .children
            .into_iter()
            .rev()
        {
            // It may have gone meanwhile.
            let seen = self.connection.get_window_attributes(window)?.reply();
            if seen.is_ok_and(|seen| seen.map_state == MapState::VIEWABLE) {
                return Ok(Some(window));
            }
        }
        Ok(None)
    }

    /// What part `[x, y, width, height]` of the screen shows.
    ///
    /// # Errors
    /// [`ScreenError`].
    pub fn grab(&self, [x, y, width, height]: [u16; 4]) -> Result<RgbImage, ScreenError> {
        let (format, planes) = (ImageFormat::Z_PIXMAP, u32::MAX);
        let got = self
            .connection
            .get_image(format, self.root, x as i16, y as i16, width, height, planes)?
            .reply()?;
        // 32 bits a pixel, the lowest first: blue, green, red.
        let pixels = got
            .data
            .chunks_exact(4)
            .flat_map(|pixel| [pixel[2], pixel[1], pixel[0]]);
        RgbImage::from_raw(u32::from(width), u32::from(height), pixels.collect())
            .ok_or_else(|| ScreenError::Picture("of another size than was asked for".to_owned()))
    }

    /// All of the screen.
    ///
    /// # Errors
    /// [`ScreenError`].
    pub fn grab_all(&self) -> Result<RgbImage, ScreenError> {
        self.grab([0, 0, self.size_px.0, self.size_px.1])
    }

    /// Closes the window in front, as somebody might.
    ///
    /// # Errors
    /// [`ScreenError`].
    pub fn close_window(&self) -> Result<(), ScreenError> {
        if let Some(window) = self.window()? {
            self.connection.destroy_window(window)?;
            self.connection.flush()?;
        }
        Ok(())
    }

    /// Tells the window in front that display frame `number` begins.
    fn tell(&self, number: u32) -> Result<(), ScreenError> {
        if let Some(window) = self.window()? {
            let message = ClientMessageEvent::new(32, window, self.frame, [number, 0, 0, 0, 0]);
            self.connection
                .send_event(false, window, EventMask::NO_EVENT, message)?;
        }
        Ok(())
    }
}

/// What goes wrong with a display on purpose. Pictures count from 0, as the patch lights up with them.
#[derive(Clone, Debug, Default)]
pub struct DisplayFaults {
    /// Before these pictures the frame before is shown once more, and everything is a frame later from then on.
    pub repeated: Vec<u64>,
    /// Of these pictures a frame is left out as they stand, and everything is a frame earlier from then on.
    pub skipped: Vec<u64>,
    /// While these pictures stand the photodiode sees every other frame dark, of even ones the even frames.
    pub flickering: Vec<u64>,
    /// When this picture comes somebody closes the window.
    pub closes_at: Option<u64>,
    /// From this picture on the photodiode sees nothing.
    pub blind_from: Option<u64>,
}

/// What is scanned out in a display frame.
#[derive(Clone, Debug)]
struct Scanned {
    lit: bool,
    /// The number of the picture that begins with it, and the picture.
    begins: Option<(u64, RgbImage)>,
}

/// What stands at the other end of the cable: scans pictures out, a frame late, and has a photodiode before the patch.
pub struct Display {
    eye: Eye,
    frame: Duration,
    patch_px: [u16; 4],
    projector: Arc<Mutex<Option<VirtualProjector>>>,
    faults: Arc<Mutex<DisplayFaults>>,
    /// Display frames so far, as the window is told.
    frames: u32,
    /// Pictures so far, as they were grabbed.
    pictures: u64,
    /// Frames that wait to be shown, at least one.
    waiting: Vec<Scanned>,
    /// The last that was grabbed, and how many frames ago the patch lit up in it.
    was_lit: bool,
    lit_for: u64,
    /// The number of the picture that is shown, and for how many frames it has been.
    shown: Option<(u64, u64)>,
}

impl Display {
    /// What stands before a window that fills the screen of `server` on a table, `hz` display frames a second and the photodiode before
    /// `patch_px` ([x, y, width, height]), and what goes wrong with it.
    ///
    /// # Errors
    /// [`ScreenError`].
    pub fn before(
        server: &Xvfb,
        hz: u32,
        patch_px: [u32; 4],
    ) -> Result<(Screen, Arc<Mutex<DisplayFaults>>), ScreenError> {
        let (projector, faults) = (Arc::default(), Arc::default());
        let frame = Duration::from_secs(1) / hz;
        let photodiode = Self::open(
            server.display(),
            frame,
            patch_px,
            Arc::clone(&projector),
            Arc::clone(&faults),
        )?;
        let screen = Screen {
            window: Settings {
                display: Some(server.display().to_owned()),
                monitor: None,
                patch_px,
                refresh_hz: Some(f64::from(hz)),
                pace: Pace::Messages,
            },
            photodiode: Box::new(photodiode),
            projector,
        };
        Ok((screen, faults))
    }

    /// What looks at the X display `display` and hands pictures on to the `projector`, when there is one.
    fn open(
        display: &str,
        frame: Duration,
        patch_px: [u32; 4],
        projector: Arc<Mutex<Option<VirtualProjector>>>,
        faults: Arc<Mutex<DisplayFaults>>,
    ) -> Result<Self, ScreenError> {
        Ok(Self {
            eye: Eye::open(display)?,
            frame,
            patch_px: patch_px.map(|px| px as u16),
            projector,
            faults,
            frames: 0,
            pictures: 0,
            waiting: vec![Scanned {
                lit: false,
                begins: None,
            }],
            was_lit: false,
            lit_for: 0,
            shown: None,
        })
    }

    /// A display frame begins.
    fn scan_out(&mut self) -> Result<Seen, ScreenError> {
        let faults = self.faults.lock().unwrap_or_else(PoisonError::into_inner).clone();
        let grabbed = self.grab()?;
        let picture = self.pictures.wrapping_sub(1);
        if let Some((number, _)) = &grabbed.begins {
            if faults.repeated.contains(number) {
                // What stood before stands once more.
                self.waiting.push(Scanned {
                    lit: false,
                    begins: None,
                });
            }
            if faults.closes_at == Some(*number) {
                self.eye.close_window()?;
            }
        }
        self.waiting.push(grabbed);
        if self.lit_for == 2 && faults.skipped.contains(&picture) && self.waiting.len() > 1 {
            self.waiting.pop();
        }
        let now = self.waiting.remove(0);
        let is_new = now.begins.is_some();
        if let Some((number, picture)) = now.begins {
            self.shown = Some((number, 0));
            self.load(picture)?;
        }
        let mut lit = now.lit;
        if let Some((number, frames)) = &mut self.shown {
            lit &=
                !(faults.flickering.contains(number) && *frames > 0 && (*frames + *number).is_multiple_of(2));
            lit &= faults.blind_from.is_none_or(|from| *number < from);
            *frames += 1;
        }
        Ok(Seen { lit, is_new })
    }

    /// Grabs what is on the screen and tells the window of the frame.
    fn grab(&mut self) -> Result<Scanned, ScreenError> {
        let [x, y, width, height] = self.patch_px;
        let connection = &self.eye.connection;
        connection.grab_server()?;
        let middle = self.eye.grab([x + width / 2, y + height / 2, 1, 1])?;
        let lit = middle.pixels().all(|pixel| pixel.0 == [255; 3]);
        let begins = if lit && !self.was_lit {
            Some((self.pictures, self.eye.grab_all()?))
        } else {
            None
        };
        self.eye.tell(self.frames)?;
        connection.ungrab_server()?;
        connection.flush()?;
        self.frames = self.frames.wrapping_add(1);
        self.lit_for = if lit { self.lit_for + 1 } else { 0 };
        self.was_lit = lit;
        self.pictures += u64::from(begins.is_some());
        Ok(Scanned { lit, begins })
    }

    /// Hands a picture on to the virtual projector.
    fn load(&self, mut picture: RgbImage) -> Result<(), ScreenError> {
        let [x, y, width, height] = self.patch_px.map(u32::from);
        for row in y..y + height {
            for column in x..x + width {
                let pixel = picture.get_pixel_mut(column, row);
                if pixel.0 != [255; 3] {
                    return Err(ScreenError::Picture(format!(
                        "a patch that is dark at ({column}, {row})"
                    )));
                }
                *pixel = Rgb([0; 3]);
            }
        }
        let pattern = pattern_of(&picture).map_err(ScreenError::Picture)?;
        if let Some(projector) = self
            .projector
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .as_mut()
        {
            projector.load(&pattern)?;
        }
        Ok(())
    }
}

impl Photodiode for Display {
    fn frame(&self) -> Duration {
        self.frame
    }

    fn look(&mut self) -> Result<Seen, Box<dyn std::error::Error + Send + Sync>> {
        Ok(self.scan_out()?)
    }
}
