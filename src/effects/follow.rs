//! Geometry follows coverage: where an effect has spread light, the depth and velocity of the nearest surface spread
//! too.

use super::LayerRun;
use crate::gpu::{Entry, Shader};
use crate::render::{GEOMETRY, Layer};

crate::uniform! {
    struct Follow { size: [i32; 2], radius: i32, unused: i32 }
}

impl LayerRun<'_> {
    /// A layer whose light has been spread by up to `radius_px`, with matching geometry if anything still reads it.
    pub fn followed(&mut self, layer: Layer, radius_px: u32) -> Layer {
        if !self.geometry_is_read || radius_px == 0 {
            return layer;
        }
        let size = layer.size;
        let follow = Follow { size: [size.0 as i32, size.1 as i32], radius: radius_px as i32, unused: 0 };
        let mut geometry = layer.geometry;
        for down in [0.0, 1.0] {
            let pass = self.recorder.pass(Shader::Follow, Entry::from("main").choose("down", down));
            [geometry] = pass.storage("follow", &follow).texture("geometry", &geometry).draw([GEOMETRY], size);
        }
        Layer { geometry, ..layer }
    }
}
