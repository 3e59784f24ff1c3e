//! Cross-validation with spatially grouped folds.
//!
//! Patches side by side show the same surface, and a patch and its virtual counterpart show the
//! same content. A group holds the patches of a square of cells of the grid, of both classes.
//! Groups are not divided between folds, so that no classifier is tested beside its training
//! patches (grouped cross-validation: Roberts et al. 2017).

use super::DetectorClassifier;
use super::auc::{Auc, auc_within_folds};
use super::boosted_trees::BoostedTrees;
use super::logistic::LogisticRegression;
use crate::simulate::random::mix;
use std::collections::BTreeMap;

/// Sides of the squares of cells that are tried, largest first.
const GROUP_SIDES: [usize; 4] = [4, 3, 2, 1];
/// Groups per fold that a side must leave.
const MIN_GROUPS_PER_FOLD: usize = 2;
/// Patches of each class that each fold must have.
pub(super) const MIN_FOLD_PATCHES: usize = 5;

/// Position of a sample: picture, and column and row in its grid of patches.
pub(super) type Cell = (usize, [usize; 2]);

/// A fitted classifier: the score of a sample's features.
type Score = Box<dyn Fn(&[f64]) -> f64>;

/// The fold of each sample. The largest groups are used with which all folds have enough patches of
/// both classes. `None` if there are none.
pub(super) fn grouped_folds(cells: &[Cell], is_positive: &[bool], folds: usize, seed: u64) -> Option<Vec<usize>> {
    let group = |(picture, [column, row]): Cell, side: usize| (picture, row / side, column / side);
    GROUP_SIDES.into_iter().find_map(|side| {
        let mut counts: BTreeMap<_, [usize; 2]> = BTreeMap::new();
        for (cell, &positive) in cells.iter().zip(is_positive) {
            counts.entry(group(*cell, side)).or_default()[usize::from(positive)] += 1;
        }
        if counts.len() < MIN_GROUPS_PER_FOLD * folds {
            return None;
        }
        // Large groups first, in a random order among equals.
        let mut groups: Vec<_> = counts.into_iter().collect();
        groups.sort_by_cached_key(|((picture, row, column), [negatives, positives])| {
            let key = [*picture, *row, *column].iter().fold(seed, |key, n| mix(key ^ mix(*n as u64 + 1)));
            (std::cmp::Reverse(negatives + positives), key)
        });
        let totals = [false, true].map(|class| is_positive.iter().filter(|p| **p == class).count().max(1) as f64);
        let mut filled = vec![[0usize; 2]; folds];
        let mut fold_of = BTreeMap::new();
        for (place, count) in groups {
            // The rise of Σ (share of a class in a fold)² is least in the emptiest fold.
            let rise = |fold: &[usize; 2]| -> f64 {
                (0..2).map(|c| (count[c] * (2 * fold[c] + count[c])) as f64 / (totals[c] * totals[c])).sum()
            };
            let fold = (0..folds).min_by(|a, b| rise(&filled[*a]).total_cmp(&rise(&filled[*b])))?;
            (0..2).for_each(|class| filled[fold][class] += count[class]);
            fold_of.insert(place, fold);
        }
        let is_filled = filled.iter().flatten().all(|count| *count >= MIN_FOLD_PATCHES);
        is_filled.then(|| cells.iter().map(|cell| fold_of[&group(*cell, side)]).collect())
    })
}

/// The area under the curve of a classifier, each fold scored by one that was trained on the
/// others.
pub(super) fn cross_validated_auc(
    samples: &[Vec<f64>],
    is_positive: &[bool],
    fold_of: &[usize],
    classifier: DetectorClassifier,
) -> Option<Auc> {
    let folds = fold_of.iter().max().map_or(0, |last| last + 1);
    let scored: Vec<(Vec<f64>, Vec<f64>)> = (0..folds)
        .map(|fold| {
            let (mut training, mut classes) = (Vec::new(), Vec::new());
            for ((sample, class), _) in samples.iter().zip(is_positive).zip(fold_of).filter(|(_, f)| **f != fold) {
                training.push(sample.as_slice());
                classes.push(*class);
            }
            let score: Score = match classifier {
                DetectorClassifier::Logistic => {
                    let fitted = LogisticRegression::fit(&training, &classes);
                    Box::new(move |sample| fitted.log_odds(sample))
                }
                DetectorClassifier::Boosted => {
                    let fitted = BoostedTrees::fit(&training, &classes);
                    Box::new(move |sample| fitted.log_odds(sample))
                }
            };
            let scores = |class: bool| {
                let tested = samples.iter().zip(is_positive).zip(fold_of);
                tested.filter(|((_, c), f)| **f == fold && **c == class).map(|((sample, _), _)| score(sample)).collect()
            };
            (scores(true), scores(false))
        })
        .collect();
    auc_within_folds(&scored)
}

