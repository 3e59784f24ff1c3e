//! Video4Linux: finding a camera, and agreeing with it on size, rate and layout.

use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};

use v4l::capability::Flags;
use v4l::format::{Colorspace, Quantization};
use v4l::frameinterval::FrameIntervalEnum;
use v4l::framesize::FrameSizeEnum;
use v4l::video::Capture;
use v4l::video::capture::Parameters;
use v4l::{Device, Format, FourCC, Fraction};

use super::{encoding, permission};
use crate::coding::{ColorMatrix, ColorRange};
use crate::text::{quoted, reason};
use crate::webcam::choose::{self, ExactMode};
use crate::webcam::driver_name::DriverName;
use crate::webcam::error::CameraError;
use crate::webcam::list::{CameraListing, CameraMode};
use crate::webcam::negotiation::FormatRequest;
use crate::webcam::picture::{Layout, PictureFormat};
use crate::webcam::session::guarded;

const CODES: [(Layout, &[u8; 4]); 6] = [
    (Layout::Yuyv, b"YUYV"),
    (Layout::Nv12, b"NV12"),
    (Layout::Mjpeg, b"MJPG"),
    (Layout::Mjpeg, b"JPEG"),
    (Layout::Rgb, b"RGB3"),
    (Layout::Grey, b"GREY"),
];
/// Sizes and rates that a driver may list, each: no camera has more.
const MAX_LISTED_MODES: usize = 200;

fn layout_of(code: FourCC) -> Option<Layout> {
    CODES.into_iter().find(|(_, other)| **other == code.repr).map(|(layout, _)| layout)
}

/// Queries the driver. The `v4l` crate panics at values that it does not define; they become
/// errors.
pub fn query<T>(ask: impl FnOnce() -> io::Result<T>) -> io::Result<T> {
    guarded(ask).unwrap_or_else(|_| Err(io::Error::other("its driver's answer is invalid")))
}

/// The numbers of the system's video devices, ascending.
fn numbers() -> Vec<usize> {
    let entries = std::fs::read_dir("/dev").into_iter().flatten().flatten();
    let number = |entry: std::fs::DirEntry| entry.file_name().to_str()?.strip_prefix("video")?.parse().ok();
    let mut numbers: Vec<usize> = entries.filter_map(number).collect();
    numbers.sort_unstable();
    numbers
}

pub fn path_of(number: usize) -> PathBuf {
    PathBuf::from(format!("/dev/video{number}"))
}

/// The system's name of a device.
pub fn name_of(number: usize) -> String {
    let file = format!("/sys/class/video4linux/video{number}/name");
    let name = std::fs::read_to_string(file).unwrap_or_default();
    if name.trim().is_empty() { format!("video{number}") } else { quoted(name.trim()) }
}

/// The number of the camera that is called so, at its old place first.
pub fn find(number: usize, name: &str) -> Option<usize> {
    let numbers = numbers();
    let mut by_name = numbers.iter().copied().filter(|other| name_of(*other) == name);
    let stays = numbers.contains(&number) && name_of(number) == name;
    if stays { Some(number) } else { by_name.next() }
}

fn takes_pictures(device: &Device) -> bool {
    let capabilities = query(|| device.query_caps()).map(|caps| caps.capabilities);
    capabilities.is_ok_and(|caps| caps.contains(Flags::VIDEO_CAPTURE | Flags::STREAMING))
}

pub fn cameras() -> Vec<CameraListing> {
    numbers().into_iter().filter_map(listed).collect()
}

fn listed(number: usize) -> Option<CameraListing> {
    let modes = match modes_of(number) {
        Err(CameraError::NoCapture { .. }) => return None,
        modes => modes.map_err(|error| error.to_string()),
    };
    let place = path_of(number).display().to_string();
    Some(CameraListing { driver: DriverName::V4l2, number, name: name_of(number), place, modes })
}

/// Opens a device.
pub fn open(path: &Path) -> Result<Device, CameraError> {
    Device::with_path(path).map_err(|error| why(path, error))
}

/// A system's error in words.
pub fn why(path: &Path, error: io::Error) -> CameraError {
    let camera = path.display().to_string();
    match error.kind() {
        ErrorKind::PermissionDenied => CameraError::Permission { advice: permission::advice(path), camera },
        ErrorKind::ResourceBusy => CameraError::Busy { camera },
        ErrorKind::NotFound => CameraError::NotACamera { name: camera, cameras: names() },
        _ => CameraError::Driver { camera, problem: reason(&error) },
    }
}

