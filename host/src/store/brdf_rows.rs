//! The values of some incident directions, and what stands where there is none.
//!
//! # Design
//! No data never equals a legal value. Where provenance is [`Provenance::Missing`], f and its standard uncertainty are NaN,
//! in files and in memory, so that whoever reads `f` alone is not misled, and whoever forgets to ask for the provenance gets
//! NaN instead of a wrong number. Where it is anything else, f is finite and the standard uncertainty is above 0. The store
//! refuses to write and to read rows that say otherwise; what computes rows brings them into this form with
//! [`BrdfRows::seal`].
//!
//! # Tradeoffs
//! Digits below a tenth of σ say nothing, and nothing compresses them. [`BrdfRows::round`] takes them away: f becomes a multiple of a
//! power of two that moves it by at most [`ROUNDING`]·σ, and σ keeps 6 significant bits. f keeps 10, however large σ is: what is below a tenth of σ
//! would be 0 otherwise, and sums over it too small, and where all values are alike all are rounded alike: a mean of many is moved by 0.1 % at most. What rounding adds to the variance is 1/300 of it at most, less than σ says of itself. Rounding twice is rounding once.
//!
//! A half float reaches from 6·10⁻⁸ to 65504 sr⁻¹. A smaller standard uncertainty is stored as the smallest, because 0 would
//! claim that a value is exact, and a larger one as the largest, which stands for "useless".

use half::f16;

use crate::store::provenance::Provenance;

/// The smallest standard uncertainty that is stored, in sr⁻¹.
pub(crate) const LEAST_SIGMA: f32 = 5.960_464_5e-8;
/// The largest, in sr⁻¹: that of a value that says nothing.
pub(crate) const USELESS_SIGMA: f32 = 65_504.0;
const _: () = assert!(
    LEAST_SIGMA.to_bits() == (127 - 24) << 23,
    "2⁻²⁴, the smallest half float"
);

/// The most that rounding moves f, over σ.
pub const ROUNDING: f64 = 0.1;
/// Steps of rounded values over the rounded σ at most, which may be larger than σ by 1/64.
const STEP: f32 = 2.0 * ROUNDING as f32 * (1.0 - 1.0 / 64.0);
/// Steps of rounded values over the power of two below them at most.
const COARSEST: f32 = 1.0 / 512.0;
/// Bits of the significand of a half float that rounding takes from σ: of 11, 6 are left.
const SIGMA_BITS: u32 = 5;

/// The values of one chunk: consecutive incident directions, row-major.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BrdfRows {
    /// f in sr⁻¹ without the cosine, axes incident, y, x, channel; NaN where there is no value.
    pub f: Vec<f32>,
    /// Standard uncertainty (k = 1) of f in sr⁻¹, same axes; NaN where there is no value.
    pub sigma: Vec<f16>,
    /// Codes of [`Provenance`], axes incident, y, x.
    pub provenance: Vec<u8>,
}

/// A standard uncertainty in sr⁻¹ as it is stored; one that is not known is useless.
#[allow(clippy::manual_clamp)] // NaN.min(x) is x, which clamp would not give
pub(crate) fn stored_sigma(sigma: f32) -> f16 {
    f16::from_f32(sigma.min(USELESS_SIGMA).max(LEAST_SIGMA))
}

/// `sigma` to fewer bits: half a unit more, and what is below a unit cut off. One below the smallest normal half float, and the largest,
/// stay.
fn rounded_sigma(sigma: f16) -> f16 {
    let bits = sigma.to_bits();
    let up = bits.wrapping_add(1 << (SIGMA_BITS - 1)) & (u16::MAX << SIGMA_BITS);
    let is_normal = (0x0400..0x7C00).contains(&bits) && up < 0x7C00;
    if is_normal { f16::from_bits(up) } else { sigma }
}

/// `f` as the nearest multiple of the largest power of two up to [`STEP`]·`sigma` and [`COARSEST`] of that below itself; of NaN, NaN, and
/// of what has no digits below that, itself.
fn rounded(f: f32, sigma: f16) -> f32 {
    /// Of a float: its exponent, that of a power of two.
    const EXPONENT: u32 = 0x7F80_0000;
    let power = |of: f32| f32::from_bits(of.to_bits() & EXPONENT);
    let step = power(STEP * sigma.to_f32()).min(COARSEST * power(f));
    let steps = f / step;
    // From 2²³ on every float is a whole number; of 0, and of what is hardly more, there are no steps.
    if steps.abs() < 8_388_608.0 {
        steps.round_ties_even() * step
    } else {
        f
    }
}

