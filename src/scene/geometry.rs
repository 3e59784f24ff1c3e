//! Triangulation, and computation of missing normals and tangents.

use std::collections::HashMap;

use glam::{DVec2, DVec3, Vec3};

use super::{TextureUse, Vertex};

/// Primitive topology (glTF 2.0, section 3.7.2.1).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum PrimitiveAssembly {
    List,
    Strip,
    Fan,
}

/// Three indices per triangle, with the winding of the first. Degenerate triangles of strips and
/// fans, which only join pieces, are removed, as are incomplete triangles at the end of a list.
pub(super) fn triangles(assembly: PrimitiveAssembly, mut indices: Vec<u32>) -> Vec<u32> {
    let keep = |t: &[u32; 3]| t[0] != t[1] && t[1] != t[2] && t[0] != t[2];
    match assembly {
        PrimitiveAssembly::List => {
            indices.truncate(indices.len() / 3 * 3);
            indices
        }
        PrimitiveAssembly::Strip => indices
            .windows(3)
            .enumerate()
            .map(|(i, w)| if i % 2 == 0 { [w[0], w[1], w[2]] } else { [w[0], w[2], w[1]] })
            .filter(keep)
            .flatten()
            .collect(),
        PrimitiveAssembly::Fan => {
            let Some((&first, rest)) = indices.split_first() else { return indices };
            rest.windows(2).map(|w| [w[0], w[1], first]).filter(keep).flatten().collect()
        }
    }
}

/// Unshares vertices and sets face normals (glTF 2.0, section 3.7.2.1: a mesh without normals is
/// flat-shaded).
pub(super) fn flat_shaded(vertices: &[Vertex], indices: &[u32]) -> (Vec<Vertex>, Vec<u32>) {
    let mut out = Vec::with_capacity(indices.len());
    for triangle in indices.chunks_exact(3) {
        let corners = [0, 1, 2].map(|i| vertices[triangle[i] as usize]);
        let normal = unit_or(doubled_area_normal(&corners), DVec3::Z).as_vec3().to_array();
        out.extend(corners.map(|vertex| Vertex { normal, ..vertex }));
    }
    let indices = (0..out.len() as u32).collect();
    (out, indices)
}

/// Sets zero normals to the mean of their triangles', weighted by area.
pub(super) fn fill_normals(vertices: &mut [Vertex], indices: &[u32]) {
    let mut sums = vec![DVec3::ZERO; vertices.len()];
    for triangle in indices.chunks_exact(3) {
        let area = doubled_area_normal(&[0, 1, 2].map(|i| vertices[triangle[i] as usize]));
        triangle.iter().for_each(|&i| sums[i as usize] += area);
    }
    for (vertex, sum) in vertices.iter_mut().zip(sums).filter(|(v, _)| v.normal == [0.0; 3]) {
        vertex.normal = unit_or(sum, DVec3::Z).as_vec3().to_array();
    }
}

/// Computes tangents for a normal map: each triangle's direction of increasing u, weighted by area,
/// summed per vertex and orthogonalized to the normal (Lengyel 2001, *Computing Tangent Space Basis
/// Vectors*). Vertices between mirrored and unmirrored texture are split. MikkTSpace weights by
/// angle and splits more: maps baked for it are slightly off where the triangles of a vertex differ
/// much in direction.
pub(super) fn tangents(vertices: &mut Vec<Vertex>, indices: &mut [u32], map: &TextureUse) {
    let uv = |v: &Vertex| {
        let [u, v] = if map.uv_set == 0 { v.uv0 } else { v.uv1 };
        let row = |r: [f32; 3]| f64::from(r[0]) * f64::from(u) + f64::from(r[1]) * f64::from(v);
        DVec2::new(row(map.transform[0]), row(map.transform[1]))
    };
    // One sum per vertex and handedness; the first handedness keeps the vertex.
    let mut side_of = vec![0i8; vertices.len()];
    let mut split: HashMap<u32, u32> = HashMap::new();
    let mut sums = vec![DVec3::ZERO; vertices.len()];
    for triangle in indices.chunks_exact_mut(3) {
        let [a, b, c] = [0, 1, 2].map(|i| vertices[triangle[i] as usize]);
        let [p, q] = [b, c].map(|v| position(&v) - position(&a));
        let [s, t] = [b, c].map(|v| uv(&v) - uv(&a));
        let turn = s.perp_dot(t);
        if turn == 0.0 || !turn.is_finite() {
            continue;
        }
        let along_u = unit_or((p * t.y - q * s.y) * turn.signum(), DVec3::ZERO) * p.cross(q).length();
        // v points down in a glTF picture, so the mirrored one has the triangle's orientation.
        let side = if turn < 0.0 { 1 } else { -1 };
        for corner in triangle {
            let i = *corner as usize;
            if side_of[i] == -side {
                *corner = *split.entry(*corner).or_insert_with(|| {
                    vertices.push(vertices[i]);
                    sums.push(DVec3::ZERO);
                    side_of.push(side);
                    (vertices.len() - 1) as u32
                });
            } else {
                side_of[i] = side;
            }
            sums[*corner as usize] += along_u;
        }
    }
    for ((vertex, sum), side) in vertices.iter_mut().zip(sums).zip(side_of) {
        let normal = Vec3::from(vertex.normal).as_dvec3();
        let tangent = unit_or(sum - normal * normal.dot(sum), normal.any_orthonormal_vector());
        vertex.tangent = tangent.as_vec3().extend(if side < 0 { -1.0 } else { 1.0 }).to_array();
    }
}

