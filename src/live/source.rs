//! Where poses come from.

use std::sync::Arc;
use std::time::Instant;

use glam::DVec3;

use super::error::LiveError;
use crate::pixels::Pixels;
use crate::pose::Pose;
use crate::stream::LensState;
use crate::tracking::covariance::Covariance;

/// Poses for a camera's frames, by the camera's clock. What finds them in the pictures gets these first.
pub trait PoseSource: Send {
    /// Sees a frame, before its poses are asked for.
    fn picture(&mut self, _time_s: f64, _pixels: &Pixels) {}
    /// The poses that are known by now and were not given before, ascending in time. Those of a source that knows them
    /// all come as far as `until_s`.
    fn poses(&mut self, until_s: f64) -> Result<Vec<(f64, Pose)>, LiveError>;
    /// Which way is up in their world.
    fn up(&self) -> Option<DVec3>;
    /// Whether the plane through their world's origin, across [`PoseSource::up`], is a surface: a sheet, a stage's floor.
    fn has_floor(&self) -> bool {
        false
    }
    /// The longest interval across which they may be interpolated, seconds.
    fn max_gap_s(&self) -> f64 {
        MAX_GAP_S
    }
    /// Poses of pictures in which nothing was found, carried on from the last one by how the picture moved; not given before.
    fn carried(&mut self) -> Vec<(f64, Pose)> {
        Vec::new()
    }
    /// How sure a pose is that was given last, by its time.
    fn covariance(&self, _time_s: f64) -> Option<Covariance> {
        None
    }
    /// Whether they come with what is known of the lens.
    fn says_lens(&self) -> bool {
        false
    }
    /// What was said of the lens with a pose that was given last, by its time.
    fn lens(&self, _time_s: f64) -> Option<Arc<LensState>> {
        None
    }
    /// Waits, at most until then, for a lens of which a camera for such pictures can be made: what is known of it by then.
    fn first_lens(&mut self, _size_px: (u32, u32), _until: Instant) -> Option<Arc<LensState>> {
        None
    }
    /// Whether they come by a clock of their own, which may be apart from the pictures'.
    fn has_clock(&self) -> bool {
        true
    }
    /// What a person should know of them by now; each once.
    fn told(&mut self) -> Option<String> {
        None
    }
    /// Why there is none now, if that is known.
    fn lacks(&self) -> Option<String> {
        None
    }
    /// What became of all that came, once it is over; nothing where that is told otherwise.
    fn closing(&self) -> Option<String> {
        None
    }
    /// Whether they come later than the pictures, so that frames wait for them.
    fn are_awaited(&self) -> bool {
        true
    }
}

/// A tenth of a second: a hand-held camera still moves smoothly.
pub const MAX_GAP_S: f64 = 0.1;
