//! Large triangles cut fine: distortion bends straight edges, and each vertex solves for its own row's time, so the
//! picture must be straight between vertices to a fraction of a pixel. Triangles that pass the camera are cut at the
//! near plane, where projection ends.

use glam::{DAffine3, DVec2, DVec3};

use super::unwrap::{Corner, Unwrapped};
use super::view::{NEAR_M, ViewKeys};
use crate::camera::{Geometry, LensModel};
use crate::scene::Vertex;

/// How far the true image of an edge may lie from the drawn one, px.
const TOLERANCE_PX: f64 = 0.05;
/// Longer edges are always cut, px: an edge through the centre can bend to both sides while its middle is right.
const LONGEST_PX: f64 = 96.0;
/// Where triangles that pass the camera are cut, metres before it at the middle moment: at others a point may be nearer.
pub const CUT_M: f64 = 2.0 * NEAR_M;
/// Each cut halves an edge, and no picture is wider than 2^12.
const DEEPEST: u32 = 12;

/// How much edges bend under a camera, to decide quickly that nothing needs cutting.
#[derive(Clone, Copy, Debug)]
pub struct Bend {
    /// Edges shorter than this are straight enough anywhere in the picture, px.
    safe_px: f64,
}

impl Bend {
    /// Measures the distortion's second derivative over the picture: an edge of length L
    /// leaves its chord by at most curvature · L² / 8.
    pub fn of(geometry: &Geometry, readout_time_s: f64) -> Self {
        if geometry.distortion.is_identity() && readout_time_s == 0.0 {
            return Self { safe_px: f64::INFINITY };
        }
        let by_curvature = if geometry.distortion.model == LensModel::OpencvFisheye {
            Self::of_fisheye(geometry)
        } else {
            Self::of_opencv(geometry)
        };
        Self { safe_px: if readout_time_s > 0.0 { by_curvature.min(LONGEST_PX) } else { by_curvature } }
    }

    /// Radial, since that is where all the bending is: how far the middle of an edge of 8 px lies from its chord's.
    fn of_fisheye(geometry: &Geometry) -> f64 {
        let (mut largest, mut steepest) = (0.0f64, 1.0f64);
        // Up to 89.5° off the axis. An edge that ends beyond was tested up to there.
        for n in 0..200 {
            let theta = f64::from(n) / 200.0 * 89.5f64.to_radians();
            steepest = steepest.max(geometry.distortion.slope(theta.min(geometry.valid_radius())));
            let at = geometry.distorted_px(DVec2::new(theta.tan(), 0.0));
            for side in [DVec2::new(4.0, 0.0), DVec2::new(0.0, 4.0)] {
                let ends = [at + side, at - side].map(|px| geometry.unproject(px));
                let [Some(a), Some(b)] = ends else { continue };
                let middle = geometry.distorted_px(0.5 * (a + b).truncate());
                largest = largest.max(middle.distance(at) / 8.0);
            }
        }
        // 8 px leave the chord by `largest` · 8, so L px leave it by `largest` / 8 · L². An edge judged by its
        // undistorted length may get longer by the slope.
        (8.0 * TOLERANCE_PX / largest.max(1e-9)).sqrt() / steepest
    }

    fn of_opencv(geometry: &Geometry) -> f64 {
        let i = &geometry.intrinsics;
        let h = 4.0 / i.fx_px;
        let mut largest = 0.0f64;
        for gy in 0..=12 {
            for gx in 0..=16 {
                let p = DVec2::new(
                    (f64::from(gx) / 16.0 * f64::from(i.width_px) - i.cx_px) / i.fx_px,
                    (f64::from(gy) / 12.0 * f64::from(i.height_px) - i.cy_px) / i.fy_px,
                );
                let at = |d: DVec2| geometry.distorted_px(p + d);
                for d in [DVec2::new(h, 0.0), DVec2::new(0.0, h), DVec2::new(h, h) / 2f64.sqrt()] {
                    largest = largest.max((at(d) + at(-d) - 2.0 * at(DVec2::ZERO)).length() / 16.0);
                }
            }
        }
        (8.0 * TOLERANCE_PX / largest.max(1e-9)).sqrt()
    }
}

/// The longest edge of a mesh, in its own units.
pub fn longest_edge(mesh: &Unwrapped) -> f64 {
    let at = |i: u32| DVec3::from(mesh.corners[i as usize].vertex.position.map(f64::from));
    mesh.indices
        .chunks_exact(3)
        .flat_map(|t| [at(t[0]).distance(at(t[1])), at(t[1]).distance(at(t[2])), at(t[2]).distance(at(t[0]))])
        .fold(0.0, f64::max)
}

