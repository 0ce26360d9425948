//! What no capture has: from the exchanged pair, from the sides of the wire, from a model where something near was measured.

use std::path::Path;

use glam::DVec3;

use super::model::Modelled;
use super::near::Near;
use super::{FillError, Options, Origin, Way, directions, facts, finish, writer_like};
use crate::base::progress::Progress;
use crate::brdf::Brdf;
use crate::instrument::optics::Unmeasurable;
use crate::judge::fit::Fit;
use crate::store::provenance::Provenance;
use crate::store::{BrdfRows, StoreError, stored_sigma};

/// Cells beyond an occluded one where its neighbours are looked for.
const REACH: usize = 8;
/// Incident directions beyond an occluded one, degrees, where its neighbours are looked for.
const REACH_DEG: f64 = 12.0;
/// Fills what `brdf`, which is of this `origin`, lacks into the file at `path`, as `options` say; the model, if one was needed and
/// found.
pub(super) fn fill(
    brdf: &Brdf,
    origin: &Origin,
    path: &Path,
    options: &Options,
    progress: &dyn Progress,
) -> Result<Option<Fit>, FillError> {
    // Across the wire the model tells how f is bent.
    let (has_wire, has_model) = (options.takes(Way::Wire), options.takes(Way::Model));
    let modelled = if has_wire || has_model {
        Some(Modelled::of(brdf)?)
    } else {
        None
    };
    let near = match modelled.as_ref().filter(|_| has_model) {
        Some(modelled) => Some(Near::of(brdf, &|wi, wo| modelled.f(wi, wo))?),
        None => None,
    };
    let incident = vec![None; brdf.grid().len()];
    let outgoing: Vec<Option<Unmeasurable>> = directions(brdf)
        .iter()
        .map(|above| above.is_none().then_some(Unmeasurable::BelowHorizon))
        .collect();
    let ways = [
        (Way::Reciprocity, "reciprocal"),
        (Way::Wire, "interpolated across the wire"),
        (Way::Model, "modelled as ggx with lambert base"),
    ];
    let taken = ways.iter().filter(|(way, _)| options.takes(*way));
    let taken: Vec<&str> = taken.map(|(_, text)| *text).collect();
    let text = match taken.as_slice() {
        [] => "nothing".to_owned(),
        [one] => (*one).to_owned(),
        several => format!("{}, in this order", several.join(", ")),
    };
    let writer = writer_like(
        brdf,
        brdf.grid(),
        path,
        &incident,
        &outgoing,
        facts(&text, &[], Some(origin)),
    )?;
    progress.begin("fill", brdf.chunks(), "chunks");
    for chunk in 0..brdf.chunks() {
        let mut image = Chunk::read(brdf, chunk)?;
        if options.takes(Way::Reciprocity) {
            image.exchange(brdf)?;
        }
        if let Some(modelled) = modelled.as_ref().filter(|_| has_wire) {
            image.bridge_cells(brdf, modelled);
            image.bridge_rows(brdf, modelled)?;
        }
        if let (Some(modelled), Some(near)) = (&modelled, &near) {
            image.model(brdf, modelled, near);
        }
        writer.write_chunk(chunk, &image.rows)?;
        progress.reach(chunk + 1);
    }
    progress.end();
    finish(writer)?;
    Ok(modelled.and_then(|modelled| modelled.fit))
}

/// The rows of one chunk on their way.
struct Chunk {
    first: usize,
    cells: usize,
    channels: usize,
    rows: BrdfRows,
    /// Directions of the cells, above the horizon.
    directions: Vec<Option<DVec3>>,
}

impl Chunk {
    fn read(brdf: &Brdf, chunk: usize) -> Result<Self, StoreError> {
        let (cells, channels, range) = (brdf.disk().len(), brdf.channels(), brdf.chunk_range(chunk));
        let rows = brdf.chunk(chunk)?;
        let mut rows = rows.unwrap_or_else(|| BrdfRows::missing(range.len() * cells, channels));
        for (place, index) in range.clone().enumerate() {
            if brdf.incident_reason(index).is_some() {
                rows.provenance[place * cells..(place + 1) * cells].fill(Provenance::Missing.code());
            }
        }
        rows.seal();
        Ok(Self {
            first: range.start,
            cells,
            channels,
            rows,
            directions: directions(brdf),
        })
    }

