//! Lightmap unwrapping: assigns each point of a mesh's surface its own position in a square.
//!
//! Connected triangles that face the same of a box's six sides are projected onto that side as one
//! island. No two triangles of an island cover the same texel: a triangle that would starts a new
//! island. Islands are packed in shelves, highest first, with texels as large as the square allows.
//!
//! Not modelled: rotated islands; foreshortening of a triangle by up to 1/√3.

use std::collections::{HashMap, HashSet};

use glam::{Vec2, Vec3};

use crate::scene::{Mesh, Vertex};

/// Area share of the square filled by the islands in the first attempt.
const INITIAL_FILL: f32 = 0.7;
/// Growth of the texel size per attempt.
const TEXEL_GROWTH: f32 = 1.1;
const MAX_ATTEMPTS: usize = 40;
/// Padding around an island, texels.
const ISLAND_PADDING_TEXELS: i32 = 1;
/// Area of the smallest island with its padding, texels.
const MIN_ISLAND_TEXELS: usize = 9;
/// Distance up to which a texel represents a surface, texels: half its diagonal plus the footprint
/// of interpolation.
const COVERAGE_RADIUS_TEXELS: f32 = 1.5;

/// A vertex with its lightmap coordinates, relative to the sides.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
pub struct LightmapVertex {
    pub vertex: Vertex,
    pub at: [f32; 2],
}

/// A mesh with lightmap coordinates.
#[derive(Clone, Debug, PartialEq)]
pub struct UnwrappedMesh {
    pub corners: Vec<LightmapVertex>,
    /// Triangle by triangle, in the mesh's order.
    pub indices: Vec<u32>,
    /// Side of the lightmap, texels. 0 without a lightmap: there are too many islands.
    pub side: u32,
}

/// Surface point of a lightmap texel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TexelPoint {
    pub texel: u32,
    pub triangle: u32,
    /// Barycentric coordinates.
    pub weights: Vec3,
}

/// A triangle projected onto the box side that it faces.
struct ProjectedTriangle {
    side: usize,
    flat: [Vec2; 3],
}

/// Connected triangles of one side, and their bounds.
struct Island {
    triangles: Vec<u32>,
    low: Vec2,
    high: Vec2,
}

impl UnwrappedMesh {
    /// Unwraps a mesh for a lightmap of at most `side` texels a side.
    pub fn new(mesh: &Mesh, side: u32) -> Self {
        let faces = faces(mesh);
        let area: f32 = faces.iter().map(|face| 0.5 * doubled_area(&face.flat).abs()).sum();
        let mut texel = (area / (INITIAL_FILL * (side * side) as f32)).sqrt();
        if texel > 0.0 && texel.is_finite() {
            let adjacency = adjacency(mesh);
            for _ in 0..MAX_ATTEMPTS {
                let islands = islands(&faces, &adjacency, texel);
                // Larger texels hardly reduce the number of islands.
                if islands.len() * MIN_ISLAND_TEXELS > (side * side) as usize {
                    break;
                }
                if let Some(places) = shelf_positions(&islands, texel, side) {
                    return Self::laid_out(mesh, side, &faces, &islands, &places, texel);
                }
                texel *= TEXEL_GROWTH;
            }
        }
        Self::none(mesh)
    }

    /// A mesh without a lightmap.
    pub fn none(mesh: &Mesh) -> Self {
        let corners = mesh.vertices.iter().map(|vertex| LightmapVertex { vertex: *vertex, at: [0.0; 2] });
        Self { corners: corners.collect(), indices: mesh.indices.clone(), side: 0 }
    }

    fn laid_out(
        mesh: &Mesh,
        side: u32,
        faces: &[ProjectedTriangle],
        islands: &[Island],
        places: &[[i32; 2]],
        texel: f32,
    ) -> Self {
        let (mut corners, mut indices) = (Vec::new(), vec![0u32; mesh.indices.len()]);
        let mut new_indices: HashMap<(u32, usize), u32> = HashMap::new();
        for (n, (island, [x, y])) in islands.iter().zip(places).enumerate() {
            let origin = Vec2::new((x + ISLAND_PADDING_TEXELS) as f32, (y + ISLAND_PADDING_TEXELS) as f32);
            for triangle in &island.triangles {
                for corner in 0..3 {
                    let index = 3 * *triangle as usize + corner;
                    let old = mesh.indices[index];
                    indices[index] = *new_indices.entry((old, n)).or_insert_with(|| {
                        let flat = faces[*triangle as usize].flat[corner];
                        let at = ((flat - island.low) / texel + origin) / side as f32;
                        corners.push(LightmapVertex { vertex: mesh.vertices[old as usize], at: at.to_array() });
                        corners.len() as u32 - 1
                    });
                }
            }
        }
        Self { corners, indices, side }
    }

