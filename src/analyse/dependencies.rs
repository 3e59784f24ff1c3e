//! Inputs of the estimates besides the recording's files and the camera.

use serde::{Deserialize, Serialize};

use crate::recording::Recording;

/// Tolerances of the unit, relative, and of the components of up.
const SAME_UNIT: f64 = 1e-9;
const SAME_UP: f64 = 1e-6;

/// `[made_with]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Dependencies {
    /// Length of the recording's unit, m.
    pub metres_per_unit: f64,
    /// Whether the format is in metres.
    pub is_metric: bool,
    /// Whether the frames' times are real ones.
    pub has_times: bool,
    /// Up in the recording's world, if it was stated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub up: Option<[f64; 3]>,
}

impl Default for Dependencies {
    fn default() -> Self {
        Self { metres_per_unit: 1.0, is_metric: true, has_times: true, up: None }
    }
}

impl Dependencies {
    pub fn of(recording: &Recording) -> Self {
        Self {
            metres_per_unit: recording.metres_per_unit,
            is_metric: recording.kind.is_metric(),
            has_times: recording.kind.has_times(),
            up: recording.up.map(|up| up.to_array()),
        }
    }

    pub fn has_unit_of(&self, other: &Self) -> bool {
        self.is_metric == other.is_metric && (self.metres_per_unit / other.metres_per_unit - 1.0).abs() < SAME_UNIT
    }

    pub fn has_up_of(&self, other: &Self) -> bool {
        match (self.up, other.up) {
            (Some(a), Some(b)) => a.iter().zip(b).all(|(a, b)| (a - b).abs() < SAME_UP),
            (a, b) => a == b,
        }
    }
}
