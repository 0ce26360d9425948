//! How the views of a photometric calibration are taken: target by target, in any order.
//!
//! # Design
//! What is shown depends on how bright the targets are: [`Capturing::prepare`] has each of them in the holder once, for test exposures.
//! From then on each view is one target with all its segments, which stand at their places in the files whenever they are taken.

use std::path::{Path, PathBuf};

use super::capture::{
    Holder, RAW, Request, SEGMENT, Series, Shows, Stand, VIEWS, Views, check_tilts, holders, layout,
};
use super::exposure::{Exposures, light};
use super::in_holder::{InHolder, Standards};
use super::stray::{self, Part, StrayViews};
use crate::base::progress::Progress;
use crate::calibrate::by_hand::{Bench, Place, VirtualBench};
use crate::calibrate::{
    CalibrateError, RIG, check_clock, create_raw, discard_unfinished, file, open_raw, segment_of,
};
use crate::capture::Tally;
use crate::instrument::monitor::watching;
use crate::instrument::rig::{Rig, Tilt};
use crate::plan;
use crate::plan::schedule::Timing;
use crate::store::whole_file::write_whole;
use crate::store::{RawStore, Segment};
use crate::virtual_rig::Held;
use crate::virtual_rig::setup::World;

/// What stands in the holder in one view.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Target {
    Mirror,
    Trap,
    /// The standard of the stand of this index.
    Standard(usize),
    Second,
}

/// Segments of a view.
pub(super) struct Taken {
    clock_hz: u32,
    /// With their places in the file of the standards, and in that of stray light.
    standards: Vec<(usize, Segment)>,
    stray: Vec<(usize, Segment)>,
}

/// Views that are being captured.
pub(super) struct Capturing {
    pub(super) dir: PathBuf,
    pub(super) views: Views,
    pub(super) standards: Standards,
    pub(super) holders: Vec<Holder>,
    /// The views, as the file of them says.
    pub(super) text: String,
    /// How often the instrument was opened for what decided all that.
    pub(super) opened: u32,
    raw: [Option<RawStore>; 2],
}

/// Captures the views of `request` in `world` with the rig of the calibration in `dir`, into it.
///
/// # Errors
/// [`CalibrateError`].
pub fn capture(
    request: &Request,
    dir: &Path,
    world: &World,
    progress: &dyn Progress,
) -> Result<(), CalibrateError> {
    let standards = Standards::of(request, Place::Virtual(world))?;
    let mut bench = VirtualBench::new(world);
    let mut capturing = Capturing::prepare(request, standards, dir, &mut bench)?;
    discard_unfinished(dir, &[RAW, stray::RAW], VIEWS)?;
    let targets = capturing.targets();
    let total = targets.iter().map(|target| capturing.exposures_of(*target)).sum();
    progress.begin("standards and stray light", total, "exposures");
    let mut done = 0;
    // The file of stray light begins with the mirror.
    for target in targets {
        let taken = capturing.take(target, &mut bench, &|taken| progress.reach(done + taken))?;
        done += capturing.exposures_of(target);
        capturing.write(&taken)?;
    }
    progress.end();
    write_whole(&dir.join(VIEWS), capturing.text.as_bytes())?;
    Ok(())
}

impl Capturing {
    /// Finds out at the `bench` how the views of `request` are to be exposed, with the rig of the calibration in `dir`.
    pub(super) fn prepare(
        request: &Request,
        standards: Standards,
        dir: &Path,
        bench: &mut dyn Bench,
    ) -> Result<Self, CalibrateError> {
        let full = Rig::load(&dir.join(RIG).display().to_string())?;
        let tilts = tilts(request)?;
        let mut holders = holders(&full, request, &tilts)?;
        let Exposures { times_s, spot_deg } =
            light(&mut holders, &standards.first, request.exposure_s, bench)?;
        let exposure_s = times_s.last().copied().expect("invariant: there are times");
        let views = Views {
            standard: request.standard.clone(),
            second_standard: request.second_standard.clone(),
            image_size: request.image_size,
            times_s,
            exposure_s,
            spot_deg,
            stray: StrayViews::plan(&full, exposure_s, bench)?,
            rig: full,
            stands: holders
                .iter()
                .zip(tilts)
                .map(|(holder, tilt)| Stand {
                    tilt,
                    directions: holder.directions.clone(),
                })
                .collect(),
        };
        Ok(Self::of(views, standards, holders, dir, bench.opened()))
    }