fn is_sigma(sigma: f16) -> bool {
    sigma.is_finite() && sigma > f16::ZERO
}

impl BrdfRows {
    /// `samples` pairs of directions of `channels` channels, none of which has a value.
    #[must_use]
    pub fn missing(samples: usize, channels: usize) -> Self {
        Self {
            f: vec![f32::NAN; samples * channels],
            sigma: vec![f16::NAN; samples * channels],
            provenance: vec![Provenance::Missing.code(); samples],
        }
    }

    /// Channels of each sample.
    fn channels(&self) -> usize {
        self.f.len() / self.provenance.len().max(1)
    }

    /// Makes NaN of what is missing and takes back what is no number: samples of which any channel has an f that is not
    /// finite become missing. Standard uncertainties that cannot be are brought into range. Returns how many samples lost
    /// their value.
    pub fn seal(&mut self) -> u64 {
        let channels = self.channels().max(1);
        let mut lost = 0;
        let samples = self
            .f
            .chunks_exact_mut(channels)
            .zip(self.sigma.chunks_exact_mut(channels));
        for ((f, sigma), provenance) in samples.zip(&mut self.provenance) {
            let has_value = *provenance != Provenance::Missing.code();
            if has_value && f.iter().all(|f| f.is_finite()) {
                for sigma in sigma.iter_mut().filter(|sigma| !is_sigma(**sigma)) {
                    let is_underflow = *sigma == f16::ZERO;
                    *sigma = f16::from_f32(if is_underflow { LEAST_SIGMA } else { USELESS_SIGMA });
                }
            } else {
                lost += u64::from(has_value);
                *provenance = Provenance::Missing.code();
                f.fill(f32::NAN);
                sigma.fill(f16::NAN);
            }
        }
        lost
    }

    /// Rounds f by at most [`ROUNDING`]·σ and σ by at most 1/64 of itself, so that they compress.
    pub fn round(&mut self) {
        for (f, sigma) in self.f.iter_mut().zip(&mut self.sigma) {
            *sigma = rounded_sigma(*sigma);
            *f = rounded(*f, *sigma);
        }
    }

    /// Whether nothing contradicts itself in rows of `N` channels: asked of all that is read, so by bits and without a branch.
    fn agree<const N: usize>(&self) -> bool {
        let ((f, _), (sigma, _)) = (self.f.as_chunks::<N>(), self.sigma.as_chunks::<N>());
        let mut all = 1_u8;
        for ((f, sigma), code) in f.iter().zip(sigma).zip(&self.provenance) {
            let (mut values, mut nan) = (1, 1);
            for (f, sigma) in f.iter().zip(sigma) {
                let (f, sigma) = (f.to_bits() & 0x7FFF_FFFF, sigma.to_bits());
                // Of half floats above 0, and finite: the smallest and the one before infinity.
                values &= u8::from(f < 0x7F80_0000) & u8::from(sigma.wrapping_sub(1) < 0x7BFF);
                nan &= u8::from(f > 0x7F80_0000) & u8::from(sigma & 0x7FFF > 0x7C00);
            }
            let is_missing = *code == Provenance::Missing.code();
            all &= if is_missing { nan } else { values };
        }
        all == 1
    }

