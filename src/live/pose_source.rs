//! The interface of pose sources.

use std::sync::Arc;
use std::time::Instant;

use glam::DVec3;

use super::error::LiveError;
use crate::pixels::Pixels;
use crate::pose::Pose;
use crate::stream::LensState;
use crate::tracking::covariance::Covariance;

/// Supplies poses by the camera's clock. A source that finds poses in the pictures is given each
/// picture first.
pub trait PoseSource: Send {
    /// Adds a picture, before its poses are requested.
    fn add_picture(&mut self, _time_s: f64, _pixels: &Pixels) {}
    /// Takes the poses available by now, ascending in time, each once. A source that has all poses
    /// in advance returns those until `until_s`.
    fn take_poses(&mut self, until_s: f64) -> Result<Vec<(f64, Pose)>, LiveError>;
    /// Up direction of the poses' world.
    fn up(&self) -> Option<DVec3>;
    /// True if the plane through the origin, perpendicular to [`PoseSource::up`], is a surface: a
    /// printed sheet, a stage's floor.
    fn has_floor(&self) -> bool {
        false
    }
    /// Longest gap across which the poses may be interpolated, seconds.
    fn max_gap_s(&self) -> f64 {
        MAX_GAP_S
    }
    /// Takes the poses of pictures in which detection failed, dead-reckoned from the last pose by
    /// the motion of the picture.
    fn take_dead_reckoned(&mut self) -> Vec<(f64, Pose)> {
        Vec::new()
    }
    /// Covariance of one of the last returned poses, by its time.
    fn covariance(&self, _time_s: f64) -> Option<Covariance> {
        None
    }
    /// True if the poses come with lens data.
    fn has_lens_data(&self) -> bool {
        false
    }
    /// Lens state of one of the last returned poses, by its time.
    fn lens(&self, _time_s: f64) -> Option<Arc<LensState>> {
        None
    }
    /// Waits until a deadline for lens data that gives a camera for pictures of this size. Returns
    /// the latest lens state.
    fn wait_for_lens(&mut self, _size_px: (u32, u32), _until: Instant) -> Option<Arc<LensState>> {
        None
    }
    /// True if the time stamps come from another clock than the pictures'.
    fn has_own_clock(&self) -> bool {
        true
    }
    /// Takes the next message for the user.
    fn take_message(&mut self) -> Option<String> {
        None
    }
    /// Reason why there is no pose at present, if known.
    fn no_pose_reason(&self) -> Option<String> {
        None
    }
    /// Summary of all received poses at the end, unless it is reported elsewhere.
    fn summary(&self) -> Option<String> {
        None
    }
    /// True if poses arrive later than their pictures, so that frames wait for them.
    fn has_latency(&self) -> bool {
        true
    }
}

/// Longest gap that is interpolated, seconds: a hand-held camera still moves smoothly over it.
pub const MAX_GAP_S: f64 = 0.1;
