//! The cameras of all drivers, and the selection of one by number, device or name.

use std::path::Path;
use std::sync::{Arc, mpsc};

use super::camera_id;
use super::driver::Driver;
use super::driver_name::DriverName;
use super::error::CameraError;
use super::latest::LatestReceiver;
use super::list::CameraListing;
use super::negotiation::{FormatRequest, NegotiatedFormat};
use super::picture::Picture;
use super::played::VideoFileDriver;
use super::session::{CaptureSession, SessionLimits, guarded};

/// A camera with a negotiated format that is not started.
pub struct WebcamSource {
    pub negotiated: NegotiatedFormat,
    session: CaptureSession,
}

impl WebcamSource {
    pub(super) fn open(
        driver: Arc<dyn Driver>,
        id: &str,
        requested: &FormatRequest,
        limits: SessionLimits,
    ) -> Result<Self, CameraError> {
        driver.prepare()?;
        let (session, negotiated) = CaptureSession::open(driver, id, requested, limits)?;
        Ok(Self { negotiated, session })
    }

    /// Starts the delivery, until the returned receiver is dropped. A video begins now.
    pub fn start(self) -> Result<LatestReceiver<Picture>, CameraError> {
        let (sender, newest) = LatestReceiver::new();
        let thread = std::thread::Builder::new().name("camera".to_owned());
        thread.spawn(move || self.session.run(&sender)).map_err(CameraError::Thread)?;
        Ok(newest)
    }
}

/// The driver of a name, if it is built and on this system.
fn driver(name: DriverName) -> Result<Arc<dyn Driver>, CameraError> {
    match name {
        DriverName::Played => Ok(Arc::new(VideoFileDriver)),
        #[cfg(feature = "camera")]
        DriverName::Nokhwa => Ok(Arc::new(super::nokhwa::Nokhwa)),
        #[cfg(all(feature = "camera", target_os = "linux"))]
        DriverName::V4l2 => Ok(Arc::new(super::v4l2::V4l2)),
        #[cfg(not(all(feature = "camera", target_os = "linux")))]
        _ if !cfg!(feature = "camera") => Err(CameraError::NotBuilt),
        #[cfg(not(all(feature = "camera", target_os = "linux")))]
        _ => Err(CameraError::NoDriver { driver: name, here: DriverName::AVAILABLE[0] }),
    }
}

/// The cameras of each driver on this system, the default driver first. Devices that take no
/// pictures are left out.
pub fn cameras() -> Vec<(DriverName, Result<Vec<CameraListing>, CameraError>)> {
    let named_cameras = |name: &DriverName| (*name, cameras_of(*name));
    DriverName::AVAILABLE.iter().map(named_cameras).collect()
}

fn cameras_of(name: DriverName) -> Result<Vec<CameraListing>, CameraError> {
    listed(name, driver(name)?, SessionLimits::default())
}

/// A driver's cameras, if it answers in time. A thread that does not return is left behind.
pub(super) fn listed(
    name: DriverName,
    driver: Arc<dyn Driver>,
    limits: SessionLimits,
) -> Result<Vec<CameraListing>, CameraError> {
    let (sender, answer) = mpsc::channel();
    let camera = format!("the driver {name}");
    let broken = |problem| CameraError::Driver { camera: camera.clone(), problem };
    let list = move || drop(sender.send(guarded(|| driver.cameras())));
    std::thread::Builder::new().name("cameras".to_owned()).spawn(list).map_err(CameraError::Thread)?;
    let seconds = limits.opening.as_secs_f64();
    match answer.recv_timeout(limits.opening) {
        Ok(cameras) => cameras.unwrap_or_else(|problem| Err(broken(problem))),
        Err(_) => Err(CameraError::NoAnswer { camera, seconds }),
    }
}

/// Opens a camera by its number, by its device (`/dev/video0`), or a video in its place by its
/// file.
pub fn open(camera: &str, requested: &FormatRequest) -> Result<WebcamSource, CameraError> {
    if camera_id::number(camera).is_some() {
        let name = requested.driver.or(DriverName::AVAILABLE.first().copied()).ok_or(CameraError::NotBuilt)?;
        return WebcamSource::open(driver(name)?, camera, requested, SessionLimits::default());
    }
    let file = Path::new(camera);
    if !file.exists() {
        // The default driver alone: another one may change a camera's mode to list it.
        let default = DriverName::AVAILABLE.first().map(|name| cameras_of(*name));
        let cameras = default.and_then(Result::ok).unwrap_or_default();
        let names = cameras.into_iter().map(|camera| format!("{} ({})", camera.number, camera.name)).collect();
        // A text in the form of a file name is one.
        return Err(if file.extension().is_some() || camera.contains(std::path::MAIN_SEPARATOR) {
            CameraError::NoFile { path: file.to_owned(), cameras: names }
        } else {
            CameraError::NotACamera { name: camera.to_owned(), cameras: names }
        });
    }
    let mut camera = WebcamSource::open(driver(DriverName::Played)?, camera, requested, SessionLimits::default())?;
    if let Some(name) = requested.driver.filter(|name| *name != DriverName::Played) {
        camera.negotiated.warnings.push(format!("a video replaces the camera; the driver {name} is not used"));
    }
    Ok(camera)
}
