//! Samples of surface radiance: measured points of frames spread over the recording, with the light
//! of those frames' pictures there.
//!
//! Depth and picture of a frame have different times, and each row has its own pose. So each point
//! is projected into the picture by the pose of the row that shows it.

use std::sync::Arc;

use glam::{DVec2, DVec3};

use crate::camera::{Geometry, Response};
use crate::compositor::project_rolling;
use crate::frame::Frame;
use crate::pose::Pose;
use crate::profile::Rig;
use crate::recording::Recording;
use crate::shadow::{SurfaceRadiance, SurfaceSample};
use crate::source::ahead::Ahead;
use crate::support::RoomPoints;

/// Largest distance of a sample: farther samples are sparser than cells of [`SurfaceRadiance`],
/// with less accurate depth, m.
const MAX_DISTANCE_M: f64 = 4.0;

/// Radiance of the surfaces of the measured points. Frames without pose or gain, and unreadable
/// pictures, contribute no samples.
pub fn radiance_of(
    recording: &Recording,
    rig: &Rig,
    response: &Response,
    measured: &Arc<RoomPoints>,
) -> SurfaceRadiance {
    let (pictures, rig, response, measured) =
        (recording.without_depth(), rig.clone(), response.clone(), measured.clone());
    let count = measured.frames.len();
    let samples_of = move |n: usize| {
        let (frame, range) = &measured.frames[n];
        let frame = pictures.frames(*frame..frame + 1).ok()?.next()?.ok()?;
        let geometry = rig.geometry_over(pictures.geometry_at_frame(frame.index))?;
        let points = measured.points[range.clone()].iter();
        let near = points.filter(|point| point.at_m.distance(point.camera_m) < MAX_DISTANCE_M).map(|point| point.at_m);
        Some(samples(near, &frame, &geometry, &response, &pictures))
    };
    let Ok(samples) = Ahead::new(0..count, samples_of) else { return SurfaceRadiance::default() };
    SurfaceRadiance::of(samples.filter_map(|of_frame| of_frame.ok().flatten()).flatten())
}

/// Samples of the points that are visible in a frame's picture.
fn samples(
    points_m: impl Iterator<Item = DVec3>,
    frame: &Frame,
    geometry: &Geometry,
    response: &Response,
    recording: &Recording,
) -> Vec<SurfaceSample> {
    let Some(brightness) = frame.exposure.brightness else { return Vec::new() };
    let taken_s = frame.timestamp_s;
    if recording.track.at(taken_s).is_err() {
        return Vec::new();
    }
    let poses = RowPoses::new(geometry, |time_s| recording.track.at_or_nearest(taken_s + time_s));
    let pixels = &frame.pixels;
    let light = response.table(pixels.max_code());
    let sample = |at_m: DVec3| {
        let (at_px, _) = project_rolling(geometry, |time_s| poses.at(time_s), at_m)?;
        let size_px = DVec2::new(f64::from(pixels.width), f64::from(pixels.height));
        if !(at_px.cmpge(DVec2::ZERO).all() && at_px.cmplt(size_px).all()) {
            return None;
        }
        let codes = pixels.at(at_px.x as u32, at_px.y as u32);
        let here = f64::from(brightness.spatial_gain.at((at_px / size_px).as_vec2().to_array())).exp2();
        let usual = |c: usize| (light[codes[c] as usize] / (brightness.factors[c] * here)) as f32;
        let is_clipped = codes.map(|code| code >= pixels.clip_code());
        Some(SurfaceSample { at_m, light: [usual(0), usual(1), usual(2)], is_clipped })
    };
    points_m.filter_map(sample).collect()
}

/// Poses at the read times of a picture's rows.
struct RowPoses {
    /// Poses from one readout time before the middle row to one after it.
    poses: Vec<Pose>,
    per_s: f64,
}

impl RowPoses {
    fn new(geometry: &Geometry, pose_at: impl Fn(f64) -> Option<Pose>) -> Self {
        let (readout_s, rows) = (geometry.intrinsics.readout_time_s, geometry.intrinsics.height_px);
        let pose_at = |time_s: f64| pose_at(time_s).unwrap_or(Pose::IDENTITY);
        if !(readout_s > 0.0 && rows > 0) {
            return Self { poses: vec![pose_at(0.0)], per_s: 0.0 };
        }
        let per_s = f64::from(rows) / readout_s;
        Self { poses: (0..=2 * rows).map(|n| pose_at((f64::from(n) - f64::from(rows)) / per_s)).collect(), per_s }
    }

    /// The pose of the row whose read time is nearest to a time relative to the middle row's, s.
    fn at(&self, time_s: f64) -> Pose {
        let middle = (self.poses.len() / 2) as f64;
        self.poses[((middle + time_s * self.per_s).round().max(0.0) as usize).min(self.poses.len() - 1)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn row_poses_are_those_of_the_nearest_row() {
        let mut geometry = Geometry::pinhole(8, 4, 8.0);
        geometry.intrinsics.readout_time_s = 0.04;
        let at = |time_s: f64| Pose::from_camera_in_world(DVec3::X * time_s, glam::DQuat::IDENTITY);
        let poses = RowPoses::new(&geometry, |time_s| Some(at(time_s)));
        let x_m = |time_s: f64| poses.at(time_s).position_in_world_m().x;
        for (time_s, expected) in [(0.0, 0.0), (0.012, 0.01), (-0.016, -0.02), (0.04, 0.04), (-0.04, -0.04)] {
            assert!((x_m(time_s) - expected).abs() < 1e-12, "{time_s}");
        }
        geometry.intrinsics.readout_time_s = 0.0;
        let poses = RowPoses::new(&geometry, |time_s| Some(at(time_s + 1.0)));
        assert_eq!(poses.at(0.0).position_in_world_m().x, 1.0);
    }
}
