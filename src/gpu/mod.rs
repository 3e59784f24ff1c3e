//! The GPU: device, shaders, textures, full-screen passes, readback. Knows no optics.

mod device;
mod pass;
mod readback;
mod shader;
mod texture;

pub use device::{AdapterReport, Gpu, GpuError, adapters};
pub use pass::{Binding, FullscreenPass, Options, Slot, run_listed, run_tiles};
pub use readback::{Readback, ReadbackSet};
#[cfg(test)]
pub use shader::constant;
pub use shader::{assemble, expand, source, sources};
pub use texture::{Texture, TexturePool, constants, half_texels};
