//! The GPU: device, shaders, textures, passes, readback. Independent of optics.
//!
//! A [`Recorder`] records the work of a frame. `recorder.pass(Shader::X, "entry")` begins a pass.
//! Its inputs are bound by the names in the shader's text, and `draw` returns the textures that it
//! draws.

mod device;
mod interface;
mod pass;
mod pipelines;
mod readback;
mod recorder;
mod shader;
mod texture;
mod timing;
mod type_map;
mod uniform;

pub use device::{AdapterReport, Gpu, GpuError, adapters};
pub use interface::{Global, Interface};
pub use pass::Pass;
pub use pipelines::ShaderEntry;
pub use readback::{Readback, ReadbackSet, read_back};
pub use recorder::PassRecorder;
#[cfg(test)]
pub use shader::constant;
pub use shader::{Shader, module};
pub use texture::{Pyramid, Texture, TexturePool, half_texels};
pub use timing::{PartTime, PendingTimes, Stamps};
pub use uniform::{Bytes, Uniform, UniformBytes, constants};
