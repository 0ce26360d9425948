//! Laws of interpolation.

use glam::DVec3;

use super::captures::{Captures, Image, ImageOf};
use super::lookup::{look_up, look_up_apart};
use super::region::{REGIONS, around, region};
use super::{BRANCHES, Blend, BranchErrors, Cells, Interpolation, RULES, Table, walk};
use crate::base::eight::{LANES, Vectors};
use crate::brdf::reflectance::Reflectance as _;
use crate::brdf::sample::{Sample, parse};
use crate::hemisphere::direction::from_degrees;
use crate::hemisphere::disk::Disk;
use crate::hemisphere::incident::{Grid, IncidentSet};

fn grid(step_deg: f64) -> IncidentSet {
    Grid::EqualSolidAngle { step_deg }.build().unwrap()
}

/// Pairs between captures, θ ≤ 75°.
fn between() -> Vec<(DVec3, DVec3)> {
    (0..4000)
        .map(|k| {
            let k = f64::from(k);
            let wi = from_degrees((k * 7.31) % 75.0, k * 31.7);
            (wi, from_degrees((k * 5.17) % 75.0, k * 77.3))
        })
        .collect()
}

/// Pairs within a few degrees of mirror reflection.
fn highlights() -> Vec<(DVec3, DVec3)> {
    (0..2000)
        .map(|k| {
            let k = f64::from(k);
            let (theta, phi) = ((k * 7.31) % 70.0, k * 31.7);
            let off = (k * 0.77) % 6.0 - 3.0;
            (
                from_degrees(theta, phi),
                from_degrees((theta + off).abs(), phi + 180.0 + off),
            )
        })
        .collect()
}

/// Root mean square of f·cosθi − truth, both clipped to `white`.
fn rms(table: &Table, sample: &dyn Sample, pairs: &[(DVec3, DVec3)], white: f64) -> f64 {
    let values = table.values(pairs).unwrap();
    let squares: f64 = pairs
        .iter()
        .zip(values)
        .map(|(&(wi, wo), value)| {
            let shown = |f: f64| (f * wi.z).clamp(0.0, white);
            (shown(f64::from(value.unwrap()[1])) - shown(sample.f(wi, wo)[1])).powi(2)
        })
        .sum();
    (squares / pairs.len() as f64).sqrt()
}

#[test]
fn a_captured_sample_is_itself_by_every_rule() {
    let satin = parse("satin").unwrap();
    let (set, disk) = (grid(15.0), Disk::new(48));
    let mut table = Table::of(satin.as_ref(), set.clone(), disk);
    let pairs: Vec<_> = (0..disk.len())
        .filter_map(|cell| disk.direction(cell))
        .zip((0..set.len()).cycle())
        .map(|(wo, row)| (set.direction(row), wo))
        .collect();
    for rule in 0..RULES.len() {
        table.blend = Blend::One(rule);
        for (&(wi, wo), value) in pairs.iter().zip(table.values(&pairs).unwrap()) {
            let (found, expected) = (f64::from(value.unwrap()[0]), satin.f(wi, wo)[0]);
            assert!(
                (found / expected - 1.0).abs() < 1e-3,
                "rule {rule}, {wi} {wo}: {found} {expected}"
            );
        }
    }
}

#[test]
fn places_in_single_precision_are_where_they_are_in_double() {
    let brass = parse("ward:brass").unwrap();
    let table = Table::of(brass.as_ref(), grid(9.0), Disk::new(96)).with(Interpolation::Blended);
    let pairs: Vec<_> = between().into_iter().chain(highlights()).collect();
    for (lookup, pair) in look_up_apart(&table, &table.blend, &pairs)
        .unwrap()
        .iter()
        .zip(&pairs)
    {
        let (found, expected) = (lookup.value().unwrap()[1], lookup.mean_of_readings().unwrap()[1]);
        assert!(
            (found / expected - 1.0).abs() < 1e-4,
            "{pair:?}: {found} {expected}"
        );
    }
}

