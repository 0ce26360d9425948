//! `rcg projector`

use std::fs;
use std::path::{Path, PathBuf};
use std::thread;
use std::time::Duration;

use rcg::base::progress::Progress as _;
use rcg::capture::dlpc900::packet::Commands;
use rcg::capture::dlpc900::unit::Unit;
use rcg::capture::dlpc900::{self, Dlpc900Projector, Kind, video};
use rcg::capture::files::read_pattern;
use rcg::capture::projector::Projector as _;
use rcg::instrument::drivers::Dlpc900;
use rcg::instrument::rig::Rig;
use rcg::plan::pattern::BitPattern;
use serde_json::json;

use crate::Done;
use crate::failure::Failure;
use crate::output::{Output, table};

/// Look for projectors with micromirrors (TI DLPC900) on USB, and try one.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    #[command(subcommand)]
    action: Action,
    /// Serial number of the unit, a part of it, its device file, or tcp:HOST:PORT [default: that of the rig file; else the only one]
    #[arg(long, global = true, value_name = "NAME", value_parser = crate::request::words)]
    device: Option<String>,
}

#[derive(Debug, clap::Subcommand)]
enum Action {
    /// Which units are on USB, and what they are
    List,
    /// What the unit is and does
    Info,
    /// Show one picture until something else is shown
    Show(Show),
    /// Upload the pictures of a folder, such as one that `rcg patterns` writes, in the order of their names; each trigger at TRIG_IN_1
    /// then shows the next
    Upload(Upload),
    /// Upload test patterns that fill more than one image, step through them, and compare what the unit says with what it was told
    Test(Test),
    /// Let a DLPC900 or DLPC350 show the planes of each video frame one after the other
    Video(Video),
}

#[derive(Debug, clap::Args)]
struct Show {
    /// PNG of native resolution, in one level of grey or of one primary
    #[arg(value_name = "PATTERN.png")]
    pattern: PathBuf,
}

#[derive(Debug, clap::Args)]
struct Upload {
    /// Folder of PNGs of native resolution
    #[arg(value_name = "FOLDER")]
    folder: PathBuf,
    /// Show each for so many milliseconds, without a trigger [default: each until the next trigger]
    #[arg(long, value_name = "MS", value_parser = shown_ms)]
    each_ms: Option<f64>,
}

#[derive(Debug, clap::Args)]
struct Test {
    /// How long each pattern is shown, milliseconds
    #[arg(long, value_name = "MS", default_value = "100", value_parser = shown_ms)]
    each_ms: f64,
}

#[derive(Debug, clap::Args)]
struct Video {
    /// How many planes of each frame
    #[arg(long, value_name = "N", default_value_t = 24, value_parser = clap::value_parser!(u32).range(1..=24))]
    planes: u32,
    /// Frames a second
    #[arg(long, value_name = "HZ", default_value = "60", value_parser = frame_hz)]
    frame_hz: f64,
}

/// A time that a pattern without triggers can be shown for.
fn shown_ms(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(ms) if (0.105..=16_000.0).contains(&ms) => Ok(ms),
        _ => Err("expected a number of milliseconds from 0.105 to 16000".to_owned()),
    }
}

fn frame_hz(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(hz) if (1.0..=1000.0).contains(&hz) => Ok(hz),
        _ => Err("expected a number of frames a second from 1 to 1000".to_owned()),
    }
}

pub(crate) fn run(args: &Args, rig: &str, output: &Output) -> Done {
    let rig = Rig::load(rig)?;
    let mut settings = rig.projector.dlpc900.unwrap_or_default();
    if args.device.is_some() {
        settings.device.clone_from(&args.device);
    }
    match &args.action {
        Action::List => list(output),
        Action::Info => info(&settings, output),
        Action::Show(show) => {
            let patterns = vec![read(&show.pattern)?];
            shown(
                &settings,
                std::slice::from_ref(&show.pattern),
                &patterns,
                Some(1000.0),
                output,
            )
        }
        Action::Upload(upload) => {
            let paths = pictures(&upload.folder)?;
            let patterns = paths
                .iter()
                .map(|path| read(path))
                .collect::<Result<Vec<_>, _>>()?;
            shown(&settings, &paths, &patterns, upload.each_ms, output)
        }
        Action::Test(test) => try_out(&settings, test.each_ms, output),
        Action::Video(video) => frames(&settings, video, output),
    }
}

fn list(output: &Output) -> Done {
    let found = dlpc900::list()?;
    output.print(&json!(found), || {
        if found.is_empty() {
            return "no DLPC900 (0451:c900) or DLPC350 (0451:6401) on USB\n".to_owned();
        }
        let lines = found
            .iter()
            .map(|one| format!("{}  {}  {}\n", one.path, one.kind.name(), one.serial));
        lines.collect::<Vec<_>>().concat()
    })
}

/// What there is to say of the unit.
fn lines(projector: &Dlpc900Projector) -> Vec<(&'static str, String)> {
    let (status, (width, height)) = (projector.status(), projector.size_px());
    let version = |(major, minor, patch): (u8, u8, u16)| format!("{major}.{minor}.{patch}");
    let yes_or_no = |yes: bool| if yes { "yes" } else { "no" }.to_owned();
    vec![
        ("projector", projector.name().to_owned()),
        ("mirrors", format!("{width}×{height}")),
        (
            "controllers",
            if projector.model().is_dual { "two" } else { "one" }.to_owned(),
        ),
        ("patterns at a time", projector.capacity().to_string()),
        (
            "firmware",
            format!(
                "{} {}, sequences {}",
                version(status.firmware),
                status.tag,
                version(status.sequences)
            ),
        ),
        ("mode", status.mode.name().to_owned()),
        ("a sequence runs", yes_or_no(status.running)),
        ("mirrors parked", yes_or_no(status.parked)),
        ("video source", yes_or_no(status.locked)),
    ]
}

