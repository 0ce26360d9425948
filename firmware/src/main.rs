//! The firmware of the RCG trigger box: embassy on the RP2040 or RP2350.
//!
//! # Design
//! One executor, and one interrupt of its own:
//! - the main loop polls the session every millisecond, shows the state and feeds the watchdog;
//! - the links' tasks move bytes and pass on the requests that they find in them;
//! - the DMA's interrupt refills the pulse engine, whatever the main loop does.
//!
//! What the box does, and when, is decided in the library; what it does it with is named in [`board`].

#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(target_os = "none")]
mod board;
#[cfg(target_os = "none")]
mod controller;
#[cfg(target_os = "none")]
mod lamp;
#[cfg(target_os = "none")]
mod links;
#[cfg(target_os = "none")]
mod uart;
#[cfg(target_os = "none")]
mod usb;

/// Boots, then serves for ever.
#[cfg(target_os = "none")]
#[embassy_executor::main]
async fn main(spawner: embassy_executor::Spawner) {
    use defmt_rtt as _; // the log goes over RTT
    use embassy_time::{Instant, Ticker};

    let board::Board {
        clock,
        uart,
        usb,
        pulse,
        mut led,
        mut watchdog,
        powered_up,
        seed,
        unit,
        kept,
    } = board::Board::take();
    controller::install(clock, seed, unit, kept, pulse);
    controller::recall(clock, powered_up);
    uart::spawn(spawner, uart);
    usb::spawn(spawner, usb, unit.serial);

    let mut shown = rcg_protocol::State::Idle;
    let mut tick = Ticker::every(board::POLL);
    loop {
        tick.next().await;
        controller::poll();

        let (state, fault) = controller::state();
        if state != shown {
            if let Some(fault) = fault {
                defmt::warn!("{} → {}: {}", shown, state, fault);
            } else {
                defmt::info!("{} → {}", shown, state);
            }
            shown = state;
        }
        let live = matches!(state, rcg_protocol::State::Armed | rcg_protocol::State::Running);
        if usb::is_stuck(clock) && !live {
            board::reset(rcg_protocol::Reset::UsbStuck);
        }
        if controller::leaves() || usb::was_touched() && !live {
            board::boot_loader();
        }
        led.set_level(lamp::level(state, Instant::now().as_millis()));
        watchdog.feed(board::WATCHDOG);
    }
}

#[cfg(not(target_os = "none"))]
fn main() {
    println!("This is the firmware of the RCG trigger box; it runs on a Pico: build it with `cargo fw`.");
}
