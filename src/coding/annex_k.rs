//! The quantisation tables of ITU-T T.81, annex K.1, which most encoders scale.

use super::dct::BLOCK_LEN;

/// Table K.1: luminance. Row-major.
#[rustfmt::skip]
pub const LUMINANCE: [u16; BLOCK_LEN] = [
    16, 11, 10, 16,  24,  40,  51,  61,
    12, 12, 14, 19,  26,  58,  60,  55,
    14, 13, 16, 24,  40,  57,  69,  56,
    14, 17, 22, 29,  51,  87,  80,  62,
    18, 22, 37, 56,  68, 109, 103,  77,
    24, 35, 55, 64,  81, 104, 113,  92,
    49, 64, 78, 87, 103, 121, 120, 101,
    72, 92, 95, 98, 112, 100, 103,  99,
];

/// Table K.2: chrominance. Row-major.
#[rustfmt::skip]
pub const CHROMINANCE: [u16; BLOCK_LEN] = [
    17, 18, 24, 47, 99, 99, 99, 99,
    18, 21, 26, 66, 99, 99, 99, 99,
    24, 26, 56, 99, 99, 99, 99, 99,
    47, 66, 99, 99, 99, 99, 99, 99,
    99, 99, 99, 99, 99, 99, 99, 99,
    99, 99, 99, 99, 99, 99, 99, 99,
    99, 99, 99, 99, 99, 99, 99, 99,
    99, 99, 99, 99, 99, 99, 99, 99,
];

/// A table times a scale, rounded to the nearest, from 1 to 255. Scale 1 is libjpeg's quality 50,
/// and (100 − quality) / 50 those above.
pub fn scaled(table: &[u16; BLOCK_LEN], scale: f64) -> [u16; BLOCK_LEN] {
    table.map(|step| (f64::from(step) * scale).round().clamp(1.0, 255.0) as u16)
}
