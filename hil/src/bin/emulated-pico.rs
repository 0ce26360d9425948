//! A trigger box without a board: the real firmware in the emulator, at a serial port that the host's command opens.

use std::thread;
use std::time::Duration;

use anyhow::Context as _;
use clap::Parser;
use rcg_hil::bridge::Bridge;
use rcg_hil::dut::PicoArgs;

/// Run the trigger box's firmware in an emulated Pico, at a serial port of its own.
///
/// Prints the path of the port, for `rcg controller info --port PATH`, and the address of its wires, for
/// `rcg measure --port PATH --wires ADDRESS`. Ends with Ctrl-C. Emulated time keeps to real time, or is slower.
#[derive(Debug, Parser)]
struct Args {
    #[command(flatten)]
    pico: PicoArgs,
    /// TCP port of this machine at which the wires end; 0 for any that is free
    #[arg(long, value_name = "PORT", default_value_t = 0)]
    wires: u16,
}

fn main() -> anyhow::Result<()> {
    let args = Args::parse();
    let dut = args.pico.pico()?;
    let bridge = Bridge::start(&dut, args.wires).context("the emulated Pico does not start")?;
    println!("port {}", bridge.port());
    println!("wires {}", bridge.wires());
    while bridge.is_running() {
        thread::sleep(Duration::from_millis(100));
    }
    bridge.stop().map(|_| ()).context("the emulated Pico has stopped")
}
