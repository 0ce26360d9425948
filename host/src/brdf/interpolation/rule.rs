//! Where a captured image is read.

use glam::DVec3;

/// By what power of cosθi·cosθo f is multiplied before it is interpolated, and divided afterwards.
///
/// A highlight that moves keeps D(h) of a microfacet model, f = D·F·G/(4·cosθi·cosθo), but not the cosines; how much of
/// them G takes back depends on the material.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Cosines {
    /// f itself.
    Zero,
    /// The square root, as in Ward's model.
    Half,
    /// The whole product.
    One,
}

/// A way to read a captured image for a pair of directions that was not captured.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rule {
    place: Place,
    cosines: Cosines,
}

/// Where an image is read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Place {
    half_vector: bool,
    turned: bool,
}

/// All rules: direct first, then at constant half vector, each as it is and turned.
pub const RULES: [Rule; 8] = {
    const fn rule(half_vector: bool, turned: bool, cosines: Cosines) -> Rule {
        Rule {
            place: Place { half_vector, turned },
            cosines,
        }
    }
    [
        rule(false, false, Cosines::Zero),
        rule(false, true, Cosines::Zero),
        rule(true, false, Cosines::Zero),
        rule(true, false, Cosines::Half),
        rule(true, false, Cosines::One),
        rule(true, true, Cosines::Zero),
        rule(true, true, Cosines::Half),
        rule(true, true, Cosines::One),
    ]
};

/// Index of the plain direct rule among [`RULES`].
pub(super) const DIRECT: usize = 0;
/// Index of the plain half-vector rule among [`RULES`].
pub(super) const HALF_VECTOR: usize = 2;

/// Rules that read at the same place: their indices among [`RULES`], which follow each other.
const PLACES: [std::ops::Range<usize>; 4] = [0..1, 1..2, 2..5, 5..8];

/// Products of cosines below this count as this: what is divided by them would grow without bound.
const LEAST_COSINES: f64 = 1e-3;

/// What one image says of a query: where it is read, and the shares of the rules that read there.
pub(super) struct Reading {
    /// Outgoing direction in the image's own sample frame.
    pub(super) wo: DVec3,
    /// Rules that read there, as indices among [`RULES`].
    pub(super) rules: std::ops::Range<usize>,
    /// √ of cosθi·cosθo there over that of the query.
    root: f64,
}

impl Reading {
    /// What rule `rule` multiplies the value with.
    pub(super) fn factor(&self, rule: usize) -> f64 {
        match RULES[rule].cosines {
            Cosines::Zero => 1.0,
            Cosines::Half => self.root,
            Cosines::One => self.root * self.root,
        }
    }
}

/// Where the image under incident direction `captured` is read for the pair (`wi`, `wo`) by the rules that `wanted`
/// says (by their index among [`RULES`]). Places below the horizon are left out.
pub(super) fn readings(
    (wi, wo): (DVec3, DVec3),
    captured: DVec3,
    wanted: impl Fn(usize) -> bool,
) -> impl Iterator<Item = Reading> {
    let half = (wi + wo).normalize_or(DVec3::Z);
    // Turned about the normal, from the azimuth of wi to that of the image.
    let (a, b) = (wi.truncate(), captured.truncate());
    let length = a.length() * b.length();
    let (cos, sin) = if length > 1e-9 {
        (a.dot(b) / length, a.perp_dot(b) / length)
    } else {
        (1.0, 0.0)
    };
    let turn = move |w: DVec3| DVec3::new(cos * w.x - sin * w.y, sin * w.x + cos * w.y, w.z);
    let asked = (wi.z * wo.z).max(LEAST_COSINES);
    let wanted: [bool; 4] = PLACES.map(|mut rules| rules.any(&wanted));
    PLACES
        .into_iter()
        .zip(wanted)
        .filter(|(_, wanted)| *wanted)
        .filter_map(move |(rules, _)| {
            let Place { half_vector, turned } = RULES[rules.start].place;
            let (half, wo) = if turned {
                (turn(half), turn(wo))
            } else {
                (half, wo)
            };
            let wo = if half_vector {
                2.0 * half.dot(captured) * half - captured
            } else {
                wo
            };
            let root = ((captured.z * wo.z).max(LEAST_COSINES) / asked).sqrt();
            (wo.z > 0.0).then_some(Reading { wo, rules, root })
        })
}
