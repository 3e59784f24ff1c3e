//! The triangles of what stands on a floor, in the floor's axes, or of what stands around a place.

use std::ops::Range;

use glam::{DAffine3, Vec2, Vec3};

use super::known::Telling;
use super::skin::Skin;
use crate::scene::{Alpha, Scene, Vertex};

/// Less opaque than this on the whole, a surface lets light through.
const OPAQUE: f32 = 0.5;

#[derive(Clone, Debug, Default, PartialEq)]
pub struct Casters {
    /// Metres. On a floor, z is the height over it.
    pub corners: Vec<Vec3>,
    pub triangles: Vec<[u32; 3]>,
    /// The share of light that each triangle throws back.
    pub colors: Vec<Vec3>,
    /// Of the triangles of each part, in turn.
    pub parts: Vec<Range<usize>>,
}

impl Casters {
    /// The parts' meshes, as indices into [`Scene::meshes`], with their places.
    pub fn of(scene: &Scene, parts: impl IntoIterator<Item = (usize, DAffine3)>) -> Self {
        let mut all = Self::default();
        for (mesh, from_mesh) in parts {
            let Some(mesh) = scene.meshes.get(mesh) else { continue };
            let material = scene.materials.get(mesh.material);
            if material.is_some_and(|m| m.alpha == Alpha::Blend && m.base_color[3] < OPAQUE) {
                continue;
            }
            let first = all.corners.len() as u32;
            let at = |vertex: &Vertex| from_mesh.transform_point3(Vec3::from(vertex.position).as_dvec3()).as_vec3();
            all.corners.extend(mesh.vertices.iter().map(at));
            let (own, skin) = (mesh.indices.chunks_exact(3), Skin::of(scene, mesh));
            all.colors.extend(own.clone().map(|t| skin.color([t[0], t[1], t[2]])));
            // Counter-clockwise seen from outside, mirrored too.
            let is_mirrored = from_mesh.matrix3.determinant() < 0.0;
            let order = if is_mirrored { [0, 2, 1] } else { [0, 1, 2] };
            let first_triangle = all.triangles.len();
            all.triangles.extend(own.map(|t| order.map(|i| first + t[i])));
            all.parts.push(first_triangle..all.triangles.len());
        }
        all
    }

    /// Where a triangle's middle is, and its normal on the front; no direction if it has no area.
    pub fn middle_and_front(&self, triangle: usize) -> (Vec3, Vec3) {
        let [a, b, c] = self.triangles[triangle].map(|i| self.corners[i as usize]);
        ((a + b + c) / 3.0, (b - a).cross(c - a).normalize_or_zero())
    }

    pub fn tell(&self, telling: &mut Telling) {
        telling.all(&self.corners);
        telling.all(&self.triangles);
        telling.all(&self.colors);
        telling.small(&self.parts);
    }

    /// What lies below the floor is on it.
    pub fn on_floor(mut self) -> Self {
        self.corners.iter_mut().for_each(|corner| corner.z = corner.z.max(0.0));
        self
    }

    /// The least box around all corners, from the floor up; `None` where there are none.
    pub fn bounds(&self) -> Option<(Vec2, Vec2, f32)> {
        let (low, high) =
            self.corners.iter().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(l, h), c| (l.min(*c), h.max(*c)));
        (low.is_finite() && high.is_finite()).then(|| (low.truncate(), high.truncate(), high.z))
    }
}
