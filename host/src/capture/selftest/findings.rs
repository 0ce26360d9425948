//! What is wrong with the wires, by what was seen.

use std::fmt;

use rcg_protocol::{Line, Polarity, Ticks};

use super::{Answer, PAIRS, Rest, Seen};
use crate::capture::steps::Output;

/// At which end two wires are crossed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum End {
    /// PROJ and CAM.
    Outputs,
    /// SYNC and STROBE.
    Inputs,
    /// It cannot be told, as with jumpers.
    Either,
}

/// Something that is not as it should be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Finding {
    /// Nobody drives this input.
    Open(Line),
    /// PROJ is answered at STROBE, CAM at SYNC.
    Crossed(End),
    /// This input rests where it should be active.
    Inverted {
        /// The input.
        line: Line,
        /// Where it rests.
        rest: Rest,
    },
    /// Something holds this input where it is, whatever the outputs do.
    Silent {
        /// The input.
        line: Line,
        /// Where it is.
        rest: Rest,
        /// The output that it should answer.
        output: Line,
    },
    /// This input answers the other output.
    Wrong {
        /// The input.
        line: Line,
        /// What it answers.
        answers: Line,
        /// What it should answer.
        output: Line,
    },
    /// This input answers both outputs, PHOTO AUX-A and AUX-B.
    Both(Line),
    /// This input answers some pulses only.
    Sometimes {
        /// The input.
        line: Line,
        /// The pulses that it answers …
        answered: u32,
        /// … of so many.
        of: u32,
    },
    /// This input has edges though both outputs rest.
    ByItself {
        /// The input.
        line: Line,
        /// How many.
        edges: u32,
    },
    /// This input changes more often than a pulse does.
    Rings {
        /// The input.
        line: Line,
        /// Edges at one pulse, at most.
        edges: u32,
    },
    /// This input is not back at rest when the period is over.
    StaysActive(Line),
}

impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Open(line) => write!(
                f,
                "{line} is open: nothing drives it, it is wherever the box pulls it"
            ),
            Self::Crossed(end) => {
                let who = match end {
                    End::Outputs => "PROJ and CAM are",
                    End::Inputs => "SYNC and STROBE are",
                    End::Either => "PROJ and CAM, or else SYNC and STROBE, are",
                };
                write!(
                    f,
                    "PROJ arrives at STROBE and CAM at SYNC: {who} crossed, swap the two wires at one end"
                )
            }
            Self::Inverted { line, rest } => {
                let other = if rest == Rest::High { "low" } else { "high" };
                write!(f, "{line} is inverted: it rests {rest} and pulses {other}")
            }
            Self::Silent { line, rest, output } => {
                write!(f, "{line} does not answer {output}: something holds it {rest}")
            }
            Self::Wrong {
                line,
                answers,
                output,
            } => write!(f, "{line} answers {answers} and not {output}"),
            Self::Both(line) => write!(
                f,
                "{line} answers both {}: two wires touch each other, or one goes to two pins",
                if line == Line::Photo {
                    "AUX-A and AUX-B"
                } else {
                    "PROJ and CAM"
                }
            ),
            Self::Sometimes { line, answered, of } => {
                write!(f, "{line} answers {answered} of {of} pulses")
            }
            Self::ByItself { line, edges } => {
                write!(f, "{line} has {edges} edges while both outputs rest")
            }
            Self::Rings { line, edges } => {
                write!(
                    f,
                    "{line} has {edges} edges at one pulse, which has 2: it rings, or picks something up"
                )
            }
            Self::StaysActive(line) => {
                write!(f, "{line} is not back at rest when the period of a pulse is over")
            }
        }
    }
}

/// What is wrong with these inputs, if lines rest as `polarity` says.
pub(super) fn of(inputs: &[Seen; 2], polarity: Polarity) -> Vec<Finding> {
    let mut findings = Vec::new();
    let crossed = crossed(inputs);
    findings.extend(crossed.map(Finding::Crossed));
    for (seen, (own, _)) in inputs.iter().zip(PAIRS) {
        let active_low = match seen.line {
            Line::Strobe => polarity.strobe_active_low,
            _ => polarity.sync_active_low,
        };
        one(seen, own, crossed.is_some(), active_low, &mut findings);
    }
    findings
}