/// A mesh cut fine for one view; `None` if it can be drawn as it is.
pub fn dice(
    mesh: &Unwrapped,
    longest: f64,
    corners_in_world: &[DVec3; 8],
    world_from_mesh: &DAffine3,
    geometry: &Geometry,
    keys: &ViewKeys,
    bend: Bend,
) -> Option<(Vec<Corner>, Vec<u32>)> {
    let pose = keys.middle();
    let nearest = keys
        .poses
        .iter()
        .flat_map(|pose| corners_in_world.iter().map(|&c| pose.transform_point(c).z))
        .fold(f64::INFINITY, f64::min);
    let crosses = nearest < CUT_M;
    let scale = world_from_mesh.matrix3;
    let stretch = scale.x_axis.length().max(scale.y_axis.length()).max(scale.z_axis.length());
    if !crosses && longest * stretch * geometry.intrinsics.fx_px / nearest <= bend.safe_px {
        return None;
    }
    let camera_from_mesh = |c: &Corner| {
        pose.transform_point(world_from_mesh.transform_point3(DVec3::from(c.vertex.position.map(f64::from))))
    };
    let mut dicer = Dicer { geometry, safe_px: bend.safe_px, corners: Vec::new() };
    for t in mesh.indices.chunks_exact(3) {
        let corners: Vec<_> = t
            .iter()
            .map(|&i| {
                let corner = mesh.corners[i as usize];
                (corner, camera_from_mesh(&corner))
            })
            .collect();
        let clipped = clip(&corners, CUT_M);
        for i in 1..clipped.len().saturating_sub(1) {
            dicer.cut([clipped[0], clipped[i], clipped[i + 1]], 0);
        }
    }
    let indices = (0..dicer.corners.len() as u32).collect();
    Some((dicer.corners, indices))
}

/// With its place in the camera's axes.
type Placed = (Corner, DVec3);

fn blend(a: &Placed, b: &Placed, f: f64) -> Placed {
    let g = f as f32;
    let mix = |x: f32, y: f32| x + (y - x) * g;
    let (v, w) = (&a.0.vertex, &b.0.vertex);
    let vertex = Vertex {
        position: std::array::from_fn(|i| mix(v.position[i], w.position[i])),
        normal: std::array::from_fn(|i| mix(v.normal[i], w.normal[i])),
        tangent: std::array::from_fn(|i| if i < 3 { mix(v.tangent[i], w.tangent[i]) } else { v.tangent[3] }),
        uv0: std::array::from_fn(|i| mix(v.uv0[i], w.uv0[i])),
        uv1: std::array::from_fn(|i| mix(v.uv1[i], w.uv1[i])),
        color: std::array::from_fn(|i| mix(v.color[i], w.color[i])),
    };
    let at = std::array::from_fn(|i| mix(a.0.at[i], b.0.at[i]));
    (Corner { vertex, at }, a.1.lerp(b.1, f))
}

/// The part of a triangle beyond the near plane: none, three or four corners.
fn clip(corners: &[Placed], near: f64) -> Vec<Placed> {
    let mut out = Vec::with_capacity(4);
    for (i, a) in corners.iter().enumerate() {
        let b = &corners[(i + 1) % corners.len()];
        if a.1.z >= near {
            out.push(*a);
        }
        if (a.1.z >= near) != (b.1.z >= near) {
            out.push(blend(a, b, (near - a.1.z) / (b.1.z - a.1.z)));
        }
    }
    out
}

struct Dicer<'a> {
    geometry: &'a Geometry,
    safe_px: f64,
    corners: Vec<Corner>,
}

impl Dicer<'_> {
    /// Whether an edge bends too much. Depends only on its two ends, not on their order, so that both triangles at an
    /// edge cut it alike and no crack opens.
    fn bends(&self, a: &Placed, b: &Placed) -> bool {
        let undistorted = |p: DVec3| p.truncate() / p.z;
        let (p, q) = (undistorted(a.1), undistorted(b.1));
        let (at_p, at_q) = (self.geometry.distorted_px(p), self.geometry.distorted_px(q));
        let length = at_p.distance(at_q);
        if length <= self.safe_px {
            return false;
        }
        // Anything far outside the picture is not seen.
        let i = &self.geometry.intrinsics;
        let size = DVec2::new(f64::from(i.width_px), f64::from(i.height_px));
        let (low, high) = (at_p.min(at_q), at_p.max(at_q));
        if low.x > size.x + 256.0 || low.y > size.y + 256.0 || high.x < -256.0 || high.y < -256.0 {
            return false;
        }
        if length > LONGEST_PX {
            return true;
        }
        [0.25, 0.5, 0.75].iter().any(|&f| {
            let truth = self.geometry.distorted_px(p + (q - p) * f);
            truth.distance(at_p + (at_q - at_p) * f) > TOLERANCE_PX
        })
    }

    fn cut(&mut self, t: [Placed; 3], depth: u32) {
        let bends = if depth < DEEPEST {
            [self.bends(&t[0], &t[1]), self.bends(&t[1], &t[2]), self.bends(&t[2], &t[0])]
        } else {
            [false; 3]
        };
        let middle = |i: usize| {
            let (a, b) = (&t[i], &t[(i + 1) % 3]);
            // The same order from both sides of the edge gives the same bits.
            if a.0.vertex.position < b.0.vertex.position { blend(a, b, 0.5) } else { blend(b, a, 0.5) }
        };
        match bends.iter().filter(|&&b| b).count() {
            0 => self.corners.extend(t.map(|c| c.0)),
            3 => {
                let m = [middle(0), middle(1), middle(2)];
                self.cut([t[0], m[0], m[2]], depth + 1);
                self.cut([m[0], t[1], m[1]], depth + 1);
                self.cut([m[2], m[1], t[2]], depth + 1);
                self.cut(m, depth + 1);
            }
            _ => {
                // One edge at a time; the pieces test the others again.
                let i = bends.iter().position(|&b| b).unwrap_or(0);
                let (a, b, c) = (t[i], t[(i + 1) % 3], t[(i + 2) % 3]);
                let m = middle(i);
                self.cut([a, m, c], depth + 1);
                self.cut([m, b, c], depth + 1);
            }
        }
    }
}
