//! The outputs at rest, and where lines rest.

use embassy_rp::pac::PIO0 as PIO;
use embassy_rp::peripherals::PIO0;
use embassy_rp::pio::StateMachine;
use rcg_protocol::{AuxPolarity, Line, Polarity};

use super::Engine;
use crate::board::{AUX_A, PROJ, SM_PULSE};

/// `set pindirs, 0b11`.
#[allow(clippy::unusual_byte_groupings)] // the fields of the instruction
const DRIVE_BOTH: u16 = 0b111_00000_100_00011;

/// `set pins, 0`; the levels of both pins are its lowest bits.
#[allow(clippy::unusual_byte_groupings)] // the fields of the instruction
const SET_BOTH: u16 = 0b111_00000_000_00000;

/// Which of PROJ and CAM, and of AUX-A and AUX-B, rest high, as the lowest bits.
fn resting_high(lines: Polarity, aux: AuxPolarity) -> [u16; 2] {
    [
        u16::from(lines.proj_active_low) | u16::from(lines.cam_active_low) << 1,
        u16::from(aux.a_active_low) | u16::from(aux.b_active_low) << 1,
    ]
}

/// Lets the pulse engine's machine, which is disabled, or about to begin, execute a `set` on PROJ and CAM and another on AUX-A and AUX-B.
fn for_pairs(machine: &mut StateMachine<'static, PIO0, SM_PULSE>, instructions: [u16; 2]) {
    let pinctrl = PIO.sm(SM_PULSE).pinctrl();
    let before = pinctrl.read();
    for (first, instruction) in [PROJ, AUX_A].into_iter().zip(instructions) {
        pinctrl.modify(|w| {
            w.set_set_base(first as u8);
            w.set_set_count(2);
        });
        // SAFETY: the caller says that the machine plays nothing, and the instruction touches nothing but these pins.
        unsafe { machine.exec_instr(instruction) };
    }
    pinctrl.write_value(before);
}

/// Makes the outputs outputs, at rest.
pub(super) fn drive_to_rest(
    machine: &mut StateMachine<'static, PIO0, SM_PULSE>,
    lines: Polarity,
    aux: AuxPolarity,
) {
    let high = resting_high(lines, aux);
    for_pairs(machine, high.map(|_| DRIVE_BOTH));
    for_pairs(machine, high.map(|high| SET_BOTH | high));
}

impl Engine {
    /// Lines rest, and are pulled, as `polarity` says. The machines must be disabled.
    pub(super) fn take_polarity(&mut self, polarity: Polarity, aux: AuxPolarity) {
        self.polarity = polarity;
        self.aux = aux;
        self.rest();
        self.photo.set_polarity(aux.photo_active_low);
        self.begin_on(Line::Start);
        self.sync.set_polarity(aux.start_active_low);
        self.begin_on(Line::Sync);
        self.sync.set_polarity(polarity.sync_active_low);
        self.strobe.set_polarity(polarity.strobe_active_low);
    }

    /// Lets runs begin on `line`, SYNC or START.
    pub(super) fn begin_on(&mut self, line: Line) {
        if self.begins_on != line {
            self.sync.exchange();
            self.begins_on = line;
        }
    }

    /// All outputs at rest. The machine must be disabled, or about to begin.
    pub(super) fn rest(&mut self) {
        let high = resting_high(self.polarity, self.aux);
        for_pairs(&mut self.machine, high.map(|high| SET_BOTH | high));
    }
}
