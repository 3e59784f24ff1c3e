//! Motion vectors of static objects under a moving camera.
//!
//! Rotation moves all depths alike; translation moves them in proportion to 1/z (Longuet-Higgins
//! and Prazdny 1980, "The interpretation of a moving retinal image"). At every pixel the velocity
//! is V = a + b/z, with z the depth there. So a grid of a and b, computed at two depths, gives the
//! velocity of everything drawn, and the triangles need no motion vectors. It is the velocity
//! through the centre of the lens; that through other points of it is not modelled.
//!
//! With a rolling shutter, a point displaced by dx is exposed by a row that is read g·dx later,
//! where g is the gradient of the row's time (s/px). So within a time ds of the exposure dx = V (ds
//! + g·dx), and the velocity dx/ds is V / (1 − g·V).
//!
//! V is the chord of the exposure, which is exact at the two depths and nearly linear between them.

use glam::{DQuat, DVec2, DVec3};

use super::view::{NEAR_M, View};
use crate::gpu::Gpu;
use crate::pixels::Rect;

/// The motion grid over a rectangle, on the GPU.
#[derive(Debug)]
pub struct MotionGrid {
    /// Side of a cell, px.
    pub side_px: u32,
    /// The covered area.
    pub rect: Rect,
    /// Cells across and down; there is one more node in each direction.
    pub cells: (u32, u32),
    /// [`MotionNode`]s at the cells' corners, row by row.
    pub nodes: wgpu::Buffer,
}

/// Coefficients of the velocity at a corner of a cell; `Node` in shaders/resolve.wgsl has the same
/// layout.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
struct MotionNode {
    /// a: the velocity of points at infinity, px/s.
    rotation_px_per_s: [f32; 2],
    /// b / [`NEAR_M`]: the velocity that translation adds at that distance, px/s.
    translation_px_per_s: [f32; 2],
    /// g: the gradient of the row's time, s/px.
    row_time: [f32; 2],
    unused: [f32; 2],
}

impl MotionGrid {
    /// Motion at the middle of the exposure. 0 for orthographic projection, which is used for
    /// single pictures only.
    pub fn new(gpu: &Gpu, view: &View<'_>) -> Self {
        // Between nodes h apart, a rotation by ω deviates from linear by h² ω / (4 f), which for
        // this h is f ω / 4096. A lens with distortion adds as much again. Each cell costs two
        // triangles.
        let side_px = (view.geometry.intrinsics.fx_px / 32.0).clamp(8.0, 64.0) as u32;
        let cells = (view.rect.width().div_ceil(side_px).max(1), view.rect.height().div_ceil(side_px).max(1));
        let path = CameraPath::new(view);
        let is_static = view.parallel_to_m.is_some() || path.is_static();
        let nodes: Vec<MotionNode> = (0..=cells.1)
            .flat_map(|y| (0..=cells.0).map(move |x| DVec2::new(f64::from(x), f64::from(y)) * f64::from(side_px)))
            .map(|at| {
                if is_static {
                    MotionNode::default()
                } else {
                    path.node(at + DVec2::new(view.rect.x0.into(), view.rect.y0.into()))
                }
            })
            .collect();
        let nodes = gpu.buffer("motion", bytemuck::cast_slice(&nodes), wgpu::BufferUsages::STORAGE);
        Self { side_px, rect: view.rect, cells, nodes }
    }

    /// The area of the cells that a rectangle touches.
    pub fn cells_around(&self, rect: &Rect) -> Rect {
        let side = self.side_px as i32;
        let down = |edge: i32, from: i32| from + (edge - from).div_euclid(side) * side;
        let (x, y) = (self.rect.x0, self.rect.y0);
        Rect::new(down(rect.x0, x), down(rect.y0, y), down(rect.x1 - 1, x) + side, down(rect.y1 - 1, y) + side)
    }

    /// The first cell of a rectangle that starts at a cell, and the number of cells across and
    /// down.
    pub fn cells_of(&self, part: &Rect) -> ((u32, u32), (u32, u32)) {
        let cell = |from: i32, to: i32| (to - from).max(0) as u32 / self.side_px;
        let first = (cell(self.rect.x0, part.x0), cell(self.rect.y0, part.y0));
        (first, (part.width().div_ceil(self.side_px), part.height().div_ceil(self.side_px)))
    }
}

/// The camera's path, as in shaders/raster.wgsl.
struct CameraPath<'a> {
    view: &'a View<'a>,
    step_s: f64,
    /// Rotation and position at the middle of the exposure, and a step before and after.
    moments: [(DQuat, DVec3); 3],
    /// Two depths, metres.
    depths_m: [f64; 2],
}

