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

#[cfg(test)]
mod tests {
    use rcg_protocol::Ticks;

    use super::*;
    use crate::virtual_rig::Noise;

    fn light(irradiance: f64) -> Light {
        Light {
            irradiance,
            ..Light::DARK
        }
    }

    /// A stage with patterns of irradiance 1, 2, 3 …; settling 33.3 ms, camera delay 5 µs, read-out 26 ms.
    fn stage() -> Stage {
        let behaviour = Behaviour {
            noise: Noise::Off,
            seed: 1,
            mischief: Mischief::default(),
        };
        let mut stage = Stage::new(&Rig::load("rcg-1").unwrap(), behaviour);
        for index in 1..=4 {
            stage.load_pattern(&[index], light(f64::from(index)));
        }
        stage.arm_camera();
        stage
    }

    fn pulse(stage: &mut Stage, line: Line, at_s: f64, width_s: f64) -> [Option<StrobeEdge>; 2] {
        let edge = |level| Edge {
            at: Ticks::ZERO,
            line,
            level,
        };
        [
            stage.edge(edge(Level::Active), at_s),
            stage.edge(edge(Level::Inactive), at_s + width_s),
        ]
    }

    fn seen(shots: &[Shot]) -> Vec<Vec<(f64, f64)>> {
        let one = |shot: &Shot| {
            shot.seen
                .iter()
                .map(|(light, s)| (light.irradiance, (s * 1e6).round()))
                .collect()
        };
        shots.iter().map(one).collect()
    }

    #[test]
    fn a_trigger_in_time_sees_one_pattern_and_strobes_for_its_exposure() {
        let mut stage = stage();
        pulse(&mut stage, Line::Proj, 0.0, 5e-6);
        let [on, off] = pulse(&mut stage, Line::Cam, 0.0333, 0.01).map(Option::unwrap);
        assert!(on.active && !off.active);
        assert!((on.at_s - 0.033_305).abs() < 1e-12 && (off.at_s - 0.043_305).abs() < 1e-12);
        assert_eq!(seen(&stage.take_shots()), [[(1.0, 10_000.0)]]);
    }

    #[test]
    fn an_early_trigger_straddles_two_patterns() {
        let mut stage = stage();
        pulse(&mut stage, Line::Proj, 0.0, 5e-6);
        pulse(&mut stage, Line::Proj, 0.1, 5e-6);
        // Pattern 2 is stable at 133.3 ms: 4 ms of this exposure come before.
        pulse(&mut stage, Line::Cam, 0.1293 - 5e-6, 0.01);
        assert_eq!(seen(&stage.take_shots()), [[(1.0, 4_000.0), (2.0, 6_000.0)]]);
    }

    #[test]
    fn before_the_first_pattern_and_after_the_last_it_is_dark() {
        let mut stage = stage();
        pulse(&mut stage, Line::Cam, 0.0, 0.01);
        for step in 0..5 {
            pulse(&mut stage, Line::Proj, 0.1 * f64::from(step + 1), 5e-6);
        }
        pulse(&mut stage, Line::Cam, 0.6, 0.01);
        assert_eq!(seen(&stage.take_shots()), [[], []]);
    }

    #[test]
    fn a_busy_camera_ignores_its_trigger_and_numbers_on() {
        let mut stage = stage();
        assert!(pulse(&mut stage, Line::Cam, 0.0, 0.01)[0].is_some());
        assert_eq!(pulse(&mut stage, Line::Cam, 0.02, 0.01), [None, None]);
        assert!(pulse(&mut stage, Line::Cam, 0.0361, 0.01)[0].is_some());
        let ids: Vec<u64> = stage.take_shots().iter().map(|shot| shot.id).collect();
        assert_eq!(ids, [0, 1]);
    }

    #[test]
    fn chance_is_the_same_for_the_same_patterns_and_another_for_a_repetition() {
        let seeds = |stage: &mut Stage| -> Vec<u64> {
            for shot in 0..3 {
                pulse(stage, Line::Cam, 0.1 * f64::from(shot), 0.01);
            }
            stage.take_shots().iter().map(|shot| shot.seed).collect()
        };
        let (mut first, mut second) = (stage(), stage());
        let drawn = seeds(&mut first);
        assert_eq!(drawn, seeds(&mut second));
        first.busy_until_s = f64::NEG_INFINITY;
        first.arm_camera();
        assert!(seeds(&mut first).iter().all(|seed| !drawn.contains(seed)));
    }
}
