//! A measurement goes on only as what it is: whatever decided what was captured is compared by content.
//!
//! # Design
//! A table over every file of a measurement and every file that it names elsewhere, each edited, exchanged for another
//! measurement's, cut short and removed, and over every command that goes on with it. Each is refused in one sentence with
//! a path, or proven harmless: what the command makes is the same to the bit.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use crate::command::{Outcome, is_full, rcg, refuses, run, text};
use crate::tensor_file::{bytes, material};
use crate::tree::{self, files};

/// A measurement with a sample and a truth from files, finished, and another of the same size.
struct World {
    folder: tempfile::TempDir,
}

/// What happens to a file.
#[derive(Clone, Copy, Debug)]
enum Mischance {
    Edited,
    Exchanged,
    CutShort,
    Removed,
}

const MISCHANCES: [Mischance; 4] = [
    Mischance::Edited,
    Mischance::Exchanged,
    Mischance::CutShort,
    Mischance::Removed,
];

/// Commands that go on with a measurement, and what each of them makes.
const STAGES: [(&[&str], &[&str]); 3] = [
    (
        &["measure", "--resume", "--out"],
        &["raw.zarr", "brdf.zarr", "manifest.json", "report.html", "figures"],
    ),
    (&["capture"], &["raw.zarr"]),
    (&["assemble"], &["brdf.zarr"]),
];

impl World {
    fn new() -> Self {
        let world = Self {
            folder: tempfile::tempdir().unwrap(),
        };
        for (name, level, seed) in [("one", 0.2, "1"), ("other", 0.1, "2")] {
            fs::write(world.at(name).with_extension("bsdf"), bytes(&material(level))).unwrap();
            let truth = world.at(name).with_extension("toml");
            run(&["truth", "--seed", seed, "--out", text(&truth)], "").done();
        }
        world
    }

