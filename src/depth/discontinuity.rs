//! Depth discontinuities and colour distance.

/// Neighbouring depths that differ by more than this factor belong to two surfaces. A floor seen
/// under 15° from 4 m changes by 1 % from row to row. `DEPTH_STEP` of shaders/real_part.wgsl and
/// shaders/shadow_mask.wgsl is the same.
pub const DEPTH_STEP: f32 = 1.04;

/// True if two neighbouring depths belong to two surfaces. Unknown depth is 0, a step to any other.
pub fn is_step(a_m: f32, b_m: f32) -> bool {
    a_m.max(b_m) > DEPTH_STEP * a_m.min(b_m)
}

/// Euclidean distance of two colours (square roots of light).
pub fn color_distance(a: &[f32; 3], b: &[f32; 3]) -> f32 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum::<f32>().sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shaders_have_the_same_discontinuity_threshold() {
        let shaders = [include_str!("../../shaders/real_part.wgsl"), include_str!("../../shaders/shadow_mask.wgsl")];
        for shader in shaders {
            let line = shader.lines().find_map(|line| line.strip_prefix("const DEPTH_STEP: f32 = ")).unwrap();
            assert_eq!(line.trim_end_matches(';').parse::<f32>().unwrap(), DEPTH_STEP);
        }
    }

    #[test]
    fn is_step_matches_examples_by_hand() {
        assert!(is_step(1.0, 1.05) && is_step(1.05, 1.0) && is_step(0.0, 1.0));
        assert!(!is_step(1.0, 1.03) && !is_step(0.0, 0.0));
    }

    #[test]
    fn color_distance_matches_an_example_by_hand() {
        assert_eq!(color_distance(&[0.1, 0.5, 0.2], &[0.1, 0.2, 0.6]), 0.5);
    }
}
