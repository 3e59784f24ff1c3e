//! Camera data for the shader: geometry, and poses around the frame's time.

use glam::{DQuat, DVec3};

use super::occlusion::{GridPlacement, Occlusion};
use super::plan::RenderSample;
use crate::camera::{Geometry, LensModel, Primaries};
use crate::pixels::Rect;
use crate::pose::Pose;

/// Maximum number of keys in the shader, as in shaders/raster.wgsl.
pub const MAX_KEYS: usize = 33;
/// Maximum interval between keys, seconds: hand motion is straight for that long.
const MAX_KEY_INTERVAL_S: f64 = 0.008;
/// Maximum number of keys on each side; a minute needs them.
const MAX_KEYS_PER_SIDE: usize = 4096;
/// Near plane, metres.
pub const NEAR_M: f64 = 0.01;

/// Exposure and readout times of a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shutter {
    pub exposure_time_s: f64,
    pub readout_time_s: f64,
    /// Largest distance of a drawn moment before or after the exposure.
    pub beyond_s: f64,
}

impl Shutter {
    /// Half the time step for velocities: to both ends of the exposure, so that the chord of a
    /// curved motion meets them. A millisecond without exposure.
    pub fn velocity_step_s(&self) -> f64 {
        if self.exposure_time_s > 0.0 { 0.5 * self.exposure_time_s } else { 5e-4 }
    }

    /// Largest offset from the frame's timestamp that a vertex may need.
    pub fn reach_s(&self) -> f64 {
        self.velocity_step_s() + self.beyond_s + self.readout_time_s
    }
}

/// Poses at equal steps around a frame's timestamp, as `camera_from_local`. The local axes are the
/// world's, moved to the camera's position at the timestamp, so that 32-bit floats suffice wherever
/// the world's origin is.
#[derive(Clone, Debug, PartialEq)]
pub struct ViewKeys {
    /// The camera's position at the timestamp, metres.
    pub origin_in_world_m: DVec3,
    /// `camera_from_world` at each step, first to last; the middle one is the frame's own pose. An
    /// odd number.
    pub poses: Vec<Pose>,
    pub reach_s: f64,
}

impl ViewKeys {
    /// Calls `pose_at(offset_s)` for the poses around the timestamp.
    pub fn new(shutter: Shutter, mut pose_at: impl FnMut(f64) -> Pose) -> Self {
        let reach_s = shutter.reach_s();
        // The shader receives MAX_KEYS of them around its moment: as many as a readout needs.
        let step_s = MAX_KEY_INTERVAL_S.max(shutter.readout_time_s / (MAX_KEYS / 2 - 1) as f64);
        let half = ((reach_s / step_s).ceil() as usize).clamp(MAX_KEYS / 2, MAX_KEYS_PER_SIDE);
        let at = |i: usize| (i as f64 - half as f64) / half as f64 * reach_s;
        let poses: Vec<_> = (0..=2 * half).map(|i| pose_at(at(i))).collect();
        Self { origin_in_world_m: poses[half].position_in_world_m(), poses, reach_s }
    }

    /// Three keys: at an offset, and `reach_s` before and after it.
    pub fn around(&self, offset_s: f64, reach_s: f64) -> Self {
        let poses = [-reach_s, 0.0, reach_s].map(|t| self.pose_at(offset_s + t)).into();
        Self { origin_in_world_m: self.origin_in_world_m, poses, reach_s }
    }

    /// Representative poses from the first to the last, and the seconds between two: all keys of a
    /// long exposure, five of one that is shorter than a change of a hand's direction.
    pub fn sampled(&self) -> (Vec<&Pose>, f64) {
        let last = self.poses.len() - 1;
        let every = if self.poses.len() == MAX_KEYS { last / 4 } else { 1 };
        (self.poses.iter().step_by(every).collect(), 2.0 * self.reach_s * every as f64 / last as f64)
    }

