//! The monitors of an X display, and whether one shows pixels as they are.
//!
//! # Design
//! RandR tells of each monitor where it is and how large, of what drives it the mode (X11 RandR 1.5, section 7: refresh rate =
//! dot clock / (horizontal × vertical total)), rotation, transformation and gamma ramps.

use std::env;

use serde::Serialize;
use x11rb::connection::{Connection as _, RequestConnection as _};
use x11rb::protocol::randr::{self, ConnectionExt as _, ModeFlag, ModeInfo, Rotation};
use x11rb::protocol::xproto::{ConnectionExt as _, VisualClass, Window as XWindow};
use x11rb::rust_connection::RustConnection;

use super::WindowError;
use crate::instrument::drivers::Window;
use crate::instrument::rig::Rig;

/// A gamma ramp may be off the straight line by what 8 bits of it are, of 65,535.
const RAMP_STEP: i64 = 257;
/// A refresh rate that is asked for may be off by so much of itself: 59.94 Hz is not 60.
const SAME_RATE: f64 = 5e-4;
/// The transformation that changes nothing, in 16.16 fixed point.
const ONE: i32 = 1 << 16;
/// The first lines of the image may be scanned out so many display frames before the last, and the photodiode be late by as much as
/// counts as in time: until then no exposure may begin.
const SCANNED_OUT: f64 = 1.0 + crate::capture::led::TOLERANCE;

/// A monitor of an X display.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Monitor {
    /// Its name, such as `HDMI-1`.
    pub name: String,
    /// Place of its first pixel on the display (x, y).
    pub at_px: (i16, i16),
    /// Width and height in pixels.
    pub size_px: (u16, u16),
    /// Display frames a second; `None` where the X server does not say.
    pub refresh_hz: Option<f64>,
    /// What stands in the way of exact pixels, if anything does.
    pub inexact: Option<String>,
}

/// The monitors of the X display `display`, in the order of their numbers; `None` for the display that `DISPLAY` names.
///
/// # Errors
/// Why there are none, in one sentence.
pub fn monitors(display: Option<&str>) -> Result<Vec<Monitor>, String> {
    let (_, connection, root, _) = connect(display).map_err(|error| error.to_string())?;
    list(&connection, root).map_err(|error| error.to_string())
}

/// A monitor that is going to be filled.
pub(super) struct Screen {
    pub(super) connection: RustConnection,
    pub(super) root: XWindow,
    pub(super) depth: u8,
    pub(super) monitor: Monitor,
    /// Length of a display frame, s.
    pub(super) frame_s: f64,
    display: String,
}

impl Screen {
    /// The monitor that `settings` name, if it shows the image of the projector of `rig` as it is.
    pub(super) fn find(settings: &Window, rig: &Rig) -> Result<Self, WindowError> {
        let (display, connection, root, depth) = connect(settings.display.as_deref())?;
        let found = list(&connection, root)?;
        let monitor = choose(&found, settings.monitor.as_deref())
            .map_err(WindowError::Said)?
            .clone();
        let lens = &rig.projector.lens;
        let frame_s =
            suits(&monitor, settings, (lens.width_px, lens.height_px)).map_err(WindowError::Said)?;
        let settled_s = SCANNED_OUT * frame_s;
        if rig.projector.settle_s < settled_s {
            return Err(WindowError::Said(format!(
                "projector.settle_s: expected at least {settled_s:.4} s, {SCANNED_OUT} display frames, in which a picture is \
                 scanned out, found {} s",
                rig.projector.settle_s
            )));
        }
        Ok(Self {
            connection,
            root,
            depth,
            monitor,
            frame_s,
            display,
        })
    }

    /// What a person knows it by.
    pub(super) fn name(&self) -> String {
        format!("window on {} of display {}", self.monitor.name, self.display)
    }
}