    /// What contradicts itself in these rows, if anything: the sample, the array, what should stand there, and what does.
    pub(super) fn contradiction(&self) -> Option<(usize, &'static str, &'static str, String)> {
        let channels = self.channels().max(1);
        if (channels == 1 && self.agree::<1>()) || (channels == 3 && self.agree::<3>()) {
            return None;
        }
        let samples = self
            .f
            .chunks_exact(channels)
            .zip(self.sigma.chunks_exact(channels));
        let wrong = |f: &[f32], sigma: &[f16], provenance: u8| {
            if provenance == Provenance::Missing.code() {
                f.iter().any(|f| !f.is_nan()) || sigma.iter().any(|sigma| !sigma.is_nan())
            } else {
                f.iter().any(|f| !f.is_finite()) || sigma.iter().any(|sigma| !is_sigma(*sigma))
            }
        };
        let (sample, ((f, sigma), provenance)) = samples
            .zip(&self.provenance)
            .enumerate()
            .find(|(_, ((f, sigma), provenance))| wrong(f, sigma, **provenance))?;
        let is_missing = *provenance == Provenance::Missing.code();
        let expected = if is_missing {
            ["NaN, because its provenance is missing"; 2]
        } else {
            [
                "a finite number, because its provenance is not missing",
                "a finite number above 0, because its provenance is not missing",
            ]
        };
        let is_wrong = |is_nan: bool, is_good: bool| if is_missing { !is_nan } else { !is_good };
        if let Some(f) = f.iter().find(|f| is_wrong(f.is_nan(), f.is_finite())) {
            return Some((sample, "f", expected[0], f.to_string()));
        }
        let sigma = sigma
            .iter()
            .find(|sigma| is_wrong(sigma.is_nan(), is_sigma(**sigma)));
        let found = sigma.map_or_else(String::new, f16::to_string);
        Some((sample, "sigma", expected[1], found))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Anything that arithmetic may leave behind.
    fn number() -> impl Strategy<Value = f32> {
        prop_oneof![
            any::<f32>(),
            Just(0.0),
            Just(f32::NAN),
            Just(-f32::NAN),
            Just(f32::INFINITY),
            // In double precision: proptest 1.12 panics in about one of 10⁸ draws from a range of `f32`.
            prop_oneof![1e-9..1e-6, 0.0..2.0].prop_map(|value: f64| value as f32),
        ]
    }

    fn rows(channels: usize) -> impl Strategy<Value = BrdfRows> {
        prop::collection::vec((prop::array::uniform3((number(), number())), 0_u8..8), 1..40).prop_map(
            move |samples| BrdfRows {
                f: samples
                    .iter()
                    .flat_map(|(values, _)| values.iter().take(channels).map(|value| value.0))
                    .collect(),
                sigma: samples
                    .iter()
                    .flat_map(|(values, _)| values.iter().take(channels).map(|value| stored_or_raw(value.1)))
                    .collect(),
                provenance: samples.iter().map(|sample| sample.1).collect(),
            },
        )
    }

    /// A half float made with care or without.
    fn stored_or_raw(sigma: f32) -> f16 {
        if sigma.to_bits().is_multiple_of(2) {
            stored_sigma(sigma)
        } else {
            f16::from_f32(sigma)
        }
    }

    proptest! {
        #[test]
        fn sealed_rows_have_a_value_or_nan_and_good_ones_stay_as_they_are(
            before in prop_oneof![rows(1), rows(3)],
        ) {
            let channels = before.f.len() / before.provenance.len();
            let mut after = before.clone();
            let lost = after.seal();
            prop_assert_eq!(after.contradiction(), None);
            let mut expected = 0;
            for (sample, &code) in before.provenance.iter().enumerate() {
                let at = sample * channels..(sample + 1) * channels;
                let has_value = code != 0 && before.f[at.clone()].iter().all(|f| f.is_finite());
                expected += u64::from(code != 0 && !has_value);
                prop_assert_eq!(after.provenance[sample], if has_value { code } else { 0 });
                for at in at {
                    if has_value {
                        prop_assert_eq!(after.f[at].to_bits(), before.f[at].to_bits());
                        if is_sigma(before.sigma[at]) {
                            prop_assert_eq!(after.sigma[at].to_bits(), before.sigma[at].to_bits());
                        }
                    } else {
                        prop_assert!(after.f[at].is_nan() && after.sigma[at].is_nan());
                    }
                }
            }
            prop_assert_eq!(lost, expected);
            // What is quick to ask has the same answer, of good rows and of others.
            for rows in [&before, &after] {
                let is_good = if channels == 1 { rows.agree::<1>() } else { rows.agree::<3>() };
                prop_assert_eq!(is_good, (0..rows.provenance.len()).all(|sample| {
                    let at = sample * channels..(sample + 1) * channels;
                    let (f, sigma) = (&rows.f[at.clone()], &rows.sigma[at]);
                    if rows.provenance[sample] == 0 {
                        f.iter().all(|f| f.is_nan()) && sigma.iter().all(|sigma| sigma.is_nan())
                    } else {
                        f.iter().all(|f| f.is_finite()) && sigma.iter().all(|sigma| is_sigma(*sigma))
                    }
                }));
            }
            // And once is enough.
            let mut again = after.clone();
            prop_assert_eq!(again.seal(), 0);
            prop_assert_eq!(again.contradiction(), None);
        }

        #[test]
        fn a_standard_uncertainty_is_stored_as_its_nearest_half_float_and_never_as_none(sigma in 0.0..1e6) {
            let sigma = sigma as f32;
            let stored = stored_sigma(sigma);
            prop_assert!(is_sigma(stored));
            if (LEAST_SIGMA..USELESS_SIGMA).contains(&sigma) {
                prop_assert_eq!(stored.to_bits(), f16::from_f32(sigma).to_bits());
            }
        }
    }

    proptest! {
        #[test]
        fn rounding_stays_within_a_tenth_of_sigma_and_once_is_enough(
            samples in prop::collection::vec((-4.0..4.0_f64, -9.0..6.0_f64, 1_u16..0x7C00), 1..60),
        ) {
            let rows = BrdfRows {
                f: samples.iter().map(|(f, ten, _)| (f * 10_f64.powf(*ten)) as f32).collect(),
                sigma: samples.iter().map(|(_, _, bits)| f16::from_bits(*bits)).collect(),
                provenance: vec![1; samples.len()],
            };
            let mut rounded = rows.clone();
            rounded.round();
            prop_assert_eq!(rounded.contradiction(), None);
            for ((f, sigma), (to, sigma_to)) in rows.f.iter().zip(&rows.sigma).zip(rounded.f.iter().zip(&rounded.sigma)) {
                let (sigma, sigma_to) = (sigma.to_f64(), sigma_to.to_f64());
                prop_assert!((sigma_to - sigma).abs() <= sigma / 64.0);
                let moved = (f64::from(*f) - f64::from(*to)).abs();
                prop_assert!(moved <= ROUNDING * sigma, "{f} ± {sigma}: {to}");
                prop_assert!(moved <= f64::from(f.abs()) / 1024.0, "{f}: {to}");
            }
            let mut again = rounded.clone();
            again.round();
            prop_assert_eq!(again, rounded);
        }
    }

    #[test]
    fn rounding_leaves_few_bits_and_what_is_missing() {
        let mut rows = BrdfRows {
            f: vec![0.123_456_79, -0.003, f32::NAN, 0.123_456_79],
            sigma: vec![f16::from_f32(1e-4), f16::from_f32(0.1), f16::NAN, f16::MAX],
            provenance: vec![1, 1, 0, 1],
        };
        rows.round();
        // A fifth of 10⁻⁴ lies above 2⁻¹⁶; of what is not far above its uncertainty ten bits are left.
        let expected = [8091.0 / 65536.0, -786.0 / 262_144.0, 1011.0 / 8192.0_f32];
        assert_eq!(
            [0, 1, 3].map(|at: usize| rows.f[at].to_bits()),
            expected.map(f32::to_bits)
        );
        assert!(rows.f[2].is_nan() && rows.sigma[2].is_nan());
        assert_eq!(rows.sigma[3], f16::MAX);
    }

    #[test]
    fn what_cannot_be_stored_is_the_smallest_or_the_largest() {
        for sigma in [0.0, 1e-30, 2e-8, LEAST_SIGMA] {
            assert_eq!(stored_sigma(sigma).to_bits(), 1, "{sigma}");
        }
        for sigma in [65_504.0, 1e9, f32::INFINITY, f32::NAN] {
            assert_eq!(stored_sigma(sigma), f16::MAX, "{sigma}");
        }
    }

    #[test]
    fn every_contradiction_is_named() {
        type Edit = fn(&mut BrdfRows);
        let whole = BrdfRows {
            f: vec![0.2, -0.1, f32::NAN, f32::NAN],
            sigma: vec![f16::ONE, f16::ONE, f16::NAN, f16::NAN],
            provenance: vec![1, 0],
        };
        assert_eq!(whole.contradiction(), None);
        let edits: [(&str, Edit); 8] = [
            ("f", |rows| rows.f[1] = f32::NAN),
            ("f", |rows| rows.f[0] = f32::INFINITY),
            ("f", |rows| rows.f[3] = 0.0),
            ("sigma", |rows| rows.sigma[0] = f16::ZERO),
            ("sigma", |rows| rows.sigma[1] = f16::NAN),
            ("sigma", |rows| rows.sigma[1] = f16::INFINITY),
            ("sigma", |rows| rows.sigma[1] = f16::NEG_ONE),
            ("sigma", |rows| rows.sigma[2] = f16::ZERO),
        ];
        for (array, edit) in edits {
            let mut rows = whole.clone();
            edit(&mut rows);
            assert_eq!(rows.contradiction().map(|found| found.1), Some(array), "{rows:?}");
        }
    }
}
