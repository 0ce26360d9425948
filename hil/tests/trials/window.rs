//! A projector that is a window: what it shows is grabbed from an X server's screen and lights the virtual rig, and a
//! photodiode before that screen is SYNC of the emulated Pico.

use std::path::Path;
use std::process::Command;
use std::sync::{Arc, Mutex, PoisonError};

use image::RgbImage;
use rcg::capture::projector::Projector as _;
use rcg::capture::window::{WindowProjector, monitors};
use rcg::instrument::drivers::{CameraDriver, Genicam, Pace, ProjectorDriver, Window};
use rcg::instrument::rig::Rig;
use rcg::plan::Virtual;
use rcg::plan::pattern::BitPattern;
use rcg_hil::bench::{Bench, Outcome};
use rcg_hil::dut::EmulatedPico;
use rcg_hil::figures::Limit;
use rcg_hil::gige::Settings;
use rcg_hil::places;
use rcg_hil::screen::{Display, DisplayFaults, Eye, Xvfb};
use rcg_hil::table::{Projection, Table, own_address};
use x11rb::protocol::randr::{ConnectionExt as _, MonitorInfo};
use x11rb::protocol::xproto::ConnectionExt as _;

use crate::runs::Result;
use crate::table::{counted, measure, same};

crate::trials!("window":
    a_window_shows_every_pixel_as_it_is [Screen],
    what_a_window_shows_has_the_bits_of_the_simulated_measurement [Emulator FastLink Camera Screen],
    a_window_that_is_closed_or_not_seen_ends_the_run_and_a_resumed_one_completes_it [Emulator FastLink Camera Screen],
    a_display_that_does_not_suit_is_named [Command Screen],
);

/// Display frames a second.
const HZ: u32 = 125;
/// What the photodiode looks at.
const PATCH_PX: [u32; 4] = [8, 700, 48, 40];

/// The rig before the window: its projector settles in a display frame and a half.
fn rig() -> Result<Rig> {
    let mut rig = Rig::load("rcg-1-16bit")?.with_image_size(24)?;
    rig.projector.settle_s = 0.012;
    rig.camera.readout_s = 0.001;
    Ok(rig)
}

/// A window on the X display of `server`, in its vertical blank.
fn window(server: &Xvfb) -> Window {
    Window {
        display: Some(server.display().to_owned()),
        monitor: None,
        patch_px: PATCH_PX,
        refresh_hz: Some(60.0),
        pace: Pace::Vsync,
    }
}

/// An X server of the projector's size.
fn server(rig: &Rig) -> Result<Xvfb> {
    let lens = &rig.projector.lens;
    Ok(Xvfb::start((lens.width_px, lens.height_px))?)
}

/// A table before such a screen, with its rig files in `folder`; the display's faults can be changed.
fn table(bench: &Bench, folder: &Path, server: &Xvfb) -> Result<(Table, Arc<Mutex<DisplayFaults>>)> {
    let rig = rig()?;
    let light = Virtual {
        noise: false,
        seed: 7,
        ..Virtual::default()
    };
    let image = bench.image().ok_or("a board has its own port")?;
    let dut = EmulatedPico {
        link: bench.link(),
        image,
    };
    let settings = Settings {
        address: own_address(),
        broadcast: false,
        ..Settings::default()
    };
    let (screen, faults) = Display::before(server, HZ, PATCH_PX)?;
    let table = Table::lay_with(&rig, &light, &dut, settings, Projection::Screen(screen))?;
    std::fs::write(folder.join("rig.toml"), table.rig().to_toml())?;
    std::fs::write(folder.join("simulated.toml"), rig.to_toml())?;
    Ok((table, faults))
}

fn set(faults: &Mutex<DisplayFaults>, to: DisplayFaults) {
    *faults.lock().unwrap_or_else(PoisonError::into_inner) = to;
}

const NOISE_FREE: [&str; 4] = ["--seed", "7", "--noise", "off"];

fn what_a_window_shows_has_the_bits_of_the_simulated_measurement(bench: &mut Bench) -> Outcome {
    let folder = tempfile::tempdir()?;
    let folder = folder.path();
    let server = server(&rig()?)?;
    let (table, faults) = table(bench, folder, &server)?;
    let (_, expected) = measure(folder, "simulated.toml", "simulated", &NOISE_FREE)?;
    let (printed, found) = measure(folder, "rig.toml", "steady", &[])?;
    let bytes = same(&expected, &found)?;
    let (paired, disputed) = (counted(&printed, "paired")?, counted(&printed, "disputed")?);
    if paired < 20 || disputed > 0 {
        return Err(format!("{paired} exposures were paired, {disputed} disputed").into());
    }
    // Pictures count from the first one that the display has seen on; each run has one before its exposures.
    let from = paired + 1;
    set(
        &faults,
        DisplayFaults {
            repeated: vec![from + 3, from + 14],
            flickering: (from + 6..from + 11).collect(),
            skipped: vec![from + 12],
            ..DisplayFaults::default()
        },
    );
    let (printed, found) = measure(folder, "rig.toml", "unsteady", &[])?;
    same(&expected, &found)?;
    let (disputed, repeated) = (counted(&printed, "disputed")?, counted(&printed, "repeated")?);
    // One each of what was repeated or skipped, and steps that flickering has begun with the picture before.
    if disputed < 5 || repeated < disputed {
        return Err(format!("{disputed} exposures were disputed, {repeated} taken again").into());
    }
    table.clear()?;
    bench.figure(
        "exposures whose display frames were repeated, skipped or flickered, taken again",
        repeated,
        "exposures",
        Limit::AtLeast(5.0),
    )?;
    bench.figure(
        "brdf.zarr by a window, equal to the simulated one bit for bit",
        bytes,
        "bytes",
        Limit::AtLeast(10_000.0),
    )
}

