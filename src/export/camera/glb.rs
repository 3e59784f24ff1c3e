//! A camera as glTF 2.0 in a binary container, with the evidence. Keyframes are at the frames' own
//! times, seconds from the recording's first frame on.

use serde_json::{Value, json};

use super::glb_scene::{self, GlbEvidence};
use super::glb_writer::GlbBuffer;
use super::plate::Plate;
use super::shot_camera::ShotCamera;
use crate::scene::Scene;

/// Near and far plane, metres.
const CLIPPING_M: [f64; 2] = [0.01, 1000.0];

/// The file's bytes.
pub fn write(camera: &ShotCamera, plate: &Plate, name: &str, scene: &Scene) -> Result<Vec<u8>, image::ImageError> {
    let mut buffer = GlbBuffer::default();
    let mut keyframes: Vec<(f32, [f32; 3], [f32; 4])> = Vec::new();
    for (frame, placement) in camera.posed() {
        let time_s = frame.time_s as f32;
        // Frames with equal timestamps share a keyframe.
        if keyframes.last().is_none_or(|before| before.0 < time_s) {
            // Of the two quaternions of a rotation the one near the previous.
            let mut rotation = placement.rotation.as_quat().normalize().to_array();
            let is_far = |before: &[f32; 4]| before.iter().zip(&rotation).map(|(a, b)| a * b).sum::<f32>() < 0.0;
            if keyframes.last().is_some_and(|before| is_far(&before.2)) {
                rotation = rotation.map(|value| -value);
            }
            keyframes.push((time_s, placement.position_m.as_vec3().to_array(), rotation));
        }
    }
    let times = buffer.floats(&keyframes.iter().map(|key| [key.0]).collect::<Vec<_>>());
    let positions = buffer.floats(&keyframes.iter().map(|key| key.1).collect::<Vec<_>>());
    let rotations = buffer.floats(&keyframes.iter().map(|key| key.2).collect::<Vec<_>>());
    let GlbEvidence { nodes, roots, meshes, materials, textures, images, samplers, extensions } =
        glb_scene::write(scene, camera.file_from_world, 1, &mut buffer)?;
    let first = keyframes.first().map_or(json!({}), |key| json!({ "translation": key.1, "rotation": key.2 }));
    let mut camera_node = json!({ "name": "Camera", "camera": 0 });
    camera_node["translation"] = first["translation"].clone();
    camera_node["rotation"] = first["rotation"].clone();
    let lens = &plate.lenses[0];
    let size = plate.size_px() / lens.focal_px;
    let mut document = json!({
        "asset": { "version": "2.0", "generator": "Locard" },
        "scene": 0,
        "scenes": [{ "name": name, "nodes": std::iter::once(0).chain(roots).collect::<Vec<_>>() }],
        "nodes": std::iter::once(camera_node).chain(nodes).collect::<Vec<_>>(),
        "cameras": [{ "name": "Camera", "type": "perspective", "perspective": {
            "yfov": plate.vertical_fov_rad(0),
            "aspectRatio": size.x / size.y,
            "znear": CLIPPING_M[0],
            "zfar": CLIPPING_M[1],
        } }],
        "animations": [{
            "name": "Camera",
            "samplers": [{ "input": times, "output": positions }, { "input": times, "output": rotations }],
            "channels": [
                { "sampler": 0, "target": { "node": 0, "path": "translation" } },
                { "sampler": 1, "target": { "node": 0, "path": "rotation" } },
            ],
        }],
    });
    // An empty list is invalid.
    for (key, list) in [
        ("meshes", meshes),
        ("materials", materials),
        ("textures", textures),
        ("images", images),
        ("samplers", samplers),
        ("extensionsUsed", extensions.into_iter().map(Value::from).collect()),
    ] {
        if !list.is_empty() {
            document[key] = list.into();
        }
    }
    Ok(buffer.container(document))
}
