//! ViewRay casting: the object under a pixel.

use glam::{DVec2, DVec3};

use super::{PosedCamera, ViewRay};
use crate::scene::{Object, Part, Scene};

/// The nearest intersection of a ray with an object.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PickHit {
    /// Index into [`Scene::objects`]; [`crate::scene::SceneFile::entries`] has its place in the
    /// scene file.
    pub object: usize,
    pub point_m: DVec3,
    /// Normal of the triangle, unit length, towards the ray's origin.
    pub normal: DVec3,
    /// Distance from the ray's origin, m.
    pub distance_m: f64,
}

impl PosedCamera {
    /// The nearest object at a position of the picture, px from its upper left. Occlusion by real
    /// objects and transparency are not considered: glass is hit.
    pub fn object_at(&self, scene: &Scene, at_px: DVec2) -> Option<PickHit> {
        nearest(scene, &self.ray(at_px)?)
    }
}

/// The nearest intersection of a ray with an object; triangles are two-sided.
pub fn nearest(scene: &Scene, ray: &ViewRay) -> Option<PickHit> {
    nearest_of(scene, ray, |_| true)
}

/// [`nearest`] among the objects that pass a filter.
pub fn nearest_of(scene: &Scene, ray: &ViewRay, accepts: impl Fn(usize) -> bool) -> Option<PickHit> {
    let objects = scene.objects.iter().enumerate().filter(|(index, _)| accepts(*index));
    let hits = objects.filter_map(|(index, object)| hit_of_object(scene, index, object, ray));
    hits.min_by(|a, b| a.distance_m.total_cmp(&b.distance_m))
}

fn hit_of_object(scene: &Scene, object: usize, of: &Object, ray: &ViewRay) -> Option<PickHit> {
    let hits = of.placed().filter_map(|part| hit_of_part(scene, part, ray));
    let (distance_m, normal) = hits.min_by(|a, b| a.0.total_cmp(&b.0))?;
    let normal = if normal.dot(ray.direction) > 0.0 { -normal } else { normal };
    Some(PickHit { object, point_m: ray.at(distance_m), normal, distance_m })
}

/// Distance, m, and normal of the nearest triangle that a ray hits.
fn hit_of_part(scene: &Scene, part: &Part, ray: &ViewRay) -> Option<(f64, DVec3)> {
    let mesh = scene.meshes.get(part.mesh)?;
    let mesh_from_world = part.world_from_mesh.inverse();
    // Not normalised, so that distances along it are the world's.
    let (origin, along) =
        (mesh_from_world.transform_point3(ray.origin_m), mesh_from_world.transform_vector3(ray.direction));
    let corner = |i: u32| DVec3::from(mesh.vertices[i as usize].position.map(f64::from));
    let triangles = mesh.indices.chunks_exact(3).map(|t| [corner(t[0]), corner(t[1]), corner(t[2])]);
    let hits = triangles.filter_map(|triangle| Some((intersect(origin, along, triangle)?, triangle)));
    let (distance_m, [a, b, c]) = hits.min_by(|a, b| a.0.total_cmp(&b.0))?;
    // Normals transform by the inverse transpose.
    let normal = mesh_from_world.matrix3.transpose() * (b - a).cross(c - a);
    Some((distance_m, normal.normalize_or_zero()))
}

/// Distance along a ray to a triangle (Möller and Trumbore 1997); `None` without an intersection.
fn intersect(origin: DVec3, along: DVec3, [a, b, c]: [DVec3; 3]) -> Option<f64> {
    let (ab, ac) = (b - a, c - a);
    let p = along.cross(ac);
    let scale = ab.dot(p).recip();
    let from_a = origin - a;
    let u = from_a.dot(p) * scale;
    let q = from_a.cross(ab);
    let v = along.dot(q) * scale;
    let distance = ac.dot(q) * scale;
    // NaN if the ray lies in the triangle's plane.
    (u >= 0.0 && v >= 0.0 && u + v <= 1.0 && distance > 0.0).then_some(distance)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Mesh, Vertex};
    use glam::{DAffine3, DQuat};

    #[test]
    fn ray_hits_the_nearest_triangle_of_translated_and_mirrored_objects() {
        let vertex = |x: f32, y: f32| Vertex { position: [x, y, 0.0], ..bytemuck::Zeroable::zeroed() };
        let mesh = Mesh {
            vertices: vec![vertex(0.0, 0.0), vertex(1.0, 0.0), vertex(0.0, 1.0)],
            indices: vec![0, 1, 2],
            material: 0,
        };
        let object =
            |world_from_mesh: DAffine3| Object { parts: vec![Part { mesh: 0, world_from_mesh }], ..Object::default() };
        let at = |x: f64, y: f64, z: f64| DAffine3::from_translation(DVec3::new(x, y, z));
        let turned = DAffine3::from_scale_rotation_translation(
            DVec3::new(-2.0, 3.0, 1.0),
            DQuat::from_rotation_z(0.0),
            DVec3::new(0.0, 0.0, 4.0),
        );
        let scene = Scene {
            meshes: vec![mesh.into()],
            objects: vec![object(at(0.0, 0.0, 5.0)), object(turned), Object::default()],
            ..Scene::default()
        };
        let ray = |x: f64, y: f64| ViewRay { origin_m: DVec3::new(x, y, 1.0), direction: DVec3::Z };
        // The first object alone extends to the right, the mirrored one to the left and farther up.
        let hit = nearest(&scene, &ray(0.25, 0.25)).unwrap();
        assert_eq!((hit.object, hit.point_m, hit.distance_m), (0, DVec3::new(0.25, 0.25, 5.0), 4.0));
        assert_eq!(hit.normal, DVec3::NEG_Z);
        let hit = nearest(&scene, &ray(-0.5, 1.5)).unwrap();
        assert!(hit.object == 1 && (hit.distance_m - 3.0).abs() < 1e-12 && hit.normal.z < -0.999, "{hit:?}");
        // Beside both objects, and in front of both.
        assert_eq!(nearest(&scene, &ray(0.6, 0.6)), None);
        assert_eq!(nearest(&scene, &ViewRay { origin_m: DVec3::new(0.25, 0.25, 6.0), direction: DVec3::Z }), None);
        // In the triangle's plane.
        assert_eq!(nearest(&scene, &ViewRay { origin_m: DVec3::new(-1.0, 0.2, 5.0), direction: DVec3::X }), None);
    }
}
