//! What each spot of a pattern with many makes of the image: codes light every spot in half of their patterns.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};

use glam::DVec3;

use super::Spot;

/// Bytes that are kept. Codes come block by block: what was of others is not asked for again.
const KEPT: usize = 1 << 26;

/// A spot's light and its colour, by their bits: what it lights follows from that.
type Key = [u64; 16];

fn key(spot: &Spot, colour: DVec3) -> Key {
    let mut key = [0; 16];
    let numbers = [spot.light.irradiance].into_iter().chain(
        spot.light
            .nodes
            .into_iter()
            .chain([colour])
            .flat_map(|vector| vector.to_array()),
    );
    for (key, number) in key.iter_mut().zip(numbers) {
        *key = number.to_bits();
    }
    key
}

/// Images of single spots, [row, column, channel].
#[derive(Debug, Default)]
pub(super) struct SpotImages(Mutex<HashMap<Key, Arc<[f32]>>>);

impl SpotImages {
    /// The image of this `spot`, which is as `make` makes it.
    pub(super) fn of(&self, spot: &Spot, colour: DVec3, make: impl FnOnce() -> Vec<f32>) -> Arc<[f32]> {
        let key = key(spot, colour);
        let known = || self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(image) = known().get(&key) {
            return image.clone();
        }
        // Nobody waits while it is made.
        let image: Arc<[f32]> = make().into();
        let mut known = known();
        if (known.len() + 1) * size_of_val(&*image) > KEPT {
            known.clear();
        }
        known.insert(key, image.clone());
        image
    }
}
