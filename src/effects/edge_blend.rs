//! Antialiasing against camera pixels: Fischer 2006, §Antialiasing.
//!
//! result = (current + Σ cameraᵢ) / (n + 1) over the n camera pixels in the 3×3 neighbourhood, and `impact`
//! interpolates between current (0) and result (1). Works on code values, as in the paper.
//!
//! In the paper a pixel is either an object's or the camera's. With edges softened by sampling or blur, a pixel is
//! partly both: a neighbour with coverage Aᵢ has the weight (1 − Aᵢ), and a pixel with coverage A moves by A of the
//! way. For hard edges that is the paper's rule. Off by default: edges are multisampled, and both together would erode
//! the edge.
//!
//! Not modelled: the edge's direction. A pixel in a corner is softened like one on an edge.

use super::{Case, Effect, LayerRun, MixedPart, Moment};
use crate::gpu::Shader;
use crate::params::Value;
use crate::pixels::Rect;

crate::params! {
    /// Parameters of the edge blend.
    pub struct EdgeBlend in "edge_blend" {
        "how far an edge pixel moves towards the mean with its camera neighbours; 0 is off"
        impact: f32 = 0.0, "1", 0.0..=1.0;
    }
}

crate::uniform! {
    struct Uniform { impact: f32 }
}

impl Effect for EdgeBlend {
    fn summary(&self) -> &'static str {
        "blends an object's edge pixels with their camera neighbours"
    }
    fn is_neutral(&self, _: &Moment<'_>) -> bool {
        self.impact == 0.0
    }
    fn cases(&self) -> Vec<Case> {
        vec![("", vec![("impact", Value::Number(1.0))])]
    }
    fn mix(&self, _: &mut LayerRun<'_>, _: Rect) -> Option<MixedPart> {
        let uniform = Uniform { impact: self.impact };
        Some(MixedPart::new(Shader::EdgeBlend, "edge_blend", &uniform))
    }
}

/// The rule for one channel. `neighbours`: the camera's code values among the eight, each with the camera's share of
/// the pixel. `covered`: the pixel's own coverage.
pub fn twin(current: f64, covered: f64, neighbours: &[(f64, f64)], impact: f64) -> f64 {
    let weight: f64 = neighbours.iter().map(|(_, w)| w).sum();
    let blended = (current + neighbours.iter().map(|(code, w)| w * code).sum::<f64>()) / (weight + 1.0);
    current + impact * covered * (blended - current)
}

#[cfg(test)]
mod tests {
    use super::twin;

    #[test]
    fn the_papers_rule_by_hand() {
        // (10 + 40 + 70) / 3 = 40; half impact: 25.
        assert_eq!(twin(10.0, 1.0, &[(40.0, 1.0), (70.0, 1.0)], 1.0), 40.0);
        assert_eq!(twin(10.0, 1.0, &[(40.0, 1.0), (70.0, 1.0)], 0.5), 25.0);
        assert_eq!(twin(10.0, 1.0, &[], 1.0), 10.0);
        // Soft: (10 + 0.5 · 40) / 1.5 = 20; a half-covered pixel goes half of the way.
        assert_eq!(twin(10.0, 0.5, &[(40.0, 0.5)], 1.0), 15.0);
    }
}
