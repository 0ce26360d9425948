//! What the pixels of the projector shine, lit and black, and what of it the camera gets without the sample.

use crate::instrument::optics::View;
use crate::virtual_rig::truth::Truth;

/// All of it, of every pixel of the projector, row by row.
#[derive(Debug)]
pub(in crate::virtual_rig) struct Shining {
    /// `E_p` of those that are lit, relative.
    pub(super) lit: Vec<f64>,
    /// The same of black ones; empty if there is none.
    pub(super) black: Vec<f64>,
    /// What of their light the camera gets without the sample, as f in sr⁻¹ × irradiance over intensity; empty if there is none.
    direct: Vec<f64>,
    /// The same of all black pixels together, × intensity.
    pub(super) black_direct: f64,
}

impl Shining {
    pub(in crate::virtual_rig) fn of(truth: &Truth) -> Self {
        let Truth { rig, flaws, .. } = truth;
        let (width_px, height_px) = View::projector(rig).size_px();
        let lit: Vec<f64> = flaws
            .intensity
            .over(width_px, height_px)
            .into_iter()
            .map(|field| field * rig.projector.irradiance)
            .collect();
        let black: Vec<f64> = if flaws.black_level > 0.0 {
            let field = flaws.black.over(width_px, height_px);
            let pixels = field.iter().zip(&lit);
            pixels
                .map(|(black, lit)| flaws.black_level * black * lit)
                .collect()
        } else {
            Vec::new()
        };
        let direct: Vec<f64> = if flaws.direct.share > 0.0 {
            // Of a white sample, 1/π of it; the hemisphere is all that the projector's pixels light.
            let each = flaws.direct.share * 2.0 / (width_px * height_px) as f64;
            let field = flaws.direct.projector.over(width_px, height_px);
            field.into_iter().map(|field| each * field).collect()
        } else {
            Vec::new()
        };
        let of_black = direct.iter().zip(&black);
        Self {
            black_direct: of_black.map(|(direct, intensity)| direct * intensity).sum(),
            lit,
            black,
            direct,
        }
    }

    /// What of the light of the pixels `lit` the camera gets without the sample.
    pub(super) fn direct(&self, lit: &[u32]) -> f64 {
        if self.direct.is_empty() {
            return 0.0;
        }
        let pixels = lit.iter().map(|&pixel| pixel as usize);
        pixels.map(|pixel| self.direct[pixel] * self.lit[pixel]).sum()
    }
}