fn position(vertex: &Vertex) -> DVec3 {
    Vec3::from(vertex.position).as_dvec3()
}

/// Face normal with twice the area as length.
fn doubled_area_normal(corners: &[Vertex; 3]) -> DVec3 {
    let [a, b, c] = corners.each_ref().map(position);
    (b - a).cross(c - a)
}

fn unit_or(v: DVec3, other: DVec3) -> DVec3 {
    // Scaled first: the squared area of a tiny triangle underflows.
    let largest = v.abs().max_element();
    if largest > 0.0 && largest.is_finite() { (v / largest).normalize() } else { other }
}

/// Unit tangent with a handedness of exactly ±1; zero if the file's tangent has no length.
pub(super) fn unit_tangent([x, y, z, side]: [f32; 4]) -> [f32; 4] {
    match Vec3::new(x, y, z).try_normalize() {
        Some(direction) => direction.extend(if side < 0.0 { -1.0 } else { 1.0 }).to_array(),
        None => [0.0; 4],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn vertex(position: [f32; 3], uv0: [f32; 2]) -> Vertex {
        let zero = [0.0; 2];
        Vertex { position, normal: [0.0; 3], tangent: [0.0; 4], uv0, uv1: zero, color: [1.0; 4] }
    }

    const PLAIN: TextureUse = TextureUse { texture: 0, uv_set: 0, transform: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]] };

    #[test]
    fn strip_keeps_its_winding() {
        // 1-3-5
        // |\|\|   all counter-clockwise
        // 0-2-4
        let strip = triangles(PrimitiveAssembly::Strip, vec![0, 2, 1, 3, 3]);
        assert_eq!(strip, [0, 2, 1, 2, 3, 1]);
        assert!(triangles(PrimitiveAssembly::Strip, vec![7, 8]).is_empty());
    }

    #[test]
    fn fan_triangles_share_the_first_vertex() {
        assert_eq!(triangles(PrimitiveAssembly::Fan, vec![9, 1, 2, 3]), [1, 2, 9, 2, 3, 9]);
        assert!(triangles(PrimitiveAssembly::Fan, vec![]).is_empty());
    }

    #[test]
    fn flat_normals_follow_counter_clockwise_winding() {
        let tiny = 1e-30; // its squared area is 0 in single precision
        let corners = [[0.0; 3], [tiny, 0.0, 0.0], [0.0, tiny, 0.0]].map(|p| vertex(p, [0.0; 2]));
        let (vertices, indices) = flat_shaded(&corners, &[0, 1, 2, 2, 1, 0]);
        assert_eq!(indices, [0, 1, 2, 3, 4, 5]);
        assert_eq!(vertices[0].normal, [0.0, 0.0, 1.0]);
        assert_eq!(vertices[5].normal, [0.0, 0.0, -1.0]);
    }

    #[test]
    fn mean_normals_are_weighted_by_area() {
        // A triangle in the xy plane and one of double size in the xz plane share vertex 0.
        let mut vertices = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [2.0, 0.0, 0.0], [0.0, 0.0, -1.0]]
            .map(|p| vertex(p, [0.0; 2]));
        vertices[1].normal = [1.0, 0.0, 0.0];
        fill_normals(&mut vertices, &[0, 1, 2, 0, 3, 4]);
        let expected = Vec3::new(0.0, 2.0, 1.0).normalize();
        assert!(Vec3::from(vertices[0].normal).abs_diff_eq(expected, 1e-6), "{:?}", vertices[0].normal);
        assert_eq!(vertices[1].normal, [1.0, 0.0, 0.0]);
    }

    #[test]
    fn tangents_follow_u_and_the_bitangent_points_against_v() {
        // A square facing +z, its picture upright: u to the right, v down.
        let corners = [([0.0, 0.0], [0.0, 1.0]), ([1.0, 0.0], [1.0, 1.0]), ([1.0, 1.0], [1.0, 0.0])];
        let mut vertices: Vec<_> = corners.map(|(p, uv)| vertex([p[0], p[1], 0.0], uv)).into();
        vertices.iter_mut().for_each(|v| v.normal = [0.0, 0.0, 1.0]);
        tangents(&mut vertices, &mut [0, 1, 2], &PLAIN);
        assert!(vertices.iter().all(|v| v.tangent == [1.0, 0.0, 0.0, 1.0]), "{vertices:?}");
        // The texture turned by a quarter: u' = v, v' = -u.
        let turned = TextureUse { transform: [[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]], ..PLAIN };
        tangents(&mut vertices, &mut [0, 1, 2], &turned);
        assert!(vertices.iter().all(|v| v.tangent == [0.0, -1.0, 0.0, 1.0]), "{vertices:?}");
    }

    #[test]
    fn vertex_between_mirrored_halves_is_split() {
        let p = [[0.0, 0.0], [0.0, 1.0], [1.0, 0.0], [-1.0, 0.0]];
        // u grows away from the middle on both sides.
        let mut vertices: Vec<_> = p.map(|[x, y]| vertex([x, y, 0.0], [x.abs(), 1.0 - y])).into();
        vertices.iter_mut().for_each(|v| v.normal = [0.0, 0.0, 1.0]);
        let mut indices = [0, 2, 1, 0, 1, 3];
        tangents(&mut vertices, &mut indices, &PLAIN);
        assert_eq!(vertices.len(), 6);
        for (corner, &i) in indices.iter().enumerate() {
            let side = if corner < 3 { 1.0 } else { -1.0 };
            assert_eq!(vertices[i as usize].tangent, [side, 0.0, 0.0, side], "corner {corner}");
        }
    }
}
