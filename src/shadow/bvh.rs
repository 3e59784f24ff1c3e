//! Bounding volume hierarchy for ray casting (Rubin and Whitted 1980).
//!
//! Nodes are stored in depth-first order with skip links, so that a ray that misses a box skips its
//! contents. A box is split across its longest side where the sum of area · triangles of both parts
//! is smallest (the surface area heuristic of Goldsmith and Salmon 1987).
//!
//! Bundles of eight rays from one point traverse the tree together, so that each box is tested once
//! for rays in similar directions. Tests run on as many vector lanes as the processor has; the
//! results do not depend on their number.

use fearless_simd::{Level, dispatch};
use glam::Vec3;

/// Maximum number of triangles in a leaf.
const LEAF: usize = 4;
/// Number of rays in a bundle.
pub const RAYS: usize = 8;

/// A box with its skip link.
#[derive(Clone, Copy, Debug)]
struct BvhNode {
    low: Vec3,
    high: Vec3,
    /// The next node that is not within this box.
    skip: u32,
    /// Triangles of a leaf: the first, and their number.
    first: u32,
    count: u32,
}

/// A vertex, two edges and the index in the input.
#[derive(Clone, Copy, Debug)]
struct BvhTriangle {
    corner: Vec3,
    edges: [Vec3; 2],
    number: u32,
}

/// Triangles and the boxes around them, the root first.
#[derive(Clone, Debug)]
pub struct Bvh {
    /// Vector instructions of this processor.
    level: Level,
    nodes: Vec<BvhNode>,
    triangles: Vec<BvhTriangle>,
}

/// Directions of rays from one point.
#[derive(Clone, Copy, Debug)]
pub struct RayPacket {
    /// Directions by axis, and their inverses.
    towards: [[f32; RAYS]; 3],
    per: [[f32; RAYS]; 3],
    /// Number of rays.
    count: usize,
}

/// The first intersection of a ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Distance in lengths of the ray's direction.
    pub along: f32,
    pub triangle: u32,
}

impl RayPacket {
    /// A packet of up to [`RAYS`] directions.
    pub fn new(rays: impl Iterator<Item = Vec3>) -> Self {
        let (mut towards, mut count) = ([[1.0; RAYS]; 3], 0);
        for (n, ray) in rays.take(RAYS).enumerate() {
            // Rays parallel to a side are tilted imperceptibly, to avoid 0/0.
            let ray = Vec3::select(ray.abs().cmplt(Vec3::splat(1e-9)), Vec3::splat(1e-9), ray);
            (0..3).for_each(|axis| towards[axis][n] = ray[axis]);
            count = n + 1;
        }
        Self { towards, per: towards.map(|along| along.map(f32::recip)), count }
    }

    /// Dot product of each direction with a vector.
    pub fn dot(&self, with: Vec3) -> [f32; RAYS] {
        let [x, y, z] = &self.towards;
        std::array::from_fn(|n| x[n] * with.x + y[n] * with.y + z[n] * with.z)
    }

    /// Length of each ray: `farthest`, in lengths of its direction, for rays towards the front of a
    /// plane, otherwise 0. `normal` points to the front.
    pub fn front_facing_lengths(&self, normal: Vec3, farthest: f32) -> [f32; RAYS] {
        let cosines = self.dot(normal);
        let goes = |n: usize| n < self.count && cosines[n] > 0.0;
        std::array::from_fn(|n| if goes(n) { farthest } else { 0.0 })
    }
}

impl Bvh {
    pub fn new(corners: &[Vec3], triangles: &[[u32; 3]]) -> Self {
        let triangle = |(number, t): (u32, &[u32; 3])| {
            let [a, b, c] = t.map(|i| corners[i as usize]);
            BvhTriangle { corner: a, edges: [b - a, c - a], number }
        };
        let triangles = (0..).zip(triangles).map(triangle).collect();
        let mut bvh = Self { level: Level::new(), nodes: Vec::new(), triangles };
        if !bvh.triangles.is_empty() {
            bvh.split(0, bvh.triangles.len());
        }
        bvh
    }

