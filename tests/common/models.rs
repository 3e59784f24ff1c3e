//! Small handwritten glTF files.

#![allow(dead_code, reason = "each test file uses some of it")]

use std::path::Path;

use locard::scene::{Scene, SceneError, load};
use serde_json::{Value, json};

/// A GLB container around a JSON and a binary chunk.
pub fn glb(json: &Value, bin: &[u8]) -> Vec<u8> {
    let mut text = serde_json::to_vec(json).unwrap();
    text.resize(text.len().next_multiple_of(4), b' ');
    let mut bin = bin.to_vec();
    bin.resize(bin.len().next_multiple_of(4), 0);
    let mut out = b"glTF".to_vec();
    out.extend(2u32.to_le_bytes());
    out.extend(((28 + text.len() + bin.len()) as u32).to_le_bytes());
    for (kind, chunk) in [(b"JSON", &text), (b"BIN\0", &bin)] {
        out.extend((chunk.len() as u32).to_le_bytes());
        out.extend(kind);
        out.extend(chunk);
    }
    out
}

/// A file under construction.
pub struct Model {
    pub json: Value,
    pub bin: Vec<u8>,
}

impl Model {
    /// One triangle, (0, 0, 0), (2, 0, 0), (0, 1, 0), indexed. Accessor 0 has its positions,
    /// accessor 1 its indices.
    pub fn triangle() -> Self {
        let mut model = Self {
            json: json!({
                "asset": { "version": "2.0" },
                "scenes": [{ "nodes": [0] }],
                "nodes": [{ "mesh": 0 }],
                "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 }, "indices": 1 }] }],
                "accessors": [], "bufferViews": [], "buffers": [{ "byteLength": 0 }],
            }),
            bin: Vec::new(),
        };
        model.floats("VEC3", &[0.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 1.0, 0.0]);
        model.accessor(5123, "SCALAR", 3, &[0, 0, 1, 0, 2, 0]);
        model
    }

    /// Adds bytes as a buffer view and returns its index.
    pub fn view(&mut self, bytes: &[u8]) -> usize {
        let view = json!({ "buffer": 0, "byteOffset": self.bin.len(), "byteLength": bytes.len() });
        self.bin.extend(bytes);
        self.bin.resize(self.bin.len().next_multiple_of(4), 0);
        self.json["buffers"][0]["byteLength"] = json!(self.bin.len());
        push(&mut self.json["bufferViews"], view)
    }

    pub fn accessor(&mut self, component: u32, shape: &str, count: usize, bytes: &[u8]) -> usize {
        let view = self.view(bytes);
        let accessor = json!({ "bufferView": view, "componentType": component, "type": shape, "count": count });
        push(&mut self.json["accessors"], accessor)
    }

    pub fn floats(&mut self, shape: &str, values: &[f32]) -> usize {
        let width = match shape {
            "VEC2" => 2,
            "VEC3" => 3,
            "VEC4" => 4,
            _ => 1,
        };
        let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        self.accessor(5126, shape, values.len() / width, &bytes)
    }

    pub fn primitive(&mut self) -> &mut Value {
        &mut self.json["meshes"][0]["primitives"][0]
    }

    /// Adds a material with a base-colour texture and texture coordinates to the triangle.
    pub fn textured(&mut self, picture: &[u8]) {
        let view = self.view(picture);
        self.json["images"] = json!([{ "bufferView": view, "mimeType": "image/png" }]);
        self.json["textures"] = json!([{ "source": 0 }]);
        self.json["materials"] = json!([{ "pbrMetallicRoughness": { "baseColorTexture": { "index": 0 } } }]);
        let uv = self.floats("VEC2", &[0.0, 1.0, 1.0, 1.0, 0.0, 0.0]);
        self.primitive()["attributes"]["TEXCOORD_0"] = json!(uv);
        self.primitive()["material"] = json!(0);
    }

    pub fn glb(&self) -> Vec<u8> {
        glb(&self.json, &self.bin)
    }

    /// Writes the file to a temporary folder and loads it.
    pub fn load(&self) -> Result<Scene, SceneError> {
        load_bytes("model.glb", &self.glb())
    }

    /// The first mesh's positions in the world, in the order of its indices.
    pub fn corners(&self) -> Vec<[f64; 3]> {
        corners(&self.load().unwrap())
    }
}

fn push(list: &mut Value, item: Value) -> usize {
    if list.is_null() {
        *list = json!([]);
    }
    let list = list.as_array_mut().unwrap();
    list.push(item);
    list.len() - 1
}

pub fn load_bytes(name: &str, bytes: &[u8]) -> Result<Scene, SceneError> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    std::fs::write(&path, bytes).unwrap();
    load(&path, None)
}

/// Writes `scene.toml` beside `triangle.glb` and loads it.
pub fn load_scene(text: &str) -> Result<Scene, SceneError> {
    let folder = tempfile::tempdir().unwrap();
    write_triangle(folder.path());
    let path = folder.path().join("scene.toml");
    std::fs::write(&path, text).unwrap();
    load(&path, None)
}

pub fn write_triangle(folder: &Path) {
    std::fs::write(folder.join("triangle.glb"), Model::triangle().glb()).unwrap();
}

/// The positions of all triangles' corners in the world, rounded to a micrometre.
pub fn corners(scene: &Scene) -> Vec<[f64; 3]> {
    let parts = scene.objects.iter().flat_map(|o| &o.parts);
    let point = |part: &locard::scene::Part, i: u32| {
        let position = scene.meshes[part.mesh].vertices[i as usize].position;
        let p = part.world_from_mesh.transform_point3(glam::Vec3::from(position).as_dvec3());
        ((p * 1e6).round() / 1e6 + 0.0).to_array()
    };
    parts.flat_map(|part| scene.meshes[part.mesh].indices.iter().map(move |&i| point(part, i))).collect()
}

/// A PNG whose header states this size; its pixel data are invalid.
pub fn png_header(width: u32, height: u32) -> Vec<u8> {
    let mut out = b"\x89PNG\r\n\x1a\n".to_vec();
    let mut header = [width.to_be_bytes(), height.to_be_bytes()].concat();
    header.extend([8, 2, 0, 0, 0]);
    for (kind, body) in [(b"IHDR", header), (b"IDAT", vec![0; 8])] {
        out.extend((body.len() as u32).to_be_bytes());
        let checked = [kind.as_slice(), &body].concat();
        out.extend(&checked);
        out.extend(crc32(&checked).to_be_bytes());
    }
    out
}

/// CRC-32 of ISO 3309, as in annex D of the PNG specification.
fn crc32(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(!0u32, |crc, &byte| {
        (0..8).fold(crc ^ u32::from(byte), |c, _| if c & 1 == 1 { (c >> 1) ^ 0xedb8_8320 } else { c >> 1 })
    })
}

pub fn png(width: u32, height: u32, rgba: &[u8]) -> Vec<u8> {
    use image::ImageEncoder;
    let mut out = Vec::new();
    let encoder = image::codecs::png::PngEncoder::new(&mut out);
    encoder.write_image(rgba, width, height, image::ExtendedColorType::Rgba8).unwrap();
    out
}
