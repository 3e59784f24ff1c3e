//! The triangles of what stands on a floor, in the floor's axes.

use glam::{DAffine3, Vec2, Vec3};

use super::skin::Skin;
use crate::scene::{Alpha, Scene};

/// Less opaque than this on the whole, a surface lets light through.
const OPAQUE: f32 = 0.5;

#[derive(Clone, Debug, Default, PartialEq)]
pub struct Casters {
    /// z is the height over the floor, metres; what lies below the floor is on it.
    pub corners: Vec<Vec3>,
    pub triangles: Vec<[u32; 3]>,
    /// The share of light that each triangle throws back.
    pub colors: Vec<Vec3>,
}

impl Casters {
    /// The parts' meshes, as indices into [`Scene::meshes`], with their places.
    pub fn of(scene: &Scene, parts: &[(usize, DAffine3)]) -> Self {
        let mut all = Self::default();
        for (mesh, floor_from_mesh) in parts {
            let Some(mesh) = scene.meshes.get(*mesh) else { continue };
            let material = scene.materials.get(mesh.material);
            if material.is_some_and(|m| m.alpha == Alpha::Blend && m.base_color[3] < OPAQUE) {
                continue;
            }
            let first = all.corners.len() as u32;
            all.corners.extend(mesh.vertices.iter().map(|vertex| {
                let at = floor_from_mesh.transform_point3(Vec3::from(vertex.position).as_dvec3()).as_vec3();
                at.with_z(at.z.max(0.0))
            }));
            let (own, skin) = (mesh.indices.chunks_exact(3), Skin::of(scene, mesh));
            all.colors.extend(own.clone().map(|t| skin.color([t[0], t[1], t[2]])));
            // Counter-clockwise seen from outside, mirrored too.
            let is_mirrored = floor_from_mesh.matrix3.determinant() < 0.0;
            let order = if is_mirrored { [0, 2, 1] } else { [0, 1, 2] };
            all.triangles.extend(own.map(|t| order.map(|i| first + t[i])));
        }
        all
    }

    /// The least box around all corners, from the floor up; `None` where there are none.
    pub fn bounds(&self) -> Option<(Vec2, Vec2, f32)> {
        let (low, high) =
            self.corners.iter().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(l, h), c| (l.min(*c), h.max(*c)));
        (low.is_finite() && high.is_finite()).then(|| (low.truncate(), high.truncate(), high.z))
    }
}
