//! Reflectance along a line of outgoing directions: f against the azimuth φr at one polar angle θr, or against θr in the plane of incidence.
//!
//! # Design
//! The circle is the way in which figure 16 of the RCG paper shows a cloth: one curve per incident direction, θr fixed. The plane is the
//! scan of classical gonioreflectometers (ASTM E2387-19): θr from −90 to 90°, positive on the side of the mirror direction. A
//! direction without a value is a gap in the curve and has its reason in the table. The table of a measurement has the standard
//! uncertainty of each value and where it is from; the chart shades the interval of k = 2. Scans of several sources stand in one chart.

use std::fmt::Write as _;

use glam::DVec3;

use crate::brdf::reflectance::{Reflectance, Value};
use crate::brdf::{Source, Stated};
use crate::hemisphere::direction::from_degrees;
use crate::judge::chart::{Axis, Chart, Curve, Scale};
use crate::judge::quantity::{Quantity, luma};
use crate::store::StoreError;

/// Incident directions of the paper's figure 16: polar angle and azimuth in degrees.
pub const INCIDENT_DEG: [(f64, f64); 3] = [(30.0, 0.0), (30.0, 45.0), (30.0, 90.0)];
/// Outgoing polar angle of that figure in degrees.
pub const THETA_R_DEG: f64 = 30.0;
/// Steps of θr in the plane of incidence in each degree, and the last θr in degrees.
const PER_DEGREE: i32 = 2;
const LAST_DEG: i32 = 89;
/// Letters of a source's name that a legend has room for.
const MOST_NAME: usize = 16;
/// Decades of a logarithmic axis at most.
const DECADES: i32 = 8;

/// Which outgoing directions are looked at.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Along {
    /// A circle: azimuths from 0 to 360°, both included, in so many steps.
    Circle {
        /// Polar angle of all of them in degrees.
        theta_r_deg: f64,
        /// Steps.
        steps: usize,
    },
    /// The plane of incidence: polar angles from −89 to 89° in steps of half a degree, positive on the side of the mirror direction.
    Plane,
}

impl Along {
    /// Of light from the azimuth `phi_i_deg`: place along the line, and the outgoing direction (θ, φ), degrees.
    fn places(self, phi_i_deg: f64) -> Vec<(f64, [f64; 2])> {
        match self {
            Self::Circle { theta_r_deg, steps } => (0..=steps)
                .map(|k| 360.0 * k as f64 / steps as f64)
                .map(|phi_deg| (phi_deg, [theta_r_deg, phi_deg]))
                .collect(),
            Self::Plane => (-LAST_DEG * PER_DEGREE..=LAST_DEG * PER_DEGREE)
                .map(|k| f64::from(k) / f64::from(PER_DEGREE))
                .map(|theta_deg| {
                    let phi_deg = if theta_deg < 0.0 {
                        phi_i_deg
                    } else {
                        phi_i_deg + 180.0
                    };
                    (theta_deg, [theta_deg.abs(), phi_deg.rem_euclid(360.0)])
                })
                .collect(),
        }
    }
}

/// One outgoing direction of a scan.
#[derive(Clone, Debug)]
struct Place {
    /// Along the line, degrees.
    at_deg: f64,
    /// Polar angle and azimuth in degrees.
    outgoing_deg: [f64; 2],
    /// What is stated, per channel, or why nothing is.
    value: Value,
    /// As that, what a measurement states of f.
    stated: Option<Stated>,
}

/// What one source shows.
#[derive(Clone, Debug)]
pub struct Scan {
    along: Along,
    quantity: Quantity,
    /// Per incident direction its angles (θ, φ) in degrees, and what is along the line.
    lines: Vec<((f64, f64), Vec<Place>)>,
    /// Where φ = 0 lies on the sample, in words, if the source says so.
    zero: Option<String>,
    is_stated: bool,
}

/// What a chart shows, and its expanded uncertainty (k = 2), if it is stated.
type Shown = (f64, Option<f64>);

/// Finds f of pairs of directions (incident, outgoing), and what is stated of it.
type Find<'a> = dyn Fn(&[(DVec3, DVec3)]) -> Result<Vec<(Value, Option<Stated>)>, StoreError> + 'a;

