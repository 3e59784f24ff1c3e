//! Camera codes in the GPU's texel layout.

use crate::pixels::Rect;

/// Red, green, blue and 0 of each pixel of a rectangle, row by row, with each code converted.
/// Beyond the picture (columns, rows), edge pixels are repeated.
pub fn rgba<T: Copy, U: Default>(
    codes: &[T],
    (width, height): (u32, u32),
    rect: Rect,
    convert: impl Fn(T) -> U,
) -> Vec<[U; 4]> {
    let clamped = |at: i32, side: u32| at.clamp(0, side as i32 - 1) as usize;
    let mut out = Vec::with_capacity(rect.width() as usize * rect.height() as usize);
    for y in rect.y0..rect.y1 {
        let row = &codes[3 * width as usize * clamped(y, height)..][..3 * width as usize];
        out.extend((rect.x0..rect.x1).map(|x| {
            let pixel = &row[3 * clamped(x, width)..][..3];
            [convert(pixel[0]), convert(pixel[1]), convert(pixel[2]), U::default()]
        }));
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rectangle_beyond_the_picture_repeats_the_edge_pixels() {
        // 2 × 2 pixels.
        let codes = [1u8, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12];
        let own = |rect| rgba(&codes, (2, 2), rect, |code| code);
        assert_eq!(own(Rect::new(1, 0, 2, 2)), [[4, 5, 6, 0], [10, 11, 12, 0]]);
        assert_eq!(own(Rect::new(-1, 1, 1, 3)), [[7, 8, 9, 0]; 4]);
        assert_eq!(
            rgba(&codes, (2, 2), Rect::new(5, -4, 6, -3), |code| 257 * u16::from(code)),
            [[1028, 1285, 1542, 0]]
        );
        assert!(own(Rect::new(0, 0, 0, 2)).is_empty());
    }
}
