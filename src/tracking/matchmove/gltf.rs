//! An animated camera of a glTF file (2.0): the first node with a camera, with the transforms of
//! its parents. Times are seconds. Skins, morph targets and extensions are not read.

use std::path::Path;

use glam::{DAffine3, DMat4, DQuat, DVec3};
use serde_json::Value;

use super::animated_camera::{AnimatedCamera, CameraKeyframe, KeyframeClock};
use super::axes::CameraPlacement;
use super::gltf_buffers::{GltfAnimationFile, index};
use super::keyframes::{KeyframeSamples, ascending, lerp, slerp};
use crate::tracking::records::TextError;

pub fn read(path: &Path) -> Result<AnimatedCamera, TextError> {
    let file = GltfAnimationFile::read(path)?;
    camera(&file).map_err(|problem| TextError::line(path, 1, problem))
}

/// A node's transform over time.
struct NodeTransform {
    translation: KeyframeSamples<DVec3>,
    rotation: KeyframeSamples<DQuat>,
    scale: KeyframeSamples<DVec3>,
}

fn numbers<const N: usize>(value: &Value) -> Option<[f64; N]> {
    let numbers: Option<Vec<f64>> = value.as_array()?.iter().map(Value::as_f64).collect();
    numbers?.try_into().ok()
}

impl NodeTransform {
    /// The transform at rest.
    fn of(node: &Value) -> Self {
        let (mut scale, mut rotation, mut translation) = (DVec3::ONE, DQuat::IDENTITY, DVec3::ZERO);
        if let Some(matrix) = numbers::<16>(&node["matrix"]) {
            (scale, rotation, translation) = DMat4::from_cols_array(&matrix).to_scale_rotation_translation();
        }
        if let Some(numbers) = numbers(&node["translation"]) {
            translation = DVec3::from_array(numbers);
        }
        if let Some([x, y, z, w]) = numbers(&node["rotation"]) {
            rotation = DQuat::from_xyzw(x, y, z, w);
        }
        if let Some(numbers) = numbers(&node["scale"]) {
            scale = DVec3::from_array(numbers);
        }
        Self {
            translation: KeyframeSamples::constant(translation),
            rotation: KeyframeSamples::constant(rotation),
            scale: KeyframeSamples::constant(scale),
        }
    }

    fn animate(&mut self, file: &GltfAnimationFile, path: &str, sampler: &Value) -> Result<(), String> {
        let accessor =
            |name: &str| index(&sampler[name]).ok_or_else(|| format!("an animation's sampler has no {name}"));
        let times: Vec<f64> = file.floats::<1>(accessor("input")?)?.into_iter().map(|[time]| time).collect();
        if times.windows(2).any(|pair| pair[0] >= pair[1]) {
            return Err("the times of an animation do not ascend".to_owned());
        }
        let interpolation = sampler["interpolation"].as_str().unwrap_or("LINEAR");
        let is_cubic = interpolation == "CUBICSPLINE";
        let output = accessor("output")?;
        match path {
            "translation" => self.translation = samples(&times, file.floats(output)?, is_cubic, DVec3::from_array)?,
            "scale" => self.scale = samples(&times, file.floats(output)?, is_cubic, DVec3::from_array)?,
            "rotation" => self.rotation = samples(&times, file.floats(output)?, is_cubic, DQuat::from_array)?,
            _ => {}
        }
        let is_stepped = interpolation == "STEP";
        match path {
            "translation" => self.translation.is_stepped = is_stepped,
            "scale" => self.scale.is_stepped = is_stepped,
            "rotation" => self.rotation.is_stepped = is_stepped,
            _ => {}
        }
        Ok(())
    }

    fn times(&self) -> impl Iterator<Item = f64> {
        self.translation.times().chain(self.rotation.times()).chain(self.scale.times())
    }

    fn at(&self, time_s: f64) -> DAffine3 {
        let rotation = self.rotation.at(time_s, slerp).unwrap_or(DQuat::IDENTITY);
        DAffine3::from_scale_rotation_translation(
            self.scale.at(time_s, lerp).unwrap_or(DVec3::ONE),
            if rotation.length_squared() > 0.0 { rotation.normalize() } else { DQuat::IDENTITY },
            self.translation.at(time_s, lerp).unwrap_or(DVec3::ZERO),
        )
    }
}

/// Samples with one value per time. Of a cubic spline, which has tangents, the values at its keys.
fn samples<const N: usize, T>(
    times: &[f64],
    values: Vec<[f64; N]>,
    is_cubic: bool,
    convert: impl Fn([f64; N]) -> T,
) -> Result<KeyframeSamples<T>, String> {
    let values: Vec<[f64; N]> = if is_cubic { values.into_iter().skip(1).step_by(3).collect() } else { values };
    if values.len() != times.len() {
        return Err(format!("an animation has {} times and {} values", times.len(), values.len()));
    }
    Ok(KeyframeSamples {
        keys: times.iter().copied().zip(values.into_iter().map(convert)).collect(),
        is_stepped: false,
    })
}

