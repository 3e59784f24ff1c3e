//! Noise by example of frames at rest that are read elsewhere.

use super::example::ExampleSampler;
use super::example_report::{ExampleCalibration, NoExample};
use super::noise::{CalibrateError, NoiseCalibrator, NoiseOptions};
use crate::pixels::Pixels;

/// Calibrates from the frames of a camera at rest, which are added in order.
#[derive(Debug)]
pub struct RestingExample(NoiseCalibrator);

impl RestingExample {
    /// Expects `frames` frames.
    pub fn new(frames: usize) -> Result<Self, CalibrateError> {
        let mut calibrator = NoiseCalibrator::new(NoiseOptions::default())?;
        calibrator.sample_examples(Some(ExampleSampler::new(1)));
        calibrator.expect_frames(frames);
        calibrator.begin_scene(None)?;
        Ok(Self(calibrator))
    }

    pub fn add(&mut self, pixels: &Pixels) -> Result<(), CalibrateError> {
        self.0.add_frame(pixels)
    }

    /// The outer error is that of frames which are not at rest.
    pub fn finish(mut self) -> Result<Result<ExampleCalibration, NoExample>, CalibrateError> {
        self.0.end_scene()?;
        Ok(self.0.take_sampler().map_or(Err(NoExample::TooFewFrames { frames: 0 }), ExampleSampler::finish))
    }
}
