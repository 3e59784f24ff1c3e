//! How what stands still moves through the picture while the camera moves.
//!
//! A turning camera moves all depths alike, a camera that goes moves them by their nearness (Longuet-Higgins and Prazdny
//! 1980, "The interpretation of a moving retinal image"): at every place velocity is a + b/z, z the depth seen there,
//! through a thin lens too. So a net of a and b, worked out at two depths, holds the velocity of all that can be
//! drawn, and the triangles need not carry it. In rows with times of their own and over the chord of a long exposure it is
//! exact at these two depths.

use glam::{DQuat, DVec2, DVec3};

use super::draw::View;
use super::view::NEAR_M;
use crate::gpu::Gpu;

/// Velocities fit 16-bit floats, px/s.
const LARGEST_PX_PER_S: f64 = 60000.0;

/// The net over a rectangle, on the GPU.
#[derive(Debug)]
pub struct Motion {
    /// Of a cell, px.
    pub side_px: u32,
    /// Cells across and down.
    pub cells: (u32, u32),
    /// At the cells' corners, row by row: a, and b / [`NEAR_M`].
    pub nodes: wgpu::Buffer,
}

impl Motion {
    /// While the shutter is open in the middle of the exposure. What parallel rays see stands still.
    pub fn new(gpu: &Gpu, view: &View<'_>) -> Self {
        use wgpu::util::DeviceExt;
        // Between nodes h apart a turn by ω leaves the straight line by h² ω / (4 f), with this h by f ω / 1024: a hand-held
        // camera's blur is right to 0.02 px. Each cell costs two triangles.
        let side_px = (view.geometry.intrinsics.fx_px / 16.0).clamp(16.0, 128.0) as u32;
        let cells = (view.rect.width().div_ceil(side_px).max(1), view.rect.height().div_ceil(side_px).max(1));
        let path = Path::new(view);
        let rests = view.parallel_to_m.is_some() || path.rests();
        let nodes: Vec<[f32; 4]> =
            (0..=cells.1)
                .flat_map(|y| (0..=cells.0).map(move |x| DVec2::new(f64::from(x), f64::from(y)) * f64::from(side_px)))
                .map(|at| {
                    if rests { [0.0; 4] } else { path.node(at + DVec2::new(view.rect.x0.into(), view.rect.y0.into())) }
                })
                .collect();
        let nodes = gpu.device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
            label: Some("motion"),
            contents: bytemuck::cast_slice(&nodes),
            usage: wgpu::BufferUsages::STORAGE,
        });
        Self { side_px, cells, nodes }
    }
}

/// The camera on its way, as shaders/raster.wgsl sees it.
struct Path<'a> {
    view: &'a View<'a>,
    step_s: f64,
    /// Rotation and position at the middle of the exposure and a step before and after.
    moments: [(DQuat, DVec3); 3],
    /// Two depths, metres.
    depths_m: [f64; 2],
}

impl<'a> Path<'a> {
    fn new(view: &'a View<'a>) -> Self {
        let step_s = view.shutter.velocity_step_s();
        let moments = [0.0, -step_s, step_s].map(|t| view.keys.at(t));
        // Of the objects; at least an octave, at most three apart, and not right before the lens.
        let far = view.depths_m[1].max(4.0 * NEAR_M);
        let near = view.depths_m[0].clamp(0.125 * far, 0.5 * far);
        Self { view, step_s, moments, depths_m: [near, far] }
    }

    fn rests(&self) -> bool {
        let keys = self.view.keys;
        keys.poses.iter().all(|pose| *pose == keys.poses[0])
    }

    fn node(&self, at_px: DVec2) -> [f32; 4] {
        let Some(ray) = self.ray(at_px) else { return [0.0; 4] };
        let [near, far] = self.depths_m.map(|depth_m| self.velocity(at_px, ray, depth_m));
        let [u, v] = self.depths_m.map(|depth_m| NEAR_M / depth_m);
        let by_nearness = (near - far) / (u - v);
        let still = far - by_nearness * v;
        [still.x, still.y, by_nearness.x, by_nearness.y].map(|v| v as f32)
    }

    /// At z = 1; where the lens sees nothing, that of the nearest place towards its middle that is seen.
    fn ray(&self, at_px: DVec2) -> Option<DVec3> {
        let i = &self.view.geometry.intrinsics;
        let middle = DVec2::new(i.cx_px, i.cy_px);
        (0..8).find_map(|n| self.view.geometry.unproject(at_px.lerp(middle, 0.05 * f64::from(n))))
    }

    /// px/s: the chord from a step before to a step after.
    fn velocity(&self, at_px: DVec2, ray: DVec3, depth_m: f64) -> DVec2 {
        let here = depth_m * ray;
        let (turn, eye) = match self.rolling() {
            true => self.view.keys.at(self.row_time_s(here, at_px)),
            false => self.moments[0],
        };
        let point = turn.inverse() * here + eye;
        let chord = self.seen(point, 2) - self.seen(point, 1);
        (chord / (2.0 * self.step_s)).clamp(DVec2::splat(-LARGEST_PX_PER_S), DVec2::splat(LARGEST_PX_PER_S))
    }

    fn rolling(&self) -> bool {
        self.view.shutter.readout_time_s > 0.0
    }

