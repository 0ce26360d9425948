//! Charts as a PDF of one page.
//!
//! # Design
//! A backend of the drawing library that writes vectors (ISO 32000-1, 8 and 9). Text is drawn as the outlines of its letters: it is the same
//! everywhere, and no font has to be put into the file. Pictures are embedded as they are, without loss. The same chart gives the same
//! bytes: there is no date in it.

use std::collections::BTreeMap;
use std::convert::Infallible;
use std::io::Write as _;

use ab_glyph::{Font as _, FontRef, OutlineCurve, PxScale, ScaleFont as _};
use flate2::Compression;
use flate2::write::ZlibEncoder;
use pdf_writer::{Content, Filter, Finish as _, Name, Pdf, Rect, Ref, TextStr};
use plotters_backend::text_anchor::{HPos, VPos};
use plotters_backend::{
    BackendColor, BackendCoord, BackendStyle, BackendTextStyle, DrawingBackend, DrawingErrorKind,
    FontTransform,
};

/// Points of a pixel: a chart is as wide as the text of a page of A4.
const POINTS: f32 = 0.24;
/// Of the size that the drawing library gives to a font, its em (as in its other backends).
const EM: f32 = 1.0 / 1.24;
/// Handles of a cubic curve that is a quarter of a circle, in radii.
const QUARTER: f32 = 0.552_285;

type Drawn = Result<(), DrawingErrorKind<Infallible>>;

/// What draws on a page.
pub(super) struct PdfBackend<'a>(pub(super) &'a mut PdfPage);

/// A page that is drawn.
pub(super) struct PdfPage {
    size: (u32, u32),
    content: Content,
    font: FontRef<'static>,
    /// Opacities that were used, in percent.
    opacities: BTreeMap<u8, Vec<u8>>,
    pictures: Vec<Embedded>,
}

/// A picture on the page.
struct Embedded {
    name: Vec<u8>,
    /// Width and height in pixels.
    size: (u32, u32),
    rgb: Vec<u8>,
}

impl PdfPage {
    pub(super) fn new(size: (u32, u32)) -> Self {
        let mut content = Content::new();
        // From pixels whose rows run downwards.
        content.transform([POINTS, 0.0, 0.0, -POINTS, 0.0, size.1 as f32 * POINTS]);
        Self {
            size,
            content,
            font: FontRef::try_from_slice(dejavu::sans::regular())
                .expect("invariant: the font that is built in can be read"),
            opacities: BTreeMap::new(),
            pictures: Vec::new(),
        }
    }

    /// The bytes of the file, which says `title` of itself.
    pub(super) fn finish(self, title: &str) -> Vec<u8> {
        let mut pdf = Pdf::new();
        let mut next = 0;
        let mut id = || {
            next += 1;
            Ref::new(next)
        };
        let (catalog, pages, page_id, content_id, info) = (id(), id(), id(), id(), id());
        let picture_ids: Vec<Ref> = self.pictures.iter().map(|_| id()).collect();
        pdf.catalog(catalog).pages(pages);
        pdf.pages(pages).kids([page_id]).count(1);
        pdf.document_info(info)
            .title(TextStr(title))
            .producer(TextStr("rcg"));
        let mut page = pdf.page(page_id);
        let (width, height) = (self.size.0 as f32 * POINTS, self.size.1 as f32 * POINTS);
        page.media_box(Rect::new(0.0, 0.0, width, height));
        page.parent(pages).contents(content_id);
        let mut resources = page.resources();
        let mut states = resources.ext_g_states();
        for (percent, name) in &self.opacities {
            let share = f32::from(*percent) / 100.0;
            states
                .insert(Name(name))
                .start::<pdf_writer::writers::ExtGraphicsState<'_>>()
                .non_stroking_alpha(share)
                .stroking_alpha(share);
        }
        states.finish();
        let mut objects = resources.x_objects();
        for (picture, id) in self.pictures.iter().zip(&picture_ids) {
            objects.pair(Name(&picture.name), *id);
        }
        objects.finish();
        resources.finish();
        page.finish();
        for (embedded, id) in self.pictures.iter().zip(picture_ids) {
            let packed = packed(&embedded.rgb);
            let (width, height) = embedded.size;
            let mut picture = pdf.image_xobject(id, &packed);
            picture.filter(Filter::FlateDecode);
            picture.width(width as i32).height(height as i32);
            picture.color_space().device_rgb();
            picture.bits_per_component(8);
        }
        let content = packed(self.content.finish().as_slice());
        pdf.stream(content_id, &content).filter(Filter::FlateDecode);
        pdf.finish()
    }

