//! Projection by a pose track with a rolling shutter: each row by its own pose.

use glam::{DVec2, DVec3};

use crate::camera::Geometry;
use crate::pose::Pose;
use crate::tracking::PoseTrack;

/// Fixed-point iterations between a point's row and the row's time.
const ROW_ITERATIONS: usize = 6;

/// A moving camera with a rolling shutter.
#[derive(Clone, Copy)]
pub struct RollingCamera<'a> {
    pub track: &'a PoseTrack,
    pub geometry: &'a Geometry,
}

impl RollingCamera<'_> {
    pub fn pose(&self, time_s: f64) -> Option<Pose> {
        self.track.at(time_s).ok()
    }

    fn of_row(&self, time_s: f64, row_px: f64) -> Option<Pose> {
        let row_px = row_px.clamp(0.0, f64::from(self.geometry.intrinsics.height_px));
        self.pose(time_s + self.geometry.row_time_s(row_px))
    }

    /// The poses of a frame's rows, at their middles; `None` if one is missing.
    pub fn rows(&self, time_s: f64) -> Option<Vec<Pose>> {
        (0..self.geometry.intrinsics.height_px).map(|row| self.of_row(time_s, f64::from(row) + 0.5)).collect()
    }

    /// The projection of [`RollingCamera::project`], by the poses of a frame's rows, to the nearest
    /// row.
    pub fn project_by_rows(&self, rows: &[Pose], point: DVec3) -> Option<(DVec2, f64)> {
        let mut row = rows.len() / 2;
        let mut at_row = None;
        for _ in 0..3 {
            let there = rows.get(row)?.transform_point(point);
            let at = self.geometry.project(there).filter(|_| there.z > 0.0)?;
            (row, at_row) = ((at.y.max(0.0) as usize).min(rows.len() - 1), Some((at, there.z)));
        }
        at_row
    }

    /// The world point of a frame's pixel at a depth along the optical axis.
    pub fn unproject(&self, time_s: f64, at_px: DVec2, depth_m: f64) -> Option<DVec3> {
        let pose = self.of_row(time_s, at_px.y)?;
        Some(pose.inverse_transform_point(self.geometry.unproject(at_px)? * depth_m))
    }

    /// Projects a point into a frame: pixel and depth, m. `None` behind the camera and without a
    /// pose. The pixel can lie outside of the picture.
    pub fn project(&self, time_s: f64, point: DVec3) -> Option<(DVec2, f64)> {
        let mut row_px = f64::from(self.geometry.intrinsics.height_px) / 2.0;
        let mut at_row = None;
        for _ in 0..ROW_ITERATIONS {
            let there = self.of_row(time_s, row_px)?.transform_point(point);
            let at = self.geometry.project(there).filter(|_| there.z > 0.0)?;
            (row_px, at_row) = (at.y, Some((at, there.z)));
        }
        at_row
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DQuat;

    #[test]
    fn later_rows_are_projected_by_later_poses() {
        let mut camera = Geometry::pinhole(640, 480, 500.0);
        camera.intrinsics.readout_time_s = 0.02;
        // 1 m/s to the right.
        let at = |time_s: f64| (time_s, Pose::from_camera_in_world(DVec3::X * time_s, DQuat::IDENTITY));
        let track = PoseTrack::new((0..30).map(|n| at(0.1 * f64::from(n))).collect(), 0.2).unwrap();
        let camera = RollingCamera { track: &track.with_clock_offset_s(0.5), geometry: &camera };
        // At row 360, a quarter of the picture below its middle: 5 ms later the camera is 5 mm on,
        // at 2 m 1.25 px.
        let point = camera.unproject(0.5, DVec2::new(320.0, 360.0), 2.0).unwrap();
        assert!((point - DVec3::new(1.005, 0.48, 2.0)).length() < 1e-9, "{point}");
        let (px, depth_m) = camera.project(0.5, point).unwrap();
        assert!((px - DVec2::new(320.0, 360.0)).length() < 1e-9 && (depth_m - 2.0).abs() < 1e-12);
        // 100 ms later it is 100 mm on: 25 px to the left.
        assert!((camera.project(0.6, point).unwrap().0 - DVec2::new(295.0, 360.0)).length() < 1e-6);
        // By the middle of row 360, 0.02 ms later, to a hundredth of a pixel.
        let rows = camera.rows(0.6).unwrap();
        assert_eq!(rows.len(), 480);
        assert!((camera.project_by_rows(&rows, point).unwrap().0 - DVec2::new(295.0, 360.0)).length() < 0.01);
        assert_eq!(camera.project_by_rows(&rows, DVec3::new(0.0, 0.0, -1.0)), None);
        assert_eq!(camera.project(0.5, DVec3::new(0.0, 0.0, -1.0)), None);
        assert_eq!(camera.project(9.0, point), None);
    }
}
