//! How a rig and what is measured on it are drawn.
//!
//! # Design
//! Everything follows from one seed: rig number i of a seed, and its request number j, are the same however many are drawn.
//! Flaws are drawn on a log scale from good to bad; those of one group by one number, because who mounts a camera well mounts
//! the mirror well too. Values are kept as the text that a command line takes, so that they are read as they were drawn.
//!
//! A flaw that `rcg truth` learns gets a row in [`FLAWS`].

use std::fmt;
use std::str::FromStr;

use rand::{RngExt as _, SeedableRng as _};
use rand_xoshiro::Xoshiro256PlusPlus;
use serde::{Deserialize, Serialize};

/// A flaw of the rig that an option of `rcg truth` sets.
#[derive(Clone, Copy, Debug)]
pub struct Flaw {
    /// The option, with its dashes.
    pub option: &'static str,
    /// Flaws of one group are good or bad together.
    group: usize,
    /// The best that is drawn, in the option's unit.
    good: f64,
    /// The worst that is drawn; neither is 0.
    bad: f64,
    /// The worst that a careful laboratory has.
    careful: f64,
}

/// All flaws that are drawn.
pub const FLAWS: [Flaw; 20] = [
    flaw("--position-mm", 0, [0.1, 3.0], 1.0),
    flaw("--angle-deg", 0, [0.05, 2.0], 0.5),
    flaw("--field-percent", 1, [5.0, 30.0], 30.0),
    flaw("--contrast", 2, [3000.0, 400.0], 1000.0),
    flaw("--glare-percent", 3, [0.1, 1.0], 0.3),
    flaw("--ghost-percent", 4, [0.5, 4.0], 4.0),
    flaw("--drift-percent", 5, [0.2, 2.0], 0.5),
    flaw("--flicker-percent", 5, [0.05, 0.5], 0.1),
    flaw("--prnu-percent", 6, [0.2, 1.0], 1.0),
    flaw("--row-noise-e", 6, [0.1, 1.0], 0.3),
    flaw("--falloff-percent", 7, [2.0, 20.0], 20.0),
    flaw("--figure-mrad", 8, [0.05, 0.5], 0.15),
    flaw("--knee-percent", 9, [0.3, 3.0], 1.0),
    flaw("--seating-mm", 0, [0.02, 0.1], 0.05),
    flaw("--blur-px", 1, [0.3, 0.8], 0.4),
    flaw("--wander-e", 6, [0.1, 1.0], 0.3),
    flaw("--crosstalk-percent", 8, [0.5, 3.0], 1.0),
    flaw("--lag-percent", 2, [0.2, 2.0], 0.5),
    flaw("--polarisation-percent", 4, [0.2, 2.0], 0.5),
    flaw("--mirror-deg", 0, [0.01, 0.05], 0.025),
];

const fn flaw(option: &'static str, group: usize, [good, bad]: [f64; 2], careful: f64) -> Flaw {
    Flaw {
        option,
        group,
        good,
        bad,
        careful,
    }
}

impl Flaw {
    /// The value at `badness`, 0 for good to 1 for bad.
    fn at(&self, badness: f64) -> f64 {
        self.good * (self.bad / self.good).powf(badness)
    }

    /// How bad a careful laboratory may be, 0 to 1.
    fn careful_badness(&self) -> f64 {
        (self.careful / self.good).ln() / (self.bad / self.good).ln()
    }
}

/// Which rigs are drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Kind {
    /// From good to bad.
    Any,
    /// No flaw beyond what a careful laboratory has.
    Careful,
    /// Every flaw at its worst.
    Bad,
}

impl FromStr for Kind {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "any" => Ok(Self::Any),
            "careful" => Ok(Self::Careful),
            "bad" => Ok(Self::Bad),
            _ => Err("expected any, careful or bad".to_owned()),
        }
    }
}

impl fmt::Display for Kind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Any => "any",
            Self::Careful => "careful",
            Self::Bad => "bad",
        })
    }
}

/// How fine captures are, pixels a side and degrees.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Sizes {
    /// Image of a measurement.
    pub image_px: u32,
    /// Image of the geometric calibration.
    pub geometry_px: u32,
    /// Image of the photometric calibration.
    pub photometry_px: u32,
    /// Between rings of incident directions, degrees.
    pub step_deg: f64,
}

/// A virtual rig as it was drawn.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct DrawnRig {
    /// Its number.
    pub index: u64,
    /// What it should be: the name of a preset.
    pub preset: String,
    /// Options of `rcg truth` and their values.
    pub flaws: Vec<(String, String)>,
    /// Seed of the truth and of the noise of the calibrations.
    pub seed: u64,
    /// Tilts at which the standard is captured, as `--tilts` takes them.
    pub tilts: Vec<String>,
    /// Seed of what is measured on it.
    requests: u64,
}

/// A measurement as it was drawn.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct DrawnRequest {
    /// Its number on the rig.
    pub index: u64,
    /// The sample, a model as `rcg measure --sample` takes it.
    pub sample: String,
    /// Seed of the noise.
    pub seed: u64,
    /// `theta-phi` or `equal-solid-angle`.
    pub grid: String,
    /// `1` or `auto`.
    pub brackets: String,
    /// `single` or `auto`.
    pub light: String,
    /// Whether pixels are fused with what their surroundings say.
    pub estimate: bool,
    /// Options of `rcg measure` for faults on the lines and their rates.
    pub faults: Vec<(String, String)>,
    /// The tilt of each capture of the sample, `None` for none: one capture, or an untilted and a tilted one.
    pub captures: Vec<Option<String>>,
}

