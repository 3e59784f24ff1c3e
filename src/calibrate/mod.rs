//! Calibration of a camera's noise from its own pictures.
//!
//! docs/calibration.md has the derivations.

mod bins;
mod blocks;
mod censoring;
mod common_motion;
mod load;
pub mod moving;
pub mod noise;
mod plane;
mod report;
mod rounding;
mod scene_sums;
mod unsteady;

pub use bins::BinReport;
pub use load::{Progress, is_picture, moving_noise_from_paths, noise_from_paths};
pub use noise::{CalibrateError, NoiseCalibration, NoiseCalibrator, NoiseOptions, SceneMotion};
