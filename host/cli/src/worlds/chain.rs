//! The chain of one world, by the program's own commands.
//!
//! # Design
//! Every stage is a process of its own, as a user would start it. It answers with exit code 0, or refuses with 1 or 2 and one
//! sentence; everything else is a fault. What it was called with stands in `commands.txt`, what it said in files with the
//! stage's name.

use std::fs::{self, OpenOptions};
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};

use rcg::brdf::Brdf;
use rcg::brdf::sample::parse;
use rcg::judge::worlds::{DrawnRequest, DrawnRig, File, Judgement, Outcome, Sizes, judge};

use crate::failure::Failure;
use crate::stage::stage;

/// Why a chain did not go on.
pub(super) enum Stop {
    /// A stage did not answer: how the world ended.
    Ended(Outcome),
    /// The stage could not be started, or what it said not be kept.
    Failed(Failure),
}

impl From<io::Error> for Stop {
    fn from(error: io::Error) -> Self {
        Self::Failed(error.into())
    }
}

/// What the stages run with.
pub(super) struct Chain<'a> {
    /// This program.
    pub(super) program: &'a Path,
    /// Threads of each stage; `None` for as many as there are cores.
    pub(super) threads: Option<usize>,
    pub(super) sizes: Sizes,
    pub(super) rig: &'a DrawnRig,
    /// The folder of the rig, an absolute path.
    pub(super) folder: PathBuf,
}

fn words(line: &[&str]) -> Vec<String> {
    line.iter().map(|word| (*word).to_owned()).collect()
}

impl Chain<'_> {
    fn at(&self, name: &str) -> String {
        self.folder.join(name).display().to_string()
    }

    /// Draws how the rig really is, and calibrates it.
    pub(super) fn calibrate(&self) -> Result<(), Stop> {
        let (truth, calibration) = (self.at("truth.toml"), self.at("calibration"));
        let (rig, seed) = (self.rig.preset.as_str(), self.rig.seed.to_string());
        let mut line = words(&["truth", "--out", &truth, "--rig", rig, "--seed", &seed]);
        for (option, value) in &self.rig.flaws {
            line.extend([option.clone(), value.clone()]);
        }
        self.stage(&self.folder, "truth", 1, &line)?;
        let with = |what: &str, size: u32| {
            let size = size.to_string();
            let line = ["calibrate", what, "--out", &calibration, "--truth", &truth];
            let rest = ["--rig", rig, "--seed", &seed, "--image-size", &size];
            words(&[line, rest].concat())
        };
        let geometry = with("geometry", self.sizes.geometry_px);
        self.stage(&self.folder, "geometry", 2, &geometry)?;
        let mut photometry = with("photometry", self.sizes.photometry_px);
        if !self.rig.tilts.is_empty() {
            photometry.extend(["--tilts".to_owned(), self.rig.tilts.join(",")]);
        }
        self.stage(&self.folder, "photometry", 2, &photometry)?;
        Ok(())
    }

    /// Measures what was drawn in `folder`, fills what is missing, and judges both.
    pub(super) fn measure(
        &self,
        request: &DrawnRequest,
        folder: &Path,
    ) -> Result<(Outcome, Vec<File>), Failure> {
        let (mut files, mut wrong) = (Vec::new(), Vec::new());
        let ended = match self.stages(request, folder, &mut files, &mut wrong) {
            Ok(()) => None,
            Err(Stop::Ended(outcome)) => Some(outcome),
            Err(Stop::Failed(failure)) => return Err(failure),
        };
        for file in &files {
            let of = file.judgement.wrong.iter();
            wrong.extend(of.map(|sentence| format!("{}: {sentence}", file.name)));
        }
        let outcome = match ended {
            // What was wrong before a later stage refused is wrong all the same.
            _ if !wrong.is_empty() => Outcome::Silent { wrong },
            Some(outcome) => outcome,
            None => Outcome::Right,
        };
        Ok((outcome, files))
    }

    fn stages(
        &self,
        request: &DrawnRequest,
        folder: &Path,
        files: &mut Vec<File>,
        wrong: &mut Vec<String>,
    ) -> Result<(), Stop> {
        let place = |name: &str| folder.join(name).display().to_string();
        let mut fill = words(&["fill"]);
        for (number, tilt) in request.captures.iter().enumerate() {
            let name = format!("m{number}");
            let line = self.measurement(request, number, tilt.as_deref(), &place(&name));
            self.stage(folder, &format!("measure-{number}"), 1, &line)?;
            let out = folder.join(&name);
            let report = fs::read_to_string(out.join("report.html"))?;
            if report.contains("not calibrated") {
                wrong.push(format!(
                    "{name}: expected a report of a calibrated measurement, found one that is not calibrated"
                ));
            }
            let judgement = judged(&out.join("brdf.zarr"), request, "measure")?;
            files.push(File {
                name: name.clone(),
                is_capture: true,
                judgement,
            });
            fill.push(place(&name));
        }
        fill.extend(["--out".to_owned(), place("whole.zarr")]);
        self.stage(folder, "fill", 1, &fill)?;
        let judgement = judged(&folder.join("whole.zarr"), request, "fill")?;
        files.push(File {
            name: "whole".to_owned(),
            is_capture: false,
            judgement,
        });
        Ok(())
    }

    /// The line of capture number `number` of `request`.
    fn measurement(
        &self,
        request: &DrawnRequest,
        number: usize,
        tilt: Option<&str>,
        out: &str,
    ) -> Vec<String> {
        let seed = (request.seed + number as u64).to_string();
        let (truth, calibration) = (self.at("truth.toml"), self.at("calibration"));
        let (step, size) = (self.sizes.step_deg.to_string(), self.sizes.image_px.to_string());
        let mut line = words(&["measure", "--out", out, "--rig", &self.rig.preset]);
        line.extend(words(&["--truth", &truth, "--calibration", &calibration]));
        line.extend(words(&["--sample", &request.sample, "--seed", &seed]));
        line.extend(words(&["--grid", &request.grid, "--step", &step]));
        line.extend(words(&["--image-size", &size, "--brackets", &request.brackets]));
        line.extend(words(&["--light", &request.light]));
        if request.estimate {
            line.extend(words(&["--estimate", "on"]));
        }
        line.extend(tilt.iter().flat_map(|tilt| words(&["--tilt", tilt])));
        for (option, rate) in &request.faults {
            line.extend([option.clone(), rate.clone()]);
        }
        line
    }

    /// Runs the stage `name`: this program with `line`, whose first `words` name the command.
    fn stage(&self, folder: &Path, name: &str, words: usize, line: &[String]) -> Result<(), Stop> {
        let log = folder.join("commands.txt");
        let mut log = OpenOptions::new().create(true).append(true).open(log)?;
        writeln!(log, "rcg {}", line.join(" "))?;
        let mut command = stage(self.program, line);
        if let Some(threads) = self.threads {
            command.env("RAYON_NUM_THREADS", threads.to_string());
        }
        let answer = command.output()?;
        fs::write(folder.join(format!("{name}.json")), &answer.stdout)?;
        fs::write(folder.join(format!("{name}.stderr")), &answer.stderr)?;
        let said = String::from_utf8_lossy(&answer.stderr).replace(&self.at(""), "");
        let command = line[..words].join(" ");
        match ending(answer.status.code(), &said, command) {
            None => Ok(()),
            Some(outcome) => Err(Stop::Ended(outcome)),
        }
    }
}

