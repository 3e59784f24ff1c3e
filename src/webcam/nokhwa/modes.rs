//! The modes that a camera offers through nokhwa.

use std::collections::BTreeMap;

use nokhwa::NokhwaError;
use nokhwa::utils::{CameraFormat, CameraIndex};

use super::system::{System, layout_of};
use crate::webcam::list::Mode;

/// Rates beyond this are numbers of another unit, Hz: on Linux nokhwa lists 30000/1001 Hz as 30000.
const MAX_RATE_HZ: u32 = 1000;

/// Lists a camera's modes. On Linux and Windows this opens the camera for a moment.
pub fn offered(number: usize) -> Result<Vec<Mode>, NokhwaError> {
    Ok(modes(System::CURRENT, &formats(CameraIndex::Index(number as u32))?))
}

/// The camera's formats in AVFoundation's order, rates ascending within each.
///
/// `nokhwa::Camera::new` sets a mode before it can list any, and may abort the process; see
/// [`without_aborts`].
#[cfg(target_os = "macos")]
fn formats(index: CameraIndex) -> Result<Vec<CameraFormat>, NokhwaError> {
    nokhwa_bindings_macos::AVCaptureDevice::new(&index)?.supported_formats()
}

/// Not by `Camera::compatible_camera_formats`, which covers two formats on Windows, and fails with
/// the first one that the camera does not have.
#[cfg(not(target_os = "macos"))]
fn formats(index: CameraIndex) -> Result<Vec<CameraFormat>, NokhwaError> {
    use nokhwa::utils::{RequestedFormat, RequestedFormatType};
    let formats = System::CURRENT.formats();
    let any = RequestedFormat::with_formats(RequestedFormatType::None, formats);
    let mut camera = nokhwa::Camera::new(index, any)?;
    let mut offered = Vec::new();
    for format in formats {
        for (resolution, rates) in camera.compatible_list_by_resolution(*format).unwrap_or_default() {
            offered.extend(rates.into_iter().map(|rate| CameraFormat::new(resolution, *format, rate)));
        }
    }
    Ok(offered)
}

/// Modes by layout and size, rates ascending.
fn modes(system: System, offered: &[CameraFormat]) -> Vec<Mode> {
    let offered = if system == System::MacOs { without_aborts(offered) } else { offered.to_vec() };
    let mut modes: BTreeMap<(usize, u32, u32), Vec<u32>> = BTreeMap::new();
    for format in offered.iter().filter(|format| (1..=MAX_RATE_HZ).contains(&format.frame_rate())) {
        if let Some(at) = system.formats().iter().position(|read| *read == format.format()) {
            modes.entry((at, format.width(), format.height())).or_default().push(format.frame_rate());
        }
    }
    let mode = |((at, width, height), mut rates): ((usize, u32, u32), Vec<u32>)| {
        rates.sort_unstable();
        rates.dedup();
        let format = system.formats()[at];
        let rates_hz = rates.into_iter().map(f64::from).collect();
        Mode { code: format.to_string(), layout: layout_of(format), sizes: [(width, height); 2], rates_hz }
    };
    modes.into_iter().map(mode).collect()
}

/// For each size the last of AVFoundation's formats, at its highest rate.
///
/// nokhwa-bindings-macos 0.2.4 takes the last format of the requested size, whatever its pixel
/// format, and the last rate range of any format of that size that ends at the requested rate. If
/// the range belongs to another format, AVFoundation throws an exception that aborts the process.
/// The highest rate of the last format is always that format's own. The stream has this rate,
/// whichever was requested: it is set again when the stream is opened.
fn without_aborts(offered: &[CameraFormat]) -> Vec<CameraFormat> {
    let mut last = BTreeMap::new();
    for format in offered {
        last.insert((format.width(), format.height()), *format);
    }
    last.into_values().collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::webcam::choose;
    use crate::webcam::wanted::Wanted;
    use nokhwa::utils::FrameFormat::{self, GRAY, MJPEG, NV12, RAWBGR, YUYV};
    use nokhwa::utils::Resolution;

    fn formats(list: &[(FrameFormat, (u32, u32), u32)]) -> Vec<CameraFormat> {
        let format =
            |(format, (width, height), rate): &_| CameraFormat::new(Resolution::new(*width, *height), *format, *rate);
        list.iter().map(format).collect()
    }

    /// `yuyv 640x480 at 15.00, 30.00 Hz`.
    fn summary(modes: &[Mode]) -> Vec<String> {
        modes.iter().map(Mode::to_string).collect()
    }

    const VGA: (u32, u32) = (640, 480);

    #[test]
    fn modes_have_their_rates_ascending_and_no_impossible_ones() {
        let offered = formats(&[
            (YUYV, VGA, 30),
            (YUYV, VGA, 15),
            (YUYV, VGA, 30),
            (YUYV, VGA, 30_000),
            (MJPEG, VGA, 60),
            (RAWBGR, VGA, 30),
            (NV12, VGA, 0),
        ]);
        let modes = modes(System::Windows, &offered);
        assert_eq!(summary(&modes), ["yuyv 640x480 at 15.00, 30.00 Hz", "mjpeg 640x480 at 60.00 Hz"]);
    }

    #[test]
    fn on_macos_only_the_last_formats_own_highest_rate_is_offered() {
        let (hd, small) = ((1280, 720), (320, 240));
        // As AVFoundation lists a webcam: 720p raw at 10 Hz after 720p at 30 Hz, 480p last as JPEG,
        // 240p last in grey.
        let offered = formats(&[
            (YUYV, hd, 5),
            (YUYV, hd, 30),
            (YUYV, VGA, 30),
            (YUYV, hd, 5),
            (YUYV, hd, 10),
            (MJPEG, VGA, 30),
            (GRAY, small, 30),
            (YUYV, (160, 120), 29),
        ]);
        let modes = modes(System::MacOs, &offered);
        assert_eq!(summary(&modes), ["yuyv 160x120 at 29.00 Hz", "yuyv 1280x720 at 10.00 Hz"]);
        // The fast 720p would be paired with the slow one's range.
        let wanted = Wanted { size: hd, ..Wanted::default() };
        assert_eq!(choose::exact(&modes, &wanted).unwrap().rate_hz, 10.0);
    }
}
