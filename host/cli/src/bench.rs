//! `rcg bench`
//!
//! # Design
//! Every stage is a process of its own, with the options that a user would give it, so that whatever `rcg measure` can do can be
//! tried, and a stage that refuses is a row of the answer.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use clap::Parser;
use rcg::base::progress::Progress as _;
use rcg::brdf::Brdf;
use rcg::brdf::sample::parse;
use rcg::instrument::rig::Rig;
use rcg::store::Lock;
use rcg::study::Spheres;
use rcg::study::pareto::{Pareto, Row};
use serde_json::Value;

use crate::Done;
use crate::failure::Failure;
use crate::measure;
use crate::output::Output;
use crate::request::image_size;
use crate::stage::stage;

/// Find which plan of measuring errs least in which time on the instrument.
///
/// Each draw is a rig with flaws (as by `truth`), calibrated by its own commands; on each, every sample is measured by every plan, noise
/// and all, and compared with what it is. The answer has the median over the draws: seconds on the instrument (light and waiting),
/// the median relative error over theta up to 80 degrees, the share within k = 2, and the smallest PSNR of spheres under the lights of
/// `study`; a star is at plans that no other beats in both time and error. A stage that refuses is a row that says why.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Directory for pareto.csv (every measurement), pareto.json and the figure (pareto.svg, pareto.png)
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// What is measured, as `measure --sample` takes it; several, each with its own --sample [default: lambert:0.5, satin, ward:brass]
    #[arg(long = "sample", value_name = "SAMPLE")]
    samples: Vec<String>,
    /// Options of `measure` in one word, such as "--step 10 --brackets 3"; several, each with its own --plan [default: steps of 30, 15, 10 and 5 degrees]
    #[arg(long = "plan", value_name = "OPTIONS", allow_hyphen_values = true)]
    plans: Vec<String>,
    /// Rigs that are drawn, each with its own flaws and calibration
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u64).range(1..=10_000))]
    draws: u64,
    /// Seed of the first draw; the next ones count on from there
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u64).range(0..=1_000_000_000))]
    seed: u64,
    /// How large flaws are, as `truth --flaws` takes it
    #[arg(long, value_name = "SIZE", default_value = "typical", value_parser = ["drawn", "typical", "bad"])]
    flaws: String,
    /// Factor from radiance (light of unit irradiance) to white, of the spheres
    #[arg(long, value_name = "FACTOR", default_value_t = 3.0, value_parser = exposure, allow_negative_numbers = true)]
    exposure: f32,
    /// Pixels a side of the image of the geometric calibration
    #[arg(long, value_name = "N", default_value_t = 256, value_parser = image_size)]
    geometry_image_size: u32,
    /// Pixels a side of the image of the photometric calibration
    #[arg(long, value_name = "N", default_value_t = 96, value_parser = image_size)]
    photometry_image_size: u32,
}

/// What is measured, and by which plans, unless others are given.
const SAMPLES: [&str; 3] = ["lambert:0.5", "satin", "ward:brass"];
const PLANS: [&str; 4] = ["--step 30", "--step 15", "--step 10", "--step 5"];

/// The options of a plan; what this command says itself stays as it is.
#[derive(Debug, Parser)]
#[command(name = "rcg measure", no_binary_name = true)]
struct Plan {
    #[command(flatten)]
    args: measure::Args,
}

fn exposure(text: &str) -> Result<f32, String> {
    let found = text.parse().ok();
    found
        .filter(|factor: &f32| factor.is_finite() && *factor > 0.0)
        .ok_or_else(|| "expected a positive number".to_owned())
}

pub(crate) fn run(args: &Args, rig: &str, output: &Output) -> Done {
    let samples = given(&args.samples, &SAMPLES);
    let plans = given(&args.plans, &PLANS);
    let full = Rig::load(rig)?;
    if full.is_real() {
        return Err(Failure::input(format!(
            "rig {}: expected the virtual rig, whose samples are known, found a real camera and projector",
            full.name
        )));
    }
    plans.iter().try_for_each(|plan| check(plan))?;
    let spheres = samples
        .iter()
        .map(|sample| Ok(Spheres::new(&parse(sample)?, args.exposure)?))
        .collect::<Result<Vec<_>, Failure>>()?;
    let _lock = Lock::folder(&args.out)?;
    let scratch = tempfile::Builder::new().prefix("rcg-bench-").tempdir()?;
    let run = Run {
        program: std::env::current_exe()?,
        rig,
        args,
        folder: scratch.path(),
    };
    let mut rows = Vec::new();
    let each = samples.len() * plans.len();
    output.begin("bench", each * args.draws as usize, "measurements");
    for draw in args.seed..args.seed + args.draws {
        let calibrated = run.calibrate(draw)?;
        for (sample, spheres) in samples.iter().zip(&spheres) {
            for plan in &plans {
                rows.push(match &calibrated {
                    Some(sentence) => Row::refused(draw, sample, plan, sentence.clone()),
                    None => run.measure(draw, sample, plan, spheres)?,
                });
                output.reach(rows.len());
            }
        }
    }
    output.end();
    let found = Pareto::new(rig, args.exposure, rows);
    found.save(&args.out)?;
    output.print(&found, || text(&found))
}

/// What was given, or what is usual.
fn given(given: &[String], usual: &[&str]) -> Vec<String> {
    if given.is_empty() {
        usual.iter().map(|word| (*word).to_owned()).collect()
    } else {
        given.to_vec()
    }
}

