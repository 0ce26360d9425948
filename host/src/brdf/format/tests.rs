//! Laws of formats: what is written is read back as it was, and no file is trusted.

use std::path::Path;

use rand::{RngExt as _, SeedableRng as _};
use rand_xoshiro::Xoshiro256PlusPlus;

use super::*;
use crate::base::progress::Silent;
use crate::hemisphere::direction::from_degrees;

fn about() -> About {
    About {
        name: "a <test> & more".to_owned(),
        written: "2026-01-01T00:00:00Z".to_owned(),
    }
}

fn written(spec: &str, to: Format, resolution: Resolution, out: &Path) -> Exported {
    export(
        &Source::open(spec).unwrap(),
        &about(),
        (to, resolution),
        out,
        &Silent,
    )
    .unwrap()
}

fn every(step_deg: f64) -> Resolution {
    Resolution {
        step_deg,
        ..Resolution::default()
    }
}

#[test]
fn what_is_written_is_read_back_as_it_was() {
    let folder = tempfile::tempdir().unwrap();
    let fine = Resolution {
        step_deg: 7.5,
        side: 64,
        ..Resolution::default()
    };
    for (to, resolution, smooth, glossy) in [
        (Format::Bsdf, fine, 4e-3, 2e-2),
        (Format::Ssdd, every(7.5), 1e-3, 5e-2),
        (Format::Npy, every(7.5), 1e-3, 5e-2),
        (Format::Bird, every(15.0), 1e-3, 0.2),
        (Format::Zemax, every(15.0), 1e-3, 0.1),
        (Format::Klems, Resolution::default(), 1e-3, 0.2),
    ] {
        for (spec, most) in [("lambert:0.6,0.3,0.06", smooth), ("ggx:satin", glossy)] {
            let out = folder.path().join(format!("{}.{}", to.name(), to.endings()[0]));
            let exported = written(spec, to, resolution, &out);
            assert_eq!(Format::of(&out).unwrap(), Some(to));
            let trip = exported.round_trip.unwrap();
            println!("{to:?} {spec}: {trip:?}, {} bytes", exported.bytes);
            assert!(
                trip.median.unwrap() < most && trip.lost == 0,
                "{to:?} {spec}: {trip:?}"
            );
            assert!(exported.missing <= 0.0);
        }
    }
}

#[test]
fn azimuths_of_light_and_view_are_where_they_were() {
    // A lobe that is twice as wide along x as along y, turned: no mirror and no exchange of axes leaves it as it is.
    let spec = "ward:rd=0.1,rs=0.3,ax=0.5,ay=0.25@25";
    let Source::Known(truth) = Source::open(spec).unwrap() else {
        panic!()
    };
    let folder = tempfile::tempdir().unwrap();
    let fine = Resolution {
        step_deg: 10.0,
        side: 48,
        ..Resolution::default()
    };
    for (to, form, most) in [
        (Format::Bsdf, Some(Form::Dense), 0.03),
        (Format::Bsdf, Some(Form::Compact), 0.03),
        (Format::Ssdd, None, 0.05),
        (Format::Npy, None, 0.05),
        (Format::Bird, None, 0.05),
        (Format::Zemax, None, 0.05),
        (Format::Klems, None, 0.15),
    ] {
        let out = folder.path().join(format!("a.{}", to.endings()[0]));
        written(spec, to, Resolution { form, ..fine }, &out);
        let file = open(&out).unwrap();
        for (theta_i, phi_i, theta_o, phi_o) in [
            (30.0, 20.0, 40.0, 170.0),
            (50.0, 100.0, 20.0, 300.0),
            (20.0, 250.0, 45.0, 40.0),
            (40.0, 330.0, 50.0, 130.0),
        ] {
            let (wi, wo) = (from_degrees(theta_i, phi_i), from_degrees(theta_o, phi_o));
            let (read, expected) = (file.f(wi, wo)[1], truth.f(wi, wo)[1]);
            assert!(
                (read / expected - 1.0).abs() < most,
                "{to:?} {phi_i} {phi_o}: {read} {expected}"
            );
        }
    }
}