    fn is_missing(&self, sample: usize) -> bool {
        self.rows.provenance[sample] == Provenance::Missing.code()
    }

    /// Missing samples above the horizon with their directions.
    fn missing(&self, brdf: &Brdf) -> Vec<(usize, DVec3, DVec3)> {
        (0..self.rows.provenance.len())
            .filter(|&sample| self.is_missing(sample))
            .filter_map(|sample| {
                let wo = self.directions[sample % self.cells]?;
                Some((
                    sample,
                    brdf.grid().direction(self.first + sample / self.cells),
                    wo,
                ))
            })
            .collect()
    }

    /// Gives a missing sample a value; one that is no number is none.
    fn put(&mut self, sample: usize, f: [f32; 3], sigma: [f32; 3], provenance: Provenance) {
        if !f[..self.channels].iter().all(|f| f.is_finite()) {
            return;
        }
        for channel in 0..self.channels {
            let at = sample * self.channels + channel;
            // Noise about 0 is negative as often as not; to cut it off would make dark samples brighter than they are.
            self.rows.f[at] = f[channel];
            self.rows.sigma[at] = stored_sigma(sigma[channel]);
        }
        self.rows.provenance[sample] = provenance.code();
    }

    fn get(&self, sample: usize) -> ([f32; 3], [f32; 3]) {
        let at = |channel: usize| sample * self.channels + channel.min(self.channels - 1);
        (
            std::array::from_fn(|channel| self.rows.f[at(channel)]),
            std::array::from_fn(|channel| self.rows.sigma[at(channel)].to_f32()),
        )
    }

    /// Helmholtz reciprocity: f(ω_i, ω_o) = f(ω_o, ω_i).
    fn exchange(&mut self, brdf: &Brdf) -> Result<(), StoreError> {
        let missing = self.missing(brdf);
        let pairs: Vec<(DVec3, DVec3)> = missing.iter().map(|&(_, wi, wo)| (wo, wi)).collect();
        for ((sample, wi, wo), found) in missing.iter().zip(brdf.with_sigma(&pairs)?) {
            if let Some([f, sigma]) = found {
                // The exchanged pair lies between the incident directions that were captured.
                let sigma = std::array::from_fn(|channel| {
                    let between = brdf.exchange_error(*wi, *wo, f64::from(f[channel]));
                    sigma[channel].hypot(between as f32)
                });
                self.put(*sample, f, sigma, Provenance::Reciprocal);
            }
        }
        Ok(())
    }

    /// Occluded cells from those on both sides, along the line on which the two are nearest.
    fn bridge_cells(&mut self, brdf: &Brdf, modelled: &Modelled) {
        let size = brdf.disk().size();
        let before = self.rows.provenance.clone();
        for sample in 0..before.len() {
            let cell = sample % self.cells;
            let is_hidden = brdf.outgoing_reason(cell) == Some(Unmeasurable::Occluded);
            if before[sample] != Provenance::Missing.code() || !is_hidden || self.directions[cell].is_none() {
                continue;
            }
            let (x, y, row) = ((cell % size) as i64, (cell / size) as i64, sample - cell);
            let sample_at = |(x, y): (i64, i64)| {
                let inside = (0..size as i64).contains(&x) && (0..size as i64).contains(&y);
                let there = inside.then(|| row + (y * size as i64 + x) as usize)?;
                (before[there] != Provenance::Missing.code()).then_some(there)
            };
            let nearest = |dx: i64, dy: i64| {
                (1..=REACH as i64).find_map(|step| {
                    let (x, y) = (x + dx * step, y + dy * step);
                    let there = sample_at((x, y))?;
                    let far = step as f32 * if dx != 0 && dy != 0 { 2_f32.sqrt() } else { 1.0 };
                    let beyond = (x + dx, y + dy);
                    Some((there, far, beyond))
                })
            };
            let lines = [(1, 0), (0, 1), (1, 1), (1, -1)];
            let sides = lines
                .into_iter()
                .filter_map(|(dx, dy)| Some((nearest(dx, dy)?, nearest(-dx, -dy)?)));
            let best = sides.min_by(|a, b| (a.0.1 + a.1.1).total_cmp(&(b.0.1 + b.1.1)));
            if let Some(((a, da, beyond_a), (b, db, beyond_b))) = best {
                let side = |at: usize, far: f32, beyond: (i64, i64)| {
                    let (f, sigma) = self.get(at);
                    let diagonal = beyond.0 != x && beyond.1 != y;
                    Side {
                        f,
                        sigma,
                        far,
                        beyond: sample_at(beyond).map(|there| self.get(there).0),
                        farther: if diagonal { 2_f32.sqrt() } else { 1.0 },
                    }
                };
                let wi = brdf.grid().direction(self.first + sample / self.cells);
                let seen = [sample, a, b].map(|at| self.directions[at % self.cells]);
                let hump = match seen {
                    [Some(wo), Some(a), Some(b)] => {
                        modelled.hump((wi, wo), [(wi, a), (wi, b)], da / (da + db))
                    }
                    _ => [0.0; 3],
                };
                let (f, sigma) = between(&side(a, da, beyond_a), &side(b, db, beyond_b), hump);
                self.put(sample, f, sigma, Provenance::Interpolated);
            }
        }
    }

