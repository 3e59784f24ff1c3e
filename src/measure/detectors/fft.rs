//! Two-dimensional discrete Fourier transform of sides that are powers of two (Cooley and Tukey
//! 1965, radix 2).

/// Columns that are transformed together, so that whole cache lines are read.
const COLUMN_GROUP: usize = 16;

/// A complex number: real part, imaginary part.
pub(super) type Complex = [f32; 2];

pub(super) fn product(a: Complex, b: Complex) -> Complex {
    [a[0] * b[0] - a[1] * b[1], a[0] * b[1] + a[1] * b[0]]
}

pub(super) fn conjugate(a: Complex) -> Complex {
    [a[0], -a[1]]
}

/// Transforms of one size.
#[derive(Clone, Debug)]
pub(super) struct Fft2 {
    pub width: usize,
    pub height: usize,
    row_roots: Vec<Complex>,
    column_roots: Vec<Complex>,
}

impl Fft2 {
    /// Transforms of the smallest powers of two from `width` and `height` on.
    pub fn holding(width: usize, height: usize) -> Self {
        let (width, height) = (width.next_power_of_two(), height.next_power_of_two());
        Self { width, height, row_roots: roots(width), column_roots: roots(height) }
    }

    /// Σ v(x, y) exp(−2πi(ux/w + vy/h)), in place, row by row. Rows from `used_rows` on must be 0.
    pub fn forward(&self, values: &mut [Complex], used_rows: usize) {
        values.chunks_exact_mut(self.width).take(used_rows).for_each(|row| transform_line(row, &self.row_roots));
        self.columns(values);
    }

    /// The inverse, without the factor 1/(w h).
    pub fn inverse(&self, values: &mut [Complex]) {
        values.iter_mut().for_each(|v| *v = conjugate(*v));
        self.forward(values, self.height);
        values.iter_mut().for_each(|v| *v = conjugate(*v));
    }

    fn columns(&self, values: &mut [Complex]) {
        let group = COLUMN_GROUP.min(self.width);
        let mut lines = vec![[0.0; 2]; group * self.height];
        for x0 in (0..self.width).step_by(group) {
            for y in 0..self.height {
                let row = &values[y * self.width + x0..][..group];
                row.iter().enumerate().for_each(|(x, v)| lines[x * self.height + y] = *v);
            }
            lines.chunks_exact_mut(self.height).for_each(|line| transform_line(line, &self.column_roots));
            for y in 0..self.height {
                let row = &mut values[y * self.width + x0..][..group];
                row.iter_mut().enumerate().for_each(|(x, v)| *v = lines[x * self.height + y]);
            }
        }
    }
}

/// exp(−2πik/n) for k up to n/2.
fn roots(length: usize) -> Vec<Complex> {
    let angle = |k: usize| -std::f64::consts::TAU * k as f64 / length as f64;
    (0..length / 2).map(|k| [angle(k).cos() as f32, angle(k).sin() as f32]).collect()
}

fn transform_line(line: &mut [Complex], roots: &[Complex]) {
    let length = line.len();
    if length < 2 {
        return;
    }
    let shift = usize::BITS - length.trailing_zeros();
    for i in 0..length {
        let j = i.reverse_bits() >> shift;
        if i < j {
            line.swap(i, j);
        }
    }
    let mut half = 1;
    while half < length {
        let stride = length / (2 * half);
        for pair in line.chunks_exact_mut(2 * half) {
            let (even, odd) = pair.split_at_mut(half);
            for ((a, b), root) in even.iter_mut().zip(odd).zip(roots.iter().step_by(stride)) {
                let turned = product(*b, *root);
                *b = [a[0] - turned[0], a[1] - turned[1]];
                *a = [a[0] + turned[0], a[1] + turned[1]];
            }
        }
        half *= 2;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn transform_matches_the_sum_of_its_definition() {
        let fft = Fft2::holding(7, 3);
        assert_eq!((fft.width, fft.height), (8, 4));
        let values: Vec<Complex> = (0..32).map(|i| [(i * i % 13) as f32, (i * 5 % 7) as f32]).collect();
        let mut found = values.clone();
        fft.forward(&mut found, 4);
        for (n, found) in found.iter().enumerate() {
            let mut expected = [0.0; 2];
            for (i, value) in values.iter().enumerate() {
                let turns = (i % 8 * (n % 8)) as f32 / 8.0 + (i / 8 * (n / 8)) as f32 / 4.0;
                let (sin, cos) = (-std::f32::consts::TAU * turns).sin_cos();
                let term = product(*value, [cos, sin]);
                expected = [expected[0] + term[0], expected[1] + term[1]];
            }
            assert!((found[0] - expected[0]).abs() < 1e-3 && (found[1] - expected[1]).abs() < 1e-3, "{n}");
        }
        fft.inverse(&mut found);
        for (found, value) in found.iter().zip(&values) {
            assert!((found[0] / 32.0 - value[0]).abs() < 1e-5 && (found[1] / 32.0 - value[1]).abs() < 1e-5);
        }
    }

    #[test]
    fn sides_of_one_pixel_are_transformed() {
        let fft = Fft2::holding(1, 2);
        let mut values = vec![[1.0, 0.0], [3.0, 0.0]];
        fft.forward(&mut values, 2);
        assert_eq!(values, [[4.0, 0.0], [-2.0, 0.0]]);
    }
}
