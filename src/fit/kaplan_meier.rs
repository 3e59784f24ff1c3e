//! Quantiles of weighted, right-censored values (Kaplan and Meier 1958).
//!
//! Values are visited in ascending order. An observed value takes its share of the remaining weight
//! off the survival function; a censored one only leaves the remaining weight.

/// A value, its weight, and whether it is censored: a lower bound of the true value.
pub type CensoredSample = (f32, f32, bool);

/// The `share` quantile, and true if it is only a lower bound because the rest is censored. `None`
/// without values. Sorts the values.
pub fn kaplan_meier(values: &mut [CensoredSample], share: f64) -> Option<(f32, bool)> {
    // Among equal values the observed come first: a lower bound is at least as large.
    values.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.2.cmp(&b.2)));
    let mut left: f64 = values.iter().map(|value| f64::from(value.1)).sum();
    let mut above = 1.0;
    for (value, weight, is_bound) in values.iter() {
        if !is_bound && left > 0.0 {
            above *= 1.0 - f64::from(*weight) / left;
            if above <= 1.0 - share + 1e-9 {
                return Some((*value, false));
            }
        }
        left -= f64::from(*weight);
    }
    values.last().map(|(value, ..)| (*value, true))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weighted_median_without_censoring_is_the_middle_value() {
        let uncensored = |values: &[(f32, f32)]| values.iter().map(|(v, w)| (*v, *w, false)).collect::<Vec<_>>();
        assert_eq!(kaplan_meier(&mut uncensored(&[(3.0, 1.0), (1.0, 1.0), (2.0, 1.0)]), 0.5), Some((2.0, false)));
        assert_eq!(kaplan_meier(&mut uncensored(&[(3.0, 5.0), (1.0, 1.0), (2.0, 1.0)]), 0.5), Some((3.0, false)));
        assert_eq!(kaplan_meier(&mut [], 0.5), None);
    }

    #[test]
    fn censored_value_counts_as_larger() {
        // 0.2, 0.6, and one that is 0.5 or more: by hand, a third is 0.2; the censored one leaves
        // at 0.5; the rest is 0.6.
        assert_eq!(
            kaplan_meier(&mut [(0.2, 1.0, false), (0.5, 1.0, true), (0.6, 1.0, false)], 0.5),
            Some((0.6, false))
        );
        // Most are censored: a bound.
        assert_eq!(kaplan_meier(&mut [(0.2, 1.0, false), (0.9, 1.0, true), (1.0, 1.0, true)], 0.5), Some((1.0, true)));
        // A value censored at 0.2 has no influence on 0.4.
        assert_eq!(kaplan_meier(&mut [(0.2, 3.0, true), (0.4, 1.0, false)], 0.5), Some((0.4, false)));
    }
}
