//! Spreads geometry over the pixels to which an effect has spread light: depth and velocity of the
//! nearest surface.

use super::LayerRun;
use crate::gpu::{Shader, ShaderEntry};
use crate::render::{GEOMETRY, Layer};

crate::uniform! {
    struct SpreadGeometryUniform { size: [i32; 2], radius: i32, unused: i32 }
}

impl LayerRun<'_> {
    /// Spreads the geometry of a layer whose light was spread by up to `radius_px`, if anything
    /// still reads it.
    pub fn with_spread_geometry(&mut self, layer: Layer, radius_px: u32) -> Layer {
        if !self.geometry_is_read || radius_px == 0 {
            return layer;
        }
        let size = layer.size;
        let spread =
            SpreadGeometryUniform { size: [size.0 as i32, size.1 as i32], radius: radius_px as i32, unused: 0 };
        let mut geometry = layer.geometry;
        for down in [0.0, 1.0] {
            let pass = self.recorder.pass(Shader::SpreadGeometry, ShaderEntry::from("main").choose("down", down));
            [geometry] = pass.storage("spread", &spread).texture("geometry", &geometry).draw([GEOMETRY], size);
        }
        Layer { geometry, ..layer }
    }
}
