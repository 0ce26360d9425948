//! The vector table in RAM: an interrupt does not wait for flash either.

use core::cell::UnsafeCell;

/// Vectors of the core and of all interrupts of either chip.
#[cfg(not(rp2350))]
const VECTORS: usize = 16 + 32;
#[cfg(rp2350)]
const VECTORS: usize = 16 + 53;

/// Aligned to its size, rounded up to a power of two, as the core wants it.
#[cfg_attr(not(rp2350), repr(C, align(256)))]
#[cfg_attr(rp2350, repr(C, align(512)))]
struct Table(UnsafeCell<[u32; VECTORS]>);

// SAFETY: it is written once, before interrupts are looked up in it.
unsafe impl Sync for Table {}

static TABLE: Table = Table(UnsafeCell::new([0; VECTORS]));

/// Lets the core look up its vectors in RAM.
pub(super) fn move_to_ram() {
    unsafe extern "C" {
        #[link_name = "__vector_table"]
        static FLASH: [u32; VECTORS];
    }
    // SAFETY: the linker puts the vectors there, nobody else writes the table, and the core is told of it when it is
    // complete.
    unsafe {
        TABLE.0.get().write(FLASH);
        (*cortex_m::peripheral::SCB::PTR).vtor.write(TABLE.0.get() as u32);
    }
    cortex_m::asm::dsb();
}
