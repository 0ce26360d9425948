//! The drive that a boot loader shows.
//!
//! # Design
//! It is known by the file `INFO_UF2.TXT`, whose line `Board-ID` names the chip: `RPI-RP2` stands for the RP2040, `RP2350` for the other
//! one, as their boot ROMs have it (RP2040 data sheet, 2.8.4.1; RP2350 data sheet, 5.5). It takes what is written to it as it comes, and is
//! gone with the last block.

use std::fs::{self, File};
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};

use rcg_firmware::uf2::Uf2;
use rcg_protocol::Chip;

use super::UpdateError;

const INFO: &str = "INFO_UF2.TXT";
const KEY: &str = "Board-ID:";

/// What each chip calls itself there.
const BOARDS: [(Chip, &str); 2] = [(Chip::Rp2040, "RPI-RP2"), (Chip::Rp2350, "RP2350")];

/// The drive of a boot loader.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Volume {
    /// Where it is.
    pub path: PathBuf,
    /// What it says that it is.
    board: String,
}

impl Volume {
    /// The drive at `place`, or the first there is; `None` if there is none, now.
    #[must_use]
    pub fn find(place: Option<&Path>) -> Option<Self> {
        match place {
            Some(place) => Self::at(place),
            None => mounted().iter().find_map(|place| Self::at(place)),
        }
    }

    fn at(place: &Path) -> Option<Self> {
        let info = fs::read(place.join(INFO)).ok()?;
        let info = String::from_utf8_lossy(&info);
        let board = info.lines().find_map(|line| line.strip_prefix(KEY))?;
        Some(Self {
            path: place.to_owned(),
            board: board.trim().to_owned(),
        })
    }

    /// # Errors
    /// [`UpdateError::OtherDrive`] if it is not that of `chip`.
    pub(super) fn check(&self, chip: Chip) -> Result<(), UpdateError> {
        if BOARDS.contains(&(chip, &self.board)) {
            return Ok(());
        }
        let of = BOARDS.iter().find(|(_, board)| *board == self.board);
        Err(UpdateError::OtherDrive {
            path: self.path.clone(),
            chip,
            found: of.map_or_else(|| format!("`{}`", self.board), |(chip, _)| format!("the {chip}")),
        })
    }

    /// Writes `uf2`. That the drive is gone before everything is closed is as it should be: whether the firmware is there, the box tells.
    ///
    /// # Errors
    /// [`UpdateError::Drive`] if the drive does not take the file.
    pub(super) fn write(&self, uf2: &Uf2) -> Result<(), UpdateError> {
        let failed = |source| UpdateError::Drive {
            path: self.path.clone(),
            source,
        };
        let mut file = File::create(self.path.join("rcg-firmware.uf2")).map_err(failed)?;
        let written: io::Result<()> = file.write_all(uf2.bytes()).and_then(|()| file.sync_all());
        match written {
            Err(source) if self.is_there() => Err(failed(source)),
            _ => Ok(()),
        }
    }

    fn is_there(&self) -> bool {
        self.path.join(INFO).exists()
    }
}

/// Folders at which such a drive may be mounted.
#[cfg(target_os = "linux")]
fn mounted() -> Vec<PathBuf> {
    mount();
    fs::read_to_string("/proc/mounts").map_or_else(|_| Vec::new(), |mounts| fat(&mounts))
}

/// Folders of the FAT drives in `mounts`, lines of `device folder type …`.
#[cfg(any(target_os = "linux", test))]
pub(super) fn fat(mounts: &str) -> Vec<PathBuf> {
    let lines = mounts.lines().map(|line| line.split(' '));
    let folders = lines.filter_map(|mut words| {
        let folder = words.nth(1)?;
        let is_fat = matches!(words.next()?, "vfat" | "msdos" | "fuseblk");
        // Blanks and the like stand there in octal digits.
        is_fat.then(|| PathBuf::from(folder.replace("\\040", " ").replace("\\134", "\\")))
    });
    folders.collect()
}

/// Mounts a boot loader's drive that nobody has mounted, where the desktop's own service can.
#[cfg(target_os = "linux")]
fn mount() {
    for (_, label) in BOARDS {
        let device = Path::new("/dev/disk/by-label").join(label);
        let Ok(device) = device.canonicalize() else {
            continue;
        };
        let mounts = fs::read_to_string("/proc/mounts").unwrap_or_default();
        let is_mounted = mounts
            .lines()
            .any(|line| line.split(' ').next().map(Path::new) == Some(&device));
        if !is_mounted {
            let mut command = std::process::Command::new("udisksctl");
            command.args(["mount", "--no-user-interaction", "--block-device"]);
            // Without the service the user mounts it; the hint says so.
            command.arg(&device).output().ok();
        }
    }
}

#[cfg(target_os = "macos")]
fn mounted() -> Vec<PathBuf> {
    let folders = fs::read_dir("/Volumes").into_iter().flatten();
    folders.filter_map(|entry| Some(entry.ok()?.path())).collect()
}

#[cfg(not(any(target_os = "linux", target_os = "macos")))]
fn mounted() -> Vec<PathBuf> {
    ('D'..='Z')
        .map(|letter| PathBuf::from(format!("{letter}:\\")))
        .collect()
}

/// What may help where no drive is found.
pub(super) fn hint() -> String {
    let device = BOARDS
        .iter()
        .map(|(_, label)| Path::new("/dev/disk/by-label").join(label))
        .find(|device| device.exists());
    device.map_or_else(String::new, |device| {
        format!(
            "; {} is there: mount it and name its folder by --volume",
            device.display()
        )
    })
}
