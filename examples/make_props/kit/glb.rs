//! A GLB file from shapes, materials and pictures (glTF 2.0, section 4.4).

use image::ImageEncoder;
use serde_json::{Value, json};

use super::canvas::Canvas;
use super::shape::Shape;

/// A prop: shapes, each with a material, and the pictures that materials name by their index.
pub struct Prop {
    pub name: &'static str,
    pub pictures: Vec<Canvas>,
    /// True if textures repeat beyond their edges.
    pub repeat: bool,
    /// glTF materials.
    pub materials: Vec<Value>,
    /// Shapes and the index of their material.
    pub shapes: Vec<(Shape, usize)>,
}

impl Prop {
    pub fn to_glb(&self) -> anyhow::Result<Vec<u8>> {
        let mut bin = Binary::default();
        let mut primitives = Vec::new();
        for (shape, material) in &self.shapes {
            let count = shape.positions.len();
            let position = bin.accessor(&floats(shape.positions.as_flattened()), count, "VEC3", 5126);
            let (low, high) = shape.bounds();
            bin.accessors[position]["min"] = json!(low.to_array());
            bin.accessors[position]["max"] = json!(high.to_array());
            let normal = bin.accessor(&floats(shape.normals.as_flattened()), count, "VEC3", 5126);
            let uv = bin.accessor(&floats(shape.uvs.as_flattened()), count, "VEC2", 5126);
            let indices: Vec<u8> = shape.indices.iter().flat_map(|i| i.to_le_bytes()).collect();
            let indices = bin.accessor(&indices, shape.indices.len(), "SCALAR", 5123);
            primitives.push(json!({
                "attributes": { "POSITION": position, "NORMAL": normal, "TEXCOORD_0": uv },
                "indices": indices, "material": material,
            }));
        }
        let mut images = Vec::new();
        for picture in &self.pictures {
            let mut png = Vec::new();
            image::codecs::png::PngEncoder::new_with_quality(
                &mut png,
                image::codecs::png::CompressionType::Best,
                image::codecs::png::FilterType::Adaptive,
            )
            .write_image(&picture.texels(), picture.width, picture.height, picture.color_type())?;
            images.push(json!({ "bufferView": bin.view(&png), "mimeType": "image/png" }));
        }
        let textures: Vec<_> = (0..images.len()).map(|i| json!({ "source": i, "sampler": 0 })).collect();
        let mut root = json!({
            "asset": { "version": "2.0", "generator": "locard make_props" },
            "scene": 0,
            "scenes": [{ "nodes": [0] }],
            "nodes": [{ "name": self.name, "mesh": 0 }],
            "meshes": [{ "name": self.name, "primitives": primitives }],
            "materials": self.materials,
            "accessors": bin.accessors,
            "bufferViews": bin.views,
            "buffers": [{ "byteLength": bin.bytes.len() }],
        });
        let wrap = if self.repeat { 10497 } else { 33071 };
        if !images.is_empty() {
            root["images"] = json!(images);
            root["textures"] = json!(textures);
            root["samplers"] = json!([{ "wrapS": wrap, "wrapT": wrap, "magFilter": 9729, "minFilter": 9987 }]);
        }
        let mut text = serde_json::to_vec(&root)?;
        text.resize(text.len().next_multiple_of(4), b' ');
        let mut glb = Vec::new();
        glb.extend(b"glTF");
        glb.extend(2u32.to_le_bytes());
        glb.extend(((12 + 8 + text.len() + 8 + bin.bytes.len()) as u32).to_le_bytes());
        for (kind, chunk) in [(b"JSON", &text), (b"BIN\0", &bin.bytes)] {
            glb.extend((chunk.len() as u32).to_le_bytes());
            glb.extend(kind);
            glb.extend(chunk);
        }
        Ok(glb)
    }
}

/// A metal, of which the picture 0 modulates the roughness.
pub fn metal(name: &str, color: [f32; 3], roughness: f32) -> Value {
    json!({
        "name": name,
        "pbrMetallicRoughness": {
            "baseColorFactor": [color[0], color[1], color[2], 1.0],
            "metallicFactor": 1.0, "roughnessFactor": roughness,
            "metallicRoughnessTexture": { "index": 0 },
        },
    })
}

/// A material of one colour, linear.
pub fn plain(name: &str, color: [f32; 3], metallic: f32, roughness: f32) -> Value {
    json!({
        "name": name,
        "pbrMetallicRoughness": {
            "baseColorFactor": [color[0], color[1], color[2], 1.0],
            "metallicFactor": metallic, "roughnessFactor": roughness,
        },
    })
}

/// A dielectric that shows the picture 0.
pub fn printed(name: &str, roughness: f64) -> Value {
    json!({
        "name": name,
        "pbrMetallicRoughness": {
            "baseColorTexture": { "index": 0 }, "metallicFactor": 0.0, "roughnessFactor": roughness,
        },
    })
}

#[derive(Default)]
struct Binary {
    bytes: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
}

impl Binary {
    fn view(&mut self, bytes: &[u8]) -> usize {
        self.views.push(json!({ "buffer": 0, "byteOffset": self.bytes.len(), "byteLength": bytes.len() }));
        self.bytes.extend(bytes);
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        self.views.len() - 1
    }

    fn accessor(&mut self, bytes: &[u8], count: usize, kind: &str, component: u32) -> usize {
        let view = self.view(bytes);
        self.accessors.push(json!({ "bufferView": view, "componentType": component, "count": count, "type": kind }));
        self.accessors.len() - 1
    }
}

fn floats(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}
