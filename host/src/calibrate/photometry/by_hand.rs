//! The views of a photometric calibration whose targets somebody puts into the holder.
//!
//! # Design
//! How long is exposed depends on the targets: each of them but the second standard is asked for once to prepare that ([`Asking`]). From
//! then on each view stands by itself. Whoever stops before all is prepared begins anew.

use std::path::Path;

use serde::{Deserialize, Serialize};

use super::capture::{Request, VIEWS, Views, holders};
use super::capturing::{Capturing, Taken, Target, tilts};
use super::in_holder::{InHolder, Standards};
use super::looks::{Looks, Wanted, reflectance_of};
use super::{Said, stray};
use crate::base::progress::Progress;
use crate::calibrate::by_hand::{
    Answer, Asked, Bench, Hands, HowFar, Notes, Place, Series, not_by_hand, take_by_hand, todo,
};
use crate::calibrate::{CalibrateError, RIG, file};
use crate::capture::Instrument;
use crate::instrument::calibration::photometry::COMMAND;
use crate::instrument::rig::{Rig, Tilt};
use crate::store::whole_file::write_whole;
use crate::virtual_rig::Held;

/// Name of the file that says how the views are captured by hand.
const NOTES: &str = "photometry-by-hand.json";
/// Name of the file that says how they were prepared.
const PREPARED: &str = "photometry-prepared.json";

/// How views were prepared, beside what they say: their numbers to the bit, which need not come back from theirs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Prepared {
    /// How often the instrument was opened for it.
    opened: u32,
    /// Exposure times, and the opening of the spots.
    bits: Vec<u64>,
}

/// Views that somebody captures by hand.
pub struct ByHand<'a> {
    request: Request,
    dir: &'a Path,
    place: Place<'a>,
    redo: &'a [usize],
    notes: Notes,
}

/// Views that are prepared.
struct Prepares {
    capturing: Capturing,
    targets: Vec<Target>,
    notes: Notes,
}

impl<'a> ByHand<'a> {
    /// Begins the views of `request` in `dir`, or goes on with those that are there, of which that is `said`; views of the numbers `redo`,
    /// from 1, are taken again. `place` is where they are captured.
    ///
    /// # Errors
    /// [`CalibrateError`] if the views there are others, or were captured otherwise.
    pub fn open(
        request: &Request,
        said: &Said,
        dir: &'a Path,
        place: Place<'a>,
        redo: &'a [usize],
    ) -> Result<Self, CalibrateError> {
        let notes = Notes::of(&dir.join(NOTES), place, COMMAND)?;
        let request = if Views::exist(dir) {
            going_on(said, dir)?
        } else {
            for name in [super::capture::RAW, stray::RAW] {
                if dir.join(name).exists() {
                    let expected = "no frames of a capture that did not come to its end";
                    return Err(not_by_hand(&dir.join(name), expected));
                }
            }
            request.clone()
        };
        let count = 3 + request.tilts.len() + usize::from(request.second_standard.is_some());
        todo(&[], redo, count)?;
        Standards::of(&request, place)?;
        tilts(&request)?;
        notes.write(&dir.join(NOTES))?;
        Ok(Self {
            request,
            dir,
            place,
            redo,
            notes,
        })
    }

    /// Has the views taken that are to be taken, until somebody stops. Returns how far they are then.
    ///
    /// # Errors
    /// [`CalibrateError`].
    pub fn take(
        &self,
        bench: &mut dyn Bench,
        hands: &mut dyn Hands,
        progress: &dyn Progress,
    ) -> Result<HowFar, CalibrateError> {
        let standards = Standards::of(&self.request, self.place)?;
        let capturing = if Views::exist(self.dir) {
            self.read(standards)?
        } else {
            match self.prepare(standards, bench, hands) {
                Err(CalibrateError::Stopped) => {
                    return Ok(HowFar::of(
                        &self.names(),
                        &(0..self.names().len()).collect::<Vec<_>>(),
                    ));
                }
                other => other?,
            }
        };
        let targets = capturing.targets();
        let mut views = Prepares {
            capturing,
            targets,
            notes: self.notes.clone(),
        };
        let todo = todo(&views.missing()?, self.redo, views.targets.len())?;
        take_by_hand(&mut views, &todo, bench, hands, progress)?;
        Ok(HowFar::of(&Series::targets(&views), &views.missing()?))
    }

