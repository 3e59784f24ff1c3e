//! The camera model that all frames of a recording share.

use super::depth_at_frame;
use crate::camera::Geometry;

/// Approximate width of the coarsest pyramid level, px.
const COARSEST_WIDTH_PX: usize = 80;
/// Assumed distance of the scene, m.
const TYPICAL_DEPTH_M: f64 = 1.5;

/// Largest difference between measured depths of one surface: an absolute part, m, and a relative
/// one. It covers the error of a Kinect's sensor and the neighbourhood of depth edges.
const SAME_SURFACE_M: f64 = 0.04;
const SAME_SURFACE_SHARE: f64 = 0.04;

/// True if a measured depth belongs to the surface at depth `far_m`, false if it belongs to one in
/// front of or behind it.
pub fn is_same_surface(measured_m: f64, far_m: f64, depth_tolerance_m: f64) -> bool {
    (measured_m - far_m).abs() < SAME_SURFACE_M + SAME_SURFACE_SHARE * far_m + depth_tolerance_m
}

/// Intrinsics, rays and depth tolerance of a recording.
#[derive(Debug)]
pub struct CameraModel {
    pub geometry: Geometry,
    /// One ray per pixel, of unit depth.
    pub rays: Vec<[f32; 3]>,
    /// Largest difference between inverse depths of one surface, 1/m; 0 for measured depth.
    pub inverse_depth_tolerance: f64,
    /// Typical distance of the scene, m or the recording's unit. Used where a rough value is
    /// enough.
    pub typical_depth_m: f64,
}

impl CameraModel {
    pub fn new(geometry: Geometry) -> Self {
        Self {
            rays: depth_at_frame::pixel_rays(&geometry),
            geometry,
            inverse_depth_tolerance: 0.0,
            typical_depth_m: TYPICAL_DEPTH_M,
        }
    }

    /// Largest difference between depths of one surface at a depth, in addition to the sensor's
    /// error, m.
    pub fn depth_tolerance_m(&self, far_m: f64) -> f64 {
        self.inverse_depth_tolerance * far_m * far_m
    }

    pub fn size(&self) -> (usize, usize) {
        (self.geometry.intrinsics.width_px as usize, self.geometry.intrinsics.height_px as usize)
    }

    /// Number of pyramid levels.
    pub fn levels(&self) -> usize {
        let width = self.size().0;
        (1..).take_while(|level| width >> level >= COARSEST_WIDTH_PX).count() + 1
    }
}
