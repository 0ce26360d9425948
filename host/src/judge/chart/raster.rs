//! From SVG to pixels, with a font that is built in.

use std::fmt::Write as _;
use std::sync::Arc;

use image::{Rgb, RgbImage, imageops};
use resvg::{tiny_skia, usvg};

/// Pixels of a strip of captions.
const STRIP: u32 = 34;

/// Draws an SVG document of this crate, `scale` times its size, on white.
#[must_use]
pub fn draw_svg(document: &str, scale: f32) -> RgbImage {
    let mut fonts = usvg::fontdb::Database::new();
    fonts.load_font_data(dejavu::sans::regular().to_vec());
    fonts.set_sans_serif_family("DejaVu Sans");
    let options = usvg::Options {
        font_family: "DejaVu Sans".to_owned(),
        fontdb: Arc::new(fonts),
        ..usvg::Options::default()
    };
    let tree = usvg::Tree::from_str(document, &options).expect("invariant: our own SVG is well formed");
    let (width, height) = (
        (tree.size().width() * scale).round() as u32,
        (tree.size().height() * scale).round() as u32,
    );
    let mut pixmap = tiny_skia::Pixmap::new(width, height).expect("invariant: a chart has pixels");
    pixmap.fill(tiny_skia::Color::WHITE);
    resvg::render(
        &tree,
        tiny_skia::Transform::from_scale(scale, scale),
        &mut pixmap.as_mut(),
    );
    let bytes = pixmap
        .data()
        .chunks_exact(4)
        .flat_map(|rgba| [rgba[0], rgba[1], rgba[2]]);
    RgbImage::from_raw(width, height, bytes.collect()).expect("invariant: three bytes a pixel")
}

/// `image` below a strip that captions its columns, all equally wide.
#[must_use]
pub fn captioned(image: &RgbImage, captions: &[String]) -> RgbImage {
    let width = image.width();
    let column = f64::from(width) / captions.len().max(1) as f64;
    let mut texts = String::new();
    for (index, caption) in captions.iter().enumerate() {
        let caption = caption.replace('&', "&amp;").replace('<', "&lt;");
        let x = (index as f64 + 0.5) * column;
        write!(
            texts,
            r#"<text x="{x}" y="23" font-size="17" text-anchor="middle">{caption}</text>"#
        )
        .expect("strings take everything");
    }
    let strip = draw_svg(
        &format!(
            r#"<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{STRIP}" font-family="sans-serif">{texts}</svg>"#
        ),
        1.0,
    );
    let mut whole = RgbImage::from_pixel(width, image.height() + STRIP, Rgb([255; 3]));
    imageops::replace(&mut whole, &strip, 0, 0);
    imageops::replace(&mut whole, image, 0, i64::from(STRIP));
    whole
}
