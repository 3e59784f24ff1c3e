//! Gradient boosting of shallow regression trees with logistic loss (Friedman 2001, algorithm 5,
//! L2_TreeBoost).
//!
//! Each tree is fitted to the residuals y − p. A node is split where the sum of squares falls most;
//! the value of a leaf is the Newton step Σ(y − p)/Σp(1 − p). Without subsampling, so the fit has
//! no randomness.

use super::logistic::sigmoid;

const TREES: usize = 60;
const DEPTH: usize = 3;
const LEARNING_RATE: f64 = 0.1;
/// Minimum number of training samples in a leaf.
const MIN_LEAF_SAMPLES: usize = 5;
/// Largest absolute value of a leaf, in logarithms of odds.
const MAX_LEAF: f64 = 10.0;

/// A fitted sum of trees.
#[derive(Clone, Debug, PartialEq)]
pub struct BoostedTrees {
    /// Logarithm of the odds of the classes.
    prior: f64,
    trees: Vec<Vec<TreeNode>>,
}

/// A node of a binary tree that is stored as a heap: the children of i are 2i + 1 and 2i + 2.
#[derive(Clone, Copy, Debug, PartialEq)]
enum TreeNode {
    Split {
        feature: usize,
        /// Samples with a larger value go to the second child.
        threshold: f64,
    },
    Leaf(f64),
}

/// The best split of a node so far.
#[derive(Clone, Copy)]
struct SplitCandidate {
    gain: f64,
    feature: usize,
    threshold: f64,
}

/// Running sums over a node's samples in the order of a feature.
#[derive(Clone, Copy, Default)]
struct LeftSums {
    count: usize,
    residual: f64,
    last: f64,
}

impl BoostedTrees {
    /// Fits to samples, each a row of features, of which `is_positive` gives the class. The rows
    /// have one length and finite values.
    pub fn fit(samples: &[&[f64]], is_positive: &[bool]) -> Self {
        let features = samples.first().map_or(0, |sample| sample.len());
        // The samples' order by each feature.
        let orders: Vec<Vec<usize>> = (0..features)
            .map(|j| {
                let mut order: Vec<usize> = (0..samples.len()).collect();
                order.sort_by(|&a, &b| samples[a][j].total_cmp(&samples[b][j]));
                order
            })
            .collect();
        let positives = is_positive.iter().filter(|p| **p).count() as f64;
        let negatives = is_positive.len() as f64 - positives;
        let prior = ((positives + 0.5) / (negatives + 0.5)).ln();
        let mut scores = vec![prior; samples.len()];
        let mut trees = Vec::with_capacity(TREES);
        for _ in 0..TREES {
            let probabilities: Vec<f64> = scores.iter().map(|s| sigmoid(*s)).collect();
            let residuals: Vec<f64> =
                probabilities.iter().zip(is_positive).map(|(p, &y)| f64::from(u8::from(y)) - p).collect();
            let tree = grow(samples, &orders, &residuals, &probabilities);
            scores.iter_mut().zip(samples).for_each(|(score, sample)| *score += value(&tree, sample));
            trees.push(tree);
        }
        Self { prior, trees }
    }

    /// Logarithm of the odds that a sample is positive.
    pub fn log_odds(&self, sample: &[f64]) -> f64 {
        self.prior + self.trees.iter().map(|tree| value(tree, sample)).sum::<f64>()
    }
}

fn value(tree: &[TreeNode], sample: &[f64]) -> f64 {
    let mut node = 0;
    loop {
        match tree[node] {
            TreeNode::Leaf(value) => return value,
            TreeNode::Split { feature, threshold } => node = 2 * node + 1 + usize::from(sample[feature] > threshold),
        }
    }
}

