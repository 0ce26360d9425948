//! Student's distribution, for the few values that repeats are.

/// Quantiles for 95 % to both sides, of one degree of freedom and more (ISO/IEC Guide 98-3:2008, table G.2).
const QUANTILES: [f64; 10] = [12.71, 4.30, 3.18, 2.78, 2.57, 2.45, 2.36, 2.31, 2.26, 2.23];
/// Of more degrees of freedom they are near 2.
const MANY: f64 = 2.2;

/// By how many standard deviations, themselves found with so many degrees of freedom, a mean is off in one of twenty cases.
pub(crate) fn quantile_95(freedom: usize) -> f64 {
    let Some(place) = freedom.checked_sub(1) else {
        return f64::INFINITY;
    };
    QUANTILES.get(place).copied().unwrap_or(MANY)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn few_values_tell_little() {
        assert!(quantile_95(0).is_infinite());
        assert!((1..40).all(|freedom| quantile_95(freedom) >= quantile_95(freedom + 1)));
        assert!((quantile_95(2) - 4.30).abs() < 1e-9 && (quantile_95(50) - 2.2).abs() < 1e-9);
    }
}