    fn split(&mut self, first: usize, count: usize) {
        let own = &mut self.triangles[first..first + count];
        let whole = Aabb::of(own);
        let node = self.nodes.len();
        self.nodes.push(BvhNode {
            low: whole.low,
            high: whole.high,
            skip: 0,
            first: first as u32,
            count: if count > LEAF { 0 } else { count as u32 },
        });
        if count > LEAF {
            let middles = own.iter().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), t| {
                (low.min(t.middle()), high.max(t.middle()))
            });
            let axis = (middles.1 - middles.0).max_position();
            own.sort_unstable_by(|a, b| a.middle()[axis].total_cmp(&b.middle()[axis]).then(a.number.cmp(&b.number)));
            let half = best_split(own);
            self.split(first, half);
            self.split(first + half, count - half);
        }
        self.nodes[node].skip = self.nodes.len() as u32;
    }

    /// The first intersection of each ray up to its length, in lengths of its direction. Rays of
    /// length 0 are skipped.
    pub fn first(&self, from: Vec3, rays: &RayPacket, farthest: [f32; RAYS]) -> [Option<Hit>; RAYS] {
        let mut hits = [None; RAYS];
        dispatch!(self.level, _ => self.intersect(from, rays, farthest, |n, hit| {
            hits[n] = Some(hit);
            hit.along
        }));
        hits
    }

    /// True for each ray that intersects any triangle.
    pub fn any(&self, from: Vec3, rays: &RayPacket, farthest: [f32; RAYS]) -> [bool; RAYS] {
        let mut is_hit = [false; RAYS];
        dispatch!(self.level, _ => self.intersect(from, rays, farthest, |n, _| {
            is_hit[n] = true;
            0.0
        }));
        is_hit
    }

    /// Calls `met` for each intersection that is nearer than those before. It returns the remaining
    /// length of the ray. Inlined, so that it is compiled for the vector instructions of its
    /// caller.
    #[inline(always)]
    fn intersect(
        &self,
        from: Vec3,
        RayPacket { towards, per, .. }: &RayPacket,
        mut farthest: [f32; RAYS],
        mut met: impl FnMut(usize, Hit) -> f32,
    ) {
        let mut at = 0;
        while let Some(node) = self.nodes.get(at) {
            let (low, high) = ((node.low - from).to_array(), (node.high - from).to_array());
            let (mut enters, mut leaves) = ([0.0; RAYS], farthest);
            for axis in 0..3 {
                for n in 0..RAYS {
                    let (a, b) = (low[axis] * per[axis][n], high[axis] * per[axis][n]);
                    enters[n] = larger(enters[n], smaller(a, b));
                    leaves[n] = smaller(leaves[n], larger(a, b));
                }
            }
            // A ray of length 0 enters no box.
            let meets = (0..RAYS).fold(false, |any, n| any | (enters[n] <= leaves[n] && leaves[n] > 0.0));
            if !meets {
                at = node.skip as usize;
                continue;
            }
            at += 1;
            for triangle in &self.triangles[node.first as usize..(node.first + node.count) as usize] {
                let along = triangle.intersect(from, towards);
                let is_met = |n: usize| (along[n] > 0.0) & (along[n] < farthest[n]);
                if !(0..RAYS).fold(false, |any, n| any | is_met(n)) {
                    continue;
                }
                for n in 0..RAYS {
                    if along[n] > 0.0 && along[n] < farthest[n] {
                        farthest[n] = met(n, Hit { along: along[n], triangle: triangle.number });
                    }
                }
            }
            if farthest.iter().all(|far| *far <= 0.0) {
                return;
            }
        }
    }
}

