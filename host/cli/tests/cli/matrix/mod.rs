//! Options in pairs: what works alone works together, with values that are right within their stated uncertainty, or is
//! refused in one sentence that says why.
//!
//! # Design
//! A table of features ([`features`]) makes some 480 pairs of values that are not the usual ones. Each pair is tried with
//! images of 24 pixels. A run of the tests draws [`DRAWN`] of them; `RCG_FULL=1` tries all, `RCG_SEED=N` draws others, and
//! `RCG_PAIR=feature=value,feature=value` tries one.

mod features;
mod lab;

use std::fmt::Write as _;
use std::fs;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

use rand::SeedableRng as _;
use rand::seq::SliceRandom as _;
use rand_xoshiro::Xoshiro256PlusPlus;
use rcg::store::provenance::Provenance;

use crate::command::{is_full, rcg, run, text};
use crate::judge::{Scores, scores};
use crate::tree::{count, files};
use features::{Case, FILE, LIST, Value, Via, World, name, pairs};
use lab::Lab;

/// Pairs that a run of the tests draws.
const DRAWN: usize = 10;
/// Cases that are tried at a time.
const AT_ONCE: usize = 2;
/// Tilts that the standard is seen at.
const TILTS: &str = "12:30:5,51:84:40";
/// What was captured.
const SEEN: [Provenance; 2] = [Provenance::Measured, Provenance::Merged];

/// One case on its way.
struct Trial<'a> {
    lab: &'a Lab,
    case: Case,
    folder: PathBuf,
    /// The commands so far, for who wants to repeat them.
    commands: String,
}