/// How a world ended with `command`, which ended with `code` and `said` something on stderr; `None` if it answered.
fn ending(code: Option<i32>, said: &str, command: String) -> Option<Outcome> {
    let is_panic = said.contains("panicked at");
    let last = said.trim_end().lines().last().unwrap_or_default();
    match (code, last.strip_prefix("rcg: ")) {
        (Some(0), _) if !is_panic => None,
        (Some(1 | 2), Some(sentence)) if !is_panic => Some(Outcome::Refused {
            command,
            sentence: sentence.to_owned(),
        }),
        _ => {
            let code = code.map_or_else(|| "a signal".to_owned(), |code| format!("exit code {code}"));
            let ending = format!("expected an answer or one sentence, found {code} and `{last}`");
            Some(Outcome::Broken { command, ending })
        }
    }
}

/// Judges the file at `path`, which `command` made of the sample of `request`.
fn judged(path: &Path, request: &DrawnRequest, command: &str) -> Result<Judgement, Stop> {
    let broken = |error: &dyn std::fmt::Display| {
        Stop::Ended(Outcome::Broken {
            command: command.to_owned(),
            ending: error.to_string(),
        })
    };
    let sample = parse(&request.sample).map_err(|error| Stop::Failed(error.into()))?;
    let brdf = Brdf::open(path).map_err(|error| broken(&error))?;
    let mut judgement = judge(&brdf, sample.as_ref()).map_err(|error| broken(&error))?;
    match brdf.uncalibrated().as_deref() {
        Some([]) => {}
        found => {
            let found = found.map_or_else(|| "nothing".to_owned(), |names| names.join(", "));
            judgement.wrong.push(format!(
                "uncalibrated: expected an empty list of a calibrated measurement, found {found}"
            ));
        }
    }
    Ok(judgement)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stage_answers_refuses_in_one_sentence_or_is_broken() {
        let of = |code, said: &str| ending(code, said, "measure".to_owned()).map(|outcome| outcome.name());
        assert_eq!(of(Some(0), ""), None);
        for code in [1, 2] {
            assert_eq!(
                of(Some(code), "rcg: light: expected some, found none\n"),
                Some("refused")
            );
        }
        for (code, said) in [
            (None, ""),
            (Some(1), ""),
            (Some(101), "thread 'main' panicked at x.rs\n"),
            (Some(0), "thread 'a' panicked at x.rs\n"),
            (Some(3), "rcg: a sentence\n"),
            (Some(2), "error: something else\n"),
        ] {
            assert_eq!(of(code, said), Some("broken"), "{said}");
        }
    }
}