fn a_window_that_is_closed_or_not_seen_ends_the_run_and_a_resumed_one_completes_it(
    bench: &mut Bench,
) -> Outcome {
    let folder = tempfile::tempdir()?;
    let folder = folder.path();
    let server = server(&rig()?)?;
    let (table, faults) = table(bench, folder, &server)?;
    let (_, expected) = measure(folder, "simulated.toml", "simulated", &NOISE_FREE)?;
    for (fault, more, sentence) in [
        (
            DisplayFaults {
                closes_at: Some(7),
                ..DisplayFaults::default()
            },
            &[][..],
            "expected a window that stays, found that it was closed",
        ),
        (
            DisplayFaults {
                blind_from: Some(0),
                ..DisplayFaults::default()
            },
            &["--resume"],
            "does the photodiode see the patch",
        ),
    ] {
        set(&faults, fault);
        match measure(folder, "rig.toml", "table", more) {
            Err(error) if error.message().unwrap_or_default().contains(sentence) => {}
            Err(error) => {
                return Err(format!(
                    "expected {sentence}, found {}",
                    error.message().unwrap_or_default()
                )
                .into());
            }
            Ok(_) => return Err(format!("a run ended in spite of: {sentence}").into()),
        }
    }
    set(&faults, DisplayFaults::default());
    let (_, found) = measure(folder, "rig.toml", "table", &["--resume"])?;
    table.clear()?;
    same(&expected, &found)?;
    Ok(())
}

/// The picture that a window should show of `pattern`.
fn expected_of(pattern: &BitPattern, patch_level: u8) -> RgbImage {
    let (width, height) = pattern.size_px();
    let mut picture = RgbImage::new(width as u32, height as u32);
    for pixel in pattern.lit() {
        let mut colour = [pattern.level(); 3];
        if let Some(primary) = pattern.primary() {
            colour = [0; 3];
            colour[usize::from(primary)] = pattern.level();
        }
        picture
            .get_pixel_mut(pixel % width as u32, pixel / width as u32)
            .0 = colour;
    }
    let [x, y, width, height] = PATCH_PX;
    for row in y..y + height {
        for column in x..x + width {
            picture.get_pixel_mut(column, row).0 = [patch_level; 3];
        }
    }
    picture
}

fn a_window_shows_every_pixel_as_it_is(bench: &mut Bench) -> Outcome {
    let mut rig = rig()?;
    rig.projector.settle_s = 0.030;
    let server = server(&rig)?;
    rig.projector.driver = ProjectorDriver::Window;
    rig.projector.window = Some(window(&server));
    let found = monitors(Some(server.display()))?;
    if found.len() != 1 || found[0].size_px != (1024, 768) {
        return Err("expected one monitor of the screen's size".into());
    }
    let eye = Eye::open(server.display())?;
    let mut projector = WindowProjector::open(&rig)?;
    projector.clear()?;
    let mut patterns = Vec::new();
    // Pixels here and there, at the corners and under the patch; whole rows; all; none.
    let some: Vec<u32> = (0..1024 * 768)
        .filter(|pixel| pixel % 1237 < 3 || pixel * 7 % 1009 == 0)
        .collect();
    let rows: Vec<u32> = (0..1024 * 768).filter(|pixel| pixel / 1024 % 5 < 2).collect();
    let all: Vec<u32> = (0..1024 * 768).collect();
    for (lit, level, primary) in [
        (&some, 255, None),
        (&rows, 97, Some(0)),
        (&all, 1, Some(1)),
        (&some, 254, Some(2)),
        (&all, 255, None),
        (&Vec::new(), 255, None),
    ] {
        let mut pattern = BitPattern::black(1024, 768);
        pattern.light(lit);
        pattern.set_level(level);
        pattern.set_primary(primary);
        projector.load(&pattern)?;
        patterns.push(pattern);
    }
    let dark = expected_of(&BitPattern::black(1024, 768), 0);
    if eye.grab_all()? != dark {
        return Err("expected black before the first picture".into());
    }
    let leading = projector.leading().ok_or("a window leads")?;
    let (mut appeared, mut pixels) = (Vec::new(), 0_u32);
    for (number, pattern) in patterns.iter().enumerate().cycle().take(8) {
        appeared.push(leading.show(number)?);
        if eye.grab_all()? != expected_of(pattern, 255) {
            return Err(format!("picture {number} is not shown as it is").into());
        }
        pixels += 1024 * 768;
    }
    leading.finish()?;
    // The patch was dark for a display frame between them: two frames each at least.
    let frames: Vec<f64> = appeared
        .windows(2)
        .map(|pair| (pair[1] - pair[0]) * 60.0)
        .collect();
    if !frames.iter().all(|frames| *frames > 1.5) {
        return Err(format!("display frames between pictures: {frames:.2?}").into());
    }
    // Somebody closes it.
    eye.close_window()?;
    let error = projector
        .clear()
        .err()
        .map(|error| error.to_string())
        .unwrap_or_default();
    if !error.contains("on screen of display") || !error.contains("that it was closed") {
        return Err(format!("a closed window is told of as: {error}").into());
    }
    bench.figure(
        "pixels of pictures on a screen, as they are",
        pixels,
        "pixels",
        Limit::Reported,
    )
}

