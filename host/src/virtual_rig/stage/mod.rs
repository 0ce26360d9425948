//! What happens on the optical bench: edges in, exposures out.
//!
//! # Design
//! Times are whole ticks of the controller's clock. The rig's delays are rounded to ticks once, and seconds come from
//! differences of ticks only: when a run begins on that clock changes no bit of its images.

use std::collections::VecDeque;
use std::sync::Arc;

use rand::{RngExt as _, SeedableRng as _};
use rand_distr::StandardNormal;
use rand_xoshiro::Xoshiro256PlusPlus;
use rcg_firmware::virtual_time::StrobeEdge;
use rcg_protocol::{Input, Level, Line, Ticks};

use super::Behaviour;
use super::flaws::Lamp;
use super::lag::Lag;
use super::light::{Glow, Shown};
use super::truth::Truth;

/// One exposure that is over.
#[derive(Clone, Debug)]
pub(super) struct Shot {
    pub(super) id: u64,
    pub(super) timestamp_s: f64,
    pub(super) exposure_s: f64,
    /// Patterns that were visible, and for how many seconds of the exposure.
    pub(super) seen: Vec<(Arc<Shown>, f64)>,
    /// The lamp's light, relative to that of the rig file.
    pub(super) lamp: f64,
    /// How many hours the instrument has been on.
    pub(super) hours: f64,
    pub(super) seed: u64,
}

struct Open {
    from: Ticks,
    missed: bool,
}

/// The bench.
pub(super) struct Stage {
    clock_hz: u32,
    settle: Ticks,
    exposure_delay: Ticks,
    readout: Ticks,
    overlap: bool,
    sync_period: Ticks,
    lamp: Lamp,
    lag: Lag,
    behaviour: Behaviour,
    patterns: Vec<Glow>,
    /// Fingerprint of the loaded patterns, and how often in a row the same ones were run.
    fingerprint: u64,
    last_run: (u64, u64),
    /// How many parts of the measurement before this one showed just the same.
    same_before: u64,
    /// Which light begins at which time; the last entry holds on.
    timeline: VecDeque<(Ticks, Arc<Shown>)>,
    next_pattern: usize,
    open: Option<Open>,
    busy_until: Ticks,
    exposures: u64,
    triggers: u64,
    /// When the camera was triggered first since it was armed: there its clock begins.
    first: Option<Ticks>,
    shots: VecDeque<Shot>,
}

/// The camera's clock says this when it is triggered first after it was armed. It does not go on from run to run: what is
/// stored of a run depends on that run alone.
const CAMERA_CLOCK_AHEAD_S: f64 = 1000.0;
/// The camera's clock runs fast by this much.
const CAMERA_CLOCK_RATE: f64 = 1.0 + 20e-6;

impl Stage {
    /// A bench at rest; times count ticks of a clock of `clock_hz`.
    pub(super) fn new(truth: &Truth, behaviour: Behaviour, clock_hz: u32) -> Self {
        let rig = &truth.rig;
        let nearest = |s: f64| Ticks((s * f64::from(clock_hz)).round() as u64);
        // As short as the rig says or shorter: a schedule that just fits in seconds fits in ticks too. The hair is
        // for products such as 5 µs × 125 MHz, which may come out below 625.
        let within = |s: f64| Ticks((s * f64::from(clock_hz) + 1e-6) as u64);
        Self {
            clock_hz,
            settle: nearest(rig.projector.settle_s),
            exposure_delay: within(rig.camera.exposure_delay_s),
            readout: within(rig.camera.readout_s),
            overlap: rig.camera.overlap,
            sync_period: nearest(rig.projector.min_period_s).max(Ticks(1)),
            lamp: truth.flaws.lamp.clone(),
            lag: truth.flaws.lag,
            behaviour,
            patterns: Vec::new(),
            fingerprint: 0,
            last_run: (0, 0),
            same_before: 0,
            timeline: VecDeque::from([(Ticks::ZERO, Arc::default())]),
            next_pattern: 0,
            open: None,
            busy_until: Ticks::ZERO,
            exposures: 0,
            triggers: 0,
            first: None,
            shots: VecDeque::new(),
        }
    }

