//! Affine transforms in whole micrometres, so that equal places compare equal.

use glam::DAffine3;

/// Resolution: a micrometre of places, a millionth of directions.
const STEPS_PER_UNIT: f64 = 1e6;

/// A transform in whole steps, as a memo's key has it. Its value is computed from the steps.
pub type QuantizedTransform = [i64; 12];

pub fn quantize(place: &DAffine3) -> QuantizedTransform {
    place.to_cols_array().map(quantize_length)
}

pub fn dequantize(steps: &QuantizedTransform) -> DAffine3 {
    DAffine3::from_cols_array(&steps.map(|step| step as f64 / STEPS_PER_UNIT))
}

pub fn quantize_length(length: f64) -> i64 {
    (length * STEPS_PER_UNIT).round() as i64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_place_comes_back_to_a_micrometre() {
        let place = DAffine3::from_translation(glam::DVec3::new(1.234_567_4, -2.0, 1e-7));
        assert_eq!(dequantize(&quantize(&place)).translation, glam::DVec3::new(1.234_567, -2.0, 0.0));
    }
}
