//! Eigenvalues and eigenvectors of symmetric 3×3 matrices.

use glam::{DMat3, DVec3};

/// Eigenvalues in ascending order with their unit eigenvectors (Jacobi 1846: rotations that zero
/// one element after another).
pub fn symmetric_eigen(mut matrix: DMat3) -> [(f64, DVec3); 3] {
    const SWEEPS: usize = 16;
    let mut axes = DMat3::IDENTITY;
    for (i, j) in (0..SWEEPS).flat_map(|_| [(0, 1), (0, 2), (1, 2)]) {
        let off_diagonal = matrix.col(j)[i];
        if off_diagonal == 0.0 {
            continue;
        }
        let angle = 0.5 * (2.0 * off_diagonal).atan2(matrix.col(j)[j] - matrix.col(i)[i]);
        let (s, c) = angle.sin_cos();
        let mut turn = DMat3::IDENTITY;
        turn.col_mut(i)[i] = c;
        turn.col_mut(j)[j] = c;
        turn.col_mut(j)[i] = s;
        turn.col_mut(i)[j] = -s;
        matrix = turn.transpose() * matrix * turn;
        axes *= turn;
    }
    let mut pairs = [0, 1, 2].map(|i| (matrix.col(i)[i], axes.col(i)));
    pairs.sort_by(|a, b| a.0.total_cmp(&b.0));
    pairs
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn eigenvalues_ascend_and_their_vectors_belong_to_them() {
        let matrix = DMat3::from_cols_array(&[2.0, -1.0, 0.5, -1.0, 3.0, 0.25, 0.5, 0.25, -1.0]);
        let pairs = symmetric_eigen(matrix);
        assert!(pairs.is_sorted_by_key(|(value, _)| *value), "{pairs:?}");
        for (value, vector) in pairs {
            assert!((matrix * vector).abs_diff_eq(value * vector, 1e-12), "{value} {vector}");
            assert!((vector.length() - 1.0).abs() < 1e-12, "{vector}");
        }
    }
}
