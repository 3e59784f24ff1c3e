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
        "how far automatic exposure wanders either way, smoothly, at most" exposure_walk_ev: f64 = 0.0, "EV", 0.0..=5.0;
        "how far automatic exposure jumps, at most" exposure_step_ev: f64 = 0.0, "EV", 0.0..=5.0;
        "how often it jumps" exposure_steps_per_s: f64 = 2.0, "1/s", 0.01..=100.0;
        "share by which automatic white balance makes red and blue brighter or darker than green, at most" white_balance_share: f64 = 0.0, "1", 0.0..=0.5;
        "share of the contrast between parts of a picture that the camera takes away, as phones do" local_tone_share: f64 = 0.0, "1", 0.0..=1.0;
        "how far each pose is off by itself, root mean square" jitter_mm: f64 = 0.0, "mm", 0.0..=1000.0;
        "how far each pose is turned by itself, root mean square" jitter_deg: f64 = 0.0, "deg", 0.0..=90.0;
        "how far poses drift, smoothly, at most" drift_mm: f64 = 0.0, "mm", 0.0..=1000.0;
        "how far poses drift by turning, at most" drift_deg: f64 = 0.0, "deg", 0.0..=90.0;
        "how far the camera stands from what was tracked" hand_eye_mm: f64 = 0.0, "mm", 0.0..=1000.0;
        "how far the camera is turned against what was tracked" hand_eye_deg: f64 = 0.0, "deg", 0.0..=90.0;
        "how much later than the pictures' clock the poses' clock says" poses_later_s: f64 = 0.0, "s", -1.0..=1.0;
        "how much later than it says depth was measured" depth_later_s: f64 = 0.0, "s", -1.0..=1.0;
        "sensor whose errors depth has, where no other depth_ number says otherwise; none: depth is exact" depth_sensor: Option<DepthSensorModel> = None;
        "how far right of its camera the depth sensor's projector stands, in whose shade there is no depth; none: as depth_sensor has it" depth_projector_mm: Option<f64> = None, "mm", -1000.0..=1000.0;
        "how far left of the frames' camera the depth sensor's camera stands whose map was brought into the frames' view: what it does not see has no depth; none: as depth_sensor has it" depth_moved_mm: Option<f64> = None, "mm", -1000.0..=1000.0;
        "the least of the projector's light with which there is depth: the share that a surface throws back, by the cosine, by the distance squared; none: as depth_sensor has it" depth_faintest_per_m2: Option<f64> = None, "1/m²", 0.0..=100.0;
        "how much wider than in the picture near things are in depth, each side, px of a map 640 wide; none: as depth_sensor has it" depth_wider_px: Option<f64> = None, "px", 0.0..=20.0;
        "how far depth's edges are torn, root mean square, px of a map 640 wide; none: as depth_sensor has it" depth_torn_px: Option<f64> = None, "px", 0.0..=20.0;
        "how far torn edges, noise and flickering holes hang together, the σ of a Gaussian, px of a map 640 wide; none: as depth_sensor has it" depth_grain_px: Option<f64> = None, "px", 0.0..=20.0;
        "depth's noise at 1 m, root mean square before its steps; it grows with the distance squared; none: as depth_sensor has it" depth_noise_mm: Option<f64> = None, "mm", 0.0..=100.0;
        "depth's steps at 1 m; they grow with the distance squared; none: as depth_sensor has it" depth_step_mm: Option<f64> = None, "mm", 0.0..=100.0;
        "share of lone pixels without depth; none: as depth_sensor has it" depth_missing_share: Option<f64> = None, "1", 0.0..=1.0;
        "share of lone pixels with any depth; none: as depth_sensor has it" depth_wrong_share: Option<f64> = None, "1", 0.0..=1.0;
        "share of the frames whose picture is that of the frame before" repeat_share: f64 = 0.0, "1", 0.0..=0.9;
        "speed of a person who walks to and fro in the room; 0 for nobody" person_m_per_s: f64 = 0.0, "m/s", 0.0..=20.0;
        "whether all surfaces shine alike, without pattern or shade" blank: bool = false;
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
        assert!(jumps.iter().fold(0.0, |most, jump| jump.max(most)) > 1.0);
        for channel in [0, 2] {
            let most = gains.iter().map(|of| (of[channel] / of[1]).ln().abs()).fold(0.0, f64::max);
            assert!(most > 0.6 * 1.1f64.ln() && most <= 1.1f64.ln() + 1e-12, "{most}");
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
