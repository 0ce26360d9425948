//! The thread that has the instrument.
//!
//! # Design
//! Between two pictures it does what is wished, one wish after the other, and answers each. While views are taken it answers that it is busy,
//! but for what somebody says who was asked for a target. What fails is a sentence in the state, and is tried again every second:
//! a camera that comes back is there again.

use std::path::PathBuf;
use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use rcg::base::progress::Progress;
use rcg::calibrate::by_hand::{Answer, Asked, Hands};
use rcg::calibrate::geometry::alignment::advise;
use rcg::calibrate::geometry::{Said, calibrate};
use rcg::calibrate::live::{Picture, Settings, Shot, Shown, Table, Witness, checklist};
use rcg::store::whole_file::write_whole;
use tokio::sync::{oneshot, watch};

use super::state::{Asks, HISTORY, State, Task};
use super::watch::Watch;
use super::wish::Wish;
use crate::failure::Failure;

/// How long after a failure, and how often a measurement is looked after.
const AGAIN: Duration = Duration::from_secs(1);
/// Pictures come no faster than this: a virtual camera would take all that the computer has.
const FASTEST: Duration = Duration::from_millis(50);
/// Exposure times that differ by less, relative, are the same.
const SAME: f64 = 0.05;

/// A wish, and who waits for what comes of it.
pub(crate) type Asking = (Wish, oneshot::Sender<Result<(), String>>);

/// What pages are told.
#[derive(Clone)]
pub(crate) struct Told {
    pub(crate) state: watch::Sender<Arc<State>>,
    pub(crate) picture: watch::Sender<Arc<Picture>>,
}

/// The thread's own.
pub(crate) struct Worker {
    table: Table,
    asked: Mutex<Receiver<Asking>>,
    told: Told,
    state: State,
    witness: Witness,
    /// Pictures to be taken although none follow on each other.
    fire: usize,
    last: Option<Instant>,
    watch: Option<(Watch, Instant)>,
    out: Option<PathBuf>,
}

impl Worker {
    pub(crate) fn new(
        table: Table,
        asked: Receiver<Asking>,
        told: Told,
        (watch, out): (Option<Watch>, Option<PathBuf>),
    ) -> Self {
        let state = State {
            rig: table.rig().name.clone(),
            is_virtual: table.is_virtual(),
            is_plugged: true,
            can_calibrate: out.is_some(),
            running: watch.is_none(),
            ..State::default()
        };
        let mut worker = Self {
            table,
            asked: Mutex::new(asked),
            told,
            state,
            witness: Witness::default(),
            fire: 0,
            last: None,
            watch: watch.map(|watch| (watch, Instant::now())),
            out,
        };
        worker.tell_settings();
        worker.tell();
        worker
    }

    /// Works until nobody can wish any more; the exposure time is found first where it `is_open`.
    pub(crate) fn run(mut self, is_open: bool) {
        self.state.is_automatic = is_open;
        if is_open && self.state.running {
            self.result_of(Self::expose);
        }
        loop {
            let wait = if self.state.running || self.fire > 0 {
                let since = self.last.map_or(FASTEST, |last| last.elapsed());
                let pace = if self.state.problem.is_some() {
                    AGAIN
                } else {
                    FASTEST
                };
                pace.saturating_sub(since)
            } else {
                AGAIN
            };
            let asked = self
                .asked
                .lock()
                .unwrap_or_else(PoisonError::into_inner)
                .recv_timeout(wait);
            match asked {
                Ok((wish, answer)) => {
                    let done = self.grant(wish).map_err(|failure| failure.to_string());
                    self.tell();
                    answer.send(done).ok();
                    continue;
                }
                Err(RecvTimeoutError::Disconnected) => return,
                Err(RecvTimeoutError::Timeout) => {}
            }
            self.look_on();
            if self.state.running || self.fire > 0 {
                self.last = Some(Instant::now());
                self.result_of(Self::picture);
            }
        }
    }

