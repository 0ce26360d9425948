//! Views whose targets somebody puts into the holder, one after the other.
//!
//! # Design
//! [`Hands`] are somebody who is asked to put a target in and answers; a [`Bench`] is the instrument around the holder. The loop
//! asks, takes the view, looks whether that target stands there, and stores it; it knows neither a terminal nor whether the rig is
//! virtual. What was stored stays: who stops goes on another day with the views that are missing, and a view that is taken again
//! replaces the old one only when it is there.
//!
//! Beside the views lies a file that says how they are captured by hand (`Notes`): under which conditions, so that no view of another
//! rig is mixed in, and which views somebody kept although something else seemed to stand there. On the virtual rig a view shows
//! the same whenever it is taken: a calibration by hand is that without hands, to the bit.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::{CalibrateError, black_glass, file};
use crate::base::progress::Progress;
use crate::brdf::sample::{Sample, parse};
use crate::capture::{Instrument, real};
use crate::hemisphere::direction::from_degrees;
use crate::instrument::calibration::CalibrationError;
use crate::instrument::rig::{Rig, Tilt};
use crate::virtual_rig::setup::{SetupError, World};
use crate::virtual_rig::{FlatMirror, Held};

/// What somebody answers who was asked to put a target in.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Answer {
    /// It stands there.
    Ready,
    /// Something else does, on purpose: for the virtual rig, as [`Bench::place`] takes it.
    Put(String),
    /// The view before shall be taken again.
    Again,
    /// The view that was just refused shall count all the same.
    Keep,
    /// Another day.
    Stop,
    /// Something that is none of these.
    Unknown(String),
}

/// What somebody is asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Asked<'a> {
    /// Number of the view, from 1; 0 before the first, for what is needed to prepare them.
    pub number: usize,
    /// Views in all.
    pub of: usize,
    /// What shall stand in the holder.
    pub target: &'a str,
    /// Why it is asked again, if it is: a sentence.
    pub complaint: Option<&'a str>,
    /// Whether the view that was refused can be kept.
    pub can_keep: bool,
}

/// Somebody who puts targets into the holder.
pub trait Hands {
    /// Asks, and waits for the answer.
    fn change(&mut self, asked: &Asked) -> Answer;
}

/// An instrument with something in its holder.
pub trait Bench {
    /// What stands in the holder from now on: what is asked for, or something else, on purpose.
    ///
    /// # Errors
    /// A sentence if that cannot be.
    fn place(&mut self, other: Option<&str>) -> Result<(), String>;

    /// The instrument. `rig` has its sample tilted by `tilt` and its camera image scaled; `held` is what the virtual rig holds, in which
    /// nobody can put anything.
    ///
    /// # Errors
    /// [`CalibrateError::Setup`], or [`CalibrateError::Stopped`] by somebody who is asked for a target first.
    fn open(&mut self, rig: &Rig, held: Held, tilt: Option<Tilt>) -> Result<Instrument, CalibrateError>;

    /// How often the instrument counts as opened from now on: each time takes minutes of the virtual lamp's life, and nothing of a
    /// real one, which has its own.
    fn set_opened(&mut self, _times: u32) {}

    /// How often it counts as opened.
    fn opened(&self) -> u32 {
        0
    }
}

/// Where views are captured.
#[derive(Clone, Copy, Debug)]
pub enum Place<'a> {
    /// In the virtual rig.
    Virtual(&'a World),
    /// On the table on which the parts of this rig stand.
    Real(&'a Rig),
}

impl Place<'_> {
    /// What decides what the instrument shows, beside what stands in it: one line.
    fn conditions(self) -> String {
        match self {
            Self::Virtual(world) => world.conditions(),
            Self::Real(rig) => format!("the real rig {}", rig.name),
        }
    }

    /// What stands in the holder when the standard of this number, 0 or 1, does, as far as anybody knows who has to expose it.
    pub(super) fn standard(self, number: usize, stated: Arc<dyn Sample>) -> Arc<dyn Sample> {
        match self {
            Self::Virtual(world) => world.standard(number, stated),
            Self::Real(_) => stated,
        }
    }
}

