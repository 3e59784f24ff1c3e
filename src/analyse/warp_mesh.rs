//! Warp mesh between two frames: positions and flows at nodes every few pixels, linear between.

use crate::fit::quantile::{upper_median, upper_median_in_place};
use glam::{DAffine3, DMat2, DVec2, DVec3};

use super::blur_frame::{BlurFrame, halvings};
use super::box_blur::cubic_weights;
use super::camera_model::{CameraModel, is_same_surface};
use super::state::{CameraState, move_point, project_rolling_shutter};
use crate::grey_image::GreyImage;

/// Distance between nodes, px.
const CELL: usize = 8;
/// Largest relative depth difference within a block.
const MAX_BLOCK_DEPTH_STEP: f64 = 0.08;
/// Largest flow, px/s.
const MAX_FLOW_PX_S: f64 = 4000.0;
/// Smallest distance of a valid node from the picture's edge, px.
const MARGIN_PX: f64 = 6.0;
/// Largest relative area change of the warp.
const MAX_AREA_CHANGE: f64 = 0.7;
/// Shifts of patches: largest difference from the median, px; σ of their smoothing, px; weight of
/// the median.
const MAX_SHIFT_DEVIATION_PX: f64 = 1.5;
const SHIFT_SMOOTHING_PX: f64 = 60.0;
const MEDIAN_SHIFT_WEIGHT: f64 = 0.02;

/// A node of frame J, px of the reduced pictures.
#[derive(Clone, Copy, Debug, Default)]
pub struct MeshNode {
    /// Position in frame I.
    pub at: DVec2,
    /// Flow of J, and flow of I in J's axes, px/s.
    pub own: DVec2,
    pub other: DVec2,
    /// 0 where unknown.
    depth: f64,
    is_valid: bool,
}

/// Nodes of the mesh, row by row, `across` in each.
pub struct WarpMesh {
    across: usize,
    down: usize,
    nodes: Vec<MeshNode>,
    /// [`CameraModel::inverse_depth_tolerance`].
    inverse_depth_tolerance: f64,
}

impl WarpMesh {
    pub fn new(model: &CameraModel, i: &BlurFrame, j: &BlurFrame) -> Self {
        let (w, h) = (j.light.width, j.light.height);
        let (across, down) = (w / CELL + 1, h / CELL + 1);
        let scale = 1usize << halvings(model);
        let i_from_j = i.state.world_from_camera.inverse() * j.state.world_from_camera;
        let node = |n: usize| {
            let (x, y) = ((n % across) * CELL, (n / across) * CELL);
            Self::node(model, i, j, &i_from_j, (x, y), scale)
        };
        let mut mesh = Self {
            across,
            down,
            nodes: (0..across * down).map(node).collect(),
            inverse_depth_tolerance: model.inverse_depth_tolerance,
        };
        mesh.transform_flow();
        mesh.extrapolate();
        mesh
    }

    fn node(
        model: &CameraModel,
        i: &BlurFrame,
        j: &BlurFrame,
        i_from_j: &DAffine3,
        (x, y): (usize, usize),
        scale: usize,
    ) -> MeshNode {
        let small = scale as f64;
        let none = MeshNode { at: DVec2::new(x as f64, y as f64), ..MeshNode::default() };
        let (x, y) = (x * scale, y * scale);
        let Some((z, ray)) = depth_near(model, &j.depth, x, y) else { return none };
        let there = f64::from(z) * DVec3::from(ray.map(f64::from));
        let correspondence = || {
            let own = flow(model, there, &j.at_row(model.geometry.row_time_s(y as f64 + 0.5)))?;
            let now =
                i_from_j.transform_point3(move_point(there, &j.state.twist, model.geometry.row_time_s(y as f64 + 0.5)));
            if now.z <= 0.0 {
                return None;
            }
            let (at, far) = project_rolling_shutter(&model.geometry, now, &i.state.twist, None, 2)?;
            let row_s = model.geometry.row_time_s(at.y);
            let other = flow(model, move_point(now, &i.state.twist, -row_s), &i.at_row(row_s))?;
            Some((own, at, far, other))
        };
        let Some((own, at, far, other)) = correspondence() else { return none };
        let (width, height) = model.size();
        let margin = MARGIN_PX * small;
        let is_inside = at.x > margin && at.y > margin && at.x < width as f64 - margin && at.y < height as f64 - margin;
        let depth_there = if is_inside { f64::from(i.depth[at.y as usize * width + at.x as usize]) } else { 0.0 };
        let is_same = depth_there == 0.0 || is_same_surface(depth_there, far, model.depth_tolerance_m(far));
        let is_clipped =
            j.is_clipped_near(model, x as f64, y as f64) || (is_inside && i.is_clipped_near(model, at.x, at.y));
        MeshNode {
            at: (at - 0.5) / small,
            own: own / small,
            other: other / small,
            depth: z.into(),
            is_valid: is_inside && is_same && !is_clipped,
        }
    }