/// Grows a tree level by level. All nodes of a level are searched in one pass over each feature.
fn grow(samples: &[&[f64]], orders: &[Vec<usize>], residuals: &[f64], probabilities: &[f64]) -> Vec<TreeNode> {
    let mut tree = vec![TreeNode::Leaf(0.0); (1 << (DEPTH + 1)) - 1];
    let mut node_of = vec![0; samples.len()];
    for level in 0..DEPTH {
        let first = (1 << level) - 1;
        let nodes = 1 << level;
        let mut totals = vec![LeftSums::default(); nodes];
        for (i, &node) in node_of.iter().enumerate().filter(|(_, node)| **node >= first) {
            totals[node - first].count += 1;
            totals[node - first].residual += residuals[i];
        }
        let mut best: Vec<Option<SplitCandidate>> = vec![None; nodes];
        for (feature, order) in orders.iter().enumerate() {
            let mut left = vec![LeftSums::default(); nodes];
            for &i in order.iter().filter(|i| node_of[**i] >= first) {
                let n = node_of[i] - first;
                let current = samples[i][feature];
                if current > left[n].last {
                    consider_split(&mut best[n], &left[n], &totals[n], feature, current);
                }
                left[n].count += 1;
                left[n].residual += residuals[i];
                left[n].last = current;
            }
        }
        for (n, candidate) in best.iter().enumerate() {
            if let Some(split) = candidate {
                tree[first + n] = TreeNode::Split { feature: split.feature, threshold: split.threshold };
            }
        }
        for (node, sample) in node_of.iter_mut().zip(samples).filter(|(node, _)| **node >= first) {
            if let TreeNode::Split { feature, threshold } = tree[*node] {
                *node = 2 * *node + 1 + usize::from(sample[feature] > threshold);
            }
        }
    }
    let mut sums = vec![[0.0; 2]; tree.len()];
    for (i, &node) in node_of.iter().enumerate() {
        sums[node][0] += residuals[i];
        sums[node][1] += probabilities[i] * (1.0 - probabilities[i]);
    }
    for (node, [residual, curvature]) in tree.iter_mut().zip(sums) {
        if let TreeNode::Leaf(value) = node {
            let step = if curvature > 1e-12 { residual / curvature } else { 0.0 };
            *value = LEARNING_RATE * step.clamp(-MAX_LEAF, MAX_LEAF);
        }
    }
    tree
}

/// Replaces the candidate if a split between the samples on the left and `next` is better. The gain
/// is the fall of the sum of squares, G_l²/n_l + G_r²/n_r − G²/n, of which the last term is common.
fn consider_split(best: &mut Option<SplitCandidate>, left: &LeftSums, total: &LeftSums, feature: usize, next: f64) {
    let right = total.count - left.count;
    if left.count < MIN_LEAF_SAMPLES || right < MIN_LEAF_SAMPLES {
        return;
    }
    let (n_left, n_right) = (left.count as f64, right as f64);
    let gain = left.residual.powi(2) / n_left + (total.residual - left.residual).powi(2) / n_right
        - total.residual.powi(2) / total.count as f64;
    if gain > best.map_or(1e-12, |b| b.gain) {
        *best = Some(SplitCandidate { gain, feature, threshold: 0.5 * (left.last + next) });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn step_in_one_feature_is_found_between_its_neighbours() {
        let values: Vec<[f64; 2]> = (0..40).map(|i| [f64::from(i % 7), f64::from(i)]).collect();
        let samples: Vec<&[f64]> = values.iter().map(|v| v.as_slice()).collect();
        let is_positive: Vec<bool> = (0..40).map(|i| i >= 15).collect();
        let trees = BoostedTrees::fit(&samples, &is_positive);
        assert_eq!(trees.trees[0][0], TreeNode::Split { feature: 1, threshold: 14.5 });
        // Newton step of the first tree: every residual is 1 − p, so the leaf is 0.1/p.
        let p = sigmoid(trees.prior);
        let leaf = value(&trees.trees[0], &[0.0, 39.0]);
        assert!((leaf - 0.1 / p).abs() < 1e-9, "{leaf}");
        assert!(trees.log_odds(&[0.0, 14.0]) < -2.0 && trees.log_odds(&[0.0, 15.0]) > 2.0);
    }

    #[test]
    fn interaction_without_main_effects_is_learnt() {
        // The class is the product of two signs, unequally frequent so that the first split gains.
        let values: Vec<[f64; 2]> =
            (0..120).map(|i| [f64::from((i * 37) % 101) - 40.0, f64::from((i * 53) % 97) - 55.0]).collect();
        let samples: Vec<&[f64]> = values.iter().map(|v| v.as_slice()).collect();
        let is_positive: Vec<bool> = values.iter().map(|v| (v[0] > 0.0) == (v[1] > 0.0)).collect();
        let trees = BoostedTrees::fit(&samples, &is_positive);
        let right = samples.iter().zip(&is_positive).filter(|(s, y)| (trees.log_odds(s) > 0.0) == **y).count();
        assert!(right >= 110, "{right} of 120");
    }

    #[test]
    fn small_leaves_and_constant_features_are_not_split() {
        let samples: Vec<&[f64]> = vec![&[1.0]; 30];
        let is_positive: Vec<bool> = (0..30).map(|i| i % 2 == 0).collect();
        let trees = BoostedTrees::fit(&samples, &is_positive);
        assert!(trees.trees.iter().all(|tree| matches!(tree[0], TreeNode::Leaf(v) if v.abs() < 1e-9)));
        let few: Vec<Vec<f64>> = (0..9).map(|i| vec![f64::from(i)]).collect();
        let few: Vec<&[f64]> = few.iter().map(Vec::as_slice).collect();
        let trees = BoostedTrees::fit(&few, &[false, false, false, false, true, true, true, true, true]);
        assert!(matches!(trees.trees[0][0], TreeNode::Leaf(_)));
    }
}
