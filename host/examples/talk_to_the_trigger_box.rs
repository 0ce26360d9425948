//! Says hello to a trigger box, fires a short schedule and prints what the box recorded.
//!
//! `cargo run --release --example talk_to_the_trigger_box [PORT]`: PORT is a serial port such as /dev/ttyACM0 or COM3, or
//! `auto` for the only trigger box on USB. Without one the firmware's own logic runs in here, in virtual time.

use std::error::Error;

use rcg::capture::device::{Device, Patience};
use rcg::capture::link::{self, Link};
use rcg::capture::records::flag_names;
use rcg::capture::steps::{Bracket, Limits, Span};
use rcg::instrument::rig::Rig;
use rcg::virtual_rig::VirtualController;
use rcg_protocol::{Event, Extent, Micros, Pace, Program, State, StepRecord, Ticks};

fn main() -> Result<(), Box<dyn Error>> {
    let rig = Rig::load("rcg-1-16bit")?;
    let link: Box<dyn Link> = match std::env::args().nth(1) {
        Some(port) => link::open(&port)?,
        None => Box::new(VirtualController::alone(&rig)),
    };

    // Hello. A request that is not answered is sent again; the box executes it once.
    let mut device = Device::connect(link, link::nonce(), Patience::default())?;
    let info = device.info();
    let (major, minor, patch) = info.firmware;
    println!(
        "{}: firmware {major}.{minor}.{patch}, {} ticks per second, tables of up to {} steps",
        device.link().peer(),
        info.clock_hz,
        info.max_steps
    );
    device.ping(42)?;

    // Three exposure times that take turns; everything else as the rig needs it. Checked against what the box can make.
    let bracket = Bracket {
        exposures: [1e-3, 2e-3, 5e-3].map(Span::Seconds).to_vec(),
        ..Bracket::default()
    };
    let steps = bracket.steps(&rig, Limits::new(&info, Pace::FreeRunning))?;
    let program = Program {
        // Should this program die, the box ends the run by itself.
        dead_man: Micros::DEFAULT_DEAD_MAN,
        ..Program::new(Extent::Table {
            steps: u32::try_from(steps.len())?,
            cycles: 2,
        })
    };

    let us = |ticks: Ticks| 1e6 * ticks.0 as f64 / f64::from(info.clock_hz);
    println!("step     trigger/µs   strobe/µs after it   strobe's width/µs   flags");
    let ending = device.play(&program, &steps, |event| {
        match event {
            Some(Event::Records { records, .. }) => records.iter().for_each(|record| print(record, us)),
            Some(Event::SpuriousStrobe { on, .. }) => {
                println!("a strobe that nothing triggered at {:.3} µs", us(*on));
            }
            // What else there is: that the run has started, and nothing at all for a while.
            _ => {}
        }
        Ok::<(), Box<dyn Error>>(())
    })?;

    if let (State::Fault, Some(fault)) = (ending.state, ending.fault) {
        return Err(fault.to_string().into());
    }
    let whole_us = ending.at.map_or(f64::NAN, us);
    println!(
        "{} after {} steps and {whole_us:.3} µs",
        ending.state, ending.steps_done
    );
    let lost = device.status()?.counters.records_lost;
    println!(
        "{lost} records lost since it was switched on, {} corrupt frames",
        device.corrupt_frames()
    );
    Ok(())
}

/// One line for a step; times count from the start of the run.
fn print(record: &StepRecord, us: impl Fn(Ticks) -> f64) {
    let strobe = match record.strobe {
        Some(strobe) => format!("{:18.3}   {:17.3}", us(strobe.delay), us(strobe.width)),
        None => format!("{:>18}   {:>17}", "none", ""),
    };
    let flags = flag_names(record.flags).join(" ");
    println!(
        "{:4}   {:12.3}   {strobe}   {flags}",
        record.step.0,
        us(record.trigger)
    );
}
