//! The modes that a camera offers through nokhwa.

use std::collections::BTreeMap;

use nokhwa::NokhwaError;
use nokhwa::utils::{CameraFormat, CameraIndex};

#[cfg(not(target_os = "linux"))]
use super::errors;
use super::system::{System, layout_of};
use crate::webcam::error::CameraError;
use crate::webcam::list::CameraMode;

/// Rates beyond this are numbers of another unit, Hz.
#[cfg_attr(target_os = "linux", allow(dead_code, reason = "used on macOS and Windows, tested on Linux"))]
const MAX_RATE_HZ: u32 = 1000;

/// Lists a camera's modes. On Windows this opens the camera for a moment.
///
/// On Linux Video4Linux lists them, which leaves the camera as it is: nokhwa sets a mode before it
/// lists any, and takes the denominators of intervals as rates, 25 Hz for 2/25 s.
pub fn offered(number: usize, name: &str) -> Result<Vec<CameraMode>, CameraError> {
    #[cfg(target_os = "linux")]
    let offered = {
        let _ = name;
        crate::webcam::v4l2::modes_of(number).map(readable)
    };
    #[cfg(not(target_os = "linux"))]
    let offered = formats(CameraIndex::Index(number as u32))
        .map(|formats| modes(System::CURRENT, &formats))
        .map_err(|error| errors::listing_error(name, &error));
    offered
}

/// Modes of one size, layouts that are read and whole rates. Of a range of sizes the largest.
#[cfg(target_os = "linux")]
fn readable(modes: Vec<CameraMode>) -> Vec<CameraMode> {
    let is_read = |mode: &CameraMode| {
        let mut layouts = System::Linux.formats().iter().filter_map(|format| layout_of(*format));
        layouts.any(|layout| mode.layout == Some(layout))
    };
    let whole = |mode: CameraMode| {
        let rates_hz = mode.rates_hz.iter().copied().filter(|rate_hz| rate_hz.fract() == 0.0).collect();
        CameraMode { sizes: [mode.sizes[1]; 2], rates_hz, ..mode }
    };
    modes.into_iter().filter(is_read).map(whole).filter(|mode| !mode.rates_hz.is_empty()).collect()
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
#[cfg_attr(target_os = "linux", allow(dead_code, reason = "used on Windows, compiled on Linux"))]
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
#[cfg_attr(target_os = "linux", allow(dead_code, reason = "used on macOS and Windows, tested on Linux"))]
fn modes(system: System, offered: &[CameraFormat]) -> Vec<CameraMode> {
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
        CameraMode { code: format.to_string(), layout: layout_of(format), sizes: [(width, height); 2], rates_hz }
    };
    modes.into_iter().map(mode).collect()
}

/// The last of AVFoundation's formats of each size, at its highest rate.
///
/// nokhwa-bindings-macos 0.2.4 takes the last format of the requested size, whatever its pixel
/// format, and the last rate range of any format of that size that ends at the requested rate. If
/// the range belongs to another format, AVFoundation throws an exception that aborts the process.
/// The highest rate of the last format is always that format's own. The stream has this rate,
/// whichever was requested: it is set again when the stream is opened.
#[cfg_attr(target_os = "linux", allow(dead_code, reason = "used on macOS, tested on Linux"))]
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
    use crate::webcam::negotiation::FormatRequest;
    use nokhwa::utils::FrameFormat::{self, GRAY, MJPEG, NV12, RAWBGR, YUYV};
    use nokhwa::utils::Resolution;

    fn formats(list: &[(FrameFormat, (u32, u32), u32)]) -> Vec<CameraFormat> {
        let format =
            |(format, (width, height), rate): &_| CameraFormat::new(Resolution::new(*width, *height), *format, *rate);
        list.iter().map(format).collect()
    }

    /// `yuyv 640x480 at 15.00, 30.00 Hz`.
    fn summary(modes: &[CameraMode]) -> Vec<String> {
        modes.iter().map(CameraMode::to_string).collect()
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

    #[cfg(target_os = "linux")]
    #[test]
    fn on_linux_fractional_rates_and_unread_layouts_are_left_out() {
        use crate::webcam::picture::Layout;
        let mode = |layout, sizes, rates_hz: &[f64]| CameraMode {
            code: "CODE".to_owned(),
            layout,
            sizes,
            rates_hz: rates_hz.to_vec(),
        };
        let listed = vec![
            mode(Some(Layout::Yuyv), [VGA; 2], &[7.5, 12.5, 15.0, 29.97, 30.0]),
            mode(Some(Layout::Mjpeg), [(160, 120), VGA], &[30.0]),
            mode(Some(Layout::Nv12), [VGA; 2], &[30_000.0 / 1001.0]),
            mode(None, [VGA; 2], &[30.0]),
        ];
        assert_eq!(summary(&readable(listed)), ["yuyv 640x480 at 15.00, 30.00 Hz", "mjpeg 640x480 at 30.00 Hz"]);
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
        let requested = FormatRequest { size: hd, ..FormatRequest::default() };
        assert_eq!(choose::exact(&modes, &requested).unwrap().rate_hz, 10.0);
    }
}