#[test]
fn beside_what_is_missing_too_places_are_where_they_are_in_double_precision() {
    let silk = parse("satin").unwrap();
    for (is_list, size) in [(false, 48), (true, 37)] {
        let set = if is_list {
            let rings = grid(15.0);
            let directions_deg = (0..rings.len()).map(|row| rings.angles_deg(row).into()).collect();
            Grid::List { directions_deg }.build().unwrap()
        } else {
            grid(15.0)
        };
        let disk = Disk::new(size).turned(17.0);
        let mut table = Table::of(silk.as_ref(), set, disk).with(Interpolation::Blended);
        // A hole, and cells here and there that saturated in one image.
        table.cells = Cells::new(disk, |cell| {
            (cell % size).abs_diff(size / 2) + (cell / size).abs_diff(size / 3) > 5
        });
        for at in (0..table.f.len() / 3).filter(|at| (at.wrapping_mul(2_654_435_761) >> 7) % 16 == 0) {
            table.f[3 * at..][..3].fill(f32::NAN);
        }
        let horizon = between().into_iter().map(|(wi, wo)| {
            let low = (wo.truncate().normalize_or(glam::DVec2::X) * 0.9998)
                .extend(0.02)
                .normalize();
            (wi, low)
        });
        let pairs: Vec<_> = between().into_iter().chain(highlights()).chain(horizon).collect();
        let found = look_up_apart(&table, &table.blend, &pairs).unwrap();
        let with_value: Vec<_> = found
            .iter()
            .zip(&pairs)
            .filter_map(|(found, pair)| Some((found.value()?, found, pair)))
            .collect();
        assert!((5_000..9_900).contains(&with_value.len()), "{}", with_value.len());
        for (f, found, pair) in with_value {
            let expected = found.mean_of_readings().unwrap();
            assert!(
                (f[0] / expected[0] - 1.0).abs() < 1e-3,
                "{pair:?}: {f:?} {expected:?}"
            );
        }
    }
}

/// A table whose images come some at a time, and some of which are not there.
struct Piecemeal<'a> {
    table: &'a Table,
    at_once: usize,
}

impl Captures for Piecemeal<'_> {
    fn set(&self) -> &IncidentSet {
        self.table.set()
    }

    fn cells(&self) -> &Cells {
        &self.table.cells
    }

    fn is_captured(&self, row: usize) -> bool {
        row % 13 != 5
    }

    fn scan(
        &self,
        wanted: &[bool],
        each: &mut dyn FnMut(std::ops::Range<usize>, ImageOf<'_>),
    ) -> Result<(), crate::store::StoreError> {
        let length = 3 * self.table.cells.disk.len();
        for first in (0..wanted.len()).step_by(self.at_once) {
            let group = first..(first + self.at_once).min(wanted.len());
            let image = |row: usize| {
                // Nobody may read what was not asked for: memory holds no more.
                (self.is_captured(row) && wanted[row] && (first..first + self.at_once).contains(&row)).then(
                    || Image {
                        f: &self.table.f[row * length..][..length],
                        provenance: None,
                        channels: 3,
                    },
                )
            };
            if wanted[group.clone()].iter().any(|wanted| *wanted) {
                each(group, &image);
            }
        }
        Ok(())
    }
}