impl<'a> CameraPath<'a> {
    fn new(view: &'a View<'a>) -> Self {
        let step_s = view.shutter.velocity_step_s();
        let moments = [0.0, -step_s, step_s].map(|t| view.keys.at(t));
        // The objects' depths, at least an octave apart. At depths below five times the camera's
        // travel a chord deviates far from the path, so smaller depths are only used if all objects
        // are that near.
        let travel_m = moments[1].1.distance(moments[2].1);
        let far = view.depths_m[1].max(4.0 * NEAR_M);
        let near = view.depths_m[0].max(5.0 * travel_m).max(2.0 * NEAR_M).min(0.5 * far);
        Self { view, step_s, moments, depths_m: [near, far] }
    }

    fn is_static(&self) -> bool {
        let keys = self.view.keys;
        keys.poses.iter().all(|pose| *pose == keys.poses[0])
    }

    fn node(&self, at_px: DVec2) -> MotionNode {
        let Some(ray) = self.ray(at_px) else { return MotionNode::default() };
        let [near, far] = self.depths_m.map(|depth_m| self.velocity(ray, depth_m));
        let [u, v] = self.depths_m.map(|depth_m| NEAR_M / depth_m);
        let translation_px_per_s = (near - far) / (u - v);
        let rotation_px_per_s = far - translation_px_per_s * v;
        let readout_s = self.view.shutter.readout_time_s;
        let row_time = match (readout_s > 0.0, &self.view.outer) {
            (false, _) => DVec2::ZERO,
            (true, None) => DVec2::new(0.0, readout_s / f64::from(self.view.geometry.intrinsics.height_px)),
            (true, Some(_)) => DVec2::new(self.slope(at_px, DVec2::X), self.slope(at_px, DVec2::Y)),
        };
        let [rotation_px_per_s, translation_px_per_s, row_time] =
            [rotation_px_per_s, translation_px_per_s, row_time].map(|v| v.as_vec2().to_array());
        MotionNode { rotation_px_per_s, translation_px_per_s, row_time, unused: [0.0; 2] }
    }

    /// The gradient of the row's time in one direction, s/px.
    fn slope(&self, at_px: DVec2, side: DVec2) -> f64 {
        let [before, after] = [-0.5, 0.5].map(|step| self.ray(at_px + step * side).map(|ray| self.row_time_s(ray)));
        before.zip(after).map_or(0.0, |(before, after)| after - before)
    }

    /// The ray at z = 1. Outside the field of view, that of the nearest visible pixel towards the
    /// centre.
    fn ray(&self, at_px: DVec2) -> Option<DVec3> {
        let i = &self.view.geometry.intrinsics;
        let middle = DVec2::new(i.cx_px, i.cy_px);
        (0..8).find_map(|n| self.view.geometry.unproject(at_px.lerp(middle, 0.05 * f64::from(n))))
    }

    /// V, px/s: the chord from a step before to a step after, relative to that pixel's row.
    fn velocity(&self, ray: DVec3, depth_m: f64) -> DVec2 {
        let [now, before, after] = if self.view.shutter.readout_time_s > 0.0 {
            let row_s = self.row_time_s(ray);
            [0.0, -self.step_s, self.step_s].map(|t| self.view.keys.at(row_s + t))
        } else {
            self.moments
        };
        let point = now.0.inverse() * (depth_m * ray) + now.1;
        let project = |(turn, eye): (DQuat, DVec3)| {
            let p = turn * (point - eye);
            self.view.geometry.distorted_px(p.truncate() / p.z.max(0.5 * NEAR_M))
        };
        (project(after) - project(before)) / (2.0 * self.step_s)
    }

