//! `kill -9` at random moments of every command that writes much: what has its final name is whole, and the same command again (with
//! `--resume` where it measures) comes to the same bytes.
//!
//! A few in every run of the tests; `RCG_KILLS=1000` makes a thousand, with calibrations among them.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::time::{Duration, Instant};

use rand::{RngExt as _, SeedableRng as _};
use rand_xoshiro::Xoshiro256PlusPlus;

use crate::command::{rcg, run, text};
use crate::tree::files;

/// In every run of the tests.
const KILLS: usize = 20;

/// What is killed: a command, its arguments but for the place of its result.
struct Victim {
    name: &'static str,
    arguments: Vec<String>,
    /// What is asked for beside, to go on after a kill.
    again: &'static [&'static str],
    /// Which parts of the result are whole whenever they are there; the result itself if none is named.
    whole: &'static [&'static str],
}

/// Everything below `path`, or the file itself.
fn content(path: &Path) -> Vec<(PathBuf, Vec<u8>)> {
    if path.is_dir() {
        files(path).into_iter().collect()
    } else {
        fs::read(path)
            .map(|bytes| vec![(PathBuf::new(), bytes)])
            .unwrap_or_default()
    }
}

fn remove(path: &Path) {
    if path.is_dir() {
        fs::remove_dir_all(path).unwrap();
    } else {
        fs::remove_file(path).ok();
    }
}

impl Victim {
    fn new(name: &'static str, arguments: &[&str]) -> Self {
        Self {
            name,
            arguments: arguments.iter().map(|&word| word.to_owned()).collect(),
            again: &[],
            whole: &[],
        }
    }

    fn command(&self, out: &Path, more: &[&str]) -> Vec<String> {
        let place = ["--out", text(out)].into_iter().chain(more.iter().copied());
        self.arguments
            .iter()
            .cloned()
            .chain(place.map(str::to_owned))
            .collect()
    }

    /// Whether a run that is killed after `time` was killed before its end; `out` is as it left it.
    fn kill(&self, out: &Path, time: Duration) -> bool {
        let mut child = rcg(&self.command(out, self.again))
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        std::thread::sleep(time);
        child.kill().unwrap();
        child.wait().unwrap().code().is_none()
    }

    /// What has its final name in `out` is as in `expected`, or not there.
    fn is_whole(&self, out: &Path, expected: &Path) {
        let parts = if self.whole.is_empty() {
            &[""][..]
        } else {
            self.whole
        };
        for part in parts {
            let (found, expected) = (content(&out.join(part)), content(&expected.join(part)));
            assert!(
                found.is_empty() || found == expected,
                "{} {part}: looks whole and is not",
                self.name
            );
        }
    }
}

/// All of them; what they read stands in `folder`.
fn victims(folder: &Path, with_calibration: bool) -> Vec<Victim> {
    let size = [
        "--step",
        "30",
        "--image-size",
        "16",
        "--exposure-ms",
        "4",
        "--seed",
        "5",
    ];
    let measured = folder.join("measured");
    run(&[&["measure", "--out", text(&measured)][..], &size].concat(), "").done();
    let measured = text(&measured).to_owned();
    let measure = |name, more: &[&str]| Victim {
        again: &["--resume"],
        whole: &["brdf.zarr"],
        ..Victim::new(name, &[&["measure"][..], more].concat())
    };
    let budget = [
        "--adaptive",
        "--budget",
        "16",
        "--image-size",
        "16",
        "--exposure-ms",
        "4",
    ];
    let mut all = vec![
        measure("measure", &size),
        Victim::new("assemble", &["assemble", &measured]),
        Victim::new("fill", &["fill", &measured]),
        Victim::new("export", &["export", &measured, "--to", "csv", "--step", "20"]),
        measure("adaptive", &budget),
    ];
    if with_calibration {
        let geometry = ["calibrate", "geometry", "--image-size", "64"];
        all.push(Victim {
            whole: &["geometry.json", "rig.toml"],
            ..Victim::new("calibrate", &geometry)
        });
    }
    all
}

#[test]
fn whatever_is_killed_leaves_nothing_that_looks_whole_and_comes_to_the_same_bytes() {
    let wanted = std::env::var("RCG_KILLS").ok();
    let wanted = wanted.map(|text| text.parse::<usize>().expect("RCG_KILLS is a number"));
    let scratch = tempfile::tempdir().unwrap();
    let victims = victims(scratch.path(), wanted.is_some());
    let undisturbed: Vec<(PathBuf, Duration)> = victims
        .iter()
        .map(|victim| {
            let out = scratch.path().join(format!("undisturbed-{}.csv", victim.name));
            let began = Instant::now();
            run(&victim.command(&out, &[]), "").done();
            (out, began.elapsed())
        })
        .collect();
    let seed = std::time::SystemTime::now()
        .duration_since(std::time::UNIX_EPOCH)
        .unwrap();
    println!("drawn by {}", seed.as_nanos() as u64);
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed.as_nanos() as u64);
    let (mut kills, mut tries) = (vec![0; victims.len()], 0);
    while kills.iter().sum::<usize>() < wanted.unwrap_or(KILLS) {
        let which = tries % victims.len();
        let (victim, (expected, time)) = (&victims[which], &undisturbed[which]);
        tries += 1;
        assert!(
            tries < 20 * wanted.unwrap_or(KILLS),
            "nothing is killed before its end"
        );
        let out = scratch.path().join("killed.csv");
        remove(&out);
        // Now and then what goes on is killed, too.
        for _ in 0..rng.random_range(1..=2) {
            kills[which] += usize::from(victim.kill(&out, time.mul_f64(rng.random_range(0.0..1.0))));
            victim.is_whole(&out, expected);
        }
        run(&victim.command(&out, victim.again), "").done();
        let (found, expected) = (content(&out), content(expected));
        let differ: Vec<&PathBuf> = found
            .iter()
            .filter(|file| !expected.contains(file))
            .chain(expected.iter().filter(|file| !found.contains(file)))
            .map(|(path, _)| path)
            .collect();
        assert!(differ.is_empty(), "{}: another result: {differ:?}", victim.name);
    }
    for (victim, kills) in victims.iter().zip(kills) {
        println!("{}: {kills} kills", victim.name);
    }
}
