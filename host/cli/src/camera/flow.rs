//! `rcg camera bench`

use std::path::PathBuf;
use std::time::Duration;

use rcg::base::progress::Progress as _;
use rcg::capture::flow::{Flow, Source, Synthetic, flow};
use serde_json::json;

use crate::Done;
use crate::failure::Failure;
use crate::output::{Output, table};

/// Pixels a side of synthetic frames.
const SIZE_PX: u32 = 96;

#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// How long, seconds
    #[arg(long, value_name = "S", default_value = "10", allow_negative_numbers = true, value_parser = seconds)]
    seconds: f64,
    /// Frames a second that the camera is asked for [default: as it is set; synthetic ones as fast as they are taken]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    frames_per_s: Option<u32>,
    /// Where frames come from: the camera, or this program itself (synthetic), which shows what disk and computer can do
    #[arg(long, value_name = "camera|synthetic", default_value = "camera", value_parser = ["camera", "synthetic"])]
    source: String,
    /// Pixels a side of synthetic frames, of one byte each [default: 96]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(8..=8192))]
    image_size: Option<u32>,
    /// Folder to write all frames into, as raw.zarr, as fast as a measurement would
    #[arg(long, value_name = "DIR")]
    to: Option<PathBuf>,
}

impl Args {
    /// Whether frames come without a camera.
    pub(super) fn is_synthetic(&self) -> bool {
        self.source == "synthetic"
    }

    fn duration(&self) -> Duration {
        Duration::from_secs_f64(self.seconds)
    }
}

/// How long a trial may take.
fn seconds(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(seconds) if (0.01..=86_400.0).contains(&seconds) => Ok(seconds),
        _ => Err("expected a number of seconds from 0.01 to 86400".to_owned()),
    }
}

/// Frames that need no camera.
pub(super) fn synthetic(args: &Args, device: Option<&str>, output: &Output) -> Done {
    if let Some(device) = device {
        return Err(Failure::input(format!(
            "--device: expected no camera beside --source synthetic, found {device}"
        )));
    }
    let size_px = args.image_size.unwrap_or(SIZE_PX);
    let mut source = Synthetic::new(size_px as usize, args.frames_per_s.map(f64::from));
    keep(args, &mut source, output)
}

/// Takes in what `source` gives, and says what came of it.
fn keep(args: &Args, source: &mut dyn Source, output: &Output) -> Done {
    let expected = args
        .frames_per_s
        .map_or(0.0, |rate| f64::from(rate) * args.seconds);
    output.begin("camera", expected as usize, "frames");
    let found = flow(source, args.duration(), args.to.as_deref(), &|frames| {
        output.reach(frames as usize);
    })?;
    output.end();
    output.print(&json!(found), || text(&found))
}

fn text(found: &Flow) -> String {
    let (width, height) = found.region_px;
    let mut lines = vec![
        ("camera", found.source.clone()),
        ("frames", format!("{width}×{height} px, {}", found.pixel_format)),
        (
            "taken in",
            format!(
                "{} in {:.1} s, {:.1} a second",
                found.frames, found.elapsed_s, found.frames_per_s
            ),
        ),
        ("of images", format!("{:.1} MB/s", found.bytes_per_s * 1e-6)),
        ("lost", found.lost.to_string()),
        (
            "ring",
            format!(
                "{} of {} frames at most, no room {} times",
                found.ring_high_water, found.ring_frames, found.ring_waits
            ),
        ),
    ];
    if let (Some(path), Some(synced_s)) = (&found.to, found.synced_s) {
        let mb_per_s = found.bytes_per_s * found.elapsed_s / synced_s * 1e-6;
        lines.push(("written to", path.display().to_string()));
        lines.push((
            "on the disk",
            format!("after {synced_s:.1} s, {mb_per_s:.1} MB/s"),
        ));
    }
    table(&lines)
}

#[cfg(feature = "genicam")]
pub(super) use real::camera;

#[cfg(feature = "genicam")]
mod real {
    use rcg::base::progress::Progress as _;
    use rcg::capture::genicam::{self, FreeRunning};
    use rcg::instrument::drivers::Genicam;
    use serde_json::json;

    use super::{Args, keep};
    use crate::Done;
    use crate::failure::Failure;
    use crate::output::{Output, table};

    /// Frames of a camera that runs free.
    pub(in crate::camera) fn camera(args: &Args, settings: &Genicam, output: &Output) -> Done {
        if let Some(size) = args.image_size {
            return Err(Failure::input(format!(
                "--image-size: expected none beside --source camera, whose region the rig file says, found {size}"
            )));
        }
        let rate = args.frames_per_s.map(f64::from);
        if args.to.is_some() {
            return keep(args, &mut FreeRunning::start(settings, rate)?, output);
        }
        let duration = args.duration();
        let expected = rate.map_or(0.0, |rate| rate * args.seconds);
        output.begin("camera", expected as usize, "frames");
        let found = genicam::bench(settings, rate, duration, &|frames| output.reach(frames as usize))?;
        output.end();
        output.print(&json!(found), || {
            let mut lines = vec![
                ("camera", found.id.clone()),
                (
                    "frames",
                    format!(
                        "{}×{} px, {}",
                        found.region_px.0, found.region_px.1, found.pixel_format
                    ),
                ),
                (
                    "arrived whole",
                    format!(
                        "{} in {:.1} s, {:.1} a second",
                        found.frames, found.elapsed_s, found.frames_per_s
                    ),
                ),
                ("of images", format!("{:.1} MB/s", found.bytes_per_s * 1e-6)),
                (
                    "lost",
                    format!(
                        "{}, {} of them as none may wait any more",
                        found.lost, found.underruns
                    ),
                ),
                (
                    "packets",
                    format!(
                        "{} sent again, {} missing",
                        found.resent_packets, found.missing_packets
                    ),
                ),
                ("frames that may wait", found.buffers.to_string()),
            ];
            if let Some(bytes) = found.packet_bytes {
                lines.push(("packet", format!("{bytes} bytes")));
            }
            table(&lines)
        })?;
        if found.frames == 0 {
            return Err(Failure::Failed(anyhow::anyhow!(
                "camera {}: expected frames, found none",
                found.id
            )));
        }
        Ok(())
    }
}
