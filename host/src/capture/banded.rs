//! Exposures of a pattern that is shown in one primary after the other, and the image that they make.
//!
//! # Design
//! Before a camera without colours the projector makes the bands ([`crate::instrument::bands`]). Each pattern is shown in red, green and
//! blue, side by side, so that what drifts is the same in all; brackets of exposure times are taken of each while it is shown. What is
//! missing of an image is taken again with all of its bands, in their order: each band stands behind the same one as always. Numbers of
//! exposures that others hear of are those of images.
//!
//! # Tradeoffs
//! Records hold the times of an image's first band. The others follow each a step later.

use super::Captured;
use crate::plan::pattern::BitPattern;

/// In which order the exposures of patterns are taken: [pattern, band, bracket].
#[derive(Clone, Copy, Debug)]
pub(super) struct Order {
    /// Exposure times of a pattern.
    pub(super) brackets: usize,
    /// Primaries that it is shown in; 1 for white.
    pub(super) bands: usize,
}

impl Order {
    /// Number of the picture that an exposure shows: of each pattern as many as bands.
    pub(super) const fn picture(self, exposure: usize) -> usize {
        exposure / self.brackets
    }

    /// Pattern and band of a picture.
    pub(super) const fn pattern_and_band(self, picture: usize) -> (usize, usize) {
        (picture / self.bands, picture % self.bands)
    }

    /// Number of the image that an exposure is a part of, and the band that it is.
    pub(super) const fn image_and_band(self, exposure: usize) -> (usize, usize) {
        let (pattern, band) = self.pattern_and_band(self.picture(exposure));
        (pattern * self.brackets + exposure % self.brackets, band)
    }

    /// The exposures of the image of this number.
    pub(super) fn exposures_of(self, image: usize) -> impl Iterator<Item = usize> {
        let (pattern, bracket) = (image / self.brackets, image % self.brackets);
        (0..self.bands).map(move |band| (pattern * self.bands + band) * self.brackets + bracket)
    }

    /// The exposures to take again of those that are `done` or not: all of each image that misses any.
    pub(super) fn open(self, done: &[Option<Captured>]) -> Vec<usize> {
        let is_missed = |exposure: &usize| {
            let (image, _) = self.image_and_band(*exposure);
            self.exposures_of(image).any(|exposure| done[exposure].is_none())
        };
        (0..done.len()).filter(is_missed).collect()
    }

    /// Gives what is lit in `image` the primary of this `band`. A pattern that has a primary of its own has no light in other bands.
    pub(super) fn show(self, band: usize, image: &mut BitPattern) {
        if self.bands == 1 {
            return;
        }
        let band = Some(band as u8);
        if image.primary().is_some() && image.primary() != band {
            image.clear();
        }
        image.set_primary(band);
    }

    /// The images of all exposures that are `done`: bands become channels.
    pub(super) fn images(self, mut done: Vec<Option<Captured>>) -> Vec<Captured> {
        if self.bands == 1 {
            return done.into_iter().flatten().collect();
        }
        let images = done.len() / self.bands;
        (0..images)
            .map(|image| {
                let bands = self
                    .exposures_of(image)
                    .filter_map(|exposure| done[exposure].take());
                together(bands.collect())
            })
            .collect()
    }
}

/// One image of the frames of its `bands`, each of one channel: with the times of the first, the attempts of the one that needed most and
/// the flags of all.
fn together(mut bands: Vec<Captured>) -> Captured {
    let values = bands[0].dn.len();
    let mut dn = Vec::with_capacity(values * bands.len());
    for pixel in 0..values {
        dn.extend(bands.iter().map(|band| band.dn[pixel]));
    }
    let attempts = bands.iter().map(|band| band.attempts).max().unwrap_or(1);
    let flags = bands.iter().fold(0, |flags, band| flags | band.flags);
    Captured {
        dn,
        attempts,
        flags,
        ..bands.swap_remove(0)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use rcg_protocol::Ticks;

    use super::*;

    fn shot(number: usize) -> Captured {
        Captured {
            dn: vec![number as u16, 1000 + number as u16],
            ticks: [Ticks(number as u64); 3],
            frame_id: number as u64,
            camera_timestamp_s: number as f64,
            attempts: 1 + (number % 3) as u8,
            flags: 1 << (number % 3),
        }
    }

    proptest! {
        /// Whatever is missing, images are whole or taken again as a whole, and every frame comes into the channel of its band.
        #[test]
        fn bands_of_an_image_stay_together(
            patterns in 1_usize..5,
            brackets in 1_usize..4,
            bands in prop_oneof![Just(1_usize), Just(3)],
            missing in proptest::collection::vec(any::<proptest::sample::Index>(), 0..4),
        ) {
            let order = Order { brackets, bands };
            let count = patterns * brackets * bands;
            let whole: Vec<Option<Captured>> = (0..count).map(|number| Some(shot(number))).collect();
            prop_assert!(order.open(&whole).is_empty());
            let mut done = whole.clone();
            let missing: Vec<usize> = missing.iter().map(|index| index.index(count)).collect();
            for exposure in &missing {
                done[*exposure] = None;
            }
            let open = order.open(&done);
            for exposure in 0..count {
                let (image, band) = order.image_and_band(exposure);
                prop_assert_eq!(order.exposures_of(image).nth(band), Some(exposure));
                let is_open = missing.iter().any(|missing| order.image_and_band(*missing).0 == image);
                prop_assert_eq!(open.contains(&exposure), is_open);
            }
            let images = order.images(whole);
            prop_assert_eq!(images.len(), patterns * brackets);
            for (number, image) in images.iter().enumerate() {
                let frames: Vec<usize> = order.exposures_of(number).collect();
                let expected: Vec<u16> = [0, 1000].iter()
                    .flat_map(|more| frames.iter().map(move |frame| more + *frame as u16))
                    .collect();
                prop_assert_eq!(&image.dn, &expected);
                prop_assert_eq!(image.frame_id, frames[0] as u64);
            }
        }
    }

    #[test]
    fn a_pattern_of_one_primary_is_dark_in_the_bands_of_others() {
        let order = Order {
            brackets: 1,
            bands: 3,
        };
        for band in 0..3 {
            let mut image = BitPattern::black(16, 4);
            image.light(&[3, 17]);
            order.show(band, &mut image);
            assert_eq!((image.primary(), image.lit().len()), (Some(band as u8), 2));
            image.set_primary(Some(1));
            order.show(band, &mut image);
            assert_eq!(image.lit().len(), if band == 1 { 2 } else { 0 });
        }
    }
}
