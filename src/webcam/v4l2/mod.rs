//! The driver of cameras on Linux: Video4Linux, through the `v4l` crate.

mod device;
mod encoding;
mod negotiate;
mod permission;

pub use device::V4l2;
pub use negotiate::{modes_of, set_mode};
