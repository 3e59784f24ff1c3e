//! Mixing of independent values to three correlated ones.

/// Lower triangle (l21, l22, l31, l32, l33) of the Cholesky factor of a correlation matrix with the
/// elements 1-2, 1-3, 2-3. Impossible correlations are shrunk towards 0 until the matrix is
/// positive semidefinite.
pub fn correlation_factor(correlation: [f64; 3]) -> [f64; 5] {
    let mut shrink = 1.0f64;
    loop {
        let [r12, r13, r23] = correlation.map(|c| c.clamp(-1.0, 1.0) * shrink);
        let l22 = (1.0 - r12 * r12).max(0.0).sqrt();
        let l32 = if l22 > 1e-9 { (r23 - r13 * r12) / l22 } else { 0.0 };
        let rest = 1.0 - r13 * r13 - l32 * l32;
        if rest >= 0.0 {
            return [r12, l22, r13, l32, rest.sqrt()];
        }
        shrink *= 0.98;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn factor_matches_a_hand_computed_example() {
        // r12 = 0.6: l21 = 0.6, l22 = 0.8; r13 = 0: l31 = 0; r23 = 0.4: l32 = 0.5; l33 = √0.75.
        let l = correlation_factor([0.6, 0.0, 0.4]);
        for (got, want) in l.iter().zip([0.6, 0.8, 0.0, 0.5, 0.75f64.sqrt()]) {
            assert!((got - want).abs() < 1e-12, "{l:?}");
        }
        assert!(correlation_factor([1.0, -1.0, 1.0]).iter().all(|v| v.is_finite()));
    }
}