/// What is wrong with PHOTO, which should answer `own`.
pub(super) fn of_photo(seen: &Seen, own: Output, active_low: bool) -> Vec<Finding> {
    let mut findings = Vec::new();
    one(seen, own, false, active_low, &mut findings);
    findings
}

const fn other(output: Output) -> Output {
    match output {
        Output::Proj => Output::Cam,
        Output::Cam => Output::Proj,
        Output::AuxA => Output::AuxB,
        Output::AuxB => Output::AuxA,
    }
}

/// What is wrong with the input `seen`, which should answer `own`.
fn one(seen: &Seen, own: Output, is_crossed: bool, active_low: bool, findings: &mut Vec<Finding>) {
    let Seen {
        line,
        rest,
        by_itself,
        ..
    } = *seen;
    if by_itself > 0 {
        // A projector may run freely; then nothing can be said of PROJ. A camera that is to be triggered may not.
        if line != Line::Sync {
            findings.push(Finding::ByItself {
                line,
                edges: by_itself,
            });
        }
        return;
    }
    if seen.of(own).iter().any(|answer| answer.edges % 2 == 1) {
        // What comes too late would pass for an answer to the other output.
        findings.push(Finding::StaysActive(line));
        return;
    }
    let (to_own, to_other) = (seen.answered(own), seen.answered(other(own)));
    let inverted = (rest == Rest::High && !active_low) || (rest == Rest::Low && active_low);
    if to_own > 0 && to_other > 0 {
        findings.push(Finding::Both(line));
    } else if to_own == 0 && to_other > 0 {
        if !is_crossed {
            findings.push(Finding::Wrong {
                line,
                answers: other(own).line(),
                output: own.line(),
            });
        }
    } else if to_own == 0 {
        findings.push(match rest {
            Rest::Open => Finding::Open(line),
            Rest::Low | Rest::High => Finding::Silent {
                line,
                rest,
                output: own.line(),
            },
        });
        return;
    }
    if inverted {
        findings.push(Finding::Inverted { line, rest });
    }
    let answers = if to_own > 0 {
        seen.of(own)
    } else {
        seen.of(other(own))
    };
    let (answered, of) = (to_own.max(to_other), answers.len());
    if answered < of {
        let (answered, of) = (answered as u32, of as u32);
        findings.push(Finding::Sometimes { line, answered, of });
    }
    let most = answers.iter().map(|answer| answer.edges).max().unwrap_or(0);
    if most > 2 {
        findings.push(Finding::Rings { line, edges: most });
    } else if answers.iter().any(|answer| answer.edges % 2 == 1) {
        findings.push(Finding::StaysActive(line));
    }
}

/// Whether PROJ is answered at STROBE alone and CAM at SYNC alone, and if so at which end the wires are crossed.
fn crossed(inputs: &[Seen; 2]) -> Option<End> {
    let [sync, strobe] = inputs;
    let only = |seen: &Seen, output| {
        seen.by_itself == 0 && seen.answered(output) > 0 && seen.answered(other(output)) == 0
    };
    if !(only(sync, Output::Cam) && only(strobe, Output::Proj)) {
        return None;
    }
    let (at_sync, at_strobe) = (
        is_as_long(sync.of(Output::Cam)),
        is_as_long(strobe.of(Output::Proj)),
    );
    Some(match (at_sync, at_strobe) {
        // The camera, whose exposure is as long as its trigger, is at PROJ and at STROBE …
        (Some(false), Some(true)) => End::Outputs,
        // … or at CAM and at SYNC.
        (Some(true), Some(false)) => End::Inputs,
        _ => End::Either,
    })
}

/// Whether an answer is longer where the pulse is longer, and by as much; `None` if that was not seen.
fn is_as_long(answers: &[Answer]) -> Option<bool> {
    let excess: Vec<i64> = answers
        .iter()
        .filter_map(|answer| Some(answer.delay_and_width?.1.0 as i64 - answer.pulse.0 as i64))
        .collect();
    let pulses = || answers.iter().map(|answer| answer.pulse);
    let (shortest, longest) = pulses().min().zip(pulses().max())?;
    let (least, most) = excess.iter().min().zip(excess.iter().max())?;
    let differs = longest.saturating_sub(shortest);
    let both = excess.len() == answers.len() && differs > Ticks::ZERO;
    both.then(|| ((most - least) as u64) < differs.0 / 2)
}
