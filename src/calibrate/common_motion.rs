//! How much of the change between two pictures a single motion of the whole picture explains (Lucas
//! and Kanade 1981). `unsteady.rs` interprets it.

use super::rounding::CODES16_PER_CODE8;

const REDUCED_BY: [usize; 3] = [1, 4, 16];
/// Fewer pixels than this cannot distinguish motion from chance.
const MIN_PIXELS: usize = 500;
/// A constant, and the six parameters of an affine motion.
const UNKNOWNS: usize = 7;

/// Energies of the differences so far: the total, and the part that a motion explains in the
/// picture reduced by each factor.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct CommonMotion {
    all: f64,
    explained: [f64; REDUCED_BY.len()],
}

impl CommonMotion {
    /// Adds two pictures' interleaved R, G, B. Only green is used.
    pub fn add(&mut self, width: usize, height: usize, before: &[u16], after: &[u16]) {
        let green =
            |codes: &[u16]| codes.iter().skip(1).step_by(3).map(|&c| f64::from(c) / CODES16_PER_CODE8 as f64).collect();
        let mut pictures: [Vec<f64>; 2] = [green(before), green(after)];
        let (mut width, mut height, mut factor) = (width, height, 1);
        let n = (width * height) as f64;
        let differences = || pictures[1].iter().zip(&pictures[0]).map(|(b, a)| b - a);
        let mean = differences().sum::<f64>() / n;
        self.all += differences().map(|d| (d - mean).powi(2)).sum::<f64>();
        for (explained, reduced_by) in self.explained.iter_mut().zip(REDUCED_BY) {
            let by = reduced_by / factor;
            if by > 1 {
                pictures = pictures.map(|picture| reduce(&picture, width, height, by));
            }
            (width, height, factor) = (width / by, height / by, reduced_by);
            if width < 3 || height < 3 || width * height < MIN_PIXELS {
                break;
            }
            *explained += explained_by_motion(&pictures, width, height) * (reduced_by * reduced_by) as f64;
        }
    }

    /// The largest share over the reductions, 0 to 1.
    pub fn share(&self) -> f64 {
        let largest = self.explained.iter().copied().fold(0.0, f64::max);
        // Less than one 16-bit step in one pixel is rounding.
        if self.all > 1e-6 { largest / self.all } else { 0.0 }
    }
}

/// Means of squares of `by` × `by` pixels. Incomplete squares at the edges are left out.
fn reduce(picture: &[f64], width: usize, height: usize, by: usize) -> Vec<f64> {
    let (columns, rows) = (width / by, height / by);
    let mut reduced = vec![0.0; columns * rows];
    for (row, line) in picture.chunks_exact(width).take(rows * by).enumerate() {
        for (cell, values) in reduced[row / by * columns..].iter_mut().zip(line.chunks_exact(by)) {
            *cell += values.iter().sum::<f64>() / (by * by) as f64;
        }
    }
    reduced
}

/// How much of Σ(b − a)² the motion explains, beyond a constant. The normal equations are
/// eliminated in order; each unknown explains its squared right side over its pivot.
fn explained_by_motion([a, b]: &[Vec<f64>; 2], width: usize, height: usize) -> f64 {
    let mut matrix = [[0.0; UNKNOWNS]; UNKNOWNS];
    let mut right = [0.0; UNKNOWNS];
    for y in 1..height - 1 {
        let v = y as f64 / height as f64 - 0.5;
        for x in 1..width - 1 {
            let (i, u) = (y * width + x, x as f64 / width as f64 - 0.5);
            let middle = |i: usize| a[i] + b[i];
            let across = middle(i + 1) - middle(i - 1);
            let down = middle(i + width) - middle(i - width);
            let row = [1.0, across, down, across * u, across * v, down * u, down * v];
            for (j, p) in row.into_iter().enumerate() {
                right[j] += p * (b[i] - a[i]);
                for (sum, q) in matrix[j].iter_mut().zip(row).skip(j) {
                    *sum += p * q;
                }
            }
        }
    }
    let diagonal: [f64; UNKNOWNS] = std::array::from_fn(|i| matrix[i][i]);
    let mut explained = 0.0;
    for i in 0..UNKNOWNS {
        let eliminating = matrix[i];
        let pivot = eliminating[i];
        // Not independent of the earlier unknowns: the picture has no gradient in that direction.
        if pivot <= 1e-9 * diagonal[i] || pivot <= 0.0 {
            continue;
        }
        explained += if i > 0 { right[i] * right[i] / pivot } else { 0.0 };
        for j in i + 1..UNKNOWNS {
            let factor = eliminating[j] / pivot;
            for (value, above) in matrix[j].iter_mut().zip(eliminating).skip(j) {
                *value -= factor * above;
            }
            right[j] -= factor * right[i];
        }
    }
    explained
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A smooth picture seen from (x, y), green only, with noise that changes from frame to frame.
    fn picture(x: f64, y: f64, noise: f64, seed: u64) -> Vec<u16> {
        let mut state = seed;
        (0..64 * 48)
            .flat_map(|i| {
                let (px, py) = ((i % 64) as f64 + x, (i / 64) as f64 + y);
                state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
                let random = (state >> 33) as f64 / f64::from(1 << 30) - 1.0;
                let value = 120.0 + 40.0 * (px / 9.0).sin() * (py / 7.0).cos() + noise * random;
                [0, (value * CODES16_PER_CODE8 as f64) as u16, 0]
            })
            .collect()
    }

    fn share(from: &[u16], to: &[u16]) -> f64 {
        let mut motion = CommonMotion::default();
        motion.add(64, 48, from, to);
        motion.share()
    }

    #[test]
    fn shift_explains_all_changes_and_noise_and_light_none() {
        let still = picture(0.0, 0.0, 1.0, 1);
        assert!(share(&picture(0.0, 0.0, 0.0, 1), &picture(0.4, -0.3, 0.0, 2)) > 0.9);
        assert!(share(&still, &picture(0.4, -0.3, 1.0, 2)) > 0.2);
        assert!(share(&still, &picture(0.0, 0.0, 1.0, 2)) < 0.02);
        let brighter: Vec<u16> = still.iter().map(|c| c.saturating_add(2570)).collect();
        assert!(share(&still, &brighter) < 1e-6);
    }

    #[test]
    fn pictures_without_gradients_have_no_common_motion() {
        assert_eq!(share(&[7; 64 * 48 * 3], &[9; 64 * 48 * 3]), 0.0);
        assert_eq!(share(&[7; 64 * 48 * 3], &[7; 64 * 48 * 3]), 0.0);
    }
}
