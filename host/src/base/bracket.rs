//! Where a value is among ascending ones.

/// The interval of ascending `values` that holds `value`: the number of its lower end, and the weights of both ends; clamped to the ends,
/// the upper one then has no weight and may not be there.
pub(crate) fn bracket(values: &[f64], value: f64) -> (usize, [f64; 2]) {
    let above = values.partition_point(|v| *v <= value);
    if above == 0 {
        return (0, [1.0, 0.0]);
    }
    let below = above - 1;
    match values.get(above) {
        None => (below, [1.0, 0.0]),
        Some(end) => {
            let t = (value - values[below]) / (end - values[below]);
            (below, [1.0 - t, t])
        }
    }
}
