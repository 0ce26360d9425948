//! The whole chain through the real binary: the host's command, the firmware's edges, the virtual rig.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::process::Command;

use rcg_hil::bench::{Bench, Outcome};
use rcg_hil::bridge::Bridge;
use rcg_hil::dut::EmulatedPico;
use rcg_hil::figures::Limit;
use rcg_hil::{log, places};

use crate::runs::Result;

crate::trials!("chain":
    measurement_has_the_bits_of_the_simulated_one [Emulator Command],
    command_reaches_the_box [Emulator Command],
);

/// Runs the host's command and returns what it prints.
pub(crate) fn rcg(arguments: &[&str]) -> Result<String> {
    let output = Command::new(places::command())
        .env("RCG_RIG", "rcg-1-16bit")
        .env("RCG_CALIBRATION", "none")
        .args(arguments)
        .current_dir(places::workspace())
        .output()?;
    if output.status.success() {
        return Ok(String::from_utf8(output.stdout)?);
    }
    let said = String::from_utf8_lossy(&output.stderr);
    Err(format!("rcg {}: {}: {said}", arguments.join(" "), output.status).into())
}

/// Every file below `dir`, by its path from there.
pub(crate) fn contents(dir: &Path) -> Result<BTreeMap<String, Vec<u8>>> {
    let mut files = BTreeMap::new();
    for entry in fs::read_dir(dir)? {
        let path = entry?.path();
        let name = path
            .file_name()
            .unwrap_or_default()
            .to_string_lossy()
            .into_owned();
        if path.is_dir() {
            let inner = contents(&path)?.into_iter();
            files.extend(inner.map(|(inner, bytes)| (format!("{name}/{inner}"), bytes)));
        } else {
            files.insert(name, fs::read(path)?);
        }
    }
    Ok(files)
}

/// A Pico of its own at a serial port; the one on the bench stays where it is.
fn bridge(bench: &Bench) -> Result<Bridge> {
    let image = bench.image().ok_or("a board has its own port")?;
    let link = bench.link();
    Ok(Bridge::start(&EmulatedPico { link, image }, 0)?)
}

/// Stops the bridge; its log goes into the failure, if there is one.
fn finish<T>(bench: &Bench, bridge: Bridge, came: Result<T>) -> Result<T> {
    let rtt = bridge.stop()?;
    came.map_err(|error| {
        let elf = bench
            .image()
            .and_then(|path| fs::read(path).ok())
            .unwrap_or_default();
        format!(
            "{}\n\nlog of the firmware at the port:\n{}",
            error.message().unwrap_or_default(),
            log::decode(&elf, &rtt)
        )
        .into()
    })
}

fn measurement_has_the_bits_of_the_simulated_one(bench: &mut Bench) -> Outcome {
    let dir = tempfile::tempdir()?;
    let path = |name: &str| dir.path().join(name).to_string_lossy().into_owned();
    let measure = |name: &str, more: &[&str]| -> Result<BTreeMap<String, Vec<u8>>> {
        let out = path(name);
        let common = [
            "measure",
            "--step",
            "15",
            "--image-size",
            "32",
            "--seed",
            "7",
            "--missed-triggers",
            "0.02",
            "-q",
            "--out",
        ];
        rcg(&[&common, [out.as_str()].as_slice(), more].concat())?;
        let mut files = contents(&Path::new(&out).join("brdf.zarr"))?;
        // Which frames it is of tells the two apart.
        let group = files.get_mut("zarr.json").ok_or("brdf.zarr has no group")?;
        let mut object: serde_json::Value = serde_json::from_slice(group)?;
        for name in ["lineage", "rcg_checksum"] {
            object["attributes"][name].take();
        }
        *group = object.to_string().into_bytes();
        Ok(files)
    };
    let simulated = measure("simulated", &[])?;
    let bridge = bridge(bench)?;
    let wires = bridge.wires().to_string();
    let behind_the_port = measure("port", &["--port", bridge.port(), "--wires", &wires]);
    let behind_the_port = finish(bench, bridge, behind_the_port)?;

    let bytes: usize = simulated.values().map(Vec::len).sum();
    if simulated.len() < 4 || bytes < 100_000 {
        return Err(format!(
            "the simulated brdf.zarr has {} files, {bytes} bytes only",
            simulated.len()
        )
        .into());
    }
    if !simulated.keys().eq(behind_the_port.keys()) {
        return Err("the two brdf.zarr have different files".into());
    }
    let differing: Vec<&String> = simulated
        .iter()
        .filter_map(|(name, bytes)| (&behind_the_port[name] != bytes).then_some(name))
        .collect();
    if !differing.is_empty() {
        return Err(format!("brdf.zarr differs in {differing:?}").into());
    }
    bench.figure(
        "brdf.zarr, equal to the simulated one bit for bit",
        bytes,
        "bytes",
        Limit::AtLeast(100_000.0),
    )
}

/// `controller info|status|run|stop|abort|bench|pulse|hold` against the box, for people and for programs.
fn command_reaches_the_box(bench: &mut Bench) -> Outcome {
    let bridge = bridge(bench)?;
    let port = bridge.port().to_owned();
    let controller = |arguments: &[&str]| -> Result<serde_json::Value> {
        let all = [&["controller"], arguments, &["--port", &port]].concat();
        let text = rcg(&all)?;
        if text.lines().count() < 2 {
            return Err(format!("{all:?}: expected a table, found {text:?}").into());
        }
        Ok(serde_json::from_str(&rcg(&[all, vec!["--json"]].concat())?)?)
    };
    let work = || -> Result<()> {
        let info = controller(&["info"])?;
        if info["clock_hz"] != bench.device.info().clock_hz {
            return Err(format!("expected the clock of the bench, found {info}").into());
        }
        let run = controller(&[
            "run",
            "--steps",
            "500",
            "--exposure",
            "100us",
            "--period",
            "1ms",
            "--cam-at",
            "200us",
        ])?;
        if (run["state"].as_str(), run["steps_done"].as_u64()) != (Some("done"), Some(500)) {
            return Err(format!("expected a run of 500 steps, found {run}").into());
        }
        let status = controller(&["status"])?;
        if status["state"] != "done" {
            return Err(format!("expected a run that is done, found {status}").into());
        }
        let pulsed = controller(&["pulse", "cam", "--width", "80us", "--count", "3"])?;
        if pulsed["pulses"] != 3 || pulsed["width_s"] != 80e-6 {
            return Err(format!("expected three pulses of 80 us, found {pulsed}").into());
        }
        let held = controller(&["hold", "proj", "low", "--active-low", "--for", "5ms"])?;
        if held["held_s"] != 5e-3 {
            return Err(format!("expected PROJ to be held for 5 ms, found {held}").into());
        }
        controller(&["abort"])?;
        controller(&["bench"])?;
        // Nothing runs, so a stop is refused, and in one sentence.
        match rcg(&["controller", "stop", "--port", &port]) {
            Err(error) if error.message().unwrap_or_default().contains("cannot stop while") => Ok(()),
            other => Err(format!("expected `stop` to be refused, found {other:?}").into()),
        }
    };
    finish(bench, bridge, work())
}