/// A connection to the X display, with its name, its root window and the depth of that.
fn connect(display: Option<&str>) -> Result<(String, RustConnection, XWindow, u8), WindowError> {
    let said = |name: &str| env::var(name).ok().filter(|value| !value.is_empty());
    let Some(name) = display.map(str::to_owned).or_else(|| said("DISPLAY")) else {
        return Err(WindowError::NoDisplay(match said("WAYLAND_DISPLAY") {
            Some(_) => {
                "Wayland alone, whose compositors scale and correct as they like; log into a session of Xorg"
            }
            None => "none",
        }));
    };
    let (connection, screen) = RustConnection::connect(Some(&name))
        .map_err(|error| WindowError::NoServer(format!("{name}: {error}")))?;
    let root = &connection.setup().roots[screen];
    let (window, depth) = (root.root, root.root_depth);
    let visuals = root.allowed_depths.iter().flat_map(|depth| &depth.visuals);
    let exact = visuals.clone().any(|visual| {
        visual.visual_id == root.root_visual
            && visual.class == VisualClass::TRUE_COLOR
            && (visual.red_mask, visual.green_mask, visual.blue_mask) == (0xff_0000, 0xff00, 0xff)
    });
    if !exact {
        return Err(WindowError::Said(format!(
            "expected a display of 8 bits of red, green and blue, found a depth of {depth} bits of another kind"
        )));
    }
    if connection.query_extension(b"XWAYLAND")?.reply()?.present {
        return Err(WindowError::Said(
            "expected an X server of its own, found Xwayland, whose compositor scales and corrects as it likes; log into a \
             session of Xorg"
                .to_owned(),
        ));
    }
    if connection
        .extension_information(randr::X11_EXTENSION_NAME)?
        .is_none()
    {
        return Err(WindowError::Said(
            "expected an X server with the extension RANDR, which tells of monitors, found none".to_owned(),
        ));
    }
    connection.randr_query_version(1, 5)?.reply()?;
    Ok((name, connection, window, depth))
}

/// All monitors.
fn list(connection: &RustConnection, root: XWindow) -> Result<Vec<Monitor>, WindowError> {
    let resources = connection.randr_get_screen_resources_current(root)?.reply()?;
    let told = connection.randr_get_monitors(root, true)?.reply()?;
    let mut monitors = Vec::with_capacity(told.monitors.len());
    for one in told.monitors {
        let name = connection.get_atom_name(one.name)?.reply()?.name;
        let mut monitor = Monitor {
            name: String::from_utf8_lossy(&name).into_owned(),
            at_px: (one.x, one.y),
            size_px: (one.width, one.height),
            refresh_hz: None,
            inexact: None,
        };
        for output in one.outputs {
            let output = connection
                .randr_get_output_info(output, resources.config_timestamp)?
                .reply()?;
            if output.crtc == 0 {
                continue;
            }
            let crtc = connection
                .randr_get_crtc_info(output.crtc, resources.config_timestamp)?
                .reply()?;
            let mode = resources.modes.iter().find(|mode| mode.id == crtc.mode);
            monitor.refresh_hz = monitor.refresh_hz.or_else(|| mode.and_then(refresh_hz));
            monitor.inexact = monitor.inexact.or(inexact(
                connection,
                output.crtc,
                crtc.rotation,
                mode.map(|mode| (mode.width, mode.height)),
                monitor.size_px,
            )?);
        }
        monitors.push(monitor);
    }
    Ok(monitors)
}

/// Display frames a second of `mode`; `None` where it does not say.
fn refresh_hz(mode: &ModeInfo) -> Option<f64> {
    let mut lines = f64::from(mode.vtotal);
    if u32::from(mode.mode_flags) & u32::from(ModeFlag::DOUBLE_SCAN) != 0 {
        lines *= 2.0;
    }
    if u32::from(mode.mode_flags) & u32::from(ModeFlag::INTERLACE) != 0 {
        lines /= 2.0;
    }
    let pixels = f64::from(mode.htotal) * lines;
    (mode.dot_clock > 0 && pixels > 0.0).then(|| f64::from(mode.dot_clock) / pixels)
}

