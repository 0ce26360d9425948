//! What is made of certificates, and what in them is refused.

use super::*;
use crate::brdf::sample::{certificate_of, parse};
use crate::hemisphere::direction::from_degrees;

/// A certificate of which `head` has the value and `rest` the tables.
fn file(head: &str, rest: &str) -> String {
    format!(
        "version = 1\nname = \"plate\"\ncertificate = \"17\"\nlaboratory = \"Lab\"\ncalibrated = 2026-02-17\nexpires = \"2027-02-17\"\n\
         {head}\n{rest}"
    )
}

fn of(head: &str, rest: &str) -> Result<Certified, SampleError> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("plate.toml");
    std::fs::write(&path, file(head, rest)).unwrap();
    Certified::open(&path)
}

const WHITE: &str =
    "quantity = \"reflectance\"\ngeometry = \"8/h\"\nvalue = 0.985\nexpanded_uncertainty = 0.005\nk = 2";
const ANGULAR: &str = "[angular]\nstandard_uncertainty = 0.006\ncorrelation = 0.5\nto_deg = 75\nvalues = [\n\
    { incident_deg = 0, outgoing_deg = 0, ratio = 1.04 },\n{ incident_deg = 0, outgoing_deg = 45, ratio = 1.0 },\n\
    { incident_deg = 0, outgoing_deg = 80, ratio = 0.88 },\n{ incident_deg = 60, outgoing_deg = -70, ratio = 0.95 },\n\
    { incident_deg = 60, outgoing_deg = 0, ratio = 0.98 },\n{ incident_deg = 60, outgoing_deg = 70, ratio = 1.2 },\n]";

fn pair(incident_deg: f64, outgoing_deg: f64) -> [DVec3; 2] {
    let azimuth_deg = if outgoing_deg < 0.0 { 0.0 } else { 180.0 };
    [
        from_degrees(incident_deg, 0.0),
        from_degrees(outgoing_deg.abs(), azimuth_deg),
    ]
}

fn close(found: f64, expected: f64) -> bool {
    (found / expected - 1.0).abs() < 1e-9
}

#[test]
fn what_was_calibrated_comes_out_in_its_geometry_whatever_the_shape() {
    for rest in ["", ANGULAR] {
        let white = of(WHITE, rest).unwrap();
        assert!((albedo(&white, from_degrees(8.0, 0.0))[0] - 0.985).abs() < 1e-6);
        for (geometry, [incident_deg, outgoing_deg]) in [
            ("0/45", [0.0, 45.0]),
            ("45:0", [45.0, 0.0]),
            ("60/-30", [60.0, -30.0]),
        ] {
            let of_pair = |quantity: &str, value: f64| {
                let head = format!(
                    "quantity = \"{quantity}\"\ngeometry = \"{geometry}\"\nvalue = {value}\nexpanded_uncertainty = {}\nk = 2",
                    value * 0.01
                );
                let standard = of(&head, rest).unwrap();
                let [wi, wo] = pair(incident_deg, outgoing_deg);
                standard.f(wi, wo)[1]
            };
            assert!(
                close(of_pair("reflectance factor", 1.01), 1.01 * FRAC_1_PI),
                "{geometry}"
            );
            assert!(close(of_pair("brdf", 0.31), 0.31), "{geometry}");
        }
    }
    // Exchanged, it is the same geometry.
    let same = of(&WHITE.replace("8/h", "d:8"), "").unwrap();
    assert_eq!(
        same.standard().certificate.as_ref().unwrap().geometry,
        "8/hemisphere"
    );
}

