//! A camera that shows an earlier measurement once more, through the real chain.
//!
//! # Design
//! The frames come from the `raw.zarr` of a measurement; everything else is real: the trigger box fires, its records arrive, frames are
//! paired, what is missing is taken again, and segments are written. STROBE has to answer CAM, by a wire from the one to the other or by
//! what else stands at the box; a camera there can be anything, or nothing. Behind each run the frames of the exposures that the box has
//! strobes of are there, numbered as they were fired, with the box's own time for a time-stamp.
//!
//! Frames that show something else than what is planned would be a wrong result that nothing tells: the rig has to be the same but for what
//! drives it, and each exposure of the plan the one that was stored, by its direction, exposure time and lit solid angle. A pilot capture has
//! no frames here.

use std::collections::VecDeque;
use std::path::{Path, PathBuf};
use std::time::Duration;

use super::camera::{Camera, CameraError, Fired, Frame, Planned};
use super::directory::{Measurement, MeasurementError};
use crate::instrument::calibration::rig_hash;
use crate::instrument::frame_format::FrameFormat;
use crate::instrument::rig::Rig;
use crate::store::{RawStore, Segment, StoreError};

/// Exposure times and solid angles that differ by no more of themselves are the same.
const SAME: f64 = 1e-9;

/// An earlier measurement as a camera.
#[derive(Debug)]
pub struct ReplayCamera {
    name: String,
    raw: RawStore,
    /// What is going to be taken.
    planned: Vec<Planned>,
    /// The segment of the file that was read last.
    segment: Option<(usize, Segment)>,
    ready: VecDeque<Frame>,
    frames: u64,
    /// Frames of an image: one of each band that the projector made, or one.
    bands: usize,
}

impl ReplayCamera {
    /// The measurement in the folder `file`, or of which `file` is the `raw.zarr`, as the camera of `rig`.
    ///
    /// # Errors
    /// [`CameraError::Failed`] if there is none, or if it is of another rig.
    pub fn open(file: &Path, rig: &Rig) -> Result<Self, CameraError> {
        let name = format!("replay {}", file.display());
        let failed = |reason: String| CameraError::Failed {
            camera: name.clone(),
            reason,
        };
        let is_raw = file.file_name().is_some_and(|name| name == "raw.zarr");
        let dir = match file.parent().filter(|_| is_raw) {
            Some(parent) if parent.as_os_str().is_empty() => PathBuf::from("."),
            Some(parent) => parent.to_owned(),
            None => file.to_owned(),
        };
        let of = |error: MeasurementError| failed(error.to_string());
        let measurement = Measurement::open(&dir).map_err(of)?;
        if rig_hash(&measurement.rig) != rig_hash(rig) {
            return Err(failed(format!(
                "expected a measurement by rig {} with images of {} pixels a side, found one by another rig, {} with {}",
                rig.name,
                rig.camera.lens.width_px,
                measurement.rig.name,
                measurement.rig.camera.lens.width_px
            )));
        }
        let raw = measurement.raw().map_err(of)?;
        Ok(Self {
            name,
            raw,
            planned: Vec::new(),
            segment: None,
            ready: VecDeque::new(),
            frames: 0,
            bands: rig.shown_bands(),
        })
    }

    fn failed(&self, reason: impl Into<String>) -> CameraError {
        CameraError::Failed {
            camera: self.name.clone(),
            reason: reason.into(),
        }
    }

    /// The stored segment with exposure `index`, and that exposure's place in it.
    fn segment_of(&mut self, index: usize) -> Result<(&Segment, usize), CameraError> {
        let number = index / self.raw.layout().segment;
        let is_held = self.segment.as_ref().is_some_and(|(held, _)| *held == number);
        if !is_held {
            let read: Result<Segment, StoreError> = self.raw.read_segment(number);
            let read = read.map_err(|error| self.failed(error.to_string()))?;
            self.segment = Some((number, read));
        }
        let first = self.raw.segment_range(number).start;
        let (_, segment) = self.segment.as_ref().expect("invariant: it was read");
        Ok((segment, index - first))
    }
}

