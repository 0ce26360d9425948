//! What the exposures of a measurement are for, and their order.

/// Black patterns of a measurement: dark level and stray light of each exposure time.
pub const BLACK_EXPOSURES: usize = 16;
/// Those of them without what watches the lamp; in the mean as early as the others, so that steady drifts cancel.
const UNWATCHED: [usize; 4] = [2, 5, 10, 13];

/// What one exposure is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Exposure {
    /// A black pattern, but for what watches the lamp.
    Black,
    /// The same without what watches the lamp.
    Unwatched,
    /// The incident direction of this index.
    Incident(usize),
    /// The code pattern of this number.
    Coded(usize),
}

impl Exposure {
    /// Number in files: −1 for black, −2 for black without what watches the lamp, −3, −4, … for code patterns, else the index of
    /// the incident direction.
    #[must_use]
    pub fn code(self) -> i64 {
        match self {
            Self::Black => -1,
            Self::Unwatched => -2,
            Self::Incident(index) => index as i64,
            Self::Coded(number) => -3 - number as i64,
        }
    }

    /// The black pattern of this number, of [`BLACK_EXPOSURES`].
    #[must_use]
    pub fn black(number: usize) -> Self {
        if UNWATCHED.contains(&number) {
            Self::Unwatched
        } else {
            Self::Black
        }
    }

    /// Whether nothing lights the sample.
    #[must_use]
    pub const fn is_black(self) -> bool {
        matches!(self, Self::Black | Self::Unwatched)
    }
}

/// The patterns `lit` with the black ones among them: evenly, the first one at the beginning and the last one at the end, or all of
/// them first.
pub(super) fn with_black(lit: &[Exposure], are_first: bool) -> Vec<Exposure> {
    let mut patterns = Vec::with_capacity(BLACK_EXPOSURES + lit.len());
    let mut done = 0;
    for number in 0..BLACK_EXPOSURES {
        let before = if are_first {
            0
        } else {
            lit.len() * number / (BLACK_EXPOSURES - 1)
        };
        patterns.extend_from_slice(&lit[done..before]);
        patterns.push(Exposure::black(number));
        done = before;
    }
    patterns.extend_from_slice(&lit[done..]);
    patterns
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn black_patterns_stand_evenly_among_the_lit_ones_and_steady_drifts_cancel_in_them() {
        for count in [1, 7, 15, 100, 4001] {
            let lit: Vec<Exposure> = (0..count).map(Exposure::Incident).collect();
            let all = with_black(&lit, false);
            let rest: Vec<Exposure> = all.iter().copied().filter(|one| !one.is_black()).collect();
            assert_eq!((rest, all.len()), (lit.clone(), count + BLACK_EXPOSURES));
            assert!(all[0].is_black() && all[all.len() - 1].is_black());
            let places: Vec<usize> = (0..all.len()).filter(|at| all[*at].is_black()).collect();
            let widest = places.windows(2).map(|pair| pair[1] - pair[0]).max().unwrap();
            assert!(
                widest <= count.div_ceil(BLACK_EXPOSURES - 1) + 1,
                "{count}: {widest}"
            );
            let mean = |wanted: Exposure| {
                let of: Vec<f64> = places
                    .iter()
                    .filter(|at| all[**at] == wanted)
                    .map(|at| *at as f64)
                    .collect();
                of.iter().sum::<f64>() / of.len() as f64
            };
            let apart = mean(Exposure::Black) - mean(Exposure::Unwatched);
            assert!(apart.abs() <= 0.5, "{count}: {apart}");
            let first = with_black(&lit, true);
            assert!(first[..BLACK_EXPOSURES].iter().all(|one| one.is_black()));
            assert_eq!(first[BLACK_EXPOSURES..], lit);
        }
    }
}