    /// Rotation, and the camera's position relative to the origin, at an offset from the timestamp.
    /// `in_camera` in shaders/raster.wgsl does the same for rows with their own times.
    pub fn at(&self, offset_s: f64) -> (DQuat, DVec3) {
        let last = (self.poses.len() - 1) as f64;
        let x = ((offset_s / self.reach_s + 1.0) * 0.5 * last).clamp(0.0, last);
        let i = x.floor().min(last - 1.0);
        let [a, b] = [0, 1].map(|k| &self.poses[i as usize + k]);
        let [p, q] = [a, b].map(|pose| pose.position_in_world_m() - self.origin_in_world_m);
        (a.rotation.lerp(b.rotation, x - i), p.lerp(q, x - i))
    }

    /// The interpolated `camera_from_world`.
    pub fn pose_at(&self, offset_s: f64) -> Pose {
        let (rotation, position_m) = self.at(offset_s);
        Pose::new(rotation, rotation * -(position_m + self.origin_in_world_m))
    }

    /// The frame's own pose.
    pub fn middle(&self) -> Pose {
        self.poses[self.poses.len() / 2]
    }
}

/// Parameters for drawing one frame.
#[derive(Clone, Copy, Debug)]
pub struct View<'a> {
    pub geometry: &'a Geometry,
    pub keys: &'a ViewKeys,
    pub shutter: Shutter,
    /// Depth range of the objects, metres.
    pub depths_m: [f64; 2],
    /// The drawn area, in raster axes; may extend beyond the picture.
    pub rect: Rect,
    /// Occlusion by the real scene; `None` without.
    pub occlusion: Option<Occlusion<'a>>,
    /// Depth range (m) of orthographic views, from the camera's plane. `geometry` then has no
    /// distortion, and its focal lengths are px per metre.
    pub parallel_to_m: Option<f64>,
    /// Primaries of the drawn light.
    pub primaries: Primaries,
    /// The camera whose picture this view is a face of.
    pub outer: Option<Outer<'a>>,
}

/// The camera whose picture a cube face belongs to.
#[derive(Clone, Copy, Debug)]
pub struct Outer<'a> {
    pub geometry: &'a Geometry,
    pub camera_from_view: DQuat,
}

crate::uniform! {
    /// `View` in shaders/raster.wgsl.
    pub struct ViewUniform {
        rect_px: [f32; 4],
        focal_px: [f32; 2],
        middle_px: [f32; 2],
        distortion: [f32; 4],
        lens_terms: [f32; 4],
        outer_turn: [f32; 4],
        rotation: [f32; 4],
        eye: [f32; 4],
        lens_m: [f32; 2],
        in_depth: [f32; 2],
        outer_fy_px: f32,
        outer_cy_px: f32,
        k3: f32,
        valid_radius: f32,
        rim_slope: f32,
        near_m: f32,
        time_s: f32,
        readout_s: f32,
        height_px: f32,
        first_key_s: f32,
        keys_per_s: f32,
        last_key: f32,
        tolerance_m: f32,
        per_focus: f32,
        parallel_to_m: f32,
        per_texel: f32,
        key_rotation: [[f32; 4]; MAX_KEYS],
        key_translation: [[f32; 4]; MAX_KEYS],
    }
}

