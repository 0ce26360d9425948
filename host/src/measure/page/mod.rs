//! The page that one sends to a colleague: one file that needs nothing else.
//!
//! # Design
//! What a person reads stands there as text and tables, and in pictures that are a part of the file. What a person looks at from all
//! sides is drawn by the page's own program (`page.js`, plain WebGL2 and canvas) from values that it carries (`shown`). It asks no
//! network for anything, and what it does not know it hatches.

mod record;
mod shown;
mod timing;

use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;

use self::record::record_html;
use self::shown::Shown;
use self::timing::Timing;
use super::budget::budget_html;
use super::report::{LIGHTS_DEG, PUBLISHED, ReportError, escape, quantile};
use crate::base::text::duration;
use crate::brdf::Brdf;
use crate::brdf::sample::Sample;
use crate::capture::directory::Measurement;
use crate::judge::evaluate::{Evaluation, Quantile};
use crate::judge::render::azimuth_in_words;

/// How it looks, and what it does.
const STYLE: &str = include_str!("page.css");
const PROGRAM: &str = include_str!("page.js");
/// Bytes of a picture that becomes a part of the page at most.
const MOST_PICTURE: u64 = 600_000;

/// What is known of how a BRDF was captured.
pub struct Capture {
    timing: Timing,
    record: String,
}

impl Capture {
    /// Of `measurement`.
    ///
    /// # Errors
    /// [`ReportError`] if its files cannot be read.
    pub fn of(measurement: &Measurement) -> Result<Self, ReportError> {
        let raw = measurement.raw()?;
        Ok(Self {
            timing: Timing::of(&raw, f64::from(raw.layout().clock_hz))?,
            record: record_html(measurement)?,
        })
    }
}

/// What stands on a page.
pub struct Page<'a> {
    /// What was measured.
    pub title: &'a str,
    /// (what, figure).
    pub lines: Vec<(&'static str, String)>,
    /// How good it is.
    pub evaluation: &'a Evaluation,
    /// Lit spheres and camera images.
    pub pictures: Option<[&'a Path; 2]>,
    /// How it was captured, if that is known.
    pub capture: Option<Capture>,
    /// Time on the instrument in s.
    pub instrument_s: Option<f64>,
}

impl Page<'_> {
    /// The page of `brdf`, beside the `reference` that it was judged by.
    ///
    /// # Errors
    /// [`ReportError`] if the file cannot be read.
    pub fn html(&self, brdf: &Brdf, reference: Option<&dyn Sample>) -> Result<String, ReportError> {
        let shown = Shown::of(brdf, reference)?;
        let mut facts = shown.facts;
        let against = self.evaluation.against_reference.as_ref();
        facts["reference"] = against.map_or(serde_json::Value::Null, |against| {
            against.reference.clone().into()
        });
        let (timing, record) = self.capture.as_ref().map_or_else(Default::default, |capture| {
            (self.capture_html(&capture.timing), capture.record.as_str())
        });
        let title = escape(self.title);
        Ok(format!(
            "<!doctype html>\n<html lang=\"en\">\n<meta charset=\"utf-8\">\n<meta name=\"viewport\" content=\"width=device-width\">\n\
             <title>RCG: {title}</title>\n<style>\n{STYLE}</style>\n<h1>{title}</h1>\n{warnings}{quality}{views}{pictures}{timing}\
             <h2>All figures</h2>\n<table>\n{rows}</table>\n{budget}{record}\
             <script type=\"application/json\" id=\"facts\">{facts}</script>\n\
             <script type=\"text/plain\" id=\"values\">{text}</script>\n<script>\n{PROGRAM}</script>\n</html>\n",
            warnings = self.warnings(),
            quality = self.quality(),
            views = views_html(),
            pictures = self.pictures_html(),
            rows = self.rows(|_| true),
            budget = budget_html(&self.evaluation.budget),
            // A text may hold what would end the element, or begin another.
            facts = facts.to_string().replace('<', "\\u003c"),
            text = shown.text,
        ))
    }

    fn warnings(&self) -> String {
        let mut html = String::new();
        for sentence in &self.evaluation.warnings {
            writeln!(html, "<p class=\"warning\">{}</p>", escape(sentence)).expect("strings take everything");
        }
        html
    }

    fn rows(&self, is_asked: impl Fn(&str) -> bool) -> String {
        let mut rows = String::new();
        for (what, figure) in self.lines.iter().filter(|(what, _)| is_asked(what)) {
            writeln!(
                rows,
                "<tr><th>{}</th><td>{}</td></tr>",
                escape(what),
                escape(figure)
            )
            .expect("strings take everything");
        }
        rows
    }

    /// How good it is, beside what others state.
    fn quality(&self) -> String {
        let sigma = match self.evaluation.median_relative_sigma {
            Quantile::At(sigma) => format!("{} (k = 2, median)", quantile(Quantile::At(2.0 * sigma))),
            other => quantile(other),
        };
        let time = self
            .instrument_s
            .map_or_else(|| "not known here".to_owned(), duration);
        let mut rows = vec![
            ("this measurement".to_owned(), sigma, time),
            (
                "the prototype of 2007 (32,400 images of 8 bits, hole of 27°)".to_owned(),
                "not stated".to_owned(),
                "50 min".to_owned(),
            ),
        ];
        let others = PUBLISHED.iter();
        rows.extend(others.map(|(who, states)| ((*who).to_owned(), (*states).to_owned(), String::new())));
        let row = |(who, uncertainty, time): (String, String, String)| {
            let cells = [who, uncertainty, time].map(|cell| escape(&cell));
            format!(
                "<tr><th>{}</th><td>{}</td><td>{}</td></tr>\n",
                cells[0], cells[1], cells[2]
            )
        };
        format!(
            "<h2>Beside others</h2>\n<table>\n<tr><th></th><th>relative uncertainty</th><th>time on the instrument</th></tr>\n{}</table>\n",
            rows.into_iter().map(row).collect::<String>()
        )
    }

    /// Triggers, frames and exposures.
    fn capture_html(&self, timing: &Timing) -> String {
        let histogram = timing
            .histogram()
            .map(|svg| format!("<div class=\"chart\">{svg}</div>\n"));
        format!(
            "<h2>Triggers and strobes</h2>\n<p>{}.</p>\n<table>\n{}</table>\n{}",
            escape(&timing.sentence()),
            self.rows(|what| ["exposures", "triggers", "dynamic range"].contains(&what)),
            histogram.unwrap_or_default()
        )
    }

    fn pictures_html(&self) -> String {
        let Some([spheres, frames]) = self.pictures else {
            return String::new();
        };
        let beside = |path: &Path| {
            let name = path
                .file_name()
                .and_then(|name| name.to_str())
                .unwrap_or_default();
            embedded(path).unwrap_or_else(|| format!("figures/{name}"))
        };
        let shown = match &self.evaluation.against_reference {
            Some(against) => format!("Above as measured, below {}", escape(&against.reference)),
            None => "As measured".to_owned(),
        };
        format!(
            "<h2>Spheres</h2>\n<p>{shown}; lights at {}. {}. Hatched: directions that were not measured.</p>\n\
             <img src=\"{}\" alt=\"lit spheres\">\n<h2>Camera images</h2>\n<p>From steep to grazing incidence, each stretched to its own \
             range.</p>\n<img src=\"{}\" alt=\"camera images\">\n",
            LIGHTS_DEG
                .map(|(theta, phi)| format!("({theta}°, {phi}°)"))
                .join(", "),
            azimuth_in_words(Some(&self.evaluation.azimuth.zero())),
            beside(spheres),
            beside(frames),
        )
    }
}

