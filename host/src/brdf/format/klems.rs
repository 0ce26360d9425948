//! LBNL's BSDF documents (`.xml`) with the patches of Klems' full basis, which WINDOW and Radiance read: one number for each pair of 145
//! patches.
//!
//! Klems, "A new method for predicting the solar heat gain of complex fenestration systems", ASHRAE Transactions 100 (1994). Patches are
//! rings of polar angles that are divided evenly in azimuth, the first of each with its middle at φ = 0:
//!
//! | θ | 0–5° | 5–15° | 15–25° | 25–35° | 35–45° | 45–55° | 55–65° | 65–75° | 75–90° |
//! |---|---|---|---|---|---|---|---|---|---|
//! | patches | 1 | 8 | 16 | 20 | 24 | 24 | 24 | 16 | 12 |
//!
//! | element | content |
//! |---|---|
//! | `WindowElement/Optical/Layer/DataDefinition` | `IncidentDataStructure` Columns, `AngleBasis` with the rings |
//! | `…/WavelengthData/WavelengthDataBlock` | `WavelengthDataDirection` Reflection Back (the side of +z), `ScatteringDataType` BRDF |
//! | `ScatteringData` | 145 × 145 numbers in sr⁻¹: a row per patch of view, a column per patch of light |
//!
//! No cosine is in f, the mean over both patches by projected solid angle. The azimuth of a patch of light is that of where its light
//! goes: that of its source and 180°. One number for all colours: the luminance of the channels (Rec. 709 weights). A look-up is constant over patches.

use std::f64::consts::TAU;
use std::fmt::Write as _;
use std::path::Path;

use glam::DVec3;

use super::{ExportError, Exporting, Resolution, luminance, reading};
use crate::base::text::shown;
use crate::brdf::sample::{Outgoing, Sample, SampleError};
use crate::hemisphere::direction::{from_degrees, is_above_horizon, to_degrees};

/// Rings: where they end in degrees, and their patches.
const RINGS: [(f64, usize); 9] = [
    (5.0, 1),
    (15.0, 8),
    (25.0, 16),
    (35.0, 20),
    (45.0, 24),
    (55.0, 24),
    (65.0, 24),
    (75.0, 16),
    (90.0, 12),
];
/// Patches.
const PATCHES: usize = 145;
/// Directions over which a patch is averaged, along each of its sides.
const WITHIN: usize = 3;
/// Name of the basis.
const BASIS: &str = "LBNL/Klems Full";
/// Side of the layer that has +z.
const SIDE: &str = "Reflection Back";
/// Bytes of the largest file that is read.
const MOST_BYTES: u64 = 100_000_000;

/// The number of the patch that a direction is in.
fn patch(theta_deg: f64, phi_deg: f64) -> usize {
    let mut first = 0;
    for (end, count) in RINGS {
        if theta_deg < end || end >= 90.0 {
            let place = (phi_deg.rem_euclid(360.0) / 360.0 * count as f64 + 0.5) as usize % count;
            return first + place;
        }
        first += count;
    }
    PATCHES - 1
}

/// Directions (polar angle, azimuth, degrees) spread over a patch by projected solid angle.
fn directions(patch: usize) -> Vec<(f64, f64)> {
    let (mut first, mut begin) = (0, 0.0_f64);
    for (end, count) in RINGS {
        if patch < first + count {
            let squares = [begin, end].map(|deg| deg.to_radians().sin().powi(2));
            let middle = |n: usize| (n as f64 + 0.5) / WITHIN as f64;
            return (0..WITHIN * WITHIN)
                .map(|n| {
                    let sine = (squares[1] - squares[0])
                        .mul_add(middle(n % WITHIN), squares[0])
                        .sqrt();
                    let turn = ((patch - first) as f64 - 0.5 + middle(n / WITHIN)) / count as f64;
                    (sine.asin().to_degrees(), (turn * TAU).to_degrees())
                })
                .collect();
        }
        (first, begin) = (first + count, end);
    }
    Vec::new()
}

