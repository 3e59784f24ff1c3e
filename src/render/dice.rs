//! Subdivision of large triangles. Distortion bends straight edges, and each vertex solves for its
//! own row's time, so interpolation between vertices must be accurate to a fraction of a pixel.
//! Triangles that pass the camera are clipped at the near plane, where projection is undefined.

use glam::{DAffine3, DVec2, DVec3};

use super::unwrap::{LightmapVertex, UnwrappedMesh};
use super::view::{NEAR_M, ViewKeys};
use crate::camera::Geometry;
use crate::scene::Vertex;

/// Maximum deviation of a drawn edge from its true image, px.
const TOLERANCE_PX: f64 = 0.05;
/// Edges longer than this are always cut, px: an edge through the centre can bend to both sides
/// while its middle is exact.
const MAX_EDGE_PX: f64 = 96.0;
/// Clip plane of triangles that pass the camera, metres at the middle moment: at other moments a
/// point may be nearer.
pub const CLIP_DEPTH_M: f64 = 2.0 * NEAR_M;
/// Maximum recursion depth: each cut halves an edge, and no picture is wider than 2^12.
const MAX_CUT_DEPTH: u32 = 12;

/// Curvature of edges under a camera, for early acceptance of meshes that need no cutting.
#[derive(Clone, Copy, Debug)]
pub struct EdgeCurvature {
    /// Length up to which edges are straight enough anywhere in the picture, px.
    safe_px: f64,
}

impl EdgeCurvature {
    /// Measures the distortion's second derivative over the picture: an edge of length L deviates
    /// from its chord by at most curvature · L² / 8.
    pub fn of(geometry: &Geometry, readout_time_s: f64) -> Self {
        if geometry.distortion.is_identity() && readout_time_s == 0.0 {
            return Self { safe_px: f64::INFINITY };
        }
        let by_curvature =
            if geometry.distortion.model.is_fisheye() { Self::of_fisheye(geometry) } else { Self::of_opencv(geometry) };
        Self { safe_px: if readout_time_s > 0.0 { by_curvature.min(MAX_EDGE_PX) } else { by_curvature } }
    }

    /// Radial direction only, which is the most curved: deviation of the middle of an 8 px edge
    /// from its chord.
    fn of_fisheye(geometry: &Geometry) -> f64 {
        let (mut largest, mut steepest) = (0.0f64, 1.0f64);
        // Up to 89.5° off the axis. An edge that ends beyond is tested up to there.
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
        // 8 px deviate by `largest` · 8 from the chord, so L px by `largest` / 8 · L². An edge
        // judged by its undistorted length may be longer by the slope.
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
pub fn longest_edge(mesh: &UnwrappedMesh) -> f64 {
    let at = |i: u32| DVec3::from(mesh.corners[i as usize].vertex.position.map(f64::from));
    mesh.indices
        .chunks_exact(3)
        .flat_map(|t| [at(t[0]).distance(at(t[1])), at(t[1]).distance(at(t[2])), at(t[2]).distance(at(t[0]))])
        .fold(0.0, f64::max)
}

/// A mesh subdivided for one view; `None` if it can be drawn unchanged.
pub fn dice(
    mesh: &UnwrappedMesh,
    longest: f64,
    corners_in_world: &[DVec3; 8],
    world_from_mesh: &DAffine3,
    geometry: &Geometry,
    keys: &ViewKeys,
    bend: EdgeCurvature,
) -> Option<(Vec<LightmapVertex>, Vec<u32>)> {
    let pose = keys.middle();
    let nearest = keys
        .poses
        .iter()
        .flat_map(|pose| corners_in_world.iter().map(|&c| pose.transform_point(c).z))
        .fold(f64::INFINITY, f64::min);
    let crosses = nearest < CLIP_DEPTH_M;
    let scale = world_from_mesh.matrix3;
    let stretch = scale.x_axis.length().max(scale.y_axis.length()).max(scale.z_axis.length());
    if !crosses && longest * stretch * geometry.intrinsics.fx_px / nearest <= bend.safe_px {
        return None;
    }
    let camera_from_mesh = |c: &LightmapVertex| {
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
        let clipped = clip(&corners, CLIP_DEPTH_M);
        for i in 1..clipped.len().saturating_sub(1) {
            dicer.cut([clipped[0], clipped[i], clipped[i + 1]], 0);
        }
    }
    let indices = (0..dicer.corners.len() as u32).collect();
    Some((dicer.corners, indices))
}

/// A vertex with its position in the camera's axes.
type CameraVertex = (LightmapVertex, DVec3);

fn blend(a: &CameraVertex, b: &CameraVertex, f: f64) -> CameraVertex {
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
    (LightmapVertex { vertex, at }, a.1.lerp(b.1, f))
}

/// The part of a triangle beyond the near plane: none, three or four corners.
fn clip(corners: &[CameraVertex], near: f64) -> Vec<CameraVertex> {
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
    corners: Vec<LightmapVertex>,
}

impl Dicer<'_> {
    /// True if an edge deviates too much. Depends only on its two ends, not on their order, so that
    /// both adjacent triangles cut it alike and no crack opens.
    fn needs_cut(&self, a: &CameraVertex, b: &CameraVertex) -> bool {
        let undistorted = |p: DVec3| p.truncate() / p.z;
        let (p, q) = (undistorted(a.1), undistorted(b.1));
        let (at_p, at_q) = (self.geometry.distorted_px(p), self.geometry.distorted_px(q));
        let length = at_p.distance(at_q);
        if length <= self.safe_px {
            return false;
        }
        // Points far outside the picture are invisible.
        let i = &self.geometry.intrinsics;
        let size = DVec2::new(f64::from(i.width_px), f64::from(i.height_px));
        let (low, high) = (at_p.min(at_q), at_p.max(at_q));
        if low.x > size.x + 256.0 || low.y > size.y + 256.0 || high.x < -256.0 || high.y < -256.0 {
            return false;
        }
        if length > MAX_EDGE_PX {
            return true;
        }
        [0.25, 0.5, 0.75].iter().any(|&f| {
            let truth = self.geometry.distorted_px(p + (q - p) * f);
            truth.distance(at_p + (at_q - at_p) * f) > TOLERANCE_PX
        })
    }

    fn cut(&mut self, t: [CameraVertex; 3], depth: u32) {
        let needs_cut = if depth < MAX_CUT_DEPTH {
            [self.needs_cut(&t[0], &t[1]), self.needs_cut(&t[1], &t[2]), self.needs_cut(&t[2], &t[0])]
        } else {
            [false; 3]
        };
        let middle = |i: usize| {
            let (a, b) = (&t[i], &t[(i + 1) % 3]);
            // The same order for both triangles of the edge gives the same bits.
            if a.0.vertex.position < b.0.vertex.position { blend(a, b, 0.5) } else { blend(b, a, 0.5) }
        };
        match needs_cut.iter().filter(|&&b| b).count() {
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
                let i = needs_cut.iter().position(|&b| b).unwrap_or(0);
                let (a, b, c) = (t[i], t[(i + 1) % 3], t[(i + 2) % 3]);
                let m = middle(i);
                self.cut([a, m, c], depth + 1);
                self.cut([m, b, c], depth + 1);
            }
        }
    }
}