    /// Surface points of all used texels, in order.
    pub fn places(&self) -> Vec<TexelPoint> {
        let side = self.side as i32;
        let mut hits: Vec<Option<(f32, TexelPoint)>> = vec![None; (side * side) as usize];
        for (triangle, corners) in (0..).zip(self.indices.chunks_exact(3)) {
            let flat: [Vec2; 3] =
                std::array::from_fn(|n| Vec2::from(self.corners[corners[n] as usize].at) * side as f32);
            let [a, b, c] = flat;
            let low = (a.min(b).min(c) - COVERAGE_RADIUS_TEXELS).floor().as_ivec2().max(glam::IVec2::ZERO);
            let high = (a.max(b).max(c) + COVERAGE_RADIUS_TEXELS).ceil().as_ivec2().min(glam::IVec2::splat(side));
            for (x, y) in (low.y..high.y).flat_map(|y| (low.x..high.x).map(move |x| (x, y))) {
                let middle = Vec2::new(x as f32 + 0.5, y as f32 + 0.5);
                let Some(weights) = nearest(middle, &flat) else { continue };
                let distance = (weights.x * a + weights.y * b + weights.z * c).distance(middle);
                let texel = (y * side + x) as usize;
                if distance < COVERAGE_RADIUS_TEXELS && hits[texel].is_none_or(|(nearest, _)| distance < nearest) {
                    hits[texel] = Some((distance, TexelPoint { texel: texel as u32, triangle, weights }));
                }
            }
        }
        hits.into_iter().flatten().map(|(_, place)| place).collect()
    }
}

/// The area of a mesh's surface, in its own units.
pub fn area_of(mesh: &Mesh) -> f64 {
    let at = |i: u32| Vec3::from(mesh.vertices[i as usize].position);
    let area = |t: &[u32]| 0.5 * (at(t[1]) - at(t[0])).cross(at(t[2]) - at(t[0])).length();
    mesh.indices.chunks_exact(3).map(|t| f64::from(area(t))).sum()
}

fn doubled_area([a, b, c]: &[Vec2; 3]) -> f32 {
    (b - a).perp_dot(c - a)
}

fn faces(mesh: &Mesh) -> Vec<ProjectedTriangle> {
    let at = |i: u32| Vec3::from(mesh.vertices[i as usize].position);
    let face = |t: &[u32]| {
        let corners = [at(t[0]), at(t[1]), at(t[2])];
        let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
        let axis = normal.abs().max_position();
        let side = 2 * axis + usize::from(normal[axis] < 0.0);
        ProjectedTriangle { side, flat: corners.map(|c| Vec2::new(c[(axis + 1) % 3], c[(axis + 2) % 3])) }
    };
    mesh.indices.chunks_exact(3).map(face).collect()
}

/// The triangles that share an edge with each triangle, by vertex positions.
fn adjacency(mesh: &Mesh) -> Vec<Vec<u32>> {
    let mut numbers: HashMap<[u32; 3], u32> = HashMap::new();
    let place = |i: &u32| mesh.vertices[*i as usize].position.map(|c| (c + 0.0).to_bits());
    let mut number = |i: &u32| {
        let next = numbers.len() as u32;
        *numbers.entry(place(i)).or_insert(next)
    };
    let places: Vec<u32> = mesh.indices.iter().map(&mut number).collect();
    let mut at_edge: HashMap<(u32, u32), Vec<u32>> = HashMap::new();
    let edges = |t: &[u32]| [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])].map(|(a, b)| (a.min(b), a.max(b)));
    for (n, t) in (0..).zip(places.chunks_exact(3)) {
        edges(t).into_iter().for_each(|edge| at_edge.entry(edge).or_default().push(n));
    }
    let others = |(n, t): (u32, &[u32])| {
        let all = edges(t).into_iter().flat_map(|edge| at_edge[&edge].iter().copied());
        all.filter(|other| *other != n).collect()
    };
    (0..).zip(places.chunks_exact(3)).map(others).collect()
}

/// Connected components of triangles, without overlaps at this texel size.
fn islands(faces: &[ProjectedTriangle], adjacency: &[Vec<u32>], texel: f32) -> Vec<Island> {
    let mut taken = vec![false; faces.len()];
    let mut islands = Vec::new();
    for first in 0..faces.len() as u32 {
        if taken[first as usize] {
            continue;
        }
        let mut covered: HashSet<(i32, i32)> = HashSet::new();
        let mut island = Island { triangles: Vec::new(), low: Vec2::INFINITY, high: Vec2::NEG_INFINITY };
        let mut next = std::collections::VecDeque::from([first]);
        while let Some(triangle) = next.pop_front() {
            let face = &faces[triangle as usize];
            if taken[triangle as usize] || face.side != faces[first as usize].side {
                continue;
            }
            let own = covered_texels(&face.flat.map(|at| at / texel));
            if own.iter().any(|texel| covered.contains(texel)) {
                continue;
            }
            covered.extend(own);
            taken[triangle as usize] = true;
            island.triangles.push(triangle);
            for at in face.flat {
                (island.low, island.high) = (island.low.min(at), island.high.max(at));
            }
            next.extend(&adjacency[triangle as usize]);
        }
        islands.push(island);
    }
    islands
}

