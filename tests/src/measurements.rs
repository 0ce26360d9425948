//! Measurements on virtual rigs, held against what is there.

use rcg::brdf::Brdf;
use rcg::brdf::sample::Sample;
use rcg::instrument::rig::Rig;
use rcg::store::provenance::Provenance;

/// A rig of `preset` with a coarse projector, which makes runs quick.
#[must_use]
pub fn coarse(preset: &str) -> Rig {
    let mut rig = Rig::load(preset).expect("a preset");
    let lens = &mut rig.projector.lens;
    (lens.width_px, lens.height_px) = (512, 384);
    lens.focal_px *= 0.5;
    lens.centre_px = lens.centre_px.map(|px| 0.5 * px);
    rig
}

/// How far a value is from the truth.
#[derive(Clone, Copy, Debug)]
pub struct Scored {
    /// Index of the incident direction.
    pub row: usize,
    /// Index of the outgoing one.
    pub cell: usize,
    /// Value less truth, in standard uncertainties of the value.
    pub score: f64,
}

/// All that `brdf` has a value for, in its first channel or the mean of all, against `sample`.
#[must_use]
pub fn scored(brdf: &Brdf, sample: &dyn Sample) -> Vec<Scored> {
    let mut all = Vec::new();
    let cells = brdf.disk().len();
    for chunk in 0..brdf.chunks() {
        let first = brdf.chunk_range(chunk).start;
        let Some(rows) = brdf.chunk(chunk).expect("a chunk can be read") else {
            continue;
        };
        let channels = brdf.channels();
        for (at, code) in rows.provenance.iter().enumerate() {
            if *code == Provenance::Missing.code() {
                continue;
            }
            let (row, cell) = (first + at / cells, at % cells);
            let wo = brdf
                .disk()
                .direction(cell)
                .expect("what has a value is above the horizon");
            let f = sample.f(brdf.grid().direction(row), wo);
            let truth = if channels == 1 {
                f.iter().sum::<f64>() / 3.0
            } else {
                f[0]
            };
            let score = (f64::from(rows.f[channels * at]) - truth) / rows.sigma[channels * at].to_f64();
            all.push(Scored { row, cell, score });
        }
    }
    all
}
