//! Cameras of this machine: pictures as the driver delivers them, with its times. A video may stand
//! in for one.
//!
//! A [`Driver`](driver::Driver) lists and opens cameras; there are three. Behind it all cameras go
//! the same way: a session puts each picture where the next one replaces it ([`LatestReceiver`]),
//! watches for stalls, and reopens a camera that was unplugged. The receiver gets the newest
//! picture and the number of dropped ones.

#[cfg(any(test, feature = "camera"))]
mod buffer;
mod camera_id;
#[cfg(any(test, feature = "camera"))]
mod choose;
mod clock;
mod driver;
mod driver_name;
mod error;
mod frame_clock;
mod latest;
mod list;
mod negotiation;
#[cfg(feature = "camera")]
mod nokhwa;
mod open;
mod picture;
mod played;
mod session;
#[cfg(test)]
mod session_tests;
#[cfg(all(feature = "camera", target_os = "linux"))]
mod v4l2;

pub use clock::monotonic_s;
pub use driver_name::DriverName;
pub use error::CameraError;
pub use latest::{Drops, LatestReceiver, LatestSender, TakeOutcome};
pub use list::{CameraListing, CameraMode};
pub use negotiation::{AssumedColor, FormatRequest, NegotiatedFormat, TimeSource};
pub use open::{WebcamSource, cameras, open};
pub use picture::{Layout, Picture, PictureError, PictureFormat};
