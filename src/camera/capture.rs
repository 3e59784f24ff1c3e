//! How one picture is taken: a frame as it was recorded, or a photograph.

use super::{Framed, Geometry, Opening};
use crate::pixels::Rect;

/// One of the exposures that a picture sums.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Summed {
    /// The middle of its exposure, in seconds from the picture's own.
    pub time_s: f64,
    pub exposure_s: f64,
    /// Its share of the light.
    pub weight: f64,
}

/// A film other than that of the recording.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FilmUsed {
    /// Its speed over the speed at which the recording's noise was measured.
    pub speed: f64,
    pub width_mm: f64,
}

/// How one picture is taken.
#[derive(Clone, Debug, PartialEq)]
pub struct Capture<'a> {
    /// The columns and rows of the picture that are made. The others stay as they are.
    pub region: Rect,
    /// Whether all pixels of the region are made. If not, pixels without virtual things keep the camera's integers.
    pub whole: bool,
    /// How long each row gathers light, seconds.
    pub exposure_time_s: f64,
    /// The opening of the lens. `None` for a pinhole.
    pub opening: Option<Opening>,
    /// The exposures that the real part sums; at least one.
    pub summed: Vec<Summed>,
    /// How many stops more the whole picture, real and virtual, is exposed than it was recorded.
    pub over_ev: f64,
    /// The share of the variance of the real pixels' noise that remains after enlarging and summing, 0 to 1.
    pub noise_left: f64,
    /// `None`: that of the recording, or what an effect's own parameters say.
    pub film: Option<FilmUsed>,
    /// The recorded camera, and where in its picture this one lies.
    pub recorded: &'a Geometry,
    pub framed: Framed,
    /// Pixels of this picture per pixel of the recording.
    pub enlargement: f64,
}

impl<'a> Capture<'a> {
    /// A camera's frame, to which virtual things are added and nothing else is changed.
    pub fn frame(recorded: &'a Geometry, exposure_time_s: f64, opening: Option<Opening>) -> Self {
        Self {
            region: Rect::full(recorded.intrinsics.width_px, recorded.intrinsics.height_px),
            whole: false,
            exposure_time_s,
            opening,
            summed: vec![Summed { time_s: 0.0, exposure_s: exposure_time_s, weight: 1.0 }],
            over_ev: 0.0,
            noise_left: 1.0,
            film: None,
            recorded,
            framed: Framed { left_px: 0.0, top_px: 0.0, step: 1.0 },
            enlargement: 1.0,
        }
    }
}
