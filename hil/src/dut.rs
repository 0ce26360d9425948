//! Devices under test, described by TOML files.
//!
//! # Design
//! `HIL_DUT` chooses: nothing means all emulated Picos, the path of a TOML file means that one, and anything else is
//! the name of a port, with `duts/board.toml` saying what is wired to it.

use std::path::{Path, PathBuf};
use std::{env, fs, io};

use serde::Deserialize;

use crate::places;

/// A device under test.
#[derive(Clone, Debug)]
pub struct Dut {
    /// Its name, the first part of the names of its trials.
    pub name: String,
    /// What it is.
    pub kind: Kind,
    /// The topics of its trials; none means all.
    pub topics: Vec<String>,
}

/// Emulated or real.
#[derive(Clone, Debug)]
pub enum Kind {
    /// A Pico in the emulator.
    Emulator(EmulatedPico),
    /// A Pico on the table.
    Board(Board),
}

/// A Pico in the emulator.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EmulatedPico {
    /// Which of the firmware's links the host is at.
    pub link: LinkKind,
    /// The firmware's ELF file, from Cargo's target directory.
    pub image: PathBuf,
}

/// The firmware's links.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum LinkKind {
    /// UART0 at 921,600 baud.
    Uart,
    /// USB CDC-ACM.
    Usb,
}

/// A Pico on the table.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Board {
    /// Its serial port.
    pub port: String,
    /// Outputs that are wired to inputs.
    #[serde(default)]
    pub jumpers: Vec<Jumper>,
}

/// A wire from an output to an input.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
pub enum Jumper {
    /// GPIO 3 to GPIO 5.
    #[serde(rename = "CAM-STROBE")]
    CamStrobe,
    /// GPIO 2 to GPIO 4.
    #[serde(rename = "PROJ-SYNC")]
    ProjSync,
}

/// Why there is no device under test.
#[derive(Debug, thiserror::Error)]
pub enum DutError {
    /// The file cannot be read.
    #[error("{path}: {source}")]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// The file is not what it should be.
    #[error("{path}: {reason}")]
    Bad {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        reason: String,
    },
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    name: String,
    #[serde(default)]
    topics: Vec<String>,
    emulator: Option<EmulatedPico>,
    board: Option<Board>,
}

/// Which Pico is emulated, on a command line.
#[derive(Debug, clap::Args)]
pub struct PicoArgs {
    /// The firmware's ELF file
    #[arg(long, value_name = "FILE", default_value_os_t = places::target().join("thumbv6m-none-eabi/firmware/rcg-firmware"))]
    image: PathBuf,
    /// Which of the firmware's links the port is
    #[arg(long, value_enum, default_value = "usb")]
    link: LinkKind,
}

impl PicoArgs {
    /// It, if there is what it needs.
    ///
    /// # Errors
    /// A sentence that says what there is not, and what makes it.
    pub fn pico(self) -> anyhow::Result<EmulatedPico> {
        anyhow::ensure!(
            self.image.is_file(),
            "image {}: expected the firmware's ELF file, found none; `cargo fw` builds it",
            self.image.display()
        );
        anyhow::ensure!(
            places::emulator_modules().is_dir(),
            "emulator: expected its modules in {}, found none; `npm ci` installs them",
            places::emulator_modules().display()
        );
        Ok(EmulatedPico {
            link: self.link,
            image: self.image,
        })
    }
}

impl Dut {
    /// Reads the description in the file `path`.
    ///
    /// # Errors
    /// [`DutError`] names the file and what is wrong with it.
    pub fn read(path: &Path) -> Result<Self, DutError> {
        let bad = |reason: String| DutError::Bad {
            path: path.to_owned(),
            reason,
        };
        let text = fs::read_to_string(path).map_err(|source| DutError::Io {
            path: path.to_owned(),
            source,
        })?;
        let file: File = toml::from_str(&text).map_err(|error| bad(error.to_string()))?;
        let kind = match (file.emulator, file.board) {
            (Some(emulator), None) => Kind::Emulator(emulator),
            (None, Some(board)) => Kind::Board(board),
            (Some(_), Some(_)) => return Err(bad("expected [emulator] or [board], found both".to_owned())),
            (None, None) => return Err(bad("expected [emulator] or [board], found neither".to_owned())),
        };
        Ok(Self {
            name: file.name,
            kind,
            topics: file.topics,
        })
    }

    /// The devices that `HIL_DUT` asks for.
    ///
    /// # Errors
    /// [`DutError`].
    pub fn chosen() -> Result<Vec<Self>, DutError> {
        let file = |name: &str| Self::read(&places::duts().join(name));
        match env::var("HIL_DUT") {
            Err(_) => ["emulator-uart.toml", "emulator-usb.toml", "emulator-200mhz.toml"]
                .into_iter()
                .map(file)
                .collect(),
            Ok(path) if Path::new(&path).extension().is_some_and(|ext| ext == "toml") => {
                Ok(vec![Self::read(Path::new(&path))?])
            }
            Ok(port) => {
                let mut dut = file("board.toml")?;
                if let Kind::Board(board) = &mut dut.kind {
                    board.port = port;
                }
                Ok(vec![dut])
            }
        }
    }

    /// Whether trials of `topic` are for this device.
    #[must_use]
    pub fn takes(&self, topic: &str) -> bool {
        self.topics.is_empty() || self.topics.iter().any(|wanted| wanted == topic)
    }

    /// Why it cannot be used here; `None` if it can.
    #[must_use]
    pub fn absent(&self) -> Option<String> {
        let Kind::Emulator(pico) = &self.kind else {
            return None; // a port that does not open is a failure: somebody has named it
        };
        let node = std::process::Command::new("node").arg("--version").output();
        let image = pico.image();
        if !node.is_ok_and(|output| output.status.success()) {
            Some("needs Node.js (`node`), found none".to_owned())
        } else if !places::emulator_modules().is_dir() {
            Some("needs the emulator's packages: `npm ci` in hil/emulator".to_owned())
        } else if !image.is_file() {
            Some(format!(
                "no firmware image at {}; `cargo fw` builds it",
                image.display()
            ))
        } else {
            None
        }
    }
}

impl EmulatedPico {
    /// Path of the firmware's ELF file.
    #[must_use]
    pub fn image(&self) -> PathBuf {
        places::target().join(&self.image)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Dut, DutError> {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("dut.toml");
        fs::write(&path, text).unwrap();
        Dut::read(&path)
    }

    #[test]
    fn the_descriptions_of_the_repository_are_good() {
        for entry in fs::read_dir(places::duts()).unwrap() {
            let path = entry.unwrap().path();
            let dut = Dut::read(&path).unwrap();
            assert_eq!(path.file_stem().unwrap(), dut.name.as_str());
        }
    }

    #[test]
    fn a_bad_description_is_answered_with_path_and_field() {
        let error = read("name = \"x\"\n[board]\nport = \"/dev/ttyACM0\"\njumper = []\n")
            .unwrap_err()
            .to_string();
        assert!(
            error.contains("dut.toml") && error.contains("unknown field `jumper`"),
            "{error}"
        );
        let error = read("name = \"x\"\n").unwrap_err().to_string();
        assert!(
            error.ends_with("expected [emulator] or [board], found neither"),
            "{error}"
        );
    }
}
