//! The light at a place by the camera's automatic exposure and white balance.
//!
//! A camera exposes a picture to a mean that hardly depends on the room. Frames are weighted by the
//! number of their points near the place: W = exp(Σ w·ln(mean light / 0.25)). Neutral is the
//! reciprocal of the gains of the same frames, because white balance belongs to the frames that see
//! the place and not to the frame of median brightness.

use glam::DVec3;

use super::gather::FrameSamples;
use super::sample::{LightSample, relative_luminance};

/// Ratio of a picture's mean linear light to that of matt white in it: 0.17 to 0.45 in real rooms.
const MEAN_BY_WHITE: f64 = 0.25;
/// Largest mean linear light of a metered picture: a brighter one shows white things, or is
/// overexposed, and its mean does not imply a brighter white.
const MAX_METERED: f64 = 0.45;
/// Radius around the place in which points count, m.
const RADIUS_M: f64 = 0.8;
/// Smallest mean of a picture, linear.
const MIN_MEAN: f64 = 1e-4;

/// Exposure of a frame, and its weight for a place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeteredFrame {
    /// Number of its points near the place.
    pub points: usize,
    pub gain: [f64; 3],
    /// Mean linear light of the whole picture, divided by its gain.
    pub mean: [f64; 3],
}

impl MeteredFrame {
    pub fn of(view: &FrameSamples, place: DVec3) -> Self {
        let is_near = |sample: &&LightSample| f64::from(sample.position_m.distance(place.as_vec3())) < RADIUS_M;
        let points = view.samples.iter().filter(is_near).count();
        Self { points, gain: view.gain, mean: view.mean }
    }
}

/// White level and neutral colour by exposure alone.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ExposureLevel {
    /// Luminance of matt white.
    pub level: f64,
    /// Colour of neutral surfaces; green is 1.
    pub neutral: [f64; 3],
}

/// If no frame sees the place, all frames have equal weight. Without frames it is the camera's own
/// white.
pub fn exposure_level(frames: &[MeteredFrame]) -> ExposureLevel {
    let points: usize = frames.iter().map(|frame| frame.points).sum();
    let weight = |frame: &MeteredFrame| match points {
        0 => 1.0 / frames.len() as f64,
        _ => frame.points as f64 / points as f64,
    };
    let mean = |of: &dyn Fn(&MeteredFrame) -> f64| frames.iter().map(|frame| weight(frame) * of(frame)).sum::<f64>();
    let metered = |frame: &MeteredFrame| {
        let shown = relative_luminance([0, 1, 2].map(|c| frame.gain[c] * frame.mean[c]));
        relative_luminance(frame.mean).max(MIN_MEAN) * (MAX_METERED / shown.max(MIN_MEAN)).min(1.0)
    };
    let level = mean(&|frame| (metered(frame) / MEAN_BY_WHITE).ln()).exp();
    let [red, green, blue] = [0, 1, 2].map(|c| (-mean(&|frame| frame.gain[c].ln())).exp());
    ExposureLevel { level, neutral: [red / green, 1.0, blue / green] }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_are_weighted_by_their_points_near_the_place() {
        // 0.1 / 0.25 = 0.4 by one frame and 0.4 / 0.25 = 1.6 by the other: 0.4^(3/4)·1.6^(1/4) =
        // 0.4·√2.
        let dark = MeteredFrame { points: 300, gain: [2.0, 1.0, 1.0], mean: [0.1; 3] };
        let bright = MeteredFrame { points: 100, gain: [1.0, 1.0, 0.5], mean: [0.4; 3] };
        let ExposureLevel { level, neutral } = exposure_level(&[dark, bright]);
        assert!((level - 0.4 * 2f64.sqrt()).abs() < 1e-9, "{level}");
        let expected = [2f64.powf(-0.75), 1.0, 2f64.powf(0.25)];
        assert!(neutral.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-9), "{neutral:?}");
        // Neither sees it: √(0.4·1.6) = 0.8.
        let unseen = exposure_level(&[MeteredFrame { points: 0, ..dark }, MeteredFrame { points: 0, ..bright }]);
        assert!((unseen.level - 0.8).abs() < 1e-9, "{unseen:?}");
        // Overexposed, by hand: a mean of 0.9 counts as 0.45, that is 0.225 in the frame of median
        // brightness.
        let over = exposure_level(&[MeteredFrame { points: 9, gain: [2.0; 3], mean: [0.45; 3] }]);
        assert!((over.level - 0.9).abs() < 1e-9, "{over:?}");
        assert_eq!(exposure_level(&[]), ExposureLevel { level: 1.0, neutral: [1.0; 3] });
    }
}
