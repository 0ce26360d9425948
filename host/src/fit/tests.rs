use super::*;
use crate::sample::{Ggx, Ward, parse};

fn value(fit: &Fit, name: &str) -> f64 {
    let found = fit.parameters.iter().find(|parameter| parameter.name == name);
    found
        .unwrap_or_else(|| panic!("no {name}: {:?}", fit.parameters))
        .value
}

#[test]
fn a_model_finds_its_own_parameters() {
    for (model, spec) in [
        (Model::Ward, "ward:brass"),
        (Model::Ward, "ward:rd=0.4,rs=0.05,ax=0.3,ay=0.3"),
        (Model::Ggx, "ggx:satin"),
        (Model::Ggx, "ggx:f0=0.04,rd=0.5,ax=0.15,ay=0.08"),
    ] {
        let sample = parse(spec).unwrap();
        let fit = Fit::of_sample(model, sample.as_ref()).unwrap();
        let truth = match model {
            Model::Ward => {
                let ward = match spec {
                    "ward:brass" => Ward::BRASS,
                    _ => Ward {
                        rho_d: 0.4,
                        rho_s: 0.05,
                        alpha_x: 0.3,
                        alpha_y: 0.3,
                    },
                };
                [ward.alpha_x, ward.alpha_y, ward.rho_d, ward.rho_s]
            }
            Model::Ggx => {
                let ggx = match spec {
                    "ggx:satin" => Ggx::SATIN,
                    _ => Ggx {
                        f0: 0.04,
                        alpha_x: 0.15,
                        alpha_y: 0.08,
                        rho_d: 0.5,
                    },
                };
                [ggx.alpha_x, ggx.alpha_y, ggx.rho_d, ggx.f0]
            }
        };
        let strength = format!("{}_g", model.strength());
        for (name, truth) in ["ax", "ay", "rd_g", &strength].into_iter().zip(truth) {
            let found = value(&fit, name);
            assert!(
                (found / truth - 1.0).abs() < 1e-6,
                "{spec}: {name} {found}, not {truth}"
            );
        }
        assert!(
            fit.chi_squared_per_degree < 1e-6,
            "{spec}: {}",
            fit.chi_squared_per_degree
        );
    }
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