/// What the display does to pixels on their way to the monitor, if anything.
fn inexact(
    connection: &RustConnection,
    crtc: randr::Crtc,
    rotation: Rotation,
    mode_px: Option<(u16, u16)>,
    size_px: (u16, u16),
) -> Result<Option<String>, WindowError> {
    if rotation != Rotation::ROTATE0 {
        return Ok(Some(
            "an image that is rotated (xrandr --rotate normal)".to_owned(),
        ));
    }
    if let Some((width, height)) = mode_px.filter(|mode| *mode != size_px) {
        return Ok(Some(format!(
            "an image that is scaled to a mode of {width}×{height} pixels (xrandr --scale 1)"
        )));
    }
    let transform = connection
        .randr_get_crtc_transform(crtc)?
        .reply()?
        .current_transform;
    let rows = [
        [transform.matrix11, transform.matrix12, transform.matrix13],
        [transform.matrix21, transform.matrix22, transform.matrix23],
        [transform.matrix31, transform.matrix32, transform.matrix33],
    ];
    if rows != [[ONE, 0, 0], [0, ONE, 0], [0, 0, ONE]] {
        return Ok(Some(
            "an image that is scaled or transformed (xrandr --scale 1)".to_owned(),
        ));
    }
    let gamma = connection.randr_get_crtc_gamma(crtc)?.reply()?;
    let ramps = [gamma.red, gamma.green, gamma.blue];
    Ok((!ramps.iter().all(|ramp| is_straight(ramp))).then(|| {
        "a gamma ramp that is not straight (xrandr --gamma 1; no night light, no colour profile)".to_owned()
    }))
}

/// Whether a gamma ramp leaves levels as they are. One that nobody has set is zero, and none.
fn is_straight(ramp: &[u16]) -> bool {
    let last = ramp.len().saturating_sub(1).max(1) as i64;
    let ideal = |index: usize| index as i64 * 65_535 / last;
    ramp.iter().all(|&value| value == 0)
        || ramp
            .iter()
            .enumerate()
            .all(|(index, &value)| (i64::from(value) - ideal(index)).abs() <= RAMP_STEP)
}

/// The monitor `wanted` by its name, or by its number; the only one for `None`.
fn choose<'a>(found: &'a [Monitor], wanted: Option<&str>) -> Result<&'a Monitor, String> {
    let names: Vec<String> = found
        .iter()
        .enumerate()
        .map(|(number, one)| format!("{number}: {} ({}×{})", one.name, one.size_px.0, one.size_px.1))
        .collect();
    let names = if names.is_empty() {
        "none".to_owned()
    } else {
        names.join(", ")
    };
    match wanted {
        None => match found {
            [only] => Ok(only),
            _ => Err(format!(
                "projector.window.monitor: expected the name or number of a monitor where there is not just one, found {names}"
            )),
        },
        Some(wanted) => found
            .iter()
            .find(|one| one.name == wanted)
            .or_else(|| found.get(wanted.parse::<usize>().ok()?))
            .ok_or_else(|| format!("projector.window.monitor: expected {wanted}, found {names}")),
    }
}

