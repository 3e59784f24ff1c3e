//! Triangles that cast shadows: above a receiver plane, in its axes, or around a point.

use std::collections::BTreeMap;
use std::ops::Range;

use glam::{DAffine3, Vec2, Vec3};

use super::albedo::MeshAlbedo;
use crate::digest::{Digester, Digestible};
use crate::scene::{Alpha, Material, Scene, Vertex};

/// Surfaces of a lower opacity do not block light.
const OPAQUE: f32 = 0.5;
/// Texels per side of a texture that its mean opacity is sampled at, at most.
const OPACITY_SAMPLES_PER_SIDE: u32 = 64;
/// Depth below the plane down to which a vertex counts as on it, m: feet are uneven.
const ON_FLOOR_M: f32 = 5e-4;

/// Triangles of placed parts, with their albedo.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Occluders {
    /// Vertices, m. Over a receiver plane z is the height.
    pub corners: Vec<Vec3>,
    pub triangles: Vec<[u32; 3]>,
    /// Albedo of each triangle.
    pub colors: Vec<Vec3>,
    /// Range of triangles of each part.
    pub parts: Vec<Range<usize>>,
}

/// Mean opacity of a material, 0 to 1, its texture included; 1 unless it is blended. A decal is a
/// mostly transparent sheet.
fn mean_opacity(scene: &Scene, material: &Material) -> f32 {
    if material.alpha != Alpha::Blend {
        return 1.0;
    }
    let texture = material.base_color_texture.and_then(|used| scene.textures.get(used.texture));
    let of_texture = texture.map_or(1.0, |texture| {
        let steps = [texture.width, texture.height].map(|side| side.div_ceil(OPACITY_SAMPLES_PER_SIDE).max(1) as usize);
        let row_bytes = 4 * texture.width.max(1) as usize;
        let rows = texture.rgba.chunks_exact(row_bytes).step_by(steps[1]);
        let samples = rows.flat_map(|row| row.chunks_exact(4).step_by(steps[0]).map(|rgba| u32::from(rgba[3])));
        let (sum, count) = samples.fold((0, 0), |(sum, count), alpha| (sum + alpha, count + 1));
        if count == 0 { 1.0 } else { sum as f32 / (255 * count) as f32 }
    });
    material.base_color[3] * of_texture
}

impl Digestible for Occluders {
    fn digest(&self, into: &mut Digester) {
        let Self { corners, triangles, colors, parts } = self;
        into.add_numbers(corners);
        into.add_numbers(triangles);
        into.add_numbers(colors);
        into.add(parts);
    }
}

impl Occluders {
    /// The parts' meshes, as indices into [`Scene::meshes`], with their places.
    pub fn of(scene: &Scene, parts: impl IntoIterator<Item = (usize, DAffine3)>) -> Self {
        let mut all = Self::default();
        for (mesh, from_mesh) in parts {
            let Some(mesh) = scene.meshes.get(mesh) else { continue };
            let material = scene.materials.get(mesh.material);
            if material.is_some_and(|m| mean_opacity(scene, m) < OPAQUE) {
                continue;
            }
            let first = all.corners.len() as u32;
            let at = |vertex: &Vertex| from_mesh.transform_point3(Vec3::from(vertex.position).as_dvec3()).as_vec3();
            all.corners.extend(mesh.vertices.iter().map(at));
            let (own, albedo) = (mesh.indices.chunks_exact(3), MeshAlbedo::of(scene, mesh));
            all.colors.extend(own.clone().map(|t| albedo.color([t[0], t[1], t[2]])));
            // Counter-clockwise seen from outside, mirrored too.
            let is_mirrored = from_mesh.matrix3.determinant() < 0.0;
            let order = if is_mirrored { [0, 2, 1] } else { [0, 1, 2] };
            let first_triangle = all.triangles.len();
            all.triangles.extend(own.map(|t| order.map(|i| first + t[i])));
            all.parts.push(first_triangle..all.triangles.len());
        }
        all
    }

    /// A triangle's centroid, and its normal on the front; 0 if it has no area.
    pub fn centroid_and_normal(&self, triangle: usize) -> (Vec3, Vec3) {
        let [a, b, c] = self.triangles[triangle].map(|i| self.corners[i as usize]);
        ((a + b + c) / 3.0, (b - a).cross(c - a).normalize_or_zero())
    }

    /// Clips triangles at the plane: parts below it are removed.
    pub fn on_floor(mut self) -> Self {
        for corner in self.corners.iter_mut().filter(|corner| corner.z >= -ON_FLOOR_M) {
            corner.z = corner.z.max(0.0);
        }
        if self.corners.iter().all(|corner| corner.z >= 0.0) { self } else { self.clip_below_plane() }
    }

    /// Clips at z = 0. Neighbours share the new vertices.
    fn clip_below_plane(self) -> Self {
        let Self { corners, triangles, colors, parts } = self;
        let mut cut = Self::default();
        // New vertices by the ends of their edges. Both ends are equal for a vertex that is kept.
        let mut cut_vertices: BTreeMap<[u32; 2], u32> = BTreeMap::new();
        let mut corner = |all: &mut Vec<Vec3>, a: u32, b: u32| {
            *cut_vertices.entry([a.min(b), a.max(b)]).or_insert_with_key(|ends| {
                let [low, high] = ends.map(|i| corners[i as usize]);
                let at = if a == b { low } else { low.lerp(high, low.z / (low.z - high.z)).with_z(0.0) };
                all.push(at);
                all.len() as u32 - 1
            })
        };
        let is_above = |i: u32| corners[i as usize].z >= 0.0;
        for part in parts {
            let first = cut.triangles.len();
            for n in part {
                let [a, b, c] = triangles[n];
                // The clipped polygon, with three or four vertices.
                let mut around = Vec::with_capacity(4);
                for [from, to] in [[a, b], [b, c], [c, a]] {
                    if is_above(from) {
                        around.push(corner(&mut cut.corners, from, from));
                    }
                    if is_above(from) != is_above(to) {
                        around.push(corner(&mut cut.corners, from, to));
                    }
                }
                for pair in around.windows(2).skip(1) {
                    cut.triangles.push([around[0], pair[0], pair[1]]);
                    cut.colors.push(colors[n]);
                }
            }
            cut.parts.push(first..cut.triangles.len());
        }
        cut
    }