/// The bench on which a real instrument stands; what is in its holder, only who put it there knows.
#[derive(Clone, Copy, Debug)]
pub struct RealBench<'a> {
    /// Whose drivers name what stands there: those of the views may be of another day, with another port.
    pub rig: &'a Rig,
}

impl Bench for RealBench<'_> {
    fn place(&mut self, other: Option<&str>) -> Result<(), String> {
        match other {
            None => Ok(()),
            Some(other) => Err(format!(
                "expected Enter once the target stands in the holder, found `put {other}`, which the virtual rig alone can do"
            )),
        }
    }

    fn open(&mut self, rig: &Rig, _held: Held, _tilt: Option<Tilt>) -> Result<Instrument, CalibrateError> {
        Ok(real::open(&rig.driven_as(self.rig)).map_err(SetupError::from)?)
    }
}

/// The bench of the virtual rig.
pub struct VirtualBench<'a> {
    world: &'a World,
    /// What stands in the holder in place of what is asked for.
    other: Option<Other>,
}

/// What somebody put in on purpose.
enum Other {
    /// A flat mirror at this tilt and azimuth, degrees.
    Mirror([f64; 2]),
    Sample(Arc<dyn Sample>),
    Nothing,
}

impl Other {
    /// It, in the holder of `rig`.
    fn held(&self, rig: &Rig) -> Held {
        match self {
            Self::Sample(sample) => Held::Sample(sample.clone()),
            Self::Nothing => Held::Trap,
            Self::Mirror([tilt_deg, azimuth_deg]) => black_mirror(rig, from_degrees(*tilt_deg, *azimuth_deg)),
        }
    }
}

/// What stands in the holder of the virtual `rig` when `text` is put there: `mirror TILT AZIMUTH` in degrees, `nothing`, or a sample.
///
/// # Errors
/// A sentence if it is none of these.
pub fn held_of(text: &str, rig: &Rig) -> Result<Held, String> {
    Ok(other_target(text)?.held(rig))
}

impl<'a> VirtualBench<'a> {
    /// That of `world`, in which stands what is asked for.
    #[must_use]
    pub const fn new(world: &'a World) -> Self {
        Self { world, other: None }
    }
}

impl Bench for VirtualBench<'_> {
    fn place(&mut self, other: Option<&str>) -> Result<(), String> {
        self.other = other.map(other_target).transpose()?;
        Ok(())
    }

    fn open(&mut self, rig: &Rig, held: Held, tilt: Option<Tilt>) -> Result<Instrument, CalibrateError> {
        let other = self.other.as_ref().map(|other| other.held(rig));
        Ok(self.world.open_held(rig, other.unwrap_or(held), tilt)?)
    }

    fn set_opened(&mut self, times: u32) {
        self.world.set_opened(times);
    }

    fn opened(&self) -> u32 {
        self.world.opened()
    }
}

/// A flat mirror of this `normal` for `rig`.
pub(super) fn black_mirror(rig: &Rig, normal: DVec3) -> Held {
    Held::Mirror(FlatMirror {
        normal,
        reflectance: black_glass(rig),
    })
}

/// `mirror TILT AZIMUTH`, `nothing`, or a sample.
fn other_target(text: &str) -> Result<Other, String> {
    let mut words = text.split_whitespace();
    let expected = || {
        format!(
            "expected `put mirror TILT AZIMUTH` in degrees, `put nothing` or `put SAMPLE`, found `put {text}`"
        )
    };
    match words.next() {
        None => Err(expected()),
        Some("mirror") => {
            let degrees: Option<Vec<f64>> = words.map(|word| word.parse().ok()).collect();
            match degrees.as_deref() {
                Some(&[tilt_deg, azimuth_deg])
                    if (0.0..=80.0).contains(&tilt_deg) && azimuth_deg.abs() <= 360.0 =>
                {
                    Ok(Other::Mirror([tilt_deg, azimuth_deg]))
                }
                _ => Err(expected()),
            }
        }
        Some("nothing") => Ok(Other::Nothing),
        Some(_) => {
            let sample = parse(text).map_err(|error| format!("put {text}: {error}"))?;
            Ok(Other::Sample(Arc::from(sample)))
        }
    }
}

