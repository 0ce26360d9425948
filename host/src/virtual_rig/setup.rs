//! Which instrument a measurement is taken with.

use std::path::Path;
use std::sync::Arc;

use crate::base::blame::Blame;
use crate::brdf::sample::SampleError;
use crate::capture::Instrument;
use crate::capture::device::{Device, DeviceError, Patience};
use crate::capture::link::{self, Link};
use crate::instrument::calibration::Calibration;
use crate::instrument::rig::{Rig, RigError};
use crate::plan::{PlanError, Request};
use crate::virtual_rig::{Behaviour, Held, Mischief, Noise, Truth, VirtualRig, Wires, WiresError};

/// What the virtual rig holds unless told otherwise.
pub const DEFAULT_SAMPLE: &str = "ward:brass";

/// Why there is no instrument.
#[derive(Debug, thiserror::Error)]
pub enum SetupError {
    /// What is to be measured.
    #[error(transparent)]
    Plan(#[from] PlanError),
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
            Self::Plan(_) | Self::Truth(_) | Self::Sample(_) => true,
            Self::Device(error) => error.is_input(),
            Self::Wires(error) => matches!(error, WiresError::Address { .. }),
        }
    }
}

/// What the virtual rig is driven by, and what goes wrong in it.
#[derive(Clone, Debug, Default)]
pub struct Setup {
    /// The trigger box that drives it; `None` for the simulated one.
    pub trigger_box: Option<TriggerBox>,
    /// What goes wrong on purpose.
    pub mischief: Mischief,
    /// How the instrument really is, as far as calibration found out.
    pub calibration: Option<Calibration>,
}

/// A trigger box outside of this program.
#[derive(Clone, Debug)]
pub struct TriggerBox {
    /// Its port, as [`link::open`] takes it.
    pub port: String,
    /// `HOST:PORT` of the bridge that its lines end at; see [`Wires`].
    pub wires: String,
}

impl Setup {
    /// The instrument for `request`; `rig` is as [`Request::rig`] makes it. A run that the trigger box may still be busy
    /// with is aborted.
    ///
    /// # Errors
    /// [`SetupError`].
    pub fn open(&self, rig: &Rig, request: &Request) -> Result<Instrument, SetupError> {
        let spec = request.sample.as_deref().unwrap_or(DEFAULT_SAMPLE);
        self.open_held(
            rig,
            Held::Sample(Arc::from(crate::brdf::sample::parse(spec)?)),
            request,
        )
    }

    /// As [`open`](Self::open), with `held` in place of the sample.
    ///
    /// # Errors
    /// [`SetupError`].
    pub fn open_held(&self, rig: &Rig, held: Held, request: &Request) -> Result<Instrument, SetupError> {
        let truth = match &request.truth {
            Some(path) => {
                let truth = Truth::load(Path::new(path))?;
                Truth {
                    rig: request.rig(&truth.rig)?,
                    ..truth
                }
            }
            None => Truth::of(rig),
        };
        let behaviour = Behaviour {
            noise: if request.noise { Noise::On } else { Noise::Off },
            seed: request.seed,
            mischief: self.mischief,
        };
        let Some(TriggerBox { port, wires }) = &self.trigger_box else {
            return Ok(Instrument::simulated(&truth, held, behaviour)?);
        };
        let link = link::open(port).map_err(DeviceError::from)?;
        let mut device = Device::connect(link, link::nonce(), Patience::default())?;
        device.abort()?;
        let (camera, projector) = VirtualRig::wired(&truth, held, behaviour, Wires::connect(wires)?)?;
        Ok(Instrument {
            device,
            camera: Box::new(camera),
            projector: Box::new(projector),
        })
    }
}

impl Instrument {
    /// The virtual instrument that `truth` describes, with `held` in it.
    ///
    /// # Errors
    /// [`DeviceError`].
    pub fn simulated(truth: &Truth, held: Held, behaviour: Behaviour) -> Result<Self, DeviceError> {
        let VirtualRig {
            controller,
            camera,
            projector,
        } = VirtualRig::new(truth, held, behaviour);
        let link: Box<dyn Link> = Box::new(controller);
        let device = Device::connect(link, 1, Patience::default())?;
        Ok(Self {
            device,
            camera: Box::new(camera),
            projector: Box::new(projector),
        })
    }
}
