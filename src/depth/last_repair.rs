//! Memo of the last repairs. While a user drags a slider the same frame is rendered repeatedly.

use std::sync::Arc;

use super::proxies::Proxies;
use super::repair::{DepthRequest, PosedNeighbour, Repair, RepairedDepth};
use crate::camera::{Geometry, Response};
use crate::frame::{Frame, FrameIdentity, NeighbourFrame, Surfel};
use crate::memo::{ByAddress, Memo};
use crate::pixels::Rect;
use crate::plane::Plane;
use crate::pose::Pose;
use crate::quality::Quality;

/// Memos of the last result of each quality. A result that was recomputed, with the same value, has
/// another address.
#[derive(Debug, Default)]
pub struct LastRepair {
    finals: Memo<RepairKey, Arc<RepairedDepth>>,
    previews: Memo<RepairKey, Arc<RepairedDepth>>,
}

/// All inputs of a repair.
#[derive(Debug, PartialEq)]
struct RepairKey {
    frame: FrameIdentity,
    /// Equal only if they were decoded with the same frame.
    neighbours: Vec<ByAddress<NeighbourFrame>>,
    /// Indices of the voting neighbours.
    voters: Vec<Option<usize>>,
    surfels: ByAddress<[Surfel]>,
    geometry: Geometry,
    response: Response,
    poses: Vec<Pose>,
    planes: Vec<Plane>,
    proxies: Option<(Proxies, Vec<Pose>, f64)>,
    rects: [Rect; 3],
    request: DepthRequest,
}

impl LastRepair {
    /// The result of [`Repair::repaired_depth`] for a frame, memoized, with its quality. `rects`
    /// are `around`, `near` and `drawn`. Without a memoized result, a preview is made without
    /// neighbours and surfels.
    pub fn repaired_depth(
        &self,
        frame: &Frame,
        repair: &Repair<'_>,
        rects: [Rect; 3],
        request: &DepthRequest,
        quality: Quality,
    ) -> (Arc<RepairedDepth>, Quality) {
        let key = RepairKey::new(frame, repair, rects, request);
        if let Some(repaired) = self.finals.get(&key) {
            return (repaired, Quality::Final);
        }
        let [around, near, drawn] = rects;
        let repaired = |repair: &Repair<'_>| Arc::new(repair.repaired_depth(around, near, drawn, request));
        if quality == Quality::Preview && repair.measured.is_some() {
            let alone = Repair { neighbours: &[], surfels: &[], ..*repair };
            return (self.previews.get_or_insert_with(key, |_| repaired(&alone)), Quality::Preview);
        }
        (self.finals.get_or_insert_with(key, |_| repaired(repair)), Quality::Final)
    }
}