/// Length of a display frame of `monitor` in s, if it shows an image of `size_px` as it is, and as often as `settings` say.
fn suits(monitor: &Monitor, settings: &Window, size_px: (u32, u32)) -> Result<f64, String> {
    let found = (u32::from(monitor.size_px.0), u32::from(monitor.size_px.1));
    if found != size_px {
        return Err(format!(
            "expected a monitor of the {}×{} pixels of projector.lens, found {} set to {}×{}",
            size_px.0, size_px.1, monitor.name, found.0, found.1
        ));
    }
    if let Some(reason) = &monitor.inexact {
        return Err(format!(
            "expected pixels of {} as they are, found {reason}",
            monitor.name
        ));
    }
    match (settings.refresh_hz, monitor.refresh_hz) {
        (Some(wanted), Some(found)) if (found / wanted - 1.0).abs() > SAME_RATE => Err(format!(
            "projector.window.refresh_hz: expected {wanted} Hz, found {} set to {found:.3} Hz",
            monitor.name
        )),
        (_, Some(hz)) | (Some(hz), None) => Ok(1.0 / hz),
        (None, None) => Err(format!(
            "projector.window.refresh_hz: expected a number, as the X server does not say how often {} shows a picture, found \
             nothing",
            monitor.name
        )),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::instrument::drivers::Pace;

    fn monitor(name: &str, size_px: (u16, u16)) -> Monitor {
        Monitor {
            name: name.to_owned(),
            at_px: (0, 0),
            size_px,
            refresh_hz: Some(60.0),
            inexact: None,
        }
    }

    #[test]
    fn a_monitor_goes_by_its_name_or_number_and_the_others_are_listed() {
        let found = [monitor("HDMI-1", (1920, 1080)), monitor("0", (640, 480))];
        // A name counts more than a number.
        for (wanted, expected) in [("HDMI-1", 0), ("0", 1), ("1", 1)] {
            assert_eq!(choose(&found, Some(wanted)), Ok(&found[expected]), "{wanted}");
        }
        for wanted in [Some("HDMI-2"), Some("2"), Some("-1"), Some(""), None] {
            let sentence = choose(&found, wanted).unwrap_err();
            assert!(
                sentence.ends_with("found 0: HDMI-1 (1920×1080), 1: 0 (640×480)"),
                "{sentence}"
            );
        }
        assert_eq!(choose(&found[..1], None), Ok(&found[0]));
        assert!(choose(&[], None).unwrap_err().ends_with("found none"));
    }

    #[test]
    fn a_monitor_suits_by_its_resolution_and_rate_or_both_are_named() {
        let settings = |refresh_hz| Window {
            display: None,
            monitor: None,
            patch_px: [0, 0, 8, 8],
            refresh_hz,
            pace: Pace::Vsync,
        };
        let good = monitor("HDMI-1", (1920, 1080));
        let silent = Monitor {
            refresh_hz: None,
            ..good.clone()
        };
        let scaled = Monitor {
            inexact: Some("an image that is rotated".to_owned()),
            ..good.clone()
        };
        let frame = |monitor: &Monitor, hz, size_px| suits(monitor, &settings(hz), size_px);
        let full = (1920, 1080);
        for (monitor, hz) in [(&good, None), (&good, Some(60.01)), (&silent, Some(60.0))] {
            assert!((frame(monitor, hz, full).unwrap() * 60.0 - 1.0).abs() < 1e-9);
        }
        for (monitor, hz, size_px, expected) in [
            (
                &good,
                None,
                (1920, 1200),
                "the 1920×1200 pixels of projector.lens, found HDMI-1 set to 1920×1080",
            ),
            (
                &good,
                Some(59.94),
                full,
                "expected 59.94 Hz, found HDMI-1 set to 60.000 Hz",
            ),
            (&silent, None, full, "refresh_hz: expected a number"),
            (&scaled, None, full, "found an image that is rotated"),
        ] {
            let sentence = frame(monitor, hz, size_px).unwrap_err();
            assert!(sentence.contains(expected), "{sentence}");
        }
    }

    #[test]
    fn a_ramp_is_straight_to_the_step_of_eight_bits() {
        let ramp = |level: &dyn Fn(u16) -> u16| (0..256).map(level).collect::<Vec<_>>();
        for straight in [ramp(&|i| i * 257), ramp(&|i| i << 8), ramp(&|_| 0), Vec::new()] {
            assert!(is_straight(&straight), "{straight:?}");
        }
        let bent = |power: f64| move |i: u16| (65_535.0 * (f64::from(i) / 255.0).powf(power)) as u16;
        for bent in [ramp(&bent(1.1)), ramp(&bent(0.95)), ramp(&|i| i * 200)] {
            assert!(!is_straight(&bent));
        }
    }
}