/// What `rcg rig check` says of the projector with this rig file.
fn checked(folder: &Path, rig: &Rig, display: Option<&str>) -> Result<String> {
    let path = folder.join("rig.toml");
    std::fs::write(&path, rig.to_toml())?;
    let mut command = Command::new(places::command());
    command.env_remove("DISPLAY").env_remove("WAYLAND_DISPLAY");
    if let Some(display) = display {
        command.env("DISPLAY", display);
    }
    let output = command.args(["rig", "check", "--rig"]).arg(path).output()?;
    let said = String::from_utf8(output.stdout)? + &String::from_utf8(output.stderr)?;
    let line = said.lines().find(|line| line.starts_with("projector"));
    Ok(line.map_or(said.clone(), str::to_owned))
}

/// A screen for two monitors side by side, the first of the projector's size.
fn two_monitors() -> Result<Xvfb> {
    let server = Xvfb::start((1024 + 640, 768))?;
    let eye = Eye::open(server.display())?;
    let (connection, root) = eye.connection();
    for (name, x, width, height) in [("HDMI-1", 0, 1024, 768), ("DP-2", 1024, 640, 480)] {
        let name = connection.intern_atom(false, name.as_bytes())?.reply()?.atom;
        let monitor = MonitorInfo {
            name,
            x,
            width,
            height,
            ..MonitorInfo::default()
        };
        connection.randr_set_monitor(root, monitor)?.check()?;
    }
    Ok(server)
}

/// A rig with a camera that is not there.
fn lab() -> Result<Rig> {
    let mut lab = rig()?;
    lab.projector.settle_s = 0.030;
    lab.camera.driver = CameraDriver::Genicam;
    lab.camera.genicam = Some(Genicam {
        device: Some("127.254.254.254".to_owned()),
        region_px: Some([0, 0, 24, 24]),
        pixel_format: Some("RGB16".to_owned()),
        ..Genicam::default()
    });
    lab.projector.driver = ProjectorDriver::Window;
    Ok(lab)
}

fn a_display_that_does_not_suit_is_named(_: &mut Bench) -> Outcome {
    let folder = tempfile::tempdir()?;
    let folder = folder.path();
    let server = two_monitors()?;
    let mut lab = lab()?;
    let base = Window {
        monitor: Some("HDMI-1".to_owned()),
        ..window(&server)
    };
    let listed = "found 0: HDMI-1 (1024×768), 1: DP-2 (640×480)";
    let with = |change: &dyn Fn(&mut Window)| {
        let mut window = base.clone();
        change(&mut window);
        window
    };
    let display = Some(server.display());
    for (window, display, expected) in [
        (base.clone(), None, "window on HDMI-1 of display"),
        (
            base.clone(),
            None,
            "1024×768 pixels at 60.000 Hz, the photodiode's patch of 48×40",
        ),
        (
            with(&|window| window.display = None),
            display,
            "window on HDMI-1 of display",
        ),
        (
            with(&|window| window.monitor = Some("0".to_owned())),
            None,
            "window on HDMI-1",
        ),
        (with(&|window| window.display = None), None, "DISPLAY, found none"),
        (
            with(&|window| window.display = Some(":4711".to_owned())),
            None,
            "an X server that answers, found: :4711",
        ),
        (
            with(&|window| window.monitor = Some("VGA-1".to_owned())),
            None,
            listed,
        ),
        (with(&|window| window.monitor = None), None, listed),
        (
            with(&|window| window.monitor = Some("DP-2".to_owned())),
            None,
            "a monitor of the 1024×768 pixels of projector.lens, found DP-2 set to 640×480",
        ),
        (
            with(&|window| window.refresh_hz = None),
            None,
            "refresh_hz: expected a number",
        ),
        (
            with(&|window| window.refresh_hz = Some(25.0)),
            None,
            "projector.settle_s: expected at least 0.0500 s",
        ),
    ] {
        lab.projector.window = Some(window);
        let said = checked(folder, &lab, display)?;
        if !said.contains(expected) {
            return Err(format!("expected {expected} in: {said}").into());
        }
    }
    Ok(())
}