    /// Readout time of the row that images a direction. Far outside the picture, times are clamped
    /// to those near its border.
    fn row_time_s(&self, direction: DVec3) -> f64 {
        let (geometry, y_px) = match &self.view.outer {
            Some(outer) => (outer.geometry, outer.geometry.project_extended_px(outer.camera_from_view * direction).y),
            None => (self.view.geometry, self.view.geometry.distorted_px(direction.truncate() / direction.z).y),
        };
        let readout_s = self.view.shutter.readout_time_s;
        (readout_s * (y_px / f64::from(geometry.intrinsics.height_px) - 0.5)).clamp(-readout_s, readout_s)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{Distortion, Geometry, Intrinsics};
    use crate::pixels::Rect;
    use crate::pose::Pose;
    use crate::render::{Shutter, ViewKeys};

    /// Velocity at a pixel and depth by the grid's node there, for a camera that moves with
    /// `metres_per_s` and turns with `radians_per_s` around its own axes.
    fn velocity(geometry: &Geometry, readout_time_s: f64, going: DVec3, turning: DVec3, at: DVec2, z: f64) -> DVec2 {
        let shutter = Shutter { exposure_time_s: 0.01, readout_time_s, beyond_s: 0.0 };
        let keys =
            ViewKeys::new(shutter, |t| Pose::from_camera_in_world(going * t, DQuat::from_scaled_axis(turning * t)));
        let view = View {
            geometry,
            keys: &keys,
            shutter,
            depths_m: [0.3, 8.0],
            rect: Rect::full(640, 480),
            occlusion: None,
            parallel_to_m: None,
            primaries: crate::camera::Primaries::Rec709,
            outer: None,
        };
        let MotionNode { rotation_px_per_s, translation_px_per_s, row_time, .. } = CameraPath::new(&view).node(at);
        let [rotation_px_per_s, translation_px_per_s, row_time] =
            [rotation_px_per_s, translation_px_per_s, row_time].map(|[x, y]| DVec2::new(x.into(), y.into()));
        let v = rotation_px_per_s + translation_px_per_s * NEAR_M / z;
        v / (1.0 - row_time.dot(v))
    }

    fn camera(distortion: Distortion) -> Geometry {
        let intrinsics = Intrinsics { fx_px: 500.0, fy_px: 500.0, ..Intrinsics::default() };
        Geometry::new(intrinsics, distortion)
    }

    #[test]
    fn pinhole_flow_matches_hand_calculation() {
        let g = camera(Distortion::default());
        let (still, at) = (DVec3::ZERO, DVec2::new(420.0, 140.0));
        // Ray (0.2, −0.2). Moving right at 1 m/s: −500/z px/s. Moving forward: 500 · 0.2/z
        // outwards.
        for z in [0.7, 1.5, 8.0] {
            let right = velocity(&g, 0.0, DVec3::X, still, at, z);
            assert!(right.distance(DVec2::new(-500.0 / z, 0.0)) < 0.02, "{z} m: {right}");
            let ahead = velocity(&g, 0.0, DVec3::Z, still, at, z);
            // The chord over a centimetre of travel deviates by 0.03 % between the two depths.
            assert!(ahead.distance(DVec2::new(100.0 / z, -100.0 / z)) < 0.06, "{z} m: {ahead}");
            // Rotating about y (to the right) by 0.5 rad/s: −500 · 0.5 (1 + x², xy), whatever the
            // depth.
            let turned = velocity(&g, 0.0, still, 0.5 * DVec3::Y, at, z);
            assert!(turned.distance(DVec2::new(-250.0 * 1.04, 250.0 * 0.04)) < 0.02, "{z} m: {turned}");
        }
    }

    #[test]
    fn rolling_shutter_velocity_accounts_for_row_time() {
        let g = camera(Distortion::default());
        // A point that falls by V px/s is met by rows read V · readout / height later: V / (1 −
        // that).
        let readout_s = 0.02;
        for z in [0.3, 0.5, 1.0, 3.0, 8.0] {
            let fast = velocity(&g, readout_s, DVec3::new(0.4, -1.0, 0.0), DVec3::ZERO, DVec2::new(320.0, 240.0), z);
            let slower = 1.0 - 500.0 / z * readout_s / 480.0;
            let by_hand = DVec2::new(-200.0 / z, 500.0 / z) / slower;
            assert!(fast.distance(by_hand) < 2e-3 * by_hand.length(), "{z} m: {fast}, by hand {by_hand}");
        }
    }

    #[test]
    fn distorted_velocity_matches_a_projected_point() {
        let g = camera(Distortion { k1: -0.3, k2: 0.1, p1: 1e-3, ..Distortion::default() });
        let (going, turning) = (DVec3::new(0.3, -0.2, 0.5), DVec3::new(0.4, -0.6, 0.9));
        for (at, z) in [((30.5, 40.5), 0.4), ((600.5, 200.5), 1.0), ((320.5, 470.5), 5.0)] {
            let at = DVec2::from(at);
            let point = g.unproject(at).expect("inside") * z;
            let project = |t: f64| {
                let pose = Pose::from_camera_in_world(going * t, DQuat::from_scaled_axis(turning * t));
                g.project(pose.transform_point(point)).expect("before the camera")
            };
            let truth = (project(1e-4) - project(-1e-4)) / 2e-4;
            let estimated = velocity(&g, 0.0, going, turning, at, z);
            assert!(estimated.distance(truth) < 2e-3 * truth.length(), "{at}, {z} m: {estimated}, truth {truth}");
        }
    }
}