fn info(settings: &Dlpc900, output: &Output) -> Done {
    let projector = Dlpc900Projector::open(settings, 0.0)?;
    let value = json!({
        "projector": projector.name(), "mirrors": projector.model().name, "size_px": projector.size_px(),
        "capacity": projector.capacity(), "status": projector.status(),
    });
    output.print(&value, || table(&lines(&projector)))
}

fn read(path: &Path) -> Result<BitPattern, Failure> {
    read_pattern(path).map_err(|error| Failure::input(error).at(path.display()))
}

/// The PNGs of `folder` by their names.
fn pictures(folder: &Path) -> Result<Vec<PathBuf>, Failure> {
    let unreadable = |error| {
        Failure::input(format!(
            "{}: expected a folder of PNGs, found {error}",
            folder.display()
        ))
    };
    let mut paths = Vec::new();
    for entry in fs::read_dir(folder).map_err(unreadable)? {
        let path = entry.map_err(unreadable)?.path();
        if path
            .extension()
            .is_some_and(|ending| ending.eq_ignore_ascii_case("png"))
        {
            paths.push(path);
        }
    }
    if paths.is_empty() {
        return Err(Failure::input(format!(
            "{}: expected PNGs, such as `rcg patterns` writes, found none",
            folder.display()
        )));
    }
    paths.sort();
    Ok(paths)
}

/// Uploads `patterns`, read from `paths`, and shows each for `each_ms`, or until the next trigger.
fn shown(
    settings: &Dlpc900,
    paths: &[PathBuf],
    patterns: &[BitPattern],
    each_ms: Option<f64>,
    output: &Output,
) -> Done {
    let mut projector = Dlpc900Projector::open(settings, 0.0)?;
    projector.clear()?;
    for (pattern, path) in patterns.iter().zip(paths) {
        projector
            .load(pattern)
            .map_err(|error| Failure::from(error).at(path.display()))?;
    }
    let bytes = send(&mut projector, each_ms, output)?;
    let status = projector.check_runs()?;
    let value = json!({
        "projector": projector.name(), "patterns": patterns.len(), "bytes": bytes, "each_ms": each_ms, "status": status,
    });
    output.print(&value, || {
        let how = each_ms.map_or_else(
            || "each until the next trigger at TRIG_IN_1".to_owned(),
            |ms| format!("each for {ms} ms"),
        );
        format!(
            "{}: {} patterns in {bytes} bytes, {how}\n",
            projector.name(),
            patterns.len()
        )
    })
}

/// Sends what is loaded, and tells how far it is. Returns the bytes of the images.
fn send(projector: &mut Dlpc900Projector, each_ms: Option<f64>, output: &Output) -> Result<usize, Failure> {
    let mut bytes = 0;
    let mut sent = |more| {
        bytes += more;
        output.reach(bytes);
    };
    output.begin("upload", 0, "bytes");
    match each_ms {
        Some(ms) => projector.run_free((ms * 1e3).round() as u32, &mut sent)?,
        None => projector.ready_telling(&mut sent)?,
    }
    output.end();
    Ok(bytes)
}

/// Patterns whose number stands in them, one more than an image holds: stripes that are as wide as their number says.
fn test_patterns((width, height): (usize, usize)) -> Vec<BitPattern> {
    let stripes = |number: usize| {
        let mut pattern = BitPattern::black(width, height);
        let lit = (0..width * height).filter(|pixel| (pixel % width / (number + 1)).is_multiple_of(2));
        pattern.light(&lit.map(|pixel| pixel as u32).collect::<Vec<_>>());
        pattern
    };
    (0..25).map(stripes).collect()
}

fn try_out(settings: &Dlpc900, each_ms: f64, output: &Output) -> Done {
    let mut projector = Dlpc900Projector::open(settings, 0.0)?;
    let patterns = test_patterns(projector.size_px());
    projector.clear()?;
    for pattern in &patterns {
        projector.load(pattern)?;
    }
    let bytes = send(&mut projector, Some(each_ms), output)?;
    projector.check_runs()?;
    // Once through all of them.
    thread::sleep(Duration::from_secs_f64(each_ms * 1e-3 * patterns.len() as f64));
    let status = projector.check_runs()?;
    projector.clear()?;
    let value = json!({
        "projector": projector.name(), "patterns": patterns.len(), "bytes": bytes, "each_ms": each_ms, "status": status,
    });
    output.print(&value, || {
        format!(
            "{}: {} stripes of growing width in {bytes} bytes went up, ran for {each_ms} ms each, and no fault was found; what the mirrors \
             showed only eyes tell\n",
            projector.name(),
            patterns.len()
        )
    })
}

fn frames(settings: &Dlpc900, args: &Video, output: &Output) -> Done {
    let opened = dlpc900::open(settings.device.as_deref(), &[Kind::Dlpc900, Kind::Dlpc350])?;
    let (name, planes) = (opened.name, args.planes as usize);
    let mut commands = Commands::new(opened.reports);
    let started = match opened.kind {
        Kind::Dlpc900 => video::start(&mut Unit::new(commands), planes, args.frame_hz),
        Kind::Dlpc350 => video::start_dlpc350(&mut commands, planes, args.frame_hz),
    };
    let started = started.map_err(|error| Failure::from(error).at(format!("projector {name}")))?;
    let value = json!({
        "projector": name, "planes": started.planes, "exposure_us": started.exposure_us, "frame_us": started.frame_us,
    });
    output.print(&value, || {
        format!(
            "{name}: {} planes of each frame of {} µs, {} µs each\n",
            started.planes, started.frame_us, started.exposure_us
        )
    })
}