#[cfg(test)]
mod tests {
    use super::super::synthetic::Normals;
    use super::*;

    /// Cells of one picture of 16×16 patches, twice: as negatives and as positives.
    fn paired_cells() -> (Vec<Cell>, Vec<bool>) {
        let cells = (0..512).map(|i| (0, [i % 16, i % 256 / 16])).collect();
        (cells, (0..512).map(|i| i >= 256).collect())
    }

    #[test]
    fn pairs_and_neighbours_share_a_fold() {
        let (cells, is_positive) = paired_cells();
        let folds = grouped_folds(&cells, &is_positive, 5, 1).unwrap();
        for (i, cell) in cells.iter().enumerate() {
            let [column, row] = cell.1;
            let first = cells.iter().position(|c| c.1 == [column / 4 * 4, row / 4 * 4]).unwrap();
            assert_eq!(folds[i], folds[first]);
        }
        for fold in 0..5 {
            let count = folds.iter().filter(|f| **f == fold).count();
            assert!((90..=130).contains(&count), "{count}");
        }
        assert_eq!(Some(&folds), grouped_folds(&cells, &is_positive, 5, 1).as_ref());
        assert_ne!(Some(folds), grouped_folds(&cells, &is_positive, 5, 2));
    }

    #[test]
    fn halves_of_a_picture_are_in_every_fold() {
        let (cells, _) = paired_cells();
        let cells = &cells[..256];
        let is_right: Vec<bool> = cells.iter().map(|(_, [column, _])| *column >= 8).collect();
        let folds = grouped_folds(cells, &is_right, 5, 1).unwrap();
        for fold in 0..5 {
            let right = folds.iter().zip(&is_right).filter(|(f, r)| **f == fold && **r).count();
            assert!((16..=40).contains(&right), "{right}");
        }
    }

    #[test]
    fn too_few_patches_of_a_class_have_no_folds() {
        let (cells, _) = paired_cells();
        let is_positive: Vec<bool> = (0..512).map(|i| i < 24).collect();
        assert_eq!(grouped_folds(&cells, &is_positive, 5, 1), None);
    }

    #[test]
    fn separable_classes_reach_1_and_equal_ones_stay_at_chance() {
        let (cells, is_positive) = paired_cells();
        let folds = grouped_folds(&cells, &is_positive, 5, 1).unwrap();
        let mut normals = Normals::new(5);
        let mut samples = |shift: f64| -> Vec<Vec<f64>> {
            let shift = |positive: &bool| if *positive { shift } else { 0.0 };
            is_positive
                .iter()
                .map(|p| (0..6).map(|j| normals.next() + f64::from(j == 2) * shift(p)).collect())
                .collect()
        };
        let (equal, apart, near) = (samples(0.0), samples(9.0), samples(2.0));
        for classifier in DetectorClassifier::ALL {
            let auc_of = |samples: &[Vec<f64>]| cross_validated_auc(samples, &is_positive, &folds, classifier).unwrap();
            assert!(auc_of(&apart).area > 0.999, "{classifier:?}");
            let chance = auc_of(&equal);
            assert!((chance.area - 0.5).abs() < 3.5 * chance.standard_error, "{classifier:?}: {chance:?}");
            // Φ(2/√2) = 0.921; boosting loses a little.
            let auc = auc_of(&near);
            assert!((0.86..0.95).contains(&auc.area) && auc.standard_error < 0.02, "{classifier:?}: {auc:?}");
        }
    }

    #[test]
    fn content_that_identifies_a_place_does_not_help() {
        // The feature is the place; each place has both classes.
        let (cells, is_positive) = paired_cells();
        let folds = grouped_folds(&cells, &is_positive, 5, 1).unwrap();
        let samples: Vec<Vec<f64>> = cells.iter().map(|(_, [x, y])| vec![*x as f64, *y as f64]).collect();
        for classifier in DetectorClassifier::ALL {
            let auc = cross_validated_auc(&samples, &is_positive, &folds, classifier).unwrap();
            assert!((auc.area - 0.5).abs() < 1e-9, "{classifier:?}: {auc:?}");
        }
    }
}
