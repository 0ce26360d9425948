//! What happens when the firmware itself fails: outputs low, one line of log, reset.
//!
//! # Design
//! A panic, a hard fault and the watchdog end alike, in a reset of the whole chip, after which the box is
//! idle with its outputs low and the host learns from its silence, or from a new session, that the run is
//! lost. Nothing is tried to be saved.

use core::panic::PanicInfo;

use cortex_m_rt::{ExceptionFrame, exception};
use defmt::Display2Format;
use embassy_rp::peripherals::WATCHDOG;
use embassy_rp::watchdog::Watchdog;

use super::force_outputs_low;

#[panic_handler]
fn panic(info: &PanicInfo) -> ! {
    force_outputs_low();
    defmt::error!("{}", Display2Format(info));
    reset()
}

// SAFETY: it does not return, takes no lock that could be held but that of the log, and touches no memory
// of the code that failed.
#[exception]
unsafe fn HardFault(frame: &ExceptionFrame) -> ! {
    force_outputs_low();
    defmt::error!("hard fault at {:#010x}", frame.pc());
    reset()
}

/// Resets the chip and all its peripherals.
fn reset() -> ! {
    // SAFETY: nothing else runs any more that could use the watchdog.
    let watchdog = unsafe { WATCHDOG::steal() };
    Watchdog::new(watchdog).trigger_reset();
    loop {
        core::hint::spin_loop();
    }
}