    /// Images of occluded incident directions from those on both sides.
    fn bridge_rows(&mut self, brdf: &Brdf, modelled: &Modelled) -> Result<(), StoreError> {
        for place in 0..self.rows.provenance.len() / self.cells {
            let index = self.first + place;
            if brdf.incident_reason(index) != Some(Unmeasurable::Occluded) {
                continue;
            }
            let w = brdf.grid().direction(index);
            let Some([(a, da), (b, db)]) = sides(brdf, w) else {
                continue;
            };
            let row = place * self.cells;
            let missing: Vec<(usize, DVec3)> = (0..self.cells)
                .filter(|&cell| self.is_missing(row + cell))
                .filter_map(|cell| Some((row + cell, self.directions[cell]?)))
                .collect();
            // As far again beyond either side.
            let beyond = |there: DVec3| (2.0 * there - w).normalize();
            let lights = [a, b, beyond(a), beyond(b)];
            let pairs: Vec<(DVec3, DVec3)> = missing
                .iter()
                .flat_map(|&(_, wo)| lights.map(|light| (light, wo)))
                .collect();
            let found = brdf.with_sigma(&pairs)?;
            for ((sample, wo), found) in missing.iter().zip(found.chunks_exact(lights.len())) {
                if let [Some([fa, sa]), Some([fb, sb]), beyond_a, beyond_b] = *found {
                    let side = |f, sigma, far: f64, beyond: Option<[[f32; 3]; 2]>| Side {
                        f,
                        sigma,
                        far: far as f32,
                        beyond: beyond.map(|[f, _]| f),
                        farther: far as f32,
                    };
                    let share = (da / (da + db)) as f32;
                    let hump = modelled.hump((w, *wo), [(a, *wo), (b, *wo)], share);
                    let (f, sigma) = between(&side(fa, sa, da, beyond_a), &side(fb, sb, db, beyond_b), hump);
                    self.put(*sample, f, sigma, Provenance::Interpolated);
                }
            }
        }
        Ok(())
    }

    /// What is left from the model, as far as something near was measured.
    fn model(&mut self, brdf: &Brdf, modelled: &Modelled, near: &Near) {
        for (sample, wi, wo) in self.missing(brdf) {
            let f = modelled.f(wi, wo);
            if let Some(sigma) = near.sigma((wi, wo), f, modelled.least()) {
                self.put(sample, f, sigma, Provenance::Modelled);
            }
        }
    }
}

/// One side of a gap.
struct Side {
    f: [f32; 3],
    sigma: [f32; 3],
    /// Distance from the place in the gap.
    far: f32,
    /// f so much farther away.
    beyond: Option<[f32; 3]>,
    farther: f32,
}

impl Side {
    /// By how much f rises towards the gap, per distance; if nobody knows what is beyond, as it would from nothing.
    fn rise(&self, channel: usize) -> f32 {
        let beyond = self.beyond.map_or(0.0, |beyond| beyond[channel]);
        (self.f[channel] - beyond) / self.farther
    }
}

