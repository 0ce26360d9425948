//! A laboratory without light: trigger box, camera and projector where the host's command looks for real ones.

use std::path::{Path, PathBuf};
use std::thread;
use std::time::Duration;

use anyhow::Context as _;
use clap::Parser;
use rcg::instrument::rig::Rig;
use rcg::plan::Virtual;
use rcg_hil::dlpc900::Dlpc900;
use rcg_hil::dut::PicoArgs;
use rcg_hil::gige::Settings;
use rcg_hil::table::{Projection, Table, own_address};

/// Lay an optical table whose parts are real but for the light.
///
/// An emulated Pico with the real firmware stands at a serial port, a GigE Vision camera on the network of this machine, and
/// a folder takes the projector's patterns; the images are those of the virtual rig. Writes OUT/rig.toml, for `rcg rig check
/// --rig OUT/rig.toml` and `rcg measure --rig OUT/rig.toml`. Ends with Ctrl-C.
#[derive(Debug, Parser)]
struct Args {
    /// Folder for the rig file and the patterns
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// The instrument: a preset or a rig file
    #[arg(long, value_name = "FILE|PRESET", default_value = "rcg-3")]
    rig: String,
    /// What stands in the holder, as `rcg measure --sample` takes it
    #[arg(long, value_name = "SAMPLE", default_value = "ward:brass")]
    sample: String,
    /// How the instrument really is: a file that `rcg truth` writes
    #[arg(long, value_name = "FILE")]
    truth: Option<String>,
    /// Switch shot and read noise off
    #[arg(long)]
    noise_free: bool,
    /// Seed of all chance
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Pixels a side of the camera's image
    #[arg(long, value_name = "N", default_value_t = 96)]
    image_size: u32,
    /// Let a window lead, on the screen of an X server without a monitor (Xvfb), in place of the folder, so many display frames a second
    #[cfg(feature = "window")]
    #[arg(long, value_name = "HZ", value_parser = clap::value_parser!(u32).range(10..=1000))]
    window_hz: Option<u32>,
    /// What stands for the projector: a folder that takes its patterns, or an emulated DLPC900 with mirrors of the rig's size
    #[arg(long, value_name = "files|dlpc900", default_value = "files", value_parser = ["files", "dlpc900"])]
    projector: String,
    #[command(flatten)]
    pico: PicoArgs,
}

fn main() -> anyhow::Result<()> {
    let args = Args::parse();
    let dut = args.pico.pico()?;
    let rig = Rig::load(&args.rig)?.with_image_size(args.image_size)?;
    let light = Virtual {
        sample: args.sample,
        truth: args.truth,
        noise: !args.noise_free,
        seed: args.seed,
        ..Virtual::default()
    };
    std::fs::create_dir_all(&args.out).with_context(|| format!("out {}", args.out.display()))?;
    let out = args.out.canonicalize()?;
    let camera = Settings {
        address: own_address(),
        ..Settings::default()
    };
    #[cfg(feature = "window")]
    if let Some(hz) = args.window_hz {
        return before_a_screen(&out, rig, hz, |rig, screen| {
            Table::lay_with(rig, &light, &dut, camera, Projection::Screen(screen))
        });
    }
    let unit = (args.projector == "dlpc900")
        .then(|| Dlpc900::like(&rig))
        .transpose()?;
    let patterns = out.join("patterns");
    let projection = match &unit {
        Some(unit) => Projection::Mirrors(unit, &patterns),
        None => Projection::Folder(&patterns),
    };
    let table = Table::lay_with(&rig, &light, &dut, camera, projection)?;
    wait(&out, &rig, table)
}

/// Waits before a table with a screen that shows `hz` display frames a second.
#[cfg(feature = "window")]
fn before_a_screen(
    out: &Path,
    mut rig: Rig,
    hz: u32,
    lay: impl FnOnce(&Rig, rcg_hil::table::Screen) -> Result<Table, rcg_hil::table::TableError>,
) -> anyhow::Result<()> {
    const SIDE_PX: u32 = 48;
    // A picture settles no sooner than it is scanned out.
    rig.projector.settle_s = rig.projector.settle_s.max(1.26 / f64::from(hz));
    let lens = &rig.projector.lens;
    let [right, bottom] = [lens.width_px, lens.height_px].map(|size| size.saturating_sub(SIDE_PX));
    let patch_px = [[0, 0], [right, 0], [0, bottom], [right, bottom]]
        .map(|[x, y]| [x, y, SIDE_PX, SIDE_PX])
        .into_iter()
        .find(|patch| rig.photodiode_beside_mirror(*patch).is_ok())
        .context(
            "expected a corner of the projector's image whose light passes beside the mirror, found none",
        )?;
    let server = rcg_hil::screen::Xvfb::start((lens.width_px, lens.height_px))?;
    let (screen, _) = rcg_hil::screen::Display::before(&server, hz, patch_px)?;
    let table = lay(&rig, screen)?;
    wait(out, &rig, table)
}

/// Writes the rig files and waits until the `table` of `rig` is no longer whole.
fn wait(out: &Path, rig: &Rig, table: Table) -> anyhow::Result<()> {
    write(&out.join("rig.toml"), &table.rig().to_toml())?;
    // The same rig without drivers: what is simulated as a whole.
    write(&out.join("simulated.toml"), &rig.to_toml())?;
    println!("rig {}", out.join("rig.toml").display());
    println!("camera {}", table.address());
    while table.is_running() {
        thread::sleep(Duration::from_millis(100));
    }
    table.clear().map(|_| ()).context("the table is no longer whole")
}

fn write(path: &Path, text: &str) -> anyhow::Result<()> {
    std::fs::write(path, text).with_context(|| path.display().to_string())
}
