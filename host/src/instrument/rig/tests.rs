//! Presets are usable, files read back to the same numbers, and every bad file gets its sentence.

use std::path::Path;

use super::*;

fn text(name: &str) -> String {
    Rig::load(name).expect("presets are valid").to_toml()
}

/// The sentence that reading rcg-1-16bit gives after each `(from, to)` replacement, which must apply once.
pub(super) fn sentence(changes: &[(&str, &str)]) -> String {
    let mut text = include_str!("presets/rcg-1-16bit.toml").to_owned();
    for (from, to) in changes {
        assert_eq!(text.matches(from).count(), 1, "{from}");
        text = text.replace(from, to);
    }
    Rig::from_toml(&text, Path::new("lab/my.toml"))
        .expect_err("the file is bad")
        .to_string()
}

#[test]
fn every_preset_is_usable_and_bears_its_name() {
    for name in PRESETS {
        let rig = Rig::load(name).expect("usable");
        assert_eq!(rig.name, name);
        rig.validate().expect("usable");
    }
}

#[test]
fn a_rig_reads_back_to_the_same_numbers() {
    for name in PRESETS {
        let rig = Rig::load(name).expect("usable");
        assert_eq!(
            Rig::from_toml(&rig.to_toml(), Path::new("x")).expect("usable"),
            rig
        );
    }
}

#[test]
fn a_rig_is_read_from_a_file() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("lab.toml");
    std::fs::write(&path, text("dmd").replace("name = \"dmd\"", "name = \"lab\"")).expect("written");
    assert_eq!(
        Rig::load(&path.display().to_string()).expect("usable").name,
        "lab"
    );
}

#[test]
fn optional_keys_have_defaults() {
    let optional = ["distortion", "offset_m", "rotation_deg"];
    let short: String = include_str!("presets/rcg-1-16bit.toml")
        .split_inclusive('\n')
        .filter(|line| !optional.iter().any(|key| line.starts_with(key)))
        .filter(|line| !line.starts_with("[wire]") && !line.starts_with("half_width"))
        .scan(0, |azimuths, line| {
            // The second azimuth is the wire's.
            *azimuths += i32::from(line.starts_with("azimuth_deg"));
            Some(if *azimuths == 2 && line.starts_with("azimuth_deg") {
                ""
            } else {
                line
            })
        })
        .collect();
    let rig = Rig::from_toml(&short, Path::new("x")).expect("usable");
    let whole = Rig::load("rcg-1-16bit").expect("usable");
    assert_eq!(rig, Rig { wire: None, ..whole });
}

#[test]
fn the_paces_of_the_presets() {
    let pace = |name: &str| {
        let rig = Rig::load(name).expect("usable");
        rig.step_period_s(rig.camera.exposure_s)
    };
    let minutes = pace("rcg-1-16bit") * 32_400.0 / 60.0;
    assert!((minutes - 50.0).abs() < 0.02, "{minutes}");
    assert!((pace("rcg-3") - 1.0 / 60.0).abs() < 1e-7, "one frame of 60 Hz");
    assert!((pace("dmd") - 105e-6).abs() < 1e-12, "one pattern of the DMD");
}

#[test]
fn a_camera_that_cannot_overlap_waits_for_its_read_out() {
    let mut rig = Rig::load("dmd").expect("usable");
    rig.projector.min_period_s = 1e-6;
    assert!((rig.step_period_s(1e-4) - 110e-6).abs() < 1e-12);
    rig.camera.overlap = false;
    assert!((rig.step_period_s(1e-4) - 125e-6).abs() < 1e-12);
    rig.camera.overlap = true;
    rig.camera.readout_s = 1.0;
    assert!((rig.step_period_s(1e-4) - 1.0).abs() < 1e-12);
}

#[test]
fn a_smaller_image_shows_the_same_directions() {
    use crate::instrument::optics::View;
    let mut wide = Rig::load("rcg-1-16bit").expect("usable");
    wide.camera.lens.width_px = 3000;
    wide.camera.lens.centre_px = [1490.0, 1030.0];
    wide.camera.lens.distortion = [-0.2, 0.1, 0.001, 0.002, 0.0];
    let small = wide.with_image_size(96).expect("usable");
    assert_eq!(
        (small.camera.lens.width_px, small.camera.lens.height_px),
        (96, 96)
    );
    let (wide, small) = (View::camera(&wide), View::camera(&small));
    let w = crate::hemisphere::direction::from_degrees(55.0, 30.0);
    let (in_wide, in_small) = (wide.pixel(w).expect("seen"), small.pixel(w).expect("seen"));
    assert!(((in_wide.x - 476.0) * 96.0 / 2048.0 - in_small.x).abs() < 1e-9);
    assert!((in_wide.y * 96.0 / 2048.0 - in_small.y).abs() < 1e-9);
}