/// The views of a calibration, each by itself.
pub(super) trait Series {
    /// A view that was taken.
    type Taken;

    /// What shall stand in the holder in each view, in words.
    fn targets(&self) -> Vec<String>;

    /// Takes the view of this index.
    fn take(
        &mut self,
        view: usize,
        bench: &mut dyn Bench,
        reach: &dyn Fn(usize),
    ) -> Result<Self::Taken, CalibrateError>;

    /// Exposures of the view of this index.
    fn exposures(&self, view: usize) -> usize;

    /// What seems to stand in the holder in place of what was asked for, if it does.
    fn doubt(&mut self, view: usize, taken: &Self::Taken) -> Result<Option<String>, CalibrateError>;

    /// Stores a view; `despite` is what seemed wrong with it.
    fn store(
        &mut self,
        view: usize,
        taken: Self::Taken,
        despite: Option<String>,
    ) -> Result<(), CalibrateError>;
}

/// What happens to the captures next.
enum Next<T> {
    Stop,
    /// Asks for the view of this place in the list again.
    Ask(usize, Option<Refused<T>>),
}

/// Why a view is asked for again.
struct Refused<T> {
    complaint: String,
    /// The view, if it can be kept.
    taken: Option<T>,
}

impl<T> Refused<T> {
    fn because(complaint: impl Into<String>) -> Self {
        Self {
            complaint: complaint.into(),
            taken: None,
        }
    }
}

/// Takes the views `todo` of `series` one after the other, until somebody stops.
pub(super) fn take_by_hand<S: Series>(
    series: &mut S,
    todo: &[usize],
    bench: &mut dyn Bench,
    hands: &mut dyn Hands,
    progress: &dyn Progress,
) -> Result<(), CalibrateError> {
    let targets = series.targets();
    let (mut at, mut refused): (usize, Option<Refused<S::Taken>>) = (0, None);
    while at < todo.len() {
        let view = todo[at];
        let asked = Asked {
            number: view + 1,
            of: targets.len(),
            target: &targets[view],
            complaint: refused.as_ref().map(|refused| refused.complaint.as_str()),
            can_keep: refused.as_ref().is_some_and(|refused| refused.taken.is_some()),
        };
        let next = match hands.change(&asked) {
            Answer::Stop => Next::Stop,
            Answer::Again if at > 0 => Next::Ask(at - 1, None),
            Answer::Again => Next::Ask(
                at,
                Some(Refused::because(
                    "no view was taken before this one in this run; --redo takes one again",
                )),
            ),
            Answer::Unknown(line) => Next::Ask(
                at,
                Some(Refused::because(format!(
                    "expected Enter, again, keep, stop or, on the virtual rig, put …, found {line}"
                ))),
            ),
            Answer::Keep => match refused.take() {
                Some(Refused {
                    complaint,
                    taken: Some(taken),
                }) => {
                    series.store(view, taken, Some(complaint))?;
                    Next::Ask(at + 1, None)
                }
                _ => Next::Ask(
                    at,
                    Some(Refused::because(
                        "there is no view that was refused and could be kept",
                    )),
                ),
            },
            Answer::Ready => tried(series, (view, at), None, bench, progress)?,
            Answer::Put(what) => tried(series, (view, at), Some(&what), bench, progress)?,
        };
        match next {
            Next::Stop => break,
            Next::Ask(place, why) => (at, refused) = (place, why),
        }
    }
    Ok(())
}

