//! Area under the ROC curve, and its standard error.
//!
//! The area is the Mann-Whitney statistic: the probability that a positive's score exceeds a
//! negative's, ties counted half. Its variance, with A the area, m positives and n negatives, is
//! that of Hanley and McNeil 1982, equations 1 and 2:
//!
//! ```text
//! var A = (A(1 − A) + (m − 1)(Q1 − A²) + (n − 1)(Q2 − A²)) / (m n)
//! Q1 = A/(2 − A)        Q2 = 2A²/(1 + A)
//! ```
//!
//! It treats scores as independent. Neighbouring patches are not quite, and the choice of the
//! training patches adds variance, so it is a lower bound.

/// Area under a ROC curve.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Auc {
    /// 0 to 1; 0.5 is chance.
    pub area: f64,
    pub standard_error: f64,
}

/// The area by which `positive` scores exceed `negative` ones. `None` if either is empty or a score
/// is NaN.
pub fn auc(positive: &[f64], negative: &[f64]) -> Option<Auc> {
    let (m, n) = (positive.len() as f64, negative.len() as f64);
    let mut scores: Vec<(f64, bool)> = positive.iter().map(|&s| (s, true)).collect();
    scores.extend(negative.iter().map(|&s| (s, false)));
    if positive.is_empty() || negative.is_empty() || scores.iter().any(|(s, _)| s.is_nan()) {
        return None;
    }
    scores.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (mut below, mut wins) = (0.0, 0.0);
    for tied in scores.chunk_by(|a, b| a.0 == b.0) {
        let positives = tied.iter().filter(|(_, is_positive)| *is_positive).count() as f64;
        let negatives = tied.len() as f64 - positives;
        wins += positives * (below + 0.5 * negatives);
        below += negatives;
    }
    let area = wins / (m * n);
    let q1 = area / (2.0 - area);
    let q2 = 2.0 * area * area / (1.0 + area);
    let squared = area * area;
    let variance = (area * (1.0 - area) + (m - 1.0) * (q1 - squared) + (n - 1.0) * (q2 - squared)) / (m * n);
    Some(Auc { area, standard_error: variance.max(0.0).sqrt() })
}

/// The area over pairs of the same fold, whose scores come from the same classifier. Each fold's
/// area counts by its number of pairs. Scores of different folds are not compared: a classifier
/// that was trained without a fold shifts its scores against the class that the fold has more of,
/// which would pull the area of equal distributions below 0.5.
pub fn auc_within_folds(folds: &[(Vec<f64>, Vec<f64>)]) -> Option<Auc> {
    let (mut pairs, mut area, mut variance) = (0.0, 0.0, 0.0);
    for (positive, negative) in folds {
        let fold = auc(positive, negative)?;
        let weight = (positive.len() * negative.len()) as f64;
        pairs += weight;
        area += weight * fold.area;
        variance += (weight * fold.standard_error).powi(2);
    }
    (pairs > 0.0).then(|| Auc { area: area / pairs, standard_error: variance.sqrt() / pairs })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn auc_of_few_scores_matches_hand_calculation() {
        // Pairs won: 3 beats 1 and 2, 2 beats 1 and ties with 2: 3.5 of 4.
        let few_scores = auc(&[3.0, 2.0], &[1.0, 2.0]).unwrap();
        assert_eq!(few_scores.area, 0.875);
        // Q1 = 0.875/1.125 = 0.77778, Q2 = 1.53125/1.875 = 0.81667, A² = 0.765625:
        // (0.109375 + 0.012153 + 0.051042)/4 = 0.0431424.
        assert!((few_scores.standard_error - 0.0431424_f64.sqrt()).abs() < 1e-5, "{few_scores:?}");
        assert_eq!(auc(&[1.0], &[2.0]).unwrap().area, 0.0);
        assert_eq!(auc(&[1.0; 5], &[1.0; 7]).unwrap().area, 0.5);
    }

    #[test]
    fn standard_error_at_chance_is_that_of_the_rank_sum() {
        // At A = 1/2 the formula is (m + n + 1)/(12 m n), the variance of the Mann-Whitney
        // statistic.
        let ties = auc(&[1.0; 20], &[1.0; 30]).unwrap();
        assert!((ties.standard_error - (51.0_f64 / 7200.0).sqrt()).abs() < 1e-12, "{ties:?}");
    }

    #[test]
    fn scores_of_different_folds_are_not_compared() {
        // Each fold is at chance; the second fold's scores are all higher.
        let folds = [(vec![0.0, 1.0], vec![0.0, 1.0]), (vec![5.0; 3], vec![5.0])];
        let within_folds = auc_within_folds(&folds).unwrap();
        assert_eq!(within_folds.area, 0.5);
        // 4 pairs with variance 5/48, 3 pairs with 5/36.
        let variance = (16.0 * 5.0 / 48.0 + 9.0 * 5.0 / 36.0) / 49.0;
        assert!((within_folds.standard_error - f64::sqrt(variance)).abs() < 1e-12, "{within_folds:?}");
    }

    #[test]
    fn missing_or_undefined_scores_have_no_area() {
        assert_eq!(auc(&[], &[1.0]), None);
        assert_eq!(auc(&[f64::NAN], &[1.0]), None);
        assert_eq!(auc_within_folds(&[]), None);
        assert!(auc(&[f64::INFINITY], &[f64::NEG_INFINITY]).unwrap().area == 1.0);
    }
}
