//! The views of a geometric calibration whose targets somebody puts into the holder.

use std::path::{Path, PathBuf};

use super::capture::{Capturing, RAW, VIEWS};
use super::stands::Stands;
use super::{Request, Said, Views};
use crate::base::progress::Progress;
use crate::calibrate::by_hand::{
    Bench, Hands, HowFar, Notes, Place, Series, not_by_hand, take_by_hand, todo,
};
use crate::calibrate::{CalibrateError, file, open_raw};
use crate::instrument::calibration::geometry::COMMAND;
use crate::store::whole_file::write_whole;
use crate::store::{RawStore, Segment};

/// Name of the file that says how the views are captured by hand.
const NOTES: &str = "geometry-by-hand.json";

/// Views that somebody captures by hand.
pub struct ByHand {
    capturing: Capturing,
    stands: Stands,
    notes: Notes,
    todo: Vec<usize>,
}

impl ByHand {
    /// Begins the views of `request` in `dir`, or goes on with those that are there, of which that is `said`; views of the numbers `redo`,
    /// from 1, are taken again. `place` is where they are captured.
    ///
    /// # Errors
    /// [`CalibrateError`] if the views there are others, or were captured otherwise.
    pub fn open(
        request: &Request,
        said: &Said,
        dir: &Path,
        place: Place,
        redo: &[usize],
    ) -> Result<Self, CalibrateError> {
        let notes = dir.join(NOTES);
        let views = if Views::exist(dir) {
            going_on(request, said, dir)?
        } else {
            request.views()?
        };
        let kept = Notes::of(&notes, place, COMMAND)?;
        let mut capturing = Capturing::new(views, dir)?;
        if !Views::exist(dir) {
            if dir.join(RAW).exists() {
                return Err(not_by_hand(
                    &dir.join(RAW),
                    "no frames of a capture that did not come to its end",
                ));
            }
            todo(&[], redo, capturing.count())?;
            kept.write(&notes)?;
            write_whole(&dir.join(VIEWS), capturing.text.as_bytes())?;
        }
        let missing = missing(dir, capturing.count())?;
        if dir.join(RAW).is_dir() {
            capturing.raw = Some(open_raw(dir, RAW, VIEWS)?);
        }
        let todo = todo(&missing, redo, capturing.count())?;
        Ok(Self {
            stands: Stands::new(&capturing, &missing)?,
            notes: kept,
            capturing,
            todo,
        })
    }

    /// Has the views taken that are to be taken, until somebody stops. Returns how far they are then.
    ///
    /// # Errors
    /// [`CalibrateError`].
    pub fn take(
        &mut self,
        bench: &mut dyn Bench,
        hands: &mut dyn Hands,
        progress: &dyn Progress,
    ) -> Result<HowFar, CalibrateError> {
        let todo = self.todo.clone();
        take_by_hand(self, &todo, bench, hands, progress)?;
        let missing = missing(&self.capturing.dir, self.capturing.count())?;
        Ok(HowFar::of(&self.targets(), &missing))
    }

    fn notes_path(&self) -> PathBuf {
        self.capturing.dir.join(NOTES)
    }
}

/// The views in `dir`, which have to be those of `request` as far as it is `said`.
fn going_on(request: &Request, said: &Said, dir: &Path) -> Result<Views, CalibrateError> {
    let path = dir.join(VIEWS);
    if !dir.join(NOTES).is_file() {
        return Err(not_by_hand(&path, "views that were begun with --by-hand"));
    }
    let there: Views = file::read(&path, COMMAND)?;
    // What was written need not come back to the last bit: what is asked for again does.
    let asked = Views {
        rig: request.rig.clone(),
        tilts: said.tilts.clone().unwrap_or_else(|| there.tilts.clone()),
        image_size: said.image_size.unwrap_or(there.image_size),
        tilt_uncertainty_deg: there.tilt_uncertainty_deg,
    };
    let is_same = |one: &Views, other: &Views| file::text(one) == file::text(other);
    if is_same(&asked, &there) {
        return Ok(asked);
    }
    let with = |of: &Views| Views {
        rig: of.rig.clone(),
        ..there.clone()
    };
    if !is_same(&with(&asked), &there) {
        return Err(CalibrateError::otherwise(
            "--rig",
            &there.rig.name,
            format!("{}, or another state of it", asked.rig.name),
        ));
    }
    let list = |tilts: &[[f64; 2]]| {
        let each = tilts
            .iter()
            .map(|[tilt_deg, azimuth_deg]| format!("{tilt_deg}:{azimuth_deg}"));
        each.collect::<Vec<_>>().join(",")
    };
    if asked.tilts != there.tilts {
        return Err(CalibrateError::otherwise(
            "--tilts",
            list(&there.tilts),
            list(&asked.tilts),
        ));
    }
    Err(CalibrateError::otherwise(
        "--image-size",
        there.image_size,
        asked.image_size,
    ))
}

/// Indices of the views in `dir`, `count` of them, that are not there.
fn missing(dir: &Path, count: usize) -> Result<Vec<usize>, CalibrateError> {
    let path = dir.join(RAW);
    if !path.is_dir() {
        return Ok((0..count).collect());
    }
    let raw = RawStore::open(&path)?;
    let mut missing = Vec::new();
    for view in 0..count {
        if !raw.is_whole(view)? {
            missing.push(view);
        }
    }
    Ok(missing)
}

/// Refuses the captures of `views` in `dir` if they are by hand and some are missing.
pub(super) fn check_whole(views: &Views, dir: &Path) -> Result<(), CalibrateError> {
    if !dir.join(NOTES).is_file() {
        return Ok(());
    }
    let count = views.tilts.len() + 1;
    let missing = missing(dir, count)?;
    if missing.is_empty() {
        return Ok(());
    }
    let numbers: Vec<String> = missing.iter().map(|view| (view + 1).to_string()).collect();
    Err(CalibrateError::Views {
        expected: format!("all {count} views"),
        found: format!("view {} missing", numbers.join(", ")),
        advice: "go on with --by-hand",
    })
}

impl Series for ByHand {
    type Taken = Segment;

    fn targets(&self) -> Vec<String> {
        let mirror =
            |[tilt_deg, azimuth_deg]: &[f64; 2]| format!("flat mirror at {tilt_deg}° / {azimuth_deg}°");
        let mirrors = self.capturing.views.tilts.iter().map(mirror);
        mirrors.chain(["diffuse standard".to_owned()]).collect()
    }

    fn exposures(&self, view: usize) -> usize {
        self.capturing.exposures_of(view)
    }

    fn take(
        &mut self,
        view: usize,
        bench: &mut dyn Bench,
        reach: &dyn Fn(usize),
    ) -> Result<Segment, CalibrateError> {
        self.capturing.take(view, bench, reach)
    }

    fn doubt(&mut self, view: usize, taken: &Segment) -> Result<Option<String>, CalibrateError> {
        Ok(self.stands.doubt(&self.capturing, view, taken))
    }

    fn store(&mut self, view: usize, taken: Segment, despite: Option<String>) -> Result<(), CalibrateError> {
        self.capturing.write(view, &taken)?;
        self.stands.take(&self.capturing, view, &taken);
        let path = self.notes_path();
        self.notes.note(&path, view, despite)
    }
}
