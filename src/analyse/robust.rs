//! Robust statistics.

/// The median; the upper one of the two middle values for an even number, 0 without values.
/// Reorders them.
pub fn median(values: &mut [f64]) -> f64 {
    let half = values.len() / 2;
    if values.is_empty() { 0.0 } else { *values.select_nth_unstable_by(half, f64::total_cmp).1 }
}

/// The median, and one standard deviation by 1.4826 · median |v − median|, as of a Gaussian.
/// Overwrites the values by absolute deviations.
pub fn scatter(values: &mut [f64]) -> (f64, f64) {
    let middle = median(values);
    values.iter_mut().for_each(|value| *value = (*value - middle).abs());
    (middle, 1.4826 * median(values))
}
