//! The camera of a recording, as all its views share it.

use super::carried;
use crate::camera::Geometry;

/// Levels of a picture: the coarsest is about this wide, px.
const COARSEST: usize = 80;
/// How far away the things of a room are, m.
const USUAL_M: f64 = 1.5;

/// Measured depths of one surface differ by less, m and by share: what a Kinect's sensor and an edge's neighbourhood make of it.
const SAME_M: f64 = 0.04;
const SAME: f64 = 0.04;

/// Whether a depth that was measured is of the surface that lies so far away, m, or of one before or behind it.
pub fn is_same(measured_m: f64, far_m: f64, slack_m: f64) -> bool {
    (measured_m - far_m).abs() < SAME_M + SAME * far_m + slack_m
}

/// What is the same for all views of a recording.
#[derive(Debug)]
pub struct Eye {
    pub geometry: Geometry,
    pub rays: Vec<[f32; 3]>,
    /// How far inverse depths of one surface may lie apart, 1/m: 0 where depth was measured.
    pub loose: f64,
    /// How far away things are, where only that is needed, m or the recording's unit.
    pub usual_m: f64,
}

impl Eye {
    pub fn new(geometry: Geometry) -> Self {
        Self { rays: carried::rays(&geometry), geometry, loose: 0.0, usual_m: USUAL_M }
    }

    /// How far depths of one surface may lie apart there, besides what a sensor's do, m.
    pub fn slack_m(&self, far_m: f64) -> f64 {
        self.loose * far_m * far_m
    }

    pub fn size(&self) -> (usize, usize) {
        (self.geometry.intrinsics.width_px as usize, self.geometry.intrinsics.height_px as usize)
    }

    pub fn levels(&self) -> usize {
        let width = self.size().0;
        (1..).take_while(|level| width >> level >= COARSEST).count() + 1
    }
}
