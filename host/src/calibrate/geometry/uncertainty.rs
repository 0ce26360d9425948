//! How uncertain directions are.

use glam::DVec3;
use nalgebra::{DMatrix, DVector};

use super::PROBES;
use super::parameters::Parameter;
use super::solve::moved;
use crate::hemisphere::judged::is_judged;
use crate::instrument::optics::View;
use crate::instrument::rig::Rig;

/// How uncertain directions are, apart from a turn of all of them about the sample's normal.
pub(super) struct Uncertainty {
    /// Standard uncertainty of camera and projector, RMS over what of their images is judged, degrees.
    pub(super) devices_deg: [f64; 2],
    /// Standard uncertainty of the turn, degrees.
    pub(super) turn_deg: f64,
    /// What each unknown by itself would make of the directions of both, squared.
    pub(super) shares: Vec<f64>,
}

/// What each of some unknowns makes of the directions `w` of one device, [direction, [unknown]], radians per unit.
type Moves = Vec<(DVec3, Vec<DVec3>)>;

/// Uncertainty of the directions of camera and projector.
///
/// A turn of both about the normal changes nothing but where azimuth 0 lies, which is by definition where the tilts, on average, say: it
/// is no uncertainty of directions and is stated apart.
pub(super) fn uncertainties(
    nominal: &Rig,
    parameters: &[Parameter],
    found: &Rig,
    covariance: &DMatrix<f64>,
) -> Uncertainty {
    // A difference that is small against the uncertainty and large against rounding.
    let step = 1e-4;
    let mut rigs = vec![found.clone()];
    rigs.extend((0..parameters.len()).map(|at| {
        let mut by = DVector::zeros(parameters.len());
        by[at] = step;
        moved(found, parameters, &by)
    }));
    let moves = [View::camera as fn(&Rig) -> View, View::projector].map(|view| -> Moves {
        let (views, reference): (Vec<View>, View) = (rigs.iter().map(view).collect(), view(nominal));
        let size = |px: usize| px as f64 / f64::from(PROBES);
        let (width, height) = reference.size_px();
        let probes = (0..PROBES).flat_map(|row| (0..PROBES).map(move |column| (column, row)));
        let probes = probes.filter_map(|(column, row)| {
            let (u, v) = (
                (f64::from(column) + 0.5) * size(width),
                (f64::from(row) + 0.5) * size(height),
            );
            // Towards the border of the hemisphere nothing holds the lenses, and nothing is judged.
            views[0].direction(u, v).ok().filter(|w| is_judged(*w))?;
            let w = views[0].sight(u, v)?;
            let moved = parameters
                .iter()
                .zip(&views[1..])
                .map(|(parameter, view)| (view.sight(u, v).unwrap_or(w) - w) / (step * parameter.tolerance));
            Some((w, moved.collect()))
        });
        probes.collect()
    });
    let across = |w: DVec3| DVec3::Z.cross(w);
    let of_turn: f64 = moves
        .iter()
        .flatten()
        .map(|(w, _)| across(*w).length_squared())
        .sum();
    let turns = DVector::from_fn(parameters.len(), |at, _| {
        let along = moves.iter().flatten().map(|(w, moved)| moved[at].dot(across(*w)));
        along.sum::<f64>() / of_turn.max(f64::MIN_POSITIVE)
    });
    let mut shares = vec![0.0; parameters.len()];
    let devices_deg = moves.map(|moves| {
        let mut sum = 0.0;
        for (w, moved) in &moves {
            let jacobian = DMatrix::from_fn(3, parameters.len(), |axis, at| {
                (moved[at] - turns[at] * across(*w))[axis]
            });
            sum += (&jacobian * covariance * jacobian.transpose()).trace();
            for (at, share) in shares.iter_mut().enumerate() {
                *share += jacobian.column(at).norm_squared() * covariance[(at, at)];
            }
        }
        (sum / moves.len().max(1) as f64).sqrt().to_degrees()
    });
    Uncertainty {
        devices_deg,
        turn_deg: turns.dot(&(covariance * &turns)).sqrt().to_degrees(),
        shares,
    }
}

/// Names of the unknowns whose uncertainty turns the directions most.
pub(super) fn undetermined(parameters: &[Parameter], shares: &[f64]) -> String {
    let mut order: Vec<usize> = (0..parameters.len()).collect();
    order.sort_by(|a, b| shares[*b].total_cmp(&shares[*a]));
    let names: Vec<&str> = order
        .iter()
        .take(3)
        .map(|at| parameters[*at].name.as_str())
        .collect();
    names.join(", ")
}