#[test]
fn an_image_of_no_pixels_is_refused() {
    let rig = Rig::load("rcg-1-16bit").expect("usable");
    assert_eq!(
        rig.with_image_size(0).expect_err("no image").to_string(),
        "rcg-1-16bit: image size: expected 1 to 2048 pixels, as many as the camera has, found 0"
    );
}

#[test]
fn a_missing_file_is_named() {
    let message = Rig::load("rcg-9").expect_err("no such rig").to_string();
    let expected = "rcg-9: expected a readable rig file (TOML) or one of the presets rcg-1, rcg-1-16bit, rcg-2, rcg-3, dmd, found: \
                    No such file or directory";
    assert!(message.starts_with(expected), "{message}");
    assert!(Rig::load("/").is_err());
    assert!(Rig::load("").is_err());
}

#[test]
fn mistakes_of_syntax_have_line_and_column() {
    assert_eq!(
        Rig::from_toml("name = \"x\"\n[mirror\na_m = 1", Path::new("my.toml"))
            .expect_err("bad")
            .to_string(),
        "my.toml: line 2, column 8: expected `]`, found unclosed table"
    );
    let message = sentence(&[("bits = 16 ", "bits == 12 ")]);
    assert!(message.starts_with("lab/my.toml: line "), "{message}");
}

#[test]
fn the_table_of_a_mistake_is_named_wherever_it_stands() {
    let message = |text: &str| {
        Rig::from_toml(text, Path::new("my.toml"))
            .expect_err("bad")
            .to_string()
    };
    let missing = "expected a value, as the field is required, found nothing";
    assert_eq!(message(""), format!("my.toml: name: {missing}"));
    assert_eq!(
        message("[mirror]\na_m = 1\n"),
        format!("my.toml: mirror.b_m: {missing}")
    );
    assert_eq!(
        message("mirror = 3\n"),
        "my.toml: mirror: expected a table, found integer `3`"
    );
    let nameless = text("rcg-1-16bit").replacen("name = \"rcg-1-16bit\"", "", 1);
    assert_eq!(
        message(nameless.trim_start()),
        format!("my.toml: name: {missing}")
    );
    let lines = "name = \"x\"\n[camera.lens]\ncentre_px = [\n  1.0,\n  \"b\",\n]\n";
    assert_eq!(
        message(lines),
        "my.toml: camera.lens.centre_px: expected a number, found string \"b\""
    );
}