    /// What all views show, before they are prepared.
    fn names(&self) -> Vec<String> {
        let name = |target| name(target, &self.request);
        let mut all = vec![name(Target::Mirror), name(Target::Trap)];
        all.extend((0..=self.request.tilts.len()).map(|stand| name(Target::Standard(stand))));
        all.extend(
            self.request
                .second_standard
                .as_ref()
                .map(|_| name(Target::Second)),
        );
        all
    }

    /// Prepares the views with each target in the holder once.
    fn prepare(
        &self,
        standards: Standards,
        bench: &mut dyn Bench,
        hands: &mut dyn Hands,
    ) -> Result<Capturing, CalibrateError> {
        let other = standards.other_reflectance(&self.request);
        let mut asking = Asking {
            bench,
            hands,
            request: &self.request,
            other,
            dir: self.dir,
            stands: None,
        };
        asking.bench.set_opened(0);
        let capturing = Capturing::prepare(&self.request, standards, self.dir, &mut asking)?;
        let views = &capturing.views;
        let prepared = Prepared {
            opened: capturing.opened,
            bits: numbers(views).map(f64::to_bits).collect(),
        };
        file::write(&self.dir.join(PREPARED), &prepared)?;
        write_whole(&self.dir.join(VIEWS), capturing.text.as_bytes())?;
        Ok(capturing)
    }

    /// The views as they were prepared.
    fn read(&self, standards: Standards) -> Result<Capturing, CalibrateError> {
        let path = self.dir.join(PREPARED);
        let prepared: Prepared = file::read(&path, COMMAND)?;
        let there: Views = file::read(&self.dir.join(VIEWS), COMMAND)?;
        let mut bits = prepared.bits.iter().copied().map(f64::from_bits);
        let mut number = || bits.next().unwrap_or(f64::NAN);
        let mut views = Views {
            rig: Rig::load(&self.dir.join(RIG).display().to_string())?,
            exposure_s: number(),
            spot_deg: there.spot_deg.map(|_| number()),
            stray: there.stray.with_times([number(), number(), number()]),
            ..there.clone()
        };
        views.times_s = there.times_s.iter().map(|_| number()).collect();
        let tilts = tilts(&self.request)?;
        let mut holders = holders(&views.rig, &self.request, &tilts)?;
        for holder in &mut holders {
            holder.set_spot(views.spot_deg());
        }
        let mut capturing = Capturing::of(views, standards, holders, self.dir, prepared.opened);
        let before = std::fs::read(self.dir.join(VIEWS)).unwrap_or_default();
        if capturing.text.as_bytes() != before {
            let expected = "the rig and the exposures of which the views before were taken";
            return Err(not_by_hand(&self.dir.join(VIEWS), expected));
        }
        capturing.open()?;
        Ok(capturing)
    }
}

/// All that views say in numbers that were found, in one order.
fn numbers(views: &Views) -> impl Iterator<Item = f64> {
    std::iter::once(views.exposure_s)
        .chain(views.spot_deg)
        .chain(views.stray.times())
        .chain(views.times_s.iter().copied())
}

/// What somebody is asked for.
fn name(target: Target, request: &Request) -> String {
    match target {
        Target::Mirror => "flat mirror at 0° / 0°".to_owned(),
        Target::Trap => "light trap".to_owned(),
        Target::Standard(0) => format!("standard {}", request.standard),
        Target::Standard(stand) => {
            format!(
                "standard {} at the tilt {}",
                request.standard,
                request.tilts[stand - 1]
            )
        }
        Target::Second => {
            let second = request.second_standard.as_deref().unwrap_or_default();
            format!("second standard {second}")
        }
    }
}