impl Scan {
    /// Looks the `quantity` of `source` up along a line for each of `incident_deg` (θ, φ in degrees).
    ///
    /// # Errors
    /// [`StoreError`] if the BRDF cannot be read.
    pub fn new(
        source: &Source,
        quantity: Quantity,
        incident_deg: &[(f64, f64)],
        along: Along,
    ) -> Result<Self, StoreError> {
        let Source::Measured(brdf) = source else {
            return Self::of(source.reflectance(), quantity, incident_deg, along);
        };
        let scan = Self::with(quantity, incident_deg, along, &|pairs| {
            let found = brdf.stated(pairs)?.into_iter();
            Ok(found
                .map(|found| (found.map(|found| found.f), found.ok()))
                .collect())
        })?;
        Ok(Self {
            is_stated: true,
            zero: Some(brdf.azimuth().zero()),
            ..scan
        })
    }

    /// As [`new`](Self::new), of anything that has values, without their uncertainties.
    ///
    /// # Errors
    /// [`StoreError`] if the BRDF cannot be read.
    pub fn of(
        material: &dyn Reflectance,
        quantity: Quantity,
        incident_deg: &[(f64, f64)],
        along: Along,
    ) -> Result<Self, StoreError> {
        Self::with(quantity, incident_deg, along, &|pairs| {
            Ok(material
                .values(pairs)?
                .into_iter()
                .map(|value| (value, None))
                .collect())
        })
    }

    /// The scan of what `find` says of f for pairs of directions.
    fn with(
        quantity: Quantity,
        incident_deg: &[(f64, f64)],
        along: Along,
        find: &Find<'_>,
    ) -> Result<Self, StoreError> {
        let line = |&(theta_deg, phi_deg): &(f64, f64)| {
            let wi = from_degrees(theta_deg, phi_deg);
            let places = along.places(phi_deg);
            let pairs: Vec<(DVec3, DVec3)> = places
                .iter()
                .map(|(_, [theta, phi])| (wi, from_degrees(*theta, *phi)))
                .collect();
            let found = find(&pairs)?;
            let place = |(at, (value, stated)): (usize, (Value, Option<Stated>))| {
                let factor = quantity.factor(pairs[at].1) as f32;
                let (at_deg, outgoing_deg) = places[at];
                Place {
                    at_deg,
                    outgoing_deg,
                    value: value.map(|f| f.map(|f| factor * f)),
                    stated,
                }
            };
            let shown = found.into_iter().enumerate().map(place).collect();
            Ok(((theta_deg, phi_deg), shown))
        };
        Ok(Self {
            along,
            quantity,
            lines: incident_deg.iter().map(line).collect::<Result<_, StoreError>>()?,
            zero: None,
            is_stated: false,
        })
    }

    /// All that it looked at.
    fn places(&self) -> impl Iterator<Item = &Place> {
        self.lines.iter().flat_map(|(_, places)| places)
    }

    /// Number of directions that were looked at.
    #[must_use]
    pub fn len(&self) -> usize {
        self.places().count()
    }

    /// Whether nothing was looked at.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.lines.is_empty()
    }

    /// Number of directions without a value.
    #[must_use]
    pub fn missing(&self) -> usize {
        self.places().filter(|place| place.value.is_err()).count()
    }

    /// Luma (BT.601) of what is at a place, and its expanded uncertainty (k = 2), if it is stated.
    fn shown(&self, place: &Place) -> Option<Shown> {
        let [theta_deg, phi_deg] = place.outgoing_deg;
        let factor = self.quantity.factor(from_degrees(theta_deg, phi_deg));
        // As if the channels had the same error.
        let expanded = place.stated.map(|stated| 2.0 * factor * luma(stated.sigma));
        Some((luma(place.value.ok()?), expanded))
    }

    /// The rows of a table, one per incident and outgoing direction; where there is no value, its reason. Each begins with `first`, and has
    /// the columns of uncertainties if the table has them.
    fn rows(&self, table: &mut String, first: &str, has_stated: bool) {
        for ((theta_i, phi_i), places) in &self.lines {
            for place in places {
                let [theta_r, phi_r] = place.outgoing_deg;
                write!(table, "{first}{theta_i},{phi_i},{theta_r},{phi_r},")
                    .expect("strings take everything");
                match &place.value {
                    Ok([r, g, b]) => write!(table, "{r:.6e},{g:.6e},{b:.6e},"),
                    Err(reason) => write!(table, ",,,{reason}"),
                }
                .expect("strings take everything");
                let factor = self.quantity.factor(from_degrees(theta_r, phi_r)) as f32;
                match place.stated {
                    _ if !has_stated => Ok(()),
                    None => write!(table, ",,,,"),
                    Some(stated) => {
                        let [r, g, b] = stated.sigma.map(|sigma| factor * sigma);
                        write!(table, ",{r:.3e},{g:.3e},{b:.3e},{}", stated.provenance.name())
                    }
                }
                .expect("strings take everything");
                table.push('\n');
            }
        }
    }
}

