//! Depth of a whole frame: its reprojected map, the consensus of its neighbours where the map is
//! unreliable, and surfels of the recording where depth is still unknown.

use super::repair::PosedNeighbour;
use super::sqrt_colors::SqrtColors;
use super::{Rays, measured_from, vote};
use crate::camera::{Geometry, Response};
use crate::frame::{Frame, NeighbourFrame};
use crate::pixels::DepthMap;
use crate::tracking::PoseTrack;

/// The neighbours of a frame that have poses. `picture`: the recording's geometry.
pub fn neighbours<'a>(frame: &'a Frame, picture: &Geometry, track: &PoseTrack) -> Vec<PosedNeighbour<'a>> {
    let neighbour = |frame: &'a NeighbourFrame| {
        let map_pose = measured_from(&frame.depth, picture, track).ok()?;
        let picture_pose = track.at(frame.timestamp_s).ok()?;
        Some(PosedNeighbour { frame, map_pose, picture_pose })
    };
    frame.neighbours.iter().filter_map(|frame| neighbour(frame)).collect()
}

/// A frame's depth, m, row by row; 0 where unknown. `None` without a pose at the time of the map or
/// of the frame, or if the map has another size than the picture.
pub fn consensus_at_frame(
    frame: &Frame,
    depth: &DepthMap,
    rays: &Rays,
    track: &PoseTrack,
    response: &Response,
) -> Option<Vec<f32>> {
    let map_pose = measured_from(depth, rays.geometry(), track).ok()?;
    let picture_pose = track.at(frame.timestamp_s).ok()?;
    let whole = rays.full();
    let mut depth_m = rays.reproject(depth, &map_pose, &picture_pose, whole);
    let neighbours = neighbours(frame, rays.geometry(), track);
    let voters: Vec<_> = neighbours.iter().map(|neighbour| neighbour.voter(response)).collect();
    if !voters.is_empty() || !frame.surfels.is_empty() {
        let (of_frame, pixels) = (SqrtColors::new(&frame.pixels, response), &frame.pixels);
        let width = pixels.width.max(1) as usize;
        let mut sqrt_colors = vec![[0.0; 3]; pixels.width as usize * pixels.height as usize];
        sqrt_colors.chunks_mut(width).zip(0..).for_each(|(row, y)| of_frame.fill_row(0, y, row));
        let max_depth_m = vec![f32::INFINITY; depth_m.len()];
        let target = vote::TargetView {
            rays,
            pose: picture_pose,
            part: whole,
            sqrt_colors: &sqrt_colors,
            max_depth_m: &max_depth_m,
        };
        target.apply_consensus(&mut depth_m, &voters);
        target.fill_unknown(&mut depth_m, &frame.surfels);
    }
    Some(depth_m)
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::frame::{SURFEL_SPACING_M, Surfel};
    use crate::pixels::Pixels;
    use crate::pose::Pose;
    use glam::{DQuat, DVec3, Vec3};

    /// A wall at 2 m, a camera that moves along it, and a hole in the frame's own map. All
    /// neighbours measured the wall except for one, which has no pose and another depth.
    #[test]
    fn hole_of_a_frame_takes_the_depth_of_neighbours_or_surfels() {
        let (width, height) = (96, 64);
        let pixels = || Pixels::from_u8(width, height, vec![120; 3 * 96 * 64]).unwrap();
        let map = |z: f32, hole: usize, timestamp_s: f64| {
            let depth_m = (0..96 * 64).map(|i| if i % 96 == hole { 0.0 } else { z }).collect();
            DepthMap { width, height, depth_m, timestamp_s }
        };
        let neighbour = |index: usize, time_s: f64, z: f32| {
            Arc::new(NeighbourFrame {
                index,
                timestamp_s: time_s,
                pixels: pixels().into(),
                depth: map(z, 96, time_s).into(),
            })
        };
        let pose = |time_s: f64| (time_s, Pose::new(DQuat::IDENTITY, DVec3::new(0.2 * time_s, 0.0, 0.0)));
        let track = PoseTrack::new(vec![pose(-1.0), pose(1.0)], 3.0).unwrap();
        let geometry = Geometry::pinhole(width, height, 80.0);
        let rays = Rays::new(&geometry);
        let own = map(2.0, 50, 0.0);
        let mut frame = Frame { depth: Some(Arc::new(own.clone())), ..Frame::new(1, 0.0, pixels()) };
        let depth_of = |frame: &Frame| consensus_at_frame(frame, &own, &rays, &track, &Response::default()).unwrap();
        assert_eq!(depth_of(&frame)[20 * 96 + 50], 0.0);
        frame.neighbours = vec![neighbour(0, -0.5, 2.0), neighbour(2, 0.5, 2.0), neighbour(3, 2.0, 1.0)];
        assert_eq!(neighbours(&frame, &geometry, &track).len(), 2);
        let depth_m = depth_of(&frame);
        assert!(depth_m.iter().all(|z| (z - 2.0).abs() < 1e-3), "{:?}", &depth_m[20 * 96..][..96]);
        // Without neighbours the surfels of a wall of the same grey fill the hole.
        frame.neighbours.clear();
        let at = |n: i32| SURFEL_SPACING_M as f32 * n as f32;
        let places = (-80..80).flat_map(|x| (-60..60).map(move |y| Vec3::new(at(x), at(y), 2.0)));
        let sqrt_color = [Response::default().decode(120.0 / 255.0).sqrt() as f32; 3];
        frame.surfels = places.map(|position_m| Surfel { position_m, normal: Vec3::NEG_Z, sqrt_color }).collect();
        let depth_m = depth_of(&frame);
        assert!(depth_m.iter().all(|z| (z - 2.0).abs() < 1e-3), "{:?}", &depth_m[20 * 96..][..96]);
        // A map of another size.
        let other = DepthMap { width: 64, height: 96, ..own.clone() };
        assert!(consensus_at_frame(&frame, &other, &rays, &track, &Response::default()).is_none());
    }
}
