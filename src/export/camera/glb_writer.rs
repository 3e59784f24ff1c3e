//! The buffer of a glTF file and its accessors, and the binary container (glTF 2.0, section 4.4).

use serde_json::{Value, json};

/// `componentType` of 32-bit floats and of 32-bit indices.
const FLOAT: u32 = 5126;
const UNSIGNED_INT: u32 = 5125;

/// A buffer in construction.
#[derive(Debug, Default)]
pub struct GlbBuffer {
    bytes: Vec<u8>,
    pub views: Vec<Value>,
    pub accessors: Vec<Value>,
}

impl GlbBuffer {
    /// Adds bytes. Returns the index of their buffer view.
    pub fn view(&mut self, bytes: &[u8]) -> usize {
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        self.views.push(json!({ "buffer": 0, "byteOffset": self.bytes.len(), "byteLength": bytes.len() }));
        self.bytes.extend(bytes);
        self.views.len() - 1
    }

    /// Adds an accessor of vectors, with their bounds. Returns its index.
    pub fn floats<const N: usize>(&mut self, values: &[[f32; N]]) -> usize {
        let view = self.view(bytemuck::cast_slice(values));
        let bound = |pick: fn(f32, f32) -> f32, from: f32| -> Vec<f32> {
            (0..N).map(|i| values.iter().map(|value| value[i]).fold(from, pick)).collect()
        };
        let kind = ["SCALAR", "VEC2", "VEC3", "VEC4"][N - 1];
        self.accessors.push(json!({
            "bufferView": view, "componentType": FLOAT, "count": values.len(), "type": kind,
            "min": bound(f32::min, f32::INFINITY), "max": bound(f32::max, f32::NEG_INFINITY),
        }));
        self.accessors.len() - 1
    }

    pub fn indices(&mut self, indices: &[u32]) -> usize {
        let view = self.view(bytemuck::cast_slice(indices));
        self.accessors.push(json!({
            "bufferView": view, "componentType": UNSIGNED_INT, "count": indices.len(), "type": "SCALAR",
        }));
        self.accessors.len() - 1
    }

    /// The file's bytes. The document's buffer, views and accessors are set here.
    pub fn container(mut self, mut document: Value) -> Vec<u8> {
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        document["buffers"] = json!([{ "byteLength": self.bytes.len() }]);
        document["bufferViews"] = self.views.into();
        document["accessors"] = self.accessors.into();
        let mut json = document.to_string().into_bytes();
        json.resize(json.len().next_multiple_of(4), b' ');
        let length = 12 + 8 + json.len() + 8 + self.bytes.len();
        let mut file = Vec::with_capacity(length);
        file.extend(b"glTF");
        file.extend(2u32.to_le_bytes());
        file.extend((length as u32).to_le_bytes());
        for (kind, chunk) in [(b"JSON", &json), (b"BIN\0", &self.bytes)] {
            file.extend((chunk.len() as u32).to_le_bytes());
            file.extend(kind);
            file.extend(chunk);
        }
        file
    }
}
