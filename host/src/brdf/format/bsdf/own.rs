//! The tables of a tensor file that is exported again, as they are.

use std::ops::Range;

use super::choice::{Form, Tabulation};
use super::facets::Facets;
use super::{Entry, Layout, Slices};
use crate::brdf::format::{ExportError, Exporting, Resolution, luminance};
use crate::brdf::sample::MeasuredRgl;
use crate::brdf::sample::rgl::Content;

/// Writes the tables of what is exported if that is a tensor file and nobody asked for other tables; `None` if not.
pub(super) fn write(
    exporting: &Exporting,
    resolution: Resolution,
) -> Result<Option<Tabulation>, ExportError> {
    let is_asked = resolution.form.is_some() || resolution.side > 0 || resolution.step_deg > 0.0;
    let tensor = exporting.tensor().filter(|_| !is_asked);
    // Renderers take squares only.
    let is_square = |content: &Content| content.rgb.rows == content.rgb.columns;
    let Some(content) = tensor.map(MeasuredRgl::content).filter(is_square) else {
        return Ok(None);
    };
    let none = Facets::none();
    let [ndf, sigma] = content.facets.unwrap_or([&none.ndf, &none.sigma]);
    let side = content.rgb.rows;
    let layout = Layout {
        phi_i: content.phi_i,
        theta_i: content.theta_i,
        ndf,
        sigma,
        warp: content
            .vndf
            .first()
            .map_or([2, 2], |density| [density.rows(), density.columns()]),
        side,
    };
    super::stream(exporting, resolution.zeros, &layout, &content)?;
    exporting.counted(layout.slices() * side * side);
    Ok(Some(Tabulation {
        form: Form::Own,
        side,
        incident: [layout.phi_i.len(), layout.theta_i.len()],
        why: "what is exported is such a file, whose own tables lose nothing".to_owned(),
    }))
}

impl Slices for Content<'_> {
    fn vndf(&self, slice: usize) -> Vec<f32> {
        self.vndf[slice].densities().collect()
    }

    fn entries(&self, slices: Range<usize>) -> Result<Vec<Entry>, ExportError> {
        let values = slices.flat_map(|slice| self.rgb.slice(slice));
        Ok(values.map(|rgb| (*rgb, luminance(*rgb) as f32)).collect())
    }
}
