//! A trigger box without a board: the real firmware in the emulator, at a serial port that the host's command opens.

use std::path::PathBuf;
use std::thread;
use std::time::Duration;

use anyhow::Context as _;
use clap::Parser;
use rcg_hil::bridge::Bridge;
use rcg_hil::dut::{EmulatedPico, LinkKind};
use rcg_hil::places;

/// Run the trigger box's firmware in an emulated Pico, at a serial port of its own.
///
/// Prints the path of the port, for `rcg controller info --port PATH`, and the address of its wires, for
/// `rcg measure --port PATH --wires ADDRESS`. Ends with Ctrl-C. Emulated time keeps to real time, or is slower.
#[derive(Debug, Parser)]
struct Args {
    /// The firmware's ELF file
    #[arg(long, value_name = "FILE", default_value_os_t = places::target().join("thumbv6m-none-eabi/firmware/rcg-firmware"))]
    image: PathBuf,
    /// Which of the firmware's links the port is
    #[arg(long, value_enum, default_value = "usb")]
    link: LinkKind,
    /// TCP port of this machine at which the wires end; 0 for any that is free
    #[arg(long, value_name = "PORT", default_value_t = 0)]
    wires: u16,
}

fn main() -> anyhow::Result<()> {
    let args = Args::parse();
    anyhow::ensure!(
        args.image.is_file(),
        "image {}: expected the firmware's ELF file, found none; `cargo fw` builds it",
        args.image.display()
    );
    anyhow::ensure!(
        places::emulator_modules().is_dir(),
        "emulator: expected its modules in {}, found none; `npm ci` installs them",
        places::emulator_modules().display()
    );
    let dut = EmulatedPico {
        link: args.link,
        image: args.image,
    };
    let bridge = Bridge::start(&dut, args.wires).context("the emulated Pico does not start")?;
    println!("port {}", bridge.port());
    println!("wires {}", bridge.wires());
    while bridge.is_running() {
        thread::sleep(Duration::from_millis(100));
    }
    bridge.stop().map(|_| ()).context("the emulated Pico has stopped")
}