#[test]
fn ratios_by_angle_are_between_the_stated_ones_on_both_sides_of_the_light() {
    let standard = of(WHITE, ANGULAR).unwrap();
    let f = |incident_deg: f64, outgoing_deg: f64| {
        let [wi, wo] = pair(incident_deg, outgoing_deg);
        standard.f(wi, wo)[0]
    };
    let unit = f(0.0, 45.0);
    for ([incident_deg, outgoing_deg], ratio) in [
        ([0.0, 0.0], 1.04),
        ([0.0, 22.5], 1.02),
        ([0.0, -45.0], 1.0),
        ([60.0, 70.0], 1.2),
        ([60.0, -70.0], 0.95),
        ([60.0, 35.0], 1.09),
        ([30.0, 0.0], 1.01),
        // Beyond what is stated, as it ends.
        ([0.0, 85.0], 0.88),
        ([80.0, 80.0], 1.2),
    ] {
        let found = f(incident_deg, outgoing_deg) / unit;
        assert!(close(found, ratio), "{incident_deg} {outgoing_deg}: {found}");
    }
    // Across the plane of light, between both sides.
    let across = standard.f(from_degrees(60.0, 0.0), from_degrees(70.0, 90.0))[0] / unit;
    assert!(close(across, f64::midpoint(1.2, 0.95)), "{across}");
    // All turned alike.
    let turned = standard.f(from_degrees(60.0, 33.0), from_degrees(70.0, 213.0))[0] / unit;
    assert!(close(turned, 1.2), "{turned}");
    for bad in [from_degrees(90.0, 0.0), from_degrees(120.0, 0.0)] {
        assert!(standard.f(bad, DVec3::Z)[0].abs() < 1e-15);
        assert!(standard.f(DVec3::Z, bad)[0].abs() < 1e-15);
    }
}

#[test]
fn what_the_certificate_does_not_say_is_added_to_its_uncertainty_by_name() {
    let parts = |standard: &Certified| -> Vec<f64> {
        standard
            .contributions()
            .iter()
            .map(|part| part.relative)
            .collect()
    };
    let alone = of(WHITE, "").unwrap();
    let [certificate, bands, departure, hemisphere] = parts(&alone)[..] else {
        panic!("{alone:?}");
    };
    assert!(close(certificate, 0.0025 / 0.985) && bands.abs() < 1e-15 && close(departure, USUAL));
    assert!(hemisphere.abs() < 1e-15, "{hemisphere}");
    let all = certificate.hypot(departure);
    assert!(close(alone.standard().standard_uncertainty, all));
    assert!(close(alone.standard().angular.each, USUAL / 2_f64.sqrt()));
    assert!(alone.standard().angular.variance(1, 80.0).sqrt() > 0.1);
    // A closer word of the laboratory: half of the variance is shared, a quarter each has by light, and by view.
    let told = of(WHITE, ANGULAR).unwrap();
    assert!(close(parts(&told)[2], 0.006 * 0.5_f64.sqrt()));
    assert!(close(told.standard().angular.each, 0.003));
    assert!(
        told.standard()
            .angular
            .known_to_deg
            .iter()
            .all(|deg| close(*deg, 75.0))
    );
    assert!((1e-4..5e-3).contains(&parts(&told)[3]), "{told:?}");
    // Values reach as far as they do.
    let reach = of(WHITE, &ANGULAR.replace("to_deg = 75\n", "")).unwrap();
    let [light_deg, view_deg] = reach.standard().angular.known_to_deg;
    assert!(close(light_deg, 60.0) && close(view_deg, 70.0));
    // What is known of one pair of directions needs no hemisphere.
    let pair = of(
        "quantity = \"reflectance factor\"\ngeometry = \"0/45\"\nvalue = [1.01, 1.0, 0.99]\nexpanded_uncertainty = [0.01, 0.02, 0.01]\nk = 2",
        "",
    )
    .unwrap();
    assert!(parts(&pair)[3].abs() < 1e-15 && close(parts(&pair)[0], 0.01) && !pair.is_grey());
}

