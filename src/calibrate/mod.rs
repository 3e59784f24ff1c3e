//! Calibration of a camera from its own pictures: its noise, how sharp it is, and how it maps rays to places.
//!
//! docs/calibration.md has the derivations.

mod bins;
mod blocks;
pub mod board;
mod censoring;
mod common_motion;
mod drawn;
pub mod geometry;
mod load;
pub mod moving;
pub mod noise;
mod picked;
mod places;
mod plane;
mod points;
mod report;
mod rounding;
mod scene_sums;
pub mod sharpness;
mod single;
mod unsteady;
mod warning;

pub use bins::BinReport;
pub use drawn::drawn_noise;
pub use load::{Progress, is_picture, moving_noise_from_paths, noise_from_paths};
pub use noise::{CalibrateError, NoiseCalibration, NoiseCalibrator, NoiseOptions, SceneMotion};
pub use picked::{Picked, PickedNoise, picked_noise};
pub use places::{PickedError, Place, Unfit, least_px};
pub use points::{NoisePoint, over_profile};
pub use warning::Warning;
