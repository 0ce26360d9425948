//! Which instrument a measurement is taken with.

use std::sync::Arc;

use crate::capture::Instrument;
use crate::device::{Device, DeviceError, Patience};
use crate::link::{self, Link};
use crate::measure::{DEFAULT_SAMPLE, MeasureError};
use crate::plan::Request;
use crate::rig::Rig;
use crate::sample::Sample;
use crate::virtual_rig::{Behaviour, Mischief, Noise, VirtualRig, Wires};

/// What the virtual rig is driven by, and what goes wrong in it.
#[derive(Clone, Debug, Default)]
pub struct Setup {
    /// The trigger box that drives it; `None` for the simulated one.
    pub trigger_box: Option<TriggerBox>,
    /// What goes wrong on purpose.
    pub mischief: Mischief,
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
    /// The instrument for `request`; `rig` has its camera image scaled. A run that the trigger box may still be busy
    /// with is aborted.
    ///
    /// # Errors
    /// [`MeasureError`].
    pub fn open(&self, rig: &Rig, request: &Request) -> Result<Instrument, MeasureError> {
        let spec = request.sample.as_deref().unwrap_or(DEFAULT_SAMPLE);
        let sample: Arc<dyn Sample> = Arc::from(crate::sample::parse(spec)?);
        let behaviour = Behaviour {
            noise: if request.noise { Noise::On } else { Noise::Off },
            seed: request.seed,
            mischief: self.mischief,
        };
        let Some(TriggerBox { port, wires }) = &self.trigger_box else {
            return Ok(Instrument::simulated(rig, sample, behaviour)?);
        };
        let link = link::open(port).map_err(DeviceError::from)?;
        let mut device = Device::connect(link, link::nonce(), Patience::default())?;
        device.abort()?;
        let (camera, projector) = VirtualRig::wired(rig, sample, behaviour, Wires::connect(wires)?)?;
        Ok(Instrument {
            device,
            camera: Box::new(camera),
            projector: Box::new(projector),
        })
    }
}

impl Instrument {
    /// A virtual instrument that is truly as `rig` says, with `sample` in it.
    ///
    /// # Errors
    /// [`DeviceError`].
    pub fn simulated(rig: &Rig, sample: Arc<dyn Sample>, behaviour: Behaviour) -> Result<Self, DeviceError> {
        let VirtualRig {
            controller,
            camera,
            projector,
        } = VirtualRig::new(rig, sample, behaviour);
        let link: Box<dyn Link> = Box::new(controller);
        let device = Device::connect(link, 1, Patience::default())?;
        Ok(Self {
            device,
            camera: Box::new(camera),
            projector: Box::new(projector),
        })
    }
}