    pub(super) fn clear_patterns(&mut self) {
        self.patterns.clear();
        self.fingerprint = 0;
        self.next_pattern = 0;
        self.timeline = VecDeque::from([(Ticks::ZERO, Arc::default())]);
    }

    /// Shows the pixels `lit` at `level` of 255, in one primary or white, which do `light`.
    pub(super) fn load_pattern(&mut self, lit: &[u32], (level, primary): (u8, Option<u8>), light: Glow) {
        self.patterns.push(light);
        if level != u8::MAX {
            self.fingerprint = mix(self.fingerprint, !u64::from(level));
        }
        if let Some(primary) = primary {
            self.fingerprint = mix(self.fingerprint, !(u64::from(primary) << 8));
        }
        for &pixel in lit {
            self.fingerprint = mix(self.fingerprint, u64::from(pixel));
        }
        self.fingerprint = mix(self.fingerprint, u64::MAX);
    }

    /// A part of the measurement begins; see [`Camera::begin_part`](crate::capture::camera::Camera::begin_part).
    pub(super) const fn begin_part(&mut self, same_before: u64) {
        self.last_run = (0, 0);
        self.same_before = same_before;
    }

    pub(super) fn arm_camera(&mut self) {
        let (fingerprint, repeats) = self.last_run;
        let repeats = if fingerprint == self.fingerprint {
            repeats + 1
        } else {
            0
        };
        self.last_run = (self.fingerprint, repeats);
        self.exposures = 0;
        self.triggers = 0;
        self.first = None;
        self.open = None;
        self.shots.clear();
    }

    /// The oldest exposures that are over, `most` of them.
    pub(super) fn take_shots(&mut self, most: usize) -> Vec<Shot> {
        self.shots.drain(..most.min(self.shots.len())).collect()
    }

    /// From one edge of the projector's vsync to the next; one of them is at tick 0.
    pub(super) const fn sync_period(&self) -> Ticks {
        self.sync_period
    }

    /// The first edge of the projector's vsync at or after `at`.
    pub(super) const fn next_sync(&self, at: Ticks) -> Ticks {
        Ticks(at.0.div_ceil(self.sync_period.0) * self.sync_period.0)
    }

    /// What stands at SYNC at `now`, with its edges since `since`: each vsync is active for a tenth of the time to the next.
    pub(super) fn sync_seen(&self, since: Ticks, now: Ticks, active_low: bool) -> Input {
        let (period, active) = (self.sync_period.0, self.sync_period.0 / 10);
        // Edges up to a time, from the clock's start on: leading ones and trailing ones, each at its place in the period.
        let edges_by = |at: u64| 2 * (at / period) + 1 + u64::from(at % period >= active);
        let count = edges_by(now.0) - edges_by(since.0);
        let edge = |number: u64| Ticks(number / 2 * period + number % 2 * active);
        let last = |back: u64| (count >= back).then(|| edge(edges_by(now.0) - back));
        Input {
            high: edges_by(now.0) % 2 == 1,
            pulled_up: active_low,
            edges: Some(u32::try_from(count).unwrap_or(u32::MAX)),
            last: [last(2), last(1)],
        }
    }

    /// An output of the controller takes a level, at `at` on its clock; times never decrease.
    pub(super) fn edge(&mut self, line: Line, level: Level, at: Ticks) -> Option<StrobeEdge> {
        match (line, level) {
            (Line::Proj, Level::Active) => {
                let light = self.patterns.get(self.next_pattern).cloned().unwrap_or_default();
                self.next_pattern += 1;
                self.timeline
                    .push_back((at + self.settle, Arc::new(Shown::from(light))));
                None
            }
            (Line::Cam, Level::Active) => self.open_shutter(at),
            (Line::Cam, Level::Inactive) => self.close_shutter(at),
            _ => None,
        }
    }

    fn open_shutter(&mut self, at: Ticks) -> Option<StrobeEdge> {
        let from = at + self.exposure_delay;
        self.triggers += 1;
        self.first.get_or_insert(from);
        let ready = if self.overlap {
            self.busy_until.saturating_sub(self.readout)
        } else {
            self.busy_until
        };
        let unlucky = self.chance(1, self.triggers, self.behaviour.faults.missed_triggers);
        let missed = unlucky || from < ready;
        self.open = Some(Open { from, missed });
        (!missed).then_some(StrobeEdge {
            at: from,
            active: true,
        })
    }