/// Refuses options that `measure` does not take, and those that are said for all plans alike.
fn check(plan: &str) -> Done {
    const OURS: [&str; 9] = [
        "--out",
        "--sample",
        "--truth",
        "--calibration",
        "--seed",
        "--reference",
        "--rig",
        "--resume",
        "--replay",
    ];
    let words: Vec<&str> = plan.split_whitespace().collect();
    let is = |word: &str, option: &str| {
        word == option
            || word
                .strip_prefix(option)
                .is_some_and(|rest| rest.starts_with('='))
    };
    if let Some(word) = words
        .iter()
        .find(|word| OURS.iter().any(|option| is(word, option)))
    {
        return Err(Failure::input(format!(
            "--plan {plan}: expected options of `rcg measure` that say how it measures, found {word}, which this command says itself"
        )));
    }
    let line = ["--out", "plan"].iter().chain(&words);
    Plan::try_parse_from(line).map(drop).map_err(|error| {
        let said = error.to_string();
        let first = said.lines().next().unwrap_or_default();
        Failure::input(format!(
            "--plan {plan}: expected options of `rcg measure`, found {}",
            first.trim_start_matches("error: ")
        ))
    })
}

/// What all stages are run with.
struct Run<'a> {
    program: PathBuf,
    rig: &'a str,
    args: &'a Args,
    folder: &'a Path,
}

impl Run<'_> {
    fn at(&self, name: &str) -> String {
        self.folder.join(name).display().to_string()
    }

    /// Draws a rig and calibrates it; returns why that was refused, if it was.
    fn calibrate(&self, draw: u64) -> Result<Option<String>, Failure> {
        let (truth, calibration, seed) = (self.at("truth.toml"), self.at("calibration"), draw.to_string());
        let [geometry, photometry] =
            [self.args.geometry_image_size, self.args.photometry_image_size].map(|size| size.to_string());
        if self.folder.join("calibration").exists() {
            std::fs::remove_dir_all(&calibration)?;
        }
        let drawn = [
            "truth",
            "--out",
            &truth,
            "--flaws",
            &self.args.flaws,
            "--seed",
            &seed,
        ];
        let on = [
            "--out",
            &calibration,
            "--truth",
            &truth,
            "--seed",
            &seed,
            "--image-size",
        ];
        for line in [
            drawn.to_vec(),
            [&["calibrate", "geometry"], &on[..], &[&geometry]].concat(),
            [&["calibrate", "photometry"], &on[..], &[&photometry]].concat(),
        ] {
            if let Err(sentence) = self.stage(&line)? {
                return Ok(Some(format!("rcg {}: {sentence}", line[..2].join(" "))));
            }
        }
        Ok(None)
    }

    /// Measures `sample` by `plan` on the rig that was drawn.
    fn measure(&self, draw: u64, sample: &str, plan: &str, spheres: &Spheres) -> Result<Row, Failure> {
        let (truth, calibration) = (self.at("truth.toml"), self.at("calibration"));
        let (out, seed) = (self.folder.join("m"), draw.to_string());
        let place = out.display().to_string();
        let mut line = vec![
            "measure",
            "--out",
            &place,
            "--truth",
            &truth,
            "--calibration",
            &calibration,
        ];
        line.extend(["--sample", sample, "--seed", &seed]);
        line.extend(plan.split_whitespace());
        let row = match self.stage(&line)? {
            Err(sentence) => Row::refused(draw, sample, plan, sentence),
            Ok(answer) => {
                let brdf = Brdf::open(&out.join("brdf.zarr"))?;
                Row::of(draw, sample, plan, &answer, &spheres.judge(&brdf)?)
            }
        };
        if out.exists() {
            std::fs::remove_dir_all(&out)?;
        }
        Ok(row)
    }

    /// What the stage that `line` calls answered, or the sentence with which it refused.
    fn stage(&self, line: &[&str]) -> Result<Result<Value, String>, Failure> {
        let ended = stage(&self.program, line).args(["--rig", self.rig]).output()?;
        let answer: Value = serde_json::from_slice(&ended.stdout).unwrap_or_default();
        match (ended.status.code(), answer["error"].as_str()) {
            (Some(0), _) => Ok(Ok(answer)),
            (Some(1 | 2), Some(sentence)) => Ok(Err(sentence.to_owned())),
            _ => {
                let said = String::from_utf8_lossy(&ended.stderr);
                let last = said.trim_end().lines().last().unwrap_or_default().to_owned();
                Err(Failure::Failed(anyhow::anyhow!(
                    "rcg {}: expected an answer or one sentence, found {} and `{last}`",
                    line.join(" "),
                    ended.status
                )))
            }
        }
    }
}

fn text(found: &Pareto) -> String {
    let mut text = format!(
        "rig {}, spheres at exposure {}; medians over the draws, a star where no other plan beats time and error\n\
         {:>9}  {:>8}  {:>7}  {:>8}  {:>7}    sample, plan\n",
        found.rig, found.exposure, "time", "error", "k = 2", "PSNR", "refused"
    );
    for point in &found.points {
        let or_none = |shown: Option<String>| shown.unwrap_or_else(|| "none".to_owned());
        let percent = |share: Option<f64>| or_none(share.map(|share| format!("{:.2} %", 100.0 * share)));
        writeln!(
            text,
            "{:>9}  {:>8}  {:>7}  {:>8}  {:>7}  {} {}, {}",
            or_none(point.instrument_s.map(|s| format!("{s:.2} s"))),
            percent(point.error_median),
            or_none(point.within_k2.map(|share| format!("{:.1} %", 100.0 * share))),
            or_none(point.psnr_y_db.map(|db| format!("{db:.1} dB"))),
            format!("{}/{}", point.refused, point.measured + point.refused),
            if point.best { '*' } else { ' ' },
            point.sample,
            point.plan
        )
        .expect("strings take everything");
    }
    text
}
