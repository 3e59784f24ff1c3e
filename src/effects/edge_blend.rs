//! Antialiasing against camera pixels: Fischer 2006, §Antialiasing.
//!
//! result = (current + Σ cameraᵢ) / (n + 1) over the n camera pixels in the 3×3 neighbourhood,
//! and `impact` between current (0) and result (1). Works on code values, as in the paper.
//! Off by default: edges are multisampled, and both together would eat the edge.
//!
//! Not modelled: the edge's direction; a pixel in a corner is softened as one on an edge.

use super::{Case, Effect, LayerRun, MixedPart, Moment};
use crate::gpu::Shader;
use crate::image::Rect;
use crate::params::Value;

crate::params! {
    /// Parameters of the edge blend.
    pub struct EdgeBlend in "edge_blend" {
        "how far an edge pixel moves towards the mean with its camera neighbours; 0 is off"
        impact: f32 = 0.0, "1", 0.0..=1.0;
    }
}

crate::uniform! {
    struct Uniform { impact: f32, unused: [f32; 3] }
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
        let uniform = Uniform { impact: self.impact, unused: [0.0; 3] };
        Some(MixedPart::new(Shader::EdgeBlend, "edge_blend", &uniform))
    }
}

/// The paper's rule on one channel: `neighbours` are the camera pixels among the eight.
pub fn twin(current: f64, neighbours: &[f64], impact: f64) -> f64 {
    let blended = (current + neighbours.iter().sum::<f64>()) / (neighbours.len() as f64 + 1.0);
    current + impact * (blended - current)
}

#[cfg(test)]
mod tests {
    use super::twin;

    #[test]
    fn the_papers_rule_by_hand() {
        // (10 + 40 + 70) / 3 = 40; half impact: 25.
        assert_eq!(twin(10.0, &[40.0, 70.0], 1.0), 40.0);
        assert_eq!(twin(10.0, &[40.0, 70.0], 0.5), 25.0);
        assert_eq!(twin(10.0, &[], 1.0), 10.0);
    }
}
