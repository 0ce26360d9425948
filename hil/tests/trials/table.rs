//! The whole chain with a camera on the network: the host's command, libaravis, a GigE Vision camera, the firmware's edges.

use std::collections::BTreeMap;
use std::io::{BufRead as _, BufReader, Write as _};
use std::path::Path;
use std::process::{Command, Stdio};

use rcg::instrument::rig::Rig;
use rcg::plan::Virtual;
use rcg_hil::bench::{Bench, Outcome};
use rcg_hil::dlpc900::Dlpc900;
use rcg_hil::dut::EmulatedPico;
use rcg_hil::figures::Limit;
use rcg_hil::gige::{Faults, Settings};
use rcg_hil::places;
use rcg_hil::table::{HOLDER, Projection, Table, own_address};
use serde_json::Value;

use crate::chain::{contents, rcg};
use crate::runs::Result;

crate::trials!("table":
    what_a_camera_on_the_network_sees_has_the_bits_of_the_simulated_measurement [Emulator FastLink Camera],
    what_micromirrors_over_usb_reports_show_has_the_bits_of_the_simulated_measurement [Emulator FastLink Camera],
    frames_that_are_lost_or_doubled_on_the_network_change_no_bit [Emulator FastLink Camera],
    a_camera_that_dies_ends_the_run_and_a_resumed_one_completes_it [Emulator FastLink Camera],
    a_rig_on_the_table_is_calibrated_by_hand_as_the_simulated_one [Emulator FastLink Camera],
    what_is_not_as_the_rig_file_says_is_named [Emulator FastLink Camera],
);

/// Pixels a side of the camera's image.
const SIZE: u32 = 24;
/// What is measured, where and how.
const MEASURE: [&str; 9] = [
    "measure",
    "--step",
    "30",
    "--exposure-ms",
    "20",
    "--image-size",
    "24",
    "-q",
    "--json",
];

/// A table with the rig files `rig.toml` and `simulated.toml` in `folder`.
pub(crate) fn table(bench: &Bench, folder: &Path, noise: bool, settings: Settings) -> Result<Table> {
    let rig = Rig::load("rcg-1-16bit")?.with_image_size(SIZE)?;
    table_of(bench, folder, &rig, noise, settings, None)
}

/// As [`table`], of another `rig`, and with this unit for a projector where there is one.
fn table_of(
    bench: &Bench,
    folder: &Path,
    rig: &Rig,
    noise: bool,
    settings: Settings,
    unit: Option<&Dlpc900>,
) -> Result<Table> {
    let light = Virtual {
        noise,
        seed: 7,
        ..Virtual::default()
    };
    let image = bench.image().ok_or("a board has its own port")?;
    let link = bench.link();
    let settings = Settings {
        address: own_address(),
        broadcast: false,
        ..settings
    };
    let patterns = folder.join("patterns");
    let dut = EmulatedPico { link, image };
    let projection = match unit {
        Some(unit) => Projection::Mirrors(unit, &patterns),
        None => Projection::Folder(&patterns),
    };
    let table = Table::lay_with(rig, &light, &dut, settings, projection)?;
    std::fs::write(folder.join("rig.toml"), table.rig().to_toml())?;
    std::fs::write(folder.join("simulated.toml"), rig.to_toml())?;
    Ok(table)
}

/// Measures in `folder` with this rig file, into a folder of this name. Returns what is printed, and `brdf.zarr`.
pub(crate) fn measure(
    folder: &Path,
    rig: &str,
    out: &str,
    more: &[&str],
) -> Result<(Value, BTreeMap<String, Vec<u8>>)> {
    let path = |name: &str| folder.join(name).to_string_lossy().into_owned();
    let (rig, dir) = (path(rig), path(out));
    let printed = rcg(&[&MEASURE, ["--rig", &rig, "--out", &dir].as_slice(), more].concat())?;
    let files = contents(&folder.join(out).join("brdf.zarr"))?;
    Ok((serde_json::from_str(&printed)?, files))
}

/// The simulated measurement of what lies on the table.
fn simulated(folder: &Path, noise: &str) -> Result<BTreeMap<String, Vec<u8>>> {
    let more = ["--seed", "7", "--noise", noise];
    Ok(measure(folder, "simulated.toml", "simulated", &more)?.1)
}

/// Refuses arrays that are not the same; what is said of the measurement beside them tells who took it.
pub(crate) fn same(expected: &BTreeMap<String, Vec<u8>>, found: &BTreeMap<String, Vec<u8>>) -> Result<usize> {
    let arrays = |files: &BTreeMap<String, Vec<u8>>| -> BTreeMap<String, Vec<u8>> {
        let mut files = files.clone();
        files.remove("zarr.json");
        files
    };
    let (expected, found) = (arrays(expected), arrays(found));
    if !expected.keys().eq(found.keys()) {
        return Err("the two brdf.zarr have different files".into());
    }
    let differing: Vec<&String> = expected
        .iter()
        .filter_map(|(name, bytes)| (&found[name] != bytes).then_some(name))
        .collect();
    if differing.is_empty() {
        Ok(expected.values().map(Vec::len).sum())
    } else {
        Err(format!(
            "brdf.zarr differs in {}",
            differing
                .iter()
                .map(|name| name.as_str())
                .collect::<Vec<_>>()
                .join(", ")
        )
        .into())
    }
}

