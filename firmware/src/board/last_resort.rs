//! What happens when the firmware itself fails: outputs low, one line of log, reset.
//!
//! # Design
//! A panic, a hard fault and the watchdog end alike, in a reset of the whole chip, after which the box is
//! idle with its outputs low and the host learns from its silence, or from a new session, that the run is
//! lost. Nothing is tried to be saved. The log itself panics when it fails in the middle of a line, so a second
//! failure is not logged.

use core::panic::PanicInfo;
use core::sync::atomic::{AtomicBool, Ordering};

use cortex_m_rt::{ExceptionFrame, exception};
use defmt::Display2Format;
use embassy_rp::peripherals::WATCHDOG;
use embassy_rp::watchdog::Watchdog;

use super::force_outputs_low;

/// Whether something has failed already.
static FAILED: AtomicBool = AtomicBool::new(false);

#[panic_handler]
fn panic(info: &PanicInfo) -> ! {
    fail(|| defmt::error!("{}", Display2Format(info)))
}

// SAFETY: it does not return, takes no lock that could be held but that of the log, and touches no memory
// of the code that failed.
#[exception]
unsafe fn HardFault(frame: &ExceptionFrame) -> ! {
    fail(|| defmt::error!("hard fault at {:#010x}", frame.pc()))
}

fn fail(log: impl FnOnce()) -> ! {
    force_outputs_low();
    if !FAILED.load(Ordering::Relaxed) {
        FAILED.store(true, Ordering::Relaxed);
        log();
    }
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
