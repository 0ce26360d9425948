//! Under which light and towards which view a certified value is.

use std::fmt::{self, Display};

use glam::DVec3;

use crate::hemisphere::direction::from_degrees;

/// What was calibrated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Quantity {
    /// Share of the light that comes back into the hemisphere.
    Reflectance,
    /// Radiance over that of a perfect and lossless diffuser: π·f.
    ReflectanceFactor,
    /// f, sr⁻¹.
    Brdf,
}

impl Quantity {
    pub(super) const ALL: [Self; 3] = [Self::Reflectance, Self::ReflectanceFactor, Self::Brdf];

    pub(super) const fn name(self) -> &'static str {
        match self {
            Self::Reflectance => "reflectance",
            Self::ReflectanceFactor => "reflectance factor",
            Self::Brdf => "brdf",
        }
    }

    /// The least and the most that it may be of a standard: matte plates reflect a little more towards some directions than a
    /// perfect diffuser does.
    pub(super) const fn range(self) -> [f64; 2] {
        match self {
            Self::Reflectance => [0.005, 1.0],
            Self::ReflectanceFactor => [0.005, 1.3],
            Self::Brdf => [0.0015, 0.42],
        }
    }
}

/// A quantity with its directions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Geometry {
    pub(super) quantity: Quantity,
    pub(super) incident_deg: f64,
    /// Polar angle of view in the plane of light; negative on the light's own side. `None` is the hemisphere.
    pub(super) outgoing_deg: Option<f64>,
}

/// The largest polar angle of light and view, degrees.
pub(super) const LARGEST_DEG: f64 = 80.0;

impl Geometry {
    /// The geometry in `text`, such as `8/h`, `d/8` or `0:45`; `None` if it is none.
    pub(super) fn parse(quantity: Quantity, text: &str) -> Option<Self> {
        let (light, view) = text.trim().split_once(['/', ':'])?;
        let (light, view) = (light.trim(), view.trim());
        let is_hemisphere = |text: &str| ["h", "hemisphere", "d", "di", "t"].contains(&text);
        let angle = |text: &str, least: f64| {
            let deg: f64 = text.trim_end_matches('°').parse().ok()?;
            (least..=LARGEST_DEG).contains(&deg).then_some(deg)
        };
        let (incident_deg, outgoing_deg) = if is_hemisphere(view) {
            (angle(light, 0.0)?, None)
        } else if is_hemisphere(light) {
            // Exchanged, it is the same (Helmholtz's reciprocity).
            (angle(view, 0.0)?, None)
        } else {
            (angle(light, 0.0)?, Some(angle(view, -LARGEST_DEG)?))
        };
        let fits = (quantity == Quantity::Reflectance) == outgoing_deg.is_none();
        fits.then_some(Self {
            quantity,
            incident_deg,
            outgoing_deg,
        })
    }

    /// Light and view; of the hemisphere the view along the normal.
    pub(super) fn directions(self) -> [DVec3; 2] {
        let view_deg = self.outgoing_deg.unwrap_or(0.0);
        let azimuth_deg = if view_deg < 0.0 { 0.0 } else { 180.0 };
        [
            from_degrees(self.incident_deg, 0.0),
            from_degrees(view_deg.abs(), azimuth_deg),
        ]
    }
}

impl Display for Geometry {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.outgoing_deg {
            None => write!(f, "{}/hemisphere", self.incident_deg),
            Some(deg) => write!(f, "{}/{deg}", self.incident_deg),
        }
    }
}
