//! Where to capture next, and how good the result is predicted to be.

use glam::DVec3;

use super::predict::LeftOut;
use crate::direction::angle_between;
use crate::evaluate::is_judged;
use crate::incident::DirectionList;

/// Candidates of a batch keep this share of their distances to captured directions from each other.
const APART: f64 = 0.9;

/// What is known about the directions between the captured ones.
pub(super) struct Outlook {
    /// Predicted mean squared error by interpolation; `None` if nothing can be compared.
    pub(super) mse: Option<f64>,
    /// Mean squared error by noise; `None` if nothing has a value.
    pub(super) noise_mse: Option<f64>,
    /// Where to capture next, the most useful first.
    pub(super) next: Vec<DVec3>,
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

/// The outlook of `list`; `left_out` is empty as long as nothing was captured, and then only distances count.
/// `reachable` says whether a direction can be captured; none is proposed nearer than `spot_rad` to a captured one.
pub(super) fn outlook(
    list: &DirectionList,
    left_out: &[LeftOut],
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
            .find(|w| w.z > 0.0 && reachable(*w))
        else {
            continue;
        };
        let solid_angle_sr = (b - a).cross(c - a).length() / 2.0;
        // Mean over the triangle of the mean squared distance to its corners, weighted as in interpolation.
        let spacing = ((b - a).length_squared() + (c - b).length_squared() + (a - c).length_squared()) / 12.0;
        // Of the corners that have it.
        let mean = |of: &dyn Fn(&LeftOut) -> Option<f64>| {
            let known: Vec<f64> = triangle
                .iter()
                .filter_map(|&index| of(left_out.get(index)?))
                .filter(|value| value.is_finite())
                .collect();
            (!known.is_empty()).then(|| known.iter().sum::<f64>() / known.len() as f64)
        };
        let error = mean(&|at| Some(at.mse? * spacing / at.spacing));
        if let Some((error, by_noise)) = error.zip(mean(&|at| at.noise_mse))
            && reachable(middle)
            && is_judged(middle)
        {
            mse += solid_angle_sr * error;
            noise += solid_angle_sr * by_noise;
            area += solid_angle_sr;
        }
        // Where nothing is known of the error only the distance counts.
        let error = error.unwrap_or(spacing);
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
    let mean = |sum: f64| (area > 0.0).then(|| sum / area);
    Outlook {
        mse: mean(mse),
        noise_mse: mean(noise),
        next: chosen.into_iter().map(|candidate| candidate.w).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::direction::{from_degrees, to_angles};
    use crate::incident::Rings;

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
        let left_out: Vec<LeftOut> = (0..list.len())
            .map(|index| LeftOut {
                mse: Some(if angle_between(list.direction(index), bad) < 0.35 {
                    1.0
                } else {
                    1e-4
                }),
                noise_mse: Some(0.0),
                spacing: 0.05,
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
                LeftOut {
                    mse: Some(1e-3),
                    noise_mse: Some(1e-5),
                    spacing: 0.1
                };
                list.len()
            ];
            let outlook = outlook(&list, &left_out, &|_| true, 0.01, 1);
            assert!((outlook.noise_mse.unwrap() - 1e-5).abs() < 1e-12);
            outlook.mse.unwrap()
        };
        assert!(
            (2.5..6.0).contains(&(mse(18.0) / mse(9.0))),
            "{} {}",
            mse(18.0),
            mse(9.0)
        );
    }

    #[test]
    fn nothing_to_compare_predicts_nothing() {
        let list = rings(15.0);
        let with = |known: usize| {
            let left_out: Vec<LeftOut> = (0..list.len())
                .map(|index| LeftOut {
                    mse: (index < known).then_some(1e-3),
                    noise_mse: (index < known).then_some(1e-5),
                    spacing: if index < known { 0.1 } else { 0.0 },
                })
                .collect();
            let found = outlook(&list, &left_out, &|_| true, 0.01, 4);
            assert_eq!(found.next.len(), 4);
            (found.mse, found.noise_mse)
        };
        assert_eq!(with(0), (None, None));
        let (some, all) = (with(list.len() / 2), with(list.len()));
        assert!(
            some.0.unwrap() > 0.0 && some.0.unwrap().is_finite(),
            "{some:?} {all:?}"
        );
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
