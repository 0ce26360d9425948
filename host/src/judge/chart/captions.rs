//! Captions above the columns of a picture.

use image::{Rgb, RgbImage, imageops};
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::font;

/// Pixels of a strip of captions.
const STRIP: u32 = 34;

/// `image` below a strip that captions its columns, all equally wide.
#[must_use]
pub fn captioned(image: &RgbImage, captions: &[String]) -> RgbImage {
    let width = image.width();
    let mut whole = RgbImage::from_pixel(width, image.height() + STRIP, Rgb([255; 3]));
    imageops::replace(&mut whole, &strip(width, captions), 0, 0);
    imageops::replace(&mut whole, image, 0, i64::from(STRIP));
    whole
}

fn strip(width: u32, captions: &[String]) -> RgbImage {
    font::register();
    let column = f64::from(width) / captions.len().max(1) as f64;
    let mut bytes = vec![255; width as usize * STRIP as usize * 3];
    {
        let area = BitMapBackend::with_buffer(&mut bytes, (width, STRIP)).into_drawing_area();
        let style = TextStyle::from(("sans-serif", 17).into_font()).pos(Pos::new(HPos::Center, VPos::Center));
        for (index, caption) in captions.iter().enumerate() {
            let x = (index as f64 + 0.5) * column;
            area.draw_text(caption, &style, (x as i32, STRIP as i32 / 2))
                .expect("invariant: memory takes everything");
        }
    }
    RgbImage::from_raw(width, STRIP, bytes).expect("invariant: three bytes a pixel")
}