/// A figure of the capture that was printed.
pub(crate) fn counted(printed: &Value, what: &str) -> Result<u64> {
    printed["capture"][what]
        .as_u64()
        .ok_or_else(|| format!("{what}: expected a number in {}", printed["capture"]).into())
}

fn what_a_camera_on_the_network_sees_has_the_bits_of_the_simulated_measurement(bench: &mut Bench) -> Outcome {
    let folder = tempfile::tempdir()?;
    let folder = folder.path();
    // Ids go round in the middle of the run.
    let settings = Settings {
        first_id: 65_530,
        ..Settings::default()
    };
    let table = table(bench, folder, true, settings)?;
    let (printed, found) = measure(folder, "rig.toml", "table", &["--sample-name", "brass"])?;
    let sent = table.counts().frames;
    table.clear()?;
    let bytes = same(&simulated(folder, "on")?, &found)?;
    let paired = counted(&printed, "paired")?;
    if paired == 0 || sent < paired || printed["sample"] != "brass" {
        return Err(format!(
            "{sent} frames were sent, {paired} paired of {}",
            printed["sample"]
        )
        .into());
    }
    bench.figure(
        "brdf.zarr by a camera on the network, equal to the simulated one bit for bit",
        bytes,
        "bytes",
        Limit::AtLeast(10_000.0),
    )
}

fn what_micromirrors_over_usb_reports_show_has_the_bits_of_the_simulated_measurement(
    bench: &mut Bench,
) -> Outcome {
    let folder = tempfile::tempdir()?;
    let folder = folder.path();
    let rig = Rig::load("rcg-1-16bit")?.with_image_size(SIZE)?;
    let unit = Dlpc900::like(&rig)?;
    let table = table_of(bench, folder, &rig, true, Settings::default(), Some(&unit))?;
    let path = folder.join("rig.toml").to_string_lossy().into_owned();
    let checked = rcg(&["rig", "check", "--rig", &path])?;
    if !checked.contains("DLP5500 at tcp:") || !checked.contains("1024×768 pixels, 432 patterns") {
        return Err(format!("the check says of the projector: {checked}").into());
    }
    let (_, found) = measure(folder, "rig.toml", "table", &[])?;
    table.clear()?;
    let bytes = same(&simulated(folder, "on")?, &found)?;
    let complaints = unit.complaints();
    if !complaints.is_empty() {
        return Err(format!("the unit complains of {}", complaints.join(", ")).into());
    }
    bench.figure(
        "brdf.zarr by an emulated DLPC900, equal to the simulated one bit for bit",
        bytes,
        "bytes",
        Limit::AtLeast(10_000.0),
    )
}

fn frames_that_are_lost_or_doubled_on_the_network_change_no_bit(bench: &mut Bench) -> Outcome {
    let folder = tempfile::tempdir()?;
    let folder = folder.path();
    // Without noise a frame that is taken again is the same.
    let expected = simulated_of(bench, folder)?;
    let mut taken_again = 0;
    for (name, faults, resend, extended_ids) in [
        // Every 20th packet is lost, and sent again.
        (
            "resent",
            Faults {
                packet_loss: 0.05,
                ..Faults::default()
            },
            true,
            false,
        ),
        // Nobody sends them again, and ids have 64 bits.
        (
            "lost",
            Faults {
                packet_loss: 0.05,
                seed: 3,
                ..Faults::default()
            },
            false,
            true,
        ),
        // The first frame never comes (three before it were triggered by software), others neither, or twice; the clock is fast.
        (
            "starved",
            Faults {
                starved: vec![4, 9, 10],
                duplicated: vec![6, 7],
                clock_ppm: 200.0,
                ..Faults::default()
            },
            true,
            false,
        ),
    ] {
        let settings = Settings {
            resend,
            extended_ids,
            ..Settings::default()
        };
        let table = table(bench, folder, false, settings)?;
        table.set_faults(faults);
        let (printed, found) = measure(folder, "rig.toml", name, &[])?;
        let counts = table.counts();
        table.clear()?;
        same(&expected, &found)
            .map_err(|error| format!("{name}: {}", error.message().unwrap_or_default()))?;
        let repeated = counted(&printed, "repeated")?;
        if (repeated == 0) == (name != "resent") || counts.resent == 0 && name == "resent" {
            return Err(format!(
                "{name}: {repeated} exposures were taken again, {} packets",
                counts.resent
            )
            .into());
        }
        taken_again += repeated;
    }
    bench.figure(
        "exposures whose frames were lost on the network, taken again",
        taken_again as f64,
        "exposures",
        Limit::AtLeast(2.0),
    )
}

/// The simulated measurement without noise, with its rig file in `folder`.
pub(crate) fn simulated_of(bench: &Bench, folder: &Path) -> Result<BTreeMap<String, Vec<u8>>> {
    table(bench, folder, false, Settings::default())?.clear()?;
    simulated(folder, "off")
}