/// The cameras that there are, for a message.
pub fn names() -> Vec<String> {
    cameras().into_iter().map(|camera| format!("{} ({})", camera.number, camera.name)).collect()
}

/// Everything that a camera offers.
fn modes(device: &Device) -> io::Result<Vec<CameraMode>> {
    let mut modes = Vec::new();
    for format in query(|| device.enum_formats())? {
        let sizes = query(|| device.enum_framesizes(format.fourcc)).unwrap_or_default();
        for size in sizes.into_iter().take(MAX_LISTED_MODES) {
            let sizes = match size.size {
                FrameSizeEnum::Discrete(size) => [(size.width, size.height); 2],
                FrameSizeEnum::Stepwise(step) => [(step.min_width, step.min_height), (step.max_width, step.max_height)],
            };
            let (width, height) = sizes[0];
            let intervals = query(|| device.enum_frameintervals(format.fourcc, width, height)).unwrap_or_default();
            let mut rates_hz: Vec<f64> =
                intervals.into_iter().take(MAX_LISTED_MODES).flat_map(|i| rates(&i.interval)).collect();
            rates_hz.sort_by(f64::total_cmp);
            let code = quoted(format.fourcc.str().unwrap_or("????").trim());
            modes.push(CameraMode { code, layout: layout_of(format.fourcc), sizes, rates_hz });
        }
    }
    Ok(modes)
}

fn rates(interval: &FrameIntervalEnum) -> Vec<f64> {
    match interval {
        FrameIntervalEnum::Discrete(interval) => rate(*interval).into_iter().collect(),
        FrameIntervalEnum::Stepwise(step) => [step.max, step.min].into_iter().filter_map(rate).collect(),
    }
}

fn rate(interval: Fraction) -> Option<f64> {
    let rate_hz = f64::from(interval.denominator) / f64::from(interval.numerator);
    (rate_hz.is_finite() && rate_hz > 0.0).then_some(rate_hz)
}

/// The interval of a rate, to a thousandth of a hertz, in lowest terms: some drivers keep the
/// fraction as it is, and other programs expect 1/30.
fn interval(rate_hz: f64) -> Fraction {
    let millihertz = (1000.0 * rate_hz).round().max(1.0) as u32;
    let gcd = |mut a: u32, mut b: u32| {
        while b > 0 {
            (a, b) = (b, a % b);
        }
        a
    };
    let divisor = gcd(1000, millihertz);
    Fraction::new(1000 / divisor, millihertz / divisor)
}

/// Sets the camera's format closest to the requested one. Returns the negotiated format, and the
/// rate, Hz.
pub fn agree(
    device: &Device,
    path: &Path,
    requested: &FormatRequest,
) -> Result<(PictureFormat, Option<f64>), CameraError> {
    let failed = |error| why(path, error);
    if !takes_pictures(device) {
        return Err(CameraError::NoCapture { camera: path.display().to_string() });
    }
    let offered = modes(device).map_err(failed)?;
    let refused = || CameraError::layout(&path.display().to_string(), &choose::names(requested.layout), &offered);
    let layout = choose::layout(&offered, requested).ok_or_else(refused)?;
    let nearest = ExactMode { layout, size: requested.size, rate_hz: requested.rate_hz };
    let (format, rate_hz) = set(device, &nearest).map_err(failed)?;
    let layout = layout_of(format.fourcc).ok_or_else(|| CameraError::Layout {
        camera: path.display().to_string(),
        layout: layout.to_string(),
        has: quoted(format.fourcc.str().unwrap_or("????")),
    })?;
    let ycbcr_enc = encoding::stated(device).unwrap_or(encoding::DEFAULT);
    Ok((picture_format(&format, ycbcr_enc, layout, requested), rate_hz))
}

/// Sets the mode that is nearest to one. Returns its format, and its rate, Hz.
fn set(device: &Device, mode: &ExactMode) -> io::Result<(Format, Option<f64>)> {
    let formats = query(|| device.enum_formats())?;
    let code = formats.iter().map(|format| format.fourcc).find(|code| layout_of(*code) == Some(mode.layout));
    let (width, height) = mode.size;
    let format = query(|| device.set_format(&Format::new(width, height, code.unwrap_or(FourCC::new(b"YUYV")))))?;
    let parameters = Parameters::new(interval(mode.rate_hz));
    // Some drivers have no rates.
    let rate_hz = query(|| device.set_params(&parameters)).ok().and_then(|p| rate(p.interval));
    Ok((format, rate_hz))
}

