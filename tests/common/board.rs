//! A flat board in front of the camera, for which each pixel can be computed by hand.

#![allow(dead_code, reason = "each test file uses some of it")]

use glam::{DAffine3, DQuat, DVec3};
use locard::pose::Pose;
use locard::scene::{Environment, Lighting, Material, Mesh, Object, Part, Scene, Vertex};
use locard::tracking::PoseTrack;

pub const DEPTH_M: f64 = 2.0;
pub const FOCAL_PX: f64 = 500.0;

/// An unlit board of one grey (linear light) that faces the camera, between two corners, px from
/// the middle of the picture.
pub fn panel(from_px: [f64; 2], to_px: [f64; 2], grey: f32) -> Scene {
    let corner = |x: f64, y: f64, uv0: [f32; 2]| Vertex {
        position: [(x * DEPTH_M / FOCAL_PX) as f32, (y * DEPTH_M / FOCAL_PX) as f32, DEPTH_M as f32],
        normal: [0.0, 0.0, -1.0],
        tangent: [0.0; 4],
        uv0,
        uv1: [0.0; 2],
        color: [1.0; 4],
    };
    Scene {
        meshes: vec![
            Mesh {
                vertices: vec![
                    corner(from_px[0], from_px[1], [0.0, 0.0]),
                    corner(to_px[0], from_px[1], [1.0, 0.0]),
                    corner(to_px[0], to_px[1], [1.0, 1.0]),
                    corner(from_px[0], to_px[1], [0.0, 1.0]),
                ],
                indices: vec![0, 1, 2, 0, 2, 3],
                material: 0,
            }
            .into(),
        ],
        materials: vec![Material {
            base_color: [grey, grey, grey, 1.0],
            unlit: true,
            double_sided: true,
            ..Material::default()
        }],
        objects: vec![Object {
            name: "board".to_owned(),
            parts: vec![Part { mesh: 0, world_from_mesh: DAffine3::IDENTITY }],
            ..Object::default()
        }],
        lighting: Lighting { environment: Environment::Uniform(glam::Vec3::ONE), ..Lighting::default() },
        ..Scene::default()
    }
}

/// A board of one grey that extends by `half_px` to each side of the picture's middle.
pub fn board(half_px: [f64; 2], grey: f32) -> Scene {
    panel(half_px.map(|h| -h), half_px, grey)
}

/// Merges the objects of two scenes. Lighting is that of the first.
pub fn merge_scenes(mut a: Scene, b: Scene) -> Scene {
    let (meshes, materials) = (a.meshes.len(), a.materials.len());
    a.meshes.extend(b.meshes.iter().map(|m| Mesh { material: m.material + materials, ..Mesh::clone(m) }.into()));
    a.materials.extend(b.materials);
    a.objects.extend(b.objects.into_iter().map(|mut object| {
        object.parts.iter_mut().for_each(|part| part.mesh += meshes);
        object
    }));
    a
}

/// A camera that moves sideways so that the board moves at this speed in the picture.
pub fn sideways(px_per_s: [f64; 2]) -> PoseTrack {
    displaced_by(50, 0.01, |t| px_per_s.map(|px| px * t))
}

/// A camera that moves so that the board is displaced by `at_px` at each time, from `steps` steps
/// before time 0 to `steps` steps after it.
pub fn displaced_by(steps: i32, step_s: f64, at_px: impl Fn(f64) -> [f64; 2]) -> PoseTrack {
    let at = |t: f64| {
        let m = at_px(t).map(|px| px * DEPTH_M / FOCAL_PX);
        Pose::from_camera_in_world(DVec3::new(-m[0], -m[1], 0.0), DQuat::IDENTITY)
    };
    PoseTrack::new((-steps..=steps).map(|i| f64::from(i) * step_s).map(|t| (t, at(t))).collect(), 1.0).unwrap()
}
