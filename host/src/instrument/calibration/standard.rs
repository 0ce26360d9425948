//! The reflectance standards of a calibration, as all its documents name them.
//!
//! # Design
//! What a certificate says is read and turned into f elsewhere ([`crate::brdf::sample`]); here is what of it travels with every result:
//! whose word it is, until when, and how far f may be off by it. That has two parts. One is a factor that all directions share. The
//! other differs from direction to direction, because no standard is Lambertian and few certificates say more than one number: light
//! and throughput take from the standard what it is off by at their polar angle.

use std::fmt::{self, Display};

use serde::{Deserialize, Serialize};

use crate::base::date::Date;

/// A reflectance standard as it served.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Standard {
    /// The model, or the name of the file.
    pub named: String,
    /// Relative standard uncertainty (k = 1) of its f that all directions share.
    pub standard_uncertainty: f64,
    /// What differs between directions.
    pub angular: Angular,
    /// Whose word it is; `None` for a model or a measured file, which is assumed to be right to that uncertainty.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub certificate: Option<Certificate>,
}

/// What a certificate of calibration says.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Certificate {
    /// What was calibrated.
    pub name: String,
    /// Its serial number.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub serial: Option<String>,
    /// Number of the certificate.
    pub number: String,
    /// Who calibrated it.
    pub laboratory: String,
    /// When it was calibrated.
    pub calibrated: Date,
    /// The last day on which it holds; `None` if the certificate names none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub expires: Option<Date>,
    /// Whether it did not hold any more when it served, and was taken anyway.
    pub expired: bool,
    /// What was calibrated of it: reflectance, reflectance factor or brdf.
    pub quantity: String,
    /// Geometry as `incident/outgoing`, degrees, such as `8/hemisphere` or `0/45`.
    pub geometry: String,
    /// The value, of one number for all channels or three; 1, or sr⁻¹ for a BRDF.
    pub value: Vec<f64>,
    /// Standard uncertainty (k = 1) of each, in the same unit.
    pub standard_uncertainty: Vec<f64>,
    /// SHA-256 of the file that says so.
    pub sha256: String,
}

/// How far f of a standard may be off in one direction beside all others.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Angular {
    /// Relative standard uncertainty (k = 1) of f at one polar angle of light, and as much again at one of view, beside what all
    /// share, as far as `known_to_deg`.
    pub each: f64,
    /// Polar angles of light and of view up to which somebody knows how f goes, degrees; farther out the usual departure from
    /// Lambert's law is added.
    pub known_to_deg: [f64; 2],
}

/// Polar angle of light or of view up to which matte standards are Lambertian to the percent or two that [`Angular::each`] has, and
/// the angle farther out at which they are a [`DEPARTURE`] off, degrees.
const LAMBERTIAN_DEG: f64 = 45.0;
const FAR_DEG: f64 = 80.0;
/// Relative departure from Lambert's law at [`FAR_DEG`]: plates of sintered and of pressed PTFE are darker there by about a tenth
/// under light along their normal, and brighter by as much and more in front of oblique light (Höpe and Hauer, Metrologia 47, 295,
/// 2010; Weidner and Hsia, J. Opt. Soc. Am. 71, 856, 1981).
const DEPARTURE: f64 = 0.1;

/// The usual relative departure at the polar angle `theta_deg`.
fn departure(theta_deg: f64) -> f64 {
    let beyond = (theta_deg - LAMBERTIAN_DEG).max(0.0) / (FAR_DEG - LAMBERTIAN_DEG);
    DEPARTURE * beyond.powi(2)
}

impl Angular {
    /// Of what is taken for right in every direction.
    pub const NONE: Self = Self {
        each: 0.0,
        known_to_deg: [90.0; 2],
    };

    /// By what the usual departure goes on where nobody knows, relative; `end` 0 is light, 1 view.
    #[must_use]
    pub fn beyond(&self, end: usize, theta_deg: f64) -> f64 {
        (departure(theta_deg) - departure(self.known_to_deg[end])).max(0.0)
    }

    /// Relative variance of f by the polar angle of light (`end` 0) or of view (1).
    #[must_use]
    pub fn variance(&self, end: usize, theta_deg: f64) -> f64 {
        self.each.powi(2) + self.beyond(end, theta_deg).powi(2)
    }
}

impl Standard {
    /// A standard of which nobody certified anything.
    #[must_use]
    pub fn assumed(named: &str, standard_uncertainty: f64) -> Self {
        Self {
            named: named.to_owned(),
            standard_uncertainty,
            angular: Angular::NONE,
            certificate: None,
        }
    }

