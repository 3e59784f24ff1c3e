//! Antialiasing against camera pixels: Fischer 2006, §Antialiasing.
//!
//! result = (current + Σ cameraᵢ) / (n + 1) over the n camera pixels in the 3×3 neighbourhood, and
//! `impact` interpolates between current (0) and result (1). Works on code values, as in the paper.
//!
//! In the paper a pixel is either an object's or the camera's, so an edge is hard. Multisampling
//! and blur make it soft, and a material may be transparent. Coverage A of 0 to 1 is then a stack
//! of hard masks, one for each level u: the mask at u contains the pixels with A > u. For a
//! straight edge that moved or was blurred, these are the edge's positions, weighted by their
//! duration. The paper's rule applies at each level, and the result is the mean over the pixel's
//! levels:
//!
//! result = current + impact · Σ sᵢ (cameraᵢ − current), sᵢ = 1/A ∫ du / (n(u) + 1) from Aᵢ to A,
//! over the neighbours with Aᵢ < A
//!
//! where n(u) counts the neighbours with Aᵢ ≤ u. So
//!
//! - a hard edge has one level, and sᵢ is the paper's 1 / (n + 1);
//! - inside a surface of constant coverage, transparent or not, no neighbour is covered less, and
//!   nothing changes;
//! - the total loss of an edge is independent of its softness: blending the mean of edges gives the
//!   mean of the blended edges;
//! - a surface whose coverage is scaled by α loses α times as much: sᵢ has only ratios of coverage.
//!
//! The last two assume equal camera pixels in the neighbourhood. The pixel's own camera share,
//! 1 − A, does not change: current − camera is A times the object's contribution.
//!
//! Off by default: edges are multisampled, and both together would erode the edge.
//!
//! Not modelled: the edge's direction. A pixel in a corner is softened like one on an edge. Edges
//! that cross within a pixel count as nested.

use super::{Case, Effect, FrameContext, LayerRun, MixedPart};
use crate::gpu::Shader;
use crate::params::Value;
use crate::pixels::Rect;

crate::params! {
    /// Parameters of the edge blend.
    pub struct EdgeBlend in "edge_blend" at Mix {
        "how far an edge pixel moves towards the mean of itself and its camera neighbours; 0 is off"
        impact as "Amount": f32 = 0.0, "1", 0.0..=1.0;
    }
}

crate::uniform! {
    struct EdgeBlendUniform { impact: f32 }
}

impl Effect for EdgeBlend {
    fn summary(&self) -> &'static str {
        "blends an object's edge pixels with their camera neighbours"
    }
    fn neutral_hint(&self) -> &'static str {
        "its amount is 0; a larger value enables it"
    }
    fn is_neutral(&self, _: &FrameContext<'_>) -> bool {
        self.impact == 0.0
    }
    fn cases(&self) -> Vec<Case> {
        vec![("", vec![("impact", Value::Number(1.0))])]
    }
    fn mix(&self, _: &mut LayerRun<'_>, _: Rect) -> Option<MixedPart> {
        let uniform = EdgeBlendUniform { impact: self.impact };
        Some(MixedPart::new(Shader::EdgeBlend, "edge_blend", &uniform))
    }
}

/// The rule for one channel. `covered`: the pixel's own coverage. `neighbours`: of those in the
/// picture among the eight, the camera's code value and the coverage.
pub fn twin(current: f64, covered: f64, neighbours: &[(f64, f64)], impact: f64) -> f64 {
    let mut less: Vec<_> = neighbours.iter().copied().filter(|(_, a)| *a < covered).collect();
    less.sort_by(|(_, a), (_, b)| a.total_cmp(b));
    // Level by level: among the n that are covered least, the mean of the pixel and the camera.
    let tops = less.iter().map(|(_, a)| *a).skip(1).chain([covered]);
    let moved = (1..).zip(less.iter().zip(tops)).map(|(n, ((_, level), top))| {
        let camera: f64 = less[..n].iter().map(|(code, _)| code).sum();
        (top - level) * ((current + camera) / (n + 1) as f64 - current)
    });
    if covered > 0.0 { current + impact * moved.sum::<f64>() / covered } else { current }
}

#[cfg(test)]
mod tests {
    use super::twin;
    use proptest::prelude::*;

    #[test]
    fn blend_matches_the_papers_rule_on_hand_computed_examples() {
        // (10 + 40 + 70) / 3 = 40; half impact: 25.
        assert_eq!(twin(10.0, 1.0, &[(40.0, 0.0), (70.0, 0.0)], 1.0), 40.0);
        assert_eq!(twin(10.0, 1.0, &[(40.0, 0.0), (70.0, 0.0), (90.0, 1.0)], 0.5), 25.0);
        assert_eq!(twin(10.0, 1.0, &[], 1.0), 10.0);
        // Half of the levels have one camera neighbour: half of the way to (10 + 40) / 2.
        assert_eq!(twin(10.0, 0.5, &[(40.0, 0.25), (40.0, 0.5), (40.0, 1.0)], 1.0), 17.5);
        // Below 0.5 only 70 is the camera's, above both: 10 + 0.5 · 30 + 0.5 · 30.
        assert_eq!(twin(10.0, 1.0, &[(40.0, 0.5), (70.0, 0.0)], 1.0), 40.0);
        assert_eq!(twin(10.0, 0.0, &[(40.0, 0.0)], 1.0), 10.0);
    }

    /// The remaining coverage of a white object in front of black.
    fn left(covered: f64, around: &[f64]) -> f64 {
        twin(covered, covered, &around.iter().map(|a| (0.0, *a)).collect::<Vec<_>>(), 1.0)
    }

    proptest! {
        #[test]
        fn uniform_coverage_stays_and_scaled_coverage_loses_in_proportion(
            covered in 0.01f64..1.0, around in prop::collection::vec(0.0f64..1.0, 8), alpha in 0.01f64..1.0,
        ) {
            prop_assert_eq!(left(covered, &[covered; 8]), covered);
            let fainter: Vec<f64> = around.iter().map(|a| alpha * a).collect();
            prop_assert!((left(alpha * covered, &fainter) - alpha * left(covered, &around)).abs() < 1e-12);
        }

        #[test]
        fn blend_of_the_mean_of_edges_is_the_mean_of_blended_edges(
            order in Just((0..9).collect::<Vec<usize>>()).prop_shuffle(), visible_shares in prop::collection::vec(0.01f64..1.0, 9),
        ) {
            // An edge that passes over nine pixels in turn, and rests before each for a share of
            // the time.
            let whole: f64 = visible_shares.iter().sum();
            let (mut mean, mut blended) = ([0.0; 9], 0.0);
            for (passed, share) in visible_shares.iter().map(|s| s / whole).enumerate() {
                let hard: Vec<f64> = (0..9).map(|i| f64::from(order[i] <= passed)).collect();
                (0..9).for_each(|i| mean[i] += share * hard[i]);
                blended += share * left(hard[0], &hard[1..]);
            }
            prop_assert!((left(mean[0], &mean[1..]) - blended).abs() < 1e-12);
        }
    }
}
