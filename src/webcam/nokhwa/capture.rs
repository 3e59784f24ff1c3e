//! Pictures from a camera of nokhwa.

use std::sync::{Mutex, PoisonError};

use nokhwa::utils::CameraFormat;
use nokhwa::{Camera, NokhwaError};

use super::errors;
use super::system::System;
use crate::webcam::buffer;
use crate::webcam::clock::monotonic_s;
use crate::webcam::driver::{DriverPicture, DriverStream};
use crate::webcam::picture::PictureFormat;

/// The numbers of the cameras that this program has open.
static OPEN: Mutex<Vec<usize>> = Mutex::new(Vec::new());

/// Whether this program has a camera open. See [`System::opens_to_list`].
pub fn is_open(number: usize) -> bool {
    OPEN.lock().unwrap_or_else(PoisonError::into_inner).contains(&number)
}

/// A number's entry among those that are open.
struct OpenNumber(usize);

impl OpenNumber {
    fn new(number: usize) -> Self {
        OPEN.lock().unwrap_or_else(PoisonError::into_inner).push(number);
        Self(number)
    }
}

impl Drop for OpenNumber {
    fn drop(&mut self) {
        let mut open = OPEN.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(at) = open.iter().position(|number| *number == self.0) {
            open.swap_remove(at);
        }
    }
}

/// An open camera. It is read as soon as a picture comes, for on macOS nokhwa returns the oldest of
/// the pictures that wait and discards the others.
pub struct NokhwaCapture {
    camera: Camera,
    format: CameraFormat,
    picture_format: PictureFormat,
    system: System,
    _number: OpenNumber,
}

impl NokhwaCapture {
    pub fn new(
        number: usize,
        mut camera: Camera,
        format: CameraFormat,
        picture_format: PictureFormat,
        system: System,
    ) -> Result<Self, NokhwaError> {
        if system.opens_stream_early() {
            camera.open_stream()?;
        }
        Ok(Self { camera, format, picture_format, system, _number: OpenNumber::new(number) })
    }
}

impl DriverStream for NokhwaCapture {
    fn next(&mut self) -> Result<Option<DriverPicture>, String> {
        if !self.camera.is_stream_open() {
            self.camera.open_stream().map_err(|error| errors::stopped(&error))?;
        }
        let buffer = self.camera.frame().map_err(|error| errors::stopped(&error))?;
        let arrived_s = monotonic_s();
        let is_agreed =
            buffer.resolution() == self.format.resolution() && buffer.source_frame_format() == self.format.format();
        let (picture_format, bytes) = buffer::fit(self.picture_format, buffer.buffer_bytes().into());
        Ok(Some(DriverPicture {
            picture_format,
            bytes,
            stamp: self.system.stamp(buffer.capture_timestamp()),
            arrived_s,
            exposure_s: None,
            dropped_frames: 0,
            is_damaged: !is_agreed,
        }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn camera_is_open_while_one_capture_holds_its_number() {
        // No machine has as many cameras.
        let number = usize::MAX;
        let (first, second) = (OpenNumber::new(number), OpenNumber::new(number));
        assert!(is_open(number) && !is_open(number - 1));
        drop(first);
        assert!(is_open(number));
        drop(second);
        assert!(!is_open(number));
    }
}