/// The texels whose centres lie inside a triangle; centres on its edges are excluded.
fn covered_texels(flat: &[Vec2; 3]) -> Vec<(i32, i32)> {
    let [a, b, c] = *flat;
    let (low, high) = (a.min(b).min(c).floor().as_ivec2(), a.max(b).max(c).ceil().as_ivec2());
    let area = doubled_area(flat);
    let is_within = |&(x, y): &(i32, i32)| {
        let p = Vec2::new(x as f32 + 0.5, y as f32 + 0.5);
        [[a, b], [b, c], [c, a]].iter().all(|[from, to]| (*to - *from).perp_dot(p - *from) * area.signum() > 1e-3)
    };
    let texels = (low.y..high.y).flat_map(|y| (low.x..high.x).map(move |x| (x, y)));
    texels.filter(is_within).collect()
}

/// Position of each island, texels; `None` if they do not fit into the square.
fn shelf_positions(islands: &[Island], texel: f32, side: u32) -> Option<Vec<[i32; 2]>> {
    let size = |island: &Island| ((island.high - island.low) / texel).ceil().as_ivec2() + 2 * ISLAND_PADDING_TEXELS;
    let mut order: Vec<usize> = (0..islands.len()).collect();
    order.sort_by_key(|n| (-size(&islands[*n]).y, *n));
    let side = side as i32;
    let mut places = vec![[0; 2]; islands.len()];
    let (mut x, mut y, mut height) = (0, 0, 0);
    for n in order {
        let size = size(&islands[n]);
        if x + size.x > side {
            (x, y, height) = (0, y + height, 0);
        }
        height = height.max(size.y);
        if size.x > side || y + height > side {
            return None;
        }
        places[n] = [x, y];
        x += size.x;
    }
    Some(places)
}

