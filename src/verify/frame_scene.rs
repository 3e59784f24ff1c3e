//! A frame as a virtual object: a mesh of its depth, textured with its picture.
//!
//! Composited into a nearby frame by the whole pipeline, it must coincide with the real picture.
//! Each row is placed by its own pose. The mesh has holes at depth discontinuities and where depth
//! is unknown.

use std::sync::Arc;

use glam::{DAffine3, DVec2, DVec3};

use crate::camera::{Curve, Response};
use crate::depth::reprojected_at_frame;
use crate::frame::{Frame, SpatialGain};
use crate::pose::Pose;
use crate::scene::{Material, Mesh, Object, Part, Scene, SceneTexture, TextureUse, Vertex, Wrap};
use crate::shot::Shot;

/// Distance between vertices, px.
const VERTEX_STEP_PX: u32 = 2;
/// Largest relative depth difference within a cell of the mesh.
const MAX_DEPTH_STEP: f32 = 0.03;
const MIN_DEPTH_M: f32 = 0.1;
/// Shortest distance along the optical axis of [`without_near_triangles`], m.
const MIN_DISTANCE_M: f64 = 0.2;

/// The scene of a frame; `None` without depth, pose or camera.
pub fn frame_scene(shot: &Shot, frame: &Frame) -> Option<Scene> {
    let geometry = shot.geometry_at(frame.index).ok()?;
    let recording = &shot.recording;
    let time_s = frame.timestamp_s;
    let depth = frame.depth.as_ref()?;
    let depth = reprojected_at_frame(&geometry, depth, &recording.track, time_s)?;
    let (width, height) = (frame.pixels.width, frame.pixels.height);
    let (columns, rows) = (width.div_ceil(VERTEX_STEP_PX), height.div_ceil(VERTEX_STEP_PX));
    let mut vertices = Vec::with_capacity((columns * rows) as usize);
    let mut depths = Vec::with_capacity(vertices.capacity());
    // Divided by the frame's gain, and by its gain within the picture.
    let brightness = frame.exposure.brightness;
    let [red, green, blue] =
        brightness.map_or([1.0; 3], |brightness| brightness.factors.map(|factor| 1.0 / factor as f32));
    let across = brightness.map_or(SpatialGain::default(), |brightness| brightness.spatial_gain);
    for y in (0..height).step_by(VERTEX_STEP_PX as usize) {
        let row_px = f64::from(y) + 0.5;
        let pose = recording.track.at(time_s + geometry.row_time_s(row_px)).ok()?;
        for x in (0..width).step_by(VERTEX_STEP_PX as usize) {
            let at = DVec2::new(f64::from(x) + 0.5, row_px);
            let z = depth[(y * width + x) as usize];
            let ray = geometry.depth_ray(at).filter(|_| z > MIN_DEPTH_M);
            let position = ray.map(|ray| pose.inverse_transform_point(f64::from(z) * ray));
            depths.push(if position.is_some() { z } else { 0.0 });
            let uv0 = [(at.x / f64::from(width)) as f32, (at.y / f64::from(height)) as f32];
            let usual = (-across.at(uv0)).exp2();
            vertices.push(Vertex {
                position: position.unwrap_or_default().as_vec3().to_array(),
                normal: [0.0, 0.0, 1.0],
                tangent: [0.0; 4],
                uv0,
                uv1: [0.0; 2],
                color: [usual, usual, usual, 1.0],
            });
        }
    }
    let mut indices = Vec::new();
    for (y, x) in (0..rows - 1).flat_map(|y| (0..columns - 1).map(move |x| (y, x))) {
        let corners = [y * columns + x, y * columns + x + 1, (y + 1) * columns + x, (y + 1) * columns + x + 1];
        let z = corners.map(|corner| depths[corner as usize]);
        let (low, high) = (z.into_iter().fold(f32::MAX, f32::min), z.into_iter().fold(0.0, f32::max));
        if low > 0.0 && high - low < MAX_DEPTH_STEP * low {
            let [a, b, c, d] = corners;
            indices.extend([a, c, b, b, c, d]);
        }
    }
    let used = TextureUse { texture: 0, uv_set: 0, transform: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]] };
    let material = Material {
        name: "picture".to_owned(),
        base_color: [red, green, blue, 1.0],
        double_sided: true,
        unlit: true,
        base_color_texture: Some(used),
        ..Material::default()
    };
    let object = Object {
        name: format!("frame {}", frame.index),
        parts: vec![Part { mesh: 0, world_from_mesh: DAffine3::IDENTITY }],
        ..Object::default()
    };
    Some(Scene {
        meshes: vec![Arc::new(Mesh { vertices, indices, material: 0 })],
        materials: vec![material],
        textures: vec![picture(frame, &shot.camera().response)],
        objects: vec![object],
        ..Scene::default()
    })
}

/// Removes triangles nearer to a camera than `MIN_DISTANCE_M` along its optical axis, or behind it.
/// Depth cameras measure nothing there, and the motion blur of such triangles would span the
/// picture. For pictures that fit a plane.
pub fn without_near_triangles(mut scene: Scene, camera_from_world: &Pose) -> Scene {
    for mesh in &mut scene.meshes {
        let mesh = Arc::make_mut(mesh);
        let is_far = |i: &u32| {
            let position = mesh.vertices[*i as usize].position;
            camera_from_world.transform_point(DVec3::from_array(position.map(f64::from))).z > MIN_DISTANCE_M
        };
        mesh.indices = mesh
            .indices
            .as_chunks::<3>()
            .0
            .iter()
            .filter(|corners| corners.iter().all(is_far))
            .flatten()
            .copied()
            .collect();
    }
    scene
}

/// The frame's light, encoded as a texture.
fn picture(frame: &Frame, response: &Response) -> SceneTexture {
    let textures = Response { curve: Curve::Srgb, ..Response::default() };
    let code = |code: u32| (255.0 * textures.encode(response.decode(f64::from(code) / 255.0))).round() as u8;
    let table: Vec<u8> = (0..256).map(code).collect();
    let codes = frame.pixels.codes.to_eight_bit();
    let rgba = codes.as_chunks::<3>().0.iter().flat_map(|rgb| {
        let [r, g, b] = rgb.map(|code| table[usize::from(code)]);
        [r, g, b, 255]
    });
    SceneTexture {
        width: frame.pixels.width,
        height: frame.pixels.height,
        rgba: Arc::new(rgba.collect()),
        srgb: true,
        wrap: [Wrap::Clamp; 2],
        smooth: true,
        mipmaps: false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn triangles_close_to_the_camera_are_removed() {
        let at = |z: f32| Vertex { position: [0.0, 0.0, z], ..bytemuck::Zeroable::zeroed() };
        let vertices = [-1.0, 0.1, 0.3, 2.0].map(at).to_vec();
        let mesh = Mesh { vertices, indices: vec![2, 3, 2, 1, 2, 3, 0, 3, 2, 3, 3, 2], material: 0 };
        let scene = Scene { meshes: vec![Arc::new(mesh)], ..Scene::default() };
        assert_eq!(without_near_triangles(scene, &Pose::IDENTITY).meshes[0].indices, [2, 3, 2, 3, 3, 2]);
    }
}
