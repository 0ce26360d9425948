//! Patterns as an X server draws them: runs of lit pixels in rows, on black.

use x11rb::protocol::xproto::Rectangle;

use crate::plan::pattern::BitPattern;

/// Side by side, lit pixels are one run.
#[derive(Clone, Debug)]
pub(super) struct Picture {
    /// The value of lit pixels: red in bits 16 to 23, green in 8 to 15, blue in 0 to 7.
    pub(super) colour: u32,
    /// Runs of lit pixels, from the top, in pixels of the image; each is one pixel high.
    pub(super) runs: Vec<Rectangle>,
}

impl Picture {
    /// What shows `pattern`.
    pub(super) fn of(pattern: &BitPattern) -> Self {
        let level = u32::from(pattern.level());
        let colour = match pattern.primary() {
            Some(primary) => level << (16 - 8 * u32::from(primary)),
            None => level * 0x01_01_01,
        };
        let width = pattern.size_px().0 as u32;
        let mut runs: Vec<Rectangle> = Vec::new();
        let mut next = None;
        for pixel in pattern.lit() {
            let x = pixel % width;
            match runs.last_mut() {
                Some(run) if next == Some(pixel) && x > 0 => run.width += 1,
                _ => runs.push(Rectangle {
                    x: x as i16,
                    y: (pixel / width) as i16,
                    width: 1,
                    height: 1,
                }),
            }
            next = Some(pixel + 1);
        }
        Self { colour, runs }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        /// Painted, the runs are the pattern.
        #[test]
        fn runs_light_just_the_lit_pixels_in_the_colour(
            (width, height, lit) in (1_usize..40, 1_usize..8).prop_flat_map(|(width, height)| {
                (Just(width), Just(height), proptest::collection::vec(any::<bool>(), width * height))
            }),
            level in 1_u8..=255,
            primary in proptest::option::of(0_u8..3),
        ) {
            let pixels: Vec<u32> = (0..lit.len() as u32).filter(|pixel| lit[*pixel as usize]).collect();
            let mut pattern = BitPattern::black(width, height);
            pattern.light(&pixels);
            pattern.set_level(level);
            pattern.set_primary(primary);
            let picture = Picture::of(&pattern);
            let [_, red, green, blue] = picture.colour.to_be_bytes();
            let mut expected = [if primary.is_none() { level } else { 0 }; 3];
            if let Some(primary) = primary {
                expected[usize::from(primary)] = level;
            }
            prop_assert_eq!([red, green, blue], expected);
            let mut painted = vec![0; lit.len()];
            for run in &picture.runs {
                prop_assert_eq!(run.height, 1);
                prop_assert!(run.x as usize + usize::from(run.width) <= width);
                for x in run.x as usize..run.x as usize + usize::from(run.width) {
                    painted[run.y as usize * width + x] += 1;
                }
            }
            let expected: Vec<i32> = lit.iter().map(|lit| i32::from(*lit)).collect();
            prop_assert_eq!(painted, expected);
            // No two runs that could be one.
            let is_joined = |pair: &[Rectangle]| {
                pair[0].y == pair[1].y && pair[0].x as usize + usize::from(pair[0].width) == pair[1].x as usize
            };
            prop_assert!(!picture.runs.windows(2).any(is_joined));
        }
    }
}