    fn close_shutter(&mut self, at: Ticks) -> Option<StrobeEdge> {
        let Open { from, missed } = self.open.take()?;
        if missed {
            return None;
        }
        let to = at + self.exposure_delay;
        self.busy_until = to + self.readout;
        let seen = self.seen(from, to);
        let id = self.exposures;
        self.exposures += 1;
        let shot = Shot {
            id,
            timestamp_s: CAMERA_CLOCK_AHEAD_S
                + self.seconds(from.saturating_sub(self.first.unwrap_or(from))) * CAMERA_CLOCK_RATE,
            exposure_s: self.seconds(to - from),
            seen,
            lamp: self.lamp_level(from, id),
            hours: self.hours(from),
            seed: self.seed(0, id),
        };
        if self.chance(3, id, self.behaviour.faults.doubled_frames) {
            self.shots.push_back(shot.clone());
        }
        if !self.chance(2, id, self.behaviour.faults.dropped_frames) {
            self.shots.push_back(shot);
        }
        Some(StrobeEdge {
            at: to,
            active: false,
        })
    }

    /// Which light was visible for how long between two times. The camera's delay may reach past edges that
    /// are not known yet, but never past a settling time: patterns outlive it. Of the one before something is left for a while.
    fn seen(&mut self, from: Ticks, to: Ticks) -> Vec<(Arc<Shown>, f64)> {
        while self.timeline.get(2).is_some_and(|next| next.0 <= from) {
            self.timeline.pop_front();
        }
        let settle_s = self.seconds(self.settle);
        let mut seen: Vec<(Arc<Shown>, f64)> = Vec::with_capacity(2);
        // Of the one before.
        let mut left_s = 0.0;
        for (index, (begins, light)) in self.timeline.iter().enumerate().rev() {
            let after = self.timeline.get(index + 1);
            let (from, to) = ((*begins).max(from), after.map_or(to, |next| next.0.min(to)));
            let visible = to.saturating_sub(from);
            let mut visible_s = self.seconds(visible) + left_s;
            left_s = 0.0;
            if visible > Ticks::ZERO && index > 0 {
                let [from_s, to_s] = [from, to].map(|at| self.seconds(at - *begins));
                left_s = self.lag.left_s(settle_s, from_s, to_s);
                visible_s -= left_s;
            }
            if visible_s > 0.0 && !light.glow.is_black() {
                seen.push((light.clone(), visible_s));
            }
        }
        seen.reverse();
        seen
    }

    /// The lamp's light in the exposure `id` that begins at `from`, relative to that of the rig file.
    fn lamp_level(&self, from: Ticks, id: u64) -> f64 {
        let Lamp { flicker, .. } = self.lamp;
        let slow = self.lamp.level(self.hours(from));
        if flicker <= 0.0 {
            return slow;
        }
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(self.seed(4, id));
        let normal: f64 = rng.sample(StandardNormal);
        slow * (1.0 + flicker * normal).max(0.0)
    }

    fn hours(&self, at: Ticks) -> f64 {
        self.behaviour.lamp_h + self.seconds(at) / 3600.0
    }

    fn seconds(&self, ticks: Ticks) -> f64 {
        ticks.0 as f64 / f64::from(self.clock_hz)
    }

    /// A seed that depends on what is measured, not on when: a resumed run draws the same.
    fn seed(&self, purpose: u64, ordinal: u64) -> u64 {
        let (fingerprint, repeats) = self.last_run;
        // Not mixed in where there is only one part of a kind: its seeds need no number.
        let part = (self.same_before > 0).then_some(self.same_before);
        [purpose, fingerprint, repeats, ordinal]
            .into_iter()
            .chain(part)
            .fold(self.behaviour.seed, mix)
    }

    fn chance(&self, purpose: u64, ordinal: u64, rate: f64) -> bool {
        rate > 0.0
            && Xoshiro256PlusPlus::seed_from_u64(self.seed(purpose, ordinal)).random_bool(rate.min(1.0))
    }
}

/// One round of `SplitMix64` over `state` and `value` (Steele, Lea, Flood 2014).
fn mix(state: u64, value: u64) -> u64 {
    let mut z = state.wrapping_add(value).wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

#[cfg(test)]
mod tests;
