//! Where to capture next, and how good the result is predicted to be.

use glam::DVec3;

use super::predict::LeftOut;
use crate::hemisphere::direction::{angle_between, is_above_horizon};
use crate::hemisphere::incident::DirectionList;
use crate::hemisphere::judged::is_judged;

/// Candidates of a batch keep this share of their distances to captured directions from each other.
const APART: f64 = 0.9;

/// What is known about the directions between the captured ones.
pub(super) struct Outlook {
    /// Predicted mean squared error by interpolation, and that by noise; `None` if no captured image says anything of it.
    pub(super) predicted: Option<Predicted>,
    /// Where to capture next, the most useful first.
    pub(super) next: Vec<DVec3>,
}

/// Predicted mean squared errors over all directions in reach.
#[derive(Clone, Copy, Debug)]
pub(super) struct Predicted {
    /// By interpolation.
    pub(super) mse: f64,
    /// By noise.
    pub(super) noise_mse: f64,
}

/// A direction that could be captured.
#[derive(Clone, Copy)]
struct Candidate {
    w: DVec3,
    /// Predicted error × solid angle.
    gain: f64,
    /// Distance to the nearest captured direction, in rad.
    distance_rad: f64,
}

/// The outlook of `list`; `left_out` is empty as long as nothing was captured, and then only distances count. Where no
/// corner of a triangle says anything (all saturated, say), more captures would not either.
/// `reachable` says whether a direction can be captured; none is proposed nearer than `spot_rad` to a captured one.
pub(super) fn outlook(
    list: &DirectionList,
    left_out: &[Option<LeftOut>],
    reachable: &dyn Fn(DVec3) -> bool,
    spot_rad: f64,
    count: usize,
) -> Outlook {
    let (mut mse, mut noise, mut area) = (0.0, 0.0, 0.0);
    let mut candidates = Vec::new();
    for triangle in list.triangles() {
        let corners = triangle.map(|index| list.direction(index));
        let [a, b, c] = corners;
        let middle = (a + b + c).normalize();
        let circumcentre = list.circumcentre(triangle);
        let Some(w) = [circumcentre, middle]
            .into_iter()
            .find(|w| is_above_horizon(*w) && reachable(*w))
        else {
            continue;
        };
        let solid_angle_sr = (b - a).cross(c - a).length() / 2.0;
        // Mean over the triangle of the mean squared distance to its corners, weighted as in interpolation.
        let spacing = ((b - a).length_squared() + (c - b).length_squared() + (a - c).length_squared()) / 12.0;
        let known: Vec<LeftOut> = if left_out.is_empty() {
            Vec::new()
        } else {
            triangle.iter().filter_map(|&index| left_out[index]).collect()
        };
        let mean = |of: &dyn Fn(&LeftOut) -> f64| known.iter().map(of).sum::<f64>() / known.len() as f64;
        let error = if left_out.is_empty() {
            spacing
        } else if known.is_empty() {
            continue;
        } else {
            mean(&|at| at.mse * spacing / at.spacing)
        };
        if reachable(middle) && is_judged(middle) && !known.is_empty() {
            mse += solid_angle_sr * error;
            area += solid_angle_sr;
            noise += solid_angle_sr * mean(&|at| at.noise_mse);
        }
        let distance_rad = corners
            .map(|corner| angle_between(corner, w))
            .into_iter()
            .fold(f64::MAX, f64::min);
        if distance_rad > spot_rad {
            candidates.push(Candidate {
                w,
                gain: error * solid_angle_sr,
                distance_rad,
            });
        }
    }
    candidates.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    let mut chosen: Vec<Candidate> = Vec::new();
    // Where those that are well apart make no batch, those that do not overlap fill it.
    for share in [APART, 0.0] {
        for candidate in &candidates {
            let apart = |other: &Candidate| {
                let least = share * other.distance_rad.min(candidate.distance_rad);
                angle_between(other.w, candidate.w) > least.max(spot_rad)
            };
            if chosen.len() < count && chosen.iter().all(apart) {
                chosen.push(*candidate);
            }
        }
    }
    Outlook {
        predicted: (area > 0.0).then(|| Predicted {
            mse: mse / area,
            noise_mse: noise / area,
        }),
        next: chosen.into_iter().map(|candidate| candidate.w).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hemisphere::direction::{from_degrees, to_angles};
    use crate::hemisphere::incident::Rings;

    fn rings(step_deg: f64) -> DirectionList {
        let rings = Rings::equal_solid_angle(step_deg).unwrap();
        let angles: Vec<[f64; 2]> = (0..rings.len())
            .map(|index| rings.angles_deg(index).into())
            .collect();
        DirectionList::new(&angles).unwrap()
    }

    #[test]
    fn what_is_chosen_is_where_the_error_is_and_apart() {
        let list = rings(15.0);
        let bad = from_degrees(50.0, 120.0);
        let left_out: Vec<Option<LeftOut>> = (0..list.len())
            .map(|index| {
                Some(LeftOut {
                    mse: if angle_between(list.direction(index), bad) < 0.35 {
                        1.0
                    } else {
                        1e-4
                    },
                    noise_mse: 0.0,
                    spacing: 0.05,
                })
            })
            .collect();
        let found = outlook(&list, &left_out, &|_| true, 0.01, 4).next;
        assert_eq!(found.len(), 4);
        for (place, w) in found.iter().enumerate() {
            assert!(angle_between(*w, bad) < 0.6, "{:?}", to_angles(*w));
            for other in &found[..place] {
                assert!(angle_between(*w, *other) > 0.08);
            }
        }
    }

    #[test]
    fn the_predicted_error_falls_with_the_spacing() {
        let mse = |step_deg| {
            let list = rings(step_deg);
            let left_out = vec![
                Some(LeftOut {
                    mse: 1e-3,
                    noise_mse: 1e-5,
                    spacing: 0.1
                });
                list.len()
            ];
            let found = outlook(&list, &left_out, &|_| true, 0.01, 1).predicted.unwrap();
            assert!((found.noise_mse - 1e-5).abs() < 1e-12);
            found.mse
        };
        assert!(
            (2.5..6.0).contains(&(mse(18.0) / mse(9.0))),
            "{} {}",
            mse(18.0),
            mse(9.0)
        );
    }

    #[test]
    fn images_that_say_nothing_predict_no_error_and_ask_for_no_more() {
        let list = rings(15.0);
        let silent = outlook(&list, &vec![None; list.len()], &|_| true, 0.01, 4);
        assert!(silent.predicted.is_none() && silent.next.is_empty());
        // Nor do they pass for perfect ones beside others.
        let half: Vec<Option<LeftOut>> = (0..list.len())
            .map(|index| {
                (list.direction(index).x > 0.0).then_some(LeftOut {
                    mse: 1e-3,
                    noise_mse: 1e-5,
                    spacing: 0.1,
                })
            })
            .collect();
        let found = outlook(&list, &half, &|_| true, 0.01, 4).predicted.unwrap();
        assert!((found.noise_mse - 1e-5).abs() < 1e-12, "{found:?}");
    }

    #[test]
    fn nothing_is_chosen_out_of_reach_or_within_a_spot() {
        let list = rings(15.0);
        let reachable = |w: DVec3| to_angles(w).0.to_degrees() > 45.0;
        let found = outlook(&list, &[], &reachable, 0.01, 1000).next;
        assert!(!found.is_empty() && found.iter().all(|w| reachable(*w)));
        assert!(outlook(&list, &[], &|_| true, 0.5, 1000).next.is_empty());
    }
}
