//! Parameters of one output picture: a recorded frame, or a photograph.

use super::{Crop, Geometry, Opening};
use crate::pixels::Rect;

/// One of the exposures that a picture sums.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SummedExposure {
    /// The middle of its exposure, in seconds relative to the picture's own.
    pub time_s: f64,
    pub exposure_s: f64,
    /// Weight in the sum.
    pub weight: f64,
}

/// A film that replaces the recording's.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FilmOverride {
    /// Its speed relative to the speed at which the recording's noise was measured.
    pub speed: f64,
    pub width_mm: f64,
}

/// Parameters of one output picture.
#[derive(Clone, Debug, PartialEq)]
pub struct Capture {
    /// The area of the picture that is composited. The rest is left unchanged.
    pub region: Rect,
    /// True if all pixels of the region are computed. Otherwise pixels without virtual content keep
    /// the camera's integers.
    pub whole: bool,
    /// Exposure time of each row, seconds.
    pub exposure_time_s: f64,
    /// The aperture of the lens. `None` for a pinhole.
    pub opening: Option<Opening>,
    /// The exposures summed in the real part; at least one.
    pub summed: Vec<SummedExposure>,
    /// Exposure of the whole picture, real and virtual, relative to the recording, stops.
    pub over_ev: f64,
    /// Share of the real pixels' noise variance that remains after resampling and summing, 0 to 1.
    pub noise_left: f64,
    /// `None`: that of the recording, or of an effect's own parameters.
    pub film: Option<FilmOverride>,
    /// The recorded camera, of whose picture this one is a crop.
    pub recorded: Geometry,
    pub framed: Crop,
    /// Pixels of this picture per pixel of the recording.
    pub enlargement: f64,
}

impl Capture {
    /// A camera's frame, to which virtual content is added without other changes.
    pub fn frame(recorded: &Geometry, exposure_time_s: f64, opening: Option<Opening>) -> Self {
        Self {
            region: Rect::full(recorded.intrinsics.width_px, recorded.intrinsics.height_px),
            whole: false,
            exposure_time_s,
            opening,
            summed: vec![SummedExposure { time_s: 0.0, exposure_s: exposure_time_s, weight: 1.0 }],
            over_ev: 0.0,
            noise_left: 1.0,
            film: None,
            recorded: recorded.clone(),
            framed: Crop { left_px: 0.0, top_px: 0.0, step: 1.0 },
            enlargement: 1.0,
        }
    }
}