#[test]
fn a_walk_has_the_values_of_single_queries_to_the_bit_however_images_come() {
    let satin = parse("satin").unwrap();
    let rings = grid(9.0);
    let directions_deg = (0..rings.len()).map(|row| rings.angles_deg(row).into()).collect();
    let list = Grid::List { directions_deg }.build().unwrap();
    let fine = Grid::ThetaPhi { step_deg: 5.0 }.build().unwrap();
    let is_above = |pair: &&(DVec3, DVec3)| pair.0.z.min(pair.1.z) > 1e-3;
    // The last of these are nowhere above the horizon.
    let below = (0..40).map(|k| {
        (
            from_degrees(91.0, f64::from(k)),
            from_degrees(f64::from(2 * k), 3.0),
        )
    });
    let pairs: Vec<_> = between().into_iter().chain(highlights()).chain(below).collect();
    for (set, at_once) in [(rings, 1), (list, 29), (fine, 500)] {
        let mut table = Table::of(satin.as_ref(), set, Disk::new(24)).with(Interpolation::Blended);
        for at in (0..table.f.len() / 3).filter(|at| (at.wrapping_mul(2_654_435_761) >> 7) % 64 == 0) {
            table.f[3 * at..][..3].fill(f32::NAN);
        }
        for blend in [Blend::One(0), table.blend.clone()] {
            let captures = Piecemeal {
                table: &table,
                at_once,
            };
            let found = walk(&captures, &blend, &pairs, |pair, value| (pair, value)).unwrap();
            assert!(found.iter().map(|found| found.0).eq(pairs.iter().copied()));
            let asked: Vec<_> = pairs.iter().filter(is_above).copied().collect();
            let mut single = look_up(&captures, &blend, &asked).unwrap().into_iter();
            let mut values = 0;
            for (pair, value) in found {
                let expected = is_above(&&pair).then(|| single.next().unwrap());
                let saturated = expected.as_ref().map_or(0.0, super::Lookup::saturated);
                match expected.and_then(|one| one.value()) {
                    Some(f) => assert_eq!(value.unwrap().map(f32::to_bits), f.map(f32::to_bits)),
                    None => assert_eq!(value.unwrap_err().to_bits(), saturated.to_bits()),
                }
                values += usize::from(value.is_ok());
            }
            assert!((4_000..6_000).contains(&values), "{values}");
        }
    }
}

#[test]
fn eight_pairs_at_once_have_the_shares_of_one() {
    let brass = parse("ward:brass").unwrap();
    let errors = Table::of(brass.as_ref(), grid(15.0), Disk::new(32))
        .learn()
        .unwrap();
    let blend = Blend::new(Interpolation::Blended, Some(&errors));
    let pairs: Vec<_> = between().into_iter().chain(highlights()).collect();
    for pairs in pairs.as_chunks::<LANES>().0 {
        let of =
            |at: fn(&(DVec3, DVec3)) -> DVec3| Vectors::of(&std::array::from_fn(|lane| at(&pairs[lane])));
        let shares = blend.shares(&of(|pair| pair.0), &of(|pair| pair.1));
        for (found, &(wi, wo)) in shares.iter().zip(pairs) {
            let expected = blend.shares_of_one(wi, wo);
            for (found, expected) in found.iter().zip(expected) {
                // One that is hardly worth it may be left out by rounding.
                assert!(
                    (found - expected).abs() < 3e-4 || (found + expected < 0.0302),
                    "{wi} {wo}: {found} {expected}"
                );
            }
        }
    }
}

#[test]
fn a_white_standard_is_white_between_captures_too() {
    let white = parse("lambert:1").unwrap();
    let table = Table::of(white.as_ref(), grid(15.0), Disk::new(32));
    let up_to_the_horizon = (0..500).map(|k| {
        let k = f64::from(k);
        (
            from_degrees((k * 7.3) % 90.0, k),
            from_degrees((k * 1.7) % 90.0, 3.0 * k),
        )
    });
    let mut pairs = between();
    pairs.extend(up_to_the_horizon);
    // Only the rules that keep f, not f times cosines, are exact for it: the blend must find that out.
    let mut table = table;
    for interpolation in Interpolation::ALL {
        table = table.with(interpolation);
        for (value, pair) in table.values(&pairs).unwrap().into_iter().zip(&pairs) {
            let f = f64::from(value.unwrap()[0]) * std::f64::consts::PI;
            assert!((f - 1.0).abs() < 1e-4, "{interpolation:?} {pair:?}: {f}");
        }
    }
}

#[test]
fn a_highlight_moves_instead_of_fading() {
    // Captures 15° apart of a lobe 3° wide (standard deviation of the half vector's slope 0.05).
    let brass = parse("ward:brass").unwrap();
    let mut table = Table::of(brass.as_ref(), grid(15.0), Disk::new(96));
    let mut error = |interpolation| {
        let mut taken = std::mem::replace(&mut table, Table::of(brass.as_ref(), grid(45.0), Disk::new(8)));
        taken = taken.with(interpolation);
        let error = rms(&taken, brass.as_ref(), &highlights(), 10.0);
        table = taken;
        error
    };
    let [direct, half, blended] = Interpolation::ALL.map(&mut error);
    assert!(half < direct / 20.0, "{direct} {half}");
    assert!(blended < half * 1.1, "{half} {blended}");
}