    /// Does something, and tells what came of it.
    fn result_of(&mut self, act: fn(&mut Self) -> Result<(), Failure>) {
        self.state.problem = act(self).err().map(|failure| failure.to_string());
        self.tell();
    }

    fn tell(&mut self) {
        self.state.checklist = checklist(&self.witness);
        self.told.state.send_replace(Arc::new(self.state.clone()));
    }

    fn tell_settings(&mut self) {
        let settings = self.table.settings();
        self.state.shown = settings.shown.to_string();
        self.state.held.clone_from(&settings.held);
        self.state.exposure_ms = settings.exposure_s * 1e3;
        self.state.gain = settings.gain;
        self.state.outlines = self.table.outlines(None);
        let format = self.table.format();
        self.state.size_px = (format.width_px, format.height_px);
        // Figures of focus compare pictures of the same.
        self.state.sharpness.clear();
    }

    /// Looks after a measurement.
    fn look_on(&mut self) {
        let Some((watch, next)) = &mut self.watch else {
            return;
        };
        if *next > Instant::now() {
            return;
        }
        *next = Instant::now() + AGAIN;
        let (far, picture) = watch.look();
        self.state.measurement = Some(far);
        if let Some(picture) = picture.filter(|_| !self.state.running) {
            self.state.number += 1;
            self.told.picture.send_replace(Arc::new(picture));
        }
        self.tell();
    }

    fn picture(&mut self) -> Result<(), Failure> {
        let began = Instant::now();
        self.fire = self.fire.saturating_sub(1);
        let shot = self.table.shoot()?;
        self.note(&shot);
        let rate_hz = began.elapsed().max(FASTEST).as_secs_f64().recip();
        let state = &mut self.state;
        state.rate_hz = if state.rate_hz > 0.0 {
            0.8 * state.rate_hz + 0.2 * rate_hz
        } else {
            rate_hz
        };
        state.number += 1;
        self.told.picture.send_replace(Arc::new(shot.picture));
        Ok(())
    }

    /// Takes in what a picture shows.
    fn note(&mut self, shot: &Shot) {
        let (settings, tally) = (self.table.settings(), self.table.tally());
        let state = &mut self.state;
        (state.missed, state.dropped) = (tally.missed_triggers, tally.dropped_frames);
        state.strobe = Some(shot.strobe);
        state.look = shot.look.clone();
        if state.sharpness.len() == HISTORY {
            state.sharpness.remove(0);
        }
        state.sharpness.push(shot.look.sharpness);
        state.outlines.clone_from(&shot.outlines);
        let seen = &mut self.witness;
        seen.strobe = Some(shot.strobe);
        seen.exposure_us = settings.exposure_s * 1e6;
        seen.look = shot.look.clone();
        // White has nothing that could be sharp but edges.
        if matches!(settings.shown, Shown::Cross | Shown::Stripes) {
            seen.sharpness.clone_from(&state.sharpness);
        }
        seen.width_px = state.size_px.0;
        let median = Some(f64::from(shot.look.median_dn));
        match settings.shown {
            Shown::Black => seen.black_dn = median,
            Shown::White => seen.white_dn = median,
            _ => {}
        }
        if settings.shown == Shown::White || shot.outlines.iter().any(|outline| outline.seen.is_some()) {
            seen.outlines.clone_from(&shot.outlines);
        }
    }

    /// Finds the exposure time for what is shown; black has that of what was shown before.
    fn expose(&mut self) -> Result<(), Failure> {
        if self.table.settings().shown == Shown::Black {
            return Ok(());
        }
        let exposure_s = self.table.auto_exposure_s()?;
        if (exposure_s / self.table.settings().exposure_s - 1.0).abs() < SAME {
            // Black and white are compared at one exposure time.
            return Ok(());
        }
        self.set(|settings| settings.exposure_s = exposure_s)?;
        (self.witness.black_dn, self.witness.white_dn) = (None, None);
        Ok(())
    }

