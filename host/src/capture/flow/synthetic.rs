//! Frames that are made in this program, at a pace or as fast as they are taken.
//!
//! # Design
//! It behaves like a camera with a driver: a frame is there when its time has come, whoever asks, and [`BUFFERS`] of them can wait.
//! Who asks later than that finds that the oldest are lost. Without a pace there is always a next frame, and none is lost. Frames look like noise, and
//! begin with their own number, so that what was written can be told from what was not.

use std::thread;
use std::time::{Duration, Instant};

use super::{About, Arrived, Source};
use crate::capture::camera::CameraError;

/// Frames that wait at most, as many as [`Genicam`](crate::instrument::drivers::Genicam) has buffers.
const BUFFERS: u64 = 256;
/// Frames that differ in more than their number.
const KINDS: usize = 64;
/// What a frame is ahead of the one of the kind before it, bytes.
const SHIFT: usize = 61;
/// Bytes of a frame's number at its beginning, the least first.
const NUMBER: usize = 8;

/// A source that needs no camera: square frames of one byte a pixel.
pub struct Synthetic {
    size_px: usize,
    frames_per_s: Option<f64>,
    noise: Vec<u8>,
    began: Option<Instant>,
    next: u64,
    lost: u64,
}

impl Synthetic {
    /// Frames of `size_px` pixels a side, at least 3, at `frames_per_s` (above 0) or as fast as they are taken.
    #[must_use]
    pub fn new(size_px: usize, frames_per_s: Option<f64>) -> Self {
        let length = size_px * size_px + KINDS * SHIFT;
        let noise = (0..length as u64).map(|at| {
            // SplitMix64 (Steele, Lea, Flood 2014); the sum of bytes is nearly normal, as shot noise is.
            let mut z = at.wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
            z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
            let sum: u32 = (z ^ (z >> 31)).to_le_bytes().into_iter().map(u32::from).sum();
            (sum / 16) as u8
        });
        Self {
            size_px,
            frames_per_s,
            noise: noise.collect(),
            began: None,
            next: 0,
            lost: 0,
        }
    }

    /// The frame of this `number`, [row, column].
    #[must_use]
    pub fn frame(&self, number: u64) -> Vec<u8> {
        let mut bytes = Vec::new();
        self.write(number, &mut bytes);
        bytes
    }

    fn write(&self, number: u64, bytes: &mut Vec<u8>) {
        let from = number as usize % KINDS * SHIFT;
        bytes.extend_from_slice(&self.noise[from..from + self.size_px * self.size_px]);
        bytes[..NUMBER].copy_from_slice(&number.to_le_bytes());
    }

    /// Waits until the next frame is there, at most `timeout`. Returns whether it is.
    fn wait(&mut self, began: Instant, frames_per_s: f64, timeout: Duration) -> bool {
        let due = |number: u64| Duration::from_secs_f64(number as f64 / frames_per_s);
        let early = due(self.next).saturating_sub(began.elapsed());
        if !early.is_zero() {
            thread::sleep(early.min(timeout));
            if began.elapsed() < due(self.next) {
                return false;
            }
        }
        let made = (began.elapsed().as_secs_f64() * frames_per_s) as u64;
        let oldest = made.saturating_sub(BUFFERS);
        self.lost += oldest.saturating_sub(self.next);
        self.next = self.next.max(oldest);
        true
    }
}

impl Source for Synthetic {
    fn about(&self) -> About {
        About {
            id: "synthetic".to_owned(),
            region_px: (self.size_px, self.size_px),
            pixel_format: "Mono8".to_owned(),
        }
    }

    fn next(&mut self, bytes: &mut Vec<u8>, timeout: Duration) -> Result<Option<Arrived>, CameraError> {
        let began = *self.began.get_or_insert_with(Instant::now);
        if let Some(frames_per_s) = self.frames_per_s
            && !self.wait(began, frames_per_s, timeout)
        {
            return Ok(None);
        }
        let number = self.next;
        self.next += 1;
        self.write(number, bytes);
        let timestamp_s = match self.frames_per_s {
            Some(frames_per_s) => number as f64 / frames_per_s,
            None => began.elapsed().as_secs_f64(),
        };
        Ok(Some(Arrived { number, timestamp_s }))
    }

    fn lost(&self) -> u64 {
        self.lost
    }
}
