//! Images of a camera that nobody shows anything to: gradients, in whose first eight bytes the frame's id is put.

use std::sync::Arc;

use super::settings::Config;

/// Images that differ.
const IMAGES: usize = 4;
/// Bytes of all of them; what is larger is not made.
const MOST_BYTES: usize = 128 << 20;

/// A ring of images, made once for a region and format.
#[derive(Default)]
pub(super) struct TestImages {
    of: Option<Config>,
    images: Vec<Arc<[u8]>>,
    next: usize,
}

impl TestImages {
    /// The next image; `None` if it would be too large.
    pub(super) fn next(&mut self, config: &Config) -> Option<Arc<[u8]>> {
        let made = |of: &Config| of.region == config.region && of.format == config.format;
        if !self.of.as_ref().is_some_and(made) {
            self.images.clear();
            let bytes = config.image_bytes();
            let count = (MOST_BYTES / bytes.max(1)).min(IMAGES);
            self.images = (0..count).map(|phase| gradient(config, phase).into()).collect();
            self.of = Some(config.clone());
        }
        if self.images.is_empty() {
            return None;
        }
        self.next = (self.next + 1) % self.images.len();
        Some(Arc::clone(&self.images[self.next]))
    }
}

/// A diagonal gradient over all digital numbers.
fn gradient(config: &Config, phase: usize) -> Vec<u8> {
    let format = config.format;
    let (width, height) = (config.region.width as usize, config.region.height as usize);
    let span = (width + height + IMAGES) as f64;
    let of = |at: usize| (at as f64 / span * f64::from(format.largest())) as u16;
    let mut dn = Vec::with_capacity(width * height * format.channels());
    for row in 0..height {
        for column in 0..width {
            dn.extend(std::iter::repeat_n(of(row + column + phase), format.channels()));
        }
    }
    format.pack(&dn)
}