    /// What is drawn from now on has this colour.
    fn ink(&mut self, colour: BackendColor, is_stroke: bool) {
        let [r, g, b] = [colour.rgb.0, colour.rgb.1, colour.rgb.2].map(|byte| f32::from(byte) / 255.0);
        let percent = (100.0 * colour.alpha).round().clamp(0.0, 100.0) as u8;
        let name = self
            .opacities
            .entry(percent)
            .or_insert_with(|| format!("o{percent}").into_bytes());
        self.content.set_parameters(Name(name));
        if is_stroke {
            self.content.set_stroke_rgb(r, g, b);
        } else {
            self.content.set_fill_rgb(r, g, b);
        }
    }

    /// A path through `points`; whether there is one.
    fn path(&mut self, points: impl IntoIterator<Item = BackendCoord>) -> bool {
        let mut points = points.into_iter();
        let Some((x, y)) = points.next() else {
            return false;
        };
        self.content.move_to(x as f32, y as f32);
        for (x, y) in points {
            self.content.line_to(x as f32, y as f32);
        }
        true
    }

    /// The letters of `text`, whose size the drawing library calls `size`, from the origin on along a base line.
    fn letters(&mut self, text: &str, size: f32) {
        let scaled = self.font.as_scaled(PxScale::from(size));
        let factor = size / self.font.height_unscaled();
        let (mut x, mut before) = (0.0, None);
        for letter in text.chars() {
            let glyph = self.font.glyph_id(letter);
            if let Some(before) = before {
                x += scaled.kern(before, glyph);
            }
            let at = |point: ab_glyph::Point| (x + factor * point.x, -factor * point.y);
            let mut last = None;
            for curve in self
                .font
                .outline(glyph)
                .into_iter()
                .flat_map(|outline| outline.curves)
            {
                let (from, to) = match curve {
                    OutlineCurve::Line(a, b)
                    | OutlineCurve::Quad(a, _, b)
                    | OutlineCurve::Cubic(a, _, _, b) => (a, b),
                };
                if last != Some(from) {
                    self.content.move_to(at(from).0, at(from).1);
                }
                let end = at(to);
                match curve {
                    OutlineCurve::Line(..) => {
                        self.content.line_to(end.0, end.1);
                    }
                    OutlineCurve::Quad(from, by, to) => {
                        // A cubic curve with the same points.
                        let third = |end: ab_glyph::Point| {
                            at(ab_glyph::point(
                                (end.x + 2.0 * by.x) / 3.0,
                                (end.y + 2.0 * by.y) / 3.0,
                            ))
                        };
                        let (a, b) = (third(from), third(to));
                        self.content.cubic_to(a.0, a.1, b.0, b.1, end.0, end.1);
                    }
                    OutlineCurve::Cubic(_, a, b, _) => {
                        let (a, b) = (at(a), at(b));
                        self.content.cubic_to(a.0, a.1, b.0, b.1, end.0, end.1);
                    }
                }
                last = Some(to);
            }
            x += scaled.h_advance(glyph);
            before = Some(glyph);
        }
        self.content.fill_nonzero();
    }

    fn width(&self, text: &str, size: f32) -> f32 {
        let scaled = self.font.as_scaled(PxScale::from(size));
        let glyphs: Vec<_> = text.chars().map(|letter| self.font.glyph_id(letter)).collect();
        let kerned: f32 = glyphs.windows(2).map(|two| scaled.kern(two[0], two[1])).sum();
        kerned + glyphs.iter().map(|&glyph| scaled.h_advance(glyph)).sum::<f32>()
    }
}

fn packed(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = ZlibEncoder::new(Vec::new(), Compression::default());
    encoder
        .write_all(bytes)
        .and_then(|()| encoder.finish())
        .expect("invariant: memory takes everything")
}

