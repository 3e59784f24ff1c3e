//! The GPU: device, shaders, textures, passes, readback. Knows no optics.
//!
//! A [`Recorder`] records what a frame needs. `recorder.pass(Shader::X, "entry")` begins a pass. Its inputs are given
//! by the names in the shader's text, and `draw` returns the textures that it draws.

mod device;
mod interface;
mod pass;
mod pipelines;
mod readback;
mod recorder;
mod shader;
mod shared;
mod texture;
mod timing;
mod uniform;

pub use device::{AdapterReport, Gpu, GpuError, adapters};
pub use interface::{Global, Interface};
pub use pass::Pass;
pub use pipelines::Entry;
pub use readback::{Readback, ReadbackSet, read_back};
pub use recorder::Recorder;
#[cfg(test)]
pub use shader::constant;
pub use shader::{Shader, module};
pub use texture::{Pyramid, Texture, TexturePool, half_texels};
pub use timing::{PartTime, Stamps, Timed};
pub use uniform::{Bytes, Packed, Uniform, constants};