/// What is replaced in the rig file, by what, and the sentence about it.
const MISTAKES: &[(&str, &str, &str)] = &[
    (
        "hole_deg =",
        "hole_dge =",
        "mirror.hole_dge: expected one of `a_m`, `b_m`, `rim_z_m`, `hole_deg`, `edge_rotation_deg`, found unknown field `hole_dge`",
    ),
    (
        "[light]",
        "[licht]",
        "licht: expected one of `name`, `mirror`, `sample`, `wire`, `obstacle`, `camera`, `projector`, `light`, `bands`, `trigger`, found unknown field `licht`",
    ),
    (
        "[camera.lens]\nwidth_px = 2048",
        "[camera.lense]\nwidth_px = 2048",
        "camera.lense: expected one of `driver`, `genicam`, `replay`, `channels`, `bits`, `full_well_e`, `read_noise_e`, `dark_dn`, `dark_current_e_per_s`, `exposure_s`, `exposure_delay_s`, `readout_s`, `overlap`, `lens`, `binned`, found unknown field `lense`",
    ),
    (
        "spot_deg = 1.0",
        "spot_deg = \"wide\"",
        "light.spot_deg: expected a number, found string \"wide\"",
    ),
    (
        "width_px = 1024",
        "width_px = 1024.5",
        "projector.lens.width_px: expected a whole number from 0 to 4294967295, found floating point `1024.5`",
    ),
    (
        "name = \"rcg-1-16bit\"",
        "name = \"rcg-1-16bit\"\nbaffle = 1",
        "baffle: expected one of `name`, `mirror`, `sample`, `wire`, `obstacle`, `camera`, `projector`, `light`, `bands`, `trigger`, found unknown field `baffle`",
    ),
    (
        "spot_deg = 1.0",
        "",
        "light.spot_deg: expected a value, as the field is required, found nothing",
    ),
    (
        "name = \"rcg-1-16bit\"",
        "",
        "name: expected a value, as the field is required, found nothing",
    ),
    (
        "bits = 16 ",
        "bits = \"12\" ",
        "camera.bits: expected a whole number from 0 to 255, found string \"12\"",
    ),
    (
        "bits = 16 ",
        "bits = 300 ",
        "camera.bits: expected a whole number from 0 to 255, found integer `300`",
    ),
    (
        "bits = 16 ",
        "bits = 14 ",
        "camera.bits: expected 8, 10, 12 or 16, found 14",
    ),
    (
        "channels = 3 ",
        "channels = 2 ",
        "camera.channels: expected 1 or 3, found 2",
    ),
    (
        "[light]",
        "[bands]\nname = [\"red\", \"green\"]\ncentre_nm = [620, 530]\nwidth_nm = [60, 70]\n[light]",
        "bands.name: expected 3, one for each channel, found 2",
    ),
    (
        "[light]",
        "[bands]\nname = [\"a\", \"b\", \"c\"]\ncentre_nm = [0.62, 0.53, 0.46]\nwidth_nm = [60, 70, 25]\n[light]",
        "bands.centre_nm: expected numbers from 200 to 2500 nanometres, found 0.62",
    ),
    (
        "[light]",
        "[bands]\nname = [\"a\", \"b\", \"a\"]\ncentre_nm = [620, 530, 460]\nwidth_nm = [60, 70, 25]\n[light]",
        "bands.name: expected names that differ, found \"a\" twice",
    ),
    (
        "[light]",
        "[bands]\nmade_by = \"projector\"\nname = [\"a\", \"b\", \"c\"]\ncentre_nm = [620, 530, 460]\nwidth_nm = [60, 70, 25]\n[light]",
        "bands.made_by: expected \"camera\", whose channels the bands are where it has more than one, found \"projector\"",
    ),
    (
        "[1024.0, 1024.0]",
        "[1024.0, 1024.0, 1.0]",
        "camera.lens.centre_px: expected an array of length 2, found an array of length 3",
    ),
    (
        "[512.0, 384.0]",
        "[512.0]",
        "projector.lens.centre_px: expected an array of length 2, found an array of length 1",
    ),
    (
        "[512.0, 384.0]",
        "[512.0, nan]",
        "projector.lens.centre_px: expected numbers from -1000000 to 1000000 pixels, found 512, NaN",
    ),
    (
        "b_m = 0.250",
        "b_m = 0.150",
        "mirror.b_m: expected more than mirror.a_m = 0.15 metres, found 0.15",
    ),
    (
        "b_m = 0.250",
        "b_m = 250",
        "mirror.b_m: expected a number from 0.001 to 10 metres, found 250",
    ),
    (
        "a_m = 0.150",
        "a_m = inf",
        "mirror.a_m: expected a number from 0.001 to 10 metres, found inf",
    ),
    (
        "rim_z_m = 0.18",
        "rim_z_m = 0.25",
        "mirror.rim_z_m: expected a number between -0.25 and 0.25 metres, exclusive, found 0.25",
    ),
    (
        "rim_z_m = 0.18",
        "rim_z_m = nan",
        "mirror.rim_z_m: expected a number between -0.25 and 0.25 metres, exclusive, found NaN",
    ),
    (
        "hole_deg = 27.0",
        "hole_deg = -1",
        "mirror.hole_deg: expected a number from 0 to 90 degrees, found -1",
    ),
    (
        "tilt_deg = 0.0",
        "tilt_deg = 91",
        "sample.tilt_deg: expected a number from -90 to 90 degrees, found 91",
    ),
    (
        "radius_m = 0.01",
        "radius_m = 0",
        "sample.radius_m: expected a number from 0.000001 to 1 metres, found 0",
    ),
    (
        "half_width_deg = 0.6",
        "half_width_deg = 60",
        "wire.half_width_deg: expected a number from 0 to 45 degrees, found 60",
    ),
    (
        "azimuth_deg = 270.0",
        "azimuth_deg = 999",
        "wire.azimuth_deg: expected a number from -360 to 360 degrees, found 999",
    ),
    (
        "full_well_e = 20000.0",
        "full_well_e = 0",
        "camera.full_well_e: expected a number from 1 to 1000000000 electrons, found 0",
    ),
    (
        "read_noise_e = 3.0",
        "read_noise_e = -3",
        "camera.read_noise_e: expected a number from 0 to 1000000 electrons, found -3",
    ),
    (
        "dark_dn = 64.0",
        "dark_dn = 65535",
        "camera.dark_dn: expected a number from 0 to 65534 digital numbers, found 65535",
    ),
    (
        "dark_current_e_per_s = 5.0",
        "dark_current_e_per_s = nan",
        "camera.dark_current_e_per_s: expected a number from 0 to 1000000000 electrons per second, found NaN",
    ),
    (
        "exposure_s = 0.0333",
        "exposure_s = 0",
        "camera.exposure_s: expected a number from 0.0000001 to 3600 seconds, found 0",
    ),
    (
        "exposure_delay_s = 5e-6",
        "exposure_delay_s = -1",
        "camera.exposure_delay_s: expected a number from 0 to 10 seconds, found -1",
    ),
    (
        "readout_s = 0.026",
        "readout_s = 61",
        "camera.readout_s: expected a number from 0 to 60 seconds, found 61",
    ),
    (
        "overlap = false",
        "overlap = 0",
        "camera.overlap: expected true or false, found integer `0`",
    ),
    (
        "settle_s = 0.0333",
        "settle_s = -1",
        "projector.settle_s: expected a number from 0 to 60 seconds, found -1",
    ),
    (
        "min_period_s = 0.0166667",
        "min_period_s = 0",
        "projector.min_period_s: expected a number from 0.0000001 to 60 seconds, found 0",
    ),
    (
        "irradiance = 1.0",
        "irradiance = 0",
        "projector.irradiance: expected a number from 0.000000001 to 1000000000 (relative intensity), found 0",
    ),
    (
        "full_scale_f_sr = 0.5",
        "full_scale_f_sr = 0",
        "light.full_scale_f_sr: expected a number from 0.000000001 to 1000000000 per steradian, found 0",
    ),
    (
        "spot_deg = 1.0",
        "spot_deg = 0",
        "light.spot_deg: expected a number from 0.001 to 90 degrees, found 0",
    ),
    (
        "width_px = 2048",
        "width_px = 0",
        "camera.lens.width_px: expected 1 to 32768 pixels, found 0",
    ),
    (
        "height_px = 768",
        "height_px = 99999",
        "projector.lens.height_px: expected 1 to 32768 pixels, found 99999",
    ),
    (
        "focal_px = 1638.4",
        "focal_px = -1638.4",
        "projector.lens.focal_px: expected a number from 0.001 to 10000000 pixels, found -1638.4",
    ),
    (
        "[0.0, 0.0, 0.0]       # optional: metres, optical",
        "[0.0, 0.0, 0.5] # ",
        "camera.lens.offset_m: expected an optical centre inside the mirror's ellipsoid, found 0, 0, 0.5 metres",
    ),
    (
        "[0.0, 0.0, 0.0]   # optional: degrees",
        "[0.0, 0.0, 400] # ",
        "camera.lens.rotation_deg: expected numbers from -360 to 360 degrees, found 0, 0, 400",
    ),
    (
        "[0.0, 0.0, 0.0, 0.0, 0.0]  # optional",
        "[-20, 0, 0, 0, 0] # ",
        "camera.lens.distortion: expected a distortion that can be undone everywhere in the image, found -20, 0, 0, 0, 0",
    ),
    (
        "[0.0, 0.0, 0.0, 0.0, 0.0]  # optional",
        "[inf, 0, 0, 0, 0] # ",
        "camera.lens.distortion: expected numbers from -1000 to 1000 (no unit), found inf, 0, 0, 0, 0",
    ),
];