#[test]
fn a_compact_table_is_written_where_it_is_smaller_and_as_good() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("a.bsdf");
    let of = |spec: &str, form| {
        let coarse = Resolution {
            step_deg: 30.0,
            form,
            ..Resolution::default()
        };
        written(spec, Format::Bsdf, coarse, &out)
    };
    let errors = |of: &Exported| {
        let trip = of.round_trip.unwrap();
        [trip.median.unwrap(), trip.below_99.unwrap()]
    };
    for (spec, is_compact) in [("ggx:satin", true), ("lambert", false)] {
        let dense = of(spec, Some(Form::Dense));
        let chosen = of(spec, None);
        let table = chosen.table.as_ref().unwrap();
        println!(
            "{spec}: {}, {:?} {:?}",
            table.why,
            errors(&chosen),
            errors(&dense)
        );
        assert_eq!(table.form == Form::Compact, is_compact, "{spec}: {table:?}");
        if is_compact {
            assert!(chosen.bytes < dense.bytes / 2, "{} {}", chosen.bytes, dense.bytes);
            for (found, most) in errors(&chosen).into_iter().zip(errors(&dense)) {
                assert!(found < 1.001 * most, "{spec}: {found} {most}");
            }
        }
    }
}

#[test]
fn a_tensor_file_keeps_its_own_tables() {
    let folder = tempfile::tempdir().unwrap();
    let [first, again] = ["first.bsdf", "again.bsdf"].map(|name| folder.path().join(name));
    let small = Resolution {
        step_deg: 30.0,
        side: 12,
        form: Some(Form::Compact),
        ..Resolution::default()
    };
    for spec in ["ggx:satin", "ggx:metal,ax=0.2,ay=0.2"] {
        written(spec, Format::Bsdf, small, &first);
        let exported = written(
            first.to_str().unwrap(),
            Format::Bsdf,
            Resolution::default(),
            &again,
        );
        assert_eq!(exported.table.as_ref().unwrap().form, Form::Own, "{exported:?}");
        assert!(
            exported.round_trip.unwrap().largest.unwrap() < 1e-5,
            "{exported:?}"
        );
        let other = written(first.to_str().unwrap(), Format::Bsdf, every(30.0), &again);
        assert_ne!(other.table.as_ref().unwrap().form, Form::Own, "{other:?}");
    }
}

#[test]
fn merl_averages_azimuths_and_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("a.binary");
    let exported = written(
        "ggx:metal,ax=0.2,ay=0.2",
        Format::Merl,
        Resolution::default(),
        &out,
    );
    assert_eq!(exported.bytes, 12 + 3 * 8 * 90 * 90 * 180);
    assert!(exported.averaged_azimuths.is_none_or(|averaged| averaged < 1e-3));
    let trip = exported.round_trip.unwrap();
    assert!(trip.median.unwrap() < 0.02, "{trip:?}");
    let exported = written("ward:brass", Format::Merl, Resolution::default(), &out);
    assert!(exported.averaged_azimuths.unwrap() > 0.1, "{exported:?}");
    assert!(
        exported
            .warnings
            .iter()
            .any(|warning| warning.starts_with("isotropic: "))
    );
}

