//! The blocks of words on their way to the pulse engine, as a chain of DMA channels.
//!
//! # Design
//! Two channels take turns: while one moves its block, the other's is filled and then *linked*, that is, named
//! as what the running channel triggers when it is through. No CPU is needed at the border of two blocks.
//! Until a block is linked, the one before it triggers the *rest* channel, which moves a single word: outputs
//! at rest. So a chain that is not continued in time ends by itself, between two steps and at rest, and never
//! plays a stale word. Linking is one store to a register; the running channel either has seen it or has
//! triggered the rest channel, and [`Chain::is_dry`] tells which.
//!
//! Words that do not change, those of a [burst](rcg_firmware::burst), need no block and are moved from where
//! they lie.
//!
//! # Tradeoffs
//! A block holds whole steps, so a stream of steps shorter than the time it takes to fetch them ends with a
//! fault, and not with a gap.

use core::sync::atomic::{Ordering, fence};

use embassy_rp::pac::DMA;
use embassy_rp::pac::dma::regs::CtrlTrig;
use embassy_rp::pac::dma::vals::{DataSize, TreqSel};
use rcg_firmware::block::Block;
use rcg_firmware::pulse::WordFormat;
use rcg_protocol::{Pace, Polarity, Ticks};

use super::{DMA_PULSE, DMA_REST};

/// Interrupt bits of the three channels.
const ALL: u32 = 1 << DMA_PULSE[0] | 1 << DMA_PULSE[1] | 1 << DMA_REST;

/// What a channel was told to move.
#[derive(Clone, Copy, Default)]
struct Part {
    start: u32,
    words: u32,
    steps: u64,
}

/// Two blocks in turns, and the word of rest.
///
/// The DMA reads the blocks where they lie, so a chain must not move while it is in use: it lives in a static.
pub(crate) struct Chain {
    parts: [Part; 2],
    rest: u32,
    format: WordFormat,
    /// Where the words go: a TX FIFO.
    fifo: u32,
    /// The block that the DMA is at, or will begin with.
    oldest: usize,
    /// Blocks that were given to the DMA and are not through.
    queued: usize,
    /// Words of the parts that are through, which wrap, and their steps.
    through: u32,
    steps_through: u64,
    /// Length of the block that was queued last.
    last_ticks: Ticks,
    cut: bool,
    dry: bool,
    blocks: [Block; 2],
}

impl Chain {
    /// A chain that feeds the TX FIFO at the address `fifo` of the pulse engine.
    pub(crate) const fn new(fifo: u32) -> Self {
        Self {
            blocks: [Block::new(), Block::new()],
            parts: [Part {
                start: 0,
                words: 0,
                steps: 0,
            }; 2],
            rest: 0,
            format: WordFormat::new(
                Pace::FreeRunning,
                Polarity {
                    proj_active_low: false,
                    cam_active_low: false,
                    sync_active_low: false,
                    strobe_active_low: false,
                },
            ),
            fifo,
            oldest: 0,
            queued: 0,
            through: 0,
            steps_through: 0,
            last_ticks: Ticks::ZERO,
            cut: false,
            dry: false,
        }
    }

    /// Forgets all blocks; the next will have words of this format.
    pub(crate) fn prepare(&mut self, format: WordFormat) {
        self.stop();
        for block in &mut self.blocks {
            block.clear();
        }
        self.format = format;
        self.rest = format.rest();
        self.oldest = 0;
        self.queued = 0;
        self.through = 0;
        self.steps_through = 0;
        self.last_ticks = Ticks(u64::MAX / 2);
        self.cut = false;
        self.dry = false;
        set_up(DMA_REST, core::slice::from_ref(&self.rest), self.fifo, DMA_REST);
        DMA.inte(0).write_value(ALL);
    }

    /// Whether another part can be queued.
    pub(crate) const fn has_room(&self) -> bool {
        !(self.cut || self.dry || self.queued == self.blocks.len())
    }

    /// The block to fill, if there is one.
    pub(crate) fn filling(&mut self) -> Option<&mut Block> {
        self.has_room()
            .then(|| &mut self.blocks[(self.oldest + self.queued) % 2])
    }

    /// How long a block should be at least: not longer than twice the one before it, so that it is filled in
    /// time.
    pub(crate) fn enough(&self, desired: Ticks) -> Ticks {
        desired.min(Ticks(2 * self.last_ticks.0))
    }

    /// Gives the block that was filled to the DMA. Returns by how many words its last step grew.
    pub(crate) fn queue(&mut self) -> usize {
        let index = (self.oldest + self.queued) % 2;
        let block = &mut self.blocks[index];
        let grown = block.close(self.format);
        self.last_ticks = block.ticks();
        let (words, steps) = (core::ptr::from_ref(block.words()), block.steps() as u64);
        self.append(words, steps);
        grown
    }

