//! The PIO programs.
//!
//! # Design
//! The two programs that make pulses are those that [`rcg_firmware::pulse`] describes; its `Reader` is the
//! reference of what they do, tick by tick. Inputs are inverted before they reach the PIO where the polarity
//! says so, hence high is active here. For [wide](rcg_firmware::pulse) words two instructions of each are exchanged. The three programs take 26 of the 32 instructions that there are.

use embassy_rp::pac::PIO0 as PIO;
use embassy_rp::peripherals::PIO0;
use embassy_rp::pio::program::pio_asm;
use embassy_rp::pio::{Common, LoadedProgram};
use rcg_firmware::pulse::WordFormat;

/// A program in the PIO's memory.
pub(crate) struct Loaded {
    pub(crate) program: LoadedProgram<'static, PIO0>,
    /// Where execution begins, by case; see the functions that load.
    pub(crate) entry: [u8; 2],
    /// The first instruction of the wait that a SYNC edge ends.
    waits_at: u8,
    /// The instruction that puts the levels of a word out, and that which takes its count.
    levels_at: [u8; 2],
}

/// `out pins, 0`, and `out x, 0`; 0 stands for 32 bits.
#[allow(clippy::unusual_byte_groupings)] // the fields of the instructions
const OUT: [u32; 2] = [0b011_00000_000_00000, 0b011_00000_001_00000];

/// Instructions of a wait, the one that the edge ends among them.
const WAIT_INSTRUCTIONS: u8 = 3;

impl Loaded {
    /// Whether a machine that is at instruction `address` waits for a SYNC edge.
    pub(crate) const fn is_waiting(&self, address: u8) -> bool {
        address >= self.waits_at && address < self.waits_at + WAIT_INSTRUCTIONS
    }

    /// Lets words have levels of so many `pins`, and a count in what `format` leaves of their bits. No machine may be at this program.
    pub(crate) fn take_format(&self, format: WordFormat) {
        let bits = [format.pins(), u32::BITS - format.shift()];
        for ((at, out), bits) in self.levels_at.into_iter().zip(OUT).zip(bits) {
            PIO.instr_mem(usize::from(at)).write(|w| w.0 = out | bits);
        }
    }
}

/// Words that follow each other. Enters to play at once, or after a SYNC edge.
pub(crate) fn free_running(common: &mut Common<'static, PIO0>) -> Loaded {
    let assembled = pio_asm!(
        "waits:",
        "    wait 0 pin 0 [31]", // An edge, not a level: SYNC has to be seen at rest first. Then it may ring,
        "    jmp pin waits",     // but not longer than SYNC_MASK.
        "    wait 1 pin 0 [1]",  // Ends in the tick of the edge; one tick more makes SYNC_LATENCY, as paced.
        ".wrap_target",
        "public at_once:",
        "    out pins, 2", // Bits 0 and 1 are PROJ and CAM; of six bits the last are AUX-A and AUX-B. The last word was pulled in ahead: one tick.
        "    out x, 30",   // The rest is a count. This empties the register, and the next word is pulled in.
        "lasts:",
        "    jmp x-- lasts", // Once when the count is 0: the word lasts count + 3 ticks.
        ".wrap",             // Costs nothing.
    );
    let program = common.load_program(&assembled.program);
    let origin = program.origin;
    Loaded {
        entry: [origin + assembled.public_defines.at_once as u8, origin],
        waits_at: origin,
        levels_at: [0, 1].map(|after| origin + assembled.public_defines.at_once as u8 + after),
        program,
    }
}

/// Words that can wait for a SYNC edge. There is one entry.
pub(crate) fn paced(common: &mut Common<'static, PIO0>) -> Loaded {
    let assembled = pio_asm!(
        "waits:",
        "    wait 0 pin 0 [31]", // SYNC_READY ticks have passed. As above, an edge counts that is no ring-back.
        "    jmp pin waits",
        "    wait 1 pin 0", // Ends in the tick of the edge.
        "    push noblock", // Tells that a step has begun. The next word's levels come SYNC_LATENCY after the edge.
        ".wrap_target",
        "public plays:",
        "    out pins, 2",   // Bits 0 and 1 are PROJ and CAM.
        "    out y, 1",      // Bit 2: wait for SYNC?
        "    out x, 29",     // The rest is a count, of which a word that waits has none.
        "    jmp y-- waits", // It does.
        "lasts:",
        "    jmp x-- lasts", // It does not: the word lasts count + 5 ticks.
        ".wrap",
    );
    let program = common.load_program(&assembled.program);
    let origin = program.origin;
    Loaded {
        entry: [origin + assembled.public_defines.plays as u8; 2],
        waits_at: origin,
        levels_at: [0, 2].map(|after| origin + assembled.public_defines.plays as u8 + after),
        program,
    }
}

/// Hands the counter X over at every change of level of the pin that `jmp pin` tests, as
/// [`rcg_firmware::edges`] reads it. Enters with the line low, or high.
///
/// X counts down by one every two ticks, on every path: a pass of either loop is two ticks and one count, and
/// a change of level is four ticks and two counts. So the counter is the time, whatever the line did, and
/// `jmp x--` may fall through once in 2³² counts without losing a tick.
pub(crate) fn edges(common: &mut Common<'static, PIO0>) -> Loaded {
    let assembled = pio_asm!(
        ".wrap_target",
        "public high:",
        "    jmp pin stays_high", // Tick 1 of the pass: is the line still high?
        "    in x, 32",           // Tick 2: it fell. The counter goes to the FIFO.
        "    jmp x-- fell",       // Tick 3, a count.
        "fell:",
        "    jmp x-- low", // Tick 4, another. Falls through to `low` too.
        "public low:",
        "    jmp pin rose", // Tick 1 of the pass: is the line still low?
        "    jmp x-- low",  // Tick 2, a count. Falls through when X wraps, and then
        "    jmp pin rose", // the next pass is made here:
        "    jmp x-- low",  // X is not 0 again so soon.
        "rose:",
        "    in x, 32",           // Tick 2: it rose.
        "    jmp x-- stays_high", // Tick 3, a count. Falls through to the same place.
        "stays_high:",
        "    jmp x-- high", // Tick 2 of the pass (4 of the change), a count. Wraps to the same place.
        ".wrap",
    );
    let program = common.load_program(&assembled.program);
    let origin = program.origin;
    Loaded {
        entry: [
            origin + assembled.public_defines.low as u8,
            origin + assembled.public_defines.high as u8,
        ],
        waits_at: origin,
        levels_at: [origin; 2],
        program,
    }
}
