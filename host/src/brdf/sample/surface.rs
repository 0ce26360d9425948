//! What a first surface does to polarised light.

/// (Rs − Rp)/(Rs + Rp) of a smooth surface of the reflectance `f0` at normal incidence, in light whose angle with the surface's normal
/// has this cosine: by how much more of the light that is polarised across the plane of incidence it reflects than of light that is
/// not, relative. Fresnel's equations with a real index, n = (1 + √f0)/(1 − √f0), which suits dielectrics; of metals, which have little
/// of it, the same f0 gives little, too.
#[must_use]
pub(crate) fn across(f0: f64, cos: f64) -> f64 {
    let root = f0.clamp(1e-6, 0.999).sqrt();
    let n = (1.0 + root) / (1.0 - root);
    let cos = cos.clamp(0.0, 1.0);
    let inside = (1.0 - (1.0 - cos * cos) / (n * n)).max(0.0).sqrt();
    let [s, p] = [
        (cos - n * inside) / (cos + n * inside),
        (n * cos - inside) / (n * cos + inside),
    ]
    .map(|amplitude| amplitude * amplitude);
    (s - p) / (s + p)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn at_brewsters_angle_all_is_polarised_and_straight_on_nothing() {
        // n = 1.5.
        assert!((across(0.04, (1.5_f64).atan().cos()) - 1.0).abs() < 1e-9);
        assert!(across(0.04, 1.0).abs() < 1e-12 && across(0.9, 1.0).abs() < 1e-12);
        let at_45 = [0.04, 0.9].map(|f0| across(f0, 0.5_f64.sqrt()));
        assert!(
            (0.75..0.85).contains(&at_45[0]) && (0.0..0.1).contains(&at_45[1]),
            "{at_45:?}"
        );
    }
}