impl Camera for ReplayCamera {
    fn name(&self) -> &str {
        &self.name
    }

    fn format(&self) -> FrameFormat {
        let layout = self.raw.layout();
        FrameFormat {
            width_px: layout.width,
            height_px: layout.height,
            channels: layout.channels / self.bands,
            bits: layout.bits,
        }
    }

    fn settings(&self) -> Vec<String> {
        vec![format!(
            "{} frames of an earlier measurement",
            self.raw.layout().exposures
        )]
    }

    fn expect(&mut self, planned: &[Planned]) -> Result<(), CameraError> {
        for exposure in planned {
            let &Planned {
                index,
                incident,
                exposure_s,
                lit_solid_angle_sr,
            } = exposure;
            let exposures = self.raw.layout().exposures;
            if index >= exposures {
                return Err(self.failed(format!("expected a plan of {exposures} exposures, found more")));
            }
            let (segment, at) = self.segment_of(index)?;
            let stored = &segment.records[at];
            let same = |a: f64, b: f64| (a - b).abs() <= SAME * a.abs().max(b.abs());
            if stored.incident != incident
                || !same(stored.exposure_s, exposure_s)
                || !same(stored.lit_solid_angle_sr, lit_solid_angle_sr)
            {
                let found = format!(
                    "expected exposure {index} as it is planned (incident {incident}, {exposure_s} s, {lit_solid_angle_sr} sr lit), found \
                     incident {}, {} s, {} sr",
                    stored.incident, stored.exposure_s, stored.lit_solid_angle_sr
                );
                return Err(self.failed(found));
            }
        }
        self.planned = planned.to_vec();
        Ok(())
    }

    fn begin_part(&mut self, _same_before: u64) {
        self.planned.clear();
    }

    fn arm(&mut self) -> Result<(), CameraError> {
        self.ready.clear();
        self.frames = 0;
        Ok(())
    }

    fn fired(&mut self, fired: &[Fired]) -> Result<(), CameraError> {
        for &Fired { exposure, band, on_s } in fired {
            let Some(index) = self.planned.get(exposure).map(|planned| planned.index) else {
                return Err(self.failed(
                    "expected exposures of a plan, found others (pilot captures and calibrations have no frames to be shown again: \
                     say how long is exposed, --exposure-ms)",
                ));
            };
            let bands = self.bands;
            let frame = self.format().len() * bands;
            let (segment, at) = self.segment_of(index)?;
            let image = &segment.frames[at * frame..(at + 1) * frame];
            let dn = image.iter().skip(band).step_by(bands).copied().collect();
            self.ready.push_back(Frame {
                id: self.frames,
                timestamp_s: on_s,
                dn,
            });
            self.frames += 1;
        }
        Ok(())
    }