    /// Changes what is looked at, and exposes it as it needs where nobody has said how.
    fn set_scene(&mut self, change: impl FnOnce(&mut Settings)) -> Result<(), Failure> {
        self.set(change)?;
        if self.state.is_automatic {
            self.expose()
        } else {
            Ok(())
        }
    }

    fn set(&mut self, change: impl FnOnce(&mut Settings)) -> Result<(), Failure> {
        let mut settings = self.table.settings().clone();
        change(&mut settings);
        self.table.set(settings)?;
        self.tell_settings();
        self.fire = self.fire.max(1);
        Ok(())
    }

    fn grant(&mut self, wish: Wish) -> Result<(), Failure> {
        match wish {
            Wish::Show(text) => {
                let shown: Shown = text.parse().map_err(Failure::input)?;
                self.set_scene(|settings| settings.shown = shown)
            }
            Wish::ExposureMs(ms) => {
                self.set(|settings| settings.exposure_s = ms * 1e-3)?;
                self.state.is_automatic = false;
                (self.witness.black_dn, self.witness.white_dn) = (None, None);
                Ok(())
            }
            Wish::AutoExposure => {
                self.state.is_automatic = true;
                self.expose()
            }
            Wish::Gain(gain) => self.set_scene(|settings| settings.gain = Some(gain)),
            Wish::Hold(held) => self.set_scene(|settings| settings.held = held),
            Wish::Run(running) => {
                self.state.running = running;
                Ok(())
            }
            Wish::Fire => {
                self.fire += 1;
                Ok(())
            }
            Wish::Move { part, motion, by } => {
                self.table.move_part(part, motion, by)?;
                self.forget();
                Ok(())
            }
            Wish::Misalign {
                seed,
                position_mm,
                angle_deg,
            } => {
                if !(0.0..=10.0).contains(&position_mm) || !(0.0..=10.0).contains(&angle_deg) {
                    return Err(Failure::input(format!(
                        "misalign: expected 0 to 10 mm and 0 to 10 degrees, found {position_mm} and {angle_deg}"
                    )));
                }
                self.table.misalign(seed, position_mm, angle_deg)?;
                (self.state.advice, self.state.rounds) = (None, 0);
                self.forget();
                Ok(())
            }
            Wish::Plug(is_in) => {
                self.table.plug(is_in)?;
                self.state.is_plugged = is_in;
                Ok(())
            }
            Wish::Advise => self.advise(),
            Wish::Follow => self.follow(),
            Wish::Answer(_) => Err(Failure::input(
                "answer: expected nobody to be asked, found an answer",
            )),
            Wish::Calibrate => self.calibrate(),
        }
    }

    /// Makes the moves of the last advice on the virtual rig.
    fn follow(&mut self) -> Result<(), Failure> {
        let Some(advice) = self.state.advice.take() else {
            return Err(Failure::input(
                "follow: expected advice, found none: ask for it first",
            ));
        };
        for one in advice.moves.iter().filter(|one| one.is_clear) {
            self.table.move_part(one.part, one.motion, one.by)?;
        }
        self.forget();
        Ok(())
    }

    /// Forgets what was seen of the rig as it stood before something was moved.
    fn forget(&mut self) {
        self.witness.outlines.clear();
        (self.witness.advice, self.witness.is_calibrated) = (None, false);
    }

    fn advise(&mut self) -> Result<(), Failure> {
        let folder = tempfile::tempdir()?;
        let dir = folder.path().join("views");
        if !self.views(&dir, None, "views for advice")? {
            return Err(Failure::input(
                "advice: expected all views, found that somebody stopped",
            ));
        }
        let advice = advise(&dir)?;
        self.witness.advice = Some(advice.clone());
        self.state.advice = Some(advice);
        self.state.rounds += 1;
        Ok(())
    }

