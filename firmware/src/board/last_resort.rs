//! What happens when the firmware itself fails: outputs at rest, one line of log, reset.
//!
//! # Design
//! A panic, a hard fault and the watchdog end alike, in a reset of the whole chip, after which the box is
//! idle with its outputs at rest and the host learns from its silence, or from a new session, that the run is
//! lost. Nothing is tried to be saved. The log itself panics when it fails in the middle of a line, so a second
//! failure is not logged.

use core::panic::PanicInfo;
use core::sync::atomic::{AtomicBool, Ordering};

use cortex_m_rt::{ExceptionFrame, exception};
use defmt::Display2Format;
use embassy_rp::peripherals::WATCHDOG;
use embassy_rp::rom_data;
use embassy_rp::watchdog::Watchdog;
use rcg_protocol::Reset;

use super::force_outputs_to_rest;
use super::identity::leave_reason;

/// Whether something has failed already.
static FAILED: AtomicBool = AtomicBool::new(false);

#[panic_handler]
fn panic(info: &PanicInfo) -> ! {
    fail(Reset::Panic, || defmt::error!("{}", Display2Format(info)))
}

// SAFETY: it does not return, takes no lock that could be held but that of the log, and touches no memory
// of the code that failed.
#[exception]
unsafe fn HardFault(frame: &ExceptionFrame) -> ! {
    fail(Reset::HardFault, || {
        defmt::error!("hard fault at {:#010x}", frame.pc());
    })
}

fn fail(reason: Reset, log: impl FnOnce()) -> ! {
    force_outputs_to_rest();
    if !FAILED.load(Ordering::Relaxed) {
        FAILED.store(true, Ordering::Relaxed);
        log();
    }
    reset(reason)
}

/// Drives the outputs to rest and leaves for the boot loader in the chip's ROM, which shows a drive on USB that takes a UF2 file. There
/// the outputs float, as after any reset.
pub(crate) fn boot_loader() -> ! {
    force_outputs_to_rest();
    cortex_m::interrupt::disable();
    rom_data::reset_to_usb_boot(0, 0);
    loop {
        core::hint::spin_loop();
    }
}

/// Drives the outputs to rest and resets the chip and all its peripherals, for this reason.
pub(crate) fn reset(reason: Reset) -> ! {
    force_outputs_to_rest();
    // SAFETY: nothing else runs any more that could use the watchdog.
    let watchdog = unsafe { WATCHDOG::steal() };
    let mut watchdog = Watchdog::new(watchdog);
    leave_reason(&mut watchdog, reason);
    watchdog.trigger_reset();
    loop {
        core::hint::spin_loop();
    }
}
