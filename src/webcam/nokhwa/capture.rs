//! Pictures from a camera of nokhwa.

use nokhwa::utils::CameraFormat;
use nokhwa::{Camera, NokhwaError};

use super::errors;
use super::system::System;
use crate::webcam::buffer;
use crate::webcam::clock::monotonic_s;
use crate::webcam::driver::{Capture, Sample};
use crate::webcam::picture::Delivered;

/// An open camera. It is read as soon as a picture comes, for on macOS nokhwa returns the oldest of the pictures that
/// wait and discards the others.
pub struct NokhwaCapture {
    camera: Camera,
    format: CameraFormat,
    delivered: Delivered,
    system: System,
}

impl NokhwaCapture {
    pub fn new(
        mut camera: Camera,
        format: CameraFormat,
        delivered: Delivered,
        system: System,
    ) -> Result<Self, NokhwaError> {
        if system.opens_stream_early() {
            camera.open_stream()?;
        }
        Ok(Self { camera, format, delivered, system })
    }
}

impl Capture for NokhwaCapture {
    fn next(&mut self) -> Result<Option<Sample>, String> {
        if !self.camera.is_stream_open() {
            self.camera.open_stream().map_err(|error| errors::stopped(&error))?;
        }
        let buffer = self.camera.frame().map_err(|error| errors::stopped(&error))?;
        let arrived_s = monotonic_s();
        let is_agreed =
            buffer.resolution() == self.format.resolution() && buffer.source_frame_format() == self.format.format();
        let (delivered, bytes) = buffer::fit(self.delivered, buffer.buffer_bytes().into());
        Ok(Some(Sample {
            delivered,
            bytes,
            stamp: self.system.stamp(buffer.capture_timestamp()),
            arrived_s,
            exposure_s: None,
            lost: 0,
            is_damaged: !is_agreed,
        }))
    }
}