fn camera(file: &GltfAnimationFile) -> Result<AnimatedCamera, String> {
    let json = &file.json;
    let nodes = json["nodes"].as_array().map_or(&[][..], Vec::as_slice);
    let mut with_camera = nodes.iter().enumerate().filter(|(_, node)| !node["camera"].is_null()).map(|(n, _)| n);
    let first =
        with_camera.next().ok_or("has no node with a camera; export with cameras (Blender: Include > Cameras)")?;
    let others = with_camera.count();
    let parent_of = |child: usize| {
        let is_parent = |node: &Value| {
            node["children"].as_array().is_some_and(|children| children.iter().any(|n| index(n) == Some(child)))
        };
        nodes.iter().position(is_parent)
    };
    let mut chain = vec![first];
    while let Some(parent) = chain.last().copied().and_then(parent_of) {
        if chain.contains(&parent) {
            return Err(format!("nodes[{parent}] is its own descendant"));
        }
        chain.push(parent);
    }
    let mut transforms: Vec<NodeTransform> = chain.iter().map(|n| NodeTransform::of(&nodes[*n])).collect();
    for animation in json["animations"].as_array().into_iter().flatten() {
        for channel in animation["channels"].as_array().into_iter().flatten() {
            let node = index(&channel["target"]["node"]);
            let Some(place) = chain.iter().position(|n| Some(*n) == node) else { continue };
            let sampler = index(&channel["sampler"]).map_or(&Value::Null, |sampler| &animation["samplers"][sampler]);
            let path = channel["target"]["path"].as_str().unwrap_or_default();
            transforms[place].animate(file, path, sampler)?;
        }
    }
    let times = ascending(transforms.iter().flat_map(NodeTransform::times));
    if times.is_empty() {
        return Err(format!("the camera of nodes[{first}] is not animated; export with animations"));
    }
    let mut keyframes = Vec::with_capacity(times.len());
    for at in times {
        let placed = transforms.iter().fold(DAffine3::IDENTITY, |inner, outer| outer.at(at) * inner);
        let placement = CameraPlacement::of_transform(placed)
            .ok_or_else(|| format!("the camera's transform at {at} s is mirrored, sheared or not finite"))?;
        keyframes.push(CameraKeyframe { at, placement });
    }
    let warnings = (others > 0).then(|| format!("the first of {} cameras is read", others + 1));
    Ok(AnimatedCamera {
        clock: KeyframeClock::Seconds,
        keyframes,
        up: DVec3::Y,
        warnings: warnings.into_iter().collect(),
    })
}

#[cfg(test)]
mod tests {
    use base64::Engine;
    use base64::engine::general_purpose::STANDARD;
    use serde_json::json;

    use super::*;

    /// A camera whose parent moves 2 m along x from 0 s to 2 s.
    fn document() -> Value {
        let floats: Vec<u8> =
            [0.0f32, 2.0, 0.0, 0.0, 0.0, 2.0, 0.0, 0.0].iter().flat_map(|v| v.to_le_bytes()).collect();
        json!({
            "asset": { "version": "2.0" },
            "nodes": [{ "children": [1] }, { "camera": 0, "translation": [0, 1, 0] }],
            "cameras": [{ "type": "perspective", "perspective": { "yfov": 1.0, "znear": 0.01 } }],
            "buffers": [{ "byteLength": 32, "uri": format!("data:application/octet-stream;base64,{}", STANDARD.encode(floats)) }],
            "bufferViews": [{ "buffer": 0, "byteLength": 8 }, { "buffer": 0, "byteOffset": 8, "byteLength": 24 }],
            "accessors": [
                { "bufferView": 0, "componentType": 5126, "count": 2, "type": "SCALAR" },
                { "bufferView": 1, "componentType": 5126, "count": 2, "type": "VEC3" },
            ],
            "animations": [{
                "samplers": [{ "input": 0, "output": 1 }],
                "channels": [{ "sampler": 0, "target": { "node": 0, "path": "translation" } }],
            }],
        })
    }

    fn read_json(json: &Value) -> Result<AnimatedCamera, String> {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("a.gltf");
        std::fs::write(&file, json.to_string()).unwrap();
        read(&file).map_err(|error| error.to_string())
    }

    #[test]
    fn camera_moves_with_its_animated_parent() {
        let camera = read_json(&document()).unwrap();
        assert_eq!((camera.clock, camera.up), (KeyframeClock::Seconds, DVec3::Y));
        let places: Vec<_> = camera.keyframes.iter().map(|key| (key.at, key.placement.position_m)).collect();
        assert_eq!(places, [(0.0, DVec3::new(0.0, 1.0, 0.0)), (2.0, DVec3::new(2.0, 1.0, 0.0))]);
    }

    #[test]
    fn unusable_files_are_refused() {
        let changes: [(&str, Value, &str); 6] = [
            ("/nodes/1/camera", Value::Null, "has no node with a camera"),
            ("/animations", Value::Null, "the camera of nodes[1] is not animated"),
            ("/bufferViews/1/byteLength", json!(24), ""),
            ("/accessors/1/count", json!(3), "accessors[1] lies outside its buffer"),
            ("/accessors/1/componentType", json!(5123), "accessors[1] is not VEC3 of 32-bit floats"),
            ("/buffers/0/uri", json!("../a.bin"), "buffers[0].uri is ../a.bin; expected a file beside it"),
        ];
        for (pointer, value, expected) in changes {
            let mut json = document();
            *json.pointer_mut(pointer).unwrap() = value;
            match read_json(&json) {
                Ok(_) => assert!(expected.is_empty(), "{pointer}"),
                Err(error) => assert!(!expected.is_empty() && error.contains(expected), "{error}"),
            }
        }
        let mut json = document();
        json["nodes"][1]["children"] = json!([0]);
        assert!(read_json(&json).unwrap_err().contains("is its own descendant"));
    }
}
