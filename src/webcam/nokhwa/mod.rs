//! The driver of cameras on macOS and Windows, and a second one on Linux: the nokhwa crate.
//!
//! Its time stamps are wall-clock times, or on Windows of unknown origin. Range, matrix, counts and
//! error flags are not available. [`System`] holds the differences between the systems;
//! docs/live.md lists them.

mod capture;
mod errors;
mod modes;
mod system;

use std::sync::mpsc;
use std::time::Duration;

use ::nokhwa::utils::{ApiBackend, CameraFormat, CameraIndex, RequestedFormat, RequestedFormatType, Resolution};

use self::capture::NokhwaCapture;
use self::system::System;
use super::camera_id::number;
use super::choose;
use super::driver::{Driver, DriverStream};
use super::driver_name::DriverName;
use super::error::CameraError;
use super::list::CameraListing;
use super::negotiation::{AssumedColor, FormatRequest, NegotiatedFormat, TimeSource};
use super::picture::{Layout, PictureFormat};
use crate::coding::{ColorMatrix, ColorRange};
use crate::text::quoted;

/// Time limit for the user's answer to the camera permission prompt.
const PERMISSION_LIMIT: Duration = Duration::from_secs(60);

/// A camera's id is its number or, on Linux, the path of its device.
pub struct Nokhwa;

/// A camera's number and name.
struct FoundCamera {
    number: usize,
    name: String,
    place: String,
}

fn system_cameras() -> Result<Vec<FoundCamera>, CameraError> {
    let query = ::nokhwa::query(ApiBackend::Auto).map_err(|error| errors::camera_error("nokhwa", &error))?;
    let camera = |info: &::nokhwa::utils::CameraInfo| {
        let number = info.index().as_index().ok()? as usize;
        Some(FoundCamera { number, name: quoted(info.human_name().trim()), place: quoted(info.description().trim()) })
    };
    let mut cameras: Vec<FoundCamera> = query.iter().filter_map(camera).collect();
    cameras.sort_by_key(|camera| camera.number);
    Ok(cameras)
}

impl Driver for Nokhwa {
    /// Requests the permission to use cameras, on systems that have one (macOS).
    fn prepare(&self) -> Result<(), CameraError> {
        let (sender, answer) = mpsc::channel();
        ::nokhwa::nokhwa_initialize(move |may| _ = sender.send(may));
        if answer.recv_timeout(PERMISSION_LIMIT).unwrap_or(false) { Ok(()) } else { Err(CameraError::NotAllowed) }
    }

    fn cameras(&self) -> Result<Vec<CameraListing>, CameraError> {
        let listed = |camera: FoundCamera| {
            let modes = if System::CURRENT.opens_to_list() && capture::is_open(camera.number) {
                Err(format!("{}: is open in this program", camera.name))
            } else {
                match modes::offered(camera.number, &camera.name) {
                    Ok(modes) => Ok(modes),
                    Err(CameraError::NoCapture { .. }) => return None,
                    Err(error) => Err(error.to_string()),
                }
            };
            let FoundCamera { number, name, place } = camera;
            Some(CameraListing { driver: DriverName::Nokhwa, number, name, place, modes })
        };
        Ok(system_cameras()?.into_iter().filter_map(listed).collect())
    }

    fn find(&self, id: &str, name: &str) -> Option<String> {
        let cameras = system_cameras().ok()?;
        let mut by_name = cameras.iter().filter(|camera| camera.name == name);
        let same = by_name.clone().find(|camera| Some(camera.number) == number(id));
        same.or_else(|| by_name.next()).map(|camera| camera.number.to_string())
    }

    fn open(
        &self,
        id: &str,
        requested: &FormatRequest,
    ) -> Result<(Box<dyn DriverStream>, NegotiatedFormat), CameraError> {
        let cameras = system_cameras()?;
        let names = || cameras.iter().map(|camera| format!("{} ({})", camera.number, camera.name)).collect();
        let camera = cameras.iter().find(|camera| Some(camera.number) == number(id));
        let none = || CameraError::NotACamera { name: id.to_owned(), cameras: names() };
        let FoundCamera { number, name, .. } = camera.ok_or_else(none)?;
        let refused = |error| errors::camera_error(name, &error);
        let offered = modes::offered(*number, name)?;
        let mode = choose::exact(&offered, requested)
            .ok_or_else(|| CameraError::layout(name, &choose::names(requested.layout), &offered))?;
        let (width, height) = mode.size;
        let format = system::format_of(mode.layout);
        let exact = CameraFormat::new(Resolution::new(width, height), format, mode.rate_hz as u32);
        let formats = [format];
        let request = RequestedFormat::with_formats(RequestedFormatType::Exact(exact), &formats);
        // nokhwa refuses a camera whose present rate is not whole.
        #[cfg(target_os = "linux")]
        super::v4l2::set_mode(*number, &mode)?;
        let camera = ::nokhwa::Camera::new(CameraIndex::Index(*number as u32), request).map_err(refused)?;
        let picture_format = picture_format(mode.layout, mode.size, requested);
        let capture = NokhwaCapture::new(*number, camera, exact, picture_format, System::CURRENT).map_err(refused)?;
        let is_ycbcr = mode.layout.is_ycbcr();
        let has_matrix = is_ycbcr && mode.layout != Layout::Grey;
        let negotiated = NegotiatedFormat {
            driver: DriverName::Nokhwa,
            name: name.clone(),
            picture_format,
            rate_hz: Some(mode.rate_hz),
            times: if System::CURRENT == System::Windows { TimeSource::CameraClock } else { TimeSource::WallClock },
            has_exposure: false,
            assumed: AssumedColor {
                range: is_ycbcr && requested.range.is_none(),
                matrix: has_matrix && requested.matrix.is_none(),
            },
            warnings: Vec::new(),
        };
        Ok((Box::new(capture), negotiated))
    }
}

/// Y'CbCr is assumed to be BT.601 in limited range, unless the request overrides it.
fn picture_format(layout: Layout, (width, height): (u32, u32), requested: &FormatRequest) -> PictureFormat {
    let (matrix, range) = match layout {
        Layout::Rgb => (ColorMatrix::Rgb, ColorRange::Full),
        Layout::Mjpeg => (ColorMatrix::Bt601, ColorRange::Full),
        Layout::Yuyv | Layout::Nv12 | Layout::Grey => {
            (requested.matrix.unwrap_or(ColorMatrix::Bt601), requested.range.unwrap_or(ColorRange::Limited))
        }
    };
    PictureFormat { layout, width, height, stride: layout.row_bytes(width), range, matrix }
}
