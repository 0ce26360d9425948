//! What a DLPC900 is told and asked, by the commands of DLPU018J.

use std::thread;
use std::time::Duration;

use serde::Serialize;

use super::model::Model;
use super::packet::{CommandError, Commands};

/// Bytes of an image that one command takes, beside their count.
const LOAD: usize = 504;
/// How often the mode is looked for, and how often it is asked: it changes within 0.3 s.
const LOOKS: usize = 40;
const LOOK: Duration = Duration::from_millis(50);

/// What the unit shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Mode {
    /// What comes by the video port, as a projector.
    Video,
    /// Patterns from its flash.
    PreStored,
    /// Planes of the frames that come by the video port.
    VideoPattern,
    /// Patterns that were uploaded.
    OnTheFly,
}

impl Mode {
    const ALL: [Self; 4] = [Self::Video, Self::PreStored, Self::VideoPattern, Self::OnTheFly];

    /// What a person knows it by.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Video => "video",
            Self::PreStored => "patterns from flash",
            Self::VideoPattern => "video pattern",
            Self::OnTheFly => "pattern on the fly",
        }
    }
}

/// What happens to the sequence.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Play {
    /// It ends; the next start begins with its first pattern.
    Stop = 0,
    /// It begins.
    Start = 2,
}

/// One pattern of a sequence.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Entry {
    /// How long it is shown, µs.
    pub exposure_us: u32,
    /// Whether it goes when that is over, or stays until the next trigger.
    pub clears: bool,
    /// Bits of grey.
    pub depth: u8,
    /// Which light is on: 1 red, 2 green, 4 blue, added.
    pub light: u8,
    /// Whether it waits for a trigger, or follows the one before.
    pub waits: bool,
    /// Number of the image, and of its first plane there.
    pub image: usize,
    /// As above.
    pub plane: usize,
}

impl Entry {
    /// As command 1A34 has it, as the `number`th of the sequence.
    fn bytes(&self, number: usize) -> [u8; 12] {
        let [index_low, index_high] = (number as u16).to_le_bytes();
        let [low, middle, high, _] = self.exposure_us.to_le_bytes();
        let flags =
            u8::from(self.clears) | (self.depth - 1) << 1 | self.light << 4 | u8::from(self.waits) << 7;
        let [image, plane] = (self.image as u16 | (self.plane as u16) << 11).to_le_bytes();
        // No dark time, TRIG_OUT_2 as it is.
        [
            index_low, index_high, low, middle, high, flags, 0, 0, 0, 0, image, plane,
        ]
    }
}

/// How it is triggered and tells of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Triggers {
    /// From the edge at TRIG_IN_1 to the pattern, µs.
    pub delay_us: u16,
    /// Whether the falling edge advances, the rising one else.
    pub falling: bool,
    /// Whether TRIG_OUT_1 is low while a pattern is exposed, high else.
    pub inverted: bool,
    /// By how much its edges are late, µs: the one at the start of the exposure and that at its end.
    pub late_us: [i16; 2],
}

/// What it says of itself.
#[expect(clippy::struct_excessive_bools, reason = "each is a bit of its status")]
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Status {
    /// Version of the firmware.
    pub firmware: (u8, u8, u16),
    /// Version of the sequences in it, which belong to the mirrors.
    pub sequences: (u8, u8, u16),
    /// What its maker calls the firmware.
    pub tag: String,
    /// Code of the mirrors.
    pub mirrors: u8,
    /// What it shows.
    pub mode: Mode,
    /// What is wrong, by its hardware status.
    pub faults: Vec<&'static str>,
    /// Whether there is a secondary controller.
    pub secondary: bool,
    /// Whether the mirrors are parked.
    pub parked: bool,
    /// Whether a sequence runs.
    pub running: bool,
    /// Whether the source at the video port is locked.
    pub locked: bool,
}

/// A DLPC900.
pub struct Unit {
    commands: Commands,
}

impl Unit {
    /// The one that hears these commands.
    #[must_use]
    pub const fn new(commands: Commands) -> Self {
        Self { commands }
    }

    /// What it says of itself.
    ///
    /// # Errors
    /// [`CommandError`].
    pub fn status(&mut self) -> Result<Status, CommandError> {
        let version = |bytes: &[u8]| (bytes[3], bytes[2], u16::from_le_bytes([bytes[0], bytes[1]]));
        let versions = self.commands.read(0x0205, 16)?;
        let hardware = self.commands.read(0x0206, 1)?;
        let tag = hardware[1..].iter().take_while(|byte| **byte != 0);
        let (faults, secondary) = self.faults()?;
        let main = self.commands.read(0x1A0C, 1)?[0];
        Ok(Status {
            firmware: version(&versions[0..4]),
            sequences: version(&versions[12..16]),
            tag: tag.map(|byte| char::from(*byte)).collect(),
            mirrors: hardware[0],
            mode: self.mode()?,
            faults,
            secondary,
            parked: main & 1 != 0,
            running: main & 2 != 0,
            locked: main & 8 != 0,
        })
    }

