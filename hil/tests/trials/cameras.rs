//! The commands that try a camera, on ours and on one that others wrote.

use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use rcg_hil::bench::{Bench, Outcome};
use rcg_hil::figures::Limit;
use rcg_hil::gige::{GigeCamera, Settings};
use rcg_hil::table::own_address;
use serde_json::Value;

use crate::chain::rcg;
use crate::runs::Result;

crate::trials!("cameras":
    the_command_tries_cameras_of_ours_and_of_others [Emulator FastLink Camera],
);

/// A camera that others wrote: the one that comes with libaravis, at the usual address of this machine.
struct Others(Child);

impl Others {
    /// Switches it on, where it is installed (Debian: aravis-tools).
    fn start() -> Option<Self> {
        let fake = Command::new("arv-fake-gv-camera-0.8")
            .args(["-i", "127.0.0.1", "-s", "others"])
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn();
        fake.ok().map(Self)
    }
}

impl Drop for Others {
    fn drop(&mut self) {
        self.0.kill().ok();
        self.0.wait().ok();
    }
}

fn the_command_tries_cameras_of_ours_and_of_others(bench: &mut Bench) -> Outcome {
    let folder = tempfile::tempdir()?;
    let settings = Settings {
        address: own_address(),
        sensor_px: (96, 64),
        // One of them hears broadcasts.
        broadcast: false,
        ..Settings::default()
    };
    let ours = GigeCamera::start(settings)?;
    let others = Others::start();
    let mut addresses = vec![ours.address().ip().to_string()];
    if others.is_some() {
        addresses.push("127.0.0.1".to_owned());
        // It takes a moment until it hears; beside other trials, a long one.
        retried(20, || {
            std::thread::sleep(Duration::from_millis(500));
            let listed = rcg(&["camera", "list"])?;
            if listed.contains("others") {
                return Ok(());
            }
            Err(format!("a camera that others wrote is not listed: {listed}").into())
        })?;
    }
    let picture = folder.path().join("frame.png");
    for address in &addresses {
        // That of others sends no packet again, and its frames get lost where two cores are busy.
        retried(3, || tried(address, &picture))?;
    }
    bench.figure(
        "cameras that the command tried, ours and that of libaravis where it is installed",
        addresses.len() as f64,
        "cameras",
        Limit::AtLeast(1.0),
    )
}

/// The first success of so many attempts, or the last failure.
fn retried(attempts: usize, mut attempt: impl FnMut() -> Result<()>) -> Result<()> {
    let mut last = attempt();
    for _ in 1..attempts {
        if last.is_ok() {
            break;
        }
        last = attempt();
    }
    last
}

/// What the command says of the camera at this address, of a single frame of it, and of a second of frames.
fn tried(address: &str, picture: &Path) -> Result<()> {
    let path = picture.to_string_lossy();
    let ask = |arguments: &[&str]| -> Result<Value> {
        let printed = rcg(&[arguments, &["--device", address, "--json", "-q"]].concat())?;
        Ok(serde_json::from_str(&printed)?)
    };
    let info = ask(&["camera", "info"])?;
    let grabbed = ask(&["camera", "grab", "--exposure-ms", "1", "--out", &path])?;
    let region = &grabbed["region_px"];
    let (width, height) = (region[0].as_u64(), region[1].as_u64());
    if info["sensor_px"] != *region || info["pixel_format"] != "Mono8" {
        return Err(format!("{address}: {info}, {grabbed}").into());
    }
    let image = std::fs::read(picture)?;
    // Width and height of a PNG (third edition, 11.2.1).
    let number = |at: usize| {
        u64::from(u32::from_be_bytes([
            image[at],
            image[at + 1],
            image[at + 2],
            image[at + 3],
        ]))
    };
    if (Some(number(16)), Some(number(20))) != (width, height) {
        return Err(format!("{address}: a picture of {}×{} pixels", number(16), number(20)).into());
    }
    let ran = ask(&["camera", "bench", "--seconds", "1", "--frames-per-s", "20"])?;
    let frames = ran["frames"].as_u64().unwrap_or(0);
    if !(1..=60).contains(&frames) || ran["lost"] != 0 {
        return Err(format!("{address}: {ran}").into());
    }
    Ok(())
}
