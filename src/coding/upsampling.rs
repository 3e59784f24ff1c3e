//! Chroma planes at the resolution of luma, in the decoders' integer arithmetic.
//!
//! JPEG decoders interpolate between the centres of samples: weights ¾ and ¼ of the nearest and of
//! the next sample along each axis. Beyond its ends a plane repeats. They differ in rounding, and
//! in where a plane ends.

use super::SamplePlane;

/// As the `image` crate's decoder: (3 nearest + next + 2) / 4 rounded down, vertically, then
/// horizontally. The plane ends with its last block.
pub fn zune(plane: &SamplePlane<u8>, factor: [u32; 2]) -> SamplePlane<u8> {
    let blend = |nearest: u8, next: u8, _| ((3 * u16::from(nearest) + u16::from(next) + 2) >> 2) as u8;
    let tall = if factor[1] == 2 { vertical(plane, blend) } else { plane.clone() };
    if factor[0] == 2 { horizontal(&tall, blend) } else { tall }
}

/// As libjpeg-turbo's "fancy" upsampling. The plane ends with the picture's last pixel: it must be
/// cut off there. Planes of fewer than three columns are not interpolated where they are widened.
///
/// 4:2:2: the first of two pixels is (3 nearest + next + 1) / 4 rounded down, the second has + 2.
/// 4:4:0: the same between rows. 4:2:0: rows are summed with weights 3 and 1, and columns the same
/// with + 8 and + 7 of 16.
pub fn libjpeg(plane: &SamplePlane<u8>, factor: [u32; 2]) -> SamplePlane<u8> {
    let blend = |nearest: u8, next: u8, at: usize| {
        ((3 * u16::from(nearest) + u16::from(next) + 1 + (at % 2) as u16) >> 2) as u8
    };
    match factor {
        [2, _] if plane.width < 3 => repeated(plane, factor),
        [2, 2] => {
            let rows = vertical(plane, |nearest: u8, next: u8, _| 3 * u16::from(nearest) + u16::from(next));
            horizontal(&rows, |nearest: u16, next: u16, at| ((3 * nearest + next + 8 - (at % 2) as u16) >> 4) as u8)
        }
        [2, _] => horizontal(plane, blend),
        [_, 2] => vertical(plane, blend),
        _ => plane.clone(),
    }
}

/// Each sample for all of its pixels.
pub fn repeated<T: Copy>(plane: &SamplePlane<T>, factor: [u32; 2]) -> SamplePlane<T> {
    let [across, down] = factor.map(|f| f as usize);
    SamplePlane::new(across * plane.width, down * plane.height, |x, y| plane.at(x / across, y / down))
}

/// The nearest sample, and the next one on the pixel's side of it. Both are the same at an end.
fn neighbours(at: usize, length: usize) -> [usize; 2] {
    let nearest = at / 2;
    let next = if at.is_multiple_of(2) { nearest.saturating_sub(1) } else { (nearest + 1).min(length - 1) };
    [nearest, next]
}

/// `blend` gets the nearest sample, the next one, and the column.
fn horizontal<T: Copy, U>(plane: &SamplePlane<T>, blend: impl Fn(T, T, usize) -> U) -> SamplePlane<U> {
    SamplePlane::new(2 * plane.width, plane.height, |x, y| {
        let [nearest, next] = neighbours(x, plane.width);
        blend(plane.at(nearest, y), plane.at(next, y), x)
    })
}

/// `blend` gets the nearest sample, the next one, and the row.
fn vertical<T: Copy, U>(plane: &SamplePlane<T>, blend: impl Fn(T, T, usize) -> U) -> SamplePlane<U> {
    SamplePlane::new(plane.width, 2 * plane.height, |x, y| {
        let [nearest, next] = neighbours(y, plane.height);
        blend(plane.at(x, nearest), plane.at(x, next), y)
    })
}
