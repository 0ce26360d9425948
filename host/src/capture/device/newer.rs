//! What not every trigger box can be asked, as older firmware does not know it.

use rcg_protocol::{Aux, AuxPolarity, Inputs, Photo, Polarity, Reply, Request, Ticks, Unit};

use super::{Device, DeviceError};
use crate::capture::link::Link;

/// The version with [`Request::Identify`] and [`Request::Filter`].
const UNIT_SINCE: u16 = 2;

/// The version that tells what stands at the inputs, goes to its boot loader and keeps a polarity.
const INPUTS_SINCE: u16 = 3;

/// The version with AUX-A, AUX-B, PHOTO and START, and runs that repeat.
const AUX_SINCE: u16 = 4;

impl<L: Link> Device<L> {
    /// Which box it is; `None` if its firmware is too old to say.
    ///
    /// # Errors
    /// [`DeviceError`].
    pub fn unit(&mut self) -> Result<Option<Unit>, DeviceError> {
        if self.protocol < UNIT_SINCE {
            return Ok(None);
        }
        match self.ask(&Request::Identify)? {
            Reply::Unit(unit) => Ok(Some(unit)),
            other => Err(self.wrong_reply("identify", &other)),
        }
    }

    /// Takes STROBE for what it was where it changes for less than `shortest`, from the next [`arm`](Self::arm) on until the end of
    /// the session.
    ///
    /// # Errors
    /// [`DeviceError`]; [`DeviceError::Older`] if the firmware is too old for it.
    pub fn filter_strobe(&mut self, shortest: Ticks) -> Result<(), DeviceError> {
        self.needs(UNIT_SINCE, "filters STROBE")?;
        self.ask_status(&Request::Filter { strobe: shortest }).map(|_| ())
    }

    /// Counts edges of the inputs from now on, until the next [`arm`](Self::arm).
    ///
    /// # Errors
    /// [`DeviceError`]; [`DeviceError::Older`] if the firmware is too old for it, and a refusal while a run goes on.
    pub fn watch(&mut self) -> Result<(), DeviceError> {
        self.needs(INPUTS_SINCE, "counts edges of its inputs")?;
        self.ask_status(&Request::Watch).map(|_| ())
    }

    /// What stands at the inputs, in a run and between two.
    ///
    /// # Errors
    /// [`DeviceError`]; [`DeviceError::Older`] if the firmware is too old for it.
    pub fn inputs(&mut self) -> Result<Inputs, DeviceError> {
        self.needs(INPUTS_SINCE, "tells what stands at its inputs")?;
        match self.ask(&Request::Inputs)? {
            Reply::Inputs(inputs) => Ok(inputs),
            other => Err(self.wrong_reply("inputs", &other)),
        }
    }

    /// Lets the box go to its boot loader: it is not there any more some 50 ms later.
    ///
    /// # Errors
    /// [`DeviceError`]; [`DeviceError::Older`] if the firmware is too old for it, and a refusal while a run goes on.
    pub fn boot(&mut self) -> Result<(), DeviceError> {
        self.needs(INPUTS_SINCE, "goes to its boot loader by itself")?;
        self.ask_status(&Request::Boot).map(|_| ())
    }

    /// Lets the box keep `polarity` over resets, so that its lines rest like that from its boot on.
    ///
    /// # Errors
    /// [`DeviceError`]; [`DeviceError::Older`] if the firmware is too old for it, and a refusal while a run goes on.
    pub fn keep(&mut self, polarity: Polarity) -> Result<(), DeviceError> {
        self.needs(INPUTS_SINCE, "keeps a polarity")?;
        self.ask_status(&Request::Keep(polarity)).map(|_| ())
    }

    /// The polarity that the box keeps over resets.
    ///
    /// # Errors
    /// [`DeviceError`]; [`DeviceError::Older`] if the firmware is too old for it.
    pub fn kept(&mut self) -> Result<Polarity, DeviceError> {
        self.needs(INPUTS_SINCE, "keeps a polarity")?;
        match self.ask(&Request::Kept)? {
            Reply::Kept(polarity) => Ok(polarity),
            other => Err(self.wrong_reply("kept", &other)),
        }
    }

    /// Lets the further lines do this in the schedules that are [loaded](Self::load) from now on, until the end of the session.
    ///
    /// # Errors
    /// [`DeviceError`]; [`DeviceError::Older`] if the firmware is too old for it.
    pub fn aux(&mut self, aux: &Aux) -> Result<(), DeviceError> {
        self.needs(AUX_SINCE, "has the lines AUX-A, AUX-B and PHOTO")?;
        self.ask_status(&Request::Aux(*aux)).map(|_| ())
    }

    /// Lets the box keep this polarity of the further lines over resets, as [`keep`](Self::keep) does of the others.
    ///
    /// # Errors
    /// [`DeviceError`]; [`DeviceError::Older`] if the firmware is too old for it, and a refusal while a run goes on.
    pub fn keep_aux(&mut self, polarity: AuxPolarity) -> Result<(), DeviceError> {
        self.needs(AUX_SINCE, "has the lines AUX-A, AUX-B and PHOTO")?;
        self.ask_status(&Request::KeepAux(polarity)).map(|_| ())
    }

    /// The polarity of the further lines that the box keeps over resets.
    ///
    /// # Errors
    /// [`DeviceError`]; [`DeviceError::Older`] if the firmware is too old for it.
    pub fn kept_aux(&mut self) -> Result<AuxPolarity, DeviceError> {
        self.needs(AUX_SINCE, "has the lines AUX-A, AUX-B and PHOTO")?;
        match self.ask(&Request::KeptAux)? {
            Reply::KeptAux(polarity) => Ok(polarity),
            other => Err(self.wrong_reply("kept", &other)),
        }
    }

    /// What stands at PHOTO, in a run and between two, and how many of its pulses the present or last run was to tell of.
    ///
    /// # Errors
    /// [`DeviceError`]; [`DeviceError::Older`] if the firmware is too old for it.
    pub fn photo(&mut self) -> Result<Photo, DeviceError> {
        self.needs(AUX_SINCE, "has the lines AUX-A, AUX-B and PHOTO")?;
        match self.ask(&Request::Photo)? {
            Reply::Photo(photo) => Ok(photo),
            other => Err(self.wrong_reply("photo", &other)),
        }
    }

    /// Lets a run of a table that is done begin again by itself, as a run of its own, until there were `runs`; 0 for ever. From the
    /// next [`arm`](Self::arm) on, until the end of the session.
    ///
    /// # Errors
    /// [`DeviceError`]; [`DeviceError::Older`] if the firmware is too old for it.
    pub fn repeat(&mut self, runs: u32) -> Result<(), DeviceError> {
        self.needs(AUX_SINCE, "repeats runs")?;
        self.ask_status(&Request::Repeat { runs }).map(|_| ())
    }

    /// Whether the box can be told of a line START, which begins a run.
    ///
    /// # Errors
    /// [`DeviceError::Older`] if the firmware is too old for it.
    pub fn needs_start(&self) -> Result<(), DeviceError> {
        self.needs(AUX_SINCE, "begins a run on START")
    }

    /// The controller speaks version `since` or a later one, which does `what`.
    pub(super) fn needs(&self, since: u16, what: &'static str) -> Result<(), DeviceError> {
        if self.protocol >= since {
            return Ok(());
        }
        Err(DeviceError::Older {
            peer: self.link.peer().to_owned(),
            what,
            since,
            version: self.protocol,
        })
    }
}
