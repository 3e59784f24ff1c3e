//! Where places of one frame lie in another, and how what is there moves in both: known every few pixels, straight between.

use glam::{DAffine3, DMat2, DVec2, DVec3};

use super::blurred::{Blurred, halvings};
use super::boxes::weights;
use super::eye::{Eye, is_same};
use super::pyramid::Plane;
use super::robust::median;
use super::state::{State, moved, seen};

/// Distance between the places, px.
const CELL: usize = 8;
/// Within a block depth differs by less than this share.
const SMOOTH: f64 = 0.08;
/// Faster flows are not followed, px/s.
const FASTEST: f64 = 4000.0;
/// How far from the rim a place must lie, px.
const RIM_PX: f64 = 6.0;
/// The warp's area may change by this share.
const AREA: f64 = 0.7;
/// Shifts count that differ from the usual one by less, px; σ over which they are smoothed, px; weight of the usual one.
const NEAR_PX: f64 = 1.5;
const SMOOTH_PX: f64 = 60.0;
const USUAL: f64 = 0.02;

/// Where a place of J lies in I, and how both flow there, px of the small pictures.
#[derive(Clone, Copy, Debug, Default)]
pub struct Node {
    pub at: DVec2,
    pub own: DVec2,
    pub other: DVec2,
    depth: f64,
    is_sound: bool,
}

pub struct Mesh {
    across: usize,
    down: usize,
    nodes: Vec<Node>,
    /// [`Eye::loose`].
    loose: f64,
}

impl Mesh {
    pub fn new(eye: &Eye, i: &Blurred, j: &Blurred) -> Self {
        let (w, h) = (j.light.width, j.light.height);
        let (across, down) = (w / CELL + 1, h / CELL + 1);
        let scale = 1usize << halvings(eye);
        let i_from_j = i.state.world_from_camera.inverse() * j.state.world_from_camera;
        let node = |n: usize| {
            let (x, y) = ((n % across) * CELL, (n / across) * CELL);
            Self::node(eye, i, j, &i_from_j, (x, y), scale)
        };
        let mut mesh = Self { across, down, nodes: (0..across * down).map(node).collect(), loose: eye.loose };
        mesh.turn();
        mesh.fill();
        mesh
    }

    fn node(eye: &Eye, i: &Blurred, j: &Blurred, i_from_j: &DAffine3, (x, y): (usize, usize), scale: usize) -> Node {
        let small = scale as f64;
        let none = Node { at: DVec2::new(x as f64, y as f64), ..Node::default() };
        let (x, y) = (x * scale, y * scale);
        let Some((z, ray)) = depth_near(eye, &j.depth, x, y) else { return none };
        let there = f64::from(z) * DVec3::from(ray.map(f64::from));
        let found = || {
            let own = flow(eye, there, &j.at_row(eye.geometry.row_time_s(y as f64 + 0.5)))?;
            let now = i_from_j.transform_point3(moved(there, &j.state.twist, eye.geometry.row_time_s(y as f64 + 0.5)));
            if now.z <= 0.0 {
                return None;
            }
            let (at, far) = seen(&eye.geometry, now, &i.state.twist, None, 2)?;
            let row_s = eye.geometry.row_time_s(at.y);
            let other = flow(eye, moved(now, &i.state.twist, -row_s), &i.at_row(row_s))?;
            Some((own, at, far, other))
        };
        let Some((own, at, far, other)) = found() else { return none };
        let (width, height) = eye.size();
        let margin = RIM_PX * small;
        let is_inside = at.x > margin && at.y > margin && at.x < width as f64 - margin && at.y < height as f64 - margin;
        let depth_there = if is_inside { f64::from(i.depth[at.y as usize * width + at.x as usize]) } else { 0.0 };
        let is_same = depth_there == 0.0 || is_same(depth_there, far, eye.slack_m(far));
        let is_clipped =
            j.is_clipped_near(eye, x as f64, y as f64) || (is_inside && i.is_clipped_near(eye, at.x, at.y));
        Node {
            at: (at - 0.5) / small,
            own: own / small,
            other: other / small,
            depth: z.into(),
            is_sound: is_inside && is_same && !is_clipped,
        }
    }