fn a_camera_that_dies_ends_the_run_and_a_resumed_one_completes_it(bench: &mut Bench) -> Outcome {
    let folder = tempfile::tempdir()?;
    let folder = folder.path();
    let expected = simulated_of(bench, folder)?;
    let table = table(bench, folder, false, Settings::default())?;
    // After so many frames it hears and says nothing any more.
    table.die_after(10);
    let error = match measure(folder, "rig.toml", "table", &[]) {
        Ok(_) => return Err("a measurement ended with a dead camera".into()),
        Err(error) => error.message().unwrap_or_default().to_owned(),
    };
    if !error.contains("the connection has ended") {
        return Err(format!("a dead camera is told of as: {error}").into());
    }
    table.revive()?;
    let (_, found) = measure(folder, "rig.toml", "table", &["--resume"])?;
    table.clear()?;
    same(&expected, &found)?;
    Ok(())
}

fn what_is_not_as_the_rig_file_says_is_named(bench: &mut Bench) -> Outcome {
    let folder = tempfile::tempdir()?;
    let folder = folder.path();
    let table = table(bench, folder, false, Settings::default())?;
    let good = std::fs::read_to_string(folder.join("rig.toml"))?;
    let check = |text: &str| -> Result<String> {
        std::fs::write(folder.join("bad.toml"), text)?;
        let path = folder.join("bad.toml").to_string_lossy().into_owned();
        let output = Command::new(places::command())
            .args(["rig", "check", "--rig", &path])
            .output()?;
        Ok(String::from_utf8(output.stdout)?)
    };
    for (from, to, expected) in [
        ("", "", "firmware"),
        ("", "", "; format RGB16 of RGB16; triggered by Line1 of "),
        (
            "Line1",
            "Line7",
            "camera.genicam.trigger_line: expected one of Software, Line1",
        ),
        ("Line2", "Line9", "camera.genicam.strobe_line"),
        (
            "RGB16",
            "BayerRG12",
            "camera.genicam.pixel_format: expected one of RGB16",
        ),
        ("device = \"127.", "device = \"128.", "expected a camera"),
        ("/dev/pts/", "/dev/no/", "port"),
    ] {
        let said = check(&if from.is_empty() {
            good.clone()
        } else {
            good.replace(from, to)
        })?;
        if !said.contains(expected) {
            return Err(format!("{from} → {to}: expected {expected} in: {said}").into());
        }
    }
    table.clear()?;
    Ok(())
}

/// Somebody puts the targets in that the command asks for, one after the other; returns how it ended.
fn calibrate_by_hand(folder: &Path) -> Result<String> {
    let path = |name: &str| folder.join(name).to_string_lossy().into_owned();
    let mut command = Command::new(places::command())
        .args(["calibrate", "geometry", "--by-hand", "-q", "--image-size", "64"])
        .args(["--rig", &path("rig.toml"), "--out", &path("by-hand")])
        .stdin(Stdio::piped())
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()?;
    let mut answers = command.stdin.take().ok_or("no stdin")?;
    let mut said = String::new();
    for line in BufReader::new(command.stderr.take().ok_or("no stderr")?).lines() {
        let line = line?;
        said += &line;
        said += "\n";
        let Some((_, asked)) = line
            .split_once(": ")
            .filter(|(_, asked)| asked.contains("; put it in"))
        else {
            continue;
        };
        let target = asked.split(';').next().unwrap_or_default();
        // `flat mirror at 15° / 120°`
        let put = match target.strip_prefix("flat mirror at ") {
            Some(tilt) => format!("mirror {}", tilt.replace(['°', '/'], " ")),
            None => "lambert:0.5".to_owned(),
        };
        std::fs::write(folder.join(HOLDER), put)?;
        answers.write_all(b"\n")?;
    }
    let status = command.wait()?;
    if status.success() {
        Ok(said)
    } else {
        Err(format!("{status}: {said}").into())
    }
}

fn a_rig_on_the_table_is_calibrated_by_hand_as_the_simulated_one(bench: &mut Bench) -> Outcome {
    let folder = tempfile::tempdir()?;
    let folder = folder.path();
    let rig = Rig::load("dmd")?.with_image_size(64)?;
    let table = table_of(bench, folder, &rig, false, Settings::default(), None)?;
    let said = calibrate_by_hand(folder)?;
    table.clear()?;
    let path = |name: &str| folder.join(name).to_string_lossy().into_owned();
    rcg(&[
        "calibrate",
        "geometry",
        "-q",
        "--image-size",
        "64",
        "--noise",
        "off",
        "--rig",
        &path("simulated.toml"),
        "--out",
        &path("simulated"),
    ])?;
    let read = |name: &str| std::fs::read(folder.join(name).join("geometry.json"));
    let (by_hand, simulated) = (read("by-hand")?, read("simulated")?);
    if by_hand != simulated {
        return Err(format!("the two geometries differ; by hand was said: {said}").into());
    }
    bench.figure(
        "geometry of a rig on the table, by hand, equal to the simulated one bit for bit",
        by_hand.len() as f64,
        "bytes",
        Limit::AtLeast(1_000.0),
    )
}
