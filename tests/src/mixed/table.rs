//! Projector and camera at the pins of the box, of which a frame says what it saw.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::Duration;

use rand::{RngExt, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;
use rcg::capture::camera::{Camera, CameraError, Frame};
use rcg::capture::projector::{Projector, ProjectorError};
use rcg::instrument::frame_format::FrameFormat;
use rcg::plan::pattern::BitPattern;
use rcg::plan::schedule::Timing;
use rcg_firmware::pulse::Edge;
use rcg_firmware::virtual_time::{Pins, StrobeEdge};
use rcg_protocol::{Level, Line, Ticks};

use crate::controller::TICK_NS;

/// Pixels of the projector along a side.
const SIDE: usize = 64;
/// A pattern that is black has this number.
const BLACK: u16 = u16::MAX;
/// From the leading edge of CAM to the beginning of the exposure, 2 µs.
const DELAY: Ticks = Ticks(250);

/// The pixel that is lit in `pattern`.
#[must_use]
pub const fn pixel_of(pattern: usize) -> u32 {
    pattern as u32
}

/// What a frame saw.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Seen {
    pattern: u16,
    /// Exposure time in µs.
    exposure_us: u16,
}

impl Seen {
    /// What an exposure of `pattern` with this `timing` shall see.
    #[must_use]
    pub fn new(pattern: usize, timing: &Timing) -> Self {
        Self {
            pattern: pattern as u16,
            exposure_us: (timing.cam_width_s * 1e6).round() as u16,
        }
    }

    /// What a frame with these digital numbers saw.
    #[must_use]
    pub fn of(dn: &[u16]) -> Self {
        Self {
            pattern: dn[0],
            exposure_us: dn[1],
        }
    }
}

/// What goes wrong with camera and clocks. Probabilities are per exposure, but for what is said otherwise.
#[derive(Clone, Copy, Debug, Default)]
pub struct Faults {
    /// A trigger is ignored.
    pub ignore: f64,
    /// A frame is lost.
    pub drop: f64,
    /// A frame comes twice.
    pub double: f64,
    /// A frame comes behind the next one.
    pub reorder: f64,
    /// A frame comes when the run is over.
    pub late: f64,
    /// The camera exposes without a trigger, as the pattern changes.
    pub spurious: f64,
    /// The camera dies, until it is opened again.
    pub die: f64,
    /// Its clock jumps.
    pub jump: f64,
    /// Its numbers begin anew, or go on elsewhere.
    pub renumber: f64,
    /// Per run: its numbers begin at another than 0.
    pub other_base: f64,
    /// Its clock is fast by this much.
    pub clock_ppm: f64,
    /// Per run: the projector has lost its patterns, and says so.
    pub lost_patterns: f64,
}

impl Faults {
    /// Any mixture.
    #[must_use]
    pub fn any(seed: u64) -> Self {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed);
        let mut maybe = |most: f64| {
            if rng.random_bool(0.5) {
                rng.random_range(0.0..most)
            } else {
                0.0
            }
        };
        let faults = Self {
            ignore: maybe(0.03),
            drop: maybe(0.03),
            double: maybe(0.03),
            reorder: maybe(0.02),
            late: maybe(0.02),
            spurious: maybe(0.02),
            die: maybe(0.002),
            jump: maybe(0.01),
            renumber: maybe(0.005),
            other_base: maybe(0.1),
            clock_ppm: 0.0,
            lost_patterns: maybe(0.02),
        };
        Self {
            clock_ppm: rng.random_range(-200.0..200.0),
            ..faults
        }
    }
}

/// What stands at the pins.
#[derive(Debug)]
struct State {
    faults: Faults,
    rng: Xoshiro256PlusPlus,
    patterns: Vec<u16>,
    next: usize,
    showing: u16,
    levels: [Level; 2],
    /// Since when the shutter is open.
    open: Option<Ticks>,
    /// An exposure that nobody asked for.
    stray: Option<Ticks>,
    /// Number of the next frame.
    next_id: u64,
    /// The camera's clock less the box's, s.
    ahead_s: f64,
    begun: u64,
    dead: bool,
    frames: VecDeque<Frame>,
    /// Those that come when the run is over.
    late: VecDeque<Frame>,
}

/// Projector and camera at the pins.
#[derive(Clone, Debug)]
pub struct Table(Arc<Mutex<State>>);

impl Table {
    /// One with these faults, drawn from `seed`.
    #[must_use]
    pub fn new(faults: Faults, seed: u64) -> Self {
        Self(Arc::new(Mutex::new(State {
            faults,
            rng: Xoshiro256PlusPlus::seed_from_u64(seed),
            patterns: Vec::new(),
            next: 0,
            showing: BLACK,
            levels: [Level::Inactive; 2],
            open: None,
            stray: None,
            next_id: 0,
            ahead_s: 1000.0,
            begun: 0,
            dead: false,
            frames: VecDeque::new(),
            late: VecDeque::new(),
        })))
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.0.lock().expect("no test goes on after a panic")
    }

    /// Its camera.
    #[must_use]
    pub fn camera(&self) -> impl Camera + use<> {
        TableCamera(self.clone())
    }

    /// Its projector.
    #[must_use]
    pub fn projector(&self) -> impl Projector + use<> {
        TableProjector(self.clone())
    }

    /// Exposures that were asked for.
    #[must_use]
    pub fn exposures(&self) -> u64 {
        self.state().begun
    }

    /// Whether both outputs are.
    #[must_use]
    pub fn is_at_rest(&self) -> bool {
        self.state().levels == [Level::Inactive; 2]
    }

