//! The requested and the negotiated format of a camera.

use std::fmt;

use super::driver_name::DriverName;
use super::picture::{Layout, PictureFormat};
use crate::coding::{ColorMatrix, ColorRange};

/// The requested format, of which a camera delivers the closest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FormatRequest {
    /// `None`: this system's default. Not used for a file.
    pub driver: Option<DriverName>,
    /// Width and height, px.
    pub size: (u32, u32),
    /// Pictures a second.
    pub rate_hz: f64,
    /// `None`: the first of [`Layout::PREFERRED`] that the camera has in this size at this rate.
    pub layout: Option<Layout>,
    /// Overrides the range that the driver reports; `matrix` overrides its matrix.
    pub range: Option<ColorRange>,
    pub matrix: Option<ColorMatrix>,
}

impl Default for FormatRequest {
    fn default() -> Self {
        Self { driver: None, size: (640, 480), rate_hz: 30.0, layout: None, range: None, matrix: None }
    }
}

/// Source of the times of a camera's pictures.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TimeSource {
    /// The driver's monotonic stamps.
    Driver,
    /// The driver's wall-clock stamps, converted to the monotonic clock.
    WallClock,
    /// Stamps by a clock of unknown origin, whose offset is estimated from arrivals.
    CameraClock,
    /// The time stamps of a video file.
    File,
}

impl fmt::Display for TimeSource {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Driver => "times from the driver, or of arrival where it has none",
            Self::WallClock => "times from the driver's wall clock, or of arrival where it has none",
            Self::CameraClock => "times from the camera's clock, set by the earliest arrivals",
            Self::File => "times from the file",
        })
    }
}

/// The negotiated format of a camera.
#[derive(Clone, Debug, PartialEq)]
pub struct NegotiatedFormat {
    pub driver: DriverName,
    pub name: String,
    pub picture_format: PictureFormat,
    /// Pictures a second, as reported by its driver.
    pub rate_hz: Option<f64>,
    pub times: TimeSource,
    /// True if its pictures have exposure times.
    pub has_exposure: bool,
    /// Which of range and matrix the driver does not state and nobody set, so that they are
    /// assumed.
    pub assumed: AssumedColor,
    /// Properties of a video played in its place that the pictures lose, a sentence each.
    pub warnings: Vec<String>,
}

/// Properties of Y'CbCr that are assumed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct AssumedColor {
    pub range: bool,
    pub matrix: bool,
}

impl NegotiatedFormat {
    /// Driver, times and assumptions, for a person.
    pub fn notes(&self) -> String {
        let AssumedColor { range, matrix } = self.assumed;
        let assumed = match (range, matrix) {
            (true, true) => "; range and matrix are assumed (--range, --matrix)",
            (true, false) => "; the range is assumed (--range)",
            (false, true) => "; the matrix is assumed (--matrix)",
            (false, false) => "",
        };
        format!("driver {}, {}{assumed}", self.driver, self.times)
    }
}
