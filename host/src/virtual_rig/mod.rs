//! The virtual rig: mirror, sample, projector and camera that a controller's *edges* drive.
//!
//! # Design
//! It knows nothing of the schedule. A PROJ edge advances the pattern, which holds from the end of its
//! settling time on; a CAM pulse exposes for as long as it lasts, after the camera's delay; each image is
//! the sum over all patterns that were visible during the exposure, weighted by how long. So wrong timing
//! smears patterns into each other as it would in the lab.
//!
//! - `stage`: edges → which pattern was lit for how long in which exposure
//! - `light`: lit pixels → light at the sample
//! - `scene`: light and sample → charge of every camera pixel
//! - `scenes`: those that were shown before
//! - `areas`: what part of the sample a pixel sees and a spot lights
//! - `stray`: light that goes other ways: glare, ghost and direct light
//! - `crosstalk`: charge that leaks between colours
//! - `lag`: what is left of the pattern before
//! - `polarisation`: how far light is polarised, and what surfaces make of it
//! - `knee`: how the camera's response bends near its full well
//! - `held`: what stands in the holder: a sample or, for calibration, a flat mirror
//! - `interreflection`: light that leaves the sample and comes back onto it
//! - `seating`: where what is put into the holder comes to lie
//! - `figure`: where the mirror is not the ellipsoid
//! - `flaws`: imperfections that no rig file has
//! - `tolerances`: how far rigs stray from what they should be
//! - `truth`: how the rig really is, if that is not what its rig file says
//! - `sensor`: charge → digital numbers, with noise
//! - `pixels`: what the sensor's pixels differ by
//! - `controller`: the firmware's own library in virtual time
//! - `wires`: the edges of a trigger box elsewhere, in place of the simulated one
//!
//! Everything is a function of the rig, the sample and a seed: the same measurement, even if it was
//! interrupted and resumed, gives the same bits.

mod areas;
mod controller;
mod crosstalk;
mod figure;
mod flaws;
mod held;
mod interreflection;
mod knee;
mod lag;
mod light;
mod pixels;
mod polarisation;
mod scene;
mod scenes;
mod seating;
mod sensor;
pub mod setup;
mod stage;
mod stray;
mod tolerances;
mod truth;
mod wires;

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use rayon::prelude::*;

use crate::capture::camera::{Camera, CameraError, Frame};
use crate::capture::projector::{Projector, ProjectorError, check_resolution};
use crate::instrument::frame_format::FrameFormat;
use crate::instrument::rig::Rig;
use crate::plan::Faults;
use crate::plan::pattern::BitPattern;

pub use controller::{CLOCK_HZ, VirtualController};
pub use crosstalk::{CROSSTALKS, Crosstalk};
pub use figure::{FIGURES_RAD, Figure};
pub use flaws::{
    BLURS_PX, CONTRASTS, DRIFTS, Direct, FALLOFFS, FLICKERS, Field, Flaws, Focus, GHOSTS, GLARES, Ghost,
    Glare, Lamp, PRNUS, Pixels, Pupils, ROW_NOISES_E, WANDERS_E,
};
pub use held::{FlatMirror, Held};
pub use knee::{KNEES, Knee};
pub use lag::{LAGS, Lag};
pub use polarisation::{POLARISATIONS, Polarisation};
pub use seating::{SEATINGS_M, Seating, TILTS_DEG};
pub use sensor::Noise;
pub use tolerances::{PixelTolerances, Tolerances};
pub use truth::Truth;
pub use wires::{Wires, WiresError};

use scene::Scene;
use sensor::Sensor;
use stage::{Shot, Stage};
use wires::Attached;

/// How the virtual rig behaves beyond what its rig file says.
#[derive(Clone, Copy, Debug)]
pub struct Behaviour {
    /// Shot and read noise.
    pub noise: Noise,
    /// Source of all chance.
    pub seed: u64,
    /// What goes wrong on purpose.
    pub faults: Faults,
    /// How many hours lamp and camera have been on.
    pub lamp_h: f64,
}

/// The three simulated ends of one rig.
pub struct VirtualRig {
    /// To be opened by a [`Device`](crate::capture::device::Device).
    pub controller: VirtualController,
    /// Its camera.
    pub camera: VirtualCamera,
    /// Its projector.
    pub projector: VirtualProjector,
}

impl VirtualRig {
    /// The rig that `truth` describes, with `held` in it.
    #[must_use]
    pub fn new(truth: &Truth, held: Held, behaviour: Behaviour) -> Self {
        Self::of(Arc::new(Scene::new(truth, held)), truth, behaviour)
    }

    /// The rig that `truth` describes, which shows this `scene`.
    fn of(scene: Arc<Scene>, truth: &Truth, behaviour: Behaviour) -> Self {
        let stage = SharedStage::new(truth, behaviour, CLOCK_HZ);
        let (camera, projector) = optics_of(scene, behaviour, &stage);
        Self {
            controller: VirtualController::new(stage, behaviour.seed as u32),
            camera,
            projector,
        }
    }

