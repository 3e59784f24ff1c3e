//! Pose and velocity of the camera at a frame, and projection with a rolling shutter.

use glam::{DAffine3, DVec2, DVec3};

use crate::camera::Geometry;
use crate::fit::twist::{self, Twist};
use crate::pose::Pose;
use crate::tracking::{NoPose, PoseTrack};

/// Half of the interval over which the velocity of a recorded track is averaged, s.
const HALF_S: f64 = 0.015;

/// Pose and velocity at the middle of the middle row's exposure.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraState {
    pub world_from_camera: DAffine3,
    /// The camera's velocity in its own axes, m/s and rad/s: T(t + dt) = T(t)·exp(twist·dt).
    pub twist: Twist,
}

impl CameraState {
    /// Pose and velocity of a track at a frame time: ξ = log(T(t − h)⁻¹·T(t + h)) / 2h.
    /// One-sided at the track's ends.
    pub fn of(track: &PoseTrack, time_s: f64) -> Result<Self, NoPose> {
        let here = world_from_camera(&track.at(time_s)?);
        let near = |by_s: f64| track.at(time_s + by_s).ok().map(|pose| (by_s, world_from_camera(&pose)));
        let (from_s, from) = near(-HALF_S).unwrap_or((0.0, here));
        let (to_s, to) = near(HALF_S).unwrap_or((0.0, here));
        let twist = if to_s > from_s { twist::log(&(from.inverse() * to)) / (to_s - from_s) } else { Twist::zeros() };
        Ok(Self { world_from_camera: here, twist })
    }

    /// The state after a time at constant velocity.
    pub fn extrapolated(&self, by_s: f64) -> Self {
        Self { world_from_camera: self.world_from_camera * twist::exp(&(self.twist * by_s)), ..*self }
    }

    /// Corrected by a motion in the camera's own axes: T·exp(c). The velocity is that of the same
    /// body: ξ' = Ad(exp(−c))·ξ.
    pub fn corrected(&self, by: &Twist) -> Self {
        let twist = twist::adjoint(&twist::exp(&-by)) * self.twist;
        Self { world_from_camera: self.world_from_camera * twist::exp(by), twist }
    }
}

pub fn world_from_camera(pose: &Pose) -> DAffine3 {
    DAffine3::from_rotation_translation(pose.world_from_camera_rotation(), pose.position_in_world_m())
}

pub fn pose(world_from_camera: &DAffine3) -> Pose {
    Pose::from_camera_in_world(world_from_camera.translation, twist::rotation(world_from_camera))
}

/// exp(ξ·t)·x to second order in t.
pub fn move_point(x: DVec3, twist: &Twist, time_s: f64) -> DVec3 {
    let w = twist::rotation_vector(twist);
    let speed = w.cross(x) + twist::translation(twist);
    x + time_s * speed + (0.5 * time_s * time_s) * w.cross(speed)
}

/// Projects a point, given in the camera's axes at the middle row's time, with the rolling shutter.
/// Returns its pixel and its depth at that row's time. Row and time depend on each other: `rounds`
/// fixed-point iterations, from the row `near_px` if given.
pub fn project_rolling_shutter(
    geometry: &Geometry,
    x: DVec3,
    twist: &Twist,
    near_px: Option<f64>,
    rounds: usize,
) -> Option<(DVec2, f64)> {
    if geometry.intrinsics.readout_time_s == 0.0 {
        return Some((geometry.project(x)?, x.z));
    }
    let height = f64::from(geometry.intrinsics.height_px);
    let (mut at, mut far) = match near_px {
        Some(y) => (DVec2::new(0.0, y), x.z),
        None => (geometry.project(x)?, x.z),
    };
    for _ in 0..rounds {
        // The camera moves by exp(ξτ), so static points move by its inverse.
        let there = move_point(x, twist, -geometry.row_time_s(at.y.clamp(-50.0, height + 50.0)));
        (at, far) = (geometry.project(there)?, there.z);
    }
    Some((at, far))
}
