//! When the pulse engine began steps on SYNC edges, as it says itself.
//!
//! # Design
//! The paced program pushes a word for each ([`programs`](super::programs)). One DMA channel takes the word away and
//! starts another, which puts the microsecond that it is into a ring. So the machine never waits for room, and no
//! interrupt has to be in time.

use core::cell::UnsafeCell;

use embassy_rp::pac::DMA;
#[cfg(not(rp2350))]
use embassy_rp::pac::TIMER;
#[cfg(rp2350)]
use embassy_rp::pac::TIMER0 as TIMER;
use embassy_rp::pac::dma::regs::CtrlTrig;
use embassy_rp::pac::dma::vals::{DataSize, TreqSel};

use super::chain::{abort, set_count};
use super::{DMA_BEGUN, DMA_BEGUN_AT};

/// Times that the ring holds: far more than steps can be on their way.
const RING_WORDS: usize = 16;

/// Binary logarithm of the ring's size in bytes.
const RING_BITS: u8 = (RING_WORDS * 4).ilog2() as u8;

/// Aligned to its size, as the DMA wraps by masking address bits.
#[repr(C, align(64))]
struct Ring(UnsafeCell<[u32; RING_WORDS]>);

const _: () = assert!(RING_WORDS * 4 == 64);

/// Times at which steps began.
///
/// The DMA writes where it lies, so it must not move while a run lasts: it lives in a static.
pub(crate) struct Begun {
    ring: Ring,
    /// RX FIFO of the pulse engine.
    fifo: u32,
    /// Where its words go. They say nothing but that they came.
    word: UnsafeCell<u32>,
}

impl Begun {
    /// Follows the words in the RX FIFO at the address `fifo`.
    pub(crate) const fn new(fifo: u32) -> Self {
        Self {
            ring: Ring(UnsafeCell::new([0; RING_WORDS])),
            fifo,
            word: UnsafeCell::new(0),
        }
    }

    /// Begins to follow.
    pub(crate) fn prepare(&mut self) {
        Self::stop();
        let at = DMA.ch(DMA_BEGUN_AT);
        at.read_addr().write_value(TIMER.timerawl().as_ptr() as u32);
        at.write_addr().write_value(self.ring.0.get() as u32);
        set_count(DMA_BEGUN_AT, 1);
        let mut control = CtrlTrig(0);
        control.set_en(true);
        control.set_data_size(DataSize::SIZE_WORD);
        control.set_incr_write(true);
        control.set_ring_sel(true);
        control.set_ring_size(RING_BITS);
        control.set_treq_sel(TreqSel::PERMANENT);
        control.set_chain_to(DMA_BEGUN as u8);
        at.al1_ctrl().write_value(control.0); // triggers nothing

        let taken = DMA.ch(DMA_BEGUN);
        taken.read_addr().write_value(self.fifo);
        taken.write_addr().write_value(self.word.get() as u32);
        set_count(DMA_BEGUN, 1);
        let mut control = CtrlTrig(0);
        control.set_en(true);
        control.set_data_size(DataSize::SIZE_WORD);
        control.set_treq_sel(TreqSel::PIO0_RX0);
        control.set_chain_to(DMA_BEGUN_AT as u8);
        taken.ctrl_trig().write_value(control);
    }

    /// The microsecond in which step `step` of the run began, in 32 bits, if it has. Steps before it began long ago, and no
    /// more than a few after it can have.
    pub(crate) fn micros_of(&self, step: u32) -> Option<u32> {
        let written = DMA.ch(DMA_BEGUN_AT).write_addr().read() - self.ring.0.get() as u32;
        let index = step as usize % RING_WORDS;
        if written as usize / 4 % RING_WORDS == index {
            return None;
        }
        let word = self.ring.0.get().cast::<u32>().wrapping_add(index);
        // SAFETY: the index is within the ring, and the DMA has written this word and has not come round to it
        // again. Volatile, as the compiler knows of no DMA.
        Some(unsafe { word.read_volatile() })
    }

    /// Stops. What has come stays.
    pub(crate) fn stop() {
        abort([DMA_BEGUN, DMA_BEGUN_AT]);
    }
}
