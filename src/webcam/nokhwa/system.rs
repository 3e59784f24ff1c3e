//! Differences of nokhwa 0.10.11 between operating systems.

use std::time::Duration;

use nokhwa::utils::FrameFormat;

use crate::webcam::driver::Stamp;
use crate::webcam::picture::Layout;

/// An operating system with a driver of its own.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum System {
    Linux,
    MacOs,
    Windows,
}

impl System {
    pub const CURRENT: Self = if cfg!(target_os = "macos") {
        Self::MacOs
    } else if cfg!(windows) {
        Self::Windows
    } else {
        Self::Linux
    };

    /// The formats that are read. On macOS nokhwa requests the pixel format of the camera's mode
    /// from AVFoundation, which converts to YUYV and RGB, but throws an exception for its codes of
    /// JPEG and grey.
    pub fn formats(self) -> &'static [FrameFormat] {
        use FrameFormat::{GRAY, MJPEG, NV12, RAWRGB, YUYV};
        match self {
            Self::MacOs => &[YUYV, RAWRGB],
            Self::Linux | Self::Windows => &[YUYV, NV12, MJPEG, RAWRGB, GRAY],
        }
    }

    /// nokhwa's time of a picture. On Windows it is counted from the moment at which the stream was
    /// selected, as if the camera's clock had been 0 then: its origin is unknown.
    pub fn stamp(self, captured: Option<Duration>) -> Stamp {
        match (captured, self) {
            (None, _) => Stamp::Missing,
            (Some(time), Self::Windows) => Stamp::Relative(time.as_secs_f64()),
            (Some(time), Self::Linux | Self::MacOs) => Stamp::Wall(time.as_secs_f64()),
        }
    }

    /// Whether a camera's modes are listed by opening it, which sets one.
    pub fn opens_to_list(self) -> bool {
        self == Self::Windows
    }

    /// Whether a stream is opened with the camera. On Linux that reserves buffers, and fails if
    /// another program has them; pictures come from the first request on. Elsewhere it starts the
    /// camera, whose pictures would queue.
    pub fn opens_stream_early(self) -> bool {
        self == Self::Linux
    }
}

/// `None`: not read. RAWBGR of Windows has its rows from bottom to top on some cameras.
pub fn layout_of(format: FrameFormat) -> Option<Layout> {
    match format {
        FrameFormat::YUYV => Some(Layout::Yuyv),
        FrameFormat::NV12 => Some(Layout::Nv12),
        FrameFormat::MJPEG => Some(Layout::Mjpeg),
        FrameFormat::RAWRGB => Some(Layout::Rgb),
        FrameFormat::GRAY => Some(Layout::Grey),
        FrameFormat::RAWBGR => None,
    }
}

pub fn format_of(layout: Layout) -> FrameFormat {
    match layout {
        Layout::Yuyv => FrameFormat::YUYV,
        Layout::Nv12 => FrameFormat::NV12,
        Layout::Mjpeg => FrameFormat::MJPEG,
        Layout::Rgb => FrameFormat::RAWRGB,
        Layout::Grey => FrameFormat::GRAY,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_layout_has_one_format() {
        for layout in Layout::PREFERRED {
            assert_eq!(layout_of(format_of(layout)), Some(layout));
        }
    }

    #[test]
    fn stamps_of_windows_have_an_unknown_origin() {
        let at = Some(Duration::from_millis(1500));
        let stamps = [System::Linux, System::MacOs, System::Windows].map(|system| system.stamp(at));
        assert_eq!(stamps, [Stamp::Wall(1.5), Stamp::Wall(1.5), Stamp::Relative(1.5)]);
        assert_eq!(System::Linux.stamp(None), Stamp::Missing);
    }
}