    /// Gives words that lie elsewhere to the DMA, `steps` whole steps. They must stay there, unchanged, until the
    /// chain is stopped or dry.
    pub(crate) fn append(&mut self, words: *const [u32], steps: u64) {
        let index = (self.oldest + self.queued) % 2;
        self.parts[index] = Part {
            start: words.cast::<u32>() as u32,
            words: words.len() as u32,
            steps,
        };
        set_up(DMA_PULSE[index], words, self.fifo, DMA_REST);
        if self.queued > 0 {
            link(DMA_PULSE[self.oldest], DMA_PULSE[index]);
        }
        self.queued += 1;
    }

    /// Begins to move words.
    pub(crate) fn start(&mut self) {
        let first = if self.queued > 0 {
            DMA_PULSE[self.oldest]
        } else {
            DMA_REST
        };
        DMA.multi_chan_trigger()
            .write(|w| w.set_multi_chan_trigger(1 << first));
    }

    /// Sees which blocks are through and acknowledges their interrupts. Returns whether there were any: nobody else
    /// will be told then that there is room.
    pub(crate) fn retire(&mut self) -> bool {
        let before = self.queued;
        let done = DMA.intr(0).read() & ALL;
        // In the order in which they were queued; both may be through.
        while self.queued > 0 && done & 1 << DMA_PULSE[self.oldest] != 0 {
            let part = self.parts[self.oldest];
            self.through = self.through.wrapping_add(part.words);
            self.steps_through += part.steps;
            self.blocks[self.oldest].clear();
            self.oldest = (self.oldest + 1) % 2;
            self.queued -= 1;
        }
        self.dry |= done & 1 << DMA_REST != 0;
        DMA.intr(0).write_value(done);
        self.queued < before
    }

    /// Lets the chain end with the block that the DMA is at, and takes no further one.
    pub(crate) fn cut(&mut self) {
        self.retire();
        if self.queued > 0 {
            link(DMA_PULSE[self.oldest], DMA_REST);
        }
        self.cut = true;
    }

    /// Whether the chain was [`cut`](Self::cut).
    pub(crate) const fn is_cut(&self) -> bool {
        self.cut
    }

    /// Whether all was moved, the word of rest too.
    pub(crate) const fn is_dry(&self) -> bool {
        self.dry
    }

    /// Words of steps that were moved to the FIFO since the start; wraps.
    pub(crate) fn moved(&self) -> u32 {
        let mut words = self.through;
        for turn in 0..self.queued {
            let index = (self.oldest + turn) % 2;
            // A channel that has not begun still points at the start.
            let at = DMA.ch(DMA_PULSE[index]).read_addr().read();
            let bytes = at.wrapping_sub(self.parts[index].start);
            words = words.wrapping_add(bytes / 4);
        }
        words
    }

    /// Steps of the parts that were moved whole.
    pub(crate) const fn steps_through(&self) -> u64 {
        self.steps_through
    }

    /// Stops at once and takes no further block; what is in the FIFO stays there.
    pub(crate) fn stop(&mut self) {
        self.cut = true;
        abort([DMA_PULSE[0], DMA_PULSE[1], DMA_REST]);
        // An aborted channel may say that it is through (erratum RP2040-E13).
        DMA.intr(0).write_value(ALL);
    }
}

/// Disables `channels` and waits until their last transfers have ended.
pub(crate) fn abort<const N: usize>(channels: [usize; N]) {
    // All are disabled first, or one that is aborted could start the next in the chain (erratum RP2350-E5).
    for channel in channels {
        DMA.ch(channel).al1_ctrl().write_value(0);
    }
    for channel in channels {
        DMA.chan_abort().write(|w| w.set_chan_abort(1 << channel));
        while DMA.ch(channel).ctrl_trig().read().busy() {}
    }
}

/// How many words `channel` moves when it is triggered.
pub(crate) fn set_count(channel: usize, words: u32) {
    #[cfg(not(rp2350))]
    DMA.ch(channel).trans_count().write_value(words);
    #[cfg(rp2350)]
    DMA.ch(channel).trans_count().write(|w| w.set_count(words));
}

/// Makes `channel` ready to move `words` to `fifo` and then to trigger `next`.
fn set_up(channel: usize, words: *const [u32], fifo: u32, next: usize) {
    // The words are in memory before the DMA is told of them.
    fence(Ordering::SeqCst);
    let ch = DMA.ch(channel);
    ch.read_addr().write_value(words.cast::<u32>() as u32);
    ch.write_addr().write_value(fifo);
    set_count(channel, words.len() as u32);
    link(channel, next);
}

/// Makes `channel` trigger `next` when it is through; `channel` itself stands for none.
fn link(channel: usize, next: usize) {
    let mut control = CtrlTrig(0);
    control.set_en(true);
    // Before the channels that store edges, which have a FIFO to wait in.
    control.set_high_priority(true);
    control.set_data_size(DataSize::SIZE_WORD);
    control.set_incr_read(true);
    control.set_treq_sel(TreqSel::PIO0_TX0);
    control.set_chain_to(next as u8);
    // The alias that triggers nothing.
    DMA.ch(channel).al1_ctrl().write_value(control.0);
}
