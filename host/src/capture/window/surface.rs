//! The window: pictures that are drawn beside it and come onto it in a display frame of their own.
//!
//! # Design
//! Each picture is drawn twice before it is shown, with the patch dark and lit; only whole pictures come onto the window. There
//! is room for two of them, so that none is touched that the display may still read.

use std::thread;
use std::time::{Duration, Instant};

use x11rb::connection::{Connection as _, RequestConnection as _, SequenceNumber};
use x11rb::protocol::present::{self, CompleteKind, CompleteMode, ConnectionExt as _};
use x11rb::protocol::xproto::{
    Atom, AtomEnum, ChangeGCAux, ConfigureWindowAux, ConnectionExt as _, CreateGCAux, CreateWindowAux,
    EventMask, Gcontext, Pixmap, PropMode, Rectangle, StackMode, Visibility, Window as XWindow, WindowClass,
};
use x11rb::protocol::{Event, screensaver};
use x11rb::rust_connection::RustConnection;
use x11rb::wrapper::ConnectionExt as _;

use super::WindowError;
use super::monitor::Screen;
use super::picture::Picture;
use crate::instrument::drivers::{Pace, Window};

/// Type of the client messages, of format 32, that say that a display frame begins. The first number is that of the frame, by
/// which the sender has counted on since it began to.
pub const FRAME: &str = "_RCG_DISPLAY_FRAME";

/// A display that shows no new frame for so long never will.
const PATIENCE: Duration = Duration::from_secs(5);
/// How often events are looked for.
const LOOK: Duration = Duration::from_micros(100);
/// Rectangles of one request.
const AT_ONCE: usize = 4096;
/// Where the patch is lit all primaries are full on.
const WHITE: u32 = 0xff_ffff;
const BLACK: u32 = 0;

/// Room for a picture.
#[derive(Clone, Copy, Debug)]
struct Slot {
    /// With the patch dark, and with it lit.
    dark: Pixmap,
    lit: Pixmap,
}

/// A window that fills a monitor.
pub(super) struct Surface {
    connection: RustConnection,
    window: XWindow,
    gc: Gcontext,
    size_px: (u16, u16),
    patch: Rectangle,
    frame_s: f64,
    pace: Pace,
    frame_message: Atom,
    slots: [Slot; 2],
    /// The slot that is on the window.
    on: usize,
    /// Number of the last picture that came onto the window.
    serial: u32,
    /// Whether it was seen in full.
    is_shown: bool,
}

impl Surface {
    /// Fills the monitor of `screen` with black.
    pub(super) fn open(screen: Screen, settings: &Window) -> Result<Self, WindowError> {
        let Screen {
            connection,
            root,
            depth,
            monitor,
            frame_s,
            ..
        } = screen;
        if settings.pace == Pace::Vsync {
            begin_present(&connection)?;
        }
        let window = window_at(&connection, root, monitor.at_px, monitor.size_px)?;
        let gc = connection.generate_id()?;
        connection.create_gc(gc, window, &CreateGCAux::new().graphics_exposures(0))?;
        let pixmap = || -> Result<Pixmap, WindowError> {
            let pixmap = connection.generate_id()?;
            connection.create_pixmap(depth, pixmap, window, monitor.size_px.0, monitor.size_px.1)?;
            Ok(pixmap)
        };
        let slot = || -> Result<Slot, WindowError> {
            Ok(Slot {
                dark: pixmap()?,
                lit: pixmap()?,
            })
        };
        let slots = [slot()?, slot()?];
        let frame_message = connection.intern_atom(false, FRAME.as_bytes())?.reply()?.atom;
        if settings.pace == Pace::Vsync {
            let events = connection.generate_id()?;
            connection.present_select_input(events, window, present::EventMask::COMPLETE_NOTIFY)?;
        }
        // A display that goes dark by itself is none that measures; where the extension is missing nothing does so.
        if connection
            .extension_information(screensaver::X11_EXTENSION_NAME)?
            .is_some()
        {
            screensaver::suspend(&connection, 1)?;
        }
        let [x, y, width, height] = settings.patch_px;
        let mut surface = Self {
            connection,
            window,
            gc,
            size_px: monitor.size_px,
            patch: Rectangle {
                x: x as i16,
                y: y as i16,
                width: width as u16,
                height: height as u16,
            },
            frame_s,
            pace: settings.pace,
            frame_message,
            slots,
            on: 0,
            serial: 0,
            is_shown: false,
        };
        surface.connection.map_window(window)?;
        surface.await_event("is seen in full", |event, _| match event {
            Event::VisibilityNotify(seen) if seen.state == Visibility::UNOBSCURED => Some(()),
            _ => None,
        })?;
        surface.is_shown = true;
        surface.blank()?;
        Ok(surface)
    }