impl Trial<'_> {
    fn out(&self, name: &str) -> String {
        text(&self.folder.join(name)).to_owned()
    }

    /// Runs the command and notes it down.
    fn run(&mut self, arguments: &[String]) -> crate::command::Outcome {
        writeln!(self.commands, "  rcg {}", arguments.join(" ")).unwrap();
        run(arguments, "")
    }

    /// The rig file, and how it really is.
    fn rig(&self) -> (String, String) {
        let Case { rig, bands, .. } = self.case;
        if bands {
            let file = self.lab.in_bands(rig);
            let truth = self.lab.truth(&format!("{rig}.bands"));
            return (file, truth);
        }
        (rig.to_owned(), self.lab.truth(rig))
    }

    /// What is measured, as `measure`, `plan` and `multiplex` take it.
    fn request(&self) -> Vec<String> {
        let (case, lab) = (&self.case, self.lab);
        let (rig, truth) = self.rig();
        let mut all = vec!["--rig".to_owned(), rig];
        let mut put = |option: &str, value: &str| all.extend([option.to_owned(), value.to_owned()]);
        put("--sample", &lab.sample(case));
        match case.grid {
            LIST => put("--grid", &lab.at("directions.txt")),
            grid => {
                put("--grid", grid);
                put("--step", "30");
            }
        }
        for (option, value) in [
            ("--brackets", case.brackets),
            ("--exposure-ms", case.exposure_ms),
            ("--light", case.light),
            ("--estimate", case.estimate),
            ("--tilt", case.tilt),
        ] {
            if let Some(value) = value {
                put(option, value);
            }
        }
        if case.world != World::AsFiled {
            put("--truth", &truth);
        }
        if case.world == World::Calibrated {
            put("--calibration", &lab.calibration(case.rig, case.bands).unwrap());
        }
        if !case.noise {
            put("--noise", "off");
        }
        if case.lossless {
            all.push("--lossless".to_owned());
        }
        let mut put = |option: &str, value: &str| all.extend([option.to_owned(), value.to_owned()]);
        if case.said {
            put("--operator", "Ada");
            put("--note", "of the matrix");
        }
        put("--image-size", case.image_size);
        put("--seed", case.seed);
        all
    }

    fn faults(&self) -> Vec<String> {
        let fault = self.case.fault.map(|fault| [fault.to_owned(), "0.1".to_owned()]);
        fault.into_iter().flatten().collect()
    }

    /// `rcg measure` into `name`.
    fn measure(&self, name: &str) -> Vec<String> {
        let mut all = vec!["measure".to_owned(), "--out".to_owned(), self.out(name)];
        all.extend(self.request());
        all.extend(self.faults());
        if self.case.adaptive {
            all.extend(["--adaptive", "--budget", "40"].map(str::to_owned));
        }
        all
    }

    /// Runs `arguments`, and where the case says so kills it once something is captured, and goes on.
    fn run_perhaps_killed(&mut self, arguments: &[String], name: &str, resume: &[&str]) {
        if self.case.resume {
            let out = self.folder.join(name);
            let mut child = rcg(arguments)
                .stdin(std::process::Stdio::null())
                .stdout(std::process::Stdio::null())
                .stderr(std::process::Stdio::null())
                .spawn()
                .unwrap();
            let has = |store: &str| count(&out.join(store).join("frames"), "c.") > 0;
            while child.try_wait().unwrap().is_none() && !has("raw.zarr") && !has("adaptive.zarr") {
                std::thread::yield_now();
            }
            child.kill().ok();
            child.wait().unwrap();
            let again: Vec<String> = arguments
                .iter()
                .cloned()
                .chain(resume.iter().map(|part| (*part).to_owned()))
                .collect();
            self.run(&again).done();
        } else {
            self.run(arguments).done();
        }
    }

    /// The values of the measurement `name`.
    fn f(&self, name: &str) -> std::collections::BTreeMap<PathBuf, Vec<u8>> {
        files(&self.folder.join(name).join("brdf.zarr/f"))
    }

    fn scores(&self, path: &str, kinds: &[Provenance]) -> Scores {
        let sample = rcg::brdf::sample::parse(&self.lab.sample(&self.case)).unwrap();
        scores(Path::new(path), sample.as_ref(), kinds)
    }

    /// Measures, and returns what the samples are worth.
    fn measured(&mut self) -> Scores {
        if self.case.via == Via::Stages && !self.case.adaptive {
            let plan = [
                &["plan".to_owned(), "--out".to_owned(), self.out("m")][..],
                &self.request(),
            ]
            .concat();
            self.run(&plan).done();
            let capture = [&["capture".to_owned(), self.out("m")][..], &self.faults()].concat();
            self.run_perhaps_killed(&capture, "m", &[]);
            self.run(&["assemble".to_owned(), self.out("m")]).done();
        } else {
            let measure = self.measure("m");
            self.run_perhaps_killed(&measure, "m", &["--resume"]);
        }
        if self.case.resume {
            // As if nothing had happened.
            let measure = self.measure("undisturbed");
            self.run(&measure).done();
            assert!(self.f("m") == self.f("undisturbed"), "resumed to other values");
        }
        if self.case.via == Via::Stages && self.case.adaptive {
            let before = self.f("m");
            fs::remove_dir_all(self.folder.join("m/brdf.zarr")).unwrap();
            self.run(&["capture".to_owned(), self.out("m")]).done();
            self.run(&["assemble".to_owned(), self.out("m")]).done();
            assert!(self.f("m") == before, "assembled to other values");
        }
        if self.case.replay {
            let mut again = [
                "measure",
                "--out",
                &self.out("again"),
                "--replay",
                &self.out("m/plan.toml"),
            ]
            .map(str::to_owned)
            .to_vec();
            again.extend(["--rig".to_owned(), self.rig().0]);
            // What is taken again draws other noise.
            again.extend(self.faults());
            if self.case.world == World::Calibrated {
                again.extend([
                    "--calibration".to_owned(),
                    self.lab.calibration(self.case.rig, self.case.bands).unwrap(),
                ]);
            }
            self.run(&again).done();
            assert!(self.f("again") == self.f("m"), "replayed to other values");
        }
        self.scores(&self.out("m/brdf.zarr"), &SEEN)
    }

    /// Fills what was measured, alone and with a capture of another tilt, which need not overlap.
    fn fill(&mut self) -> String {
        let mut said = String::new();
        let alone = [
            "fill".to_owned(),
            self.out("m"),
            "--out".to_owned(),
            self.out("alone.zarr"),
        ];
        self.run(&alone).done();
        self.case.tilt = match self.case.tilt {
            None => Some("12:30:5"),
            Some(_) => None,
        };
        let other = self.measure("other");
        self.run(&other).done();
        let both = [
            "fill",
            &self.out("m"),
            &self.out("other"),
            "--out",
            &self.out("both.zarr"),
        ]
        .map(str::to_owned);
        let outcome = self.run(&both);
        if outcome.code != Some(0) {
            outcome.complains(2, &["other", "samples that", "has too, found"]);
            ", without overlap".clone_into(&mut said);
        }
        for file in ["alone.zarr", "both.zarr"] {
            let path = self.out(file);
            if !Path::new(&path).exists() {
                continue;
            }
            self.check(&self.scores(&path, &SEEN), "filled");
            let reciprocal = self.scores(&path, &[Provenance::Reciprocal]);
            write!(said, "; {file}: reciprocal {reciprocal}").unwrap();
            let is_known = self.case.world != World::Strays && self.case.sample != FILE;
            if is_known && reciprocal.count > 100 {
                assert!(reciprocal.within_2 > 0.8, "reciprocal: {reciprocal}");
            }
        }
        said
    }

    /// Whether the samples are as good as they say.
    fn check(&self, found: &Scores, what: &str) {
        let case = &self.case;
        if found.count == 0 {
            // Many directions at once saturate the camera in what suits a few exposure times of one.
            let is_coded = case.light.is_some() && case.exposure_ms.is_some();
            let is_long = case.exposure_ms == Some("2000");
            assert!(is_long || is_coded, "{what}: nothing was measured");
            return;
        }
        // What nobody calibrated is not in the uncertainty, and 1/cosθ is steep for these coarse pixels.
        if case.world == World::Strays || case.sample == FILE {
            let most = if case.world == World::Strays { 1.0 } else { 0.05 };
            // A short exposure is noisy, and says so.
            let is_stated = case.sample == FILE && found.within_2 >= 0.95;
            assert!(is_stated || found.median_error < most, "{what}: {found}");
            return;
        }
        assert!(found.within_2 >= 0.9, "{what}: {found}");
        // Of n normal deviates one may be beyond 6 once in 10⁹; blur and fields are not normal.
        assert!(found.worst < 6.0, "{what}: {found}");
    }

    /// Asks whether multiplexing pays.
    fn multiplex(&mut self) -> String {
        let mut all = vec!["multiplex".to_owned(), "--json".to_owned()];
        all.extend(["--order", "7"].map(str::to_owned));
        all.extend(self.request());
        all.extend(self.faults());
        let answer = self.run(&all).object();
        for alternative in answer["alternatives"].as_array().unwrap() {
            let uncertainty = alternative["uncertainty"].as_f64();
            assert!(uncertainty.is_some_and(|u| u > 0.0 && u < 10.0), "{alternative}");
        }
        answer["verdict"].as_str().unwrap().to_owned()
    }

    /// What must be refused.
    fn refused(&mut self, why: &str) -> String {
        let all = match self.case.via {
            Via::Multiplex => {
                let mut all = vec!["multiplex".to_owned()];
                all.extend(self.request());
                let flags = [
                    (self.case.adaptive, "--adaptive"),
                    (self.case.resume, "--resume"),
                    (self.case.replay, "--replay"),
                ];
                all.extend(flags.iter().filter(|flag| flag.0).map(|flag| flag.1.to_owned()));
                all
            }
            Via::Stages => {
                let mut all = vec!["plan".to_owned(), "--out".to_owned(), self.out("m")];
                all.extend(self.request());
                all
            }
            Via::Measure | Via::Fill => self.measure("m"),
        };
        let outcome = self.run(&all);
        outcome.complains(2, &[why]);
        assert!(!self.folder.join("m").exists(), "something was written");
        "refused".to_owned()
    }

    fn outcome(&mut self) -> String {
        fs::create_dir_all(&self.folder).unwrap();
        if let Some(why) = self.case.contradiction() {
            return self.refused(why);
        }
        if self.case.via == Via::Multiplex {
            return self.multiplex();
        }
        let found = self.measured();
        self.check(&found, "measured");
        let more = if self.case.via == Via::Fill {
            self.fill()
        } else {
            String::new()
        };
        format!("{found}{more}")
    }
}