/// Sets the mode of a camera that nobody reads.
pub fn set_mode(number: usize, mode: &ExactMode) -> Result<(), CameraError> {
    let path = path_of(number);
    set(&open(&path)?, mode).map(drop).map_err(|error| why(&path, error))
}

/// Everything that a camera offers. Leaves its mode as it is.
pub fn modes_of(number: usize) -> Result<Vec<CameraMode>, CameraError> {
    let path = path_of(number);
    let device = open(&path)?;
    if !takes_pictures(&device) {
        return Err(CameraError::NoCapture { camera: path.display().to_string() });
    }
    modes(&device).map_err(|error| why(&path, error))
}

/// A range that the driver leaves open follows from its colour space (V4L2_MAP_QUANTIZATION_DEFAULT
/// of the kernel's videodev2.h).
fn picture_format(format: &Format, ycbcr_enc: u32, layout: Layout, requested: &FormatRequest) -> PictureFormat {
    let matrix = encoding::matrix(ycbcr_enc, format.colorspace);
    let range = match (format.quantization, format.colorspace) {
        (Quantization::FullRange, _) | (Quantization::Default, Colorspace::JPEG) => ColorRange::Full,
        _ => ColorRange::Limited,
    };
    let (matrix, range) = match layout {
        Layout::Rgb => (ColorMatrix::Rgb, ColorRange::Full),
        Layout::Mjpeg => (ColorMatrix::Bt601, ColorRange::Full),
        Layout::Yuyv | Layout::Nv12 | Layout::Grey => {
            (requested.matrix.unwrap_or(matrix), requested.range.unwrap_or(range))
        }
    };
    let Format { width, height, stride, .. } = *format;
    PictureFormat { layout, width, height, stride: stride as usize, range, matrix }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn interval_is_in_lowest_terms() {
        let fraction = |rate_hz| {
            let Fraction { numerator, denominator } = interval(rate_hz);
            (numerator, denominator)
        };
        assert_eq!([30.0, 12.5, 29.97, 0.0].map(fraction), [(1, 30), (2, 25), (100, 2997), (1000, 1)]);
    }

    #[test]
    fn range_and_matrix_are_the_drivers_or_the_kernels_defaults() {
        let colours = |colorspace, quantization, layout, requested: FormatRequest| {
            let format = Format { colorspace, quantization, ..Format::new(2, 2, FourCC::new(b"YUYV")) };
            let picture_format = picture_format(&format, encoding::DEFAULT, layout, &requested);
            (picture_format.matrix, picture_format.range)
        };
        let none = FormatRequest::default();
        let bt709 = picture_format(&Format::new(2, 2, FourCC::new(b"YUYV")), 2, Layout::Yuyv, &none);
        assert_eq!(bt709.matrix, ColorMatrix::Bt709);
        let (srgb, unsaid) = (Colorspace::SRGB, Quantization::Default);
        assert_eq!(colours(srgb, unsaid, Layout::Yuyv, none), (ColorMatrix::Bt601, ColorRange::Limited));
        assert_eq!(colours(Colorspace::JPEG, unsaid, Layout::Yuyv, none), (ColorMatrix::Bt601, ColorRange::Full));
        let full = Quantization::FullRange;
        assert_eq!(colours(Colorspace::Rec709, full, Layout::Nv12, none), (ColorMatrix::Bt709, ColorRange::Full));
        assert_eq!(colours(Colorspace::Rec709, unsaid, Layout::Mjpeg, none), (ColorMatrix::Bt601, ColorRange::Full));
        let bt2020 = FormatRequest { range: Some(ColorRange::Full), matrix: Some(ColorMatrix::Bt2020), ..none };
        assert_eq!(colours(srgb, unsaid, Layout::Yuyv, bt2020), (ColorMatrix::Bt2020, ColorRange::Full));
        assert_eq!(colours(srgb, unsaid, Layout::Rgb, bt2020), (ColorMatrix::Rgb, ColorRange::Full));
    }
}
