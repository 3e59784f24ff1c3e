//! Places in whole steps, so that equal places compare equal.

use glam::{DAffine3, DVec3};

/// Resolution of places and directions.
#[derive(Clone, Copy, Debug)]
pub struct PlaceGrid {
    steps_per_unit: f64,
}

/// Resolution for parts of objects: a micrometre of places, a millionth of directions.
pub const MICROMETRES: PlaceGrid = PlaceGrid { steps_per_unit: 1e6 };
/// Resolution for planes and lamps, finer than the single precision of the light that they
/// determine.
pub const NANOMETRES: PlaceGrid = PlaceGrid { steps_per_unit: 1e9 };

/// A transform in whole steps, as a memo's key has it. Its value is computed from the steps.
pub type QuantizedTransform = [i64; 12];

impl PlaceGrid {
    pub fn quantize(self, place: &DAffine3) -> QuantizedTransform {
        place.to_cols_array().map(|length| self.steps(length))
    }

    pub fn dequantize(self, steps: &QuantizedTransform) -> DAffine3 {
        DAffine3::from_cols_array(&steps.map(|steps| self.length(steps)))
    }

    pub fn quantize_point(self, point: DVec3) -> [i64; 3] {
        point.to_array().map(|length| self.steps(length))
    }

    pub fn dequantize_point(self, steps: [i64; 3]) -> DVec3 {
        DVec3::from_array(steps.map(|steps| self.length(steps)))
    }

    fn steps(self, length: f64) -> i64 {
        (length * self.steps_per_unit).round() as i64
    }

    fn length(self, steps: i64) -> f64 {
        steps as f64 / self.steps_per_unit
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_place_comes_back_to_a_step() {
        let point = DVec3::new(1.234_567_890_4, -2.0, 1e-10);
        let place = DAffine3::from_translation(point);
        let back = MICROMETRES.dequantize(&MICROMETRES.quantize(&place));
        assert_eq!(back.translation, DVec3::new(1.234_568, -2.0, 0.0));
        let back = NANOMETRES.dequantize_point(NANOMETRES.quantize_point(point));
        assert_eq!(back, DVec3::new(1.234_567_89, -2.0, 0.0));
    }
}