#[inline(always)]
fn smaller(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

#[inline(always)]
fn larger(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// Number of sorted triangles in the first part, by the surface area heuristic.
fn best_split(sorted: &[BvhTriangle]) -> usize {
    let mut behind: Vec<f32> = Vec::with_capacity(sorted.len());
    let mut rest = Aabb::of(&[]);
    for triangle in sorted.iter().rev() {
        rest.add(triangle);
        behind.push(rest.area());
    }
    let mut before = Aabb::of(&[]);
    let mut best = (f32::INFINITY, sorted.len() / 2);
    for (n, triangle) in sorted.iter().enumerate().take(sorted.len() - 1) {
        before.add(triangle);
        let others = sorted.len() - n - 1;
        let cost = before.area() * (n + 1) as f32 + behind[others - 1] * others as f32;
        if cost < best.0 {
            best = (cost, n + 1);
        }
    }
    best.1
}

struct Aabb {
    low: Vec3,
    high: Vec3,
}

impl Aabb {
    fn of(triangles: &[BvhTriangle]) -> Self {
        let mut all = Self { low: Vec3::INFINITY, high: Vec3::NEG_INFINITY };
        triangles.iter().for_each(|triangle| all.add(triangle));
        all
    }

    fn add(&mut self, triangle: &BvhTriangle) {
        for corner in [Vec3::ZERO, triangle.edges[0], triangle.edges[1]].map(|edge| triangle.corner + edge) {
            (self.low, self.high) = (self.low.min(corner), self.high.max(corner));
        }
    }

    /// Half of the surface area.
    fn area(&self) -> f32 {
        let side = self.high - self.low;
        side.x * side.y + side.y * side.z + side.z * side.x
    }
}

impl BvhTriangle {
    fn middle(&self) -> Vec3 {
        self.corner + (self.edges[0] + self.edges[1]) / 3.0
    }

    /// Distance of the intersection along each ray, on either side (Möller and Trumbore 1997);
    /// negative without one.
    #[inline(always)]
    fn intersect(&self, from: Vec3, towards: &[[f32; RAYS]; 3]) -> [f32; RAYS] {
        let ([b, c], to) = (self.edges, from - self.corner);
        let beside = to.cross(b);
        let ahead = c.dot(beside);
        let mut along = [-1.0; RAYS];
        // Without branches, for vector instructions.
        for n in 0..RAYS {
            let (x, y, z) = (towards[0][n], towards[1][n], towards[2][n]);
            let across = [y * c.z - z * c.y, z * c.x - x * c.z, x * c.y - y * c.x];
            let per = 1.0 / (b.x * across[0] + b.y * across[1] + b.z * across[2]);
            let u = (to.x * across[0] + to.y * across[1] + to.z * across[2]) * per;
            let v = (x * beside.x + y * beside.y + z * beside.z) * per;
            // For rays in the plane u is NaN or infinite, which is no intersection.
            let is_met = (u >= 0.0) & (v >= 0.0) & (u + v <= 1.0);
            along[n] = if is_met { ahead * per } else { -1.0 };
        }
        along
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ray_hits_match_brute_force() {
        let mut state = 7u32;
        let mut random = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / (1 << 24) as f32
        };
        let mut corners = Vec::new();
        for _ in 0..300 {
            let middle = Vec3::new(random(), random(), random());
            corners.extend((0..3).map(|_| middle + 0.4 * Vec3::new(random(), random(), random())));
        }
        let triangles: Vec<[u32; 3]> = (0..300).map(|n| [3 * n, 3 * n + 1, 3 * n + 2]).collect();
        let bvh = Bvh::new(&corners, &triangles);
        let mut met = 0;
        for n in 0..300 {
            let from = Vec3::new(random(), random(), random()) * 1.4 - 0.2;
            // Some along an axis, and one of length 0.
            let mut rays = [Vec3::X; RAYS];
            rays[1..].fill_with(|| Vec3::new(random(), random(), random()) - 0.5);
            let mut farthest = [f32::INFINITY; RAYS];
            farthest[n % RAYS] = 0.0;
            let bundle = RayPacket::new(rays.into_iter());
            let alone = |n: usize| RayPacket::new(std::iter::once(rays[n]));
            let (first, any) = (bvh.first(from, &bundle, farthest), bvh.any(from, &bundle, farthest));
            for (n, farthest) in farthest.iter().enumerate() {
                let all = bvh.triangles.iter().map(|t| (t.intersect(from, &alone(n).towards)[0], t.number));
                let met_all = all.filter(|(t, _)| *t > 0.0 && t < farthest);
                let nearest = met_all.min_by(|a, b| a.0.total_cmp(&b.0));
                assert_eq!(first[n].map(|hit| hit.triangle), nearest.map(|(_, number)| number), "{n}");
                assert_eq!(any[n], first[n].is_some());
                if let Some(hit) = first[n] {
                    met += 1;
                    assert!(!bvh.any(from, &alone(n), [0.999 * hit.along; RAYS])[0]);
                }
            }
        }
        assert!((500..2200).contains(&met), "{met}");
        let bundle = RayPacket::new(std::iter::once(Vec3::X));
        assert_eq!(Bvh::new(&[], &[]).first(Vec3::ZERO, &bundle, [1.0; RAYS]), [None; RAYS]);
    }
}
