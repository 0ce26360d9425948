//! Planes of video frames as patterns: DLPC900 in its video pattern mode, and the DLPC350 of a LightCrafter 4500.
//!
//! # Design
//! Each frame at the video port (HDMI, DisplayPort) carries up to 24 planes of one bit, which are shown one after the other from its
//! vertical sync on: 24 × 60 frames are 1,440 patterns a second. Which plane is which bit of the frame: 0–7 are those of green, 8–15 of red,
//! 16–23 of blue, each from the least significant one on (DLPU010, table of pattern numbers). `rcg patterns --sheets` writes such frames.
//!
//! The vertical sync is the trigger, not PROJ: no step of a measurement can advance such patterns. So this sets a unit up for a program that
//! shows frames, with TRIG_OUT_1 (SYNC) around each pattern, and a rig cannot name it as its driver. A DLPC350 takes patterns over USB in no
//! mode; from its flash it would advance by a trigger, but writing them there takes a firmware image that TI's tool builds (DLPU010,
//! chapter 4), for each sequence, of at most 64 images of 24 planes. What a driver would take beyond what stands here: frames of native
//! resolution (912 × 1140 mirrors in a diamond) from a window on that screen without gamma, scaling and dither, and steps of the trigger box
//! that wait for SYNC.

use std::thread;
use std::time::Duration;

use super::image::PLANES;
use super::packet::{CommandError, Commands};
use super::unit::{Entry, Mode, Play, Unit};
use crate::base::blame::Blame;
use crate::instrument::drivers::SHORTEST_US;

/// Between the last pattern of a frame and the next vertical sync, µs (DLPU010: command 1A29).
const REST_US: f64 = 230.0;
/// Shortest exposure on a DLPC350, µs: 4,225 patterns a second of one bit (DLPU010, table 2-63).
const SHORTEST_350_US: u32 = 235;
/// How often a DLPC350 is asked whether it has looked at its sequence.
const LOOKS: usize = 40;
const LOOK: Duration = Duration::from_millis(50);

/// How frames are taken apart.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct VideoPatterns {
    /// How many planes of each frame are shown, from plane 0 on.
    pub planes: usize,
    /// How long each is, µs.
    pub exposure_us: u32,
    /// Length of a frame, µs.
    pub frame_us: u32,
}