/// Takes the view of an index at a place in the list, with what is asked for in the holder, or `other`.
fn tried<S: Series>(
    series: &mut S,
    (view, at): (usize, usize),
    other: Option<&str>,
    bench: &mut dyn Bench,
    progress: &dyn Progress,
) -> Result<Next<S::Taken>, CalibrateError> {
    if let Err(sentence) = bench.place(other) {
        return Ok(Next::Ask(at, Some(Refused::because(sentence))));
    }
    progress.begin(&format!("view {}", view + 1), series.exposures(view), "exposures");
    let taken = series.take(view, bench, &|taken| progress.reach(taken));
    progress.end();
    let refused = match taken {
        // What stands there may be another target, and too bright.
        Err(CalibrateError::Views { expected, found, .. }) => {
            Refused::because(format!("expected {expected}, found {found}"))
        }
        Err(error) => return Err(error),
        Ok(taken) => match series.doubt(view, &taken)? {
            None => {
                series.store(view, taken, None)?;
                return Ok(Next::Ask(at + 1, None));
            }
            Some(complaint) => Refused {
                complaint,
                taken: Some(taken),
            },
        },
    };
    Ok(Next::Ask(at, Some(refused)))
}

/// What is noted of captures by hand, beside them.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Notes {
    /// What decides what the instrument shows, beside what stands in it: on the virtual rig, what it is and its chance.
    conditions: String,
    /// Views, numbered from 1, that were kept although something else seemed to stand there, and what.
    #[serde(default)]
    pub(super) kept: BTreeMap<usize, String>,
}

impl Notes {
    /// Those at `path` of captures at this `place`, or new ones if there are none.
    ///
    /// # Errors
    /// [`CalibrateError`] if the captures there are of another place.
    pub(super) fn of(path: &Path, place: Place, command: &str) -> Result<Self, CalibrateError> {
        let conditions = place.conditions();
        if !path.is_file() {
            return Ok(Self {
                conditions,
                ..Self::default()
            });
        }
        let notes: Self = file::read(path, command)?;
        if notes.conditions == conditions {
            return Ok(notes);
        }
        Err(CalibrationError::Content {
            path: path.display().to_string(),
            field: "conditions".to_owned(),
            expected: format!("{} as in the views before", notes.conditions),
            found: conditions,
        }
        .into())
    }

    /// Writes them to `path`; `despite` is what seemed wrong with the view of this index, if it did.
    pub(super) fn note(
        &mut self,
        path: &Path,
        view: usize,
        despite: Option<String>,
    ) -> Result<(), CalibrateError> {
        let before = self.clone();
        match despite {
            Some(why) => self.kept.insert(view + 1, why),
            None => self.kept.remove(&(view + 1)),
        };
        if *self != before || !path.is_file() {
            file::write(path, self)?;
        }
        Ok(())
    }

    /// Writes them to `path` as they are.
    pub(super) fn write(&self, path: &Path) -> Result<(), CalibrateError> {
        Ok(file::write(path, self)?)
    }
}

/// Something at `path` that is not as views by hand leave it.
pub(super) fn not_by_hand(path: &Path, expected: &str) -> CalibrateError {
    CalibrationError::Content {
        path: path.display().to_string(),
        field: "file".to_owned(),
        expected: expected.to_owned(),
        found: "others; capture into another directory".to_owned(),
    }
    .into()
}

/// How far captures by hand are.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct HowFar {
    /// Views in all.
    pub views: usize,
    /// Those that are missing, numbered from 1.
    pub missing: Vec<usize>,
    /// What shall stand in the holder in each of these.
    pub targets: Vec<String>,
}

impl HowFar {
    pub(super) fn of(targets: &[String], missing: &[usize]) -> Self {
        Self {
            views: targets.len(),
            missing: missing.iter().map(|view| view + 1).collect(),
            targets: missing.iter().map(|view| targets[*view].clone()).collect(),
        }
    }
}

/// The places in the list of views that are to be taken: those that are missing, and those of numbers that shall be taken again.
pub(super) fn todo(missing: &[usize], redo: &[usize], views: usize) -> Result<Vec<usize>, CalibrateError> {
    if let Some(number) = redo.iter().find(|number| !(1..=views).contains(*number)) {
        return Err(CalibrateError::Views {
            expected: format!("--redo with numbers of views from 1 to {views}"),
            found: number.to_string(),
            advice: "number the views as they are asked for",
        });
    }
    Ok((0..views)
        .filter(|view| missing.contains(view) || redo.contains(&(view + 1)))
        .collect())
}
