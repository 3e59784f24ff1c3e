//! Zero padding of a map, so that window filters need no bounds checks.

use crate::parallel::{over_rows, processors};

/// The values `of` `count` pixels in rows of `width`, with `border` zeros above, below and on the
/// left. Zeros on the right make rows of `padded_width`.
pub fn pad(
    count: usize,
    width: usize,
    border: usize,
    padded_width: usize,
    of: &(dyn Fn(usize) -> f32 + Sync),
) -> Vec<f32> {
    let height = count / width.max(1);
    let mut all = vec![0.0; padded_width * (height + 2 * border)];
    over_rows(&mut all[border * padded_width..][..height * padded_width], padded_width, processors(), |y, row| {
        row[border..][..width].iter_mut().enumerate().for_each(|(x, value)| *value = of(y * width + x));
    });
    all
}

#[cfg(test)]
mod tests {
    use super::pad;

    #[test]
    fn values_are_surrounded_by_zeros() {
        let value = |i: usize| i as f32 + 1.0;
        let (none, rows) = ([0.0; 5], [[0.0, 1.0, 2.0, 0.0, 0.0], [0.0, 3.0, 4.0, 0.0, 0.0]]);
        assert_eq!(pad(4, 2, 1, 5, &value), [none, rows[0], rows[1], none].concat());
        assert!(pad(0, 0, 0, 0, &value).is_empty());
    }
}