    /// Length of a display frame, s.
    pub(super) const fn frame_s(&self) -> f64 {
        self.frame_s
    }

    /// Shows black, with the patch dark.
    pub(super) fn blank(&mut self) -> Result<(), WindowError> {
        let black = Picture {
            colour: BLACK,
            runs: Vec::new(),
        };
        let next = 1 - self.on;
        self.draw(self.slots[next], &black)?;
        self.flip(self.slots[next].dark)?;
        self.on = next;
        Ok(())
    }

    /// Lets the patch go dark, and come back with `picture`. Returns when that appeared, s on the display's clock.
    pub(super) fn show(&mut self, picture: &Picture) -> Result<f64, WindowError> {
        let next = 1 - self.on;
        self.draw(self.slots[next], picture)?;
        self.flip(self.slots[self.on].dark)?;
        let at_s = self.flip(self.slots[next].lit)?;
        self.on = next;
        Ok(at_s)
    }

    /// Takes notice of what has happened to the window.
    pub(super) fn look(&self) -> Result<(), WindowError> {
        self.connection.get_input_focus()?.reply()?;
        while let Some(event) = self.connection.poll_for_event()? {
            self.notice(&event)?;
        }
        Ok(())
    }

    /// Draws `picture` where it is not seen yet.
    fn draw(&self, slot: Slot, picture: &Picture) -> Result<(), WindowError> {
        let Self {
            connection,
            gc,
            size_px: (width, height),
            ..
        } = self;
        let paint = |pixmap: Pixmap, colour: u32, areas: &[Rectangle]| -> Result<(), WindowError> {
            connection.change_gc(*gc, &ChangeGCAux::new().foreground(colour))?;
            for areas in areas.chunks(AT_ONCE) {
                connection.poly_fill_rectangle(pixmap, *gc, areas)?;
            }
            Ok(())
        };
        let whole = Rectangle {
            x: 0,
            y: 0,
            width: *width,
            height: *height,
        };
        paint(slot.dark, BLACK, &[whole])?;
        paint(slot.dark, picture.colour, &picture.runs)?;
        paint(slot.dark, BLACK, &[self.patch])?;
        connection.copy_area(slot.dark, slot.lit, *gc, 0, 0, 0, 0, *width, *height)?;
        paint(slot.lit, WHITE, &[self.patch])
    }

    /// Brings `pixmap` onto the window. Returns when the display frame began that shows it, s on the display's clock.
    fn flip(&mut self, pixmap: Pixmap) -> Result<f64, WindowError> {
        match self.pace {
            Pace::Vsync => self.present(pixmap),
            Pace::Messages => self.copy(pixmap),
        }
    }

    /// By the Present extension, in the next vertical blank.
    fn present(&mut self, pixmap: Pixmap) -> Result<f64, WindowError> {
        loop {
            self.serial = self.serial.wrapping_add(1);
            let (serial, window) = (self.serial, self.window);
            let options = present::Option::NONE.into();
            self.connection.present_pixmap(
                window,
                pixmap,
                serial,
                0,
                0,
                0,
                0,
                0,
                0,
                0,
                options,
                0,
                0,
                0,
                &[],
            )?;
            let (mode, at_us) = self.await_event("shows a picture", |event, _| match event {
                Event::PresentCompleteNotify(shown)
                    if shown.kind == CompleteKind::PIXMAP && shown.serial == serial =>
                {
                    Some((shown.mode, shown.ust))
                }
                _ => None,
            })?;
            // What was left out is shown anew.
            if mode != CompleteMode::SKIP {
                return Ok(at_us as f64 * 1e-6);
            }
        }
    }

    /// At once, and then waits for whoever looks at the display to say that it was seen.
    fn copy(&self, pixmap: Pixmap) -> Result<f64, WindowError> {
        let (width, height) = self.size_px;
        let drawn = self
            .connection
            .copy_area(pixmap, self.window, self.gc, 0, 0, 0, 0, width, height)?
            .sequence_number();
        let frame_message = self.frame_message;
        // What was said before it was drawn is not said of it.
        let number = self.await_event("is told of a display frame", |event, after| match event {
            Event::ClientMessage(message) if message.type_ == frame_message && after >= drawn => {
                Some(message.data.as_data32()[0])
            }
            _ => None,
        })?;
        Ok(f64::from(number) * self.frame_s)
    }

