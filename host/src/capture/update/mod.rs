//! Another firmware for the trigger box: it goes to its boot loader, takes a UF2 file there, and comes back.
//!
//! # Design
//! The file is checked before the box is asked for anything ([`Uf2::check`]), and what comes back has to say that it is what was
//! written. The box leaves by a request or, where it speaks another version, by the port's speed being set to 1200 baud, a custom of
//! such boxes. Its boot loader then shows a drive.
//!
//! # Tradeoffs
//! Drives have no number that the box tells before it leaves. So that no other board is written to, a drive that was there before is
//! taken only where no box is.

#[cfg(all(test, unix))]
mod tests;
mod volume;

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};
use std::{fs, io, thread};

pub use rcg_firmware::uf2::{About, Uf2, Uf2Error};
use rcg_protocol::{Chip, Unit};

use crate::base::blame::Blame;
use crate::capture::device::{Device, DeviceError, Patience};
use crate::capture::link::{self, Link, LinkError, SerialLink};

pub use volume::Volume;

/// How long a box may take until its drive appears, or until it is back.
pub const PATIENCE: Duration = Duration::from_secs(20);

/// How often it is looked for.
const LOOK: Duration = Duration::from_millis(50);

/// One that answers does so at once.
const GREETING: Patience = Patience {
    timeout: Duration::from_millis(200),
    attempts: 3,
};

/// Why the firmware is not another one, or it is not known whether it is.
#[derive(Debug, thiserror::Error)]
pub enum UpdateError {
    /// The file with the firmware cannot be read.
    #[error("{}: expected a UF2 file, found: {source}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// The file is no firmware of the trigger box.
    #[error("{}: {error}", path.display())]
    NoFirmware {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        error: Uf2Error,
    },
    /// The trigger box.
    #[error(transparent)]
    Device(#[from] DeviceError),
    /// It cannot be asked to leave.
    #[error(
        "{error}; or hold its BOOTSEL button while you plug it in, and start this again while its drive is there"
    )]
    TooOld {
        /// Why.
        error: DeviceError,
    },
    /// It is for another chip.
    #[error("expected firmware for the {found} of this trigger box, found a file for the {chip}")]
    OtherChip {
        /// That of the file.
        chip: Chip,
        /// That of the box.
        found: Chip,
    },
    /// A boot loader is there beside a box.
    #[error(
        "{}: expected no drive of a boot loader before the trigger box goes to its own, found one: take it away, or the box if \
         the drive is what is meant", path.display()
    )]
    DriveBefore {
        /// The drive.
        path: PathBuf,
    },
    /// No drive of a boot loader appeared.
    #[error("expected the drive of the {chip}'s boot loader{}, found none in {waited_s} s{hint}", at(.place.as_deref()))]
    NoDrive {
        /// The chip.
        chip: Chip,
        /// Where it was expected, if that was said.
        place: Option<PathBuf>,
        /// How long, in seconds.
        waited_s: u64,
        /// What may help.
        hint: String,
    },
    /// The drive is another chip's.
    #[error("{}: expected the boot loader of the {chip}, found that of {found}", path.display())]
    OtherDrive {
        /// The drive.
        path: PathBuf,
        /// What the file is for.
        chip: Chip,
        /// What the drive says.
        found: String,
    },
    /// The drive does not take the file.
    #[error("{}: expected a drive that takes the firmware, found: {source}", path.display())]
    Drive {
        /// The drive.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// It does not come back.
    #[error("port {port}: expected the trigger box back within {waited_s} s, found: {error}")]
    NotBack {
        /// Its port.
        port: String,
        /// How long, in seconds.
        waited_s: u64,
        /// Why the last look failed.
        error: DeviceError,
    },
    /// What is back is not what was written.
    #[error("port {port}: expected firmware {expected} after the update, found {found}")]
    OtherFirmware {
        /// Its port.
        port: String,
        /// What was written.
        expected: About,
        /// What is there.
        found: About,
    },
}

fn at(place: Option<&Path>) -> String {
    place.map_or_else(String::new, |place| format!(" at {}", place.display()))
}

impl Blame for UpdateError {
    fn is_input(&self) -> bool {
        match self {
            Self::File { source, .. } => {
                matches!(
                    source.kind(),
                    io::ErrorKind::NotFound | io::ErrorKind::IsADirectory
                )
            }
            Self::NoFirmware { .. } | Self::OtherChip { .. } | Self::DriveBefore { .. } => true,
            Self::Device(error) => error.is_input(),
            _ => false,
        }
    }
}

/// Reads and checks the firmware in the file `path`.
///
/// # Errors
/// [`UpdateError::File`], [`UpdateError::NoFirmware`].
pub fn read(path: &Path) -> Result<Uf2, UpdateError> {
    /// A file of more is none of the box's, whose flash is 2 MB.
    const MOST: u64 = 8 * 1024 * 1024;
    let failed = |source| UpdateError::File {
        path: path.to_owned(),
        source,
    };
    let length = fs::metadata(path).map_err(failed)?.len();
    if length > MOST {
        return Err(UpdateError::NoFirmware {
            path: path.to_owned(),
            error: Uf2Error::Length(usize::try_from(length).unwrap_or(usize::MAX)),
        });
    }
    let bytes = fs::read(path).map_err(failed)?;
    Uf2::check(bytes).map_err(|error| UpdateError::NoFirmware {
        path: path.to_owned(),
        error,
    })
}

