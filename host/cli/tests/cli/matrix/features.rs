//! The table of features: what a measurement can be asked for, and what cannot be asked for together.

/// What the instrument really is, and what is known of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum World {
    /// As its rig file says.
    AsFiled,
    /// Drawn by `rcg truth`, and nobody has calibrated it.
    Strays,
    /// Drawn by `rcg truth` and calibrated.
    Calibrated,
}

/// What is done with the options.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Via {
    Measure,
    /// `plan`, `capture`, `assemble`.
    Stages,
    /// A measurement, filled by itself and with one of another tilt.
    Fill,
    Multiplex,
}

/// One way to measure.
#[derive(Clone, Copy, Debug)]
#[allow(clippy::struct_excessive_bools)] // each is an option
pub(super) struct Case {
    pub(super) rig: &'static str,
    /// Whether its camera has no colours and its projector makes them, one after the other.
    pub(super) bands: bool,
    /// A model, or `FILE` for a measured file.
    pub(super) sample: &'static str,
    /// A grid, or `LIST` for a file of directions.
    pub(super) grid: &'static str,
    pub(super) adaptive: bool,
    pub(super) brackets: Option<&'static str>,
    pub(super) exposure_ms: Option<&'static str>,
    pub(super) light: Option<&'static str>,
    pub(super) estimate: Option<&'static str>,
    pub(super) world: World,
    pub(super) tilt: Option<&'static str>,
    pub(super) noise: bool,
    pub(super) lossless: bool,
    pub(super) fault: Option<&'static str>,
    /// Killed and resumed.
    pub(super) resume: bool,
    pub(super) replay: bool,
    /// Whether somebody says who measures.
    pub(super) said: bool,
    pub(super) image_size: &'static str,
    pub(super) seed: &'static str,
    pub(super) via: Via,
}

/// Stands for a measured file.
pub(super) const FILE: &str = "FILE";
/// Stands for a file of directions.
pub(super) const LIST: &str = "LIST";
/// A sample that half a minute does not saturate as others do in milliseconds.
const DARK: &str = "lambert:0.005";

/// What is measured unless a feature says otherwise.
pub(super) const USUAL: Case = Case {
    rig: "rcg-1-16bit",
    bands: false,
    sample: "lambert:0.5",
    grid: "theta-phi",
    adaptive: false,
    brackets: None,
    exposure_ms: None,
    light: None,
    estimate: None,
    world: World::AsFiled,
    tilt: None,
    noise: true,
    lossless: false,
    fault: None,
    resume: false,
    replay: false,
    said: false,
    image_size: "24",
    seed: "1",
    via: Via::Measure,
};