#[test]
fn a_spectrum_is_known_no_better_than_the_bands_allow() {
    let spectrum = "spectrum = [\n{ wavelength_nm = 400, value = 0.90, expanded_uncertainty = 0.02 },\n\
        { wavelength_nm = 500, value = 0.98, expanded_uncertainty = 0.004 },\n\
        { wavelength_nm = 700, value = 0.96, expanded_uncertainty = 0.004 },\n]";
    let head = "quantity = \"reflectance\"\ngeometry = \"8/h\"\nk = 2\n";
    let with = |bands: &str| of(&format!("{head}bands_nm = {bands}\n{spectrum}"), "");
    let grey = with("[[450, 700]]").unwrap();
    let certificate = grey.standard().certificate.clone().unwrap();
    // From 0.94 at 450 nm to 0.98 at 500 nm; the largest uncertainty is that at 450 nm.
    assert!(close(certificate.value[0], 0.96) && certificate.value.len() == 1);
    assert!(close(certificate.standard_uncertainty[0], 0.006));
    assert!(close(
        grey.contributions()[1].relative,
        0.04 / 12_f64.sqrt() / 0.96
    ));
    let colours = with("[[600, 700], [500, 600], [400, 500]]").unwrap();
    let values = colours.standard().certificate.clone().unwrap().value;
    for (found, expected) in values.into_iter().zip([0.965, 0.975, 0.94]) {
        assert!(close(found, expected), "{found}");
    }
    for (bands, found) in [
        ("[[350, 700]]", "350 to 700 nm"),
        ("[[400, 701]]", "400 to 701 nm"),
        ("[[500, 500]]", "500 to 500 nm"),
        ("[[600, 500]]", "600 to 500 nm"),
        ("[[nan, 500]]", "NaN to 500 nm"),
        ("[[400, 500], [500, 600]]", "2 bands"),
    ] {
        let error = with(bands).unwrap_err().to_string();
        assert!(
            error.contains("bands_nm: expected") && error.ends_with(found),
            "{error}"
        );
    }
    let error = of(&format!("{head}{spectrum}"), "").unwrap_err().to_string();
    assert!(
        error.contains("the rig knows nothing of its bands, found nothing"),
        "{error}"
    );
}

/// Such a certificate is refused by `field`.
fn refused(head: &str, rest: &str, field: &str, found: &str) {
    let error = of(head, rest).unwrap_err().to_string();
    assert!(
        error.contains(&format!("plate.toml, {field}: expected "))
            && error.contains(&format!("found {found}")),
        "{field}, {found}: {error}"
    );
}

#[test]
fn certificates_that_say_nothing_of_use_are_refused_by_their_field() {
    for (from, to, field, found) in [
        ("k = 2", "k = 0", "k", "0"),
        ("k = 2", "k = nan", "k", "NaN"),
        ("k = 2", "", "k", "nothing"),
        ("k = 2", "k = \"two\"", "k", "string"),
        ("k = 2", "k = 2\ncolour = 1", "colour", "unknown field `colour`"),
        ("8/h", "8/45", "geometry", "`8/45`"),
        ("8/h", "85/h", "geometry", "`85/h`"),
        ("8/h", "8", "geometry", "`8`"),
        ("\"reflectance\"", "\"whiteness\"", "quantity", "`whiteness`"),
        ("\"reflectance\"", "\"brdf\"", "geometry", "`8/h`"),
        ("0.985", "1.01", "value", "1.01"),
        ("0.985", "nan", "value", "NaN"),
        ("0.985", "\"white\"", "value", "`\"white\"`"),
        ("0.985", "[0.98, 0.97]", "value", "`[0.98, 0.97]`"),
        ("value = 0.985\n", "", "value", "neither"),
        ("0.005", "0", "expanded_uncertainty", "0 of 0.985"),
        ("0.005", "-0.005", "expanded_uncertainty", "-0.005 of 0.985"),
        ("0.005", "0.6", "expanded_uncertainty", "0.6 of 0.985"),
        ("0.005", "[0.1, 0.1, 0.1]", "expanded_uncertainty", "three"),
        (
            "expanded_uncertainty = 0.005\n",
            "",
            "expanded_uncertainty",
            "nothing",
        ),
        (
            "k = 2",
            "k = 2\nbands_nm = [[400, 700]]",
            "bands_nm",
            "wavelengths",
        ),
    ] {
        refused(&WHITE.replace(from, to), "", field, found);
    }
}

#[test]
fn an_angular_behaviour_that_none_has_is_refused_by_its_field() {
    let each = |wrong: &str| format!("{ANGULAR}\n").replace("correlation = 0.5", wrong);
    refused(WHITE, &each("correlation = 1.5"), "angular.correlation", "1.5");
    refused(
        WHITE,
        &each("shape = 1"),
        "angular.shape",
        "unknown field `shape`",
    );
    let alone = "[angular]\nstandard_uncertainty = 0.01";
    refused(WHITE, alone, "angular.to_deg", "nothing");
    refused(
        WHITE,
        &alone.replace("0.01", "0"),
        "angular.standard_uncertainty",
        "0",
    );
    for (from, to, field, found) in [
        ("ratio = 1.04", "ratio = 0", "angular.values[0].ratio", "0"),
        (
            "outgoing_deg = 80",
            "outgoing_deg = 45",
            "angular.values[2].outgoing_deg",
            "45 again",
        ),
        (
            "outgoing_deg = 80",
            "outgoing_deg = 91",
            "angular.values[2].outgoing_deg",
            "91",
        ),
        (
            "incident_deg = 60",
            "incident_deg = -60",
            "angular.values[3].incident_deg",
            "-60",
        ),
    ] {
        refused(WHITE, &ANGULAR.replacen(from, to, 1), field, found);
    }
}

