//! What is drawn on one page, and saved in any format of a chart.

use std::fmt::Write as _;
use std::path::Path;

use base64::Engine as _;
use base64::prelude::BASE64_STANDARD;
use image::{RgbImage, imageops};
use plotters::coord::Shift;
use plotters::prelude::*;

use super::pdf::{PdfBackend, PdfPage};
use super::{ChartError, font};
use crate::base::file_format::CHART;
use crate::judge::render::{coded_png, save};
use crate::store::whole_file::write_whole;

/// What ends the white ground in a document, behind which pictures stand.
const GROUND_END: &str = "stroke=\"none\"/>";

/// Something that is drawn on a page of white.
pub trait Sheet {
    /// What it is called.
    fn title(&self) -> &str;

    /// Width and height in pixels.
    fn size(&self) -> (u32, u32);

    /// Pictures that stand behind all that is drawn, by their upper left corners.
    fn pictures(&self) -> Vec<((i32, i32), RgbImage)> {
        Vec::new()
    }

    /// Draws all but the pictures.
    ///
    /// # Errors
    /// What the backend says.
    fn draw<DB: DrawingBackend>(
        &self,
        root: &DrawingArea<DB, Shift>,
    ) -> Result<(), DrawingAreaErrorKind<DB::ErrorType>>;

    /// As an SVG document.
    #[must_use]
    fn svg(&self) -> String {
        let mut document = String::new();
        {
            let root = root(SVGBackend::with_string(&mut document, self.size()));
            root.fill(&WHITE)
                .and_then(|()| self.draw(&root))
                .and_then(|()| root.present())
                .expect("invariant: a string takes everything");
        }
        let mut images = String::new();
        for ((x, y), picture) in self.pictures() {
            let (width, height) = picture.dimensions();
            let bytes = coded_png(&picture, None).expect("invariant: memory takes everything");
            let data = BASE64_STANDARD.encode(bytes);
            write!(
                images,
                "\n<image x=\"{x}\" y=\"{y}\" width=\"{width}\" height=\"{height}\" href=\"data:image/png;base64,{data}\"/>"
            )
            .expect("strings take everything");
        }
        if let Some(end) = document.find(GROUND_END) {
            document.insert_str(end + GROUND_END.len(), &images);
        }
        document
    }

    /// As pixels.
    #[must_use]
    fn picture(&self) -> RgbImage {
        let (width, height) = self.size();
        let mut image = RgbImage::from_pixel(width, height, image::Rgb([255; 3]));
        for ((x, y), picture) in self.pictures() {
            imageops::replace(&mut image, &picture, i64::from(x), i64::from(y));
        }
        let mut bytes = image.into_raw();
        {
            let root = root(BitMapBackend::with_buffer(&mut bytes, (width, height)));
            self.draw(&root)
                .and_then(|()| root.present())
                .expect("invariant: memory takes everything");
        }
        RgbImage::from_raw(width, height, bytes).expect("invariant: three bytes a pixel")
    }

    /// As a PDF of one page.
    #[must_use]
    fn pdf(&self) -> Vec<u8> {
        let mut page = PdfPage::new(self.size());
        for (at, picture) in self.pictures() {
            PdfBackend(&mut page)
                .blit_bitmap(at, picture.dimensions(), picture.as_raw())
                .expect("invariant: memory takes everything");
        }
        {
            let root = root(PdfBackend(&mut page));
            self.draw(&root)
                .and_then(|()| root.present())
                .expect("invariant: memory takes everything");
        }
        page.finish(self.title())
    }

    /// Writes it: SVG, PDF or PNG, as the name of `path` ends.
    ///
    /// # Errors
    /// [`ChartError`].
    fn save(&self, path: &Path) -> Result<(), ChartError> {
        match CHART.of(path)? {
            "svg" => write_whole(path, self.svg().as_bytes())?,
            "pdf" => write_whole(path, &self.pdf())?,
            _ => save(&self.picture(), path)?,
        }
        Ok(())
    }
}

fn root<DB: DrawingBackend>(backend: DB) -> DrawingArea<DB, Shift> {
    font::register();
    backend.into_drawing_area()
}
