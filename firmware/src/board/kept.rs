//! The polarity that is kept over resets, in the last sector of the flash.
//!
//! # Design
//! What is kept are two words, each with a mark, the polarity of some lines, and the same bits inverted behind. Anything else there, such
//! as the ones of a flash that was never written, stands for lines that rest low. The sector lies beyond every image, and a boot loader that
//! takes another one leaves it alone.

use core::sync::atomic::{AtomicU32, Ordering};

use embassy_rp::flash::{Blocking, ERASE_SIZE, FLASH_BASE, Flash, PAGE_SIZE};
use embassy_rp::peripherals::{FLASH, WATCHDOG};
use embassy_rp::watchdog::Watchdog;
use rcg_firmware::kept::{self, Kept, words};

use super::{AUX_A, AUX_B, CAM, PROJ, WATCHDOG as BITES_AFTER};

/// Size of a Pico's flash. A Pico 2 has twice as much, of which the same sector is taken.
const FLASH_BYTES: usize = 2 * 1024 * 1024;

/// Where the last sector begins.
const SECTOR: usize = FLASH_BYTES - ERASE_SIZE;

/// The outputs that rest high, as bits of the pins.
static HIGH: AtomicU32 = AtomicU32::new(0);

/// The outputs that rest high, as bits of the pins.
pub(super) fn resting_high() -> u32 {
    HIGH.load(Ordering::Relaxed)
}

/// The outputs rest like that from now on.
pub(super) fn rest_like(kept: Kept) {
    let Kept { lines, aux } = kept;
    let high = u32::from(lines.proj_active_low) << PROJ
        | u32::from(lines.cam_active_low) << CAM
        | u32::from(aux.a_active_low) << AUX_A
        | u32::from(aux.b_active_low) << AUX_B;
    HIGH.store(high, Ordering::Relaxed);
}

/// What is kept.
pub(super) fn read() -> Kept {
    let at = FLASH_BASE.wrapping_add(SECTOR / 4).cast::<[u32; 4]>();
    // SAFETY: these words are in flash, which is read as memory; volatile, as writing it is no business of the compiler.
    kept::kept(unsafe { at.read_volatile() })
}

/// Keeps `kept`. Takes some tenths of a second, in which nothing else is done: this need not be in RAM but for what sends commands to
/// the flash, which `embassy_rp` has there.
#[unsafe(link_section = ".boot_text")]
#[inline(never)]
pub(super) fn write(kept: Kept) {
    rest_like(kept);
    // SAFETY: the flash was given back when the box was asked for its number, and nothing runs from it; the watchdog is only fed.
    let (flash, watchdog) = unsafe { (FLASH::steal(), WATCHDOG::steal()) };
    let mut watchdog = Watchdog::new(watchdog);
    let mut flash = Flash::<_, Blocking, FLASH_BYTES>::new_blocking(flash);
    let mut page = [u8::MAX; PAGE_SIZE];
    for (bytes, word) in page.as_chunks_mut().0.iter_mut().zip(words(kept)) {
        *bytes = word.to_le_bytes();
    }
    watchdog.feed(BITES_AFTER);
    let erased = flash.blocking_erase(SECTOR as u32, (SECTOR + ERASE_SIZE) as u32);
    watchdog.feed(BITES_AFTER);
    let written = erased.and_then(|()| flash.blocking_write(SECTOR as u32, &page));
    watchdog.feed(BITES_AFTER);
    if written.is_err() || read() != kept {
        defmt::error!("the polarity was not kept");
    }
}
