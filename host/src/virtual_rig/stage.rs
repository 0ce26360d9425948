//! What happens on the optical bench: edges in, exposures out.

use std::collections::VecDeque;

use rand::{RngExt as _, SeedableRng as _};
use rand_xoshiro::Xoshiro256PlusPlus;
use rcg_firmware::pulse::Edge;
use rcg_protocol::{Level, Line};

use super::Behaviour;
use super::light::Light;
use crate::rig::Rig;

/// What goes wrong on purpose: rates between 0 and 1, drawn from the seed.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Mischief {
    /// Triggers that the camera ignores.
    pub missed_triggers: f64,
    /// Exposures whose frames are lost on the way.
    pub dropped_frames: f64,
    /// Frames that come twice.
    pub doubled_frames: f64,
}

/// An edge of the STROBE line, in seconds on the controller's clock.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct StrobeEdge {
    pub(super) at_s: f64,
    pub(super) active: bool,
}

/// One exposure that is over.
#[derive(Clone, Debug)]
pub(super) struct Shot {
    pub(super) id: u64,
    pub(super) timestamp_s: f64,
    pub(super) exposure_s: f64,
    /// Patterns that were visible, and for how many seconds of the exposure.
    pub(super) seen: Vec<(Light, f64)>,
    pub(super) seed: u64,
}

struct Open {
    from_s: f64,
    missed: bool,
}

/// The bench.
pub(super) struct Stage {
    settle_s: f64,
    exposure_delay_s: f64,
    readout_s: f64,
    overlap: bool,
    sync_period_s: f64,
    behaviour: Behaviour,
    patterns: Vec<Light>,
    /// Fingerprint of the loaded patterns, and how often in a row the same ones were run.
    fingerprint: u64,
    last_run: (u64, u64),
    /// Which light begins at which time; the last entry holds on.
    timeline: VecDeque<(f64, Light)>,
    next_pattern: usize,
    open: Option<Open>,
    busy_until_s: f64,
    exposures: u64,
    triggers: u64,
    shots: Vec<Shot>,
}

/// The camera's clock is this far ahead of the controller's.
const CAMERA_CLOCK_AHEAD_S: f64 = 1000.0;
/// The camera's clock runs fast by this much.
const CAMERA_CLOCK_RATE: f64 = 1.0 + 20e-6;

impl Stage {
    pub(super) fn new(rig: &Rig, behaviour: Behaviour) -> Self {
        Self {
            settle_s: rig.projector.settle_s,
            exposure_delay_s: rig.camera.exposure_delay_s,
            readout_s: rig.camera.readout_s,
            overlap: rig.camera.overlap,
            sync_period_s: rig.projector.min_period_s,
            behaviour,
            patterns: Vec::new(),
            fingerprint: 0,
            last_run: (0, 0),
            timeline: VecDeque::from([(f64::NEG_INFINITY, Light::DARK)]),
            next_pattern: 0,
            open: None,
            busy_until_s: f64::NEG_INFINITY,
            exposures: 0,
            triggers: 0,
            shots: Vec::new(),
        }
    }

    pub(super) fn clear_patterns(&mut self) {
        self.patterns.clear();
        self.fingerprint = 0;
        self.next_pattern = 0;
        self.timeline = VecDeque::from([(f64::NEG_INFINITY, Light::DARK)]);
    }

    pub(super) fn load_pattern(&mut self, lit: &[u32], light: Light) {
        self.patterns.push(light);
        for &pixel in lit {
            self.fingerprint = mix(self.fingerprint, u64::from(pixel));
        }
        self.fingerprint = mix(self.fingerprint, u64::MAX);
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
        self.open = None;
        self.shots.clear();
    }

    pub(super) fn take_shots(&mut self) -> Vec<Shot> {
        std::mem::take(&mut self.shots)
    }

    /// The first edge of the projector's vsync at or after `at_s`.
    pub(super) fn next_sync_s(&self, at_s: f64) -> f64 {
        (at_s / self.sync_period_s).ceil() * self.sync_period_s
    }

    /// An output edge of the controller, at `at_s` on its clock; times never decrease.
    pub(super) fn edge(&mut self, edge: Edge, at_s: f64) -> Option<StrobeEdge> {
        match (edge.line, edge.level) {
            (Line::Proj, Level::Active) => {
                let light = self
                    .patterns
                    .get(self.next_pattern)
                    .copied()
                    .unwrap_or(Light::DARK);
                self.next_pattern += 1;
                self.timeline.push_back((at_s + self.settle_s, light));
                None
            }
            (Line::Cam, Level::Active) => self.open_shutter(at_s),
            (Line::Cam, Level::Inactive) => self.close_shutter(at_s),
            _ => None,
        }
    }

    fn open_shutter(&mut self, at_s: f64) -> Option<StrobeEdge> {
        let from_s = at_s + self.exposure_delay_s;
        self.triggers += 1;
        let ready_s = if self.overlap {
            self.busy_until_s - self.readout_s
        } else {
            self.busy_until_s
        };
        let unlucky = self.chance(1, self.triggers, self.behaviour.mischief.missed_triggers);
        // A hair of tolerance: times are sums of floating point numbers.
        let missed = unlucky || from_s < ready_s - 1e-12;
        self.open = Some(Open { from_s, missed });
        (!missed).then_some(StrobeEdge {
            at_s: from_s,
            active: true,
        })
    }

    fn close_shutter(&mut self, at_s: f64) -> Option<StrobeEdge> {
        let Open { from_s, missed } = self.open.take()?;
        if missed {
            return None;
        }
        let to_s = at_s + self.exposure_delay_s;
        self.busy_until_s = to_s + self.readout_s;
        let seen = self.seen(from_s, to_s);
        let id = self.exposures;
        self.exposures += 1;
        let shot = Shot {
            id,
            timestamp_s: CAMERA_CLOCK_AHEAD_S + from_s * CAMERA_CLOCK_RATE,
            exposure_s: to_s - from_s,
            seen,
            seed: self.seed(0, id),
        };
        if self.chance(3, id, self.behaviour.mischief.doubled_frames) {
            self.shots.push(shot.clone());
        }
        if !self.chance(2, id, self.behaviour.mischief.dropped_frames) {
            self.shots.push(shot);
        }
        Some(StrobeEdge {
            at_s: to_s,
            active: false,
        })
    }

    /// Which light was visible for how long between two times. The camera's delay may reach past edges that
    /// are not known yet, but never past a settling time: patterns outlive it.
    fn seen(&mut self, from_s: f64, to_s: f64) -> Vec<(Light, f64)> {
        while self.timeline.get(1).is_some_and(|next| next.0 <= from_s) {
            self.timeline.pop_front();
        }
        let mut seen = Vec::with_capacity(1);
        for (index, &(begins_s, light)) in self.timeline.iter().enumerate() {
            let ends_s = self.timeline.get(index + 1).map_or(f64::INFINITY, |next| next.0);
            let visible_s = ends_s.min(to_s) - begins_s.max(from_s);
            if visible_s > 0.0 && light.irradiance > 0.0 {
                seen.push((light, visible_s));
            }
        }
        seen
    }

    /// A seed that depends on what is measured, not on when: a resumed run draws the same.
    fn seed(&self, purpose: u64, ordinal: u64) -> u64 {
        let (fingerprint, repeats) = self.last_run;
        [purpose, fingerprint, repeats, ordinal]
            .into_iter()
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