    /// What is wrong by its hardware status, and whether there is a secondary controller.
    ///
    /// # Errors
    /// [`CommandError`].
    pub fn faults(&mut self) -> Result<(Vec<&'static str>, bool), CommandError> {
        let status = self.commands.read(0x1A0A, 1)?[0];
        let mut faults = Vec::new();
        // The first bit says that all is well.
        for (bit, fault) in [
            (0, "it was not initialised"),
            (1, "controller and mirrors do not fit"),
            (2, "the mirrors' reset overlapped"),
            (3, "a forced swap of buffers"),
            (6, "the sequencer was aborted"),
            (7, "an error of the sequencer"),
        ] {
            if (status >> bit & 1 != 0) != (bit == 0) {
                faults.push(fault);
            }
        }
        Ok((faults, status >> 4 & 1 != 0))
    }

    /// What it shows.
    ///
    /// # Errors
    /// [`CommandError`].
    pub fn mode(&mut self) -> Result<Mode, CommandError> {
        let mode = self.commands.read(0x1A1B, 1)?[0];
        Ok(Mode::ALL[usize::from(mode & 3)])
    }

    /// Stops what runs, changes the mode, and stops again: without either it may hang.
    ///
    /// # Errors
    /// [`CommandError`].
    pub fn set_mode(&mut self, mode: Mode) -> Result<(), CommandError> {
        self.play(Play::Stop)?;
        self.commands.write(0x1A1B, &[mode as u8])?;
        let mut found = self.mode()?;
        for _ in 0..LOOKS {
            if found == mode {
                return self.play(Play::Stop);
            }
            thread::sleep(LOOK);
            found = self.mode()?;
        }
        Err(CommandError::Mode {
            expected: mode.name(),
            found: found.name(),
        })
    }

    /// Gets it out of what it hangs in, as far as commands can: it is stopped, set to another mode and back. Whether that helped, the
    /// next commands show.
    pub fn recover(&mut self) {
        for mode in [Mode::Video, Mode::OnTheFly] {
            self.set_mode(mode).ok();
        }
    }

    /// Refuses what its hardware status says is wrong.
    ///
    /// # Errors
    /// [`CommandError`].
    pub fn check(&mut self) -> Result<(), CommandError> {
        let (faults, _) = self.faults()?;
        if faults.is_empty() {
            Ok(())
        } else {
            Err(CommandError::Faults(faults))
        }
    }

    /// Starts or stops the sequence.
    ///
    /// # Errors
    /// [`CommandError`].
    pub fn play(&mut self, play: Play) -> Result<(), CommandError> {
        self.commands.write(0x1A24, &[play as u8])
    }

    /// Sets inputs and outputs: TRIG_IN_1 advances, TRIG_IN_2 enables while high, TRIG_OUT_1 frames the exposure.
    ///
    /// # Errors
    /// [`CommandError`].
    pub fn set_triggers(&mut self, triggers: &Triggers) -> Result<(), CommandError> {
        let mut input = triggers.delay_us.to_le_bytes().to_vec();
        input.push(u8::from(triggers.falling));
        self.commands.write(0x1A35, &input)?;
        self.commands.write(0x1A36, &[0])?;
        let mut output = vec![u8::from(triggers.inverted)];
        for late_us in triggers.late_us {
            output.extend(late_us.to_le_bytes());
        }
        self.commands.write(0x1A1D, &output)
    }

    /// Defines the sequence. It repeats.
    ///
    /// # Errors
    /// [`CommandError`].
    pub fn define(&mut self, entries: &[Entry]) -> Result<(), CommandError> {
        for (number, entry) in entries.iter().enumerate() {
            self.commands.write(0x1A34, &entry.bytes(number))?;
        }
        self.configure(entries.len())
    }

    /// Makes the definition of so many patterns effective.
    ///
    /// # Errors
    /// [`CommandError`].
    pub fn configure(&mut self, entries: usize) -> Result<(), CommandError> {
        let mut data = (entries as u16).to_le_bytes().to_vec();
        data.extend(0_u32.to_le_bytes());
        self.commands.write(0x1A31, &data)
    }

    /// Uploads image `number`, its parts for the controllers of `model`; images go up from the last to the first. `sent` is told of the
    /// bytes that are there.
    ///
    /// # Errors
    /// [`CommandError`].
    pub fn upload(
        &mut self,
        number: usize,
        parts: &[Vec<u8>],
        sent: &mut dyn FnMut(usize),
    ) -> Result<(), CommandError> {
        for (part, (init, load)) in parts.iter().zip([(0x1A2A, 0x1A2B), (0x1A2C, 0x1A2D)]) {
            let mut data = (number as u16).to_le_bytes().to_vec();
            data.extend((part.len() as u32).to_le_bytes());
            self.commands.write(init, &data)?;
            for bytes in part.chunks(LOAD) {
                let mut data = (bytes.len() as u16).to_le_bytes().to_vec();
                data.extend(bytes);
                self.commands.write(load, &data)?;
                sent(bytes.len());
            }
        }
        Ok(())
    }
}

impl Status {
    /// The mirrors, if this driver knows them.
    #[must_use]
    pub fn model(&self) -> Option<Model> {
        Model::of(self.mirrors)
    }
}
