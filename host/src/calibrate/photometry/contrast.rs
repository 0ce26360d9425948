//! The contrast of the projector: light of all its pixels lit over that of all black.
//!
//! What all of them lit would show of the standard follows from light and throughput; what they show black is seen. Both are means
//! over the pixels of the camera that see the standard. Of what each of them sees not all is lit from everywhere.

use super::rank_one::{Fields, Seen};
use crate::brdf::sample::Sample;
use crate::hemisphere::direction::from_degrees;
use crate::instrument::frame_format::place_of_pixel;
use crate::instrument::optics::{DirectionTiles, View};
use crate::instrument::rig::Rig;

/// Side of the squares of the projector's pixels that count as one: light is smooth.
const COARSE_PX: u32 = 4;

/// The contrast, by what was `seen` of the `standard` on `rig` with these `fields`; `black` is what a black pattern adds to
/// darkness in `exposure_s` seconds, linear digital numbers. `None` if that is nothing.
pub(super) fn contrast(
    seen: &Seen,
    (rig, exposure_s): (&Rig, f64),
    fields: &Fields,
    standard: &dyn Sample,
    black: &[f64],
) -> Option<f64> {
    let projector = DirectionTiles::of(View::projector(&rig.with_coarse_projector(COARSE_PX)));
    let (width_px, height_px) = projector.view().size_px();
    let irradiance: f64 = (0..width_px * height_px)
        .filter_map(|pixel| {
            let (direction, sr) = projector.pixel(pixel)?;
            let [x, y] = place_of_pixel(pixel, width_px, height_px);
            Some(fields.intensity.at(x, y) * direction.z * sr)
        })
        .sum();
    // Standards are diffuse: one direction stands for all.
    let lobe = standard.incident(from_degrees(45.0, 0.0));
    let (mut lit, mut unlit) = (0.0, 0.0);
    for (pixel, [x, y], wo) in &seen.pixels {
        let f = lobe.f(*wo);
        let irradiance = irradiance * seen.mean_share(*pixel);
        for (channel, k) in fields.sensitivity.iter().enumerate() {
            lit += exposure_s * k * fields.throughput.at(*x, *y) * seen.f_of(f, channel) * irradiance;
            unlit += black[pixel * seen.channels + channel];
        }
    }
    (unlit > 0.0 && lit > unlit).then(|| lit / unlit)
}
