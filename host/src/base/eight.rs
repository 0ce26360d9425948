//! Eight numbers that are computed at once.
//!
//! # Design
//! Every operation is the same in all lanes, and a compiler makes vector instructions of such loops. Functions are polynomials without a
//! branch, fitted at Chebyshev's nodes: what single precision rounds is larger than what they are off by. No operation is fused and none
//! depends on the processor, so that the same numbers come out everywhere, whatever stands in the other lanes.

// Inlined whatever the compiler thinks of it: these are the instructions of what is computed millions of times a second.
#![allow(clippy::inline_always)]

use std::f32::consts::{FRAC_1_PI, FRAC_PI_2, PI};
use std::ops::{Add, Div, Mul, Sub};

use glam::{DVec3, Vec4};

/// Numbers side by side.
pub(crate) const LANES: usize = 8;
/// 1.5 · 2²³: added and taken away, it leaves a whole number of what is smaller than 2²².
const WHOLE: f32 = 12_582_912.0;
/// 2²³, whose last bit counts ones.
const ONES: f32 = 8_388_608.0;

/// arctan(√z)/√z, for z from 0 to 1.
const ATAN: [f32; 9] = [
    1.0,
    -0.333_330_36,
    0.199_918_72,
    -0.141_977_98,
    0.106_183_71,
    -0.074_568_55,
    0.042_137_623,
    -0.015_731_249,
    0.002_766_283_5,
];
/// tan(√z)/√z, for z up to (π/6)².
const TAN: [f32; 6] = [
    1.0,
    0.333_333_6,
    0.133_321_66,
    0.054_146_998,
    0.020_651_251,
    0.012_554_246,
];
/// 2^x, for x from −½ to ½.
const EXP2: [f32; 7] = [
    1.0,
    std::f32::consts::LN_2,
    0.240_226_5,
    0.055_503_27,
    0.009_618_057,
    0.001_340_042_8,
    0.000_154_614_45,
];

/// Eight numbers.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Eight([Vec4; 2]);

/// A direction in each lane.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Vectors {
    pub(crate) x: Eight,
    pub(crate) y: Eight,
    pub(crate) z: Eight,
}

macro_rules! lane_by_lane {
    ($($trait:ident $function:ident $operator:tt),*) => {$(
        impl $trait for Eight {
            type Output = Self;

            #[inline(always)]
            fn $function(self, other: Self) -> Self {
                let ([a, b], [c, d]) = (self.0, other.0);
                Self([a $operator c, b $operator d])
            }
        }
    )*};
}

lane_by_lane!(Add add +, Sub sub -, Mul mul *, Div div /);

/// The polynomial with these coefficients, the constant one first.
#[inline(always)]
fn polynomial<const N: usize>(coefficients: &[f32; N], x: Eight) -> Eight {
    let mut sum = Eight::splat(coefficients[N - 1]);
    for at in (0..N - 1).rev() {
        sum = sum * x + Eight::splat(coefficients[at]);
    }
    sum
}

/// The next whole numbers below, of numbers between −2²² and 2²²: without an instruction that not every processor has.
#[inline(always)]
pub(crate) fn floor(x: Vec4) -> Vec4 {
    let near = x + WHOLE - WHOLE;
    near - Vec4::select(x.cmplt(near), Vec4::ONE, Vec4::ZERO)
}

/// Whole numbers from 0 to 2²³ − 1 as such; of anything else they mean nothing.
#[inline(always)]
pub(crate) fn whole(x: Vec4) -> [u32; 4] {
    let [a, b, c, d] = (x + ONES).to_array();
    let last = |x: f32| x.to_bits() & 0x7f_ffff;
    [last(a), last(b), last(c), last(d)]
}

impl Eight {
    #[inline(always)]
    pub(crate) const fn splat(x: f32) -> Self {
        Self([Vec4::splat(x); 2])
    }

    #[inline(always)]
    pub(crate) const fn new([a, b, c, d, e, f, g, h]: [f32; LANES]) -> Self {
        Self([Vec4::new(a, b, c, d), Vec4::new(e, f, g, h)])
    }

    #[inline(always)]
    pub(crate) fn to_array(self) -> [f32; LANES] {
        let ([a, b, c, d], [e, f, g, h]) = (self.0[0].to_array(), self.0[1].to_array());
        [a, b, c, d, e, f, g, h]
    }

    /// The larger ones; what is not a number counts as the smaller.
    #[inline(always)]
    pub(crate) fn max(self, other: Self) -> Self {
        let ([a, b], [c, d]) = (self.0, other.0);
        Self([a.max(c), b.max(d)])
    }

    #[inline(always)]
    pub(crate) fn min(self, other: Self) -> Self {
        let ([a, b], [c, d]) = (self.0, other.0);
        Self([a.min(c), b.min(d)])
    }

    /// In each lane `yes` where this is less than `than`, else `no`.
    #[inline(always)]
    pub(crate) fn where_less(self, than: Self, yes: Self, no: Self) -> Self {
        let half = |at: usize| Vec4::select(self.0[at].cmplt(than.0[at]), yes.0[at], no.0[at]);
        Self([half(0), half(1)])
    }

    /// In which lanes this is less than `than`, one bit each.
    #[inline(always)]
    pub(crate) fn is_less(self, than: Self) -> u32 {
        let half = |at: usize| self.0[at].cmplt(than.0[at]).bitmask();
        half(0) | half(1) << (LANES / 2)
    }