    /// Camera and projector of such a rig, at the wires of a trigger box elsewhere.
    ///
    /// # Errors
    /// [`WiresError`].
    fn wired(
        scene: Arc<Scene>,
        truth: &Truth,
        behaviour: Behaviour,
        wires: Wires,
    ) -> Result<(VirtualCamera, VirtualProjector), WiresError> {
        let stage = SharedStage::new(truth, behaviour, wires.clock_hz());
        let (mut camera, projector) = optics_of(scene, behaviour, &stage);
        camera.wires = Some(wires.attach(stage)?);
        Ok((camera, projector))
    }
}

/// Digital numbers of pixels of `rig`'s camera that collected `signal_e` electrons of light in `exposure_s` seconds.
#[must_use]
pub fn sense(rig: &Rig, signal_e: &[f32], exposure_s: f64, noise: Noise, seed: u64) -> Vec<u16> {
    Sensor::of(rig).digitise(signal_e, &[], exposure_s, noise, seed)
}

fn optics_of(
    scene: Arc<Scene>,
    behaviour: Behaviour,
    stage: &SharedStage,
) -> (VirtualCamera, VirtualProjector) {
    let camera = VirtualCamera {
        stage: stage.clone(),
        scene: scene.clone(),
        behaviour,
        ready: Vec::new().into_iter(),
        wires: None,
    };
    let stage = stage.clone();
    (camera, VirtualProjector { stage, scene })
}

impl VirtualController {
    /// A controller whose camera and projector nobody looks at, for work on the trigger box alone.
    #[must_use]
    pub fn alone(rig: &Rig) -> Self {
        let behaviour = Behaviour {
            noise: Noise::Off,
            seed: 0,
            faults: Faults::default(),
            lamp_h: 0.0,
        };
        Self::new(SharedStage::new(&Truth::of(rig), behaviour, CLOCK_HZ), 0)
    }
}

/// The stage as camera, projector and controller share it.
#[derive(Clone)]
struct SharedStage(Arc<Mutex<Stage>>);

impl SharedStage {
    fn new(truth: &Truth, behaviour: Behaviour, clock_hz: u32) -> Self {
        Self(Arc::new(Mutex::new(Stage::new(truth, behaviour, clock_hz))))
    }

    fn lock(&self) -> MutexGuard<'_, Stage> {
        // A panic elsewhere leaves the stage as it was between two edges.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Images of 256 × 256 pixels that are computed at a time, fewer of larger ones: all cores are busy, and the host is never
/// silent for long in between.
const IMAGES: usize = 64;

/// The simulated camera. Images are computed when they are fetched, on all cores.
pub struct VirtualCamera {
    stage: SharedStage,
    scene: Arc<Scene>,
    behaviour: Behaviour,
    ready: std::vec::IntoIter<Frame>,
    /// The wires, where the edges come from elsewhere.
    wires: Option<Attached>,
}

impl Camera for VirtualCamera {
    fn name(&self) -> &'static str {
        "virtual"
    }

    fn format(&self) -> FrameFormat {
        self.scene.format()
    }

    fn arm(&mut self) -> Result<(), CameraError> {
        self.ready = Vec::new().into_iter();
        self.stage.lock().arm_camera();
        Ok(())
    }

    fn begin_part(&mut self, same_before: u64) {
        self.stage.lock().begin_part(same_before);
    }

    fn next_frame(&mut self, _timeout: Duration) -> Result<Option<Frame>, CameraError> {
        if self.ready.len() == 0 {
            // Asked first: once the wires have ended nothing comes behind the shots that are taken then.
            let failure = self
                .wires
                .as_mut()
                .and_then(Attached::failure)
                .map(ToString::to_string);
            let format = self.scene.format();
            let pixels = format.width_px * format.height_px;
            let cores = rayon::current_num_threads().min(IMAGES);
            // At real wires the dead-man time is real too, however slow or busy this machine is.
            let images = match self.wires {
                Some(_) => cores,
                None => (IMAGES * 65_536 / pixels).clamp(cores, IMAGES),
            };
            let shots: Vec<Shot> = self.stage.lock().take_shots(images);
            let frames: Vec<Frame> = shots
                .into_par_iter()
                .map(|shot| Frame {
                    id: shot.id,
                    timestamp_s: shot.timestamp_s,
                    dn: self.scene.frame(&shot, self.behaviour.noise),
                })
                .collect();
            self.ready = frames.into_iter();
            if self.ready.len() == 0
                && let Some(reason) = failure
            {
                return Err(CameraError::Failed {
                    camera: "virtual".to_owned(),
                    reason,
                });
            }
        }
        Ok(self.ready.next())
    }
}

/// The simulated projector.
pub struct VirtualProjector {
    stage: SharedStage,
    scene: Arc<Scene>,
}

impl Projector for VirtualProjector {
    fn name(&self) -> &'static str {
        "virtual"
    }

    fn size_px(&self) -> (usize, usize) {
        self.scene.projector_size_px()
    }

    fn capacity(&self) -> usize {
        4096
    }

    fn clear(&mut self) -> Result<(), ProjectorError> {
        self.stage.lock().clear_patterns();
        Ok(())
    }

    fn load(&mut self, pattern: &BitPattern) -> Result<(), ProjectorError> {
        check_resolution(self.name(), self.size_px(), pattern)?;
        let lit = pattern.lit();
        let light = self.scene.light(pattern, &lit);
        let look = (pattern.level(), pattern.primary());
        self.stage.lock().load_pattern(&lit, look, light);
        Ok(())
    }
}