/// The nearest point of a triangle, as barycentric coordinates; `None` if it has no area.
fn nearest(at: Vec2, [a, b, c]: &[Vec2; 3]) -> Option<Vec3> {
    let area = doubled_area(&[*a, *b, *c]);
    if area == 0.0 {
        return None;
    }
    let inside =
        Vec3::new((*c - *b).perp_dot(at - *b), (*a - *c).perp_dot(at - *c), (*b - *a).perp_dot(at - *a)) / area;
    if inside.cmpge(Vec3::ZERO).all() {
        return Some(inside);
    }
    // Otherwise the nearest point on the three edges.
    let nearest_on_edge = |from: Vec2, to: Vec2| {
        let t = ((at - from).dot(to - from) / from.distance_squared(to).max(1e-20)).clamp(0.0, 1.0);
        (t, (from + t * (to - from)).distance_squared(at))
    };
    let edges = [nearest_on_edge(*a, *b), nearest_on_edge(*b, *c), nearest_on_edge(*c, *a)];
    let (n, (t, _)) = edges.into_iter().enumerate().min_by(|(_, (_, p)), (_, (_, q))| p.total_cmp(q))?;
    let mut weights = Vec3::ZERO;
    (weights[n], weights[(n + 1) % 3]) = (1.0 - t, t);
    Some(weights)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mesh(positions: &[[f32; 3]], indices: &[u32]) -> Mesh {
        let vertex = |position: &[f32; 3]| Vertex { position: *position, ..bytemuck::Zeroable::zeroed() };
        Mesh { vertices: positions.iter().map(vertex).collect(), indices: indices.to_vec(), material: 0 }
    }

    /// A box of 4 × 2 × 1; each side has two triangles.
    fn cuboid() -> Mesh {
        let corner = |i: u32| [4.0 * (i & 1) as f32, 2.0 * (i >> 1 & 1) as f32, (i >> 2 & 1) as f32];
        let sides = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        let indices: Vec<u32> = sides.iter().flat_map(|[a, b, c, d]| [*a, *b, *c, *a, *c, *d]).collect();
        mesh(&(0..8).map(corner).collect::<Vec<_>>(), &indices)
    }

    /// A helical strip of three turns: seen along the axis it covers itself.
    fn helix() -> Mesh {
        let (mut positions, mut indices) = (Vec::new(), Vec::new());
        for n in 0..=72u32 {
            let (sin, cos) = (n as f32 / 24.0 * std::f32::consts::TAU).sin_cos();
            positions.extend([1.0, 2.0].map(|r| [r * cos, r * sin, 0.02 * n as f32]));
            if n > 0 {
                let i = 2 * n;
                indices.extend([i - 2, i - 1, i + 1, i - 2, i + 1, i]);
            }
        }
        mesh(&positions, &indices)
    }

    #[test]
    fn texels_and_surface_points_correspond_one_to_one() {
        for mesh in [cuboid(), helix()] {
            let unwrapped = UnwrappedMesh::new(&mesh, 64);
            assert_eq!((unwrapped.side, unwrapped.indices.len()), (64, mesh.indices.len()));
            // Vertices are unchanged.
            for (old, new) in mesh.indices.iter().zip(&unwrapped.indices) {
                let (old, new) = (&mesh.vertices[*old as usize], &unwrapped.corners[*new as usize]);
                assert_eq!(*old, new.vertex);
                assert!(new.at.iter().all(|at| (0.5 / 64.0..=63.5 / 64.0).contains(at)), "{:?}", new.at);
            }
            let places = unwrapped.places();
            let shown: HashMap<u32, &TexelPoint> = places.iter().map(|place| (place.texel, place)).collect();
            let mut owner: HashMap<u32, usize> = HashMap::new();
            let position = |triangle: usize, weights: Vec3| -> Vec3 {
                let corner = |n: usize| unwrapped.corners[unwrapped.indices[3 * triangle + n] as usize];
                (0..3).map(|n| weights[n] * Vec3::from(corner(n).vertex.position)).sum()
            };
            for triangle in 0..mesh.indices.len() / 3 {
                let at: [Vec2; 3] = std::array::from_fn(|n| {
                    64.0 * Vec2::from(unwrapped.corners[unwrapped.indices[3 * triangle + n] as usize].at)
                });
                for (x, y) in covered_texels(&at) {
                    let texel = (64 * y + x) as u32;
                    assert_eq!(*owner.entry(texel).or_insert(triangle), triangle, "two triangles at {x} {y}");
                    let weights = nearest(Vec2::new(x as f32 + 0.5, y as f32 + 0.5), &at).unwrap();
                    let [drawn, baked] =
                        [position(triangle, weights), position(shown[&texel].triangle as usize, shown[&texel].weights)];
                    assert!(drawn.distance(baked) < 1e-4, "{drawn} is not {baked}");
                }
            }
            assert!(owner.len() > 64 * 64 / 4, "{} texels are used", owner.len());
            // All texels used for interpolation at a corner are filled.
            for corner in &unwrapped.corners {
                let at = (64.0 * Vec2::from(corner.at) - 0.5).floor().as_ivec2();
                for (x, y) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                    assert!(shown.contains_key(&((64 * (at.y + y) + at.x + x) as u32)), "{at} {x} {y}");
                }
            }
        }
    }

    #[test]
    fn nearest_point_matches_hand_calculation() {
        let triangle = [Vec2::ZERO, Vec2::new(4.0, 0.0), Vec2::new(0.0, 4.0)];
        assert_eq!(nearest(Vec2::new(1.0, 1.0), &triangle), Some(Vec3::new(0.5, 0.25, 0.25)));
        assert_eq!(nearest(Vec2::new(2.0, -3.0), &triangle), Some(Vec3::new(0.5, 0.5, 0.0)));
        assert_eq!(nearest(Vec2::new(-1.0, -1.0), &triangle).map(|w| w.x), Some(1.0));
        assert_eq!(nearest(Vec2::new(3.0, 3.0), &triangle), Some(Vec3::new(0.0, 0.5, 0.5)));
        assert_eq!(nearest(Vec2::ZERO, &[Vec2::ZERO; 3]), None);
    }

    #[test]
    fn degenerate_and_fragmented_meshes_have_no_lightmap() {
        assert_eq!(UnwrappedMesh::new(&mesh(&[[0.0; 3]; 3], &[0, 1, 2]), 64).side, 0);
        assert_eq!(UnwrappedMesh::new(&mesh(&[], &[]), 64).side, 0);
        // A thousand separate triangles do not fit into 16 texels.
        let positions: Vec<[f32; 3]> =
            (0..3000).map(|i| [(i / 3) as f32 + (i % 3 % 2) as f32, (i % 3 / 2) as f32, 0.0]).collect();
        let apart = mesh(
            &positions.iter().map(|[x, y, z]| [*x * 3.0, *y, *z]).collect::<Vec<_>>(),
            &(0..3000).collect::<Vec<_>>(),
        );
        let unwrapped = UnwrappedMesh::new(&apart, 16);
        assert_eq!((unwrapped.side, &unwrapped.indices), (0, &apart.indices));
    }
}