#[test]
fn an_identity_that_is_none_is_refused_by_its_field() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("plate.toml");
    for (from, to, field, found) in [
        ("version = 1", "version = 2", "version", "2"),
        ("2026-02-17", "2027-02-17", "expires", "2027-02-17"),
        ("\"2027-02-17\"", "\"17.2.2027\"", "expires", "`17.2.2027`"),
        (
            "\"2027-02-17\"",
            "2027-02-17T10:00:00Z",
            "expires",
            "`2027-02-17T10:00:00Z`",
        ),
        ("\"plate\"", "\" \"", "name", "` `"),
        ("\"plate\"", "\"a\\u001Bb\"", "name", "`a\\u{1b}b`"),
    ] {
        std::fs::write(&path, file(WHITE, "").replacen(from, to, 1)).unwrap();
        let error = Certified::open(&path).unwrap_err().to_string();
        assert!(
            error.contains(&format!("plate.toml, {field}: expected "))
                && error.contains(&format!("found {found}")),
            "{field}, {found}: {error}"
        );
    }
    std::fs::write(&path, "version = ").unwrap();
    let error = Certified::open(&path).unwrap_err().to_string();
    assert!(error.contains("plate.toml, line 1, column"), "{error}");
    assert!(
        parse("none.toml")
            .unwrap_err()
            .to_string()
            .contains("none.toml: expected a readable file")
    );
}

#[test]
fn the_example_is_a_certificate_and_each_of_its_alternatives_too() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/standard.toml");
    let found = certificate_of(path).unwrap().unwrap();
    assert!(parse(path).unwrap().is_isotropic() && found.is_grey());
    assert_eq!(found.standard().named, "standard.toml");
    assert!(certificate_of("lambert:0.98").unwrap().is_none());
    // What stands behind three blanks of a comment is TOML too.
    let text = std::fs::read_to_string(path).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let other = folder.path().join("other.toml");
    let lines = text.lines().filter_map(|line| match line.strip_prefix("#   ") {
        Some(code) => (!code.starts_with("quantity")).then_some(code),
        None => (!line.starts_with("value =") && !line.starts_with("expanded_uncertainty")).then_some(line),
    });
    std::fs::write(&other, lines.collect::<Vec<_>>().join("\n")).unwrap();
    let all = Certified::open(&other).unwrap();
    assert!(
        (0.5..1.0).contains(&(100.0 * all.standard().standard_uncertainty)),
        "{all:?}"
    );
}

/// The mean of certificates of which each has this head, by number.
fn mean(heads: &[&str], are_independent: bool) -> Result<(Mean, Certified), SampleError> {
    let folder = tempfile::tempdir().unwrap();
    let paths: Vec<_> = heads
        .iter()
        .enumerate()
        .map(|(number, head)| {
            let path = folder.path().join(format!("{number}.toml"));
            let head = format!("serial = \"S1\"\n{head}");
            std::fs::write(
                &path,
                file(&head, ANGULAR).replace("\"17\"", &format!("\"A-{number}\"")),
            )
            .unwrap();
            path
        })
        .collect();
    let mean = mean_of(&paths, are_independent)?;
    let path = folder.path().join("mean.toml");
    std::fs::write(&path, &mean.text).unwrap();
    let certified = Certified::open(&path)?;
    Ok((mean, certified))
}

