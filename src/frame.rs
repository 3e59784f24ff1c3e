//! One moment of a recording.

use crate::pixels::{DepthMap, Pixels};

/// A frame as the camera delivered it. Never changed in place.
#[derive(Clone, Debug)]
pub struct Frame {
    /// Position in the recording's order, from 0.
    pub index: usize,
    /// The middle of the middle row's exposure, seconds on the recording's clock.
    pub timestamp_s: f64,
    pub pixels: Pixels,
    /// What stands where in the room, registered to the colour picture; `None` without a sensor.
    pub depth: Option<DepthMap>,
    pub exposure: FrameExposure,
}

/// How long it is from a frame to the next, seconds: by their times where the next one's is known; else, at a recording's end or
/// in a stream whose next frame is still to come, as usual.
pub fn interval_s(timestamps_s: &[f64], index: usize, usual_s: f64) -> f64 {
    let time_s = |i: usize| timestamps_s.get(i).copied();
    let next = index.checked_add(1).and_then(time_s);
    next.zip(time_s(index)).map_or(usual_s, |(next, this)| next - this)
}

/// What the camera said of this frame's exposure; `None` where it said nothing.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FrameExposure {
    /// How long each row gathered light, seconds on the recording's clock: what moves is blurred
    /// that long. `None` too where that clock is only nominal; see [`PhotoSettings::time_s`].
    pub time_s: Option<f64>,
    /// Amplification relative to the recording's base, a factor.
    pub gain: Option<f64>,
    /// What the picture's own file says.
    pub photo: PhotoSettings,
}

/// The settings that a picture was taken with, as its file (EXIF) gives them; all above 0 but `taken_s`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PhotoSettings {
    /// How long the shutter was open, seconds.
    pub time_s: Option<f64>,
    /// Focal length over opening.
    pub f_number: Option<f64>,
    /// Film speed.
    pub iso: Option<f64>,
    /// Of the lens focused at infinity, metres; makers round it to millimetres.
    pub focal_length_m: Option<f64>,
    /// When, by the camera's clock, whose time zone nobody tells: seconds since 1970-01-01 0:00 of that clock.
    pub taken_s: Option<f64>,
}

#[cfg(test)]
mod tests {
    #[test]
    fn the_newest_frames_interval_is_the_usual_one() {
        let interval = |index| super::interval_s(&[1.0, 1.5, 1.75], index, 0.04);
        assert_eq!([0, 1, 2, 3, usize::MAX].map(interval), [0.5, 0.25, 0.04, 0.04, 0.04]);
    }
}
