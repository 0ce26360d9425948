//! What the camera's STROBE line says about each trigger.
//!
//! # Design
//! Triggers are announced in the order in which they will happen; STROBE edges come in the order in which
//! they happened, on the same clock. A strobe belongs to the last trigger before it. A trigger is settled
//! once the next one has passed: what has not been seen by then was missed. Nothing is guessed: a strobe
//! that no trigger explains is reported as such.

use heapless::Deque;
use rcg_protocol::{StepFlags, StepId, StepRecord, Strobe, Ticks};

/// Triggers that can be announced and not yet settled: two full blocks of short steps.
pub const MAX_PENDING: usize = 256;

/// A trigger that is still open.
#[derive(Clone, Copy, Debug)]
struct Pending {
    step: StepId,
    /// Leading edge of CAM, or start of the step.
    at: Ticks,
    fires: bool,
    strobe_on: Option<Ticks>,
    strobe_off: Option<Ticks>,
    flags: StepFlags,
}

impl Pending {
    fn record(self) -> StepRecord {
        let mut flags = self.flags;
        if !self.fires {
            flags = flags.with(StepFlags::NO_TRIGGER);
        } else if self.strobe_on.is_none() {
            flags = flags.with(StepFlags::MISSED);
        }
        let strobe = self.strobe_on.map(|on| Strobe {
            delay: on - self.at,
            width: self.strobe_off.map_or(Ticks::ZERO, |off| off - on),
        });
        if strobe.is_some() && self.strobe_off.is_none() {
            flags = flags.with(StepFlags::OVERRUN);
        }
        StepRecord {
            step: self.step,
            trigger: self.at,
            strobe,
            flags,
        }
    }
}

/// What came of a STROBE edge.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[must_use]
pub enum Sighting {
    /// It belongs to a trigger.
    Expected,
    /// No trigger explains it.
    Spurious,
}

/// Holds triggers against strobes. All times count from the start of the run.
#[derive(Clone, Debug, Default)]
pub struct Witness {
    /// The strobe that is on is a spurious one, or of a trigger that is settled already.
    ignore_off: bool,
    pending: Deque<Pending, MAX_PENDING>,
}

impl Witness {
    /// Nothing announced.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            pending: Deque::new(),
            ignore_off: false,
        }
    }

    /// Forgets the run.
    pub fn clear(&mut self) {
        self.pending.clear();
        self.ignore_off = false;
    }

    /// Announces a trigger: step `step` begins at `at`, or fires CAM at `at` if `fires`.
    /// Returns the oldest open one, unsettled, if there is no room.
    pub fn announce(&mut self, step: StepId, at: Ticks, fires: bool) -> Option<StepRecord> {
        let crowded = if self.pending.is_full() {
            self.pending.pop_front().map(Pending::record)
        } else {
            None
        };
        let pending = Pending {
            step,
            at,
            fires,
            strobe_on: None,
            strobe_off: None,
            flags: StepFlags::default(),
        };
        self.pending.push_back(pending).ok();
        crowded
    }

    /// Adds `flags` to the trigger that was announced last.
    pub fn flag_newest(&mut self, flags: StepFlags) {
        if let Some(newest) = self.pending.back_mut() {
            newest.flags = newest.flags.with(flags);
        }
    }

    /// The next record that is settled at `now`: the trigger after it has passed.
    pub fn settled(&mut self, now: Ticks) -> Option<StepRecord> {
        let next = self.pending.get(1)?;
        if next.at > now {
            return None;
        }
        self.settle_front()
    }

    /// The next record when the run is over and all edges have been reported.
    pub fn last(&mut self, now: Ticks) -> Option<StepRecord> {
        // What was announced but never reached did not happen.
        while self.pending.back().is_some_and(|p| p.at > now) {
            self.pending.pop_back();
        }
        self.settle_front()
    }

    fn settle_front(&mut self) -> Option<StepRecord> {
        let front = self.pending.pop_front()?;
        self.ignore_off |= front.strobe_on.is_some() && front.strobe_off.is_none();
        Some(front.record())
    }

    /// STROBE became active at `at`. Ask for [`settled`](Self::settled) records of the same time first.
    pub fn strobe_on(&mut self, at: Ticks) -> Sighting {
        match self.pending.front_mut() {
            Some(front) if front.at <= at && front.fires => {
                if front.strobe_on.is_some() {
                    front.flags = front.flags.with(StepFlags::DOUBLE);
                    self.ignore_off = true;
                    return Sighting::Spurious;
                }
                front.strobe_on = Some(at);
                self.ignore_off = false;
                Sighting::Expected
            }
            _ => {
                self.ignore_off = true;
                Sighting::Spurious
            }
        }
    }

    /// STROBE went back to rest at `at`.
    pub fn strobe_off(&mut self, at: Ticks) {
        if core::mem::take(&mut self.ignore_off) {
            return;
        }
        if let Some(front) = self.pending.front_mut()
            && front.strobe_on.is_some()
            && front.strobe_off.is_none()
        {
            front.strobe_off = Some(at);
        }
    }
}