/// A feature's name, and the values that are not the usual one with what they change.
type Feature = (&'static str, &'static [(&'static str, fn(&mut Case))]);

pub(super) const FEATURES: [Feature; 20] = [
    (
        "rig",
        &[("rcg-2", |c| c.rig = "rcg-2"), ("dmd", |c| c.rig = "dmd")],
    ),
    ("bands", &[("in turn", |c| c.bands = true)]),
    (
        "sample",
        &[
            ("ward", |c| c.sample = "ward:rd=0.3,rs=0.1,ax=0.7,ay=0.6"),
            ("ggx", |c| c.sample = "ggx:f0=0.2,ax=0.7,ay=0.6,rd=0.4"),
            ("file", |c| c.sample = FILE),
        ],
    ),
    (
        "grid",
        &[
            ("equal-solid-angle", |c| c.grid = "equal-solid-angle"),
            ("list", |c| c.grid = LIST),
        ],
    ),
    ("adaptive", &[("on", |c| c.adaptive = true)]),
    (
        "brackets",
        &[
            ("auto", |c| c.brackets = Some("auto")),
            ("2", |c| c.brackets = Some("2")),
            ("times", |c| c.brackets = Some("0.05,0.4,3")),
        ],
    ),
    (
        "exposure",
        &[
            ("short", |c| c.exposure_ms = Some("0.1")),
            ("long", |c| {
                c.exposure_ms = Some("2000");
                if c.sample == USUAL.sample {
                    c.sample = DARK;
                }
            }),
        ],
    ),
    (
        "light",
        &[
            ("multiplexed", |c| c.light = Some("multiplexed:7")),
            ("complement", |c| c.light = Some("complement:3")),
            ("auto", |c| c.light = Some("auto")),
        ],
    ),
    ("estimate", &[("on", |c| c.estimate = Some("on"))]),
    (
        "world",
        &[
            ("strays", |c| c.world = World::Strays),
            ("calibrated", |c| c.world = World::Calibrated),
        ],
    ),
    (
        "tilt",
        &[
            ("little", |c| c.tilt = Some("12:30:5")),
            ("much", |c| c.tilt = Some("51:84:40")),
        ],
    ),
    ("noise", &[("off", |c| c.noise = false)]),
    ("lossless", &[("on", |c| c.lossless = true)]),
    (
        "faults",
        &[
            ("missed", |c| c.fault = Some("--missed-triggers")),
            ("dropped", |c| c.fault = Some("--dropped-frames")),
            ("doubled", |c| c.fault = Some("--doubled-frames")),
        ],
    ),
    ("resume", &[("killed", |c| c.resume = true)]),
    ("replay", &[("plan", |c| c.replay = true)]),
    ("session", &[("said", |c| c.said = true)]),
    ("image-size", &[("odd", |c| c.image_size = "25")]),
    ("seed", &[("other", |c| c.seed = "7")]),
    (
        "via",
        &[
            ("stages", |c| c.via = Via::Stages),
            ("fill", |c| c.via = Via::Fill),
            ("multiplex", |c| c.via = Via::Multiplex),
        ],
    ),
];

/// A value of a feature: their places in [`FEATURES`].
pub(super) type Value = (usize, usize);

/// The name of a value, `feature=value`.
pub(super) fn name((feature, value): Value) -> String {
    let (feature, values) = FEATURES[feature];
    format!("{feature}={}", values[value].0)
}

/// All pairs of values of different features, with names.
pub(super) fn pairs() -> Vec<[Value; 2]> {
    let values: Vec<Value> = FEATURES
        .iter()
        .enumerate()
        .flat_map(|(feature, (_, values))| (0..values.len()).map(move |value| (feature, value)))
        .collect();
    let later = |a: Value| values.iter().copied().filter(move |b| b.0 > a.0);
    values
        .iter()
        .flat_map(|&a| later(a).map(move |b| [a, b]))
        .collect()
}

impl Case {
    /// The usual case with a pair of other values.
    pub(super) fn of(pair: [Value; 2]) -> Self {
        let mut case = USUAL;
        for (feature, value) in pair {
            FEATURES[feature].1[value].1(&mut case);
        }
        case
    }

    /// Why these options contradict each other, a part of the sentence that must say so; `None` if they must work.
    pub(super) fn contradiction(&self) -> Option<&'static str> {
        let is_bracketed = self.brackets.is_some();
        match self.via {
            _ if is_bracketed && self.exposure_ms.is_some() => {
                Some("--exposure-ms: expected none beside --brackets")
            }
            Via::Multiplex if is_bracketed || self.exposure_ms.is_some() => {
                Some("finds the exposure times of every alternative itself")
            }
            Via::Multiplex if self.light.is_some() => Some("--light: expected single"),
            Via::Multiplex if self.adaptive => Some("--adaptive"),
            Via::Multiplex if self.resume => Some("--resume"),
            Via::Multiplex if self.replay => Some("--replay"),
            Via::Multiplex if self.said => Some("--operator"),
            _ if self.adaptive && self.light.is_some() => Some("light: expected single with --adaptive"),
            _ => None,
        }
    }
}