impl RepairKey {
    fn new(frame: &Frame, repair: &Repair<'_>, rects: [Rect; 3], request: &DepthRequest) -> Self {
        let measured = repair.measured.map(|(_, pose)| *pose);
        let own = [repair.frame, repair.shutter[0], repair.shutter[1]].map(|pose| *pose);
        let theirs = repair.neighbours.iter().flat_map(|neighbour| [neighbour.map_pose, neighbour.picture_pose]);
        let place =
            |voter: &PosedNeighbour<'_>| frame.neighbours.iter().position(|of| std::ptr::eq(&**of, voter.frame));
        Self {
            frame: frame.identity(),
            neighbours: frame.neighbours.iter().cloned().map(ByAddress).collect(),
            voters: repair.neighbours.iter().map(place).collect(),
            surfels: ByAddress(Arc::clone(&frame.surfels)),
            geometry: repair.rays.geometry().clone(),
            response: repair.response.clone(),
            poses: own.into_iter().chain(measured).chain(theirs).collect(),
            planes: repair.planes.to_vec(),
            proxies: repair.proxies.map(|view| (view.proxies.clone(), view.poses.0.to_vec(), view.poses.1)),
            rects,
            request: request.clone(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Curve;
    use crate::depth::{ProjectedPoint, ProxyView, Rays};
    use crate::pixels::{DepthMap, Pixels};
    use glam::{DQuat, DVec3, Vec3};

    /// An object at 1 m in front of a wall at 2 m. The frame's own map has it one column too
    /// narrow.
    fn repaired(last: &LastRepair, frame: &Frame, quality: Quality, max_depth_m: f32) -> (Arc<RepairedDepth>, Quality) {
        let (rays, pose) = (Rays::new(&Geometry::pinhole(96, 64, 80.0)), Pose::IDENTITY);
        let depth = frame.depth.as_ref().unwrap();
        let neighbour = |frame| PosedNeighbour { frame, map_pose: pose, picture_pose: pose };
        let neighbours: Vec<_> = frame.neighbours.iter().map(|beside| neighbour(beside)).collect();
        let repair = Repair {
            rays: &rays,
            measured: Some((depth, &pose)),
            frame: &pose,
            shutter: [&pose; 2],
            pixels: &frame.pixels,
            response: &Response::default(),
            planes: &[],
            proxies: None,
            neighbours: &neighbours,
            surfels: &frame.surfels,
        };
        let whole = Rect::full(96, 64);
        let request =
            DepthRequest { objects: vec![(whole, max_depth_m)], full_depth_rect: whole, receiver_rect: whole };
        last.repaired_depth(frame, &repair, [whole; 3], &request, quality)
    }

    fn frame() -> Frame {
        let map = |end: usize| {
            let depth_m = (0..96 * 64).map(|i| if (30..end).contains(&(i % 96)) { 1.0 } else { 2.0 }).collect();
            DepthMap { width: 96, height: 64, depth_m, timestamp_s: 0.0 }
        };
        let codes = (0..96 * 64).flat_map(|i| [if (30..64).contains(&(i % 96)) { 40 } else { 200 }; 3]).collect();
        let pixels = Arc::new(Pixels::from_u8(96, 64, codes).unwrap());
        let neighbour =
            |index| NeighbourFrame { index, timestamp_s: 0.0, pixels: pixels.clone(), depth: map(60).into() };
        Frame {
            depth: Some(Arc::new(map(59))),
            neighbours: [2, 3, 5].map(|index| Arc::new(neighbour(index))).to_vec(),
            ..Frame::new(4, 0.0, pixels.clone())
        }
    }

    #[test]
    fn repair_with_the_same_inputs_is_memoized() {
        let (last, here) = (LastRepair::default(), frame());
        let (first, quality) = repaired(&last, &here, Quality::Final, 9.0);
        assert_eq!(quality, Quality::Final);
        // Also for a preview, and for a copy of the frame.
        for requested in [Quality::Final, Quality::Preview] {
            let (again, quality) = repaired(&last, &here.clone(), requested, 9.0);
            assert!(Arc::ptr_eq(&first, &again) && quality == Quality::Final);
        }
        assert!(!Arc::ptr_eq(&first, &repaired(&last, &here, Quality::Final, 8.0).0));
        assert!(!Arc::ptr_eq(&first, &repaired(&last, &Frame { index: 5, ..here.clone() }, Quality::Final, 9.0).0));
        // The same neighbours, decoded again.
        let (again, _) = repaired(&last, &frame(), Quality::Final, 9.0);
        assert!(!Arc::ptr_eq(&first, &again) && first == again);
    }

    #[test]
    fn preview_without_neighbours_is_not_memoized() {
        let (last, here) = (LastRepair::default(), frame());
        let (preview, quality) = repaired(&last, &here, Quality::Preview, 9.0);
        assert_eq!(quality, Quality::Preview);
        let alone = Frame { neighbours: Vec::new(), ..here.clone() };
        assert_eq!(preview, repaired(&last, &alone, Quality::Final, 9.0).0);
        let (whole, quality) = repaired(&last, &here, Quality::Final, 9.0);
        assert!(quality == Quality::Final && whole != preview);
    }

    #[test]
    fn key_differs_with_any_other_input() {
        let (here, pose) = (frame(), Pose::IDENTITY);
        let moved = Pose::from_camera_in_world(DVec3::X, DQuat::IDENTITY);
        let [rays, longer] = [80.0, 81.0].map(|focal_px| Rays::new(&Geometry::pinhole(96, 64, focal_px)));
        let linear = Response { curve: Curve::Linear, ..Response::default() };
        let planes = [1.0, 2.0].map(|y_m| [Plane { point_m: y_m * DVec3::Y, normal: DVec3::NEG_Y }]);
        let proxies = [1.0, 2.0].map(|z_m| Proxies { triangles: vec![[DVec3::X, DVec3::Y, z_m * DVec3::Z]] });
        let (here_poses, moved_poses) = ([pose; 3], [pose, pose, moved]);
        let project: &dyn Fn(DVec3) -> ProjectedPoint = &|_| None;
        let neighbour =
            |map_pose, picture_pose| [PosedNeighbour { frame: &here.neighbours[0], map_pose, picture_pose }];
        let neighbours = [neighbour(pose, pose), neighbour(moved, pose), neighbour(pose, moved)];
        let other_voter = [PosedNeighbour { frame: &here.neighbours[1], map_pose: pose, picture_pose: pose }];
        let depth = here.depth.as_ref().unwrap();
        let repair = Repair {
            rays: &rays,
            measured: Some((depth, &pose)),
            frame: &pose,
            shutter: [&pose; 2],
            pixels: &here.pixels,
            response: &Response::default(),
            planes: &planes[0],
            proxies: Some(ProxyView { proxies: &proxies[0], project, poses: (&here_poses, 0.1) }),
            neighbours: &neighbours[0],
            surfels: &here.surfels,
        };
        let view = repair.proxies.unwrap();
        let surfel = Surfel { position_m: Vec3::Z, normal: Vec3::NEG_Z, sqrt_color: [0.5; 3] };
        let rects = [Rect::full(96, 64); 3];
        let request = DepthRequest::all(rects[0]);
        let key = RepairKey::new(&here, &repair, rects, &request);
        assert!(key == RepairKey::new(&here.clone(), &repair, rects, &request));
        for (input, other) in [
            ("geometry", Repair { rays: &longer, ..repair }),
            ("pose of the map", Repair { measured: Some((depth, &moved)), ..repair }),
            ("pose of the frame", Repair { frame: &moved, ..repair }),
            ("pose as the shutter opens", Repair { shutter: [&moved, &pose], ..repair }),
            ("pose as the shutter closes", Repair { shutter: [&pose, &moved], ..repair }),
            ("response", Repair { response: &linear, ..repair }),
            ("planes", Repair { planes: &planes[1], ..repair }),
            ("no planes", Repair { planes: &[], ..repair }),
            ("proxies", Repair { proxies: Some(ProxyView { proxies: &proxies[1], ..view }), ..repair }),
            ("poses of rows", Repair { proxies: Some(ProxyView { poses: (&moved_poses, 0.1), ..view }), ..repair }),
            ("times of rows", Repair { proxies: Some(ProxyView { poses: (&here_poses, 0.2), ..view }), ..repair }),
            ("no proxies", Repair { proxies: None, ..repair }),
            ("pose of a neighbour's map", Repair { neighbours: &neighbours[1], ..repair }),
            ("pose of a neighbour", Repair { neighbours: &neighbours[2], ..repair }),
            ("voter", Repair { neighbours: &other_voter, ..repair }),
        ] {
            assert!(key != RepairKey::new(&here, &other, rects, &request), "{input}");
        }
        let remembered = Frame { surfels: vec![surfel].into(), ..here.clone() };
        assert!(key != RepairKey::new(&remembered, &repair, rects, &request), "surfels");
        let smaller = Rect::new(0, 0, 95, 64);
        assert!(key != RepairKey::new(&here, &repair, [rects[0], rects[1], smaller], &request), "rectangles");
        assert!(key != RepairKey::new(&here, &repair, rects, &DepthRequest::all(smaller)), "requested depth");
    }
}