/// Why no frame is taken apart.
#[derive(Debug, thiserror::Error)]
pub enum VideoError {
    /// There are not so many.
    #[error("planes: expected 1 to {PLANES}, found {0}")]
    Planes(usize),
    /// They are too short.
    #[error(
        "planes: expected exposures of {shortest} µs or more, found {found} µs for {planes} planes of a frame; show fewer"
    )]
    Short {
        /// The shortest that the unit has.
        shortest: u32,
        /// What is left for each.
        found: u32,
        /// How many there are.
        planes: usize,
    },
    /// Nothing comes by the video port.
    #[error("expected a locked source at the video port, found none; show frames of native resolution there")]
    NoSource,
    /// The unit looked at the sequence and does not take it.
    #[error("expected a sequence that the unit finds valid, found {}", .0.join(", "))]
    Invalid(Vec<&'static str>),
    /// A command.
    #[error(transparent)]
    Command(#[from] CommandError),
}

impl Blame for VideoError {
    fn is_input(&self) -> bool {
        match self {
            Self::Planes(_) | Self::Short { .. } => true,
            Self::NoSource | Self::Invalid(_) | Self::Command(_) => false,
        }
    }
}

impl VideoPatterns {
    /// So many `planes` of each of `frame_hz` frames a second, none shorter than `shortest_us`.
    fn new(planes: usize, frame_hz: f64, shortest_us: u32) -> Result<Self, VideoError> {
        if !(1..=PLANES).contains(&planes) {
            return Err(VideoError::Planes(planes));
        }
        let frame_us = 1e6 / frame_hz;
        let exposure_us = ((frame_us - REST_US) / planes as f64).max(0.0) as u32;
        if exposure_us < shortest_us {
            return Err(VideoError::Short {
                shortest: shortest_us,
                found: exposure_us,
                planes,
            });
        }
        Ok(Self {
            planes,
            exposure_us,
            frame_us: frame_us as u32,
        })
    }
}

/// Lets a DLPC900 show so many `planes` of each of `frame_hz` frames a second.
///
/// # Errors
/// [`VideoError`].
pub fn start(unit: &mut Unit, planes: usize, frame_hz: f64) -> Result<VideoPatterns, VideoError> {
    let patterns = VideoPatterns::new(planes, frame_hz, SHORTEST_US)?;
    // The mode is reached from video with a locked source only.
    unit.set_mode(Mode::Video)?;
    if !unit.status()?.locked {
        return Err(VideoError::NoSource);
    }
    unit.set_mode(Mode::VideoPattern)?;
    let entries: Vec<Entry> = (0..planes)
        .map(|plane| Entry {
            exposure_us: patterns.exposure_us,
            clears: true,
            depth: 1,
            light: 7,
            // The first waits for the vertical sync.
            waits: plane == 0,
            image: 0,
            plane,
        })
        .collect();
    unit.define(&entries)?;
    unit.check()?;
    unit.play(Play::Start)?;
    Ok(patterns)
}

/// Lets the DLPC350 behind `commands` show so many `planes` of each of `frame_hz` frames a second.
///
/// # Errors
/// [`VideoError`].
pub fn start_dlpc350(
    commands: &mut Commands,
    planes: usize,
    frame_hz: f64,
) -> Result<VideoPatterns, VideoError> {
    let patterns = VideoPatterns::new(planes, frame_hz, SHORTEST_350_US)?;
    commands.write(0x1A24, &[0])?;
    // Patterns, from the video port, each sequence from a vertical sync on.
    commands.write(0x1A1B, &[1])?;
    commands.write(0x1A22, &[0])?;
    let last = planes as u8 - 1;
    // Again and again; TRIG_OUT_2 tells of each sequence.
    commands.write(0x1A31, &[last, 1, last, 0])?;
    commands.write(0x1A23, &[0])?;
    let mut times = patterns.exposure_us.to_le_bytes().to_vec();
    times.extend(patterns.exposure_us.to_le_bytes());
    commands.write(0x1A29, &times)?;
    // The table is open for entries from the first on.
    commands.write(0x1A33, &[2])?;
    commands.write(0x1A32, &[0])?;
    let entry = |plane: u8| {
        // The first waits for its trigger, the sync, and swaps in the frame; the others follow it. One bit, all lights.
        let (trigger, swap) = if plane == 0 { (1, 1 << 2) } else { (3, 0) };
        [plane << 2 | trigger, 1 | 7 << 4, swap]
    };
    let table: Vec<u8> = (0..planes as u8).flat_map(entry).collect();
    commands.write(0x1A34, &table)?;
    commands.write(0x1A33, &[0])?;
    validate(commands)?;
    commands.write(0x1A24, &[2])?;
    Ok(patterns)
}

/// Lets a DLPC350 look at its sequence.
fn validate(commands: &mut Commands) -> Result<(), VideoError> {
    commands.write(0x1A1A, &[0])?;
    for _ in 0..LOOKS {
        let status = commands.read(0x1A1A, 1)?[0];
        if status & 0x80 != 0 {
            thread::sleep(LOOK);
            continue;
        }
        let wrong: Vec<&str> = [
            "exposure or period out of range",
            "number of a pattern out of range",
            "overlapping black patterns",
            "no black pattern before a triggered one",
            "exposure and period too close",
        ]
        .into_iter()
        .enumerate()
        .filter_map(|(bit, wrong)| (status >> bit & 1 != 0).then_some(wrong))
        .collect();
        return if wrong.is_empty() {
            Ok(())
        } else {
            Err(VideoError::Invalid(wrong))
        };
    }
    Err(VideoError::Invalid(vec!["no end of its looking"]))
}

#[cfg(test)]
mod tests {
    use std::sync::{Arc, Mutex};

    use super::super::reports::{REPORT, Reports};
    use super::*;

    /// Commands with their data.
    type Told = Vec<(u16, Vec<u8>)>;

    /// Answers every command, and keeps what it was told.
    #[derive(Clone, Default)]
    struct Kept(Arc<Mutex<Told>>, Arc<Mutex<Vec<u8>>>);

    impl Reports for Kept {
        fn send(&mut self, report: &[u8; REPORT]) -> Result<(), String> {
            let mut bytes = self.1.lock().unwrap();
            bytes.extend(report);
            let length = usize::from(u16::from_le_bytes([bytes[2], bytes[3]])) + 4;
            if bytes.len() >= length {
                let command = u16::from_le_bytes([bytes[4], bytes[5]]);
                let answer = [bytes[0], bytes[1], 1, 0, 0];
                self.0.lock().unwrap().push((command, bytes[6..length].to_vec()));
                *bytes = answer.to_vec();
            }
            Ok(())
        }

        fn take(&mut self, _: Duration) -> Result<Option<[u8; REPORT]>, String> {
            let mut report = [0; REPORT];
            report[..5].copy_from_slice(&self.1.lock().unwrap().split_off(0));
            Ok(Some(report))
        }
    }

    #[test]
    fn a_dlpc350_is_told_of_the_planes_of_a_frame_and_what_is_too_short_is_refused() {
        let kept = Kept::default();
        let mut commands = Commands::new(Box::new(kept.clone()));
        let patterns = start_dlpc350(&mut commands, 24, 120.0).unwrap();
        assert_eq!((patterns.exposure_us, patterns.frame_us), (337, 8333));
        let told = kept.0.lock().unwrap().clone();
        let of = |command| told.iter().find(|(it, _)| *it == command).unwrap().1.clone();
        assert_eq!(told.first(), Some(&(0x1A24, vec![0])));
        assert_eq!(told.last(), Some(&(0x1A24, vec![2])));
        assert_eq!(of(0x1A31), [23, 1, 23, 0]);
        assert_eq!(of(0x1A29), [0x51, 1, 0, 0, 0x51, 1, 0, 0]);
        let table = of(0x1A34);
        assert_eq!((&table[..6], table.len()), (&[1, 0x71, 4, 7, 0x71, 0][..], 72));
        let error = start_dlpc350(&mut commands, 24, 180.0).unwrap_err().to_string();
        assert!(error.contains("found 221 µs for 24 planes"), "{error}");
        let error = start_dlpc350(&mut commands, 25, 60.0).unwrap_err().to_string();
        assert_eq!(error, "planes: expected 1 to 24, found 25");
    }
}
