//! Triangles that rays are asked of: a tree of boxes (Rubin and Whitted 1980), each box with all that is in it in a row, so that a
//! ray that misses a box skips what follows. Halves have as many triangles each, split by their middles along the longest side.

use glam::Vec3;

/// Triangles of a box that is not split.
const LEAF: usize = 4;

/// A box, and what follows it in the row.
#[derive(Clone, Copy, Debug)]
struct Node {
    low: Vec3,
    high: Vec3,
    /// The next box that is not within this one.
    skip: u32,
    /// Triangles of an undivided box: the first, and how many.
    first: u32,
    count: u32,
}

/// A corner and two edges, and whose it is.
#[derive(Clone, Copy, Debug)]
struct Triangle {
    corner: Vec3,
    edges: [Vec3; 2],
    number: u32,
}

#[derive(Clone, Debug, Default)]
pub struct Bvh {
    nodes: Vec<Node>,
    triangles: Vec<Triangle>,
}

/// Where a ray meets a triangle first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Lengths of the ray's direction.
    pub along: f32,
    pub triangle: u32,
}

impl Bvh {
    pub fn new(corners: &[Vec3], triangles: &[[u32; 3]]) -> Self {
        let triangle = |(number, t): (u32, &[u32; 3])| {
            let [a, b, c] = t.map(|i| corners[i as usize]);
            Triangle { corner: a, edges: [b - a, c - a], number }
        };
        let mut bvh = Self { nodes: Vec::new(), triangles: (0..).zip(triangles).map(triangle).collect() };
        if !bvh.triangles.is_empty() {
            bvh.split(0, bvh.triangles.len());
        }
        bvh
    }

    fn split(&mut self, first: usize, count: usize) {
        let own = &mut self.triangles[first..first + count];
        let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        let middle = |t: &Triangle| t.corner + (t.edges[0] + t.edges[1]) / 3.0;
        let (mut from, mut to) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        for t in own.iter() {
            for corner in [t.corner, t.corner + t.edges[0], t.corner + t.edges[1]] {
                (low, high) = (low.min(corner), high.max(corner));
            }
            (from, to) = (from.min(middle(t)), to.max(middle(t)));
        }
        let node = self.nodes.len();
        self.nodes.push(Node { low, high, skip: 0, first: first as u32, count: count as u32 });
        if count > LEAF {
            let axis = (to - from).max_position();
            let half = count / 2;
            own.select_nth_unstable_by(half, |a, b| {
                middle(a)[axis].total_cmp(&middle(b)[axis]).then(a.number.cmp(&b.number))
            });
            self.nodes[node].count = 0;
            self.split(first, half);
            self.split(first + half, count - half);
        }
        self.nodes[node].skip = self.nodes.len() as u32;
    }

    /// The first triangle that a ray meets between two lengths of it.
    pub fn first(&self, from: Vec3, towards: Vec3, between: std::ops::Range<f32>) -> Option<Hit> {
        self.meet(from, towards, between, false)
    }

    /// Whether a ray meets any between two lengths of it.
    pub fn any(&self, from: Vec3, towards: Vec3, between: std::ops::Range<f32>) -> bool {
        self.meet(from, towards, between, true).is_some()
    }

    fn meet(&self, from: Vec3, towards: Vec3, between: std::ops::Range<f32>, is_enough: bool) -> Option<Hit> {
        // What runs along a side is moved by nothing that one sees, so that no 0 is divided by 0.
        let towards = Vec3::select(towards.abs().cmplt(Vec3::splat(1e-9)), Vec3::splat(1e-9), towards);
        let per = towards.recip();
        let mut found: Option<Hit> = None;
        let mut farthest = between.end;
        let mut at = 0;
        while let Some(node) = self.nodes.get(at) {
            let (a, b) = ((node.low - from) * per, (node.high - from) * per);
            let enters = a.min(b).max_element().max(between.start);
            let leaves = a.max(b).min_element().min(farthest);
            if enters > leaves {
                at = node.skip as usize;
                continue;
            }
            at += 1;
            for triangle in &self.triangles[node.first as usize..(node.first + node.count) as usize] {
                let Some(along) = triangle.meet(from, towards).filter(|t| *t > between.start && *t < farthest) else {
                    continue;
                };
                (farthest, found) = (along, Some(Hit { along, triangle: triangle.number }));
                if is_enough {
                    return found;
                }
            }
        }
        found
    }
}

impl Triangle {
    /// Möller and Trumbore 1997, from both sides.
    fn meet(&self, from: Vec3, towards: Vec3) -> Option<f32> {
        let [b, c] = self.edges;
        let across = towards.cross(c);
        let determinant = b.dot(across);
        let per = 1.0 / determinant;
        let to = from - self.corner;
        let u = to.dot(across) * per;
        let beside = to.cross(b);
        let v = towards.dot(beside) * per;
        (determinant != 0.0 && u >= 0.0 && v >= 0.0 && u + v <= 1.0).then(|| c.dot(beside) * per)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ray_meets_what_a_search_through_all_triangles_finds() {
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
        for n in 0..2000 {
            let from = Vec3::new(random(), random(), random()) * 1.4 - 0.2;
            let mut towards = Vec3::new(random(), random(), random()) - 0.5;
            if n % 4 == 0 {
                // Along an axis.
                towards = Vec3::ZERO.with_x(1.0);
            }
            let all = bvh.triangles.iter().filter_map(|t| Some((t.meet(from, towards)?, t.number)));
            let nearest = all.filter(|(t, _)| *t > 1e-4).min_by(|a, b| a.0.total_cmp(&b.0));
            let found = bvh.first(from, towards, 1e-4..f32::INFINITY);
            assert_eq!(found.map(|hit| hit.triangle), nearest.map(|(_, number)| number), "{n}");
            assert_eq!(bvh.any(from, towards, 1e-4..f32::INFINITY), found.is_some());
            if let Some(hit) = found {
                met += 1;
                assert!(!bvh.any(from, towards, 1e-4..0.999 * hit.along));
            }
        }
        assert!((500..1900).contains(&met), "{met}");
        assert_eq!(Bvh::new(&[], &[]).first(Vec3::ZERO, Vec3::X, 0.0..1.0), None);
    }
}