#[test]
fn certificates_of_one_plate_are_weighed_and_scatter_counts() {
    let stating = |value: f64, u: f64| {
        format!(
            "quantity = \"reflectance\"\ngeometry = \"8:di\"\nvalue = {value}\nexpanded_uncertainty = {}\nk = 2.5",
            2.5 * u
        )
    };
    let known = |heads: &[&str], are_independent| {
        let (mean, certified) = mean(heads, are_independent).unwrap();
        let certificate = certified.standard().certificate.clone().unwrap();
        assert!(
            certificate.number.starts_with("mean of A-0"),
            "{}",
            certificate.number
        );
        assert_eq!(certificate.expires.unwrap().to_string(), "2027-02-17");
        (
            certificate.value[0],
            certificate.standard_uncertainty[0],
            mean.birge_ratio,
        )
    };
    // Three that agree: 1/u² = 1, 1 and 4 of (0.002)⁻².
    let agreeing = [
        stating(0.980, 0.002),
        stating(0.982, 0.002),
        stating(0.981, 0.001),
    ];
    let agreeing: Vec<&str> = agreeing.iter().map(String::as_str).collect();
    let (value, u, birge) = known(&agreeing, true);
    assert!((value - 0.981).abs() < 1e-12 && birge < 1.0, "{value} {birge}");
    assert!((u - 0.002 / 6_f64.sqrt()).abs() < 1e-12, "{u}");
    assert!((known(&agreeing, false).1 - 0.001).abs() < 1e-12);
    // Two that are 2.5 standard uncertainties of their difference apart.
    let apart = [
        stating(0.980, 0.002),
        stating(0.980 + 0.005 * 2_f64.sqrt(), 0.002),
    ];
    let (_, u, birge) = known(&[&apart[0], &apart[1]], true);
    assert!(
        (birge - 2.5).abs() < 1e-9 && (u - 2.5 * 0.002 / 2_f64.sqrt()).abs() < 1e-12,
        "{birge} {u}"
    );
    // Angular behaviour is that of all.
    let (_, certified) = mean(&[&apart[0], &apart[1]], false).unwrap();
    assert_eq!(
        certified.standard().angular,
        of(WHITE, ANGULAR).unwrap().standard().angular
    );
}

#[test]
fn spectra_and_channels_are_weighed_one_by_one() {
    let rgb = |value: f64| {
        format!(
            "quantity = \"brdf\"\ngeometry = \"0/45\"\nvalue = [{value}, 0.3, 0.2]\nexpanded_uncertainty = 0.004\nk = 2"
        )
    };
    let (_, certified) = mean(&[&rgb(0.301), &rgb(0.303)], true).unwrap();
    let certificate = certified.standard().certificate.as_ref().unwrap();
    for (found, expected) in certificate.value.iter().zip([0.302, 0.3, 0.2]) {
        assert!((found - expected).abs() < 1e-12, "{found}");
    }
    let spectrum = |value: f64| {
        format!(
            "quantity = \"reflectance\"\ngeometry = \"8/h\"\nk = 2\nbands_nm = [[450, 600]]\nspectrum = [\n\
             {{ wavelength_nm = 400, value = {value}, expanded_uncertainty = 0.004 }},\n\
             {{ wavelength_nm = 700, value = {value}, expanded_uncertainty = 0.004 }},\n]"
        )
    };
    let (mean, certified) = mean(&[&spectrum(0.950), &spectrum(0.952)], true).unwrap();
    assert!(
        (certified.standard().certificate.as_ref().unwrap().value[0] - 0.951).abs() < 1e-12,
        "{}",
        mean.text
    );
}

#[test]
fn certificates_that_are_no_basis_of_a_mean_are_refused_by_name() {
    let other = |from: &str, to: &str| WHITE.replace(from, to);
    for (heads, field) in [
        (
            [WHITE.to_owned(), WHITE.to_owned(), other("0.985", "0.955")],
            "2.toml, value",
        ),
        (
            [other("0.985", "0.955"), WHITE.to_owned(), WHITE.to_owned()],
            "0.toml, value",
        ),
        (
            [WHITE.to_owned(), WHITE.to_owned(), other("8/h", "10/h")],
            "2.toml, geometry",
        ),
        (
            [
                WHITE.to_owned(),
                other("value = 0.985", "value = [0.985, 0.985, 0.985]"),
                WHITE.to_owned(),
            ],
            "1.toml, value",
        ),
    ] {
        let heads: Vec<&str> = heads.iter().map(String::as_str).collect();
        let error = mean(&heads, false).unwrap_err().to_string();
        let (name, field) = field.split_once(", ").unwrap();
        assert!(error.contains(name) && error.contains(field), "{error}");
    }
    assert!(
        mean(&[WHITE], false)
            .unwrap_err()
            .to_string()
            .contains("two or more")
    );
}