    /// Transforms I's flow into J's axes, by the Jacobian of the warp.
    fn transform_flow(&mut self) {
        let before = self.nodes.clone();
        for n in 0..before.len() {
            let (x, y) = (n % self.across, n / self.across);
            let span = |a: usize, b: usize| {
                let (a, b) = (&before[a], &before[b]);
                (a.depth > 0.0 && b.depth > 0.0).then(|| b.at - a.at)
            };
            let along = span(n - usize::from(x > 0), n + usize::from(x + 1 < self.across));
            let down =
                span(n - if y > 0 { self.across } else { 0 }, n + if y + 1 < self.down { self.across } else { 0 });
            let steps_x = (usize::from(x > 0) + usize::from(x + 1 < self.across)) * CELL;
            let steps_y = (usize::from(y > 0) + usize::from(y + 1 < self.down)) * CELL;
            let node = &mut self.nodes[n];
            match (along, down) {
                (Some(along), Some(down)) => {
                    let m = DMat2::from_cols(along / steps_x as f64, down / steps_y as f64);
                    if (m.determinant() - 1.0).abs() < MAX_AREA_CHANGE {
                        node.other = m.inverse() * node.other;
                    } else {
                        node.is_valid = false;
                    }
                }
                _ => node.is_valid = false,
            }
        }
    }

    /// Extrapolates positions to nodes without depth. They only affect the band-pass near valid
    /// nodes.
    fn extrapolate(&mut self) {
        let place = |n: usize, across: usize| DVec2::new((n % across * CELL) as f64, (n / across * CELL) as f64);
        let mut has_depth: Vec<bool> = self.nodes.iter().map(|node| node.depth > 0.0).collect();
        for _ in 0..self.across.max(self.down) {
            let mut next = has_depth.clone();
            for n in 0..self.nodes.len() {
                if has_depth[n] {
                    continue;
                }
                let (x, y) = (n % self.across, n / self.across);
                let around = [
                    (x > 0).then(|| n - 1),
                    (x + 1 < self.across).then(|| n + 1),
                    (y > 0).then(|| n - self.across),
                    (y + 1 < self.down).then(|| n + self.across),
                ];
                let (mut sum, mut count) = (DVec2::ZERO, 0.0);
                for m in around.into_iter().flatten().filter(|m| has_depth[*m]) {
                    sum += self.nodes[m].at - place(m, self.across);
                    count += 1.0;
                }
                if count > 0.0 {
                    self.nodes[n].at = place(n, self.across) + sum / count;
                    next[n] = true;
                }
            }
            if next == has_depth {
                break;
            }
            has_depth = next;
        }
    }

    /// The middle node of a block, if all nine of its nodes are valid and on one surface.
    pub fn block(&self, x: usize, y: usize) -> Option<&MeshNode> {
        let (cx, cy) = (x / CELL, y / CELL);
        if cx + 2 >= self.across || cy + 2 >= self.down {
            return None;
        }
        let (mut near, mut far) = (f64::MAX, 0.0f64);
        for dy in 0..3 {
            for dx in 0..3 {
                let node = &self.nodes[(cy + dy) * self.across + cx + dx];
                if !node.is_valid {
                    return None;
                }
                (near, far) = (near.min(node.depth), far.max(node.depth));
            }
        }
        (far - near < MAX_BLOCK_DEPTH_STEP * near + self.inverse_depth_tolerance * near * near)
            .then(|| &self.nodes[(cy + 1) * self.across + cx + 1])
    }

