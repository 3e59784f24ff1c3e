//! Defects of real recordings, added to simulated ones: automatic exposure and white balance, pose
//! errors, clock offsets, repeated pictures, people walking past. Each follows from [`Flaws::seed`]
//! and a time or frame number, so a frame does not depend on which others are rendered. Each is
//! described where it is implemented.
//!
//! Not modelled: automatic exposure that changes the exposure time or the noise; autofocus.

use super::path::START_S;
use super::random::Random;
use super::random_walk::{RandomSteps, SmoothWalk};

/// Knot intervals of the random walks of exposure and white balance, s.
const EXPOSURE_KNOT_S: f64 = 0.7;
const WHITE_BALANCE_KNOT_S: f64 = 1.0;

/// Keys of the random numbers, in addition to the seed.
const EXPOSURE_KEY: u64 = 1;
const STEP_KEY: u64 = 2;
const RED_KEY: u64 = 3;
const BLUE_KEY: u64 = 4;
const REPEAT_KEY: u64 = 5;

crate::choices! {
    /// A depth sensor with a measured error model.
    pub enum DepthSensorModel {
        /// Kinect v1: structured light, registered to the frames' view by its driver.
        Kinect = "kinect",
    }
}

crate::params! {
    /// Defects of a recording. The default is none.
    pub struct Flaws in "flaws" {
        "largest smooth drift of automatic exposure, either way" exposure_walk_ev: f64 = 0.0, "EV", 0.0..=5.0;
        "largest jump of automatic exposure" exposure_step_ev: f64 = 0.0, "EV", 0.0..=5.0;
        "how often it jumps" exposure_steps_per_s: f64 = 2.0, "1/s", 0.01..=100.0;
        "largest share by which automatic white balance makes red and blue brighter or darker than green" white_balance_share: f64 = 0.0, "1", 0.0..=0.5;
        "share of the contrast between parts of a picture that the camera removes, as phones do" local_tone_share: f64 = 0.0, "1", 0.0..=1.0;
        "independent position error of each pose, root mean square" jitter_mm: f64 = 0.0, "mm", 0.0..=1000.0;
        "independent rotation error of each pose, root mean square" jitter_deg: f64 = 0.0, "deg", 0.0..=90.0;
        "largest smooth drift of the poses' positions" drift_mm: f64 = 0.0, "mm", 0.0..=1000.0;
        "largest smooth drift of the poses' rotations" drift_deg: f64 = 0.0, "deg", 0.0..=90.0;
        "distance of the camera from the tracked point" hand_eye_mm: f64 = 0.0, "mm", 0.0..=1000.0;
        "rotation of the camera against the tracked body" hand_eye_deg: f64 = 0.0, "deg", 0.0..=90.0;
        "how far the poses' clock is ahead of the pictures' clock" poses_later_s: f64 = 0.0, "s", -1.0..=1.0;
        "how much later than its time stamp depth was measured" depth_later_s: f64 = 0.0, "s", -1.0..=1.0;
        "sensor whose errors depth has, unless another depth_ option overrides them; none: depth is exact" depth_sensor: Option<DepthSensorModel> = None;
        "distance of the depth sensor's projector to the right of its camera; in the projector's shadow there is no depth; none: by depth_sensor" depth_projector_mm: Option<f64> = None, "mm", -1000.0..=1000.0;
        "distance of the depth sensor's camera to the left of the frames' camera; its map is reprojected into the frames' view, where surfaces hidden from it have no depth; none: by depth_sensor" depth_moved_mm: Option<f64> = None, "mm", -1000.0..=1000.0;
        "smallest light of the projector that yields depth: reflectance times cosine over distance squared; none: by depth_sensor" depth_faintest_per_m2: Option<f64> = None, "1/m²", 0.0..=100.0;
        "how much wider near objects are in depth than in the picture, each side, px of a map 640 wide; none: by depth_sensor" depth_wider_px: Option<f64> = None, "px", 0.0..=20.0;
        "displacement of depth's ragged edges, root mean square, px of a map 640 wide; none: by depth_sensor" depth_torn_px: Option<f64> = None, "px", 0.0..=20.0;
        "correlation length of ragged edges, noise and flickering holes, the σ of a Gaussian, px of a map 640 wide; none: by depth_sensor" depth_grain_px: Option<f64> = None, "px", 0.0..=20.0;
        "depth's noise at 1 m, root mean square before quantization; it grows with the distance squared; none: by depth_sensor" depth_noise_mm: Option<f64> = None, "mm", 0.0..=100.0;
        "depth's quantization step at 1 m; it grows with the distance squared; none: by depth_sensor" depth_step_mm: Option<f64> = None, "mm", 0.0..=100.0;
        "share of single pixels without depth; none: by depth_sensor" depth_missing_share: Option<f64> = None, "1", 0.0..=1.0;
        "share of single pixels with a random depth; none: by depth_sensor" depth_wrong_share: Option<f64> = None, "1", 0.0..=1.0;
        "share of the frames whose picture is that of the frame before" repeat_share: f64 = 0.0, "1", 0.0..=0.9;
        "speed of a person who walks to and fro in the room; 0 for nobody" person_m_per_s: f64 = 0.0, "m/s", 0.0..=20.0;
        "whether all surfaces are equally bright, without pattern or shading" blank: bool = false;
        "seed of all of these" seed: u64 = 1, "1", 0.0..=9007199254740991.0;
    }
}

