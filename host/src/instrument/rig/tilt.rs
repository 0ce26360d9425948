//! A sample that the holder tilts on purpose.
//!
//! # Design
//! What a rig cannot see of a sample (the hole, the wire) it sees of the same sample tilted. A tilt is against the frame S
//! that the holder gives the sample in the rig, nominal or calibrated, as the tilts of the flat mirror are that calibrate it:
//! S · T · R_z(turn), where T leans the normal. Against the mirror's own axes it could not be stated: no calibration tells how
//! the mirror is turned about its axis. The holder turns the sample about the sample's centre, which stays where it is. So one
//! calibration serves captures at all tilts.

use std::fmt;
use std::str::FromStr;

use glam::{DMat3, DVec3, EulerRot};
use serde::de::{Error as _, Unexpected};
use serde::{Deserialize, Deserializer, Serialize};

use super::{Rig, RigError};
use crate::hemisphere::direction::from_degrees;
use crate::instrument::optics::SampleFrame;

/// Largest tilt, degrees.
const LARGEST_DEG: f64 = 80.0;
/// What a tilt is written as.
const EXPECTED: &str =
    "TILT:TOWARDS or TILT:TOWARDS:TURN in degrees, a tilt from 0 to 80, the others from -360 to 360";

/// How the holder tilts the sample against the rig's own sample frame, degrees.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(into = "String")]
pub struct Tilt {
    /// By how much the normal leans.
    pub tilt_deg: f64,
    /// The azimuth towards which it leans, about the normal of the untilted sample, from its +x towards +y.
    pub towards_deg: f64,
    /// Turn of the sample about its own normal.
    pub turn_deg: f64,
}

impl FromStr for Tilt {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers: Option<Vec<f64>> = text.split(':').map(|part| part.trim().parse().ok()).collect();
        let tilt = match numbers.as_deref() {
            Some(&[tilt_deg, towards_deg]) => [tilt_deg, towards_deg, 0.0],
            Some(&[tilt_deg, towards_deg, turn_deg]) => [tilt_deg, towards_deg, turn_deg],
            _ => [f64::NAN; 3],
        };
        let [tilt_deg, towards_deg, turn_deg] = tilt;
        let is_good = (0.0..=LARGEST_DEG).contains(&tilt_deg)
            && [towards_deg, turn_deg].iter().all(|deg| deg.abs() <= 360.0);
        is_good
            .then_some(Self {
                tilt_deg,
                towards_deg,
                turn_deg,
            })
            .ok_or_else(|| format!("expected {EXPECTED}"))
    }
}

impl Tilt {
    /// Whether a sample stands alike at both tilts; no tilt is one of 0°.
    #[must_use]
    pub fn is_same(one: Option<Self>, other: Option<Self>) -> bool {
        let normal =
            |tilt: Option<Self>| tilt.map_or(DVec3::Z, |tilt| from_degrees(tilt.tilt_deg, tilt.towards_deg));
        let turn_deg = |tilt: Option<Self>| tilt.map_or(0.0, |tilt| tilt.turn_deg);
        let turned_deg = (turn_deg(one) - turn_deg(other)).rem_euclid(360.0);
        (normal(one) - normal(other)).length() < 1e-9 && turned_deg.min(360.0 - turned_deg) < 1e-9
    }
}

impl fmt::Display for Tilt {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:{}:{}", self.tilt_deg, self.towards_deg, self.turn_deg)
    }
}

impl From<Tilt> for String {
    fn from(tilt: Tilt) -> Self {
        tilt.to_string()
    }
}

impl<'de> Deserialize<'de> for Tilt {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let text = String::deserialize(deserializer)?;
        text.parse()
            .map_err(|_| D::Error::invalid_value(Unexpected::Str(&text), &EXPECTED))
    }
}

