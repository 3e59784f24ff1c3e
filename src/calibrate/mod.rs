//! Calibration of a camera from its own pictures: its noise, how sharp it is, and how it maps rays
//! to places.
//!
//! docs/calibration.md has the derivations.

mod bins;
mod blocks;
pub mod board;
mod censoring;
mod common_motion;
mod example;
mod example_report;
mod footage;
pub mod geometry;
mod load;
pub mod noise;
mod picked;
mod picked_region;
mod plane;
mod points;
mod rendered_noise;
mod report;
mod rest;
mod resting_example;
mod rounding;
mod sampling_plan;
mod scene_sums;
pub mod sharpness;
mod single;
pub mod textureless;
mod unsteady;
mod warning;

pub use bins::BinReport;
pub use example_report::{ExampleCalibration, ExampleMethod, NoExample};
pub use footage::is_picture;
pub use load::{LoadProgress, MeasuredNoise, NoiseSource, noise_from_paths};
pub use noise::{CalibrateError, NoiseCalibration, NoiseCalibrator, NoiseOptions, SceneMotion};
pub use picked::{PickedNoise, PickedResult, picked_noise};
pub use picked_region::{PickedError, PickedRegion, RegionError, min_side_px};
pub use points::{NoisePoint, sigma_over_profile};
pub use rendered_noise::rendered_noise;
pub use rest::RestSearch;
pub use resting_example::RestingExample;
pub use warning::Warning;