/// The request of the views in `dir`, which have to be as `said`.
fn going_on(said: &Said, dir: &Path) -> Result<Request, CalibrateError> {
    let path = dir.join(VIEWS);
    if !dir.join(NOTES).is_file() || !dir.join(PREPARED).is_file() {
        return Err(not_by_hand(&path, "views that were begun with --by-hand"));
    }
    let mut views: Views = file::read(&path, COMMAND)?;
    for (what, captured, said) in [
        ("--standard", Some(&views.standard), &said.standard),
        (
            "--second-standard",
            views.second_standard.as_ref(),
            &said.second_standard,
        ),
    ] {
        let captured = captured.map_or(super::NONE, String::as_str);
        if let Some(said) = said.as_ref().filter(|said| *said != captured) {
            return Err(CalibrateError::otherwise(what, captured, said));
        }
    }
    said.apply(&mut views)?;
    Ok(Request {
        standard: views.standard.clone(),
        second_standard: views.second_standard.clone(),
        tilts: views.stands.iter().filter_map(|stand| stand.tilt).collect(),
        exposure_s: said.exposure_s,
        image_size: views.image_size,
    })
}

/// Refuses the captures of `views` in `dir` if they are by hand and some are missing.
pub(super) fn check_whole(views: &Views, dir: &Path) -> Result<(), CalibrateError> {
    if !dir.join(NOTES).is_file() || !dir.join(PREPARED).is_file() {
        return Ok(());
    }
    let missing = [
        (super::capture::RAW, views.segments().len()),
        (stray::RAW, stray::SEGMENTS),
    ];
    for (name, segments) in missing {
        let path = dir.join(name);
        let whole = if path.is_dir() {
            crate::store::RawStore::open(&path)?.whole_segments()?
        } else {
            0
        };
        if whole != segments {
            return Err(CalibrateError::Views {
                expected: "the views of all targets".to_owned(),
                found: format!("{name} without some of them"),
                advice: "go on with --by-hand",
            });
        }
    }
    Ok(())
}

/// What is wrong with what stands in the holder of the bench in place of a target, if something is.
fn doubt(
    target: Target,
    capturing: &Capturing,
    request: (&str, Option<f64>),
    bench: &mut dyn Bench,
) -> Result<Option<String>, CalibrateError> {
    let (held, holder) = capturing.held(target);
    let mut instrument = bench.open(&holder.rig, held.clone(), holder.tilt)?;
    let wanted = match (&held, target) {
        (Held::Mirror(_), _) => Wanted::Mirror,
        (Held::Trap, _) => Wanted::Nothing,
        (Held::Sample(sample), _) => Wanted::Diffuse(sample.as_ref(), request.1),
    };
    Ok(Looks::of(holder, &mut instrument)?.doubt(wanted, request.0))
}

/// A bench at which somebody is asked whenever another target has to stand in the holder.
struct Asking<'a> {
    bench: &'a mut dyn Bench,
    hands: &'a mut dyn Hands,
    request: &'a Request,
    /// Reflectance of the second standard.
    other: Option<f64>,
    dir: &'a Path,
    /// The target that stands there.
    stands: Option<String>,
}

impl Asking<'_> {
    /// Has what is to be `held` put in, at the tilt of the holder.
    fn put_in(&mut self, held: &Held, tilt: Option<Tilt>) -> Result<(), CalibrateError> {
        let stand = tilt.and_then(|tilt| {
            let same = |other: &Tilt| Tilt::is_same(Some(tilt), Some(*other));
            self.request.tilts.iter().position(same).map(|at| at + 1)
        });
        let (target, wanted) = match held {
            Held::Mirror(_) => (Target::Mirror, Wanted::Mirror),
            Held::Trap => (Target::Trap, Wanted::Nothing),
            Held::Sample(sample) => (
                Target::Standard(stand.unwrap_or(0)),
                Wanted::Diffuse(sample.as_ref(), self.other),
            ),
        };
        let name = name(target, self.request);
        if self.stands.as_ref() == Some(&name) {
            return Ok(());
        }
        let full = Rig::load(&self.dir.join(RIG).display().to_string())?;
        let holder = holders(&full, self.request, &[tilt])?.remove(0);
        let words = format!("{name}, to find out how it is exposed");
        let mut refused: Option<String> = None;
        loop {
            let can_keep = refused.is_some();
            let answer = self.hands.change(&Asked {
                number: 0,
                of: 0,
                target: &words,
                complaint: refused.as_deref(),
                can_keep,
            });
            let other = match answer {
                Answer::Stop => return Err(CalibrateError::Stopped),
                Answer::Keep if can_keep => break,
                Answer::Ready => None,
                Answer::Put(what) => Some(what),
                Answer::Again | Answer::Keep | Answer::Unknown(_) => {
                    refused = Some(
                        "expected Enter, stop or, on the virtual rig, put …, found something else".to_owned(),
                    );
                    continue;
                }
            };
            if let Err(sentence) = self.bench.place(other.as_deref()) {
                refused = Some(sentence);
                continue;
            }
            let opened = self.bench.opened();
            let mut instrument = self.bench.open(&holder.rig, held.clone(), tilt)?;
            let looks = Looks::of(&holder, &mut instrument)?;
            // What was only looked at changes nothing.
            self.bench.set_opened(opened);
            refused = looks.doubt(wanted, &name);
            if refused.is_none() {
                break;
            }
        }
        self.stands = Some(name);
        Ok(())
    }
}