    /// Numbers with their names and what they may be at all.
    pub(crate) fn ranges(&self) -> Vec<(String, f64, f64, f64)> {
        let mut all = vec![
            (
                "standard_uncertainty".to_owned(),
                self.standard_uncertainty,
                0.0,
                0.5,
            ),
            ("angular.each".to_owned(), self.angular.each, 0.0, 0.5),
        ];
        for (end, deg) in self.angular.known_to_deg.into_iter().enumerate() {
            all.push((format!("angular.known_to_deg[{end}]"), deg, 0.0, 90.0));
        }
        if let Some(certificate) = &self.certificate {
            let of = |field: &str, at: usize| format!("certificate.{field}[{at}]");
            let values = certificate.value.iter().enumerate();
            all.extend(values.map(|(at, value)| (of("value", at), *value, 0.0, 2.0)));
            let sigmas = certificate.standard_uncertainty.iter().enumerate();
            all.extend(sigmas.map(|(at, sigma)| (of("standard_uncertainty", at), *sigma, 0.0, 1.0)));
        }
        all
    }

    /// What is to be known of it beside its uncertainty, in one sentence; `None` if nothing is.
    #[must_use]
    pub fn warning(&self) -> Option<String> {
        let certificate = self
            .certificate
            .as_ref()
            .filter(|certificate| certificate.expired)?;
        let expires = certificate.expires?;
        Some(format!(
            "standard: the certificate {} of {} had expired on {expires} when it was captured, and was taken anyway",
            certificate.number, certificate.name
        ))
    }
}

/// A standard uncertainty of `relative` in words.
fn percent(relative: f64) -> String {
    format!("{:.2} % (k = 1)", 100.0 * relative)
}

impl Display for Standard {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let shared = percent(self.standard_uncertainty);
        let Some(certificate) = &self.certificate else {
            return write!(f, "{}, assumed, without certificate, to {shared}", self.named);
        };
        write!(
            f,
            "{certificate}; f to {shared} that all directions share, and to {} that each has beside, for θ ≤ {LAMBERTIAN_DEG}°",
            percent(2_f64.sqrt() * self.angular.each)
        )
    }
}

