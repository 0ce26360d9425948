//! Which box this is, and why it was reset last.
//!
//! # Design
//! A number that the chip or its flash was made with tells two boxes apart. Why the firmware itself wanted a reset is left
//! in a register that outlives one.

use embassy_rp::Peri;
#[cfg(not(rp2350))]
use embassy_rp::flash::{Blocking, Flash};
use embassy_rp::peripherals::FLASH;
use embassy_rp::watchdog::{ResetReason, Watchdog};
use rcg_protocol::{Chip, Reset, Unit};

/// The watchdog's register with the reason; the boot ROM uses those from 4 on.
const REASON: usize = 0;

/// The reasons, as they stand there.
const REASONS: [(Reset, u32); 3] = [
    (Reset::Panic, 0x5243_4701),
    (Reset::HardFault, 0x5243_4702),
    (Reset::UsbStuck, 0x5243_4703),
];

/// Leaves word of why the chip will be reset.
pub(crate) fn leave_reason(watchdog: &mut Watchdog, reset: Reset) {
    if let Some((_, code)) = REASONS.into_iter().find(|(reason, _)| *reason == reset) {
        watchdog.set_scratch(REASON, code);
    }
}

/// Why the chip was reset. Forgets it.
pub(super) fn reset_reason(watchdog: &mut Watchdog) -> Reset {
    let left = watchdog.get_scratch(REASON);
    watchdog.set_scratch(REASON, 0);
    match watchdog.reset_reason() {
        None => Reset::PowerOn,
        Some(ResetReason::TimedOut) => Reset::Hang,
        Some(ResetReason::Forced) => {
            let reason = REASONS.into_iter().find(|(_, code)| *code == left);
            reason.map_or(Reset::PowerOn, |(reason, _)| reason)
        }
    }
}

/// What an update looks for in an image, to know which it is.
static ABOUT: &str = concat!(
    "RCG trigger box, firmware ",
    env!("CARGO_PKG_VERSION"),
    " ",
    env!("RCG_COMMIT"),
    " ",
    env!("RCG_MODIFIED"),
    ";"
);

/// Which box this is, and why it was `reset`. The watchdog must run.
pub(super) fn unit(watchdog: &mut Watchdog, flash: Peri<'static, FLASH>, reset: Reset) -> Unit {
    // Nothing else refers to it, and what nothing refers to is not linked.
    core::hint::black_box(ABOUT);
    Unit {
        serial: serial(watchdog, flash),
        commit: u32::from_str_radix(env!("RCG_COMMIT"), 16).unwrap_or(0),
        modified: !env!("RCG_MODIFIED").is_empty(),
        chip: if cfg!(rp2350) { Chip::Rp2350 } else { Chip::Rp2040 },
        reset,
    }
}

/// The number of the chip.
#[cfg(rp2350)]
fn serial(_: &mut Watchdog, _: Peri<'static, FLASH>) -> u64 {
    embassy_rp::otp::get_chipid().unwrap_or(0)
}

/// The watchdog's register that says whether the flash is being asked.
#[cfg(not(rp2350))]
const ASKING: usize = 1;

/// What stands there then.
#[cfg(not(rp2350))]
const MARK: u32 = 0x5243_4704;

/// The number of the flash, as the chip has none. The boot ROM lets go of the flash for the question and takes it back, which
/// is the one thing that it is called for; should that hang the watchdog bites, and the flash is not asked again.
#[cfg(not(rp2350))]
fn serial(watchdog: &mut Watchdog, flash: Peri<'static, FLASH>) -> u64 {
    /// Size of a Pico's flash, which the driver wants to know.
    const FLASH_BYTES: usize = 2 * 1024 * 1024;
    if watchdog.get_scratch(ASKING) == MARK {
        return 0;
    }
    watchdog.set_scratch(ASKING, MARK);
    let mut number = [0; 8];
    let asked = Flash::<_, Blocking, FLASH_BYTES>::new_blocking(flash).blocking_unique_id(&mut number);
    watchdog.set_scratch(ASKING, 0);
    asked.map_or(0, |()| u64::from_be_bytes(number))
}