/// A material of such a document.
#[derive(Debug)]
pub struct Klems {
    /// f in sr⁻¹, [view, light].
    f: Vec<f64>,
}

impl Klems {
    /// Reads the file at `path`.
    ///
    /// # Errors
    /// [`SampleError`] with path, field, expected and found.
    pub fn open(path: &Path) -> Result<Self, SampleError> {
        let text = reading::text(path, MOST_BYTES)?;
        let wrong = |field: &str, expected: &str, found: &str| reading::wrong(path, field, expected, found);
        let document = roxmltree::Document::parse(&text)
            .map_err(|error| wrong("document", "XML", &shown(&error.to_string())))?;
        let named = |node: &roxmltree::Node, name: &str| node.tag_name().name() == name;
        let text_of = |node: roxmltree::Node, name: &str| -> Option<String> {
            let child = node.descendants().find(|child| named(child, name))?;
            Some(child.text()?.trim().to_owned())
        };
        let structure = text_of(document.root(), "IncidentDataStructure");
        if let Some(tree) = structure.filter(|name| name.starts_with("TensorTree")) {
            let expected = "Columns, as tensor trees are not read here";
            return Err(wrong("IncidentDataStructure", expected, &shown(&tree)));
        }
        let blocks: Vec<roxmltree::Node> = document
            .descendants()
            .filter(|node| named(node, "WavelengthData"))
            .filter(|node| text_of(*node, "Wavelength").is_none_or(|band| band == "Visible"))
            .filter(|node| text_of(*node, "WavelengthDataDirection").as_deref() == Some(SIDE))
            .collect();
        let [block] = blocks[..] else {
            let found = format!("{} of them", blocks.len());
            return Err(wrong(
                "WavelengthDataBlock",
                &format!("one of {SIDE}, visible"),
                &found,
            ));
        };
        for name in ["ColumnAngleBasis", "RowAngleBasis"] {
            let basis = text_of(block, name).unwrap_or_default();
            if basis != BASIS {
                return Err(wrong(name, BASIS, &shown(&basis)));
            }
        }
        let data =
            text_of(block, "ScatteringData").ok_or_else(|| wrong("ScatteringData", "numbers", "none"))?;
        let words = data
            .split(|c: char| c == ',' || c.is_whitespace())
            .filter(|word| !word.is_empty());
        let numbers: Result<Vec<f64>, _> = words.map(str::parse).collect();
        let f = numbers.map_err(|error| wrong("ScatteringData", "numbers", &error.to_string()))?;
        if f.len() != PATCHES * PATCHES || f.iter().any(|f| !f.is_finite()) {
            let expected = format!("{} finite numbers", PATCHES * PATCHES);
            return Err(wrong(
                "ScatteringData",
                &expected,
                &format!("{}, or others", f.len()),
            ));
        }
        Ok(Self { f })
    }
}

impl Sample for Klems {
    fn incident(&self, wi: DVec3) -> Box<dyn Outgoing + '_> {
        let (theta_deg, phi_deg) = to_degrees(wi);
        Box::new(Lit {
            table: self,
            column: is_above_horizon(wi).then(|| patch(theta_deg, phi_deg + 180.0)),
        })
    }

    fn is_isotropic(&self) -> bool {
        false
    }
}

struct Lit<'a> {
    table: &'a Klems,
    column: Option<usize>,
}

impl Outgoing for Lit<'_> {
    fn f(&self, wo: DVec3) -> [f64; 3] {
        let Some(column) = self.column.filter(|_| is_above_horizon(wo)) else {
            return [0.0; 3];
        };
        let (theta_deg, phi_deg) = to_degrees(wo);
        [self.table.f[patch(theta_deg, phi_deg) * PATCHES + column]; 3]
    }
}

