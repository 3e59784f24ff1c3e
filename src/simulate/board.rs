//! A known object in the site: a flat, textured, self-luminous board.
//!
//! The board is either rendered by the simulation (`board = true`) or exported as glTF and placed
//! into a simulated recording without it. Both must look the same: the simulated board is the
//! reference for registration, blur and noise of the virtual one.

use std::sync::Arc;

use glam::{DVec2, DVec3};
use image::{ExtendedColorType, ImageEncoder, codecs::png::PngEncoder};

use crate::camera::Response;
use crate::scene::{SceneTexture, Wrap};

use super::chart::SiteChart;
use super::shapes::SiteShape;

/// Texels per side; each is 5 mm.
const SIDE: u32 = 64;
/// Texels per side of a pattern square.
const SQUARE: u32 = 8;

/// World position and texture of the board.
#[derive(Clone, Debug)]
pub struct SimulatedBoard {
    /// Upper left, upper right, lower right, lower left as seen from its front; metres, world axes.
    pub corners_in_world_m: [DVec3; 4],
    /// Opaque, sRGB-encoded, smooth, no mipmaps, clamped. Its first row lies along the upper edge.
    pub texture: SceneTexture,
}

/// The board: 0.32 m square, above the origin and leaning back, its front towards the camera in
/// every motion.
pub fn board() -> SimulatedBoard {
    let (left, right) = (DVec3::new(-0.16, -0.04, 0.03), DVec3::new(0.16, -0.04, 0.03));
    let up = DVec3::new(0.0, 0.192, 0.256);
    let texel = |x: u32, y: u32| {
        let (column, row) = (x / SQUARE, y / SQUARE);
        let color: [u8; 3] = match (column, row, (column + row) % 2) {
            (1, 1, _) => [200, 60, 50],
            (6, 1, _) => [60, 160, 80],
            (1, 6, _) => [60, 90, 190],
            // A grey ramp that makes the response visible.
            (6, 6, _) => [20 + 24 * (x % SQUARE) as u8; 3],
            (_, _, 0) => [215, 215, 210],
            _ => [40, 40, 45],
        };
        [color[0], color[1], color[2], 255]
    };
    let rgba = (0..SIDE * SIDE).flat_map(|i| texel(i % SIDE, i / SIDE)).collect();
    SimulatedBoard {
        corners_in_world_m: [left + up, right + up, right, left],
        texture: SceneTexture {
            width: SIDE,
            height: SIDE,
            rgba: Arc::new(rgba),
            srgb: true,
            wrap: [Wrap::Clamp; 2],
            smooth: true,
            mipmaps: false,
        },
    }
}

impl SimulatedBoard {
    /// World position, metres, of texture coordinates in texels from the upper left corner (texel
    /// centres at +0.5).
    pub fn point_at_texel(&self, texel: DVec2) -> DVec3 {
        let [upper_left, upper_right, _, lower_left] = self.corners_in_world_m;
        let uv = texel / f64::from(SIDE);
        upper_left + (upper_right - upper_left) * uv.x + (lower_left - upper_left) * uv.y
    }

    /// The board as a panel with linear emitted light, for the ray caster.
    pub(super) fn emissive_panel(&self) -> Option<(SiteShape, SiteChart)> {
        let [upper_left, upper_right, _, lower_left] = self.corners_in_world_m;
        let response = Response::default();
        let light = |texel: &[u8]| {
            let value = |i: usize| response.decode(f64::from(texel[i]) / 255.0) as f32;
            [value(0), value(1), value(2), 0.0]
        };
        let cells = self.texture.rgba.chunks_exact(4).map(light).collect();
        let shape = SiteShape::Panel { corner: upper_left, u: upper_right - upper_left, v: lower_left - upper_left };
        Some((shape, SiteChart::new(SIDE as usize, SIDE as usize, cells)?))
    }

    /// The board as a binary glTF 2.0 file: unlit, double-sided, in the recording's world
    /// coordinates.
    pub fn glb(&self) -> Result<Vec<u8>, image::ImageError> {
        let mut binary = Vec::new();
        for corner in self.corners_in_world_m {
            corner.as_vec3().to_array().iter().for_each(|v| binary.extend(v.to_le_bytes()));
        }
        for uv in [[0.0f32, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]] {
            uv.iter().for_each(|v| binary.extend(v.to_le_bytes()));
        }
        for index in [0u16, 3, 2, 0, 2, 1] {
            binary.extend(index.to_le_bytes());
        }
        let mut png = Vec::new();
        PngEncoder::new(&mut png).write_image(&self.texture.rgba, SIDE, SIDE, ExtendedColorType::Rgba8)?;
        let png_length = png.len();
        binary.append(&mut png);
        binary.resize(binary.len().next_multiple_of(4), 0);

        let corners = self.corners_in_world_m.map(DVec3::as_vec3);
        let low = corners.iter().fold(corners[0], |a, b| a.min(*b)).to_array();
        let high = corners.iter().fold(corners[0], |a, b| a.max(*b)).to_array();
        let json = serde_json::json!({
            "asset": { "version": "2.0", "generator": "locard simulate" },
            "extensionsUsed": ["KHR_materials_unlit"],
            "scene": 0,
            "scenes": [{ "nodes": [0] }],
            "nodes": [{ "mesh": 0, "name": "board" }],
            "meshes": [{ "primitives": [{
                "attributes": { "POSITION": 0, "TEXCOORD_0": 1 }, "indices": 2, "material": 0
            }] }],
            "materials": [{
                "name": "board",
                "doubleSided": true,
                "pbrMetallicRoughness": {
                    "baseColorTexture": { "index": 0 }, "metallicFactor": 0.0, "roughnessFactor": 1.0
                },
                "extensions": { "KHR_materials_unlit": {} }
            }],
            "textures": [{ "source": 0, "sampler": 0 }],
            // Linear without mipmaps, clamped to the edge.
            "samplers": [{ "magFilter": 9729, "minFilter": 9729, "wrapS": 33071, "wrapT": 33071 }],
            "images": [{ "bufferView": 3, "mimeType": "image/png" }],
            "accessors": [
                { "bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3", "min": low, "max": high },
                { "bufferView": 1, "componentType": 5126, "count": 4, "type": "VEC2" },
                { "bufferView": 2, "componentType": 5123, "count": 6, "type": "SCALAR" }
            ],
            "bufferViews": [
                { "buffer": 0, "byteOffset": 0, "byteLength": 48 },
                { "buffer": 0, "byteOffset": 48, "byteLength": 32 },
                { "buffer": 0, "byteOffset": 80, "byteLength": 12 },
                { "buffer": 0, "byteOffset": 92, "byteLength": png_length }
            ],
            "buffers": [{ "byteLength": binary.len() }]
        });
        let mut text = json.to_string().into_bytes();
        text.resize(text.len().next_multiple_of(4), b' ');
        let total = 12 + 8 + text.len() + 8 + binary.len();
        let mut glb = Vec::with_capacity(total);
        for word in [0x4654_6c67, 2, total as u32, text.len() as u32, 0x4e4f_534a] {
            glb.extend(u32::to_le_bytes(word));
        }
        glb.append(&mut text);
        for word in [binary.len() as u32, 0x004e_4942] {
            glb.extend(u32::to_le_bytes(word));
        }
        glb.append(&mut binary);
        Ok(glb)
    }
}