impl Bench for Asking<'_> {
    fn place(&mut self, other: Option<&str>) -> Result<(), String> {
        self.bench.place(other)
    }

    fn open(&mut self, rig: &Rig, held: Held, tilt: Option<Tilt>) -> Result<Instrument, CalibrateError> {
        self.put_in(&held, tilt)?;
        self.bench.open(rig, held, tilt)
    }

    fn set_opened(&mut self, times: u32) {
        self.bench.set_opened(times);
    }

    fn opened(&self) -> u32 {
        self.bench.opened()
    }
}

impl Prepares {
    /// Indices of the views that are not there.
    fn missing(&self) -> Result<Vec<usize>, CalibrateError> {
        let mut missing = Vec::new();
        for (view, target) in self.targets.iter().enumerate() {
            if !self.capturing.is_there(*target)? {
                missing.push(view);
            }
        }
        Ok(missing)
    }

    fn request(&self) -> Request {
        let views = &self.capturing.views;
        Request {
            standard: views.standard.clone(),
            second_standard: views.second_standard.clone(),
            tilts: views.stands.iter().filter_map(|stand| stand.tilt).collect(),
            exposure_s: None,
            image_size: views.image_size,
        }
    }
}

impl Series for Prepares {
    /// With what seemed wrong before it was taken.
    type Taken = (Taken, Option<String>);

    fn targets(&self) -> Vec<String> {
        let request = self.request();
        self.targets
            .iter()
            .map(|target| name(*target, &request))
            .collect()
    }

    fn exposures(&self, view: usize) -> usize {
        self.capturing.exposures_of(self.targets[view])
    }

    fn take(
        &mut self,
        view: usize,
        bench: &mut dyn Bench,
        reach: &dyn Fn(usize),
    ) -> Result<Self::Taken, CalibrateError> {
        let (target, request) = (self.targets[view], self.request());
        let standards = &self.capturing.standards;
        let other = match target {
            Target::Second => standards.reflectance(InHolder::Standard),
            _ => standards.other_reflectance(&request),
        };
        let doubt = doubt(target, &self.capturing, (&name(target, &request), other), bench)?;
        Ok((self.capturing.take(target, bench, reach)?, doubt))
    }

    fn doubt(&mut self, _: usize, (_, doubt): &Self::Taken) -> Result<Option<String>, CalibrateError> {
        Ok(doubt.clone())
    }

    fn store(
        &mut self,
        view: usize,
        (taken, _): Self::Taken,
        despite: Option<String>,
    ) -> Result<(), CalibrateError> {
        self.capturing.write(&taken)?;
        let path = self.capturing.dir.join(NOTES);
        self.notes.note(&path, view, despite)
    }
}

impl Standards {
    /// What a standard reflects, about.
    fn reflectance(&self, what: InHolder) -> Option<f64> {
        match self.get(what) {
            Held::Sample(sample) => Some(reflectance_of(sample.as_ref())),
            Held::Mirror(_) | Held::Trap => None,
        }
    }

    /// What the second standard of `request` reflects, about, if there is one.
    fn other_reflectance(&self, request: &Request) -> Option<f64> {
        let second = request.second_standard.as_ref();
        second.and_then(|_| self.reflectance(InHolder::Second))
    }
}