    #[inline(always)]
    pub(crate) fn abs(self) -> Self {
        let [a, b] = self.0;
        Self([a.abs(), b.abs()])
    }

    #[inline(always)]
    pub(crate) fn sqrt(self) -> Self {
        let [a, b] = self.0;
        Self([a.sqrt(), b.sqrt()])
    }

    /// The least of the numbers.
    #[inline(always)]
    pub(crate) fn least(self) -> f32 {
        self.0[0].min(self.0[1]).min_element()
    }

    /// The next whole number below, of numbers between −2²² and 2²².
    #[inline(always)]
    pub(crate) fn floor(self) -> Self {
        let [a, b] = self.0;
        Self([floor(a), floor(b)])
    }

    /// See [`whole`].
    #[inline(always)]
    pub(crate) fn whole(self) -> [u32; LANES] {
        let ([a, b, c, d], [e, f, g, h]) = (whole(self.0[0]), whole(self.0[1]));
        [a, b, c, d, e, f, g, h]
    }

    /// The angle in rad, from 0 to π/2, in the triangle with the legs `self` (opposite) and `other` (adjacent), none of them negative.
    #[inline(always)]
    pub(crate) fn angle_over(self, other: Self) -> Self {
        let (less, more) = (self.min(other), self.max(other));
        let t = less / more.max(Self::splat(f32::MIN_POSITIVE));
        let angle = t * polynomial(&ATAN, t * t);
        other.where_less(self, Self::splat(FRAC_PI_2) - angle, angle)
    }

    /// The azimuth of the direction with these components along x and `y`, in turns, from 0 up to 1.
    #[inline(always)]
    pub(crate) fn turns(self, y: Self) -> Self {
        let zero = Self::splat(0.0);
        let quarter = y.abs().angle_over(self.abs());
        let half = self.where_less(zero, Self::splat(PI) - quarter, quarter);
        let turns = half * Self::splat(0.5 * FRAC_1_PI);
        y.where_less(zero, Self::splat(1.0) - turns, turns)
    }

    /// The tangent of an angle in rad from −π/6 to π/6.
    #[inline(always)]
    pub(crate) fn tan(self) -> Self {
        self * polynomial(&TAN, self * self)
    }

    /// 2 to the power of it, from −100 to 100.
    #[inline(always)]
    pub(crate) fn exp2(self) -> Self {
        let near = self + Self::splat(WHOLE);
        let part = self - (near - Self::splat(WHOLE));
        // The last bits of the sum are the whole number; in those of the exponent it is a power of two.
        let mut power = near.to_array();
        for x in &mut power {
            *x = f32::from_bits((x.to_bits() << 23).wrapping_add(1.0_f32.to_bits()));
        }
        polynomial(&EXP2, part) * Self::new(power)
    }
}

impl Vectors {
    /// Polar angles of directions of any length above the horizon, in rad; exact near the pole, where a cosine would lose half of the digits.
    #[inline(always)]
    pub(crate) fn theta_rad(&self) -> Eight {
        (self.x * self.x + self.y * self.y).sqrt().angle_over(self.z)
    }

    /// These directions.
    #[inline(always)]
    pub(crate) fn of(w: &[DVec3; LANES]) -> Self {
        let along = |of: fn(&DVec3) -> f64| {
            let mut all = [0.0; LANES];
            for (x, w) in all.iter_mut().zip(w) {
                *x = of(w) as f32;
            }
            Eight::new(all)
        };
        Self {
            x: along(|w| w.x),
            y: along(|w| w.y),
            z: along(|w| w.z),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The largest difference of `found` from `expected`, at many places from `low` to `high`.
    fn off(low: f32, high: f32, found: impl Fn(Eight) -> Eight, expected: impl Fn(f64) -> f64) -> f64 {
        let places = (0..=100_000).map(|at| low + (high - low) * (at as f32 / 100_000.0));
        let of = |x: f32| {
            let lanes = found(Eight::new([x, low, high, x, low, high, x, x])).to_array();
            assert_eq!(lanes[0].to_bits(), lanes[7].to_bits(), "other lanes have no part");
            (f64::from(lanes[0]) - expected(f64::from(x))).abs()
        };
        places.map(of).fold(0.0, f64::max)
    }

    #[test]
    fn functions_are_those_of_mathematics() {
        assert!(off(-0.523, 0.523, Eight::tan, f64::tan) < 1e-7);
        assert!(off(-6.0, 0.0, Eight::exp2, f64::exp2) < 2e-7);
        assert!(off(-700.0, 700.0, Eight::floor, f64::floor) < 1e-9);
        let whole = |x: Eight| Eight::new(x.floor().whole().map(|whole| whole as f32));
        assert!(off(0.0, 700.0, whole, f64::floor) < 1e-9);
        let high = Eight::splat(0.7);
        assert!(off(0.0, 3.0, |x| x.angle_over(high), |x| x.atan2(f64::from(0.7_f32))) < 2e-7);
        for y in [-0.4_f32, -0.0, 0.0, 0.3] {
            let turns = |x: f64| {
                let turns = f64::from(y).atan2(x) / std::f64::consts::TAU;
                turns + if turns < 0.0 { 1.0 } else { 0.0 }
            };
            let off = off(-1.0, 1.0, |x| x.turns(Eight::splat(y)), |x| turns(x).abs());
            assert!(off < 2e-7 || (y == 0.0 && (off - 0.5).abs() < 1e-6), "{y}: {off}");
        }
    }
}
