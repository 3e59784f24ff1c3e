//! nokhwa's errors, which are texts of the systems.

use nokhwa::NokhwaError;

use crate::webcam::error::CameraError;

/// Parts of the systems' messages. Linux: EBUSY. Windows: MF_E_VIDEO_RECORDING_DEVICE_PREEMPTED and
/// MF_E_HW_MFT_FAILED_START_STREAMING, ERROR_BUSY.
const BUSY: [&str; 5] = ["os error 16)", "0xC00D3EA3", "0xC00D3704", "0x800700AA", "Already in use"];
/// Linux: EACCES, EPERM. Windows: E_ACCESSDENIED.
const NOT_PERMITTED: [&str; 3] = ["os error 13)", "os error 1)", "0x80070005"];
/// Linux: ENODEV. Windows: MF_E_VIDEO_RECORDING_DEVICE_INVALIDATED.
const UNPLUGGED: [&str; 2] = ["os error 19)", "0xC00D3EA2"];

fn contains(error: &NokhwaError, parts: &[&str]) -> bool {
    let text = error.to_string();
    parts.iter().any(|part| text.contains(part))
}

/// Why a camera was not opened.
pub fn camera_error(camera: &str, error: &NokhwaError) -> CameraError {
    let camera = camera.to_owned();
    if contains(error, &BUSY) {
        return CameraError::Busy { camera };
    }
    if contains(error, &NOT_PERMITTED) {
        return CameraError::Permission { camera, advice: advice().to_owned() };
    }
    let mut problem = error.to_string();
    if problem.contains("not whole number") {
        problem.push_str("; nokhwa reads whole rates alone: set one at the camera, or choose --driver v4l2");
    } else if has_unsupported_format(error) {
        "it is set to a format that nokhwa does not read: set another one at the camera, or choose --driver v4l2"
            .clone_into(&mut problem);
    } else if problem.contains("Failed to Fufill") {
        "nokhwa finds no format that is read here, at a whole rate".clone_into(&mut problem);
    }
    CameraError::Driver { camera, problem }
}

fn advice() -> &'static str {
    if cfg!(windows) {
        "allow desktop apps to use the camera (Settings, Privacy & security, Camera)"
    } else {
        "the group of the device may (`ls -l /dev/video*`); have yourself added to it, then log in again"
    }
}

/// Whether a camera is set to a format that nokhwa does not read (Linux). It takes pictures all the
/// same.
fn has_unsupported_format(error: &NokhwaError) -> bool {
    matches!(
        error,
        NokhwaError::GetPropertyError { property, error } if property == "FrameFormat" && error == "unsupported"
    )
}

/// Why a camera's modes are not known.
#[cfg_attr(target_os = "linux", allow(dead_code, reason = "used on macOS and Windows, compiled on Linux"))]
pub fn listing_error(camera: &str, error: &NokhwaError) -> CameraError {
    if takes_no_pictures(error) {
        CameraError::NoCapture { camera: camera.to_owned() }
    } else {
        camera_error(camera, error)
    }
}

/// Whether a device has no formats of pictures.
#[cfg_attr(target_os = "linux", allow(dead_code, reason = "used on macOS and Windows, compiled on Linux"))]
fn takes_no_pictures(error: &NokhwaError) -> bool {
    let has_no_formats = matches!(error, NokhwaError::GetPropertyError { property, .. } if property == "FrameFormat");
    has_no_formats && !has_unsupported_format(error)
}

/// Why no further picture comes, behind "the camera stopped: ".
pub fn stopped(error: &NokhwaError) -> String {
    if contains(error, &UNPLUGGED) { "it was unplugged".to_owned() } else { error.to_string() }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn open_error(text: &str) -> NokhwaError {
        NokhwaError::OpenDeviceError("0".to_owned(), text.to_owned())
    }

    #[test]
    fn system_errors_are_classified() {
        let busy = open_error("V4L2 Error: Device or resource busy (os error 16)");
        assert!(matches!(camera_error("c", &busy), CameraError::Busy { .. }));
        let denied = open_error("V4L2 Error: Permission denied (os error 13)");
        assert!(matches!(camera_error("c", &denied), CameraError::Permission { .. }));
        assert!(matches!(camera_error("c", &open_error("odd (os error 161)")), CameraError::Driver { .. }));
        let rate = camera_error("c", &open_error("Framerate not whole number: 30000 / 1001")).to_string();
        assert!(rate.ends_with("or choose --driver v4l2"), "{rate}");
        let property = |property: &str, error: &str| NokhwaError::GetPropertyError {
            property: property.to_owned(),
            error: error.to_owned(),
        };
        let none = property("CameraFormat", "Failed to Fufill");
        assert_eq!(
            camera_error("c", &none).to_string(),
            "c: nokhwa finds no format that is read here, at a whole rate"
        );
        let unsupported = property("FrameFormat", "unsupported");
        assert!(!takes_no_pictures(&unsupported));
        assert!(camera_error("c", &unsupported).to_string().ends_with("or choose --driver v4l2"));
        assert!(takes_no_pictures(&property("FrameFormat", "Invalid argument (os error 22)")));
        let gone = NokhwaError::ReadFrameError("No such device (os error 19)".to_owned());
        assert_eq!(stopped(&gone), "it was unplugged");
        assert_eq!(stopped(&NokhwaError::ReadFrameError("odd".to_owned())), "Could not capture frame: odd");
    }
}
