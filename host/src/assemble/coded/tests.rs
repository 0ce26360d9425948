//! What codes show is what single light shows.

use std::path::Path;

use crate::base::progress::Silent;
use crate::brdf::Brdf;
use crate::brdf::sample::parse;
use crate::hemisphere::incident::Grid;
use crate::hemisphere::judged::is_judged;
use crate::instrument::rig::Rig;
use crate::measure::{assemble_measurement, capture, prepare};
use crate::plan::brackets::Brackets;
use crate::plan::light::Light;
use crate::plan::{Request, Virtual};
use crate::store::provenance::Provenance;
use crate::virtual_rig::setup::Setup;

/// f and its standard uncertainty of all judged pairs that have a value, NaN for the others, and the truth.
struct Values {
    f: Vec<f32>,
    sigma: Vec<f32>,
    truth: Vec<f32>,
}

fn measured(folder: &Path, sample: &str, noise: bool, request: Request) -> Values {
    let setup = Setup::from(Virtual {
        sample: sample.to_owned(),
        noise,
        ..Virtual::default()
    });
    let rig = Rig::load("rcg-1-16bit").unwrap();
    let out = folder.join(format!("{}-{noise}", request.light).replace(':', "-"));
    let (job, measurement) = prepare(&out, &rig, request, &setup, &Silent).unwrap();
    capture(&measurement, &job, &Silent).unwrap();
    let assembled = assemble_measurement(&measurement, &Silent).unwrap();
    assert_eq!(assembled.saturated, 0, "{}", job.plan.request.light);
    assert!(!measurement.path("brdf.zarr").join("cells.tmp").exists());
    values(&Brdf::open(&measurement.path("brdf.zarr")).unwrap(), sample)
}

fn values(brdf: &Brdf, sample: &str) -> Values {
    let sample = parse(sample).unwrap();
    let (cells, channels) = (brdf.disk().len(), brdf.channels());
    let mut all = Values {
        f: Vec::new(),
        sigma: Vec::new(),
        truth: Vec::new(),
    };
    for chunk in 0..brdf.chunks() {
        let Some(rows) = brdf.chunk(chunk).unwrap() else {
            continue;
        };
        for (place, index) in brdf.chunk_range(chunk).enumerate() {
            let wi = brdf.grid().direction(index);
            let lobe = sample.incident(wi);
            for cell in (0..cells).filter(|_| is_judged(wi)) {
                let Some(wo) = brdf.disk().direction(cell).filter(|wo| is_judged(*wo)) else {
                    continue;
                };
                let at = place * cells + cell;
                if rows.provenance[at] == Provenance::Missing.code() {
                    continue;
                }
                all.f.push(rows.f[at * channels]);
                all.sigma.push(rows.sigma[at * channels].to_f32());
                all.truth.push(lobe.f(wo)[0] as f32);
            }
        }
    }
    all
}

fn request(light: Light, brackets: Brackets) -> Request {
    Request {
        grid: Grid::ThetaPhi { step_deg: 22.5 },
        image_size: 16,
        light,
        brackets,
        ..Request::default()
    }
}

#[test]
fn without_noise_codes_show_what_single_light_shows() {
    for brackets in [Brackets::One, Brackets::TimesMs(vec![0.5, 4.0])] {
        let folder = tempfile::tempdir().unwrap();
        let of = |light: &str| {
            let request = request(light.parse().unwrap(), brackets.clone());
            measured(folder.path(), "ward:rd=0.3,rs=0.1,ax=0.7,ay=0.6", false, request)
        };
        let single = of("single");
        assert!(single.f.len() > 1000, "{}", single.f.len());
        for light in ["multiplexed:7", "multiplexed:20", "complement:15"] {
            let coded = of(light);
            assert_eq!(coded.f.len(), single.f.len());
            // Without noise nothing dithers what is rounded, black frames too.
            let off = (0..single.f.len()).map(|at| {
                let sigma = single.sigma[at].hypot(coded.sigma[at]);
                (coded.f[at] - single.f[at]).abs() / sigma
            });
            let off: Vec<f32> = off.collect();
            let near = off.iter().filter(|off| **off < 2.0).count();
            let worst = off.iter().copied().fold(0.0, f32::max);
            assert!(
                near * 100 >= off.len() * 98,
                "{light}, {brackets}: {near} of {}",
                off.len()
            );
            assert!(worst < 6.0, "{light}, {brackets}: {worst}");
        }
    }
}

#[test]
fn with_noise_values_scatter_as_they_say() {
    let folder = tempfile::tempdir().unwrap();
    for light in ["multiplexed:15", "complement:7"] {
        let request = request(light.parse().unwrap(), Brackets::One);
        let found = measured(folder.path(), "lambert:0.5", true, request);
        let squares = found.f.iter().zip(&found.truth).zip(&found.sigma);
        let squares: f32 = squares
            .map(|((f, truth), sigma)| ((f - truth) / sigma).powi(2))
            .sum();
        let mean = squares / found.f.len() as f32;
        // Cells share pixels, and coded values frames, so that there are fewer degrees of freedom than values.
        assert!((0.7..1.2).contains(&mean), "{light}: {mean} of {}", found.f.len());
    }
}

#[test]
fn a_pixel_that_saturates_has_no_value_in_any_cell_of_its_block() {
    let folder = tempfile::tempdir().unwrap();
    let setup = Setup::from(Virtual {
        sample: "lambert:0.5".to_owned(),
        ..Virtual::default()
    });
    let rig = Rig::load("rcg-1-16bit").unwrap();
    // Single light fills the camera in this time: with codes all saturate.
    let single = request(Light::Single, Brackets::One);
    let (job, _) = prepare(&folder.path().join("s"), &rig, single.clone(), &setup, &Silent).unwrap();
    let coded = Request {
        light: Light::Multiplexed(Some(31)),
        exposure_s: Some(job.plan.exposure_s),
        ..single
    };
    let (job, measurement) = prepare(&folder.path().join("m"), &rig, coded, &setup, &Silent).unwrap();
    capture(&measurement, &job, &Silent).unwrap();
    let assembled = assemble_measurement(&measurement, &Silent).unwrap();
    assert!(assembled.saturated > assembled.measured, "{assembled:?}");
}