    /// I's flow into J's axes, by the warp's own slope.
    fn turn(&mut self) {
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
                    if (m.determinant() - 1.0).abs() < AREA {
                        node.other = m.inverse() * node.other;
                    } else {
                        node.is_sound = false;
                    }
                }
                _ => node.is_sound = false,
            }
        }
    }

    /// Where depth is unknown, what is around it goes on: only the Gaussians see it.
    fn fill(&mut self) {
        let place = |n: usize, across: usize| DVec2::new((n % across * CELL) as f64, (n / across * CELL) as f64);
        let mut known: Vec<bool> = self.nodes.iter().map(|node| node.depth > 0.0).collect();
        for _ in 0..self.across.max(self.down) {
            let mut next = known.clone();
            for n in 0..self.nodes.len() {
                if known[n] {
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
                for m in around.into_iter().flatten().filter(|m| known[*m]) {
                    sum += self.nodes[m].at - place(m, self.across);
                    count += 1.0;
                }
                if count > 0.0 {
                    self.nodes[n].at = place(n, self.across) + sum / count;
                    next[n] = true;
                }
            }
            if next == known {
                break;
            }
            known = next;
        }
    }

    /// The node in the middle of a block, if all nine of it are sound and of one surface.
    pub fn block(&self, x: usize, y: usize) -> Option<&Node> {
        let (cx, cy) = (x / CELL, y / CELL);
        if cx + 2 >= self.across || cy + 2 >= self.down {
            return None;
        }
        let (mut near, mut far) = (f64::MAX, 0.0f64);
        for dy in 0..3 {
            for dx in 0..3 {
                let node = &self.nodes[(cy + dy) * self.across + cx + dx];
                if !node.is_sound {
                    return None;
                }
                (near, far) = (near.min(node.depth), far.max(node.depth));
            }
        }
        (far - near < SMOOTH * near + self.loose * near * near).then(|| &self.nodes[(cy + 1) * self.across + cx + 1])
    }

    /// A plane of I as J would show it.
    pub fn warped(&self, plane: &Plane) -> Plane {
        let (w, h) = (plane.width, plane.height);
        let mut out = Plane::new(w, h, 0.0);
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

    /// By the patches' shifts, smoothed.
    pub fn shifted(&mut self, shifts: &[(DVec2, DVec2)]) {
        let middle = |of: fn(&(DVec2, DVec2)) -> f64| {
            let mut values: Vec<f64> = shifts.iter().map(of).collect();
            median(&mut values)
        };
        let usual = DVec2::new(middle(|s| s.1.x), middle(|s| s.1.y));
        let near: Vec<_> = shifts.iter().filter(|s| (s.1 - usual).length() < NEAR_PX).collect();
        for n in 0..self.nodes.len() {
            let here = DVec2::new((n % self.across * CELL) as f64, (n / self.across * CELL) as f64);
            let (mut sum, mut whole) = (USUAL * usual, USUAL);
            for (at, by) in &near {
                let weight = (-(*at - here).length_squared() / (2.0 * SMOOTH_PX * SMOOTH_PX)).exp();
                sum += weight * *by;
                whole += weight;
            }
            // The warp's own slope is nearly one.
            self.nodes[n].at += sum / whole;
        }
    }
}

/// The nearest known depth's ray and a median of depth around a pixel; `None` where most is unknown.
fn depth_near(eye: &Eye, depth: &[f32], x: usize, y: usize) -> Option<(f32, [f32; 3])> {
    let (width, height) = eye.size();
    let (x, y) = (x.min(width - 1), y.min(height - 1));
    let mut known = [0.0f32; 9];
    let mut count = 0;
    for dy in 0..3 {
        for dx in 0..3 {
            let (x, y) =
                ((x + 2 * dx).saturating_sub(2).min(width - 1), (y + 2 * dy).saturating_sub(2).min(height - 1));
            let z = depth[y * width + x];
            if z > 0.0 {
                known[count] = z;
                count += 1;
            }
        }
    }
    let ray = eye.rays[y * width + x];
    (count >= 5 && ray[0].is_finite()).then(|| {
        known[..count].sort_unstable_by(f32::total_cmp);
        (known[count / 2], ray)
    })
}

/// Cubic convolution, so that W is nearly as sharp as I is; beyond the rim what is at the rim.
fn cubic(plane: &Plane, x: f32, y: f32) -> f32 {
    let (w, h) = (plane.width, plane.height);
    let x = x.clamp(1.0, w as f32 - 3.001);
    let y = y.clamp(1.0, h as f32 - 3.001);
    let (column, row) = (x as usize, y as usize);
    let (wx, wy) = (weights(x - column as f32), weights(y - row as f32));
    let mut sum = 0.0;
    for (k, wy) in wy.iter().enumerate() {
        let i = (row + k - 1) * w + column - 1;
        let v = &plane.values[i..i + 4];
        sum += wy * (wx[0] * v[0] + wx[1] * v[1] + wx[2] * v[2] + wx[3] * v[3]);
    }
    sum
}

/// How what stands at `x` as its row is read moves in the picture, px/s.
pub fn flow(eye: &Eye, x: DVec3, state: &State) -> Option<DVec2> {
    const HALF_S: f64 = 1e-3;
    let at = |by_s: f64| eye.geometry.project(moved(x, &state.twist, -by_s));
    let flow = (at(HALF_S)? - at(-HALF_S)?) / (2.0 * HALF_S);
    (flow.is_finite() && flow.length() < FASTEST).then_some(flow)
}
