//! An emulated DLPC900 behind a USB gadget, for the guest of `hil/guest`, or at a port.

use std::fs::OpenOptions;
use std::io::Write as _;
use std::path::PathBuf;
use std::sync::atomic::AtomicBool;
use std::thread;
use std::time::Duration;

use anyhow::Context as _;
use clap::Parser;
use rcg_hil::dlpc900::{Dlpc900, Nature};

/// Answer as a DLPC900, and say what it shows and complains of. Ends with Ctrl-C.
#[derive(Debug, Parser)]
struct Args {
    /// Device file of a HID gadget [default: none, but a port of this machine, for `rcg projector --device tcp:HOST:PORT`]
    #[arg(long, value_name = "FILE")]
    device: Option<PathBuf>,
    /// Code of the mirrors: 1 DLP6500, 2 DLP9000, 3 DLP670S, 4 DLP500YX, 5 DLP5500
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u8).range(1..=5))]
    mirrors: u8,
}

fn main() -> anyhow::Result<()> {
    let args = Args::parse();
    let unit = Dlpc900::new(Nature {
        mirrors: args.mirrors,
        has_source: true,
        ..Nature::default()
    });
    let Some(device) = args.device else {
        let served = unit.serve()?;
        say(&served.device());
        watch(&unit);
        return Ok(());
    };
    let witness = unit.clone();
    thread::spawn(move || watch(&witness));
    let file = OpenOptions::new()
        .read(true)
        .write(true)
        .open(&device)
        .with_context(|| device.display().to_string())?;
    unit.converse(file, &AtomicBool::new(false))
        .with_context(|| device.display().to_string())
}

/// Tells of `unit` what changes, for ever.
fn watch(unit: &Dlpc900) {
    let (mut running, mut complaints) = (None, 0);
    loop {
        let now = unit.running();
        if let Some(patterns) = now.filter(|_| now != running) {
            say(&format!("gadget: {patterns} patterns run"));
        }
        running = now;
        for complaint in unit.complaints().split_off(complaints) {
            say(&format!("gadget: complaint: {complaint}"));
            complaints += 1;
        }
        thread::sleep(Duration::from_millis(10));
    }
}

/// Says a line at once: nobody ends this program gently.
fn say(line: &str) {
    let mut out = std::io::stdout().lock();
    writeln!(out, "{line}").and_then(|()| out.flush()).ok();
}
