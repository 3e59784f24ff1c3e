//! Nearest ray-triangle intersection by a bounding volume hierarchy with median splits along the
//! longest axis.

use glam::{DVec2, DVec3};

/// Maximum number of triangles of a leaf.
const MAX_LEAF_TRIANGLES: usize = 4;

/// A corner, and the sides from there to the second and the third corner, m.
#[derive(Clone, Copy, Debug)]
pub struct Triangle {
    pub corner: DVec3,
    pub sides: [DVec3; 2],
}

/// Intersection of a ray with a triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TriangleHit {
    /// Distance in lengths of the ray's direction.
    pub t: f64,
    /// Index of the triangle in the input.
    pub face: usize,
    /// Barycentric coordinates of the second and the third corner.
    pub barycentric: DVec2,
}

#[derive(Clone, Debug)]
struct FacesNode {
    low: DVec3,
    high: DVec3,
    /// Range in `order`; empty for an inner node.
    faces: std::ops::Range<usize>,
    /// Index of the second child; the first one follows its parent. 0 for a leaf.
    second: usize,
}

/// Triangles with their hierarchy.
#[derive(Clone, Debug)]
pub struct Triangles {
    all: Vec<Triangle>,
    order: Vec<usize>,
    nodes: Vec<FacesNode>,
}

impl Triangles {
    pub fn new(all: Vec<Triangle>) -> Self {
        let order = (0..all.len()).collect();
        let mut bvh = Self { all, order, nodes: Vec::new() };
        bvh.build(0..bvh.all.len());
        bvh
    }

    fn build(&mut self, range: std::ops::Range<usize>) {
        let bounds = |points: &mut dyn Iterator<Item = DVec3>| {
            points.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), p| (low.min(p), high.max(p)))
        };
        let faces = &self.order[range.clone()];
        let (low, high) = bounds(&mut faces.iter().flat_map(|face| self.all[*face].corners()));
        let centre = |face: &usize| self.all[*face].corners().iter().sum::<DVec3>() / 3.0;
        let (first, last) = bounds(&mut faces.iter().map(centre));
        let here = self.nodes.len();
        self.nodes.push(FacesNode { low, high, faces: range.clone(), second: 0 });
        let size = last - first;
        if range.len() <= MAX_LEAF_TRIANGLES || size.max_element() <= 0.0 {
            return;
        }
        let axis = (0..3).max_by(|a, b| size[*a].total_cmp(&size[*b])).unwrap_or(0);
        let all = &self.all;
        let at = |face: &usize| all[*face].corners().iter().map(|p| p[axis]).sum::<f64>();
        self.order[range.clone()].sort_by(|a, b| at(a).total_cmp(&at(b)).then(a.cmp(b)));
        let half = range.start + range.len() / 2;
        self.build(range.start..half);
        self.nodes[here].second = self.nodes.len();
        self.nodes[here].faces = 0..0;
        self.build(half..range.end);
    }

    /// Unit normal of a triangle, towards the side where its corners run counter-clockwise.
    pub fn normal(&self, face: usize) -> DVec3 {
        let [u, v] = self.all[face].sides;
        u.cross(v).normalize_or(DVec3::Z)
    }

    /// The nearest intersection closer than `max_t`.
    pub fn hit(&self, origin: DVec3, direction: DVec3, max_t: f64) -> Option<TriangleHit> {
        let inverse = direction.recip();
        let mut nearest: Option<TriangleHit> = None;
        let mut far = max_t;
        let (mut stack, mut count) = ([0usize; 64], 1);
        if self.all.is_empty() {
            return None;
        }
        while count > 0 {
            count -= 1;
            let here = stack[count];
            let node = &self.nodes[here];
            let (a, b) = ((node.low - origin) * inverse, (node.high - origin) * inverse);
            let (enters, leaves) = (a.min(b).max_element().max(0.0), a.max(b).min_element().min(far));
            // A direction parallel to a side of the box may give 0 · ∞ = NaN; the node is then
            // traversed.
            if enters > leaves {
                continue;
            }
            if node.second > 0 {
                stack[count] = node.second;
                stack[count + 1] = here + 1;
                count += 2;
                continue;
            }
            for face in &self.order[node.faces.clone()] {
                if let Some((t, barycentric)) = self.all[*face].hit(origin, direction)
                    && t < far
                {
                    far = t;
                    nearest = Some(TriangleHit { t, face: *face, barycentric });
                }
            }
        }
        nearest
    }
}

impl Triangle {
    fn corners(&self) -> [DVec3; 3] {
        [self.corner, self.corner + self.sides[0], self.corner + self.sides[1]]
    }

    /// Möller and Trumbore (1997).
    fn hit(&self, origin: DVec3, direction: DVec3) -> Option<(f64, DVec2)> {
        let [u, v] = self.sides;
        let p = direction.cross(v);
        let determinant = u.dot(p);
        let from = origin - self.corner;
        let q = from.cross(u);
        let barycentric = DVec2::new(from.dot(p), direction.dot(q)) / determinant;
        let t = v.dot(q) / determinant;
        (t > 0.0 && barycentric.min_element() >= 0.0 && barycentric.element_sum() <= 1.0).then_some((t, barycentric))
    }
}

#[cfg(test)]
mod tests {
    use super::super::random::Random;
    use super::*;

    #[test]
    fn bvh_finds_the_same_hits_as_brute_force() {
        let mut random = Random::new([5, 0, 0, 0]);
        let mut place = |size: f64| DVec3::from([0, 1, 2].map(|_| size * (random.uniform() - 0.5)));
        let all: Vec<Triangle> =
            (0..200).map(|_| Triangle { corner: place(2.0), sides: [place(0.5), place(0.5)] }).collect();
        let tree = Triangles::new(all.clone());
        let mut hit_count = 0;
        for _ in 0..500 {
            let origin = place(4.0);
            let direction = place(2.0) - origin;
            let brute_force =
                all.iter().enumerate().filter_map(|(face, one)| Some((one.hit(origin, direction)?, face)));
            let first = brute_force
                .min_by(|a, b| a.0.0.total_cmp(&b.0.0))
                .map(|((t, barycentric), face)| TriangleHit { t, face, barycentric });
            assert_eq!(tree.hit(origin, direction, f64::INFINITY), first);
            if let Some(hit) = first {
                hit_count += 1;
                assert_eq!(tree.hit(origin, direction, 0.99 * hit.t), None);
            }
        }
        assert!(hit_count > 100, "{hit_count}");
    }

    #[test]
    fn axis_aligned_ray_hits_a_square_of_two_triangles() {
        let corner = DVec3::new(-1.0, -1.0, 2.0);
        let half = |sides| Triangle { corner, sides };
        let square = Triangles::new(vec![
            half([2.0 * DVec3::X, DVec3::new(2.0, 2.0, 0.0)]),
            half([DVec3::new(2.0, 2.0, 0.0), 2.0 * DVec3::Y]),
        ]);
        let hit = square.hit(DVec3::new(0.5, -0.5, 0.0), DVec3::Z, f64::INFINITY).unwrap();
        assert_eq!((hit.t, hit.face, hit.barycentric), (2.0, 0, DVec2::new(0.5, 0.25)));
        assert_eq!(square.hit(DVec3::new(1.5, 0.0, 0.0), DVec3::Z, f64::INFINITY), None);
        assert_eq!(square.normal(0), DVec3::Z);
        assert_eq!(Triangles::new(Vec::new()).hit(DVec3::ZERO, DVec3::Z, 1.0), None);
    }
}
