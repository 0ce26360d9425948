//! The parts of a rig as its TOML file names them.
//!
//! # Design
//! Plain data with public fields; the unit is the suffix of the name. Arrays must have exactly the stated
//! length: serde's own arrays silently drop what is too much in a TOML file.

use serde::de::{Deserializer, Error};
use serde::{Deserialize, Serialize};

use crate::instrument::bands::Bands;
use crate::instrument::drivers::{
    CameraDriver, Dlpc900, Files, Genicam, ProjectorDriver, Replay, Trigger, Window,
};

/// A complete instrument.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Rig {
    /// Name for reports and manifests.
    pub name: String,
    /// The ellipsoidal mirror.
    pub mirror: Mirror,
    /// How the sample stands at the mirror's focus F1.
    pub sample: Sample,
    /// The wire that holds the sample, if it is in the way of the light.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub wire: Option<Wire>,
    /// What else is in the way of the light: clamps, cables, dust on the mirror.
    #[serde(default, rename = "obstacle", skip_serializing_if = "Vec::is_empty")]
    pub obstacles: Vec<Obstacle>,
    /// The camera near F2.
    pub camera: CameraPart,
    /// The projector near F2, seen through the beam splitter.
    pub projector: ProjectorPart,
    /// How strong the light is and how large one pattern's spot.
    pub light: Light,
    /// The bands of light that channels stand for, if that is known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bands: Option<Bands>,
    /// The trigger box of a real instrument.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub trigger: Option<Trigger>,
}

/// The mirror: the part z ≥ `rim_z_m` of x²/a² + y²/a² + z²/b² = 1, less a hole around the vertex (0, 0, b).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Mirror {
    /// Semi-axis a across the mirror's axis, metres.
    pub a_m: f64,
    /// Semi-axis b along the mirror's axis, metres; larger than a.
    pub b_m: f64,
    /// Height of the rim in the mirror frame, metres; the mirror is what lies above it.
    pub rim_z_m: f64,
    /// Half angle of the hole seen from F1, about the mirror's axis, degrees; 0 = no hole.
    pub hole_deg: f64,
    /// Rotations about x and y of the machined edges, hole and rim, against the ellipsoid's own axis, degrees; the one
    /// about y acts first.
    #[serde(default, deserialize_with = "exactly")]
    pub edge_rotation_deg: [f64; 2],
}

/// How the sample frame stands in the mirror frame.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Sample {
    /// Angle from the mirror's axis to the sample's normal, towards the mirror's +x, degrees.
    pub tilt_deg: f64,
    /// Rotation of the sample's +x about its normal, degrees.
    pub azimuth_deg: f64,
    /// Rotation of the tilted sample about the mirror's x, degrees: what leans its normal out of the x–z plane.
    #[serde(default)]
    pub roll_deg: f64,
    /// Centre of the sample minus F1 in the mirror frame, metres.
    #[serde(default, deserialize_with = "exactly")]
    pub offset_m: [f64; 3],
    /// A viewing ray that meets the sample plane farther from the sample's centre than this misses it, metres.
    pub radius_m: f64,
}

/// The straight holder of the sample: a strip in front of the mirror seen from F1.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Wire {
    /// Direction of the strip about the mirror's axis, from the mirror's +x towards +y, degrees.
    pub azimuth_deg: f64,
    /// Half the angular width of the strip seen from F1, degrees.
    pub half_width_deg: f64,
}

/// Something dark in front of the mirror, which hides the directions within a polygon seen from F1.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Obstacle {
    /// What it is, for people.
    pub name: String,
    /// Corners, one after the other: angle from the mirror's +z and azimuth about it from +x towards +y, mirror frame, degrees.
    pub outline_deg: Vec<[f64; 2]>,
}

/// A pinhole with distortion and a pose, the same for camera and projector.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Lens {
    /// Width of the image, pixels.
    pub width_px: u32,
    /// Height of the image, pixels.
    pub height_px: u32,
    /// Focal length, pixels.
    pub focal_px: f64,
    /// Principal point (u, v), pixels; the centre of the first pixel is 0.5.
    #[serde(deserialize_with = "exactly")]
    pub centre_px: [f64; 2],
    /// Brown–Conrady distortion k1, k2, p1, p2, k3, for image coordinates divided by the focal length.
    #[serde(default, deserialize_with = "exactly")]
    pub distortion: [f64; 5],
    /// Optical centre minus F2 in the mirror frame, metres.
    #[serde(default, deserialize_with = "exactly")]
    pub offset_m: [f64; 3],
    /// Rotations about x, y, z of the device from "looks along the mirror's +z, u along +x, v along +y",
    /// degrees; the one about z acts first, then y, then x.
    #[serde(default, deserialize_with = "exactly")]
    pub rotation_deg: [f64; 3],
    /// Whether the image is mirrored left to right, as a beam splitter does to what it reflects: u along −x.
    #[serde(default, skip_serializing_if = "is_false")]
    pub mirrored: bool,
    /// Diameter of the pupil, metres; 0 stands for a point. Its image is what a pixel sees, or lights, of the sample.
    #[serde(default, skip_serializing_if = "is_point")]
    pub pupil_m: f64,
}