/// Linear interpolation between both sides of a gap; the uncertainty takes in half of what the two disagree by, and what
/// lies between if f bends there as its slopes on both sides say, or has the `hump` of a model: a lobe may have its peak in the
/// gap, and a narrow one all of it.
fn between(a: &Side, b: &Side, hump: [f32; 3]) -> ([f32; 3], [f32; 3]) {
    let width = a.far + b.far;
    let share = a.far / width;
    let f = std::array::from_fn(|c| a.f[c] + share * (b.f[c] - a.f[c]));
    let sigma = std::array::from_fn(|c| {
        let own = ((1.0 - share) * a.sigma[c]).hypot(share * b.sigma[c]);
        // Slopes are those between the sides and what is beyond them.
        let bend = (a.rise(c) + b.rise(c)) / (width + 0.5 * (a.farther + b.farther));
        own.hypot(0.5 * (a.f[c] - b.f[c]))
            .hypot(bend * a.far * b.far)
            .hypot(hump[c])
    });
    (f, sigma)
}

/// The nearest captured incident directions on both sides of `w` in azimuth, and how far they are.
fn sides(brdf: &Brdf, w: DVec3) -> Option<[(DVec3, f64); 2]> {
    let mut nearest: [Option<(DVec3, f64)>; 2] = [None; 2];
    for index in (0..brdf.grid().len()).filter(|&index| brdf.incident_reason(index).is_none()) {
        let there = brdf.grid().direction(index);
        let far = there.angle_between(w);
        // Positive to the left of w, seen from above.
        let side = usize::from(w.x * there.y - w.y * there.x > 0.0);
        let is_nearer = nearest[side].is_none_or(|(_, least)| far < least);
        if far < REACH_DEG.to_radians() && is_nearer {
            nearest[side] = Some((there, far));
        }
    }
    Some([nearest[0]?, nearest[1]?])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hemisphere::direction::from_degrees;

    /// A Gaussian lobe of this standard width about 0, seen from −3 and 3 on.
    fn across(width: f32) -> (f32, f32) {
        let f = |x: f32| 1.0 + 10.0 * (-0.5 * (x / width).powi(2)).exp();
        let side = || Side {
            f: [f(3.0); 3],
            sigma: [0.001; 3],
            far: 3.0,
            beyond: Some([f(4.0); 3]),
            farther: 1.0,
        };
        let (found, sigma) = between(&side(), &side(), [0.0; 3]);
        ((found[0] - f(0.0)).abs(), sigma[0])
    }

    #[test]
    fn a_lobe_with_its_peak_in_the_gap_is_uncertain_by_its_height() {
        for width in [2.0, 3.0, 5.0, 20.0] {
            let (error, sigma) = across(width);
            assert!(
                error < 3.0 * sigma && sigma < 3.0 * error + 0.01,
                "{width}: {error} ± {sigma}"
            );
        }
        let alone = |beyond| Side {
            f: [1.0; 3],
            sigma: [0.0; 3],
            far: 1.0,
            beyond,
            farther: 1.0,
        };
        let flat = between(&alone(Some([1.0; 3])), &alone(Some([1.0; 3])), [0.0; 3]);
        assert_eq!(flat, ([1.0; 3], [0.0; 3]));
        // What nobody knows of what is beyond is no certainty.
        let (_, sigma) = between(&alone(None), &alone(None), [0.0; 3]);
        assert!(sigma[0] > 0.3, "{sigma:?}");
        // A lobe that is in the gap with all of it is what a model says.
        let modelled = Modelled::of_lobe(0.02);
        let [light, view, left, right] =
            [(40.0, 0.0), (40.0, 180.0), (40.0, 170.0), (40.0, 190.0)].map(|(t, p)| from_degrees(t, p));
        let hump = modelled.hump((light, view), [(light, left), (light, right)], 0.5);
        let (_, sigma) = between(&alone(Some([1.0; 3])), &alone(Some([1.0; 3])), hump);
        let peak = modelled.f(light, view);
        assert!(peak[0] > 10.0 && sigma[0] > 0.9 * peak[0], "{peak:?} {sigma:?}");
    }
}
