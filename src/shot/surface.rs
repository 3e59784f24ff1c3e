//! The real surface at a pixel: the plane that the frame's depth has around it.

use glam::{DVec2, DVec3};

use super::{Shot, ShotError};
use crate::frame::Frame;
use crate::pixels::DepthMap;
use crate::plane::Plane;
use crate::pose::Pose;
use crate::support::InverseDepthPlane;
use crate::text::number;
use crate::tracking::NoPose;

/// A plane that was fitted around a pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Surface {
    /// Plane in the world, through its intersection with the pixel's ray. The normal faces the
    /// camera.
    pub plane: Plane,
    /// Depth of the point, by the convention of depth maps, m.
    pub depth_m: f64,
    /// Robust standard deviation of the measured depths from the plane, m.
    pub sigma_m: f64,
    /// Share of the pixels around that lie on the plane.
    pub share: f64,
}

/// Why there is no surface at a pixel.
#[derive(Debug, thiserror::Error)]
pub enum SurfaceError {
    #[error("frame {frame} has no depth: give a plane, or pick the point in a second frame too (X,Y+FRAME:X,Y)")]
    NoDepth { frame: usize },
    #[error("{} lies outside the picture of {width}x{height} px: expected X from 0 to {width}, Y from 0 to {height}", place(*.at_px))]
    Outside { at_px: [f64; 2], width: u32, height: u32 },
    #[error("the lens model has no ray at {}", place(*.at_px))]
    NoRay { at_px: [f64; 2] },
    #[error("there is no surface with depth around {}: pick a place next to it, or give a plane", place(*.at_px))]
    NotMeasured { at_px: [f64; 2] },
    #[error("{plane} {reason}")]
    Plane { plane: String, reason: &'static str },
    #[error("{what} has no world point: {reason}")]
    Views { what: String, reason: String },
    #[error(transparent)]
    NoPose(#[from] NoPose),
    #[error(transparent)]
    Shot(#[from] Box<ShotError>),
}

fn place(at_px: [f64; 2]) -> String {
    at_px.map(|px| number((px * 10.0).round() / 10.0)).join(",")
}

/// The depth map has a time of its own: the position of a pixel in it depends on the pixel's depth.
/// Number of iterations.
const ITERATIONS: usize = 4;

impl Shot {
    /// The surface at a position of a frame's picture, px from the upper left. The depth map's time
    /// and that of the position's row are both taken into account, as in occlusion.
    pub fn surface_at(&self, frame: &Frame, at_px: DVec2) -> Result<Surface, SurfaceError> {
        let index = frame.index;
        let depth = frame.depth.as_ref().ok_or(SurfaceError::NoDepth { frame: index })?;
        let position = at_px.to_array();
        let (width, height) = (f64::from(depth.width), f64::from(depth.height));
        let is_inside = |at: DVec2| at.cmpge(DVec2::ZERO).all() && at.x < width && at.y < height;
        if !is_inside(at_px) {
            return Err(SurfaceError::Outside { at_px: position, width: depth.width, height: depth.height });
        }
        let eye = self.posed_camera(index)?;
        let geometry = eye.geometry();
        let ray = eye.ray(at_px).ok_or(SurfaceError::NoRay { at_px: position })?;
        let not_measured = || SurfaceError::NotMeasured { at_px: position };
        let pose = self.measured_from(frame, depth)?;
        let (origin, along) =
            (pose.transform_point(ray.origin_m), pose.world_from_camera_rotation().inverse() * ray.direction);
        let mut in_map = at_px;
        for _ in 1..ITERATIONS {
            let plane =
                InverseDepthPlane::around(depth, in_map, |px| geometry.depth_ray(px)).ok_or_else(not_measured)?;
            let point = plane.intersect(origin, along).ok_or_else(not_measured)?;
            let next = geometry.project(point).filter(|next| is_inside(*next)).ok_or_else(not_measured)?;
            let has_converged = geometry.displacement_px(in_map, next).length() < 0.5;
            in_map = next;
            if has_converged {
                break;
            }
        }
        let plane = InverseDepthPlane::around(depth, in_map, |px| geometry.depth_ray(px)).ok_or_else(not_measured)?;
        let point = plane.intersect(origin, along).ok_or_else(not_measured)?;
        let depth_m = if geometry.is_equirectangular() { point.length() } else { point.z };
        // n/d points away from the camera, because depth is positive.
        let normal = -(pose.world_from_camera_rotation() * plane.inverse_depth.normalize());
        Ok(Surface {
            plane: Plane { point_m: pose.inverse_transform_point(point), normal },
            depth_m,
            sigma_m: plane.sigma * depth_m * depth_m,
            share: plane.share,
        })
    }

    /// The pose at which a frame's depth was measured, or the frame's if the track does not cover
    /// that time.
    pub(super) fn measured_from(&self, frame: &Frame, depth: &DepthMap) -> Result<Pose, NoPose> {
        let recording = &self.recording;
        let measured = recording.track.at(depth.timestamp_s);
        measured.or_else(|_| recording.pose_at_frame(frame.index))
    }

    /// Intersection of the ray of a position in a frame's picture with the plane
    /// a·x + b·y + c·z = d of the world.
    pub fn support_on_plane(&self, frame: usize, at_px: DVec2, plane: [f64; 4]) -> Result<Plane, SurfaceError> {
        let [a, b, c, d] = plane;
        let normal = DVec3::new(a, b, c);
        let refused = |reason| SurfaceError::Plane { plane: plane.map(number).join(","), reason };
        let unit = normal.try_normalize().ok_or_else(|| refused("is not a plane: the normal A,B,C has no length"))?;
        let ray = self.posed_camera(frame)?.ray(at_px).ok_or(SurfaceError::NoRay { at_px: at_px.to_array() })?;
        let t = (d - normal.dot(ray.origin_m)) / normal.dot(ray.direction);
        if !(t.is_finite() && t > 0.0) {
            return Err(refused("does not lie before the camera there"));
        }
        // The normal faces the camera.
        let normal = if unit.dot(ray.direction) > 0.0 { -unit } else { unit };
        Ok(Plane { point_m: ray.at(t), normal })
    }
}