    /// Both outputs come to rest, as without supply.
    pub(super) fn rest(&self) {
        let mut state = self.state();
        state.levels = [Level::Inactive; 2];
        (state.open, state.stray) = (None, None);
    }
}

impl State {
    fn chance(&mut self, of: impl Fn(&Faults) -> f64) -> bool {
        let chance = of(&self.faults);
        self.rng.random_bool(chance)
    }

    fn expose(&mut self, from: Ticks, to: Ticks) {
        if self.chance(|faults| faults.jump) {
            // Mostly by about as much as lies between two exposures, where it does most harm.
            self.ahead_s += self.rng.random_range(-4e-3..4e-3);
        }
        if self.chance(|faults| faults.renumber) {
            self.next_id = if self.rng.random_bool(0.5) {
                0
            } else {
                self.next_id.saturating_add_signed(self.rng.random_range(-3..=3))
            };
        }
        let from_s = from.0 as f64 * TICK_NS as f64 * 1e-9;
        let exposure_us = (to.0 - from.0) as f64 * TICK_NS as f64 * 1e-3;
        let frame = Frame {
            id: self.next_id,
            timestamp_s: self.ahead_s + from_s * (1.0 + 1e-6 * self.faults.clock_ppm),
            dn: vec![self.showing, exposure_us.round() as u16],
        };
        self.next_id += 1;
        if self.chance(|faults| faults.drop) {
            return;
        }
        if self.chance(|faults| faults.late) {
            self.late.push_back(frame);
            return;
        }
        if self.chance(|faults| faults.double) {
            self.frames.push_back(frame.clone());
        }
        let at =
            self.frames.len() - usize::from(!self.frames.is_empty() && self.chance(|faults| faults.reorder));
        self.frames.insert(at, frame);
    }

    fn advance(&mut self, at: Ticks) -> Option<StrobeEdge> {
        self.showing = self.patterns.get(self.next).copied().unwrap_or(BLACK);
        self.next += 1;
        (!self.dead && self.chance(|faults| faults.spurious)).then(|| {
            self.stray = Some(at);
            StrobeEdge { at, active: true }
        })
    }

    fn open(&mut self, at: Ticks) -> Option<StrobeEdge> {
        self.begun += 1;
        self.dead |= self.chance(|faults| faults.die);
        if self.dead || self.chance(|faults| faults.ignore) {
            return None;
        }
        let at = at + DELAY;
        self.open = Some(at);
        Some(StrobeEdge { at, active: true })
    }

    fn close(&mut self, at: Ticks, opened: Option<Ticks>) -> Option<StrobeEdge> {
        let from = opened?;
        self.expose(from, at);
        Some(StrobeEdge { at, active: false })
    }
}

impl Pins for Table {
    fn edge(&mut self, edge: Edge) -> Option<StrobeEdge> {
        let mut state = self.state();
        let line = match edge.line {
            Line::Proj => 0,
            Line::Cam => 1,
            _ => return None,
        };
        state.levels[line] = edge.level;
        match (edge.line, edge.level) {
            (Line::Proj, Level::Active) => state.advance(edge.at),
            (Line::Proj, Level::Inactive) => {
                let stray = state.stray.take();
                state.close(edge.at, stray)
            }
            (_, Level::Active) => state.open(edge.at),
            (_, Level::Inactive) => {
                let open = state.open.take();
                state.close(edge.at + DELAY, open)
            }
        }
    }

    fn next_sync(&mut self, _from: Ticks) -> Option<Ticks> {
        None
    }
}

struct TableCamera(Table);

impl Camera for TableCamera {
    fn name(&self) -> &'static str {
        "table"
    }

    fn format(&self) -> FrameFormat {
        FrameFormat {
            width_px: 2,
            height_px: 1,
            channels: 1,
            bits: 16,
        }
    }

    fn arm(&mut self) -> Result<(), CameraError> {
        let mut state = self.0.state();
        state.dead = false;
        state.frames.clear();
        state.late.clear();
        state.next_id = if state.chance(|faults| faults.other_base) {
            state.rng.random_range(1..4)
        } else {
            0
        };
        Ok(())
    }

    fn next_frame(&mut self, timeout: Duration) -> Result<Option<Frame>, CameraError> {
        let mut state = self.0.state();
        if state.dead {
            return Err(CameraError::Disconnected {
                camera: "table".to_owned(),
            });
        }
        let next = state.frames.pop_front();
        Ok(next.or_else(|| (!timeout.is_zero()).then(|| state.late.pop_front()).flatten()))
    }
}

struct TableProjector(Table);

impl Projector for TableProjector {
    fn name(&self) -> &'static str {
        "table"
    }

    fn size_px(&self) -> (usize, usize) {
        (SIDE, SIDE)
    }

    fn capacity(&self) -> usize {
        4096
    }

    fn clear(&mut self) -> Result<(), ProjectorError> {
        let mut state = self.0.state();
        state.patterns.clear();
        (state.next, state.showing) = (0, BLACK);
        Ok(())
    }

    fn load(&mut self, pattern: &BitPattern) -> Result<(), ProjectorError> {
        let number = pattern.lit().first().map_or(BLACK, |pixel| *pixel as u16);
        self.0.state().patterns.push(number);
        Ok(())
    }

    fn ready(&mut self) -> Result<(), ProjectorError> {
        let mut state = self.0.state();
        (state.next, state.showing) = (0, BLACK);
        if state.chance(|faults| faults.lost_patterns) {
            return Err(ProjectorError::Failed {
                projector: "table".to_owned(),
                reason: "expected the patterns that were loaded, found none".to_owned(),
            });
        }
        Ok(())
    }
}
