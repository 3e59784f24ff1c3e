//! Zero padding of a map, so that window filters need no bounds checks.

use crate::parallel::{over_rows, processors};

/// Of `count` pixels in rows of `width`: `of` each, with `rim` zeros above and below, and on the left; on the right as many as make
/// rows `wide`.
pub fn pad(count: usize, width: usize, rim: usize, wide: usize, of: &(dyn Fn(usize) -> f32 + Sync)) -> Vec<f32> {
    let height = count / width.max(1);
    let mut all = vec![0.0; wide * (height + 2 * rim)];
    over_rows(&mut all[rim * wide..][..height * wide], wide, processors(), |y, row| {
        row[rim..][..width].iter_mut().enumerate().for_each(|(x, value)| *value = of(y * width + x));
    });
    all
}

#[cfg(test)]
mod tests {
    use super::pad;

    #[test]
    fn by_hand() {
        let of = |i: usize| i as f32 + 1.0;
        let (none, rows) = ([0.0; 5], [[0.0, 1.0, 2.0, 0.0, 0.0], [0.0, 3.0, 4.0, 0.0, 0.0]]);
        assert_eq!(pad(4, 2, 1, 5, &of), [none, rows[0], rows[1], none].concat());
        assert!(pad(0, 0, 0, 0, &of).is_empty());
    }
}