impl Flaws {
    /// True if the recording deviates from the ground truth.
    pub fn is_any(&self) -> bool {
        Self { seed: 0, ..self.clone() } != Self { seed: 0, ..Self::default() }
    }

    /// True if the camera changes its exposure, white balance or tone.
    pub fn is_automatic(&self) -> bool {
        self.exposure_walk_ev > 0.0
            || self.exposure_step_ev > 0.0
            || self.white_balance_share > 0.0
            || self.local_tone_share > 0.0
    }

    /// Gains of red, green and blue at a time. The exposure's are powers of two (stops). White
    /// balance leaves green unchanged.
    pub fn gains(&self, time_s: f64) -> [f64; 3] {
        let after_s = time_s - START_S;
        let walk = |what, every_s| SmoothWalk::new([self.seed, what], every_s).at(after_s);
        let steps = RandomSteps { keys: [self.seed, STEP_KEY], interval_s: self.exposure_steps_per_s.recip() };
        let stops =
            self.exposure_walk_ev * walk(EXPOSURE_KEY, EXPOSURE_KNOT_S) + self.exposure_step_ev * steps.at(after_s);
        let balance = |what| (1.0 + self.white_balance_share).powf(walk(what, WHITE_BALANCE_KNOT_S));
        [balance(RED_KEY), 1.0, balance(BLUE_KEY)].map(|balance| stops.exp2() * balance)
    }

    /// Index of the frame whose picture this frame shows: itself, or an earlier one if it is
    /// repeated.
    pub fn source_frame(&self, frame: usize) -> usize {
        let repeats = |frame: usize| {
            frame > 0 && Random::new([self.seed, REPEAT_KEY, frame as u64, 0]).uniform() < self.repeat_share
        };
        (0..=frame).rev().find(|frame| !repeats(*frame)).unwrap_or(0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn default_flaws_change_nothing() {
        let none = Flaws { seed: 9, ..Flaws::default() };
        assert!(!none.is_any() && !none.is_automatic());
        assert_eq!(none.gains(1.7), [1.0; 3]);
        assert!((0..100).all(|frame| none.source_frame(frame) == frame));
        assert!(Flaws { depth_later_s: -0.01, ..none }.is_any());
    }

    #[test]
    fn exposure_and_white_balance_stay_within_the_requested_range() {
        let flaws = Flaws { exposure_step_ev: 1.5, white_balance_share: 0.1, ..Flaws::default() };
        let gains: Vec<[f64; 3]> = (0..6000).map(|n| flaws.gains(1.0 + 0.01 * f64::from(n))).collect();
        let stops = |of: &[f64; 3]| of[1].log2();
        assert!(gains.iter().all(|of| stops(of).abs() <= 0.75));
        let jumps: Vec<f64> =
            gains.windows(2).map(|pair| (stops(&pair[1]) - stops(&pair[0])).abs()).filter(|jump| *jump > 0.0).collect();
        assert_eq!(jumps.len(), 120, "two a second for a minute");
        assert!(jumps.iter().fold(0.0, |largest, jump| jump.max(largest)) > 1.0);
        for channel in [0, 2] {
            let largest_ln = gains.iter().map(|of| (of[channel] / of[1]).ln().abs()).fold(0.0, f64::max);
            assert!(largest_ln > 0.6 * 1.1f64.ln() && largest_ln <= 1.1f64.ln() + 1e-12, "{largest_ln}");
        }
    }

    #[test]
    fn repeated_pictures_have_the_requested_share() {
        let flaws = Flaws { repeat_share: 0.25, ..Flaws::default() };
        let repeats: Vec<usize> = (0..4000).filter(|frame| flaws.source_frame(*frame) != *frame).collect();
        // Standard error 27.
        assert!((repeats.len() as f64 - 1000.0).abs() < 110.0, "{}", repeats.len());
        for frame in repeats {
            assert_eq!(flaws.source_frame(frame), flaws.source_frame(frame - 1));
        }
        assert_eq!(flaws.source_frame(0), 0);
    }
}