impl Rig {
    /// The same rig with its sample tilted; without a tilt the same.
    ///
    /// # Errors
    /// [`RigError::Field`] if camera or projector see nothing of the tilted sample, or it leans by more than 90°.
    pub fn tilted(&self, tilt: Option<Tilt>) -> Result<Rig, RigError> {
        let mut rig = self.clone();
        let Some(tilt) = tilt else { return Ok(rig) };
        let turn = |deg: f64| DMat3::from_rotation_z(deg.to_radians());
        let lean = turn(tilt.towards_deg)
            * DMat3::from_rotation_y(tilt.tilt_deg.to_radians())
            * turn(-tilt.towards_deg);
        let frame = SampleFrame::of(&self.sample).s_to_m * lean * turn(tilt.turn_deg);
        let (roll_rad, tilt_rad, azimuth_rad) = frame.to_euler(EulerRot::XYZ);
        rig.sample.roll_deg = roll_rad.to_degrees();
        rig.sample.tilt_deg = tilt_rad.to_degrees();
        rig.sample.azimuth_deg = azimuth_rad.to_degrees();
        rig.validate()?;
        Ok(rig)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_is_read_again_and_the_rest_is_refused() {
        let tilt: Tilt = "51:90".parse().unwrap();
        assert_eq!(tilt.to_string(), "51:90:0");
        assert_eq!("51:90:0".parse(), Ok(tilt));
        let turned: Tilt = "7.5:-30:42".parse().unwrap();
        assert!((turned.turn_deg - 42.0).abs() < 1e-12);
        for text in ["", "51", "81:0", "-1:0", "5:400", "5:0:nan", "5:0:0:0", "a:b"] {
            let error = text.parse::<Tilt>().unwrap_err();
            assert!(error.starts_with("expected TILT:TOWARDS"), "{text}");
        }
    }

    #[test]
    fn tilts_are_the_same_if_the_sample_stands_alike() {
        let tilt = |text: &str| Some(text.parse::<Tilt>().unwrap());
        for (one, other, same) in [
            (None, None, true),
            (None, tilt("0:0"), true),
            (None, tilt("0:77:360"), true),
            (None, tilt("0:0:1"), false),
            (tilt("51:84:40"), tilt("51:84:40"), true),
            (tilt("51:84:40"), tilt("51:-276:-320"), true),
            (tilt("51:84:40"), tilt("51:84:41"), false),
            (tilt("51:84"), tilt("51:85"), false),
            (tilt("51:84"), None, false),
        ] {
            assert_eq!(Tilt::is_same(one, other), same, "{one:?} {other:?}");
            assert_eq!(Tilt::is_same(other, one), same, "{one:?} {other:?}");
        }
    }

    #[test]
    fn the_normal_leans_where_it_should_and_the_frame_turns_about_it() {
        let mut rig = Rig::load("rcg-1-16bit").unwrap();
        rig.sample.offset_m = [0.0, 0.0, 1e-3];
        let tilted = |text: &str| rig.tilted(Some(text.parse().unwrap())).unwrap();
        for (tilt_deg, towards_deg) in [(0.0, 0.0), (51.0, 90.0), (30.0, 200.0), (20.0, -45.0)] {
            let rig = tilted(&format!("{tilt_deg}:{towards_deg}:33"));
            let frame = SampleFrame::of(&rig.sample).s_to_m;
            let expected = from_degrees(tilt_deg, towards_deg);
            assert!(
                (frame.z_axis - expected).length() < 1e-12,
                "{tilt_deg} {towards_deg}"
            );
            // The centre stays where it was.
            assert!((DVec3::from(rig.sample.offset_m) - 1e-3 * DVec3::Z).length() < 1e-15);
            // A turn about the normal, and nothing else, is between it and the one that is not turned.
            let unturned = SampleFrame::of(&tilted(&format!("{tilt_deg}:{towards_deg}")).sample).s_to_m;
            let turn = (unturned.transpose() * frame).x_axis;
            assert!((turn - from_degrees(90.0, 33.0)).length() < 1e-12);
        }
        assert_eq!(rig.tilted(None).unwrap(), rig);
    }

    #[test]
    fn a_mirror_turned_about_its_axis_is_no_other_one_to_a_tilted_sample() {
        // What no calibration can tell apart: all of the rig turned about the mirror's axis, the sample with it.
        let rig = Rig::load("rcg-1-16bit").unwrap();
        let mut turned = rig.clone();
        turned.sample.azimuth_deg += 5.0;
        turned.wire.as_mut().unwrap().azimuth_deg += 5.0;
        let tilt = Some("40:100:20".parse().unwrap());
        let about_axis = DMat3::from_rotation_z(5_f64.to_radians());
        let (one, other) = (rig.tilted(tilt).unwrap(), turned.tilted(tilt).unwrap());
        let frames = [&one, &other].map(|rig| SampleFrame::of(&rig.sample).s_to_m);
        assert!(
            (about_axis * frames[0] - frames[1])
                .to_cols_array()
                .iter()
                .all(|part| part.abs() < 1e-12)
        );
    }

    #[test]
    fn tilts_add_to_what_calibration_found() {
        let mut rig = Rig::load("rcg-2").unwrap();
        rig.sample.roll_deg = 1.5;
        rig.sample.azimuth_deg = 12.0;
        let before = SampleFrame::of(&rig.sample).s_to_m;
        let tilted = rig.tilted(Some("10:180".parse().unwrap())).unwrap();
        let after = SampleFrame::of(&tilted.sample).s_to_m;
        let lean = DMat3::from_rotation_y(-10_f64.to_radians());
        assert!(
            (after - before * lean)
                .to_cols_array()
                .iter()
                .all(|part| part.abs() < 1e-12)
        );
    }
}
