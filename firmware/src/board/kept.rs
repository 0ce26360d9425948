//! What is kept over resets, at the end of the flash: the polarity in the last sector, and a schedule before it.
//!
//! # Design
//! What is kept are two words, each with a mark, the polarity of some lines, and the same bits inverted behind. Anything else there, such
//! as the ones of a flash that was never written, stands for lines that rest low. What is kept of a schedule, and what is none, says
//! [`rcg_firmware::stored`]. All of it lies beyond every image, and a boot loader that takes another one leaves it alone.

use core::sync::atomic::{AtomicU32, Ordering};

use embassy_rp::flash::{Blocking, ERASE_SIZE, FLASH_BASE, Flash, PAGE_SIZE};
use embassy_rp::peripherals::{FLASH, WATCHDOG};
use embassy_rp::watchdog::Watchdog;
use rcg_firmware::kept::{self, Kept, words};
use rcg_firmware::stored;
use rcg_protocol::{FIRST_PAGE, PAGE_BYTES, PAGES, Stored};

use super::{AUX_A, AUX_B, CAM, PROJ, WATCHDOG as BITES_AFTER};

/// Size of a Pico's flash. A Pico 2 has twice as much, of which the same sector is taken.
const FLASH_BYTES: usize = 2 * 1024 * 1024;

/// Where the last sector begins.
const SECTOR: usize = FLASH_BYTES - ERASE_SIZE;

/// Where schedules are kept, and how many bytes.
const SCHEDULE: usize = SECTOR - SCHEDULE_BYTES;
const SCHEDULE_BYTES: usize = PAGES as usize * PAGE_BYTES;

const _: () = assert!(SCHEDULE.is_multiple_of(ERASE_SIZE) && PAGE_BYTES == PAGE_SIZE);
const _: () = assert!(FIRST_PAGE as usize * PAGE_SIZE == ERASE_SIZE);

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
    let mut page = [u8::MAX; PAGE_SIZE];
    for (bytes, word) in page.as_chunks_mut().0.iter_mut().zip(words(kept)) {
        *bytes = word.to_le_bytes();
    }
    if program(SECTOR, &page).is_err() || read() != kept {
        defmt::error!("the polarity was not kept");
    }
}

/// Writes a page of what is kept of a schedule; zeros follow `bytes`. That of no bytes is only erased, with its sector.
#[unsafe(link_section = ".boot_text")]
#[inline(never)]
pub(super) fn store(page: u16, bytes: &[u8]) {
    let mut padded = [0; PAGE_SIZE];
    padded
        .iter_mut()
        .zip(bytes)
        .for_each(|(place, byte)| *place = *byte);
    let written = if bytes.is_empty() { &[] } else { &padded[..] };
    if program(SCHEDULE + usize::from(page) * PAGE_SIZE, written).is_err() {
        defmt::error!("page {} was not kept", page);
    }
}

/// The schedule that is kept for a clock of `clock_hz`, and its requests.
#[unsafe(link_section = ".boot_text")]
#[inline(never)]
pub(crate) fn schedule(clock_hz: u32) -> Option<(Stored, &'static [u8])> {
    let at = FLASH_BASE.cast::<u8>().wrapping_add(SCHEDULE);
    // SAFETY: these bytes are in flash, and nobody writes them while a schedule is looked at.
    let memory = unsafe { core::slice::from_raw_parts(at, SCHEDULE_BYTES) };
    stored::read(memory, clock_hz)
}

/// Writes `bytes`, a page at most, to `at` in flash, after the sector was erased if it begins there.
#[unsafe(link_section = ".boot_text")]
#[inline(never)]
fn program(at: usize, bytes: &[u8]) -> Result<(), embassy_rp::flash::Error> {
    // SAFETY: the flash was given back when the box was asked for its number, and nothing runs from it; the watchdog is only fed.
    let (flash, watchdog) = unsafe { (FLASH::steal(), WATCHDOG::steal()) };
    let mut watchdog = Watchdog::new(watchdog);
    let mut flash = Flash::<_, Blocking, FLASH_BYTES>::new_blocking(flash);
    watchdog.feed(BITES_AFTER);
    let mut done = Ok(());
    if at.is_multiple_of(ERASE_SIZE) {
        done = flash.blocking_erase(at as u32, (at + ERASE_SIZE) as u32);
        watchdog.feed(BITES_AFTER);
    }
    if !bytes.is_empty() {
        done = done.and_then(|()| flash.blocking_write(at as u32, bytes));
        watchdog.feed(BITES_AFTER);
    }
    done
}
