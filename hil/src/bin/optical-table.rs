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
use rcg_hil::table::{Table, own_address};

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
    let unit = (args.projector == "dlpc900")
        .then(|| Dlpc900::like(&rig))
        .transpose()?;
    let table = Table::lay_with(&rig, &light, &dut, camera, &out.join("patterns"), unit.as_ref())?;
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
