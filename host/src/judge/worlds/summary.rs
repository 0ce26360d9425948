//! What many worlds come to.

use std::collections::{BTreeMap, BTreeSet};

use serde::Serialize;

use super::{FLAWS, Origins, Outcome, World};
use crate::base::median::median;

/// The worlds of one preset.
#[derive(Clone, Debug, Default, Serialize)]
pub struct OfPreset {
    /// Its name; `all` of all.
    pub preset: String,
    /// Worlds.
    pub worlds: usize,
    /// Of them right.
    pub right: usize,
    /// Of them refused.
    pub refused: usize,
    /// Of them silent.
    pub silent: usize,
    /// Of them broken.
    pub broken: usize,
    /// Samples of all captures that were judged.
    pub measured: Origins,
    /// Share of them within 2 σ; `None` if there are none.
    pub coverage: Option<f64>,
    /// What was filled in, by the names of the provenances.
    pub filled_in: BTreeMap<String, Origins>,
    /// Median over the captures of their median relative errors.
    pub median_error: Option<f64>,
    /// Median over the captures of their median σ/f.
    pub median_sigma: Option<f64>,
    /// Median over the captures of the share that is scored.
    pub scored_share: Option<f64>,
}

/// Why worlds were refused.
#[derive(Clone, Debug, Serialize)]
pub struct Cause {
    /// The words of the command.
    pub command: String,
    /// Its sentence, numbers left out.
    pub sentence: String,
    /// Worlds.
    pub worlds: usize,
}

/// The values of a flaw that were drawn.
#[derive(Clone, Debug, Serialize)]
pub struct Drawn {
    /// The option.
    pub option: String,
    /// How those worlds ended; `all` of all.
    pub ended: String,
    /// Least, median and most, in the option's unit.
    pub quantiles: [f64; 3],
}

/// What many worlds come to.
#[derive(Clone, Debug, Serialize)]
pub struct Summary {
    /// By preset, and all together last.
    pub presets: Vec<OfPreset>,
    /// Causes of refusals, the most frequent first.
    pub causes: Vec<Cause>,
    /// The flaws that were drawn.
    pub flaws: Vec<Drawn>,
    /// The builds that were judged.
    pub versions: Vec<String>,
}

impl Summary {
    /// Of `worlds`.
    #[must_use]
    pub fn of(worlds: &[World]) -> Self {
        let names: BTreeSet<&str> = worlds.iter().map(|world| world.rig.preset.as_str()).collect();
        let part = |name: &str| {
            let of: Vec<&World> = worlds.iter().filter(|world| world.rig.preset == name).collect();
            of_preset(name, &of)
        };
        let mut presets: Vec<OfPreset> = names.into_iter().map(part).collect();
        presets.push(of_preset("all", &worlds.iter().collect::<Vec<_>>()));
        let versions: BTreeSet<String> = worlds.iter().map(|world| world.version.clone()).collect();
        Self {
            presets,
            causes: causes(worlds),
            flaws: flaws(worlds),
            versions: versions.into_iter().collect(),
        }
    }

    /// Worlds in which the program is at fault.
    #[must_use]
    pub fn faults(&self) -> usize {
        self.presets.last().map_or(0, |all| all.silent + all.broken)
    }
}

fn of_preset(name: &str, worlds: &[&World]) -> OfPreset {
    let ended = |name: &str| worlds.iter().filter(|world| world.outcome.name() == name).count();
    let captures = || worlds.iter().flat_map(|world| world.captures());
    let middle =
        |figure: fn(&super::Judgement) -> Option<f64>| median(captures().filter_map(figure).collect());
    let measured = captures().fold(Origins::default(), |sum, one| sum.and(&one.measured));
    let made = worlds.iter().flat_map(|world| &world.files);
    let mut filled_in: BTreeMap<String, Origins> = BTreeMap::new();
    for (name, origins) in made.flat_map(|file| &file.judgement.filled_in) {
        let sum = filled_in.entry(name.clone()).or_default();
        *sum = sum.and(origins);
    }
    OfPreset {
        preset: name.to_owned(),
        worlds: worlds.len(),
        right: ended("right"),
        refused: ended("refused"),
        silent: ended("silent"),
        broken: ended("broken"),
        measured,
        coverage: measured.coverage(),
        filled_in,
        median_error: middle(|one| one.median_error),
        median_sigma: middle(|one| one.median_sigma),
        scored_share: middle(|one| one.scored_share),
    }
}

/// `sentence` without its numbers, so that those of the same cause are alike.
fn without_numbers(sentence: &str) -> String {
    let mut plain = String::new();
    for word in sentence.split_whitespace() {
        if !plain.is_empty() {
            plain.push(' ');
        }
        let mut is_in_number = false;
        for letter in word.chars() {
            let is_number = letter.is_ascii_digit() || is_in_number && letter == '.';
            if is_number && !is_in_number {
                plain.push('#');
            } else if !is_number {
                plain.push(letter);
            }
            is_in_number = is_number;
        }
    }
    plain
}

fn causes(worlds: &[World]) -> Vec<Cause> {
    let mut counts: BTreeMap<(String, String), usize> = BTreeMap::new();
    for world in worlds {
        if let Outcome::Refused { command, sentence } = &world.outcome {
            *counts
                .entry((command.clone(), without_numbers(sentence)))
                .or_default() += 1;
        }
    }
    let cause = |((command, sentence), worlds)| Cause {
        command,
        sentence,
        worlds,
    };
    let mut causes: Vec<Cause> = counts.into_iter().map(cause).collect();
    causes.sort_by_key(|cause| std::cmp::Reverse(cause.worlds));
    causes
}

fn flaws(worlds: &[World]) -> Vec<Drawn> {
    let mut found = Vec::new();
    for flaw in FLAWS {
        for ended in ["all", "right", "refused", "silent", "broken"] {
            let of = worlds
                .iter()
                .filter(|world| ended == "all" || world.outcome.name() == ended);
            let values = of.flat_map(|world| &world.rig.flaws);
            let mut values: Vec<f64> = values
                .filter(|(option, _)| option == flaw.option)
                .filter_map(|(_, value)| value.parse().ok())
                .collect();
            values.sort_unstable_by(f64::total_cmp);
            if let (Some(least), Some(most)) = (values.first(), values.last()) {
                found.push(Drawn {
                    option: flaw.option.to_owned(),
                    ended: ended.to_owned(),
                    quantiles: [*least, values[values.len() / 2], *most],
                });
            }
        }
    }
    found
}