/// Tilts that show what the hole and the wire hide.
const TILTS: [&str; 3] = ["51:84:40", "52:100:-44", "54:45:60"];
/// Share of the rigs whose standard is captured at a tilt too.
const TILTED: f64 = 0.5;
/// Samples that are drawn beside lobes by chance.
const SAMPLES: [&str; 9] = [
    "lambert:0.5",
    "lambert:0.18",
    "lambert:0.6,0.3,0.06",
    "ward:brass",
    "ggx:metal",
    "ggx:satin",
    "ggx:plastic",
    "velvet:pile",
    "satin:silk",
];
/// Share of the samples that are lobes by chance.
const BY_CHANCE: f64 = 0.4;
/// Widths α of a lobe by chance.
const WIDTHS: [f64; 2] = [0.1, 0.6];
/// Share of the measurements for which a pilot capture chooses between single spots and codes of light, and of those whose pixels know of
/// their surroundings.
const CODED: f64 = 0.25;
const ESTIMATED: f64 = 0.5;
/// Options for faults on the lines.
const FAULTS: [&str; 3] = ["--missed-triggers", "--dropped-frames", "--doubled-frames"];
/// Share of the measurements that have a fault of each kind, and its rates.
const FAULTY: f64 = 0.25;
const RATES: [f64; 2] = [1e-3, 2e-2];

/// The seed number `index` of those that follow from `seed`. Seeds are below 2³¹: files hold no larger ones.
fn follows(seed: u64, index: u64) -> u64 {
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed);
    for _ in 0..index {
        rng.random::<u64>();
    }
    rng.random::<u64>() >> 33
}

fn log_uniform(rng: &mut Xoshiro256PlusPlus, [low, high]: [f64; 2]) -> f64 {
    low * (high / low).powf(rng.random_range(0.0..1.0))
}

/// `value` with three digits that count.
fn rounded(value: f64) -> String {
    let scale = 10_f64.powi(2 - value.abs().log10().floor() as i32);
    format!("{}", (value * scale).round() / scale)
}

fn one_of<'a>(rng: &mut Xoshiro256PlusPlus, all: &[&'a str]) -> &'a str {
    all[rng.random_range(0..all.len())]
}

impl DrawnRig {
    /// Rig number `index` of `seed`, one of `presets`.
    #[must_use]
    pub fn draw(seed: u64, index: u64, presets: &[&str], kind: Kind) -> Self {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(follows(seed, index));
        let (truth, requests) = (rng.random::<u64>() >> 33, rng.random::<u64>() >> 33);
        let preset = one_of(&mut rng, presets).to_owned();
        let is_tilted = rng.random_bool(TILTED);
        let tilt = one_of(&mut rng, &TILTS).to_owned();
        // Last, so that another flaw changes nothing else.
        let groups = FLAWS.iter().map(|flaw| flaw.group).max().unwrap_or(0) + 1;
        let drawn: Vec<f64> = (0..groups).map(|_| rng.random_range(0.0..1.0)).collect();
        let limit = |group: usize| {
            let of = FLAWS.iter().filter(|flaw| flaw.group == group);
            of.map(Flaw::careful_badness).fold(1.0, f64::min)
        };
        let flaws = FLAWS.iter().map(|flaw| {
            let badness = match kind {
                Kind::Any => drawn[flaw.group],
                Kind::Careful => drawn[flaw.group] * limit(flaw.group),
                Kind::Bad => 1.0,
            };
            (flaw.option.to_owned(), rounded(flaw.at(badness)))
        });
        Self {
            index,
            preset,
            flaws: flaws.collect(),
            seed: truth,
            tilts: if is_tilted { vec![tilt] } else { Vec::new() },
            requests,
        }
    }

    /// Measurement number `index` on this rig.
    #[must_use]
    pub fn request(&self, index: u64) -> DrawnRequest {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(follows(self.requests, index));
        let seed = rng.random::<u64>() >> 33;
        let grid = one_of(&mut rng, &["theta-phi", "equal-solid-angle"]).to_owned();
        let brackets = one_of(&mut rng, &["1", "auto"]).to_owned();
        let how = rng.random_range(0..4);
        let captures = match (self.tilts.first().cloned(), how) {
            (None, _) | (_, 0) => vec![None],
            (tilt, 1) => vec![tilt],
            (tilt, _) => vec![None, tilt],
        };
        let sample = if rng.random_bool(BY_CHANCE) {
            lobe(&mut rng)
        } else {
            one_of(&mut rng, &SAMPLES).to_owned()
        };
        let mut faults = Vec::new();
        for option in FAULTS {
            if rng.random_bool(FAULTY) {
                faults.push((option.to_owned(), rounded(log_uniform(&mut rng, RATES))));
            }
        }
        // Last, as above.
        let light = if rng.random_bool(CODED) { "auto" } else { "single" }.to_owned();
        let estimate = rng.random_bool(ESTIMATED);
        DrawnRequest {
            index,
            sample,
            seed,
            grid,
            brackets,
            light,
            estimate,
            faults,
            captures,
        }
    }
}

/// A lobe over a diffuse base, by chance.
fn lobe(rng: &mut Xoshiro256PlusPlus) -> String {
    let (model, strength) = *[("ward", "rs"), ("ggx", "f0")]
        .get(rng.random_range(0..2))
        .expect("invariant: one of two");
    let [ax, ay] = [(); 2].map(|()| rounded(log_uniform(rng, WIDTHS)));
    let base = rounded(rng.random_range(0.05..0.5));
    let strength_value = rounded(rng.random_range(0.05..0.5));
    format!("{model}:rd={base},{strength}={strength_value},ax={ax},ay={ay}")
}
