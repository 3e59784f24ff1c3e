//! A camera in RealityCapture's units, and its geometry for a picture's size.

use std::path::PathBuf;

use crate::camera::Geometry;
use crate::pose::Pose;
use crate::recording::RecordingError;
use crate::recording::brown_camera::BrownCamera;
use crate::recording::photogrammetry::PosedPicture;
use crate::source::still;

/// A camera as exported, in the program's units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ExportedCamera {
    pub focal_35mm: f64,
    /// Relative to the picture's centre, in units of the longer side.
    pub principal_point: [f64; 2],
    /// k1, k2, k3, k4, t1, t2.
    pub distortion: [f64; 6],
    /// Focal length in pixel heights over that in pixel widths.
    pub aspect_ratio: f64,
    /// Skew in units of the longer side.
    pub skew: f64,
}

impl ExportedCamera {
    /// The geometry for a picture's size, and a warning.
    pub fn geometry(&self, width: u32, height: u32) -> Result<(Geometry, Option<String>), String> {
        let size_px = [f64::from(width), f64::from(height)];
        let unit_px = size_px[0].max(size_px[1]);
        let focal_px = self.focal_35mm / 36.0 * unit_px;
        let [k1, k2, k3, k4, t1, t2] = self.distortion;
        let centre = |axis: usize| 0.5 * size_px[axis] + self.principal_point[axis] * unit_px;
        let camera = BrownCamera {
            size_px,
            focal_px: [focal_px, focal_px * self.aspect_ratio],
            centre_px: [centre(0), centre(1)],
            skew_px: self.skew * unit_px,
            radial: [k1, k2, k3, k4],
            tangential: [t2, t1],
        };
        camera.geometry()
    }
}

/// A picture with its pose and camera, whose geometry depends on the picture's size. A file that is
/// no picture has no geometry: its frame is left out.
pub fn posed(
    picture: PathBuf,
    pose: Option<Pose>,
    camera: Option<&ExportedCamera>,
    warnings: &mut Vec<String>,
    refuse: impl Fn(String) -> RecordingError,
) -> Result<PosedPicture, RecordingError> {
    let geometry = match camera.zip(still::read_header(&picture).ok()) {
        Some((camera, header)) => {
            let (geometry, warning) = camera.geometry(header.width, header.height).map_err(refuse)?;
            // All pictures of a camera have the same warning.
            warnings.extend(warning.filter(|warning| !warnings.contains(warning)));
            Some(geometry)
        }
        None => None,
    };
    Ok(PosedPicture { file: picture, camera_from_world: pose, geometry })
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DVec2, DVec3};

    #[test]
    fn projected_point_matches_hand_calculation() {
        // 1000×800: a unit is 1000 px, so f = 18 mm is 500 px, and the principal point (0.01,
        // −0.02) is at (510, 380).
        let camera = ExportedCamera {
            focal_35mm: 18.0,
            principal_point: [0.01, -0.02],
            distortion: [-0.1, 0.4, 0.0, 0.0, 0.02, 0.01],
            aspect_ratio: 1.01,
            skew: 0.0,
        };
        let (geometry, warning) = camera.geometry(1000, 800).unwrap();
        // u = 0.2, v = 0.1, r² = 0.05: radial 0.996; x' = 0.1992 + 0.02·(0.05 + 0.08) + 2·0.01·0.02
        // = 0.2022; y' = 0.0996 + 0.01·(0.05 + 0.02) + 2·0.02·0.02 = 0.1011.
        let at = geometry.project(DVec3::new(0.4, 0.2, 2.0)).unwrap();
        assert!(warning.is_none() && (at - DVec2::new(510.0 + 101.1, 380.0 + 0.1011 * 505.0)).length() < 1e-9, "{at}");
        // Upright, a unit is the height.
        let (geometry, _) = camera.geometry(600, 1000).unwrap();
        let i = &geometry.intrinsics;
        assert_eq!((i.fx_px, i.cx_px, i.cy_px), (500.0, 310.0, 480.0));
    }
}
