//! `rcg camera`

mod flow;

use std::path::PathBuf;

use rcg::instrument::drivers::Genicam;
use rcg::instrument::rig::Rig;

use crate::Done;
use crate::output::Output;

/// Look for GenICam cameras (GigE Vision, USB3 Vision), and try one.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    #[command(subcommand)]
    action: Action,
    /// Identity of the camera, a part of it, or its network address [default: that of the rig file; else the only one]
    #[arg(long, global = true, value_name = "NAME", value_parser = crate::request::words)]
    device: Option<String>,
}

#[derive(Debug, clap::Subcommand)]
enum Action {
    /// Which cameras answer
    List,
    /// What the camera can do, and how it is set
    Info,
    /// Take one frame by software and write it as a PNG
    Grab(Grab),
    /// Let the camera run free and count the frames that arrive whole, or those that reach the disk
    Bench(flow::Args),
}

#[derive(Debug, clap::Args)]
#[cfg_attr(not(feature = "genicam"), allow(dead_code))] // read by the driver
struct Grab {
    /// PNG to write: the sensor's own pixels, 16 bits, under a mosaic of colours as grey
    #[arg(long, value_name = "FILE.png")]
    out: PathBuf,
    /// Exposure time in milliseconds
    #[arg(long, value_name = "MS", default_value = "10", value_parser = crate::request::exposure_ms)]
    exposure_ms: f64,
}

pub(crate) fn run(args: &Args, rig: &str, output: &Output) -> Done {
    let rig = Rig::load(rig)?;
    let mut settings = rig.camera.genicam.unwrap_or_default();
    if args.device.is_some() {
        settings.device.clone_from(&args.device);
    }
    match &args.action {
        Action::Bench(bench) if bench.is_synthetic() => {
            flow::synthetic(bench, args.device.as_deref(), output)
        }
        action => act(action, &settings, output),
    }
}

#[cfg(not(feature = "genicam"))]
fn act(_action: &Action, _settings: &Genicam, _output: &Output) -> Done {
    Err(crate::failure::Failure::input(
        "camera: expected a program that was built with `--features genicam`, found one without (Debian: apt install \
         libaravis-dev libusb-1.0-0-dev; then `cargo build --release --features genicam`)",
    ))
}

#[cfg(feature = "genicam")]
fn act(action: &Action, settings: &Genicam, output: &Output) -> Done {
    match action {
        Action::List => real::list(output),
        Action::Info => real::info(settings, output),
        Action::Grab(args) => real::grab(args, settings, output),
        Action::Bench(args) => flow::camera(args, settings, output),
    }
}

#[cfg(feature = "genicam")]
mod real {
    use rcg::base::file_format::PICTURE;
    use rcg::capture::genicam;
    use rcg::instrument::drivers::Genicam;
    use serde_json::json;

    use super::Grab;
    use crate::Done;
    use crate::output::{Output, table, to_write};

    pub(super) fn list(output: &Output) -> Done {
        let found = genicam::list();
        output.print(&json!(found), || {
            if found.is_empty() {
                return "no camera answers\n".to_owned();
            }
            let lines = found.iter().map(|one| {
                format!(
                    "{}  {} {}, {}, {}\n",
                    one.id, one.vendor, one.model, one.protocol, one.address
                )
            });
            lines.collect::<Vec<_>>().concat()
        })
    }

    pub(super) fn info(settings: &Genicam, output: &Output) -> Done {
        let found = genicam::details(settings.device.as_deref())?;
        let yes_or_no = |yes: bool| if yes { "yes" } else { "no" }.to_owned();
        output.print(&json!(found), || {
            let (x, y, width, height) = found.region_px;
            let mut lines = vec![
                ("camera", found.id.clone()),
                ("maker and model", format!("{} {}", found.vendor, found.model)),
                ("serial number", found.serial.clone()),
                (
                    "sensor",
                    format!("{}×{} px", found.sensor_px.0, found.sensor_px.1),
                ),
                ("region", format!("{width}×{height} px at ({x}, {y})")),
                (
                    "pixel format",
                    format!("{} of {}", found.pixel_format, found.pixel_formats.join(", ")),
                ),
                ("trigger sources", found.trigger_sources.join(", ")),
                ("exposure by the trigger's width", yes_or_no(found.trigger_width)),
                ("exposure put out on a line", yes_or_no(found.exposure_active)),
                ("trigger by software", yes_or_no(found.software_trigger)),
                (
                    "exposure time",
                    format!("{:.6} to {:.3} s", found.exposure_s.0, found.exposure_s.1),
                ),
            ];
            if let Some((gain, low, high)) = found.gain {
                lines.push(("gain", format!("{gain} of {low} to {high}, in its own unit")));
            }
            if let Some(bytes) = found.packet_bytes {
                lines.push(("packet", format!("{bytes} bytes")));
            }
            table(&lines)
        })
    }

    pub(super) fn grab(args: &Grab, settings: &Genicam, output: &Output) -> Done {
        to_write(&args.out, PICTURE)?;
        let found = genicam::grab(settings, args.exposure_ms * 1e-3)?;
        found.write(&args.out)?;
        let saturated = found.dn.iter().filter(|&&dn| dn == found.range_dn()).count();
        let brightest = found.dn.iter().max().copied().unwrap_or(0);
        let value = json!({
            "out": args.out, "camera": found.id, "pixel_format": found.pixel_format, "region_px": found.region_px,
            "brightest_dn": brightest, "saturated": saturated,
        });
        output.print(&value, || {
            format!(
                "{}: {}×{} pixels of {}, brightest {brightest} of {} DN, {saturated} saturated\n",
                args.out.display(),
                found.region_px.0,
                found.region_px.1,
                found.pixel_format,
                found.range_dn(),
            )
        })
    }
}
