//! What the projector shows while somebody aligns.

use std::fmt;
use std::str::FromStr;

use crate::hemisphere::direction::from_degrees;
use crate::plan::pattern::PatternMaker;

/// Thickness of the cross, and width of a stripe, as a share of the image's height.
const CROSS: f64 = 0.01;
const STRIPE: f64 = 0.03;

/// A picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Shown {
    /// No pixel is lit.
    Black,
    /// Every pixel is.
    White,
    /// A cross through the principal point.
    Cross,
    /// The spot that lights the sample from this direction, sample frame, degrees.
    Spot {
        /// Angle from the normal, 0 to 90.
        theta_deg: f64,
        /// Azimuth, 0 to 360.
        phi_deg: f64,
    },
    /// Upright stripes.
    Stripes,
}

impl FromStr for Shown {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let expected = || {
            format!(
                "expected black, white, cross, stripes, or spot THETA PHI with angles from 0 to 90 and from 0 to 360 degrees, found {text}"
            )
        };
        let words: Vec<&str> = text.split_whitespace().collect();
        match words[..] {
            ["black"] => Ok(Self::Black),
            ["white"] => Ok(Self::White),
            ["cross"] => Ok(Self::Cross),
            ["stripes"] => Ok(Self::Stripes),
            ["spot", theta, phi] => {
                let angle = |text: &str, most: f64| {
                    let angle = text.parse().ok().filter(|deg| (0.0..=most).contains(deg));
                    angle.ok_or_else(expected)
                };
                Ok(Self::Spot {
                    theta_deg: angle(theta, 90.0)?,
                    phi_deg: angle(phi, 360.0)?,
                })
            }
            _ => Err(expected()),
        }
    }
}

impl fmt::Display for Shown {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Black => f.write_str("black"),
            Self::White => f.write_str("white"),
            Self::Cross => f.write_str("cross"),
            Self::Stripes => f.write_str("stripes"),
            Self::Spot { theta_deg, phi_deg } => write!(f, "spot {theta_deg} {phi_deg}"),
        }
    }
}

impl Shown {
    /// Row-major indices of the pixels that are lit of a projector whose principal point is `centre_px`.
    ///
    /// # Errors
    /// A sentence where the projector does not reach the spot.
    pub(super) fn lit(self, maker: &PatternMaker, centre_px: [f64; 2]) -> Result<Vec<u32>, String> {
        let (width, height) = maker.size_px();
        let pick = |is_lit: &dyn Fn(f64, f64) -> bool| -> Vec<u32> {
            let all = (0..width * height)
                .filter(|pixel| is_lit((pixel % width) as f64 + 0.5, (pixel / width) as f64 + 0.5));
            all.map(|pixel| pixel as u32).collect()
        };
        let size = height as f64;
        match self {
            Self::Black => Ok(Vec::new()),
            Self::White => Ok(pick(&|_, _| true)),
            Self::Cross => {
                let half = (CROSS * size / 2.0).max(1.0);
                Ok(pick(&|u, v| {
                    (u - centre_px[0]).abs() < half || (v - centre_px[1]).abs() < half
                }))
            }
            Self::Stripes => {
                let stripe = (STRIPE * size).max(1.0);
                Ok(pick(&|u, _| ((u / stripe) as u64).is_multiple_of(2)))
            }
            Self::Spot { theta_deg, phi_deg } => maker
                .lit_set(from_degrees(theta_deg, phi_deg))
                .map(|lit| lit.pixels)
                .map_err(|reason| {
                    format!(
                        "spot {theta_deg} {phi_deg}: expected a direction that the projector reaches, found {reason}"
                    )
                }),
        }
    }
}