    /// Of `views` that were prepared.
    pub(super) fn of(
        views: Views,
        standards: Standards,
        holders: Vec<Holder>,
        dir: &Path,
        opened: u32,
    ) -> Self {
        Self {
            dir: dir.to_owned(),
            text: file::text(&views),
            views,
            standards,
            holders,
            opened,
            raw: [None, None],
        }
    }

    /// What stands in the holder, view by view. Whoever prepared them has the mirror in it.
    pub(super) fn targets(&self) -> Vec<Target> {
        let mut all = vec![Target::Mirror, Target::Trap];
        all.extend((0..self.holders.len()).map(Target::Standard));
        all.extend(self.views.second_standard.as_ref().map(|_| Target::Second));
        all
    }

    /// The places of the segments of a target in the file of standards, with what they show.
    fn segments_of(&self, target: Target) -> Vec<(usize, Shows)> {
        let is_of_it = |shows: &Shows| match (target, shows.in_holder()) {
            (Target::Mirror, _) => false,
            (Target::Trap, (_, what)) => what == InHolder::Trap,
            (Target::Second, (_, what)) => what == InHolder::Second,
            (Target::Standard(wanted), (stand, what)) => what == InHolder::Standard && stand == wanted,
        };
        let all = self.views.segments().into_iter().enumerate();
        all.filter(|(_, shows)| is_of_it(shows)).collect()
    }

    /// The part of the views of stray light that shows a target.
    const fn part_of(target: Target) -> Option<Part> {
        match target {
            Target::Mirror => Some(Part::Mirror),
            Target::Trap => Some(Part::Trap),
            Target::Standard(_) | Target::Second => None,
        }
    }

    /// Exposures of the view of a target.
    pub(super) fn exposures_of(&self, target: Target) -> usize {
        let stray = Self::part_of(target).map_or(0, |part| part.segments().len());
        SEGMENT * (self.segments_of(target).len() + stray)
    }

    /// What a target is on the virtual rig, and the holder that it stands in.
    pub(super) fn held(&self, target: Target) -> (Held, &Holder) {
        match target {
            Target::Mirror => (stray::mirror(), &self.holders[0]),
            Target::Trap => (Held::Trap, &self.holders[0]),
            Target::Standard(stand) => (self.standards.first.clone(), &self.holders[stand]),
            Target::Second => (self.standards.get(InHolder::Second).clone(), &self.holders[0]),
        }
    }

    /// How often the instrument was opened before the view of a target, as if all were taken in the order of the files.
    fn opened_before(&self, target: Target) -> u32 {
        let stands = self.holders.len();
        let place = match target {
            Target::Standard(stand) => stand,
            Target::Second => stands,
            Target::Trap => stands + 1,
            Target::Mirror => stands + 2,
        };
        self.opened + place as u32
    }

    /// Takes all segments of a target; `reach` is told how many exposures are taken.
    pub(super) fn take(
        &self,
        target: Target,
        bench: &mut dyn Bench,
        reach: &dyn Fn(usize),
    ) -> Result<Taken, CalibrateError> {
        let mut taken = Taken {
            clock_hz: 0,
            standards: Vec::new(),
            stray: Vec::new(),
        };
        let segments = self.segments_of(target);
        if !segments.is_empty() {
            bench.set_opened(self.opened_before(target));
            self.take_standards(target, &segments, &mut taken, bench, reach)?;
        }
        if let Some(part) = Self::part_of(target) {
            let before = SEGMENT * segments.len();
            let opened = self.opened_before(Target::Mirror);
            let stray = &self.views.stray;
            (taken.clock_hz, taken.stray) = stray.take(&self.views.rig, part, bench, opened, &|count| {
                reach(before + count);
            })?;
        }
        Ok(taken)
    }

