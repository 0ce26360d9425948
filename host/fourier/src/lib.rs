//! The fast Fourier transform of real pairs in single precision: rustfft, and nothing of it that is generic.
//!
//! A crate of its own, because a generic planner is compiled where it is used, for both precisions and all sets of instructions: it was a tenth of
//! what is compiled of the library, each time.

use std::sync::Arc;

pub use rustfft::num_complex::Complex32;
use rustfft::{Fft, FftPlanner};

/// The transforms of one length, both ways, neither of which is normalised.
pub struct Fourier {
    forward: Arc<dyn Fft<f32>>,
    inverse: Arc<dyn Fft<f32>>,
}

impl Fourier {
    /// Of so many numbers.
    #[must_use]
    pub fn new(length: usize) -> Self {
        let mut planner = FftPlanner::new();
        Self {
            forward: planner.plan_fft_forward(length),
            inverse: planner.plan_fft_inverse(length),
        }
    }

    /// Transforms each row of `rows`, which are as long as this transform, in place.
    pub fn forward(&self, rows: &mut [Complex32]) {
        self.forward.process(rows);
    }

    /// Transforms each row of `rows` back; each is multiplied by its length then.
    pub fn inverse(&self, rows: &mut [Complex32]) {
        self.inverse.process(rows);
    }
}
