//! Medians and quantiles by rank (Hyndman and Fan 1996 compare the conventions).
//!
//! n values in ascending order have the ranks 0 to n − 1. The functions differ in the rank that
//! they take for a share p of the values; all return `None` without values.

use std::cmp::Ordering;

/// Median absolute deviation to one standard deviation of a normal distribution.
pub const SIGMA_PER_MAD: f64 = 1.4826;

/// Numbers with a total order.
pub trait TotalOrder: Copy {
    fn order(&self, other: &Self) -> Ordering;
}

impl TotalOrder for f32 {
    fn order(&self, other: &Self) -> Ordering {
        self.total_cmp(other)
    }
}

impl TotalOrder for f64 {
    fn order(&self, other: &Self) -> Ordering {
        self.total_cmp(other)
    }
}

impl TotalOrder for u64 {
    fn order(&self, other: &Self) -> Ordering {
        self.cmp(other)
    }
}

/// The median; the upper one of the two middle values for an even number.
pub fn upper_median<T: TotalOrder>(values: impl IntoIterator<Item = T>) -> Option<T> {
    upper_median_in_place(&mut values.into_iter().collect::<Vec<T>>())
}

/// [`upper_median`] of a slice, which it reorders.
pub fn upper_median_in_place<T: TotalOrder>(values: &mut [T]) -> Option<T> {
    of_rank(values, values.len() / 2)
}

/// The median; the mean of the two middle values for an even number.
pub fn midpoint_median(values: impl IntoIterator<Item = f64>) -> Option<f64> {
    let mut values: Vec<f64> = values.into_iter().collect();
    let upper = upper_median_in_place(&mut values)?;
    if !values.len().is_multiple_of(2) {
        return Some(upper);
    }
    let below = values.len() / 2 - 1;
    Some(0.5 * (of_rank(&mut values, below)? + upper))
}

/// The quantile of rank ⌊p·n⌋, at most n − 1. Reorders the values.
pub fn upper_quantile<T: TotalOrder>(values: &mut [T], share: f64) -> Option<T> {
    let rank = (share * values.len() as f64) as usize;
    of_rank(values, rank.min(values.len().saturating_sub(1)))
}

/// The quantile of rank ⌊p·(n − 1)⌋. Reorders the values.
pub fn lower_quantile<T: TotalOrder>(values: &mut [T], share: f64) -> Option<T> {
    of_rank(values, (share * values.len().saturating_sub(1) as f64) as usize)
}

/// The quantile of the rank nearest to p·(n − 1). Reorders the values.
pub fn nearest_quantile<T: TotalOrder>(values: &mut [T], share: f64) -> Option<T> {
    of_rank(values, (share * values.len().saturating_sub(1) as f64).round() as usize)
}

/// The median, and one standard deviation by the median absolute deviation. 0 without values.
pub fn median_and_sigma(values: impl IntoIterator<Item = f64>) -> (f64, f64) {
    let mut values: Vec<f64> = values.into_iter().collect();
    let median = upper_median_in_place(&mut values).unwrap_or(0.0);
    let mad = upper_median(values.into_iter().map(|value| (value - median).abs())).unwrap_or(0.0);
    (median, SIGMA_PER_MAD * mad)
}

fn of_rank<T: TotalOrder>(values: &mut [T], rank: usize) -> Option<T> {
    (rank < values.len()).then(|| *values.select_nth_unstable_by(rank, T::order).1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn medians_of_an_even_number_follow_their_convention() {
        let values = [4.0, 1.0, 3.0, 2.0];
        assert_eq!((upper_median(values), midpoint_median(values)), (Some(3.0), Some(2.5)));
        assert_eq!((upper_median([5.0, 1.0, 2.0]), midpoint_median([5.0, 1.0, 2.0])), (Some(2.0), Some(2.0)));
        assert_eq!((upper_median::<f64>([]), midpoint_median([])), (None, None));
    }

    #[test]
    fn quantiles_take_the_rank_of_their_convention() {
        let quantiles = |share: f64| {
            let mut values = [40.0, 10.0, 30.0, 20.0];
            [
                upper_quantile(&mut values, share),
                lower_quantile(&mut values, share),
                nearest_quantile(&mut values, share),
            ]
            .map(Option::unwrap)
        };
        // p·n is 0, 2, 3.6, 4; p·(n − 1) is 0, 1.5, 2.7, 3.
        assert_eq!(quantiles(0.0), [10.0, 10.0, 10.0]);
        assert_eq!(quantiles(0.5), [30.0, 20.0, 30.0]);
        assert_eq!(quantiles(0.9), [40.0, 30.0, 40.0]);
        assert_eq!(quantiles(1.0), [40.0, 40.0, 40.0]);
        assert_eq!([upper_quantile, lower_quantile, nearest_quantile].map(|of| of(&mut [0.0f32; 0], 0.5)), [None; 3]);
    }

    #[test]
    fn sigma_by_the_median_absolute_deviation_ignores_an_outlier() {
        // Deviations from 3 are 2, 1, 0, 1, 97.
        assert_eq!(median_and_sigma([1.0, 2.0, 3.0, 4.0, 100.0]), (3.0, SIGMA_PER_MAD));
        assert_eq!(median_and_sigma([]), (0.0, 0.0));
    }
}