impl Display for Certificate {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.name)?;
        if let Some(serial) = &self.serial {
            write!(f, " ({serial})")?;
        }
        write!(
            f,
            ", certificate {} of {}, calibrated {}, ",
            self.number, self.laboratory, self.calibrated
        )?;
        match (self.expires, self.expired) {
            (None, _) => f.write_str("without a day on which it expires")?,
            (Some(day), false) => write!(f, "valid to {day}")?,
            (Some(day), true) => write!(f, "EXPIRED on {day}")?,
        }
        write!(f, "; {} {} ", self.quantity, self.geometry)?;
        for (at, (value, sigma)) in self.value.iter().zip(&self.standard_uncertainty).enumerate() {
            let between = if at == 0 { "" } else { ", " };
            write!(f, "{between}{value:.4} ± {sigma:.4}")?;
        }
        let unit = if self.quantity == "brdf" { " 1/sr" } else { "" };
        write!(f, "{unit} (k = 1)")
    }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt as _, SeedableRng as _};
    use rand_distr::StandardNormal;
    use rand_xoshiro::Xoshiro256PlusPlus;

    use super::super::Interreflection;
    use super::super::TwoStandards;
    use super::*;

    #[test]
    fn farther_out_than_anybody_knows_the_uncertainty_grows() {
        let nobody = Angular {
            each: 0.01,
            known_to_deg: [0.0; 2],
        };
        let sigma = |angular: Angular, deg: f64| angular.variance(1, deg).sqrt();
        assert!((sigma(nobody, 30.0) - 0.01).abs() < 1e-12);
        assert!(sigma(nobody, 60.0) > 0.018 && sigma(nobody, 60.0) < 0.03);
        assert!((sigma(nobody, 80.0) - 0.1_f64.hypot(0.01)).abs() < 1e-12);
        let to_75 = Angular {
            known_to_deg: [0.0, 75.0],
            ..nobody
        };
        assert!((sigma(to_75, 75.0) - 0.01).abs() < 1e-12);
        assert!(sigma(to_75, 80.0) > 0.02 && sigma(to_75, 80.0) < sigma(nobody, 80.0));
        assert!(Angular::NONE.variance(0, 89.0).abs() < 1e-15);
    }

    /// What is found of a sample by standards that are off by so much each, over what is true, less 1; and what is stated for it.
    fn by_standards(
        two: TwoStandards,
        off: [f64; 2],
        [a, b]: [f64; 2],
        [f, per_share]: [f64; 2],
    ) -> [f64; 2] {
        let share = 0.01;
        // Of a reflectance ρ a standard shows ρ·(1 + share·ρ).
        let shown = |rho: f64, off: f64| {
            let rho = rho * (1.0 + off);
            rho * (1.0 + share * rho)
        };
        let (first, second) = (shown(a, off[0]) / a, shown(b, off[1]) / b);
        let ratio = first / second;
        let found = Interreflection {
            share: (ratio - 1.0) / (a - ratio * b),
            standard_uncertainty: 0.0,
            by_standards: 0.0,
            own: a,
            apart: a - b,
            narrowed: 1.0,
        };
        let sensitivity = first / (1.0 + found.share * a);
        let measured = (f + share * per_share) / sensitivity - found.share * per_share;
        let sigma = f64::from(found.standards_variance(two, f as f32, per_share as f32)).sqrt();
        [measured - f, sigma]
    }

    #[test]
    fn two_standards_of_different_uncertainty_state_what_they_make_of_f() {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(7);
        let mut normal = || -> f64 { rng.sample(StandardNormal) };
        for uncertainty in [
            [0.002, 0.002],
            [0.002, 0.02],
            [0.02, 0.002],
            [0.003, 0.0],
            [0.0, 0.01],
        ] {
            // The darker one first, too; a white, a grey and a black sample, and one with more light back than its f says.
            for rho in [[0.98, 0.2], [0.2, 0.98], [0.98, 0.6]] {
                for [f, per_share] in [[0.3, 0.28], [0.1, 0.03], [0.01, 0.0003], [0.01, 0.2]] {
                    let two = |may_agree| TwoStandards {
                        uncertainty,
                        may_agree,
                    };
                    let (mut apart, mut together, mut count) = ([0.0; 2], [0.0; 2], 0);
                    for _ in 0..2000 {
                        let drawn = [normal(), normal()];
                        let off = [0, 1].map(|at| uncertainty[at] * drawn[at]);
                        let [error, sigma] = by_standards(two(false), off, rho, [f, per_share]);
                        apart = [apart[0] + error.powi(2), apart[1] + sigma.powi(2)];
                        count += u32::from(error.abs() <= 2.0 * sigma);
                        // Both by the same chance.
                        let off = uncertainty.map(|relative| relative * drawn[0]);
                        let [error, sigma] = by_standards(two(true), off, rho, [f, per_share]);
                        together = [together[0] + error.powi(2), together[1] + sigma.powi(2)];
                    }
                    let case = format!("{uncertainty:?} {rho:?} {f} {per_share}");
                    let ratio = (apart[0] / apart[1]).sqrt();
                    assert!((0.93..1.07).contains(&ratio), "{case}: {ratio}");
                    assert!(
                        (0.94..0.97).contains(&(f64::from(count) / 2000.0)),
                        "{case}: {count}"
                    );
                    assert!((together[0] / together[1]).sqrt() < 1.07, "{case}");
                }
            }
        }
    }

    fn certified(expired: bool) -> Standard {
        Standard {
            named: "plate.toml".to_owned(),
            standard_uncertainty: 0.0151,
            angular: Angular {
                each: 0.01,
                known_to_deg: [0.0; 2],
            },
            certificate: Some(Certificate {
                name: "plate".to_owned(),
                serial: Some("7".to_owned()),
                number: "17".to_owned(),
                laboratory: "Laboratory".to_owned(),
                calibrated: "2026-02-17".parse().unwrap(),
                expires: Some("2027-02-17".parse().unwrap()),
                expired,
                quantity: "reflectance".to_owned(),
                geometry: "8/hemisphere".to_owned(),
                value: vec![0.985],
                standard_uncertainty: vec![0.0025],
                sha256: "00".to_owned(),
            }),
        }
    }

    #[test]
    fn documents_say_whose_word_it_is_and_until_when() {
        let valid = certified(false);
        assert_eq!(
            valid.to_string(),
            "plate (7), certificate 17 of Laboratory, calibrated 2026-02-17, valid to 2027-02-17; reflectance 8/hemisphere 0.9850 ± 0.0025 \
             (k = 1); f to 1.51 % (k = 1) that all directions share, and to 1.41 % (k = 1) that each has beside, for θ ≤ 45°"
        );
        assert_eq!(valid.warning(), None);
        let expired = certified(true);
        assert!(expired.to_string().contains("EXPIRED on 2027-02-17"));
        assert!(expired.warning().unwrap().contains("had expired on 2027-02-17"));
        for standard in [valid, expired, Standard::assumed("lambert:0.98", 0.0025)] {
            let text = serde_json::to_string(&standard).unwrap();
            assert!(!text.contains("null"), "{text}");
            assert_eq!(serde_json::from_str::<Standard>(&text).unwrap(), standard);
        }
        assert!(
            Standard::assumed("lambert:0.98", 0.0025)
                .to_string()
                .contains("assumed, without certificate")
        );
    }
}
