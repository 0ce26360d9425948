//! Whether PHOTO sees what AUX-A or AUX-B switches: a jumper, or a light source and a photodiode.

use rcg_protocol::{Aux, AuxPolarity, Line, Pace, Polarity, Step};

use super::{Rest, Seen, SelftestError, Settings, answer, findings, let_pass, program, pulse, twice};
use crate::capture::device::{Device, DeviceError};
use crate::capture::link::Link;
use crate::capture::selftest::Finding;
use crate::capture::steps::{Limits, Output};

/// What was seen of PHOTO, and what is to be said of it.
#[derive(Clone, Debug)]
pub struct PhotoTested {
    /// PHOTO; its answers are those to AUX-A and to AUX-B.
    pub seen: Seen,
    /// What is not as it should be.
    pub findings: Vec<Finding>,
}

/// Tries whether PHOTO answers `own`, AUX-A or AUX-B, and not the other one; `polarity` says how these lines should rest. The schedule that
/// was loaded is forgotten.
///
/// # Errors
/// [`SelftestError`]; [`DeviceError::Older`] if the firmware has no such lines.
pub fn selftest_photo<L: Link>(
    device: &mut Device<L>,
    settings: &Settings,
    polarity: AuxPolarity,
    own: Output,
) -> Result<PhotoTested, SelftestError> {
    // One that is too old for it moves no output.
    device.photo()?;
    let info = device.info();
    let limits = Limits::new(&info, Pace::FreeRunning);
    let period = Some(settings.period);
    // What cannot be made is refused before any output moves.
    let mut pulses = Vec::new();
    for output in [Output::AuxA, Output::AuxB] {
        for width in [settings.width, twice(settings.width)] {
            pulses.push((limits.pulse(output, width, period)?, width.ticks(info.clock_hz)));
        }
    }
    let step = pulses[0].0.0;
    let up = at_rest(device, &step, settings.polarity, polarity, true)?;
    let down = at_rest(device, &step, settings.polarity, polarity, false)?;
    device.watch()?;
    let_pass(device, settings.period.seconds(info.clock_hz))?;
    let by_itself = device.photo()?.input.edges.unwrap_or(0);

    let mut answers = [Vec::new(), Vec::new()];
    for (place, (output, answers)) in [Output::AuxA, Output::AuxB].iter().zip(&mut answers).enumerate() {
        for number in 0..settings.count as usize {
            let ((step, aux), width) = pulses[2 * place + number % 2];
            let aux = Aux {
                polarity,
                photo: true,
                ..aux
            };
            device.aux(&aux)?;
            let began = pulse(device, *output, &step, settings.polarity)?;
            answers.push(answer(&device.photo()?.input, began, width));
        }
    }
    let seen = Seen {
        line: Line::Photo,
        rest: Rest::of([up, down]),
        by_itself,
        answers,
    };
    let findings = findings::of_photo(&seen, own, polarity.photo_active_low);
    Ok(PhotoTested { seen, findings })
}

/// Whether PHOTO is high while all outputs rest and the box pulls it up, or down.
fn at_rest<L: Link>(
    device: &mut Device<L>,
    step: &Step,
    lines: Polarity,
    polarity: AuxPolarity,
    up: bool,
) -> Result<bool, DeviceError> {
    device.aux(&Aux::resting(AuxPolarity {
        photo_active_low: up,
        ..polarity
    }))?;
    device.load(&program(lines), &[*step])?;
    device.arm()?;
    let photo = device.photo();
    device.abort()?;
    Ok(photo?.input.high)
}