impl DrawingBackend for PdfBackend<'_> {
    type ErrorType = Infallible;

    fn get_size(&self) -> (u32, u32) {
        self.0.size
    }

    fn ensure_prepared(&mut self) -> Drawn {
        Ok(())
    }

    fn present(&mut self) -> Drawn {
        Ok(())
    }

    fn draw_pixel(&mut self, (x, y): BackendCoord, colour: BackendColor) -> Drawn {
        self.0.ink(colour, false);
        self.0.content.rect(x as f32, y as f32, 1.0, 1.0).fill_nonzero();
        Ok(())
    }

    fn draw_line<S: BackendStyle>(&mut self, from: BackendCoord, to: BackendCoord, style: &S) -> Drawn {
        self.draw_path([from, to], style)
    }

    fn draw_rect<S: BackendStyle>(
        &mut self,
        (x0, y0): BackendCoord,
        (x1, y1): BackendCoord,
        style: &S,
        fill: bool,
    ) -> Drawn {
        self.0.ink(style.color(), !fill);
        let [x, y, width, height] = [x0, y0, x1 - x0, y1 - y0].map(|number| number as f32);
        if fill {
            self.0.content.rect(x, y, width, height).fill_nonzero();
        } else {
            self.0.content.set_line_width(style.stroke_width() as f32);
            self.0.content.rect(x, y, width, height).stroke();
        }
        Ok(())
    }

    fn draw_path<S: BackendStyle, I: IntoIterator<Item = BackendCoord>>(
        &mut self,
        path: I,
        style: &S,
    ) -> Drawn {
        self.0.ink(style.color(), true);
        self.0.content.set_line_width(style.stroke_width() as f32);
        if self.0.path(path) {
            self.0.content.stroke();
        }
        Ok(())
    }

    fn draw_circle<S: BackendStyle>(
        &mut self,
        (x, y): BackendCoord,
        radius: u32,
        style: &S,
        fill: bool,
    ) -> Drawn {
        self.0.ink(style.color(), !fill);
        let (x, y, r) = (x as f32, y as f32, radius as f32);
        let h = QUARTER * r;
        self.0
            .content
            .move_to(x + r, y)
            .cubic_to(x + r, y + h, x + h, y + r, x, y + r)
            .cubic_to(x - h, y + r, x - r, y + h, x - r, y)
            .cubic_to(x - r, y - h, x - h, y - r, x, y - r)
            .cubic_to(x + h, y - r, x + r, y - h, x + r, y)
            .close_path();
        if fill {
            self.0.content.fill_nonzero();
        } else {
            self.0
                .content
                .set_line_width(style.stroke_width() as f32)
                .stroke();
        }
        Ok(())
    }

    fn fill_polygon<S: BackendStyle, I: IntoIterator<Item = BackendCoord>>(
        &mut self,
        corners: I,
        style: &S,
    ) -> Drawn {
        self.0.ink(style.color(), false);
        if self.0.path(corners) {
            self.0.content.close_path().fill_nonzero();
        }
        Ok(())
    }

    fn draw_text<S: BackendTextStyle>(&mut self, text: &str, style: &S, (x, y): BackendCoord) -> Drawn {
        let size = style.size() as f32;
        let em = EM * size;
        let along = match style.anchor().h_pos {
            HPos::Left => 0.0,
            HPos::Center => -self.0.width(text, size) / 2.0,
            HPos::Right => -self.0.width(text, size),
        };
        let down = match style.anchor().v_pos {
            VPos::Top => 0.76 * em,
            VPos::Center => 0.27 * em,
            VPos::Bottom => -0.27 * em,
        };
        let (cos, sin) = match style.transform() {
            FontTransform::None => (1.0, 0.0),
            FontTransform::Rotate90 => (0.0, 1.0),
            FontTransform::Rotate180 => (-1.0, 0.0),
            FontTransform::Rotate270 => (0.0, -1.0),
        };
        self.0.ink(style.color(), false);
        self.0.content.save_state();
        self.0
            .content
            .transform([cos, sin, -sin, cos, x as f32, y as f32]);
        self.0.content.transform([1.0, 0.0, 0.0, 1.0, along, down]);
        self.0.letters(text, size);
        self.0.content.restore_state();
        Ok(())
    }

    fn blit_bitmap(&mut self, (x, y): BackendCoord, (width, height): (u32, u32), rgb: &[u8]) -> Drawn {
        let whole = BackendColor {
            alpha: 1.0,
            rgb: (0, 0, 0),
        };
        self.0.ink(whole, false);
        let name = format!("p{}", self.0.pictures.len()).into_bytes();
        // A picture covers a unit square whose rows run upwards.
        let (w, h) = (width as f32, height as f32);
        self.0.content.save_state();
        self.0
            .content
            .transform([w, 0.0, 0.0, -h, x as f32, y as f32 + h]);
        self.0.content.x_object(Name(&name));
        self.0.content.restore_state();
        self.0.pictures.push(Embedded {
            name,
            size: (width, height),
            rgb: rgb.to_vec(),
        });
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use plotters::prelude::*;

    use super::*;

    #[test]
    fn the_same_drawing_gives_the_same_whole_file_with_its_letters_and_pictures() {
        let file = |text: &str| {
            let mut page = PdfPage::new((400, 200));
            let mut backend = PdfBackend(&mut page);
            let style = TextStyle::from(("sans-serif", 40).into_font());
            backend.draw_text(text, &style, (10, 20)).unwrap();
            backend
                .blit_bitmap((0, 0), (2, 1), &[255, 0, 0, 0, 0, 255])
                .unwrap();
            backend.draw_circle((100, 100), 5, &BLUE.mix(0.5), true).unwrap();
            page.finish("θ")
        };
        let pdf = file("σ·θ");
        assert!(pdf == file("σ·θ") && pdf != file("σ·φ") && file("σθφ").len() > file("").len() + 200);
        assert!(pdf.starts_with(b"%PDF-1.") && pdf.ends_with(b"%%EOF"));
        let has = |what: &[u8]| pdf.windows(what.len()).any(|part| part == what);
        assert!(has(b"/MediaBox [0 0 96 48]") && has(b"/Width 2") && has(b"/ca 0.5"));
    }
}