    /// Waits until `wanted` finds what it wants in an event, or in the number of the request that was done before it.
    fn await_event<T>(
        &self,
        what: &str,
        mut wanted: impl FnMut(&Event, SequenceNumber) -> Option<T>,
    ) -> Result<T, WindowError> {
        self.connection.flush()?;
        let began = Instant::now();
        loop {
            while let Some((event, after)) = self.connection.poll_for_event_with_sequence()? {
                if let Some(found) = wanted(&event, after) {
                    return Ok(found);
                }
                // It comes into sight bit by bit.
                if self.is_shown {
                    self.notice(&event)?;
                } else if let Event::Error(error) = &event {
                    return Err(WindowError::refused(error));
                }
            }
            if began.elapsed() > PATIENCE {
                return Err(WindowError::Said(format!(
                    "expected that the window {what} within {} s, found that it does not: is the monitor on?",
                    PATIENCE.as_secs()
                )));
            }
            thread::sleep(LOOK);
        }
    }

    /// Refuses events after which the monitor does not show what it should.
    fn notice(&self, event: &Event) -> Result<(), WindowError> {
        let said = |what: &str| {
            Err(WindowError::Said(format!(
                "expected a window that stays, found {what}"
            )))
        };
        match event {
            Event::DestroyNotify(gone) if gone.window == self.window => said("that it was closed"),
            Event::UnmapNotify(gone) if gone.window == self.window => said("that it was closed"),
            Event::VisibilityNotify(seen) if seen.state != Visibility::UNOBSCURED => {
                said("another window in front of it")
            }
            Event::ConfigureNotify(moved)
                if moved.window == self.window && (moved.width, moved.height) != self.size_px =>
            {
                said("another size of it")
            }
            Event::Error(error) => Err(WindowError::refused(error)),
            _ => Ok(()),
        }
    }
}

/// Asks for the Present extension.
fn begin_present(connection: &RustConnection) -> Result<(), WindowError> {
    if connection
        .extension_information(present::X11_EXTENSION_NAME)?
        .is_none()
    {
        return Err(WindowError::Said(
            "expected an X server with the extension Present, which shows pictures in the vertical blank, found none"
                .to_owned(),
        ));
    }
    connection.present_query_version(1, 2)?.reply()?;
    Ok(())
}

/// A black window of `size_px` at `at_px` that no window manager touches, without a pointer.
fn window_at(
    connection: &RustConnection,
    root: XWindow,
    at_px: (i16, i16),
    size_px: (u16, u16),
) -> Result<XWindow, WindowError> {
    let nothing = connection.generate_id()?;
    connection.create_pixmap(1, nothing, root, 1, 1)?;
    let gc = connection.generate_id()?;
    connection.create_gc(gc, nothing, &CreateGCAux::new().foreground(0))?;
    let dot = Rectangle {
        x: 0,
        y: 0,
        width: 1,
        height: 1,
    };
    connection.poly_fill_rectangle(nothing, gc, &[dot])?;
    connection.free_gc(gc)?;
    let cursor = connection.generate_id()?;
    connection.create_cursor(cursor, nothing, nothing, 0, 0, 0, 0, 0, 0, 0, 0)?;
    let window = connection.generate_id()?;
    let looks = CreateWindowAux::new()
        .background_pixel(BLACK)
        .border_pixel(BLACK)
        .override_redirect(1)
        .cursor(cursor)
        .event_mask(EventMask::STRUCTURE_NOTIFY | EventMask::VISIBILITY_CHANGE);
    let ((x, y), (width, height)) = (at_px, size_px);
    let copied = x11rb::COPY_DEPTH_FROM_PARENT;
    let class = WindowClass::INPUT_OUTPUT;
    connection.create_window(copied, window, root, x, y, width, height, 0, class, 0, &looks)?;
    connection.free_pixmap(nothing)?;
    connection.free_cursor(cursor)?;
    let name = b"rcg projector";
    connection.change_property8(
        PropMode::REPLACE,
        window,
        AtomEnum::WM_NAME,
        AtomEnum::STRING,
        name,
    )?;
    // A compositor that hears of it keeps its hands off.
    let bypass = connection
        .intern_atom(false, b"_NET_WM_BYPASS_COMPOSITOR")?
        .reply()?
        .atom;
    connection.change_property32(PropMode::REPLACE, window, bypass, AtomEnum::CARDINAL, &[1])?;
    connection.configure_window(window, &ConfigureWindowAux::new().stack_mode(StackMode::ABOVE))?;
    Ok(window)
}