/// The pairs to try.
fn chosen() -> Vec<[Value; 2]> {
    let mut all = pairs();
    if let Ok(wanted) = std::env::var("RCG_PAIR") {
        all.retain(|pair| pair.map(name).join(",") == wanted);
        assert!(!all.is_empty(), "RCG_PAIR: no such pair: {wanted}");
        return all;
    }
    if !is_full() {
        let seed = std::env::var("RCG_SEED").map_or(1, |seed| seed.parse().expect("RCG_SEED is a number"));
        println!("RCG_SEED={seed}");
        all.shuffle(&mut Xoshiro256PlusPlus::seed_from_u64(seed));
        all.truncate(DRAWN);
    }
    all
}

#[test]
fn options_work_in_pairs_or_are_refused() {
    let lab = Lab::open();
    for rig in ["rcg-1-16bit", "rcg-2", "dmd"] {
        lab.write_in_bands(rig);
        Lab::draw_truth(rig, &lab.truth(rig));
        Lab::draw_truth(&lab.in_bands(rig), &lab.truth(&format!("{rig}.bands")));
    }
    let all = chosen();
    let (next, table) = (AtomicUsize::new(0), Mutex::new(Vec::new()));
    std::thread::scope(|scope| {
        for _ in 0..AT_ONCE {
            scope.spawn(|| {
                while let Some(pair) = all.get(next.fetch_add(1, Ordering::Relaxed)) {
                    let names = pair.map(name).join(",");
                    let mut trial = Trial {
                        lab: &lab,
                        case: Case::of(*pair),
                        folder: lab.folder.join(&names),
                        commands: String::new(),
                    };
                    let ended = catch_unwind(AssertUnwindSafe(|| trial.outcome()));
                    fs::remove_dir_all(&trial.folder).ok();
                    let line = ended.map_err(|panic| {
                        let said = panic.downcast_ref::<String>().cloned().unwrap_or_default();
                        format!(
                            "RCG_PAIR={names} cargo test --test cli options_work\n{}  {said}",
                            trial.commands
                        )
                    });
                    println!("{names}: {}", line.as_deref().unwrap_or("FAILED"));
                    table.lock().unwrap().push(line);
                }
            });
        }
    });
    let failed: Vec<String> = table
        .into_inner()
        .unwrap()
        .into_iter()
        .filter_map(Result::err)
        .collect();
    assert!(
        failed.is_empty(),
        "{} of {} pairs failed:\n{}",
        failed.len(),
        all.len(),
        failed.join("\n")
    );
}
