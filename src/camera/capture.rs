//! How one picture is taken: a frame as it was recorded, or a photograph of the whole.

use super::{Framed, Geometry, Opening};
use crate::pixels::Rect;

/// One of the exposures whose light a picture sums.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Summed {
    /// The middle of its exposure, seconds from the picture's own.
    pub time_s: f64,
    pub exposure_s: f64,
    /// Its share of the light.
    pub weight: f64,
}

/// Film, beside that with which the recording was taken.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FilmUsed {
    /// Speed over that at which the recording's noise was measured.
    pub speed: f64,
    pub width_mm: f64,
}

/// How one picture is taken.
#[derive(Clone, Debug, PartialEq)]
pub struct Capture<'a> {
    /// Which columns and rows of the picture are made; the others stay as they are.
    pub region: Rect,
    /// Whether every pixel of the region is made, as of a photograph; else those alone in which something virtual is,
    /// and the others stay the camera's integers.
    pub whole: bool,
    /// How long each row gathers light, seconds.
    pub exposure_time_s: f64,
    /// The lens; none for a pinhole.
    pub opening: Option<Opening>,
    /// What the real part sums; at least one.
    pub summed: Vec<Summed>,
    /// By how many stops the whole picture, real and virtual, is exposed more than it was recorded.
    pub over_ev: f64,
    /// What enlarging and summing leave of the variance of the real pixels' noise, 0 to 1.
    pub noise_left: f64,
    /// None: that of the recording, or what an effect's own parameters say.
    pub film: Option<FilmUsed>,
    /// The camera that was recorded, and where in its pictures this one lies.
    pub recorded: &'a Geometry,
    pub framed: Framed,
    /// Pixels of this picture for one of the recording.
    pub enlargement: f64,
}

impl<'a> Capture<'a> {
    /// A frame of a camera's, to which virtual things are added while nothing else is changed.
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