#[test]
fn the_blend_is_about_as_good_as_the_best_rule_or_better() {
    for spec in [
        "lambert:0.5",
        "velvet",
        "satin",
        "ward:brass",
        "ggx:satin",
        "ggx:plastic",
    ] {
        let sample = parse(spec).unwrap();
        for step_deg in [15.0, 9.0] {
            let mut errors = Interpolation::ALL.map(|interpolation| {
                let table = Table::of(sample.as_ref(), grid(step_deg), Disk::new(64)).with(interpolation);
                rms(&table, sample.as_ref(), &between(), 1.0)
            });
            let blended = errors[2];
            errors[..2].sort_by(f64::total_cmp);
            assert!(
                blended <= errors[0] * 1.15 + 1e-4,
                "{spec} {step_deg}°: {blended}, the better rule {}",
                errors[0]
            );
        }
    }
}

#[test]
fn reading_back_helps_where_the_outgoing_direction_was_captured_as_an_incident_one() {
    // wo is a captured incident direction and wi lies in the middle between captures.
    let velvet = parse("velvet").unwrap();
    let set = grid(15.0);
    let pairs: Vec<_> = (0..set.len())
        .flat_map(|row| (0..6).map(move |k| (row, k)))
        .map(|(row, k)| (from_degrees(15.0 * f64::from(k) + 0.01, 11.0), set.direction(row)))
        .collect();
    let table = Table::of(velvet.as_ref(), set, Disk::new(96));
    let with_errors = |blend| {
        let mut table = Table::of(velvet.as_ref(), grid(15.0), Disk::new(96));
        table.blend = blend;
        rms(&table, velvet.as_ref(), &pairs, 1.0)
    };
    let errors = table.learn().unwrap();
    let blended = with_errors(Blend::new(Interpolation::Blended, Some(&errors)));
    // The same without the branches that read back: as if they were hopeless.
    let half = BRANCHES / 2;
    let forth_only = errors
        .as_slice()
        .chunks_exact(BRANCHES)
        .flat_map(|row| (0..BRANCHES).map(|branch| if branch < half { row[branch] } else { 1e3 }))
        .collect();
    let forth = with_errors(Blend::new(
        Interpolation::Blended,
        BranchErrors::from_values(forth_only).as_ref(),
    ));
    assert!(blended < 0.8 * forth, "{blended} {forth}");
}

#[test]
fn regions_around_a_pair_are_near_and_their_weights_sum_to_one() {
    for (wi, wo) in between().into_iter().chain(highlights()) {
        let regions = around(wi, wo);
        let sum: f32 = regions.iter().map(|region| region.1).sum();
        assert!((sum - 1.0).abs() < 1e-5);
        assert!(
            regions
                .iter()
                .all(|&(at, weight)| at < REGIONS && weight >= -1e-6)
        );
        let own = regions.iter().filter(|at| at.0 == region(wi, wo)).map(|at| at.1);
        assert!(own.sum::<f32>() > 0.12, "{wi} {wo}");
    }
}

#[test]
fn errors_survive_a_file_and_nonsense_is_refused() {
    let brass = parse("ward:brass").unwrap();
    let errors = Table::of(brass.as_ref(), grid(15.0), Disk::new(32))
        .learn()
        .unwrap();
    let again = BranchErrors::from_values(errors.as_slice().to_vec()).unwrap();
    assert_eq!(again, errors);
    assert!(BranchErrors::from_values(vec![1.0; 7]).is_none());
    assert!(BranchErrors::from_values(vec![0.0; REGIONS * BRANCHES]).is_none());
    assert!(BranchErrors::from_values(vec![f64::NAN; REGIONS * BRANCHES]).is_none());
}
