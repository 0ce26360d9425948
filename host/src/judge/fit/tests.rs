use super::*;
use crate::brdf::sample::{Ggx, Ward, parse};

fn value(fit: &Fit, name: &str) -> f64 {
    let found = fit.parameters.iter().find(|parameter| parameter.name == name);
    found
        .unwrap_or_else(|| panic!("no {name}: {:?}", fit.parameters))
        .value
}

/// Fits `model` to `sample`, whose αx, αy, ρd and strength are `truth`.
fn finds(model: Model, sample: &dyn Sample, truth: [f64; 4]) {
    let fit = Fit::of_sample(model, sample).unwrap();
    let strength = format!("{}_g", model.strength());
    for (name, truth) in ["ax", "ay", "rd_g", &strength].into_iter().zip(truth) {
        let found = value(&fit, name);
        assert!(
            (found / truth - 1.0).abs() < 1e-6,
            "{sample:?}: {name} {found}, not {truth}"
        );
    }
    assert!(
        fit.chi_squared_per_degree < 1e-6,
        "{sample:?}: {}",
        fit.chi_squared_per_degree
    );
}

#[test]
fn a_model_finds_its_own_parameters() {
    let ward = Ward::BRASS;
    let truth = [ward.alpha_x, ward.alpha_y, ward.rho_d, ward.rho_s];
    finds(Model::Ward, &ward, truth);
    let glossy = Ggx {
        f0: 0.04,
        alpha_x: 0.15,
        alpha_y: 0.08,
        rho_d: 0.5,
    };
    let truth = [glossy.alpha_x, glossy.alpha_y, glossy.rho_d, glossy.f0];
    finds(Model::Ggx, &glossy, truth);
}

#[test]
fn a_sample_that_lies_turned_has_its_azimuth_found_and_one_that_is_alike_all_around_has_none() {
    for (spec, azimuth_deg) in [("ward:brass@-71", 19.0), ("ward:brass,ax=0.16,ay=0.05@40", 40.0)] {
        let brass = parse(spec).unwrap();
        let fit = Fit::of_sample(Model::Ward, brass.as_ref()).unwrap();
        assert!(
            (value(&fit, AZIMUTH) - azimuth_deg).abs() < 1e-3,
            "{spec}: {:?}",
            fit.parameters
        );
        // The axis that is nearer to x comes first.
        let narrow = value(&fit, "ay");
        assert!((narrow / 0.05 - 1.0).abs() < 1e-6, "{spec}: {:?}", fit.parameters);
    }
    let round = parse("ward:brass,ax=0.1,ay=0.1").unwrap();
    let fit = Fit::of_sample(Model::Ward, round.as_ref()).unwrap();
    assert!(
        fit.parameters.iter().all(|parameter| parameter.name != AZIMUTH),
        "{:?}",
        fit.parameters
    );
}

#[test]
fn a_model_that_is_wrong_says_so() {
    let fit = Fit::of_sample(Model::Ward, &Ggx::SATIN).unwrap();
    assert!(
        fit.chi_squared_per_degree > 10.0,
        "{}",
        fit.chi_squared_per_degree
    );
    let rms = fit.residuals.iter().map(|residual| residual.rms_percent);
    assert!(rms.fold(0.0, f64::max) > 5.0);
}

#[test]
fn a_diffuse_material_has_no_lobe() {
    let white = parse("lambert:0.5").unwrap();
    let found = Fit::of_sample(Model::Ward, white.as_ref());
    assert!(matches!(found, Err(FitError::NoLobe { .. })), "{found:?}");
}