    /// A plane of I, warped to J.
    pub fn warped(&self, plane: &GreyImage) -> GreyImage {
        let (w, h) = (plane.width, plane.height);
        let mut out = GreyImage::uniform(w, h, 0.0);
        let at = |cx: usize, cy: usize| self.nodes[cy.min(self.down - 1) * self.across + cx.min(self.across - 1)].at;
        for cy in 0..h.div_ceil(CELL) {
            for cx in 0..w.div_ceil(CELL) {
                let corner = [at(cx, cy), at(cx + 1, cy), at(cx, cy + 1), at(cx + 1, cy + 1)].map(|p| p.as_vec2());
                for dy in 0..CELL.min(h - cy * CELL) {
                    let fy = dy as f32 / CELL as f32;
                    let (a, b) = (corner[0].lerp(corner[2], fy), corner[1].lerp(corner[3], fy));
                    let row = (cy * CELL + dy) * w + cx * CELL;
                    for dx in 0..CELL.min(w - cx * CELL) {
                        let p = a.lerp(b, dx as f32 / CELL as f32);
                        out.values[row + dx] = cubic(plane, p.x, p.y);
                    }
                }
            }
        }
        out
    }

    /// Moves the nodes by the patches' shifts, smoothed.
    pub fn apply_shifts(&mut self, shifts: &[(DVec2, DVec2)]) {
        let middle = |of: fn(&(DVec2, DVec2)) -> f64| upper_median(shifts.iter().map(of)).unwrap_or(0.0);
        let usual = DVec2::new(middle(|s| s.1.x), middle(|s| s.1.y));
        let near: Vec<_> = shifts.iter().filter(|s| (s.1 - usual).length() < MAX_SHIFT_DEVIATION_PX).collect();
        for n in 0..self.nodes.len() {
            let here = DVec2::new((n % self.across * CELL) as f64, (n / self.across * CELL) as f64);
            let (mut sum, mut whole) = (MEDIAN_SHIFT_WEIGHT * usual, MEDIAN_SHIFT_WEIGHT);
            for (at, by) in &near {
                let weight = (-(*at - here).length_squared() / (2.0 * SHIFT_SMOOTHING_PX * SHIFT_SMOOTHING_PX)).exp();
                sum += weight * *by;
                whole += weight;
            }
            // The Jacobian of the warp is nearly the identity.
            self.nodes[n].at += sum / whole;
        }
    }
}

/// Median of the depth around a pixel, and the pixel's ray; `None` where most depth is unknown.
fn depth_near(model: &CameraModel, depth: &[f32], x: usize, y: usize) -> Option<(f32, [f32; 3])> {
    let (width, height) = model.size();
    let (x, y) = (x.min(width - 1), y.min(height - 1));
    let mut depths = [0.0f32; 9];
    let mut count = 0;
    for dy in 0..3 {
        for dx in 0..3 {
            let (x, y) =
                ((x + 2 * dx).saturating_sub(2).min(width - 1), (y + 2 * dy).saturating_sub(2).min(height - 1));
            let z = depth[y * width + x];
            if z > 0.0 {
                depths[count] = z;
                count += 1;
            }
        }
    }
    let ray = model.rays[y * width + x];
    let depth_m = upper_median_in_place(&mut depths[..count])?;
    (count >= 5 && ray[0].is_finite()).then_some((depth_m, ray))
}

/// Cubic convolution, which keeps the warped picture nearly as sharp as the original. Positions are
/// clamped to the picture.
fn cubic(plane: &GreyImage, x: f32, y: f32) -> f32 {
    let (w, h) = (plane.width, plane.height);
    let x = x.clamp(1.0, w as f32 - 3.001);
    let y = y.clamp(1.0, h as f32 - 3.001);
    let (column, row) = (x as usize, y as usize);
    let (wx, wy) = (cubic_weights(x - column as f32), cubic_weights(y - row as f32));
    let mut sum = 0.0;
    for (k, wy) in wy.iter().enumerate() {
        let i = (row + k - 1) * w + column - 1;
        let v = &plane.values[i..i + 4];
        sum += wy * (wx[0] * v[0] + wx[1] * v[1] + wx[2] * v[2] + wx[3] * v[3]);
    }
    sum
}

/// Optical flow of a static point at `x`, given in the camera's axes at its row's time, px/s.
pub fn flow(model: &CameraModel, x: DVec3, state: &CameraState) -> Option<DVec2> {
    const HALF_S: f64 = 1e-3;
    let at = |by_s: f64| model.geometry.project(move_point(x, &state.twist, -by_s));
    let flow = (at(HALF_S)? - at(-HALF_S)?) / (2.0 * HALF_S);
    (flow.is_finite() && flow.length() < MAX_FLOW_PX_S).then_some(flow)
}