impl ViewUniform {
    /// `whole` is the rectangle of the real scene's depth map.
    pub fn new(view: &View<'_>, whole: &Rect, sample: &RenderSample, focus_distance_m: f64) -> Self {
        let tolerance_m = view.occlusion.map_or(0.0, |occlusion| occlusion.tolerance_m);
        let per_pixel = GridPlacement { first: [whole.x0, whole.y0], per_pixel: 1.0 };
        let depth = view.occlusion.and_then(|occlusion| occlusion.grid_placement).unwrap_or(per_pixel);
        let time_s = sample.time_s;
        let View { geometry, keys, shutter, rect, .. } = *view;
        let i = &geometry.intrinsics;
        // A cube face uses the lens and rows of the picture's camera.
        let camera = view.outer.map_or(geometry, |outer| outer.geometry);
        let d = &camera.distortion;
        let valid = camera.valid_radius();
        let (k3_or_p1, k4_or_p2) = if d.model.is_fisheye() { (d.k3, d.k4) } else { (d.p1, d.p2) };
        let lens_terms = match d.model {
            LensModel::OpencvRational => [d.k4, d.k5, d.k6, 0.0],
            LensModel::Fov => {
                let [omega, double_tan] = d.field_of_view();
                [omega, double_tan, 0.0, 0.0]
            }
            LensModel::ThinPrismFisheye => [d.p1, d.p2, d.sx1, d.sy1],
            LensModel::StMap => d.bound_map().map_or([0.0, 0.0, 1.0, 1.0], |table| {
                [table.low.x, table.low.y, 1.0 / table.cell.x, 1.0 / table.cell.y]
            }),
            LensModel::Opencv | LensModel::OpencvFisheye | LensModel::Equirectangular => [0.0; 4],
        };
        // A large finite number for "everywhere".
        let (valid, slope) = if valid.is_finite() { (valid, camera.rim_slope()) } else { (1e9, 1.0) };
        let (rotation, eye) = keys.at(time_s);
        let keys_per_s = (keys.poses.len() - 1) as f64 / (2.0 * keys.reach_s);
        let nearest = ((time_s + keys.reach_s) * keys_per_s).round().max(0.0) as usize;
        let first = nearest.saturating_sub(MAX_KEYS / 2).min(keys.poses.len().saturating_sub(MAX_KEYS));
        let first_s = first as f64 / keys_per_s - keys.reach_s;
        let poses = &keys.poses[first..keys.poses.len().min(first + MAX_KEYS)];
        let mut key_rotation = [[0.0; 4]; MAX_KEYS];
        let mut key_translation = [[0.0; 4]; MAX_KEYS];
        let mut last = DQuat::IDENTITY;
        for (n, pose) in poses.iter().enumerate() {
            // The same sign as the neighbour, since the shader interpolates between them.
            let q = if last.dot(pose.rotation) < 0.0 { -pose.rotation } else { pose.rotation };
            last = q;
            key_rotation[n] = [q.x as f32, q.y as f32, q.z as f32, q.w as f32];
            let eye = (pose.position_in_world_m() - keys.origin_in_world_m).as_vec3();
            key_translation[n] = [eye.x, eye.y, eye.z, 0.0];
        }
        Self {
            rect_px: [rect.x0 as f32, rect.y0 as f32, rect.width() as f32, rect.height() as f32],
            focal_px: [i.fx_px as f32, i.fy_px as f32],
            middle_px: [i.cx_px as f32, i.cy_px as f32],
            distortion: [d.k1, d.k2, k3_or_p1, k4_or_p2].map(|k| k as f32),
            lens_terms: lens_terms.map(|term| term as f32),
            outer_turn: view.outer.map_or(DQuat::IDENTITY, |outer| outer.camera_from_view).as_quat().to_array(),
            rotation: rotation.as_quat().to_array(),
            eye: eye.as_vec3().extend(0.0).to_array(),
            lens_m: sample.lens_m.map(|c| c as f32),
            in_depth: depth.of_pixel([view.rect.x0, view.rect.y0]),
            outer_fy_px: camera.intrinsics.fy_px as f32,
            outer_cy_px: camera.intrinsics.cy_px as f32,
            k3: d.k3 as f32,
            valid_radius: valid as f32,
            rim_slope: slope as f32,
            near_m: NEAR_M as f32,
            time_s: time_s as f32,
            readout_s: shutter.readout_time_s as f32,
            height_px: camera.intrinsics.height_px as f32,
            first_key_s: first_s as f32,
            keys_per_s: keys_per_s as f32,
            last_key: (poses.len() - 1) as f32,
            tolerance_m,
            per_focus: (1.0 / focus_distance_m) as f32,
            parallel_to_m: view.parallel_to_m.unwrap_or(0.0) as f32,
            per_texel: depth.per_pixel as f32,
            key_rotation,
            key_translation,
        }
    }
}
