//! Geometry follows coverage: where an effect has spread light, depth and velocity of the nearest surface around go with it.

use super::LayerRun;
use crate::gpu::{Entry, Shader};
use crate::render::{GEOMETRY, Layer};

impl LayerRun<'_> {
    /// A layer whose light has been spread by up to `radius_px`, with its geometry, where that is read still.
    pub fn followed(&mut self, layer: Layer, radius_px: u32) -> Layer {
        if !self.geometry_is_read || radius_px == 0 {
            return layer;
        }
        let size = layer.size;
        let follow = [size.0 as i32, size.1 as i32, radius_px as i32, 0];
        let follow = self.recorder.storage(bytemuck::cast_slice(&follow));
        let [mut geometry] = [layer.geometry];
        for down in [0.0, 1.0] {
            let pass = self.recorder.pass(Shader::Follow, Entry::from("main").choose("down", down));
            [geometry] = pass.buffer("follow", follow.clone()).texture("geometry", &geometry).draw([GEOMETRY], size);
        }
        Layer { geometry, ..layer }
    }
}