/// The chart of `scans`, each with the name of its source: along the same line, of the same quantity. Logarithmic if `log`.
///
/// # Panics
/// If there is none.
#[must_use]
pub fn chart(scans: &[(&str, Scan)], title: &str, log: bool) -> Chart {
    let Scan { along, quantity, .. } = scans[0].1;
    let lights = &scans[0].1.lines;
    let has_one_light = lights.len() == 1;
    let mut curves = Vec::new();
    for (source, scan) in scans {
        for ((theta, phi), places) in &scan.lines {
            let angles = format!("({theta}°, {phi}°)");
            let label = match (scans.len() > 1, has_one_light) {
                (false, _) => angles,
                (true, true) => shortened(source),
                (true, false) => format!("{} {angles}", shortened(source)),
            };
            let shown: Vec<(f64, Option<Shown>)> = places
                .iter()
                .map(|place| (place.at_deg, scan.shown(place)))
                .collect();
            let is_drawn = |value: &f64| !log || *value > 0.0;
            let band = |(value, expanded): Shown| {
                let expanded = expanded?;
                Some([value - expanded, value + expanded]).filter(|[_, high]| is_drawn(high))
            };
            curves.push(Curve {
                label,
                points: shown
                    .iter()
                    .map(|(at, shown)| (*at, shown.map(|one| one.0).filter(is_drawn)))
                    .collect(),
                band: shown
                    .iter()
                    .map(|(at, shown)| (*at, shown.and_then(band)))
                    .collect(),
            });
        }
    }
    let values = curves
        .iter()
        .flat_map(|curve| &curve.points)
        .filter_map(|point| point.1);
    let mut zeros: Vec<&String> = scans.iter().filter_map(|(_, scan)| scan.zero.as_ref()).collect();
    zeros.dedup();
    let zero = match zeros[..] {
        [zero] => format!("; {zero}"),
        _ => String::new(),
    };
    let (label, ticks): (String, Vec<f64>) = match along {
        Along::Circle { theta_r_deg, .. } => (
            format!("outgoing azimuth φr (°), θr = {theta_r_deg}°{zero}"),
            (0..=6).map(|k| f64::from(k) * 60.0).collect(),
        ),
        Along::Plane => (
            format!("outgoing θr in the plane of incidence, mirror side positive (°){zero}"),
            (-3..=3).map(|k| f64::from(k) * 30.0).collect(),
        ),
    };
    let y = if log {
        Axis::decades(&quantity.label(), values, DECADES)
    } else {
        Axis::covering(&quantity.label(), values.chain([0.0]))
    };
    Chart {
        title: title.to_owned(),
        x: Axis {
            label,
            ticks,
            scale: Scale::Linear,
        },
        y,
        legend: match &lights[..] {
            [((theta, phi), _)] if scans.len() > 1 => format!("incident ({theta}°, {phi}°)"),
            _ => "incident (θi, φi)".to_owned(),
        },
        marks: false,
        curves,
    }
}

/// The name of a source as a legend has room for it: the end of a path tells more than its beginning.
pub(crate) fn shortened(source: &str) -> String {
    match source.chars().count().checked_sub(MOST_NAME) {
        None | Some(0) => source.to_owned(),
        Some(more) => std::iter::once('…')
            .chain(source.chars().skip(more + 1))
            .collect(),
    }
}

