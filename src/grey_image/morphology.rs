//! Grey-scale morphology with a square: the largest or smallest value around each pixel.

/// Maximum over the square of half width `reach` around each pixel.
pub fn dilated(values: &[f32], width: usize, reach: usize) -> Vec<f32> {
    extrema(values, width, reach, f32::NEG_INFINITY, |a, b| if a > b { a } else { b })
}

/// Minimum over the square of half width `reach` around each pixel.
pub fn eroded(values: &[f32], width: usize, reach: usize) -> Vec<f32> {
    extrema(values, width, reach, f32::INFINITY, |a, b| if a < b { a } else { b })
}

/// Along rows, then along columns. `neutral` is the value beyond the border.
fn extrema(values: &[f32], width: usize, reach: usize, neutral: f32, of: impl Fn(f32, f32) -> f32) -> Vec<f32> {
    let width = width.max(1);
    let mut rows = Vec::with_capacity(values.len());
    for row in values.chunks_exact(width) {
        rows.extend(sliding(row, 1, reach, neutral, &of));
    }
    sliding(&rows, width, reach, neutral, &of)
}

/// Sliding extremum over ±`reach` lines of `length` values each. The window grows by doubling; two
/// overlapping ones of the last size make up the whole window.
fn sliding(lines: &[f32], length: usize, reach: usize, neutral: f32, of: impl Fn(f32, f32) -> f32) -> Vec<f32> {
    let reach = reach.min(lines.len() / length);
    let padding = vec![neutral; reach * length];
    let mut extrema = [&padding, lines, &padding].concat();
    let of_two = |extrema: &[f32], offset: usize| -> Vec<f32> {
        extrema.iter().zip(&extrema[offset * length..]).map(|(a, b)| of(*a, *b)).collect()
    };
    let window = 2 * reach + 1;
    let mut covered = 1;
    while 2 * covered <= window {
        (extrema, covered) = (of_two(&extrema, covered), 2 * covered);
    }
    of_two(&extrema, window - covered)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn extrema_equal_a_direct_search() {
        let (width, height) = (23, 17);
        let values: Vec<f32> = (0..width * height).map(|i| (i * 37 % 101) as f32 / 10.0).collect();
        for reach in [0, 1, 2, 5, 7, 40] {
            let neighbourhood = |i: usize| {
                let (x, y) = (i % width, i / width);
                let rows = y.saturating_sub(reach)..(y + reach + 1).min(height);
                let columns = x.saturating_sub(reach)..(x + reach + 1).min(width);
                rows.flat_map(move |y| columns.clone().map(move |x| y * width + x)).map(|i| values[i])
            };
            let expected = |of: fn(f32, f32) -> f32, start: f32| -> Vec<f32> {
                (0..values.len()).map(|i| neighbourhood(i).fold(start, of)).collect()
            };
            assert_eq!(dilated(&values, width, reach), expected(f32::max, 0.0), "{reach}");
            assert_eq!(eroded(&values, width, reach), expected(f32::min, 99.0), "{reach}");
        }
        assert!(dilated(&[], 0, 3).is_empty());
    }
}