    fn next_frame(&mut self, _timeout: Duration) -> Result<Option<Frame>, CameraError> {
        Ok(self.ready.pop_front())
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::base::progress::Silent;
    use crate::brdf::sample;
    use crate::capture::Instrument;
    use crate::hemisphere::incident::Grid;
    use crate::measure::{self, Job};
    use crate::plan::{Faults, Plan, Request, Virtual};
    use crate::virtual_rig::{Behaviour, Held, Noise, Truth};

    fn request(step_deg: f64) -> Request {
        Request {
            grid: Grid::ThetaPhi { step_deg },
            image_size: 16,
            ..Request::default()
        }
    }

    fn rig() -> Rig {
        Rig::load("rcg-2").unwrap().with_image_size(16).unwrap()
    }

    /// A virtual instrument with a sample that nobody has asked for, whose camera misses triggers; `camera` in its place.
    fn instrument(rig: &Rig, camera: ReplayCamera) -> Instrument {
        let behaviour = Behaviour {
            noise: Noise::On,
            seed: 9,
            faults: Faults {
                missed_triggers: 0.1,
                ..Faults::default()
            },
            lamp_h: 0.0,
        };
        let held = Held::Sample(Arc::from(sample::parse("lambert:0.1").unwrap()));
        let mut instrument = Instrument::simulated(&Truth::of(rig), held, behaviour).unwrap();
        instrument.camera = Box::new(camera);
        instrument
    }

    /// Captures with frames of `earlier`; what came of it.
    fn again(dir: &Path, earlier: &Path, step_deg: f64, exposure_s: f64) -> Result<Measurement, String> {
        again_by(&rig(), dir, earlier, step_deg, exposure_s)
    }

    fn again_by(
        rig: &Rig,
        dir: &Path,
        earlier: &Path,
        step_deg: f64,
        exposure_s: f64,
    ) -> Result<Measurement, String> {
        let plan = Plan::new(request(step_deg), rig, exposure_s).unwrap();
        let measurement = Measurement::create(dir, rig.clone(), plan).unwrap();
        let camera = ReplayCamera::open(earlier, rig).map_err(|error| error.to_string())?;
        let captured = measurement.capture(&mut instrument(rig, camera), &mut |_| {});
        captured.map(|_| measurement).map_err(|error| error.to_string())
    }

    #[test]
    fn an_earlier_measurement_in_bands_comes_again() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let mut rig = rig();
        rig.camera.channels = 1;
        rig.bands = Some(crate::instrument::bands::tests::in_turn());
        let plan = Plan::new(request(45.0), &rig, 0.004).unwrap();
        let spec = Virtual {
            sample: "lambert:0.6,0.3,0.06".to_owned(),
            ..Virtual::default()
        };
        let earlier = Measurement::create(&at("earlier"), rig.clone(), plan.on(spec)).unwrap();
        measure::capture(&earlier, &Job::of(&earlier, None).unwrap(), &Silent).unwrap();
        let replayed = again_by(&rig, &at("again"), &at("earlier"), 45.0, 0.004).unwrap();
        let [before, after] = [&earlier, &replayed].map(|one| one.raw().unwrap().read_segment(0).unwrap());
        assert!(before.frames == after.frames && after.tally.repeated > 0);
        assert_eq!(after.tally.paired, 3 * after.records.len() as u64);
    }

    #[test]
    fn an_earlier_measurement_comes_again_bit_for_bit_and_no_other_is_taken_for_it() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let plan = Plan::new(request(30.0), &rig(), 0.004).unwrap();
        let earlier = Measurement::create(&at("earlier"), rig(), plan.on(Virtual::default())).unwrap();
        measure::capture(&earlier, &Job::of(&earlier, None).unwrap(), &Silent).unwrap();

        let replayed = again(&at("again"), &at("earlier/raw.zarr"), 30.0, 0.004).unwrap();
        let [before, after] = [&earlier, &replayed].map(|one| one.raw().unwrap());
        let mut repeated = 0;
        for index in 0..before.segments() {
            let [before, after] = [&before, &after].map(|raw| raw.read_segment(index).unwrap());
            assert!(before.frames == after.frames, "{index}");
            repeated += after.tally.repeated;
        }
        assert!(repeated > 0);

        for (step_deg, exposure_s, part) in [
            (30.0, 0.005, "expected exposure 0 as it is planned"),
            (15.0, 0.004, "as it is planned"),
            (30.0, 0.004, "expected a measurement"),
        ] {
            let file = if part.ends_with("a measurement") {
                at("none")
            } else {
                at("earlier")
            };
            let out = at(&format!("{step_deg} {exposure_s}"));
            let said = again(&out, &file, step_deg, exposure_s).err().unwrap();
            assert!(said.contains("replay") && said.contains(part), "{said}");
        }
        let other = Rig::load("rcg-2").unwrap().with_image_size(24).unwrap();
        let said = ReplayCamera::open(&at("earlier"), &other)
            .unwrap_err()
            .to_string();
        assert!(said.contains("another rig"), "{said}");
    }
}