    /// Takes the `segments` of a target that stand in the file of standards.
    fn take_standards(
        &self,
        target: Target,
        segments: &[(usize, Shows)],
        taken: &mut Taken,
        bench: &mut dyn Bench,
        reach: &dyn Fn(usize),
    ) -> Result<(), CalibrateError> {
        let (held, holder) = self.held(target);
        let series = Series::of(&self.holders[0], &self.views);
        let watched = watching(&self.views.rig, self.views.stray.watching_side);
        let mut instrument = bench.open(&holder.rig, held, holder.tilt)?;
        taken.clock_hz = instrument.device.info().clock_hz;
        for (at, (index, shows)) in segments.iter().enumerate() {
            instrument.watching = if shows.is_watched() {
                watched.clone()
            } else {
                Vec::new()
            };
            let exposure_s = self.views.exposure_of(*shows);
            let mut tally = Tally::default();
            let timing = Timing::patient(&holder.rig, exposure_s).map_err(plan::PlanError::from)?;
            let shots = instrument.take(
                SEGMENT,
                &[timing],
                |exposure, image| shows.draw(exposure, holder, &series, image),
                &mut tally,
                |count| reach(at * SEGMENT + count),
            )?;
            taken
                .standards
                .push((*index, segment_of(shots, tally, exposure_s)));
        }
        Ok(())
    }

    /// The files of frames, with their names: that of standards, then that of stray light.
    const FILES: [&str; 2] = [RAW, stray::RAW];

    /// Opens what frames are there already.
    pub(super) fn open(&mut self) -> Result<(), CalibrateError> {
        for (raw, name) in self.raw.iter_mut().zip(Self::FILES) {
            if self.dir.join(name).is_dir() {
                *raw = Some(open_raw(&self.dir, name, VIEWS)?);
            }
        }
        Ok(())
    }

    /// Stores a view, in place of an older one.
    pub(super) fn write(&mut self, taken: &Taken) -> Result<(), CalibrateError> {
        for (file, segments) in [&taken.standards, &taken.stray].into_iter().enumerate() {
            if segments.is_empty() {
                continue;
            }
            if self.raw[file].is_none() {
                // Now the clock is known.
                self.raw[file] = Some(self.create(file, taken.clock_hz)?);
            }
            let raw = self.raw[file].as_ref().expect("invariant: made above");
            check_clock(&self.dir.join(Self::FILES[file]), raw, taken.clock_hz)?;
            for (index, segment) in segments {
                raw.put_segment(*index, segment)?;
            }
        }
        Ok(())
    }

    fn create(&self, file: usize, clock_hz: u32) -> Result<RawStore, CalibrateError> {
        let Self { dir, text, views, .. } = self;
        if file == 1 {
            return views.stray.create(&views.rig, dir, text, clock_hz);
        }
        let layout = layout(views.segments().len(), self.holders[0].rig.frame_format());
        create_raw(&dir.join(RAW), layout, clock_hz, VIEWS, text)
    }

    /// Whether all segments of a target are there.
    pub(super) fn is_there(&self, target: Target) -> Result<bool, CalibrateError> {
        let standards = self.segments_of(target).into_iter().map(|(index, _)| index);
        let stray = Self::part_of(target).map_or(0..0, Part::segments);
        for (file, index) in standards
            .map(|index| (0, index))
            .chain(stray.map(|index| (1, index)))
        {
            let is_whole = match &self.raw[file] {
                Some(raw) => raw.is_whole(index)?,
                None => false,
            };
            if !is_whole {
                return Ok(false);
            }
        }
        Ok(true)
    }
}

/// The tilts of the standard that are asked for, none first.
pub(super) fn tilts(request: &Request) -> Result<Vec<Option<Tilt>>, CalibrateError> {
    check_tilts(&request.tilts)?;
    let tilts = request.tilts.iter().copied().map(Some);
    Ok(std::iter::once(None).chain(tilts).collect())
}