/// Writes the document.
pub(super) fn write(exporting: &Exporting, resolution: Resolution) -> Result<(), ExportError> {
    exporting.check_visible()?;
    let all: Vec<Vec<(f64, f64)>> = (0..PATCHES).map(directions).collect();
    let each = (WITHIN * WITHIN).pow(2);
    let mut data = String::new();
    exporting.progress.begin("export", PATCHES, "patches");
    let rows_at_once = (exporting.at_once() / (PATCHES * each)).max(1);
    for first in (0..PATCHES).step_by(rows_at_once) {
        let rows = first..(first + rows_at_once).min(PATCHES);
        let pairs: Vec<(DVec3, DVec3)> = rows
            .clone()
            .flat_map(|row| (0..PATCHES).map(move |column| (row, column)))
            .flat_map(|(row, column)| {
                let views = &all[row];
                all[column].iter().flat_map(move |(theta_i, phi_i)| {
                    let wi = from_degrees(*theta_i, phi_i + 180.0);
                    views
                        .iter()
                        .map(move |(theta_o, phi_o)| (wi, from_degrees(*theta_o, *phi_o)))
                })
            })
            .collect();
        let values = exporting.values(&pairs)?;
        for (number, values) in values.chunks(each).enumerate() {
            let known: Vec<f64> = values.iter().flatten().map(|f| luminance(*f)).collect();
            let f = known.iter().sum::<f64>() / known.len().max(1) as f64;
            let end = if (number + 1) % PATCHES == 0 { ",\n" } else { ", " };
            write!(data, "{f:.6e}{end}").expect("strings take everything");
        }
        exporting.progress.reach(rows.end);
    }
    exporting.check_whole(resolution.zeros)?;
    exporting.write_whole(document(&data, &exporting.description()).as_bytes())
}

fn document(data: &str, description: &str) -> String {
    let (mut rings, mut begin) = (String::new(), 0.0);
    for (end, count) in RINGS {
        let middle = if begin > 0.0 {
            f64::midpoint(begin, end)
        } else {
            0.0
        };
        writeln!(
            rings,
            "<AngleBasisBlock><Theta>{middle}</Theta><nPhis>{count}</nPhis><ThetaBounds><LowerTheta>{begin}</LowerTheta>\
             <UpperTheta>{end}</UpperTheta></ThetaBounds></AngleBasisBlock>"
        )
        .expect("strings take everything");
        begin = end;
    }
    let name = description.replace('&', "&amp;").replace('<', "&lt;");
    format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<WindowElement xmlns=\"http://windows.lbl.gov\">\n\
         <WindowElementType>System</WindowElementType>\n<Optical>\n<Layer>\n<Material><Name>{name}</Name>\
         <Manufacturer>rcg</Manufacturer></Material>\n<DataDefinition>\n<IncidentDataStructure>Columns</IncidentDataStructure>\n\
         <AngleBasis><AngleBasisName>{BASIS}</AngleBasisName>\n{rings}</AngleBasis>\n</DataDefinition>\n<WavelengthData>\n\
         <LayerNumber>System</LayerNumber>\n<Wavelength unit=\"Integral\">Visible</Wavelength>\n<WavelengthDataBlock>\n\
         <WavelengthDataDirection>{SIDE}</WavelengthDataDirection>\n<ColumnAngleBasis>{BASIS}</ColumnAngleBasis>\n\
         <RowAngleBasis>{BASIS}</RowAngleBasis>\n<ScatteringDataType>BRDF</ScatteringDataType>\n<ScatteringData>\n{data}\
         </ScatteringData>\n</WavelengthDataBlock>\n</WavelengthData>\n</Layer>\n</Optical>\n</WindowElement>\n"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn directions_lie_in_their_patches() {
        for number in 0..PATCHES {
            for (theta_deg, phi_deg) in directions(number) {
                assert_eq!(patch(theta_deg, phi_deg), number);
            }
        }
    }
}
