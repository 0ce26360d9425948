//! What concerns the virtual rig alone, as it was asked for.

use serde::{Deserialize, Serialize};

/// What the virtual rig holds unless told otherwise.
const DEFAULT_SAMPLE: &str = "ward:brass";

/// The table `[virtual]` of a plan; the plan of a real instrument has none.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Virtual {
    /// The sample that stands in it, as [`crate::brdf::sample::parse`] takes it.
    pub sample: String,
    /// File that says how it really is, as [`crate::virtual_rig::Truth::load`] takes it; `None` if it is as the rig file
    /// says.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub truth: Option<String>,
    /// Whether it is noisy.
    pub noise: bool,
    /// Source of all its chance.
    pub seed: u64,
    /// What goes wrong in it on purpose; changes no frame, only how often it must be taken.
    #[serde(default, skip_serializing_if = "Faults::are_none")]
    pub faults: Faults,
}

impl Default for Virtual {
    /// A noisy rig as its file says, with brass in it, seed 1, in which nothing goes wrong on purpose.
    fn default() -> Self {
        Self {
            sample: DEFAULT_SAMPLE.to_owned(),
            truth: None,
            noise: true,
            seed: 1,
            faults: Faults::default(),
        }
    }
}

impl Virtual {
    /// With the full paths of the files that it names, so that they are found from any working directory. A path that
    /// leads nowhere, or is no text, stays as it is.
    #[must_use]
    pub fn located(mut self) -> Self {
        if let Some(sample) = located_sample(&self.sample) {
            self.sample = sample;
        }
        if let Some(truth) = self.truth.as_deref().and_then(|path| full(path.as_ref())) {
            self.truth = Some(truth);
        }
        self
    }

    /// As this one, in which nothing goes wrong on purpose.
    #[must_use]
    pub fn calm(&self) -> Self {
        Self {
            faults: Faults::default(),
            ..self.clone()
        }
    }
}

/// The full path of the file that the sample `spec` names, if it names one that is there.
pub(super) fn located_sample(spec: &str) -> Option<String> {
    crate::brdf::sample::file_of(spec).and_then(full)
}

fn full(path: &std::path::Path) -> Option<String> {
    path.canonicalize().ok()?.to_str().map(str::to_owned)
}

/// Rates between 0 and 1 at which the virtual rig fails on purpose, drawn from its seed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Faults {
    /// Triggers that the camera ignores.
    pub missed_triggers: f64,
    /// Exposures whose frames are lost on the way.
    pub dropped_frames: f64,
    /// Frames that come twice.
    pub doubled_frames: f64,
}

impl Faults {
    fn are_none(&self) -> bool {
        *self == Self::default()
    }
}
