//! The calibration of the virtual rig that a measurement begins with if nothing is said of one.
//!
//! # Design
//! It is what `rcg calibrate geometry` and `rcg calibrate photometry` find: the same lines are parsed and run. The result is kept
//! in the user's cache under a name that says all that decides it ([`kept`]), so that the next measurement on the same rig has it.

use std::fs;
use std::path::PathBuf;

use clap::Parser;
use etcetera::BaseStrategy as _;
use rcg::base::progress::Progress as _;
use rcg::calibrate::kept;
use rcg::instrument::rig::{Rig, Tilt};
use rcg::plan::Virtual;
use rcg::store::whole_file::FileError;

use super::{Command, geometry, photometry};
use crate::failure::Failure;
use crate::output::Output;
use crate::request::NO_CALIBRATION;

/// `rcg calibrate` as a line of words.
#[derive(Debug, Parser)]
#[command(name = "rcg calibrate", no_binary_name = true)]
struct Line {
    #[command(subcommand)]
    command: Command,
}

/// The directory of a calibration of the virtual `rig`, which `named` is the argument of, as it is asked for, with the standard at `tilt` too: one that is kept, or
/// a new one.
pub(crate) fn calibrated(
    named: &str,
    rig: &Rig,
    virtual_rig: &Virtual,
    tilt: Option<Tilt>,
    output: &Output,
) -> Result<PathBuf, Failure> {
    let program = std::env::current_exe()?;
    let shelf = shelf()?;
    let dir = shelf.join(kept::key(rig, virtual_rig, tilt, &program)?);
    if dir.is_dir() {
        output.remark(&format!(
            "{}: the calibration of this virtual rig, kept from an earlier run, is taken into account",
            dir.display()
        ));
        return Ok(dir);
    }
    fs::create_dir_all(&shelf).map_err(|source| FileError::at(&shelf, source))?;
    let made = tempfile::Builder::new()
        .prefix("unfinished-")
        .tempdir_in(&shelf)
        .map_err(|source| FileError::at(&shelf, source))?;
    output.remark(&format!(
        "the virtual rig is calibrated first, by geometry and photometry, and the result kept in {} for further runs; \
         --calibration {NO_CALIBRATION} measures without",
        dir.display()
    ));
    let at = made.path().display().to_string();
    for what in ["geometry", "photometry"] {
        let line = words(what, &at, virtual_rig, tilt);
        calibrate(&line, named, output).map_err(|failure| {
            // The directory is gone with the failure.
            let said = failure.to_string().replace(&format!("{at}: "), "").replace(&at, "its calibration");
            failure.saying(format!(
                "the virtual rig is calibrated first, and that failed: {said} (--calibration {NO_CALIBRATION} measures without)"
            ))
        })?;
    }
    kept::keep(made.path(), &dir)?;
    Ok(dir)
}

/// Where calibrations are kept.
fn shelf() -> Result<PathBuf, Failure> {
    let places = etcetera::choose_base_strategy().map_err(|error| {
        Failure::input(format!(
            "HOME: expected a home directory, in whose cache calibrations of the virtual rig are kept, found none: {error} \
             (--calibration {NO_CALIBRATION} measures without)"
        ))
    })?;
    Ok(places.cache_dir().join("rcg").join("calibrations"))
}

/// The words of `rcg calibrate WHAT` of `virtual_rig` in the directory `out`.
fn words(what: &str, out: &str, virtual_rig: &Virtual, tilt: Option<Tilt>) -> Vec<String> {
    let mut words = vec![what.to_owned(), "--out".to_owned(), out.to_owned()];
    if let Some(truth) = &virtual_rig.truth {
        words.push(format!("--truth={truth}"));
    }
    if !virtual_rig.noise {
        words.push("--noise=off".to_owned());
    }
    words.extend(
        tilt.filter(|_| what == "photometry")
            .map(|tilt| format!("--tilts={tilt}")),
    );
    words
}

/// Runs `rcg calibrate` with these words; what was found goes into its directory alone.
fn calibrate(words: &[String], rig: &str, output: &Output) -> Result<(), Failure> {
    let line = Line::try_parse_from(words).map_err(|error| Failure::input(error.to_string()))?;
    match &line.command {
        Command::Geometry(args) => geometry::calibrated(args, rig, output).map(drop),
        Command::Photometry(args) => photometry::calibrated(args, rig, output).map(drop),
    }
}