/// What came of an update.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Updated {
    /// What the box had before, if it was asked and knew.
    pub before: Option<About>,
    /// What it has now.
    pub after: About,
    /// How long it was away.
    pub away: Duration,
}

/// Where the box is, and how long it is waited for.
#[derive(Clone, Debug)]
pub struct Place {
    /// Its port, as [`link::open`] takes it.
    pub port: String,
    /// Where the drive of its boot loader will be; `None` to look for it.
    pub volume: Option<PathBuf>,
    /// How long the drive and the box may take to appear.
    pub patience: Duration,
}

/// Gives the trigger box at `place` the firmware `uf2`, and sees that it is back with it.
///
/// # Errors
/// [`UpdateError`]. A box that has left for its boot loader stays there until it has got a firmware, or is plugged in again.
pub fn update(uf2: &Uf2, place: &Place) -> Result<Updated, UpdateError> {
    let drive = || Volume::find(place.volume.as_deref());
    let connected = link::open(&place.port)
        .map_err(DeviceError::from)
        .and_then(|link| Device::connect(link, link::nonce(), GREETING));
    let began = Instant::now();
    let mut unit = None;
    let mut before = None;
    match (connected, drive()) {
        (Ok(_), Some(volume)) => return Err(UpdateError::DriveBefore { path: volume.path }),
        (Ok(mut device), None) => {
            unit = device.unit()?;
            before = unit.map(|unit| about(&device, unit));
            if let Some(Unit { chip: found, .. }) = unit
                && found != uf2.chip()
            {
                let chip = uf2.chip();
                return Err(UpdateError::OtherChip { chip, found });
            }
            device.boot().map_err(|error| match error {
                DeviceError::Older { .. } => UpdateError::TooOld { error },
                error => UpdateError::Device(error),
            })?;
        }
        // It is there already, by its button.
        (Err(DeviceError::Link(_)), Some(_)) => {}
        (Err(DeviceError::OtherVersion { peer, .. }), None) => {
            SerialLink::touch(&peer).map_err(DeviceError::from)?;
        }
        (Err(error), _) => return Err(error.into()),
    }

    let volume = wait(place.patience, drive).ok_or_else(|| UpdateError::NoDrive {
        chip: uf2.chip(),
        place: place.volume.clone(),
        waited_s: place.patience.as_secs(),
        hint: volume::hint(),
    })?;
    volume.check(uf2.chip())?;
    volume.write(uf2)?;

    let port = match unit {
        // It may be at another port now.
        Some(unit) if unit.serial != 0 && place.port == "auto" => format!("serial:{:016x}", unit.serial),
        _ => place.port.clone(),
    };
    let after = back(&port, place.patience)?;
    let expected = uf2.about();
    if after != expected {
        return Err(UpdateError::OtherFirmware {
            port,
            expected,
            found: after,
        });
    }
    Ok(Updated {
        before,
        after,
        away: began.elapsed(),
    })
}

/// Waits until the box is at `port` again, and asks it what it is.
fn back(port: &str, patience: Duration) -> Result<About, UpdateError> {
    let mut failed = None;
    let found = wait(patience, || {
        let met = link::open(port)
            .map_err(DeviceError::from)
            .and_then(|link| Device::connect(link, link::nonce(), GREETING))
            .and_then(|mut device| Ok((device.unit()?, device)));
        match met {
            Ok((unit, device)) => Some(unit.map_or_else(|| of_version(&device), |unit| about(&device, unit))),
            Err(error) => {
                failed = Some(error);
                None
            }
        }
    });
    found.ok_or_else(|| UpdateError::NotBack {
        port: port.to_owned(),
        waited_s: patience.as_secs(),
        error: failed.expect("it was looked for at least once"),
    })
}

fn of_version<L: Link>(device: &Device<L>) -> About {
    About {
        version: device.info().firmware,
        commit: 0,
        modified: false,
    }
}

fn about<L: Link>(device: &Device<L>, unit: Unit) -> About {
    About {
        commit: unit.commit,
        modified: unit.modified,
        ..of_version(device)
    }
}

/// What `look` finds within `patience`; it looks once at least.
fn wait<T>(patience: Duration, mut look: impl FnMut() -> Option<T>) -> Option<T> {
    let began = Instant::now();
    loop {
        if let Some(found) = look() {
            return Some(found);
        }
        if began.elapsed() >= patience {
            return None;
        }
        thread::sleep(LOOK);
    }
}

impl From<LinkError> for UpdateError {
    fn from(error: LinkError) -> Self {
        Self::Device(error.into())
    }
}