/// The table of `scans`, each with the name of its source, which has a column if there are several.
///
/// # Panics
/// If there is none.
#[must_use]
pub fn csv(scans: &[(&str, Scan)]) -> String {
    let quantity = scans[0].1.quantity;
    let (name, unit) = (quantity.column(), quantity.column_unit());
    let columns = |before: &str| {
        ["r", "g", "b"]
            .map(|channel| format!("{before}_{channel}{unit}"))
            .join(",")
    };
    let has_stated = scans.iter().any(|(_, scan)| scan.is_stated);
    let uncertain = if has_stated {
        format!(",{},provenance", columns(&format!("u_{name}")))
    } else {
        String::new()
    };
    let is_one = scans.len() == 1;
    let mut table = format!(
        "{}theta_i_deg,phi_i_deg,theta_r_deg,phi_r_deg,{},reason{uncertain}\n",
        if is_one { "" } else { "source," },
        columns(name)
    );
    for (source, scan) in scans {
        let first = if is_one {
            String::new()
        } else {
            format!("\"{}\",", crate::base::text::plain(source).replace('"', "\"\""))
        };
        scan.rows(&mut table, &first, has_stated);
    }
    table
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::brdf::reflectance::Missing;
    use crate::brdf::sample::parse;
    use crate::instrument::optics::Unmeasurable;

    /// Lambert that cannot be seen for x > 0.
    struct Half;

    impl Reflectance for Half {
        fn values(&self, pairs: &[(DVec3, DVec3)]) -> Result<Vec<Value>, StoreError> {
            let hidden = Err(Missing::Outgoing(Unmeasurable::Hole));
            Ok(pairs
                .iter()
                .map(|pair| if pair.1.x > 0.0 { hidden } else { Ok([0.2; 3]) })
                .collect())
        }
    }

    #[test]
    fn a_cloth_is_as_bright_as_its_model_says() {
        let sample = parse("velvet").unwrap();
        let circle = Along::Circle {
            theta_r_deg: THETA_R_DEG,
            steps: 72,
        };
        let scan = Scan::of(&sample, Quantity::Brdf, &INCIDENT_DEG, circle).unwrap();
        let rows: Vec<Vec<f64>> = csv(&[("velvet", scan)])
            .lines()
            .skip(1)
            .map(|line| {
                line.split(',')
                    .take(5)
                    .map(|cell| cell.parse().unwrap())
                    .collect()
            })
            .collect();
        assert_eq!(rows.len(), 3 * 73);
        for row in rows {
            let f = sample.f(from_degrees(row[0], row[1]), from_degrees(row[2], row[3]))[0];
            assert!((row[4] / f - 1.0).abs() < 1e-5, "{row:?} {f}");
        }
    }

    #[test]
    fn what_has_no_value_is_a_gap_with_a_reason() {
        let circle = Along::Circle {
            theta_r_deg: 30.0,
            steps: 8,
        };
        let scan = Scan::of(&Half, Quantity::Brdf, &[(30.0, 0.0)], circle).unwrap();
        let scans = [("half", scan)];
        let points = &chart(&scans, "half", false).curves[0].points;
        let gaps: Vec<f64> = points
            .iter()
            .filter(|point| point.1.is_none())
            .map(|point| point.0)
            .collect();
        // At 90° cos φ is 6e-17 rather than 0.
        assert_eq!(gaps, [0.0, 45.0, 90.0, 315.0, 360.0]);
        assert_eq!(scans[0].1.missing(), 5);
        let table = csv(&scans);
        assert!(table.contains("\n30,0,30,45,,,,hole\n"), "{table}");
    }

    #[test]
    fn in_the_plane_of_incidence_the_mirror_side_is_positive_and_logarithms_have_no_zero() {
        let sample = parse("ggx:metal").unwrap();
        for phi_deg in [0.0, 110.0, 300.0] {
            let scan = Scan::of(&sample, Quantity::Brdf, &[(40.0, phi_deg)], Along::Plane).unwrap();
            let drawn = chart(&[("metal", scan.clone()), ("half", scan)], "both", true);
            assert_eq!(drawn.curves.len(), 2);
            assert!(
                drawn.curves[1].label == "half" && drawn.legend.starts_with("incident (40°"),
                "{}",
                drawn.curves[1].label
            );
            let points = &drawn.curves[0].points;
            let brightest = points
                .iter()
                .max_by(|a, b| a.1.unwrap().total_cmp(&b.1.unwrap()))
                .unwrap();
            assert!((brightest.0 - 40.0).abs() < 3.0, "{brightest:?}");
            assert_eq!(drawn.y.scale, Scale::Logarithmic);
        }
        let dark = parse("lambert:0").unwrap();
        let scan = Scan::of(&dark, Quantity::Brdf, &[(40.0, 0.0)], Along::Plane).unwrap();
        let drawn = chart(&[("dark", scan)], "dark", true);
        assert!(drawn.curves[0].points.iter().all(|point| point.1.is_none()));
    }
}
