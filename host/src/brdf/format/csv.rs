//! Tables of text (`.csv`): a row per pair of directions, what each column is in its name, and lines that begin with # before them.
//!
//! `theta_i_deg, phi_i_deg, theta_o_deg, phi_o_deg, f_r_per_sr, f_g_per_sr, f_b_per_sr, u_r_per_sr, u_g_per_sr, u_b_per_sr, provenance`: f has
//! no cosine in it; u is its standard uncertainty (k = 1), nothing where nobody states one. Pairs without a value are left out. Only written:
//! nothing says in which order rows stand.

use std::io::{BufWriter, Write as _};

use super::table::Axes;
use super::{ExportError, Exporting, Resolution};

/// Step of the angles if nobody says otherwise, degrees; never finer than the source.
const STEP_DEG: f64 = 15.0;

/// Writes the table: of the incident direction (polar angle, azimuth, degrees) that `resolution` names, or of all.
pub(super) fn write(exporting: &Exporting, resolution: Resolution) -> Result<(), ExportError> {
    let mut axes = Axes::of(exporting, resolution, STEP_DEG, false)?;
    if let Some([theta_deg, phi_deg]) = resolution.incident_deg {
        (axes.theta_i, axes.phi_i) = (vec![theta_deg], vec![phi_deg]);
    }
    let failed = |error| exporting.failed(error);
    let mut file = BufWriter::new(exporting.create()?);
    let head = format!(
        "# {}\n# f in 1/sr, without the cosine; u: standard uncertainty (k = 1)\ntheta_i_deg,phi_i_deg,theta_o_deg,phi_o_deg,f_r_per_sr,\
         f_g_per_sr,f_b_per_sr,u_r_per_sr,u_g_per_sr,u_b_per_sr,provenance\n",
        crate::base::text::plain(&exporting.description())
    );
    file.write_all(head.as_bytes()).map_err(failed)?;
    let number = |value: &f32| {
        if value.is_nan() {
            String::new()
        } else {
            format!("{value:.6e}")
        }
    };
    axes.scan(exporting, |range, pairs| {
        for (place, entry) in range.zip(exporting.entries(pairs)?) {
            let Some(entry) = entry else { continue };
            let angles = axes.angles(place).map(|deg| deg.to_string());
            let values: Vec<String> = entry.f.iter().chain(&entry.sigma).map(number).collect();
            writeln!(
                file,
                "{},{},{}",
                angles.join(","),
                values.join(","),
                entry.origin()
            )
            .map_err(failed)?;
        }
        Ok(())
    })?;
    exporting.finish(file)
}
