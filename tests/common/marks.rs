//! Unlit objects in vertex colours, in known directions from the origin.

#![allow(dead_code, reason = "each test file uses some of it")]

use glam::{DAffine3, DVec3, Vec3};
use locard::scene::{Material, Mesh, Object, Part, Scene, Vertex};

pub fn vertex(position: DVec3, color: Vec3) -> Vertex {
    Vertex {
        position: position.as_vec3().to_array(),
        normal: [0.0, 0.0, 1.0],
        tangent: [0.0; 4],
        uv0: [0.0; 2],
        uv1: [0.0; 2],
        color: color.extend(1.0).to_array(),
    }
}

pub fn unlit(vertices: Vec<Vertex>, indices: Vec<u32>) -> Scene {
    Scene {
        meshes: vec![Mesh { vertices, indices, material: 0 }.into()],
        materials: vec![Material { unlit: true, double_sided: true, ..Material::default() }],
        objects: vec![Object {
            name: "marks".to_owned(),
            parts: vec![Part { mesh: 0, world_from_mesh: DAffine3::IDENTITY }],
            ..Object::default()
        }],
        ..Scene::default()
    }
}

/// Squares of one grey in these directions that face the origin from 2 m and extend by `half_m` to
/// each side.
pub fn marks(directions: &[DVec3], half_m: f64, grey: f32) -> Scene {
    let (mut vertices, mut indices) = (Vec::new(), Vec::new());
    for d in directions {
        let d = d.normalize();
        let (x, y) = d.any_orthonormal_pair();
        let first = vertices.len() as u32;
        for (a, b) in [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)] {
            vertices.push(vertex(2.0 * d + half_m * (a * x + b * y), Vec3::splat(grey)));
        }
        indices.extend([0, 1, 2, 0, 2, 3].map(|i| first + i));
    }
    unlit(vertices, indices)
}
