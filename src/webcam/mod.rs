//! Cameras of this machine: pictures as the driver delivers them, with its times. A video may stand in for one.
//!
//! A camera has a thread of its own, which puts each picture where the next one replaces it ([`Newest`]): whoever takes
//! them gets the newest, and is told how many were dropped.

mod clock;
#[cfg(all(feature = "camera", target_os = "linux"))]
mod device;
#[cfg(all(feature = "camera", target_os = "linux"))]
mod encoding;
mod error;
mod list;
#[cfg(all(feature = "camera", target_os = "linux"))]
mod negotiate;
mod newest;
mod open;
mod picture;
mod played;
mod wanted;

pub use clock::monotonic_s;
pub use error::CameraError;
pub use list::{Listed, Mode};
pub use newest::{Drops, Newest, Putter, Taken};
pub use open::{Camera, cameras, open};
pub use picture::{Delivered, Layout, Picture, PictureError};
pub use wanted::{Given, Wanted};
