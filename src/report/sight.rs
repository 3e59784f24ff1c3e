//! Where a point of the room is seen by a track: each row by its own pose.

use glam::{DVec2, DVec3};

use crate::camera::Geometry;
use crate::pose::Pose;
use crate::tracking::PoseTrack;

/// The row's time is put into where the point lands, and that into the row's time. It settles within a few.
const ROUNDS: usize = 6;

/// A camera on its way.
#[derive(Clone, Copy)]
pub struct Sight<'a> {
    pub track: &'a PoseTrack,
    /// Added to frame times to get the track's, seconds.
    pub later_s: f64,
    pub camera: &'a Geometry,
}

impl Sight<'_> {
    pub fn pose(&self, time_s: f64) -> Option<Pose> {
        self.track.at(time_s + self.later_s).ok()
    }

    fn of_row(&self, time_s: f64, row_px: f64) -> Option<Pose> {
        let row_px = row_px.clamp(0.0, f64::from(self.camera.intrinsics.height_px));
        self.pose(time_s + self.camera.row_time_s(row_px))
    }

    /// One for each of a frame's rows, at its middle; `None` without one of them.
    pub fn rows(&self, time_s: f64) -> Option<Vec<Pose>> {
        (0..self.camera.intrinsics.height_px).map(|row| self.of_row(time_s, f64::from(row) + 0.5)).collect()
    }

    /// As [`Sight::seen`], by the poses of a frame's rows, to the nearest row.
    pub fn seen_by_rows(&self, rows: &[Pose], point: DVec3) -> Option<(DVec2, f64)> {
        let mut row = rows.len() / 2;
        let mut found = None;
        for _ in 0..3 {
            let there = rows.get(row)?.transform_point(point);
            let at = self.camera.project(there).filter(|_| there.z > 0.0)?;
            (row, found) = ((at.y.max(0.0) as usize).min(rows.len() - 1), Some((at, there.z)));
        }
        found
    }

    /// The world's point that a frame shows at a place, `depth_m` away along the optical axis.
    pub fn point(&self, time_s: f64, at_px: DVec2, depth_m: f64) -> Option<DVec3> {
        let pose = self.of_row(time_s, at_px.y)?;
        Some(pose.inverse_transform_point(self.camera.unproject(at_px)? * depth_m))
    }

    /// Where a frame shows a point, px, and its depth there, m. `None` behind the camera and without a pose; the place may lie
    /// beside the picture.
    pub fn seen(&self, time_s: f64, point: DVec3) -> Option<(DVec2, f64)> {
        let mut row_px = f64::from(self.camera.intrinsics.height_px) / 2.0;
        let mut found = None;
        for _ in 0..ROUNDS {
            let there = self.of_row(time_s, row_px)?.transform_point(point);
            let at = self.camera.project(there).filter(|_| there.z > 0.0)?;
            (row_px, found) = (at.y, Some((at, there.z)));
        }
        found
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DQuat;

    #[test]
    fn a_row_that_is_read_later_sees_the_camera_farther_on() {
        let mut camera = Geometry::pinhole(640, 480, 500.0);
        camera.intrinsics.readout_time_s = 0.02;
        // 1 m/s to the right.
        let at = |time_s: f64| (time_s, Pose::from_camera_in_world(DVec3::X * time_s, DQuat::IDENTITY));
        let track = PoseTrack::new((0..30).map(|n| at(0.1 * f64::from(n))).collect(), 0.2).unwrap();
        let sight = Sight { track: &track, later_s: 0.5, camera: &camera };
        // At row 360, a quarter of the picture below its middle: 5 ms later the camera is 5 mm on, at 2 m 1.25 px.
        let point = sight.point(0.5, DVec2::new(320.0, 360.0), 2.0).unwrap();
        assert!((point - DVec3::new(1.005, 0.48, 2.0)).length() < 1e-9, "{point}");
        let (px, depth_m) = sight.seen(0.5, point).unwrap();
        assert!((px - DVec2::new(320.0, 360.0)).length() < 1e-9 && (depth_m - 2.0).abs() < 1e-12);
        // 100 ms later it is 100 mm on: 25 px to the left.
        assert!((sight.seen(0.6, point).unwrap().0 - DVec2::new(295.0, 360.0)).length() < 1e-6);
        // By the middle of row 360, 0.02 ms later, to a hundredth of a pixel.
        let rows = sight.rows(0.6).unwrap();
        assert_eq!(rows.len(), 480);
        assert!((sight.seen_by_rows(&rows, point).unwrap().0 - DVec2::new(295.0, 360.0)).length() < 0.01);
        assert_eq!(sight.seen_by_rows(&rows, DVec3::new(0.0, 0.0, -1.0)), None);
        assert_eq!(sight.seen(0.5, DVec3::new(0.0, 0.0, -1.0)), None);
        assert_eq!(sight.seen(9.0, point), None);
    }
}
