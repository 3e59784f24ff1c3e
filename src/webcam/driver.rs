//! A camera driver: lists cameras, opens one, and delivers its pictures one at a time.
//!
//! [`CaptureSession`](super::session::CaptureSession) runs a driver on a thread of its own. It
//! watches for stalls, reopens a camera that was unplugged, and counts dropped pictures, for all
//! drivers alike.

use super::error::CameraError;
use super::list::CameraListing;
use super::negotiation::{FormatRequest, NegotiatedFormat};
use super::picture::PictureFormat;

/// When a picture was taken, as its driver stamps it.
#[derive(Clone, Copy, Debug, PartialEq)]
#[allow(dead_code, reason = "v4l2 alone has monotonic stamps, and a file alone exact ones")]
pub enum Stamp {
    Missing,
    /// Seconds of [`super::monotonic_s`]; replaced by the arrival if implausible.
    Monotonic(f64),
    /// Seconds by a clock that the driver does not name: used as monotonic if plausible, else
    /// ignored.
    UnnamedClock(f64),
    /// Seconds since 1970 by the system's wall clock.
    Wall(f64),
    /// Seconds by a clock of unknown origin.
    Relative(f64),
    /// Seconds of [`super::monotonic_s`], accepted without a check.
    Exact(f64),
}

/// A picture from a driver, before its time is converted.
#[derive(Clone, Debug, PartialEq)]
pub struct DriverPicture {
    pub picture_format: PictureFormat,
    pub bytes: Vec<u8>,
    pub stamp: Stamp,
    /// When it arrived, seconds of [`super::monotonic_s`].
    pub arrived_s: f64,
    pub exposure_s: Option<f64>,
    /// Pictures lost before it, by the driver's count.
    pub dropped_frames: u64,
    /// The driver marked it as damaged.
    pub is_damaged: bool,
}

/// Access to the cameras of a system. Methods may be called on any thread.
pub trait Driver: Send + Sync {
    /// Called before a camera is opened, on the thread that opens it.
    fn prepare(&self) -> Result<(), CameraError> {
        Ok(())
    }

    /// The cameras, with their modes.
    fn cameras(&self) -> Result<Vec<CameraListing>, CameraError>;

    /// The present id of a camera that had an id and a name when it was opened; the same id is
    /// preferred. `None`: it is unplugged. Called on the camera's thread; may block without end.
    fn find(&self, id: &str, name: &str) -> Option<String>;

    /// Opens a camera by its id. Called on the camera's thread; may block without end.
    fn open(
        &self,
        id: &str,
        requested: &FormatRequest,
    ) -> Result<(Box<dyn DriverStream>, NegotiatedFormat), CameraError>;

    /// False for a file: pictures may be far apart, and after a failure it is not reopened.
    fn is_live(&self) -> bool {
        true
    }
}

/// An open camera. It stays on the thread that opened it.
pub trait DriverStream {
    /// Waits for the next picture; may block without end. `None`: there will be no more. An error
    /// ends the capture, and its text follows the camera's name: "… stopped: it was unplugged".
    fn next(&mut self) -> Result<Option<DriverPicture>, String>;
}