    /// Bounding box of all vertices, from the plane up; `None` without any.
    pub fn bounds(&self) -> Option<(Vec2, Vec2, f32)> {
        let (low, high) =
            self.corners.iter().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(l, h), c| (l.min(*c), h.max(*c)));
        (low.is_finite() && high.is_finite()).then(|| (low.truncate(), high.truncate(), high.z))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Mesh, SceneTexture, TextureUse, Wrap};

    /// Two triangles that share an edge, a part each.
    fn sheet(heights: [f32; 4]) -> Occluders {
        let [a, b, c, d] = heights;
        Occluders {
            corners: vec![
                Vec3::new(0.0, 0.0, a),
                Vec3::new(1.0, 0.0, b),
                Vec3::new(1.0, 1.0, c),
                Vec3::new(0.0, 1.0, d),
            ],
            triangles: vec![[0, 1, 2], [0, 2, 3]],
            colors: vec![Vec3::X, Vec3::Y],
            parts: vec![0..1, 1..2],
        }
    }

    /// A square with a material and its texture's opacity, left and right half.
    fn square(alpha: Alpha, base_opacity: f32, halves: [u8; 2]) -> Scene {
        let vertex = |x: f32, y: f32| Vertex { position: [x, y, 0.0], ..bytemuck::Zeroable::zeroed() };
        let vertices = vec![vertex(0.0, 0.0), vertex(1.0, 0.0), vertex(1.0, 1.0), vertex(0.0, 1.0)];
        let used = TextureUse { texture: 0, uv_set: 0, transform: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]] };
        let material = Material {
            alpha,
            base_color: [1.0, 1.0, 1.0, base_opacity],
            base_color_texture: Some(used),
            ..Material::default()
        };
        let row: Vec<u8> = (0..200).flat_map(|x| [255, 255, 255, halves[x / 100]]).collect();
        let texture = SceneTexture {
            width: 200,
            height: 130,
            rgba: row.repeat(130).into(),
            srgb: true,
            wrap: [Wrap::Clamp; 2],
            smooth: true,
            mipmaps: true,
        };
        Scene {
            meshes: vec![Mesh { vertices, indices: vec![0, 1, 2, 0, 2, 3], material: 0 }.into()],
            materials: vec![material],
            textures: vec![texture],
            ..Scene::default()
        }
    }

    #[test]
    fn decals_and_clear_sheets_cast_no_shadow() {
        let count = |alpha, base_opacity, halves| {
            let scene = square(alpha, base_opacity, halves);
            Occluders::of(&scene, [(0, DAffine3::IDENTITY)]).triangles.len()
        };
        // Mean opacities of 0.4, 0.6, 0.6 · 0.5 and 0.49.
        assert_eq!(count(Alpha::Blend, 1.0, [0, 204]), 0);
        assert_eq!(count(Alpha::Blend, 1.0, [51, 255]), 2);
        assert_eq!(count(Alpha::Blend, 0.5, [51, 255]), 0);
        assert_eq!(count(Alpha::Blend, 0.49, [255, 255]), 0);
        // Only blended surfaces are transparent.
        assert_eq!(count(Alpha::Opaque, 0.1, [0, 0]), 2);
        assert_eq!(count(Alpha::Mask(0.5), 1.0, [0, 204]), 2);
    }

    #[test]
    fn sunken_geometry_is_clipped_at_the_plane() {
        // It rises from 1 m below the plane to 3 m above it: a quarter of it is below.
        let cut = sheet([-1.0, 3.0, 3.0, -1.0]).on_floor();
        assert_eq!(cut.bounds().unwrap(), (Vec2::new(0.25, 0.0), Vec2::ONE, 3.0));
        // A quarter of the sheet is removed; of the triangle on its low side 0.21875 of 0.5.
        let area = |[a, b, c]: [u32; 3]| {
            let [a, b, c] = [a, b, c].map(|i| cut.corners[i as usize].truncate());
            0.5 * (b - a).perp_dot(c - a)
        };
        let whole = |color: Vec3| -> f32 {
            let own = (0..cut.triangles.len()).filter(|n| cut.colors[*n] == color);
            own.map(|n| area(cut.triangles[n])).sum()
        };
        let [first, second] = [Vec3::X, Vec3::Y].map(whole);
        assert!((first + second - 0.75).abs() < 1e-6 && (second - 0.28125).abs() < 1e-6, "{first} {second}");
        assert_eq!(cut.parts, [0..2, 2..3]);
        // The shared edge is clipped once.
        assert_eq!(cut.corners.len(), 5);
        assert!(sheet([-1.0, -2.0, -1.0, -1.0]).on_floor().bounds().is_none());
    }

    #[test]
    fn an_uneven_foot_stands_on_the_floor() {
        let foot = sheet([-1e-4, 0.0, 0.1, -1e-6]).on_floor();
        assert_eq!(foot, sheet([0.0, 0.0, 0.1, 0.0]));
    }
}
