//! Which instrument a measurement is taken with.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};

use rand::{RngExt as _, SeedableRng as _};
use rand_xoshiro::Xoshiro256PlusPlus;

use crate::base::blame::Blame;
use crate::brdf::sample::{Sample, SampleError};
use crate::capture::Instrument;
use crate::capture::device::{Device, DeviceError, Patience};
use crate::capture::directory::{Sums, stamps_of, sums_of};
use crate::capture::link::Link;
use crate::capture::real::RealError;
use crate::capture::session::Opening;
use crate::capture::wiring::Wiring;
use crate::instrument::calibration::Calibration;
use crate::instrument::rig::{Rig, RigError, Tilt};
use crate::plan::Virtual;
use crate::store::whole_file::FileError;
use crate::virtual_rig::scene::Scene;
use crate::virtual_rig::scenes::Scenes;
use crate::virtual_rig::{
    Behaviour, Held, Noise, Truth, VirtualCamera, VirtualProjector, VirtualRig, Wires, WiresError,
};

/// Why there is no instrument.
#[derive(Debug, thiserror::Error)]
pub enum SetupError {
    /// A file that is named for the virtual rig.
    #[error(transparent)]
    File(#[from] FileError),
    /// A file that is named for the virtual rig became another while it was read.
    #[error("{path}: expected a file that stays as it is, found another after it was read")]
    Changed {
        /// The file.
        path: String,
    },
    /// The instrument that stands on a table.
    #[error(transparent)]
    Real(#[from] RealError),
    /// How the virtual rig really is.
    #[error(transparent)]
    Truth(#[from] RigError),
    /// The sample.
    #[error(transparent)]
    Sample(#[from] SampleError),
    /// The controller.
    #[error(transparent)]
    Device(#[from] DeviceError),
    /// The wires between the trigger box and the virtual rig.
    #[error(transparent)]
    Wires(#[from] WiresError),
}

impl Blame for SetupError {
    fn is_input(&self) -> bool {
        match self {
            Self::File(_) | Self::Changed { .. } | Self::Truth(_) | Self::Sample(_) => true,
            Self::Real(error) => error.is_input(),
            Self::Device(error) => error.is_input(),
            Self::Wires(error) => matches!(error, WiresError::Address { .. }),
        }
    }
}

/// What stands in the holder is changed within so many hours.
const OPENING_H: f64 = 0.02;

/// The instrument as it is asked for.
#[derive(Clone, Debug, Default)]
pub struct Setup {
    /// The virtual rig.
    pub virtual_rig: Virtual,
    /// The trigger box that drives it; `None` for the simulated one.
    pub trigger_box: Option<TriggerBox>,
    /// How the instrument really is, as far as calibration found out.
    pub calibration: Option<Calibration>,
    /// Who measures, when and with what; it is written into a measurement that begins.
    pub session: Option<Opening>,
}

/// A trigger box outside of this program.
#[derive(Clone, Debug)]
pub struct TriggerBox {
    /// Its port, as [`link::open`](crate::capture::link::open) takes it.
    pub port: String,
    /// `HOST:PORT` of the bridge that its lines end at; see [`Wires`].
    pub wires: String,
}

impl From<Virtual> for Setup {
    /// The virtual rig with the simulated trigger box.
    fn from(virtual_rig: Virtual) -> Self {
        Self {
            virtual_rig,
            ..Self::default()
        }
    }
}

impl Setup {
    /// The virtual rig that is asked for, with the trigger box that drives it.
    ///
    /// # Errors
    /// [`SetupError`] if a file that is named for it cannot be used.
    pub fn world(&self) -> Result<World, SetupError> {
        World::read(&self.virtual_rig, self.trigger_box.clone())
    }
}

/// The virtual rig, every file that is named for it read.
#[derive(Clone, Debug)]
pub struct World {
    /// The sample that stands in it.
    pub sample: Arc<dyn Sample>,
    /// Checksums of the files that were read.
    pub(crate) inputs: Sums,
    /// How it really is, without tilt and its camera image at full size; `None` if as the rig file says.
    truth: Option<Truth>,
    behaviour: Behaviour,
    /// How often the instrument was opened: each time takes some minutes of the lamp's life.
    opened: Arc<AtomicU32>,
    scenes: Scenes,
    trigger_box: Option<TriggerBox>,
}

impl World {
    /// The one that `spec` asks for, driven by the `trigger_box`, or the simulated one.
    ///
    /// # Errors
    /// [`SetupError`] if a file that is named for it cannot be used.
    pub fn read(spec: &Virtual, trigger_box: Option<TriggerBox>) -> Result<Self, SetupError> {
        let before = stamps_of(spec);
        let sample = Arc::from(crate::brdf::sample::parse(&spec.sample)?);
        let truth = spec
            .truth
            .as_ref()
            .map(|path| Truth::load(Path::new(path)))
            .transpose()?;
        // The sums come last: what can be read has an end.
        let inputs = sums_of(Some(spec))?;
        let changed = stamps_of(spec)
            .into_iter()
            .zip(before)
            .find(|(after, before)| after != before);
        if let Some(((path, _), _)) = changed {
            return Err(SetupError::Changed {
                path: path.display().to_string(),
            });
        }
        Ok(Self {
            sample,
            inputs,
            truth,
            behaviour: Behaviour {
                noise: if spec.noise { Noise::On } else { Noise::Off },
                seed: spec.seed,
                faults: spec.faults,
                // Each command begins at an hour of its own.
                lamp_h: Xoshiro256PlusPlus::seed_from_u64(!spec.seed).random_range(0.0..1.0),
            },
            opened: Arc::default(),
            scenes: Scenes::default(),
            trigger_box,
        })
    }

    /// How it really is, if its rig file says `rig`.
    #[must_use]
    pub fn truth(&self, rig: &Rig) -> Truth {
        self.truth.clone().unwrap_or_else(|| Truth::of(rig))
    }

    /// The same one as it is once somebody has moved its parts: as `truth` says.
    #[must_use]
    pub fn moved(&self, truth: Truth) -> Self {
        Self {
            truth: Some(truth),
            ..self.clone()
        }
    }

    /// What stands in the holder when the standard of this number, 0 or 1, does, which is said to be `stated`.
    #[must_use]
    pub fn standard(&self, number: usize, stated: Arc<dyn Sample>) -> Arc<dyn Sample> {
        match &self.truth {
            Some(truth) => truth.standard(number, stated),
            None => stated,
        }
    }

    /// Refuses a `rig` whose camera has other channels than the one that was drawn.
    ///
    /// # Errors
    /// [`SetupError::Truth`].
    pub fn check_camera(&self, rig: &Rig) -> Result<(), SetupError> {
        let drawn = self.truth.as_ref().map(|truth| truth.rig.camera.channels);
        match drawn.filter(|drawn| *drawn != rig.camera.channels) {
            None => Ok(()),
            Some(drawn) => Err(RigError::Field {
                path: rig.name.clone().into(),
                field: "camera.channels".to_owned(),
                expected: format!("{drawn} as in the truth"),
                found: rig.camera.channels.to_string(),
            }
            .into()),
        }
    }

    /// The instrument; `rig` has its sample tilted by `tilt` and its camera image scaled. A run that the trigger box may
    /// still be busy with is aborted.
    ///
    /// # Errors
    /// [`SetupError`].
    pub fn open(&self, rig: &Rig, tilt: Option<Tilt>) -> Result<Instrument, SetupError> {
        self.open_held(rig, Held::Sample(self.sample.clone()), tilt)
    }

    /// What decides what its frames show, beside what stands in it: one line.
    #[must_use]
    pub fn conditions(&self) -> String {
        let Behaviour { noise, seed, .. } = self.behaviour;
        let noise = if noise == Noise::On { "on" } else { "off" };
        let truth = self.inputs.get("truth");
        let truth = truth.map_or_else(
            || "as the rig file says".to_owned(),
            |sum| format!("a truth of SHA-256 {sum:.12}"),
        );
        format!("virtual rig, {truth}, seed {seed}, noise {noise}")
    }

    /// From now on as if it had been opened so many times: whoever goes on on another day finds it as one who never stopped.
    pub fn set_opened(&self, times: u32) {
        self.opened.store(times, Ordering::Relaxed);
    }

    /// How often it was opened.
    #[must_use]
    pub fn opened(&self) -> u32 {
        self.opened.load(Ordering::Relaxed)
    }

    /// As [`open`](Self::open), with `held` in place of the sample.
    ///
    /// # Errors
    /// [`SetupError`].
    pub fn open_held(&self, rig: &Rig, held: Held, tilt: Option<Tilt>) -> Result<Instrument, SetupError> {
        let (scene, truth, behaviour) = self.stood_up(rig, held, tilt)?;
        let Some(TriggerBox { port, wires }) = &self.trigger_box else {
            return Ok(Instrument::of(
                VirtualRig::of(scene, &truth, behaviour),
                &truth.rig,
            )?);
        };
        let mut device = Device::at(port)?;
        device.abort()?;
        let wires = Wires::connect(wires)?;
        let (camera, projector) = VirtualRig::wired(scene, &truth, behaviour, wires)?;
        Ok(Instrument {
            wiring: Wiring::default(),
            device,
            camera: Box::new(camera),
            projector: Box::new(projector),
            watching: Vec::new(),
            bands: truth.rig.shown_bands(),
        })
    }

    /// Its camera and projector alone with `held` in it, at the `wires` of a trigger box that somebody else talks to.
    ///
    /// # Errors
    /// [`SetupError`].
    pub fn optics(
        &self,
        rig: &Rig,
        held: Held,
        wires: Wires,
    ) -> Result<(VirtualCamera, VirtualProjector), SetupError> {
        let (scene, truth, behaviour) = self.stood_up(rig, held, None)?;
        Ok(VirtualRig::wired(scene, &truth, behaviour, wires)?)
    }

    /// What it shows with `held` in it, how it really is, and how it behaves; it is opened once more.
    fn stood_up(
        &self,
        rig: &Rig,
        held: Held,
        tilt: Option<Tilt>,
    ) -> Result<(Arc<Scene>, Truth, Behaviour), SetupError> {
        let mut truth = match &self.truth {
            Some(truth) => Truth {
                rig: truth
                    .rig
                    .tilted(tilt)?
                    .with_image_size(rig.camera.lens.width_px)?,
                ..truth.clone()
            },
            None => Truth::of(rig),
        };
        self.check_camera(rig)?;
        // Which bands are shown the rig file decides, whatever it was when the truth was drawn.
        truth.rig.bands.clone_from(&rig.bands);
        let (seating, seed) = (truth.flaws.seating, self.behaviour.seed);
        let mut held = held;
        match &mut held {
            Held::Sample(sample) => seating.seat(&mut truth.rig, sample.as_ref(), tilt, seed),
            Held::Mirror(mirror) => mirror.normal = seating.lean(mirror.normal, seed),
            Held::Trap => {}
        }
        let opened = self.opened.fetch_add(1, Ordering::Relaxed);
        let behaviour = Behaviour {
            lamp_h: self.behaviour.lamp_h + f64::from(opened) * OPENING_H,
            ..self.behaviour
        };
        let scene = self.scenes.of(&truth, held);
        Ok((scene, truth, behaviour))
    }
}

impl Instrument {
    /// The virtual instrument that `truth` describes, with `held` in it.
    ///
    /// # Errors
    /// [`DeviceError`].
    pub fn simulated(truth: &Truth, held: Held, behaviour: Behaviour) -> Result<Self, DeviceError> {
        Self::of(VirtualRig::new(truth, held, behaviour), &truth.rig)
    }

    fn of(simulated: VirtualRig, rig: &Rig) -> Result<Self, DeviceError> {
        let VirtualRig {
            controller,
            camera,
            projector,
        } = simulated;
        let link: Box<dyn Link> = Box::new(controller);
        let device = Device::connect(link, 1, Patience::default())?;
        Ok(Self {
            wiring: Wiring::default(),
            device,
            camera: Box::new(camera),
            projector: Box::new(projector),
            watching: Vec::new(),
            bands: rig.shown_bands(),
        })
    }
}
