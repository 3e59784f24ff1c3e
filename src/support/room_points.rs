//! Measured points of the room: samples of the depth maps of frames spread over the recording.
//!
//! Depth is read once. Points are computed from it by the camera, so that a changed lens needs no
//! further read.

use std::ops::Range;
use std::sync::Arc;

use glam::{DVec2, DVec3};

use super::ransac::MeasuredPoint;
use super::room_planes::RoomPlanes;
use crate::camera::Geometry;
use crate::pixels::DepthMap;
use crate::plane::{HessePlane, Plane};
use crate::pose::Pose;
use crate::recording::Recording;
use crate::scene::MIN_SUPPORT_COSINE;
use crate::source::ahead::Ahead;

/// Number of depth maps to sample.
const SAMPLED_FRAMES: usize = 24;
/// Number of samples across a map.
const SAMPLES_ACROSS: u32 = 96;
/// Radius of the points around a position on a surface, m.
const AROUND_M: f64 = 0.1;

/// Samples of a frame's depth map on a grid of pixels ([`grid`]).
#[derive(Debug)]
pub struct DepthSamples {
    frame: usize,
    pose: Pose,
    width: u32,
    height: u32,
    across: u32,
    /// Row by row, m; 0 if unknown.
    depth_m: Vec<f32>,
}

impl DepthSamples {
    /// `pose`: the camera's at the time of the map; `across`: the approximate number of columns.
    pub fn new(frame: usize, pose: Pose, map: &DepthMap, across: u32) -> Self {
        let DepthMap { width, height, depth_m, .. } = map;
        let depth_m = grid(*width, *height, across).map(|(x, y)| depth_m[(y * width + x) as usize]).collect();
        Self { frame, pose, width: *width, height: *height, across, depth_m }
    }

    /// Samples of the depth of frames spread over the recording. Empty without readable depth: an
    /// unreadable file is reported when its frame is read.
    pub fn of_recording(recording: &Arc<Recording>) -> Vec<Self> {
        if !recording.has_depth() {
            return Vec::new();
        }
        let numbers: Arc<[usize]> = recording.spread_frames(SAMPLED_FRAMES).collect();
        let (of, sampled) = (recording.clone(), numbers.clone());
        let Ok(maps) = Ahead::new(0..numbers.len(), move |n| of.depth_at(sampled[n])) else { return Vec::new() };
        let samples = |(n, map): (usize, _)| {
            let Ok(Ok(Some(map @ DepthMap { timestamp_s, .. }))) = map else { return None };
            let pose = recording.track.at(timestamp_s).ok()?;
            Some(Self::new(numbers[n], pose, &map, SAMPLES_ACROSS))
        };
        maps.enumerate().filter_map(samples).collect()
    }
}

/// Measured points of a room, and the dominant planes among them.
#[derive(Debug, Default)]
pub struct RoomPoints {
    pub points: Vec<MeasuredPoint>,
    /// Frame index and its range in `points`.
    pub frames: Vec<(usize, Range<usize>)>,
    pub planes: RoomPlanes,
}

impl RoomPoints {
    pub fn new(by_frame: Vec<(usize, Vec<MeasuredPoint>)>) -> Self {
        let mut end = 0;
        let range = |(frame, points): &(usize, Vec<MeasuredPoint>)| {
            let start = end;
            end += points.len();
            (*frame, start..end)
        };
        let frames = by_frame.iter().map(range).collect();
        let points: Vec<MeasuredPoint> = by_frame.into_iter().flat_map(|(_, points)| points).collect();
        Self { planes: RoomPlanes::of(&points), points, frames }
    }

    /// The dominant plane that explains the points around a surface as well as the surface's own
    /// plane, at a small angle to it; else its own.
    pub fn or_dominant(&self, surface: &Plane) -> HessePlane {
        let near_points = self.points_within(surface.point_m, AROUND_M);
        let accepts = |normal: DVec3| normal.dot(surface.normal).abs() > MIN_SUPPORT_COSINE;
        self.planes.or_dominant((*surface).into(), surface.point_m, &near_points, accepts)
    }

    /// Points within a radius of a position.
    fn points_within(&self, at_m: DVec3, within_m: f64) -> Vec<MeasuredPoint> {
        self.points.iter().filter(|point| point.at_m.distance(at_m) < within_m).copied().collect()
    }
}

/// Measured points by frame, through the cameras of the frames. Samples of another size than the
/// camera's picture are skipped.
pub fn points_by_frame(
    samples: &[DepthSamples],
    geometry_of: impl Fn(usize) -> Option<Geometry>,
) -> Vec<(usize, Vec<MeasuredPoint>)> {
    let mut by_frame = Vec::new();
    // Rays of the previous frame's camera: in most recordings all frames share one. No memo: they
    // last for this loop.
    let mut rays: Option<(Geometry, Vec<Option<DVec3>>)> = None;
    for DepthSamples { frame, pose, width, height, across, depth_m } in samples {
        let Some(geometry) = geometry_of(*frame) else { continue };
        let i = &geometry.intrinsics;
        if (*width, *height) != (i.width_px, i.height_px) {
            continue;
        }
        let (_, rays) = match rays.take().filter(|(of, _)| *of == geometry) {
            Some(same) => rays.insert(same),
            None => {
                let middle = |(x, y)| DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
                let through = grid(*width, *height, *across).map(|at| geometry.depth_ray(middle(at))).collect();
                rays.insert((geometry, through))
            }
        };
        let point = |(z, ray): (f64, &Option<DVec3>)| {
            let at_m = pose.inverse_transform_point(z * ray.filter(|_| z > 0.0 && z.is_finite())?);
            Some(MeasuredPoint::new(at_m, z, pose.position_in_world_m()))
        };
        let depth_m = depth_m.iter().map(|z| f64::from(*z));
        by_frame.push((*frame, depth_m.zip(rays.iter()).filter_map(point).collect()));
    }
    by_frame
}

/// The sampled pixels of a depth map, row by row: about `across` in a row.
fn grid(width: u32, height: u32, across: u32) -> impl Iterator<Item = (u32, u32)> {
    let step = (width / across).max(1);
    let columns = move || (step / 2..width).step_by(step as usize);
    (step / 2..height).step_by(step as usize).flat_map(move |y| columns().map(move |x| (x, y)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn room_points_are_indexed_by_frame() {
        let point = |x: f64| MeasuredPoint::new(DVec3::new(x, 0.0, 0.0), 1.0, DVec3::Z);
        let room = RoomPoints::new(vec![(3, vec![point(0.0), point(1.0)]), (5, vec![]), (9, vec![point(2.0)])]);
        assert_eq!(room.frames, [(3, 0..2), (5, 2..2), (9, 2..3)]);
        assert_eq!(room.points[room.frames[2].1.clone()].iter().map(|p| p.at_m.x).collect::<Vec<_>>(), [2.0]);
        assert_eq!(room.points_within(DVec3::X, 0.5).len(), 1);
    }

    #[test]
    fn grid_samples_the_middle_of_each_step() {
        assert_eq!(grid(9, 7, 3).collect::<Vec<_>>(), [(1, 1), (4, 1), (7, 1), (1, 4), (4, 4), (7, 4)]);
        assert_eq!(grid(2, 1, 96).collect::<Vec<_>>(), [(0, 0), (1, 0)]);
    }
}