#[test]
fn every_mistake_has_its_sentence() {
    for &(from, to, expected) in MISTAKES {
        assert_eq!(sentence(&[(from, to)]), format!("lab/my.toml: {expected}"));
    }
}

#[test]
fn a_pose_that_sees_nothing_is_refused_with_the_reason() {
    let blind = |device: &str, reason: &str| {
        format!(
            "lab/my.toml: {device}.lens: expected a pose, focal length and mirror with which some pixel sees the \
             hemisphere, found no measurable pixel, most of them for the reason \"{reason}\""
        )
    };
    let aside = ("[0.0, 0.0, 0.0]   # optional: degrees", "[0.0, 60.0, 0.0] # ");
    assert_eq!(sentence(&[aside]), blind("camera", "below horizon"));
    assert_eq!(
        sentence(&[("hole_deg = 27.0", "hole_deg = 90")]),
        blind("camera", "hole")
    );
    assert_eq!(
        sentence(&[("rim_z_m = 0.18", "rim_z_m = 0.2499")]),
        blind("camera", "beyond rim")
    );
    // Ten times the focal length sees only the hole.
    assert_eq!(
        sentence(&[("focal_px = 1638.4", "focal_px = 16384")]),
        blind("projector", "hole")
    );
    let beside = (
        "[0.0, 0.0, 0.0]       # optional: metres, optical",
        "[0.05, 0.0, 0.0] # ",
    );
    let small = ("radius_m = 0.01", "radius_m = 1e-6");
    assert_eq!(sentence(&[beside, small]), blind("camera", "off sample"));
}