/// The camera: its lens, sensor and timing.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraPart {
    /// What drives it.
    #[serde(default, skip_serializing_if = "CameraDriver::is_virtual")]
    pub driver: CameraDriver,
    /// Settings of the driver `genicam`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub genicam: Option<Genicam>,
    /// Settings of the driver `replay`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub replay: Option<Replay>,
    /// Colour channels of its frames: 1 or 3. Results have as many, unless the projector makes the bands, see [`Rig::channels`].
    pub channels: u8,
    /// Bits of a digital number: 8, 10, 12 or 16.
    pub bits: u8,
    /// Electrons at saturation of the converter.
    pub full_well_e: f64,
    /// Standard deviation of the read-out, electrons.
    pub read_noise_e: f64,
    /// Digital number of a pixel without any charge.
    pub dark_dn: f64,
    /// Dark current, electrons per second and pixel.
    pub dark_current_e_per_s: f64,
    /// Default exposure time, seconds.
    pub exposure_s: f64,
    /// From the trigger edge to the start of the exposure, seconds.
    pub exposure_delay_s: f64,
    /// The camera is busy for this long after an exposure, seconds.
    pub readout_s: f64,
    /// Whether the camera can expose while it reads out.
    pub overlap: bool,
    /// Image size, projection and pose.
    pub lens: Lens,
    /// What stands behind a pixel of the image: the sensor's own pixel, unless this is the rig of a capture.
    #[serde(default, skip_serializing_if = "Binned::is_one")]
    pub binned: Binned,
}

/// The sensor's pixels behind one pixel of a [`CameraPart`]'s image.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Binned {
    /// How many: a pixel of the image is their mean.
    pub pixels: f64,
    /// Their converter's step, in electrons of one of them; 0 where the image's own step is the only one.
    pub step_e: f64,
    /// Their read noise, in electrons of one of them.
    pub read_noise_e: f64,
}

impl Binned {
    /// Whether it is a pixel of the sensor itself.
    fn is_one(&self) -> bool {
        *self == Self::default()
    }
}

impl Default for Binned {
    fn default() -> Self {
        Self {
            pixels: 1.0,
            step_e: 0.0,
            read_noise_e: 0.0,
        }
    }
}

/// The projector: its lens and timing.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ProjectorPart {
    /// What drives it.
    #[serde(default, skip_serializing_if = "ProjectorDriver::is_virtual")]
    pub driver: ProjectorDriver,
    /// Settings of the driver `files`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub files: Option<Files>,
    /// Settings of the driver `window`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub window: Option<Window>,
    /// Settings of the driver `dlpc900`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub dlpc900: Option<Dlpc900>,
    /// From the trigger edge until the new pattern is stable, seconds.
    pub settle_s: f64,
    /// Shortest time between two patterns, seconds.
    pub min_period_s: f64,
    /// Relative intensity `E_p` of every pixel.
    pub irradiance: f64,
    /// Full on over full off, as its data sheet has it; as black as one wants if that says nothing.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub contrast: Option<f64>,
    /// What makes its image.
    #[serde(default, skip_serializing_if = "Panel::is_liquid_crystal")]
    pub panel: Panel,
    /// Image size, projection and pose.
    pub lens: Lens,
}

/// What makes a projector's image.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Panel {
    /// Liquid crystal: a little of a change of light is left when a pattern counts as settled.
    #[default]
    LiquidCrystal,
    /// Micromirrors, of whose changes nothing is left.
    Mirrors,
}

impl Panel {
    #[expect(clippy::trivially_copy_pass_by_ref, reason = "serde passes a reference")]
    fn is_liquid_crystal(&self) -> bool {
        *self == Self::LiquidCrystal
    }
}

/// Strength and size of the light.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Light {
    /// BRDF in sr⁻¹ that just saturates the camera with the default exposure time and a spot of 1° diameter
    /// at normal incidence.
    pub full_scale_f_sr: f64,
    /// Diameter of the cone that one pattern lights, degrees; its solid angle is the same for all patterns.
    pub spot_deg: f64,
    /// How far light is polarised on the sample, and how far the camera prefers polarised light, all in all (k = 1).
    #[serde(default = "depolarised", skip_serializing_if = "is_depolarised")]
    pub polarisation: f64,
}

/// What depolarisers leave.
const fn depolarised() -> f64 {
    0.01
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde passes a reference")]
fn is_depolarised(degree: &f64) -> bool {
    degree.total_cmp(&depolarised()).is_eq()
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde passes a reference")]
fn is_false(value: &bool) -> bool {
    !value
}

/// Whether a diameter is that of a point: rigs of before there were pupils keep their hash.
#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde passes a reference")]
fn is_point(diameter_m: &f64) -> bool {
    *diameter_m == 0.0
}

/// Reads an array of exactly `N` numbers.
fn exactly<'de, D: Deserializer<'de>, const N: usize>(deserializer: D) -> Result<[f64; N], D::Error> {
    let numbers = Vec::<f64>::deserialize(deserializer)?;
    <[f64; N]>::try_from(numbers).map_err(|found| {
        D::Error::custom(format!(
            "an array of length {}, expected an array of length {N}",
            found.len()
        ))
    })
}