    fn calibrate(&mut self) -> Result<(), Failure> {
        let Some(out) = self.out.clone() else {
            return Err(Failure::input(
                "calibrate: expected `rcg live --out DIR`, found no directory; or stop, and run `rcg calibrate geometry`",
            ));
        };
        std::fs::create_dir_all(&out)?;
        if let Some(truth) = self.table.truth() {
            write_whole(&out.join("truth.toml"), truth.to_toml().as_bytes())?;
        }
        // As large as what is looked at.
        let image_size = self.table.rig().camera.lens.width_px;
        if !self.views(&out, Some(image_size), "calibration")? {
            return Err(Failure::input(
                "calibrate: expected all views, found that somebody stopped",
            ));
        }
        calibrate(&out, &Said::default())?;
        self.witness.is_calibrated = true;
        Ok(())
    }

    /// Takes views into `dir`; whether all were taken.
    fn views(&mut self, dir: &std::path::Path, image_size: Option<u32>, what: &str) -> Result<bool, Failure> {
        let teller = Teller {
            asked: &self.asked,
            told: &self.told,
            state: Mutex::new(self.state.clone()),
            what,
        };
        teller.change(|task| what.clone_into(&mut task.what));
        let mut hands = AtThePage { teller: &teller };
        Ok(self.table.views(dir, image_size, &mut hands, &teller)?)
    }
}

/// Tells how far views are, and answers who wishes something meanwhile.
struct Teller<'a> {
    asked: &'a Mutex<Receiver<Asking>>,
    told: &'a Told,
    state: Mutex<State>,
    what: &'a str,
}

impl Teller<'_> {
    fn change(&self, change: impl FnOnce(&mut Task)) {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        change(state.task.get_or_insert_default());
        self.told.state.send_replace(Arc::new(state.clone()));
    }

    fn busy(&self, (_, answer): Asking) {
        answer
            .send(Err(format!(
                "expected an instrument that is free, found it busy: {}",
                self.what
            )))
            .ok();
    }
}

impl Progress for Teller<'_> {
    fn begin(&self, stage: &str, total: usize, _unit: &str) {
        self.change(|task| {
            (task.what, task.done, task.of) = (format!("{}: {stage}", self.what), 0, total);
        });
    }

    fn reach(&self, done: usize) {
        self.change(|task| task.done = done);
        let asked = self.asked.lock().unwrap_or_else(PoisonError::into_inner);
        while let Ok(asking) = asked.try_recv() {
            self.busy(asking);
        }
    }

    fn end(&self) {
        self.change(|task| task.done = task.of);
    }
}

/// Somebody at a page.
struct AtThePage<'a> {
    teller: &'a Teller<'a>,
}

impl Hands for AtThePage<'_> {
    fn change(&mut self, asked: &Asked) -> Answer {
        self.teller.change(|task| {
            task.what = format!("{}: view {} of {}", self.teller.what, asked.number, asked.of);
            task.asks = Some(Asks {
                target: asked.target.to_owned(),
                complaint: asked.complaint.map(str::to_owned),
                can_keep: asked.can_keep,
            });
        });
        let receiver = self.teller.asked.lock().unwrap_or_else(PoisonError::into_inner);
        let answer = loop {
            match receiver.recv() {
                Ok((Wish::Answer(text), answer)) => {
                    answer.send(Ok(())).ok();
                    break match text.as_str() {
                        "ready" => Answer::Ready,
                        "again" => Answer::Again,
                        "keep" => Answer::Keep,
                        "stop" => Answer::Stop,
                        _ => Answer::Unknown(text),
                    };
                }
                Ok(asking) => self.teller.busy(asking),
                // Nobody is left who could put anything in.
                Err(_) => break Answer::Stop,
            }
        };
        drop(receiver);
        self.teller.change(|task| task.asks = None);
        answer
    }
}
