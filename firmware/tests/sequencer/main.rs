//! Laws of the run: which command is legal when, and what is fired.

mod steps;
mod transitions;

use rcg_firmware::sequencer::Sequencer;
use rcg_protocol::{Extent, Program, Pulse, Step, StepId, Ticks};

pub(crate) const fn table(steps: u32, cycles: u32) -> Program {
    Program::new(Extent::Table { steps, cycles })
}

/// A step of four words that differ for every number.
pub(crate) const fn step(number: u64) -> Step {
    Step {
        proj: Pulse::new(0, 10),
        cam: Pulse::new(20, 30 + number),
        period: Ticks(1000 + 2 * number),
    }
}

pub(crate) fn steps(from: u64, count: u64) -> Vec<Step> {
    (from..from + count).map(step).collect()
}

pub(crate) fn load_table(s: &mut Sequencer) {
    s.load(table(2, 3)).unwrap();
    s.append(0, &steps(0, 2), false).unwrap();
}

pub(crate) fn load_stream(s: &mut Sequencer, last: bool) {
    s.load(Program::new(Extent::Stream)).unwrap();
    s.append(0, &steps(0, 2), last).unwrap();
}

pub(crate) fn go(s: &mut Sequencer) {
    s.arm().unwrap();
    s.start().unwrap();
}

/// Fires all that there is, as the engine does.
pub(crate) fn play(s: &mut Sequencer) -> Vec<(StepId, Vec<u32>, u64)> {
    let mut played = Vec::new();
    let mut words = Vec::new();
    while let Some(fetched) = s.next_step(|piece| words.extend_from_slice(piece)) {
        assert_eq!(fetched.words, words.len());
        played.push((fetched.step, std::mem::take(&mut words), fetched.begins.0));
        s.fired(played.len() as u64);
    }
    played
}