    fn at(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Arguments that say what is measured, for the measurement `name` with noise of `seed`.
    fn request(&self, name: &str, seed: &str) -> Vec<String> {
        let (sample, truth) = (
            self.at(name).with_extension("bsdf"),
            self.at(name).with_extension("toml"),
        );
        let request = ["--sample", text(&sample), "--truth", text(&truth), "--seed", seed];
        let size = ["--step", "15", "--image-size", "16", "--exposure-ms", "4"];
        request.iter().chain(&size).map(|&part| part.to_owned()).collect()
    }

    fn begin(&self, command: &str, name: &str, seed: &str) -> PathBuf {
        let out = self.at(name);
        let mut arguments = vec![command.to_owned(), "--out".to_owned(), text(&out).to_owned()];
        arguments.extend(self.request(name, seed));
        run(&arguments, "").done();
        out
    }
}

/// A copy of the folder `from`, which replaces `to`.
fn copy(from: &Path, to: &Path) {
    fs::remove_dir_all(to).ok();
    tree::copy(from, to);
}

fn befall(mischance: Mischance, path: &Path, other: &Path) {
    let content = fs::read(path).unwrap();
    match mischance {
        Mischance::Edited => {
            // A digit if there is one: the file stays one of its kind.
            let middle = content.len() / 2;
            let digit = (middle..content.len()).find(|&at| content[at].is_ascii_digit());
            let mut edited = content;
            match digit {
                Some(at) => edited[at] = b'0' + (edited[at] - b'0' + 1) % 10,
                None => edited[middle] ^= 1,
            }
            fs::write(path, edited).unwrap();
        }
        Mischance::Exchanged => {
            fs::copy(other, path).unwrap();
        }
        Mischance::CutShort => fs::write(path, &content[..content.len() / 2]).unwrap(),
        Mischance::Removed => fs::remove_file(path).unwrap(),
    }
}

/// Whether `outcome` is a refusal that names something under `folder`; anything but that and success fails.
fn is_refused(outcome: &Outcome, folder: &Path, what: &str) -> bool {
    if outcome.code == Some(0) {
        return false;
    }
    let code = outcome.code.unwrap();
    assert!(code == 2 || code == 1, "{what}: {outcome:?}");
    outcome.complains(code, &[text(folder)]);
    true
}

/// Runs each of `stages` on a copy of `whole` of which the file `name` met with `mischance`; returns how many refused.
fn stages_after(
    whole: &Path,
    name: &Path,
    mischance: Mischance,
    other: &Path,
    scratch: &Path,
    expected: &BTreeMap<PathBuf, Vec<u8>>,
    stages: &[(&[&str], &[&str])],
) -> usize {
    let mut refused = 0;
    for &(command, makes) in stages {
        copy(whole, scratch);
        befall(mischance, &scratch.join(name), other);
        let outcome = run(&[command, &[text(scratch)]].concat(), "");
        let what = format!("{mischance:?} {} before {command:?}", name.display());
        if is_refused(&outcome, scratch, &what) {
            refused += 1;
            continue;
        }
        let found = files(scratch);
        let made = expected
            .iter()
            .filter(|(path, _)| makes.iter().any(|part| path.starts_with(part)) && path.as_path() != name);
        for (path, content) in made {
            assert!(
                found.get(path) == Some(content),
                "{what}: exit 0 with another {}",
                path.display()
            );
        }
    }
    refused
}

#[test]
fn what_says_what_a_measurement_is_cannot_be_exchanged() {
    let world = World::new();
    let (whole, other) = (
        world.begin("measure", "one", "1"),
        world.begin("measure", "other", "2"),
    );
    let expected = files(&whole);
    let scratch = world.at("scratch");
    for name in ["rig.toml", "plan.toml", "manifest.json"] {
        for mischance in MISCHANCES {
            // The rigs are the same: nothing is exchanged there.
            let (name, other) = (Path::new(name), other.join(name));
            let is_other = !matches!(mischance, Mischance::Exchanged)
                || fs::read(&other).unwrap() != fs::read(whole.join(name)).unwrap();
            let refused = stages_after(&whole, name, mischance, &other, &scratch, &expected, &STAGES);
            assert_eq!(
                refused,
                if is_other { 3 } else { 0 },
                "{mischance:?} {}",
                name.display()
            );
        }
    }
    // What comes in addition.
    for (command, _) in STAGES {
        copy(&whole, &scratch);
        fs::write(scratch.join("calibration.json"), "{}").unwrap();
        run(&[command, &[text(&scratch)]].concat(), "").complains(2, &["calibration.json", "found another"]);
    }
    // All that says what it is, together.
    for (command, _) in STAGES {
        copy(&whole, &scratch);
        for name in ["rig.toml", "plan.toml", "manifest.json"] {
            fs::copy(other.join(name), scratch.join(name)).unwrap();
        }
        run(&[command, &[text(&scratch)]].concat(), "").complains(2, &["raw.zarr", "frames of another"]);
    }
}

#[test]
fn no_other_file_of_a_measurement_makes_a_wrong_result() {
    let world = World::new();
    let (whole, other) = (
        world.begin("measure", "one", "1"),
        world.begin("measure", "other", "2"),
    );
    let expected = files(&whole);
    let scratch = world.at("scratch");
    // Always these, and some by chance; each mischance with one of the commands by chance.
    let always = [
        "raw.zarr/zarr.json",
        "raw.zarr/frames/c.0.0.0.0",
        "raw.zarr/frames/zarr.json",
        "raw.zarr/paired/c.0",
        "raw.zarr/seal/c.0",
    ];
    let chance = std::time::SystemTime::now()
        .duration_since(std::time::UNIX_EPOCH)
        .unwrap()
        .subsec_nanos() as usize;
    let all: Vec<&PathBuf> = expected.keys().collect();
    let count = if is_full() { 20 } else { 1 };
    let drawn = (0..count).map(|n| all[(chance + n * 7919 * chance) % all.len()].as_path());
    let always = always.iter().step_by(if is_full() { 1 } else { 2 });
    let names = always.map(Path::new).chain(drawn);
    let cases = names.flat_map(|name| MISCHANCES.map(|mischance| (name, mischance)));
    for (place, (name, mischance)) in cases.enumerate() {
        let stage = &STAGES[(chance + place) % STAGES.len()..][..1];
        println!(
            "{mischance:?} {} before {stage:?} (drawn by {chance})",
            name.display()
        );
        let other = other.join(name);
        stages_after(&whole, name, mischance, &other, &scratch, &expected, stage);
    }
}

#[test]
fn the_files_that_a_measurement_names_are_told_by_content() {
    let world = World::new();
    let whole = world.begin("measure", "one", "1");
    let expected = files(&whole);
    let planned = world.at("planned");
    let plan = ["plan", "--out", text(&planned)].map(str::to_owned);
    run(&[&plan[..], &world.request("one", "1")].concat(), "").done();
    for kind in ["bsdf", "toml"] {
        let path = world.at("one").with_extension(kind);
        let content = fs::read(&path).unwrap();
        for mischance in MISCHANCES {
            befall(mischance, &path, &world.at("other").with_extension(kind));
            let what = format!("{mischance:?} {}", path.display());
            for out in [&whole, &planned] {
                let resume = ["measure", "--resume", "--out", text(out)].map(str::to_owned);
                let given = [&resume[..], &world.request("one", "1")].concat();
                let capture = ["capture", text(out)].map(str::to_owned);
                for command in [resume.to_vec(), given, capture.to_vec()] {
                    let outcome = run(&command, "");
                    assert!(
                        is_refused(&outcome, world.folder.path(), &what),
                        "{what}: {outcome:?}"
                    );
                    outcome.complains(outcome.code.unwrap(), &[text(&path)]);
                }
            }
            // Frames are frames, whatever became of what they show.
            run(&["assemble", text(&whole)], "").done();
            fs::write(&path, &content).unwrap();
        }
    }
    assert!(!planned.join("raw.zarr").exists(), "captured of something else");
    // Put back, all is as it was.
    run(&["measure", "--resume", "--out", text(&whole)], "").done();
    assert!(files(&whole) == expected);
}

#[test]
fn a_rig_of_the_same_name_is_told_by_content() {
    let world = World::new();
    let rig = world.at("mine.toml");
    let preset = include_str!("../../../src/instrument/rig/presets/rcg-1-16bit.toml");
    fs::write(&rig, preset).unwrap();
    let out = world.at("out");
    let measure = |out: &Path, rest: &[&str]| {
        let size = ["--step", "15", "--image-size", "16", "--exposure-ms", "4"];
        let all = [&["measure", "--out", text(out)][..], &size, rest].concat();
        all.into_iter().map(str::to_owned).collect::<Vec<_>>()
    };
    run(&measure(&out, &["--rig", text(&rig)]), "").done();
    let before = files(&out);
    // The same by another name.
    run(&measure(&out, &["--resume", "--rig", "rcg-1-16bit"]), "").done();
    assert!(files(&out) == before);
    let edited = preset.replacen("read_noise_e = ", "read_noise_e = 1", 1);
    assert_ne!(edited, preset);
    fs::write(&rig, edited).unwrap();
    refuses(
        &measure(&out, &["--resume", "--rig", text(&rig)]),
        "",
        2,
        &[
            text(&out),
            "rig: expected rcg-1-16bit (SHA-256",
            "found another one of that name",
        ],
    );
    // And the other way round.
    let second = world.at("second");
    run(&measure(&second, &["--rig", text(&rig)]), "").done();
    refuses(
        &measure(&second, &["--resume"]),
        "",
        2,
        &["rig: expected", "found another"],
    );
    // What was chosen on the way is compared as well.
    let adaptive = [
        "measure",
        "--resume",
        "--out",
        text(&out),
        "--adaptive",
        "--budget",
        "32",
    ];
    refuses(
        &adaptive,
        "",
        2,
        &[
            "expected a measurement that was begun with --adaptive",
            "found one of a",
        ],
    );
    let plan = second.join("plan.toml");
    let replay = [
        "measure",
        "--resume",
        "--out",
        text(&out),
        "--seed",
        "1",
        "--replay",
        text(&plan),
    ];
    run(&replay, "").done();
    let other = world.begin("measure", "one", "3").join("plan.toml");
    let replay = [
        "measure",
        "--resume",
        "--out",
        text(&out),
        "--replay",
        text(&other),
    ];
    refuses(&replay, "", 2, &["sample: expected ward:brass"]);
    assert!(files(&out) == before);
}

#[test]
fn a_relative_sample_is_found_from_anywhere_and_may_be_moved() {
    let world = World::new();
    let (out, here, there) = (world.at("out"), world.folder.path(), world.at("there"));
    fs::create_dir(&there).unwrap();
    let from = |folder: &Path, arguments: &[&str]| {
        let output = rcg(arguments).current_dir(folder).output().unwrap();
        let told = String::from_utf8(output.stderr).unwrap();
        (output.status.code(), told)
    };
    let size = ["--step", "30", "--image-size", "16", "--exposure-ms", "4"];
    let plan = [
        "plan",
        "--out",
        "out",
        "--sample",
        "one.bsdf",
        "--truth",
        "./one.toml",
    ];
    assert_eq!(from(here, &[&plan[..], &size].concat()).0, Some(0));
    let resume = ["measure", "--resume", "--out", text(&out)];
    assert_eq!(from(&there, &resume), (Some(0), String::new()));
    let whole = files(&out.join("brdf.zarr"));
    // By another path, and by its new one when it is gone from the old.
    for (sample, truth) in [("../one.bsdf", "../one.toml"), ("moved", "moved.toml")] {
        if sample == "moved" {
            fs::rename(here.join("one.bsdf"), there.join(sample)).unwrap();
            fs::rename(here.join("one.toml"), there.join(truth)).unwrap();
            let (code, told) = from(&there, &resume);
            assert!(code == Some(2) && told.contains("one.bsdf"), "{told}");
        }
        let given = [&resume[..], &["--sample", sample, "--truth", truth]].concat();
        assert_eq!(from(&there, &given), (Some(0), String::new()));
        assert!(files(&out.join("brdf.zarr")) == whole);
    }
    let other = [
        &resume[..],
        &["--sample", "../other.bsdf", "--truth", "moved.toml"],
    ]
    .concat();
    let (code, told) = from(&there, &other);
    assert!(
        code == Some(2) && told.contains("sample: expected") && told.contains("other.bsdf"),
        "{told}"
    );
}

#[test]
fn a_measurement_of_an_earlier_version_is_refused_by_name() {
    let world = World::new();
    let out = world.begin("measure", "one", "1");
    let manifest = out.join("manifest.json");
    fs::write(&manifest, "{\"state\": \"reported\", \"seed\": 1}").unwrap();
    for (command, _) in STAGES {
        let parts = [text(&manifest), "an earlier version", "format 2"];
        refuses(&[command, &[text(&out)]].concat(), "", 2, &parts);
    }
}
