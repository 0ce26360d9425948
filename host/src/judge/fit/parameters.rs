//! Unknowns of a fit as what users know them by.

use nalgebra::{DMatrix, DVector};

use super::CLEAR;
use super::model::Model;
use super::shape::{SHAPE, Shape};

/// Relative standard uncertainty of every parameter by what is left of blur and rounding: in noise-free measurements of brass
/// and other lobes on the virtual rigs ρd and strength come back within 0.25 %, and azimuths as if half as much were left.
const LEFT: f64 = 2e-3;
/// Name of the parameter that says where the lobe's axes lie.
pub const AZIMUTH: &str = "azimuth_deg";

/// One parameter of a fit.
#[derive(Clone, Debug, serde::Serialize)]
pub struct Parameter {
    /// `ax`, `ay` (roughness along the lobe's axes), `azimuth_deg` (of the axis of `ax`, from the frame's +x towards its +y, −45° to 45°),
    /// `rd` (diffuse reflectance), `rs` (Ward) or `f0` (GGX); those of colour channels end in `_r`, `_g`, `_b`.
    pub name: String,
    /// Its value.
    pub value: f64,
    /// Its standard uncertainty (k = 1); `None` if the fit is not acceptable.
    pub standard_uncertainty: Option<f64>,
    /// Whether it sits at the bound of what is physical.
    pub at_bound: bool,
}

/// The parameters of a fit with their covariance, and the shape of its lobe.
pub(super) struct Numbers {
    pub(super) parameters: Vec<Parameter>,
    pub(super) covariance: DMatrix<f64>,
    pub(super) shape: Shape,
}

impl Numbers {
    /// What stands for the `unknowns` of a fit of `model` to so many `channels`, which have this `covariance`.
    pub(super) fn of(
        model: Model,
        unknowns: &DVector<f64>,
        covariance: &DMatrix<f64>,
        channels: usize,
    ) -> Self {
        let of_shape = [unknowns[0], unknowns[1], unknowns[2]];
        let has_azimuth = has_azimuth(of_shape, covariance);
        let shape = if has_azimuth {
            Shape::of_unknowns(of_shape)
        } else {
            Shape::along_frame(of_shape)
        };
        let mut named = vec![
            ("ax".to_owned(), shape.alpha[0]),
            ("ay".to_owned(), shape.alpha[1]),
        ];
        if has_azimuth {
            named.push((AZIMUTH.to_owned(), shape.azimuth_rad.to_degrees()));
        }
        let first = named.len();
        let linear = unknowns.iter().skip(SHAPE).enumerate();
        named.extend(linear.map(|(at, value)| {
            let part = if at.is_multiple_of(2) {
                "rd"
            } else {
                model.strength()
            };
            let name = match channels {
                1 => part.to_owned(),
                _ => format!("{part}_{}", ["r", "g", "b"][at / 2]),
            };
            (name, *value)
        }));
        // Of the shape's numbers by its unknowns; the others are what they are.
        let mut derivatives = DMatrix::zeros(named.len(), unknowns.len());
        let of_shape = Shape::derivatives(of_shape, has_azimuth);
        derivatives
            .view_mut((0, 0), of_shape.shape())
            .copy_from(&of_shape);
        for at in SHAPE..unknowns.len() {
            derivatives[(first + at - SHAPE, at)] = 1.0;
        }
        let mut covariance = &derivatives * covariance * derivatives.transpose();
        for (at, (name, value)) in named.iter().enumerate() {
            covariance[(at, at)] += if name == AZIMUTH {
                shape.azimuth_left_deg(LEFT).powi(2)
            } else {
                (LEFT * value).powi(2)
            };
        }
        let parameter = |(at, (name, value))| {
            let is_at_bound = |at: usize| {
                let (is_diffuse, pair) = (at.is_multiple_of(2), SHAPE + (at & !1));
                is_at_bound(unknowns[pair], unknowns[pair + 1], is_diffuse)
            };
            let sigma: f64 = covariance[(at, at)];
            Parameter {
                name,
                value,
                standard_uncertainty: Some(sigma.sqrt()).filter(|sigma| sigma.is_finite()),
                at_bound: at.checked_sub(first).is_some_and(is_at_bound),
            }
        };
        Self {
            parameters: named.into_iter().enumerate().map(parameter).collect(),
            covariance,
            shape,
        }
    }
}

/// Whether a lobe of those unknowns with their covariance (and others) is clearly wider along one axis than along the other.
fn has_azimuth([_, u, v]: [f64; SHAPE], covariance: &DMatrix<f64>) -> bool {
    let half = u.hypot(v);
    let [by_u, by_v] = [u / half, v / half];
    let variance = by_u * by_u * covariance[(1, 1)]
        + by_v * by_v * covariance[(2, 2)]
        + 2.0 * by_u * by_v * covariance[(1, 2)];
    half > CLEAR * variance.sqrt().hypot(LEFT)
}

fn is_at_bound(rho_d: f64, strength: f64, is_diffuse: bool) -> bool {
    let value = if is_diffuse { rho_d } else { strength };
    value <= 0.0 || rho_d + strength >= 1.0
}