#[test]
fn a_picture_has_the_hemisphere_as_one_looks_at_it() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("a.exr");
    let lit = Resolution {
        side: 40,
        incident_deg: Some([50.0, 20.0]),
        ..Resolution::default()
    };
    // Neither turned nor mirrored it would look the same.
    let spec = "ward:rd=0.1,rs=0.3,ax=0.5,ay=0.25@25";
    let exported = written(spec, Format::Exr, lit, &out);
    assert!(exported.missing <= 0.0 && exported.round_trip.is_none());
    assert_eq!(Format::of(&out).unwrap(), Some(Format::Exr));
    assert!(
        open(&out)
            .err()
            .unwrap()
            .to_string()
            .contains("OpenEXR picture of a hemisphere, which is written only")
    );
    let image = ::exr::prelude::read_first_flat_layer_from_file(&out).unwrap();
    let attributes = &image.layer_data.attributes;
    let named = ::exr::prelude::Text::new_or_panic("incidentPhiDeg");
    assert_eq!(
        attributes.other[&named],
        ::exr::prelude::AttributeValue::F64(20.0)
    );
    let values = |name: &str| -> Vec<f32> {
        let channels = &image.layer_data.channel_data.list;
        let channel = channels
            .iter()
            .find(|channel| channel.name.to_string() == name)
            .unwrap();
        channel.sample_data.values_as_f32().collect()
    };
    let (Source::Known(truth), [g, origin]) = (Source::open(spec).unwrap(), ["G", "provenance"].map(values))
    else {
        panic!()
    };
    for (theta, phi) in [(45.0, 200.0), (50.0, 10.0), (20.0, 90.0), (70.0, 300.0)] {
        // To the right and up, on a disk of radius 20 pixels.
        let radius = 20.0 * std::f64::consts::SQRT_2 * f64::to_radians(theta / 2.0).sin();
        let (x, y) = (
            20.0 + radius * f64::to_radians(phi).cos(),
            20.0 - radius * f64::to_radians(phi).sin(),
        );
        let at = y as usize * 40 + x as usize;
        let expected = truth.f(from_degrees(50.0, 20.0), from_degrees(theta, phi))[1];
        // The pixel's own direction is up to 3° off.
        let error = f64::from(g[at]) / expected - 1.0;
        assert!(error.abs() < 0.3, "{theta} {phi}: {} {expected}", g[at]);
        assert!((origin[at] + 1.0).abs() < 1e-6);
    }
    assert!(g[0].is_nan() && origin[0].abs() < 1e-6);
}

#[test]
fn gaps_are_told_as_the_format_can_or_refused() {
    let folder = tempfile::tempdir().unwrap();
    let holed = folder.path().join("holed.npy");
    written("lambert", Format::Npy, every(15.0), &holed);
    // Takes the values near the normal away.
    let mut bytes = std::fs::read(&holed).unwrap();
    let start = 10 + usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
    let record = 41;
    let count = (bytes.len() - start) / record;
    for number in 0..count {
        let at = start + number * record;
        let theta = f32::from_le_bytes(bytes[at + 8..at + 12].try_into().unwrap());
        if theta < 20.0 {
            bytes[at + 16..at + 28].copy_from_slice(&[f32::NAN.to_le_bytes(); 3].concat());
        }
    }
    std::fs::write(&holed, &bytes).unwrap();
    let spec = holed.to_str().unwrap();
    let coarse = Resolution {
        step_deg: 30.0,
        side: 16,
        ..Resolution::default()
    };
    for to in [Format::Bsdf, Format::Klems, Format::Zemax] {
        let out = folder.path().join(format!("{}.{}", to.name(), to.endings()[0]));
        let source = Source::open(spec).unwrap();
        let error = export(&source, &about(), (to, coarse), &out, &Silent).unwrap_err();
        assert!(
            error.is_input() && error.to_string().contains("found none for"),
            "{error}"
        );
        assert!(!out.exists(), "{to:?}");
        let zeros = Resolution {
            zeros: true,
            ..coarse
        };
        let exported = export(&source, &about(), (to, zeros), &out, &Silent).unwrap();
        assert!(
            exported.missing > 0.01 && exported.warnings[0].contains("which are 0 there"),
            "{exported:?}"
        );
    }
    for to in [Format::Ssdd, Format::Npy, Format::Bird] {
        let out = folder.path().join(format!("c.{}", to.endings()[0]));
        written(spec, to, every(15.0), &out);
        let again = Source::open(out.to_str().unwrap()).unwrap();
        let ask = |theta_deg: f64| {
            let pair = (from_degrees(40.0, 10.0), from_degrees(theta_deg, 100.0));
            again.reflectance().values(&[pair]).unwrap().remove(0)
        };
        assert_eq!(
            ask(5.0).unwrap_err().to_string(),
            "no value in the file",
            "{to:?}"
        );
        assert!(
            (ask(50.0).unwrap()[0] * std::f32::consts::TAU - 1.0).abs() < 1e-3,
            "{to:?}"
        );
    }
}

