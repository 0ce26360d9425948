//! How far the measurement in a directory is: whoever takes it knows nothing of who looks on.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::Instant;

use rcg::calibrate::live::{Look, Picture};
use rcg::instrument::frame_format::FrameFormat;
use rcg::store::{RawStore, StoreError};
use serde::Serialize;
use serde_json::Value;

/// How far a measurement is.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub(crate) struct HowFar {
    /// Its directory.
    pub(crate) dir: String,
    /// What its manifest says of it: planned, captured …
    pub(crate) state: String,
    /// Exposures that are captured, and all.
    pub(crate) done: usize,
    pub(crate) of: usize,
    /// Exposures a second since this program looks on, and seconds that are left at this rate.
    pub(crate) rate_hz: Option<f64>,
    pub(crate) left_s: Option<f64>,
    /// Triggers that the camera missed, frames that were dropped, exposures that were repeated.
    pub(crate) missed: u64,
    pub(crate) dropped: u64,
    pub(crate) repeated: u64,
    /// The newest frame that is stored.
    pub(crate) look: Option<Look>,
    /// Whether there is a report.
    pub(crate) has_report: bool,
    /// What is the matter, if something is.
    pub(crate) problem: Option<String>,
}

/// Who looks on.
pub(crate) struct Watch {
    dir: PathBuf,
    /// Segments when something was captured first while somebody looked on, and when that was.
    began: Option<(usize, Instant)>,
    seen: Option<usize>,
    look: Option<Look>,
}

impl Watch {
    /// Of the measurement in `dir`.
    pub(crate) fn new(dir: &Path) -> Self {
        Self {
            dir: dir.to_owned(),
            began: None,
            seen: None,
            look: None,
        }
    }

    /// How far it is now, and its newest frame where that is another than before.
    pub(crate) fn look(&mut self) -> (HowFar, Option<Picture>) {
        let mut far = HowFar {
            dir: self.dir.display().to_string(),
            state: self.state(),
            has_report: self.dir.join("report.html").is_file(),
            ..HowFar::default()
        };
        if !self.dir.join("raw.zarr").exists() {
            far.problem = Some(format!(
                "{}: expected a measurement, found no frames yet",
                far.dir
            ));
            return (far, None);
        }
        match self.frames(&mut far) {
            Ok(picture) => (far, picture),
            Err(error) => {
                far.problem = Some(error.to_string());
                (far, None)
            }
        }
    }

    /// What the manifest says.
    fn state(&self) -> String {
        let manifest = fs::read(self.dir.join("manifest.json")).ok();
        let manifest = manifest.and_then(|bytes| serde_json::from_slice::<Value>(&bytes).ok());
        let state = manifest.and_then(|facts| facts["state"].as_str().map(str::to_owned));
        state.unwrap_or_else(|| "unknown".to_owned())
    }

    fn frames(&mut self, far: &mut HowFar) -> Result<Option<Picture>, StoreError> {
        let raw = RawStore::open(&self.dir.join("raw.zarr"))?;
        let (layout, whole) = (*raw.layout(), raw.whole_segments()?);
        let count = |segments: usize| {
            (0..segments)
                .map(|index| raw.segment_range(index).len())
                .sum::<usize>()
        };
        (far.done, far.of) = (count(whole), layout.exposures);
        let tally = raw.tally()?;
        (far.missed, far.dropped, far.repeated) =
            (tally.missed_triggers, tally.dropped_frames, tally.repeated);
        let is_new = self.seen.replace(whole).is_some_and(|seen| seen < whole);
        if is_new && self.began.is_none() {
            self.began = Some((whole, Instant::now()));
        }
        if let Some((first, since)) = self.began
            && whole > first
        {
            let rate_hz = (count(whole) - count(first)) as f64 / since.elapsed().as_secs_f64();
            far.rate_hz = Some(rate_hz);
            far.left_s = Some((far.of - far.done) as f64 / rate_hz);
        }
        if whole == 0 || self.look.is_some() && !is_new {
            far.look.clone_from(&self.look);
            return Ok(None);
        }
        let segment = raw.read_segment(whole - 1)?;
        let length = layout.height * layout.width * layout.channels;
        let newest = segment.frames.chunks_exact(length).last().unwrap_or(&[]);
        let format = FrameFormat {
            width_px: layout.width,
            height_px: layout.height,
            channels: layout.channels,
            bits: layout.bits,
        };
        self.look = Some(Look::of(newest, format, 0.0));
        far.look.clone_from(&self.look);
        Ok((!newest.is_empty()).then(|| Picture::of(newest, format)))
    }
}