    /// Where a point is seen at a moment, each row at its own time.
    fn seen(&self, point: DVec3, moment: usize) -> DVec2 {
        let place = |(turn, eye): (DQuat, DVec3)| {
            let p = turn * (point - eye);
            (p, self.view.geometry.distorted_px(p.truncate() / p.z.max(0.5 * NEAR_M)))
        };
        let (mut p, mut at_px) = place(self.moments[moment]);
        if self.rolling() {
            for _ in 0..4 {
                let time_s = [0.0, -self.step_s, self.step_s][moment] + self.row_time_s(p, at_px);
                (p, at_px) = place(self.view.keys.at(time_s));
            }
        }
        at_px
    }

    /// When the row in which a point is seen is read; rows far outside the picture near its own time.
    fn row_time_s(&self, p: DVec3, at_px: DVec2) -> f64 {
        let (geometry, y_px) = match &self.view.outer {
            Some(outer) => (outer.geometry, outer.geometry.carried_px(outer.camera_from_view * p).y),
            None => (self.view.geometry, at_px.y),
        };
        let readout_s = self.view.shutter.readout_time_s;
        (readout_s * (y_px / f64::from(geometry.intrinsics.height_px) - 0.5)).clamp(-readout_s, readout_s)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{Distortion, Geometry, Intrinsics};
    use crate::image::Rect;
    use crate::pose::Pose;
    use crate::render::{Shutter, ViewKeys};

    /// Velocity at a place and depth by the net's node there, of a camera that goes with `metres_per_s` and turns with
    /// `radians_per_s` around its own axes.
    fn velocity(geometry: &Geometry, readout_time_s: f64, going: DVec3, turning: DVec3, at: DVec2, z: f64) -> DVec2 {
        let shutter = Shutter { exposure_time_s: 0.01, readout_time_s, beyond_s: 0.0 };
        let keys =
            ViewKeys::new(shutter, |t| Pose::from_camera_in_world(going * t, DQuat::from_scaled_axis(turning * t)));
        let view = View {
            geometry,
            keys: &keys,
            shutter,
            depths_m: [1.0, 3.0],
            rect: Rect::full(640, 480),
            occlusion: None,
            parallel_to_m: None,
            outer: None,
        };
        let [ax, ay, bx, by] = Path::new(&view).node(at).map(f64::from);
        DVec2::new(ax, ay) + DVec2::new(bx, by) * NEAR_M / z
    }

    fn camera(distortion: Distortion) -> Geometry {
        let intrinsics = Intrinsics { fx_px: 500.0, fy_px: 500.0, ..Intrinsics::default() };
        Geometry::new(intrinsics, distortion)
    }

    #[test]
    fn a_pinhole_s_flow_by_hand() {
        let g = camera(Distortion::default());
        let (still, at) = (DVec3::ZERO, DVec2::new(420.0, 140.0));
        // Ray (0.2, −0.2). Going right by 1 m/s: −500/z px/s. Going ahead: 500 · 0.2/z outwards.
        for z in [0.7, 1.5, 8.0] {
            let right = velocity(&g, 0.0, DVec3::X, still, at, z);
            assert!(right.distance(DVec2::new(-500.0 / z, 0.0)) < 0.02, "{z} m: {right}");
            let ahead = velocity(&g, 0.0, DVec3::Z, still, at, z);
            assert!(ahead.distance(DVec2::new(100.0 / z, -100.0 / z)) < 0.02, "{z} m: {ahead}");
            // Turning about y (to the right) by 0.5 rad/s: −500 · 0.5 (1 + x², xy), whatever the depth.
            let turned = velocity(&g, 0.0, still, 0.5 * DVec3::Y, at, z);
            assert!(turned.distance(DVec2::new(-250.0 * 1.04, 250.0 * 0.04)) < 0.02, "{z} m: {turned}");
        }
    }

    #[test]
    fn rows_with_times_of_their_own() {
        let g = camera(Distortion::default());
        // A point that falls by V px/s is met by rows that are read V · readout / height later: V / (1 − that).
        let readout_s = 0.02;
        let fast = velocity(&g, readout_s, -DVec3::Y, DVec3::ZERO, DVec2::new(320.0, 240.0), 1.0);
        let by_hand = 500.0 / (1.0 - 500.0 * readout_s / 480.0);
        assert!((fast.y - by_hand).abs() < 0.01 && fast.x.abs() < 1e-6, "{fast}, by hand {by_hand}");
    }

    #[test]
    fn through_a_lens_that_bends_it_is_what_a_point_does() {
        let g = camera(Distortion { k1: -0.3, k2: 0.1, p1: 1e-3, ..Distortion::default() });
        let (going, turning) = (DVec3::new(0.3, -0.2, 0.5), DVec3::new(0.4, -0.6, 0.9));
        for (at, z) in [((30.5, 40.5), 1.2), ((600.5, 200.5), 2.0), ((320.5, 470.5), 5.0)] {
            let at = DVec2::from(at);
            let point = g.unproject(at).expect("inside") * z;
            let seen = |t: f64| {
                let pose = Pose::from_camera_in_world(going * t, DQuat::from_scaled_axis(turning * t));
                g.project(pose.transform_point(point)).expect("before the camera")
            };
            let truth = (seen(1e-4) - seen(-1e-4)) / 2e-4;
            let told = velocity(&g, 0.0, going, turning, at, z);
            assert!(told.distance(truth) < 2e-3 * truth.length(), "{at}, {z} m: {told}, truth {truth}");
        }
    }
}