#[test]
fn no_file_is_trusted() {
    let folder = tempfile::tempdir().unwrap();
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(5);
    let coarse = Resolution {
        step_deg: 45.0,
        side: 4,
        ..Resolution::default()
    };
    for to in [
        Format::Bsdf,
        Format::Ssdd,
        Format::Npy,
        Format::Bird,
        Format::Zemax,
        Format::Klems,
    ] {
        let out = folder.path().join(format!("d.{}", to.endings()[0]));
        written("lambert", to, coarse, &out);
        let whole = std::fs::read(&out).unwrap();
        // All cuts of the beginning, and some of the rest.
        let cuts = (0..whole.len().min(400)).chain((400..whole.len()).step_by(whole.len() / 60 + 1));
        for cut in cuts {
            std::fs::write(&out, &whole[..cut]).unwrap();
            if let Err(error) = open(&out) {
                assert!(error.to_string().starts_with(out.to_str().unwrap()), "{error}");
            } else {
                // What ends a text may be missing.
                assert!(
                    cut + 20 > whole.len(),
                    "{to:?}: {cut} of {} bytes are a file",
                    whole.len()
                );
            }
        }
        for _ in 0..400 {
            let mut bytes = whole.clone();
            for _ in 0..rng.random_range(1..4) {
                let at = rng.random_range(0..bytes.len().min(1200));
                bytes[at] = rng.random();
            }
            std::fs::write(&out, &bytes).unwrap();
            if let Ok(sample) = open(&out) {
                sample.f(from_degrees(30.0, 10.0), from_degrees(50.0, 200.0));
            }
        }
    }
    let klems = folder.path().join("d.xml");
    written("lambert", Format::Klems, coarse, &klems);
    let tree = std::fs::read_to_string(&klems)
        .unwrap()
        .replace(">Columns<", ">TensorTree4<");
    std::fs::write(&klems, tree).unwrap();
    let told = open(&klems).unwrap_err().to_string();
    assert!(
        told.contains("IncidentDataStructure: expected Columns") && told.contains("found `TensorTree4`"),
        "{told}"
    );
    let merl = folder.path().join("e.binary");
    for bytes in [
        &b"\x5a\0\0\0\x5a\0\0\0\xb4\0\0\0"[..],
        b"\x5a\0\0\0\x5a\0\0\0\xb4\0\0\0\0\0\0\0",
        b"\x10\0\0\0",
    ] {
        std::fs::write(&merl, bytes).unwrap();
        assert!(open(&merl).is_err());
    }
}

#[test]
fn angles_are_read_in_radians_and_on_either_side_of_the_normal() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("plane.brdf");
    // f grows with the polar angle of view, negative ones lie at φ = 180°; azimuths are enough to interpolate between.
    let (mut angles, mut f) = (vec![Vec::new(); 4], Vec::new());
    for theta_i in [10.0_f64, 40.0] {
        for phi_i in [0.0_f64, 60.0, 120.0, 180.0, 240.0, 300.0] {
            for theta_r in [-50.0_f64, -20.0, 20.0, 50.0] {
                for phi_r in [0.0_f64, 60.0, 120.0] {
                    let all = [theta_i, phi_i, theta_r, phi_r];
                    angles
                        .iter_mut()
                        .zip(all)
                        .for_each(|(list, deg)| list.push(deg.to_radians()));
                    f.push(0.1 + theta_r.abs() / 100.0);
                }
            }
        }
    }
    let list = |values: &[f64]| serde_json::json!({ "unit": "rad", "values": values });
    let mut data = serde_json::json!({ "BRDF": { "unit": "sr^-1", "values": f } });
    for (name, list) in ["theta_i", "phi_i", "theta_r", "phi_r"]
        .into_iter()
        .zip(angles.iter().map(|one| list(one)))
    {
        data[name] = list;
    }
    let document = serde_json::json!({ "metadata": { "type": "BRDF" }, "data": data });
    std::fs::write(&path, document.to_string()).unwrap();
    let file = open(&path).unwrap();
    for (theta_o, phi_o) in [(20.0, 30.0), (35.0, 200.0), (50.0, 310.0)] {
        let read = file.f(from_degrees(25.0, 90.0), from_degrees(theta_o, phi_o))[0];
        assert!(
            (read - 0.1 - theta_o / 100.0).abs() < 1e-6,
            "{theta_o} {phi_o}: {read}"
        );
    }
}
