//! Where a captured image is read.

use glam::{DVec2, DVec3, Vec2, Vec3};

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
    pub(super) place: Place,
    cosines: Cosines,
}

/// Where an image is read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Place {
    pub(super) half_vector: bool,
    pub(super) turned: bool,
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
pub(super) const PLACES: [std::ops::Range<usize>; 4] = [0..1, 1..2, 2..5, 5..8];

/// Products of cosines below this count as this: what is divided by them would grow without bound.
pub(super) const LEAST_COSINES: f64 = 1e-3;

/// What one image says of a query: where it is read, and the shares of the rules that read there.
pub(super) struct Reading {
    /// Outgoing direction in the image's own sample frame.
    pub(super) wo: DVec3,
    /// Rules that read there, as indices among [`RULES`].
    pub(super) rules: std::ops::Range<usize>,
    /// √ of cosθi·cosθo there over that of the query; 1 where no rule asks for it.
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

/// The incident direction of an image, and what every query asks of it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Captured {
    pub(super) w: DVec3,
    /// Sine of its polar angle.
    sine: f64,
    /// In single precision: itself, and the cosine and sine of its azimuth, both 0 of the normal, which has none.
    pub(super) lane: Vec3,
    pub(super) azimuth: Vec2,
}

impl Captured {
    pub(crate) fn new(w: DVec3) -> Self {
        let across = w.truncate();
        let azimuth = if across.length_squared() > 1e-18 {
            across.normalize()
        } else {
            DVec2::ZERO
        };
        Self {
            w,
            sine: across.length(),
            lane: w.as_vec3(),
            azimuth: azimuth.as_vec2(),
        }
    }
}

/// A pair of directions, and what is the same for all images that are read for it.
pub(super) struct Query {
    wi: DVec3,
    wo: DVec3,
    half: DVec3,
    /// Sine of the polar angle of `wi`.
    sine: f64,
    /// cosθi·cosθo.
    cosines: f64,
    wanted: [bool; PLACES.len()],
}

impl Query {
    /// The query for the pair (`wi`, `wo`) by the rules that `wanted` says (by their index among [`RULES`]).
    pub(super) fn new((wi, wo): (DVec3, DVec3), wanted: impl Fn(usize) -> bool) -> Self {
        Self {
            wi,
            wo,
            half: (wi + wo).normalize_or(DVec3::Z),
            sine: wi.truncate().length(),
            cosines: (wi.z * wo.z).max(LEAST_COSINES),
            wanted: PLACES.map(|mut rules| rules.any(&wanted)),
        }
    }

    /// Where the image under incident direction `captured` is read. Places below the horizon are left out.
    #[inline]
    pub(super) fn readings(&self, captured: &Captured, mut each: impl FnMut(Reading)) {
        // Turned about the normal, from the azimuth of wi to that of the image.
        let (a, b) = (self.wi.truncate(), captured.w.truncate());
        let length = self.sine * captured.sine;
        let (cos, sin) = if length > 1e-9 {
            (a.dot(b) / length, a.perp_dot(b) / length)
        } else {
            (1.0, 0.0)
        };
        let turn = |w: DVec3| DVec3::new(cos * w.x - sin * w.y, sin * w.x + cos * w.y, w.z);
        for (rules, _) in PLACES.into_iter().zip(self.wanted).filter(|place| place.1) {
            let Place { half_vector, turned } = RULES[rules.start].place;
            let wo = match (half_vector, turned) {
                (false, false) => self.wo,
                (false, true) => turn(self.wo),
                (true, _) => {
                    let half = if turned { turn(self.half) } else { self.half };
                    2.0 * half.dot(captured.w) * half - captured.w
                }
            };
            if wo.z > 0.0 {
                let root = if half_vector {
                    ((captured.w.z * wo.z).max(LEAST_COSINES) / self.cosines).sqrt()
                } else {
                    1.0
                };
                each(Reading { wo, rules, root });
            }
        }
    }
}