/// The views that the page's program draws.
fn views_html() -> String {
    let canvas = |id: &str, label: &str, help: &str| {
        format!(
            "<figure><figcaption>{label}</figcaption><canvas id=\"{id}\" tabindex=\"0\" role=\"img\" aria-label=\"{label}. {help}\">\
             </canvas><p class=\"help\">{help}</p></figure>\n"
        )
    };
    format!(
        "<h2>Values</h2>\n<p id=\"state\" aria-live=\"polite\"></p>\n<div class=\"controls\" id=\"controls\"></div>\n<div class=\"views\">\n\
         {}{}{}{}{}</div>\n<noscript><p>The views are drawn by a program in this page, which this browser does not run.</p></noscript>\n",
        canvas(
            "light",
            "Incident directions",
            "Click, drag or use the arrow keys to choose one. Empty dots: not lit."
        ),
        canvas(
            "hemisphere",
            "Outgoing hemisphere",
            "Point at it, or use the arrow keys, to read a value."
        ),
        canvas(
            "plane",
            "Plane of incidence",
            "f against θ of view, and its interval of k = 2."
        ),
        canvas("lobe", "Lobe", "Drag, or use the arrow keys, to turn it."),
        canvas(
            "sphere",
            "Sphere under a distant light",
            "Drag, or use the arrow keys, to move the light."
        ),
    )
}

/// The picture at `path` as an address that holds all of it; `None` if it is large, no picture, or not there.
fn embedded(path: &Path) -> Option<String> {
    let ending = path.extension()?.to_str()?.to_lowercase();
    let kind = match ending.as_str() {
        "jpg" | "jpeg" => "jpeg",
        "png" | "webp" => ending.as_str(),
        _ => return None,
    };
    if fs::metadata(path).ok()?.len() > MOST_PICTURE {
        return None;
    }
    let bytes = fs::read(path).ok()?;
    Some(format!("data:image/{kind};base64,{}", STANDARD.encode(bytes)))
}
