//! Occlusion of virtual objects in each of the frames that a photograph sums.
//!
//! While the shutter is open the camera moves, and real edges with it: a frame's depth is valid for
//! the edges of that frame's picture only. So each frame has its own depth map, repaired with its
//! own picture and neighbours, which occludes objects drawn within the frame's exposure. In the sum
//! an object behind a real edge is cut off as softly as the edge itself is blurred.
//!
//! Not modelled: the dependence of the real part beside a pixel's virtual share on the moments of
//! visibility (the mean of all frames is used), and the sharp cut-off of a blurred object by a real
//! one in focus: here it is cut off first and blurred then.

use glam::DVec3;

use super::Framing;
use crate::camera::{Geometry, Response};
use crate::compositor::project_rolling;
use crate::depth::{DepthGrid, ProjectedPoint, Proxies, Rays, consensus_at_frame, snap_to_planes};
use crate::frame::Frame;
use crate::pixels::DepthMap;
use crate::plane::Plane;
use crate::tracking::PoseTrack;

/// Inputs common to all frames.
#[derive(Debug)]
pub struct SummedFrameOcclusion<'a> {
    rays: Rays,
    recorded: &'a Geometry,
    track: &'a PoseTrack,
    framing: &'a Framing,
    response: &'a Response,
    /// Used for frames without depth.
    depth: &'a DepthMap,
    proxies: &'a Proxies,
    /// Support planes of the scene's objects.
    planes: &'a [Plane],
}

/// Projection of a point into the recording's camera at a time; `None` without poses.
pub fn seen_in(recorded: &Geometry, track: &PoseTrack, time_s: f64, point: DVec3) -> ProjectedPoint {
    let about = track.at(time_s).ok()?;
    project_rolling(recorded, |later_s| track.at(time_s + later_s).unwrap_or(about), point)
}

impl<'a> SummedFrameOcclusion<'a> {
    pub fn new(
        recorded: &'a Geometry,
        track: &'a PoseTrack,
        framing: &'a Framing,
        response: &'a Response,
        (depth, proxies, planes): (&'a DepthMap, &'a Proxies, &'a [Plane]),
    ) -> Self {
        Self { rays: Rays::new(recorded), recorded, track, framing, response, depth, proxies, planes }
    }

    /// A frame's depth over the photograph; `None` without a pose at its time of measurement.
    pub fn of(&self, frame: &Frame) -> Option<DepthGrid> {
        let intrinsics = &self.recorded.intrinsics;
        let depth = frame.depth.as_deref().unwrap_or(self.depth);
        let mut depth_m = consensus_at_frame(frame, depth, &self.rays, self.track, self.response)?;
        if let Ok(pose) = self.track.at(frame.timestamp_s) {
            snap_to_planes(&mut depth_m, &self.rays, &pose, self.rays.full(), self.planes);
        }
        let project = |point| seen_in(self.recorded, self.track, frame.timestamp_s, point);
        self.proxies.rasterize(&mut depth_m, self.rays.full(), project);
        DepthGrid::of_frame(
            &frame.pixels,
            intrinsics,
            &depth_m,
            &self.framing.framed,
            self.framing.size(),
            self.response,
        )
    }
}
