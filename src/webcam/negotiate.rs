//! Video4Linux: finding a camera, and agreeing with it on size, rate and layout.
//!
//! Through the `v4l` crate, and not through nokhwa above it: nokhwa loses the length of a JPEG picture, the driver's own
//! time and count, the colour range, and every rate that is not whole; and it waits without end for a camera that has
//! stopped.

use std::io::{self, ErrorKind};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};

use v4l::capability::Flags;
use v4l::format::{Colorspace, Quantization};
use v4l::frameinterval::FrameIntervalEnum;
use v4l::framesize::FrameSizeEnum;
use v4l::video::Capture;
use v4l::video::capture::Parameters;
use v4l::{Device, Format, FourCC, Fraction};

use super::encoding;
use super::error::CameraError;
use super::list::{Listed, Mode};
use super::picture::{Delivered, Layout};
use super::wanted::Wanted;
use crate::source::video::{ColorMatrix, ColorRange};
use crate::words::{quoted, reason};

const CODES: [(Layout, &[u8; 4]); 5] = [
    (Layout::Yuyv, b"YUYV"),
    (Layout::Nv12, b"NV12"),
    (Layout::Mjpeg, b"MJPG"),
    (Layout::Mjpeg, b"JPEG"),
    (Layout::Rgb, b"RGB3"),
];
/// Sizes and rates that a driver may list, each: no camera has more.
const MOST_LISTED: usize = 200;

fn layout_of(code: FourCC) -> Option<Layout> {
    CODES.into_iter().find(|(_, known)| **known == code.repr).map(|(layout, _)| layout)
}

/// What the driver answers, which the crate below refuses by a panic where it does not know it.
pub fn asked<T>(ask: impl FnOnce() -> io::Result<T>) -> io::Result<T> {
    let refused = |_| Err(io::Error::other("its driver's answer is not understood"));
    catch_unwind(AssertUnwindSafe(ask)).unwrap_or_else(refused)
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
    let known = asked(|| device.query_caps()).map(|caps| caps.capabilities);
    known.is_ok_and(|caps| caps.contains(Flags::VIDEO_CAPTURE | Flags::STREAMING))
}

pub fn cameras() -> Vec<Listed> {
    numbers().into_iter().filter_map(listed).collect()
}

fn listed(number: usize) -> Option<Listed> {
    let path = path_of(number);
    let modes = match open(&path) {
        Ok(device) if !takes_pictures(&device) => return None,
        Ok(device) => modes(&device).map_err(|error| why(&path, error).to_string()),
        Err(error) => Err(error.to_string()),
    };
    Some(Listed { number, name: name_of(number), path, modes })
}

/// Opens a device.
pub fn open(path: &Path) -> Result<Device, CameraError> {
    Device::with_path(path).map_err(|error| why(path, error))
}

/// A system's error in words.
pub fn why(path: &Path, error: io::Error) -> CameraError {
    let path = path.to_owned();
    match error.kind() {
        ErrorKind::PermissionDenied => CameraError::Permission { advice: advice(&path), path },
        ErrorKind::ResourceBusy => CameraError::Busy { path },
        ErrorKind::NotFound => CameraError::None { asked: path.display().to_string(), found: names() },
        _ => CameraError::Driver { path, problem: reason(&error) },
    }
}

/// The cameras that there are, for a message.
pub fn names() -> Vec<String> {
    cameras().into_iter().map(|camera| format!("{} ({})", camera.number, camera.name)).collect()
}

/// Who may open a device, by its group.
fn advice(path: &Path) -> String {
    use std::os::unix::fs::MetadataExt;
    let gid = std::fs::metadata(path).map(|metadata| metadata.gid()).ok();
    let groups = std::fs::read_to_string("/etc/group").unwrap_or_default();
    let named = |line: &str| {
        let mut parts = line.split(':');
        let name = parts.next()?.to_owned();
        (parts.nth(1)?.parse().ok() == gid).then_some(name).filter(|_| gid.is_some())
    };
    // Nobody should be of root's group for a camera.
    match groups.lines().find_map(named).filter(|_| gid != Some(0)) {
        Some(group) => {
            format!("the group {group} may, and you are not of it; `sudo usermod -aG {group} $USER`, then log in anew")
        }
        None => "only root may; whoever looks after this machine can give it to the group video".to_owned(),
    }
}

/// Everything that a camera offers.
fn modes(device: &Device) -> io::Result<Vec<Mode>> {
    let mut modes = Vec::new();
    for format in asked(|| device.enum_formats())? {
        let sizes = asked(|| device.enum_framesizes(format.fourcc)).unwrap_or_default();
        for size in sizes.into_iter().take(MOST_LISTED) {
            let sizes = match size.size {
                FrameSizeEnum::Discrete(size) => [(size.width, size.height); 2],
                FrameSizeEnum::Stepwise(step) => [(step.min_width, step.min_height), (step.max_width, step.max_height)],
            };
            let (width, height) = sizes[0];
            let intervals = asked(|| device.enum_frameintervals(format.fourcc, width, height)).unwrap_or_default();
            let mut rates_hz: Vec<f64> =
                intervals.into_iter().take(MOST_LISTED).flat_map(|i| rates(&i.interval)).collect();
            rates_hz.sort_by(f64::total_cmp);
            let code = quoted(format.fourcc.str().unwrap_or("????").trim());
            modes.push(Mode { code, layout: layout_of(format.fourcc), sizes, rates_hz });
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

/// Has a camera take what comes nearest to what is wanted. Gives what it agreed to, and the rate, Hz.
pub fn agree(device: &Device, path: &Path, wanted: &Wanted) -> Result<(Delivered, Option<f64>), CameraError> {
    let failed = |error| why(path, error);
    if !takes_pictures(device) {
        return Err(CameraError::TakesNone { path: path.to_owned() });
    }
    let offered = modes(device).map_err(failed)?;
    let layout = chosen(&offered, wanted).ok_or_else(|| {
        let mut has: Vec<&str> = offered.iter().map(|mode| mode.code.as_str()).collect();
        has.dedup();
        CameraError::Layout { path: path.to_owned(), asked: names_of(wanted.layout), has: has.join(", ") }
    })?;
    let formats = asked(|| device.enum_formats()).map_err(failed)?;
    let code = formats.iter().map(|format| format.fourcc).find(|code| layout_of(*code) == Some(layout));
    let (width, height) = wanted.size;
    let format = Format::new(width, height, code.unwrap_or(FourCC::new(b"YUYV")));
    let format = asked(|| device.set_format(&format)).map_err(failed)?;
    // In units of a millisecond of a picture, so that 29.97 is told from 30.
    let interval = Fraction::new(1000, (1000.0 * wanted.rate_hz).round().max(1.0) as u32);
    // Some drivers have no rates.
    let rate_hz = asked(|| device.set_params(&Parameters::new(interval))).ok().and_then(|p| rate(p.interval));
    let layout = layout_of(format.fourcc).ok_or_else(|| CameraError::Layout {
        path: path.to_owned(),
        asked: layout.to_string(),
        has: quoted(format.fourcc.str().unwrap_or("????")),
    })?;
    let ycbcr_enc = encoding::stated(device).unwrap_or(encoding::DEFAULT);
    Ok((delivered(&format, ycbcr_enc, layout, wanted), rate_hz))
}

fn names_of(asked: Option<Layout>) -> String {
    asked.map_or_else(|| Layout::PREFERRED.map(Layout::name).join(", "), |layout| layout.to_string())
}

/// The layout that was asked for, or the best of those that come in this size at this rate, else of all.
fn chosen(offered: &[Mode], wanted: &Wanted) -> Option<Layout> {
    let has = |layout: Layout, fits: &dyn Fn(&Mode) -> bool| {
        offered.iter().any(|mode| mode.layout == Some(layout) && fits(mode))
    };
    if let Some(layout) = wanted.layout {
        return has(layout, &|_| true).then_some(layout);
    }
    let fits = |mode: &Mode| {
        let [least, most] = mode.sizes;
        let (w, h) = wanted.size;
        let in_size = (least.0..=most.0).contains(&w) && (least.1..=most.1).contains(&h);
        // A rate of 30 is met by 29.97.
        in_size && (mode.rates_hz.is_empty() || mode.rates_hz.iter().any(|rate| *rate > 0.99 * wanted.rate_hz))
    };
    let of = |fits: &dyn Fn(&Mode) -> bool| Layout::PREFERRED.into_iter().find(|layout| has(*layout, fits));
    of(&fits).or_else(|| of(&|_| true))
}

/// A range that the driver leaves open follows from its colour space (V4L2_MAP_QUANTIZATION_DEFAULT of the kernel's
/// videodev2.h).
fn delivered(format: &Format, ycbcr_enc: u32, layout: Layout, wanted: &Wanted) -> Delivered {
    let matrix = encoding::matrix(ycbcr_enc, format.colorspace);
    let range = match (format.quantization, format.colorspace) {
        (Quantization::FullRange, _) | (Quantization::Default, Colorspace::JPEG) => ColorRange::Full,
        _ => ColorRange::Limited,
    };
    let (matrix, range) = match layout {
        Layout::Rgb => (ColorMatrix::Rgb, ColorRange::Full),
        Layout::Mjpeg => (ColorMatrix::Bt601, ColorRange::Full),
        Layout::Yuyv | Layout::Nv12 => (wanted.matrix.unwrap_or(matrix), wanted.range.unwrap_or(range)),
    };
    let Format { width, height, stride, .. } = *format;
    Delivered { layout, width, height, stride: stride as usize, range, matrix }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mode(layout: Layout, size: (u32, u32), rates_hz: &[f64]) -> Mode {
        Mode { code: String::new(), layout: Some(layout), sizes: [size; 2], rates_hz: rates_hz.to_vec() }
    }

    #[test]
    fn what_is_chosen_is_as_fast_as_asked() {
        // A webcam as they are: raw at 30 only when small.
        let offered = [
            mode(Layout::Yuyv, (640, 480), &[30.0, 15.0]),
            mode(Layout::Yuyv, (1280, 720), &[10.0]),
            mode(Layout::Mjpeg, (1280, 720), &[29.97]),
        ];
        let of = |size, layout| chosen(&offered, &Wanted { size, layout, ..Wanted::default() });
        assert_eq!(of((640, 480), None), Some(Layout::Yuyv));
        assert_eq!(of((1280, 720), None), Some(Layout::Mjpeg));
        assert_eq!(of((1280, 720), Some(Layout::Yuyv)), Some(Layout::Yuyv));
        assert_eq!(of((640, 480), Some(Layout::Nv12)), None);
        // Nothing fits: the nearest of all.
        assert_eq!(of((99, 99), None), Some(Layout::Yuyv));
    }

    #[test]
    fn range_and_matrix_are_the_drivers_or_the_kernels_defaults() {
        let of = |colorspace, quantization, layout, wanted: Wanted| {
            let format = Format { colorspace, quantization, ..Format::new(2, 2, FourCC::new(b"YUYV")) };
            let delivered = delivered(&format, encoding::DEFAULT, layout, &wanted);
            (delivered.matrix, delivered.range)
        };
        let none = Wanted::default();
        let bt709 = delivered(&Format::new(2, 2, FourCC::new(b"YUYV")), 2, Layout::Yuyv, &none);
        assert_eq!(bt709.matrix, ColorMatrix::Bt709);
        let (srgb, unsaid) = (Colorspace::SRGB, Quantization::Default);
        assert_eq!(of(srgb, unsaid, Layout::Yuyv, none), (ColorMatrix::Bt601, ColorRange::Limited));
        assert_eq!(of(Colorspace::JPEG, unsaid, Layout::Yuyv, none), (ColorMatrix::Bt601, ColorRange::Full));
        let full = Quantization::FullRange;
        assert_eq!(of(Colorspace::Rec709, full, Layout::Nv12, none), (ColorMatrix::Bt709, ColorRange::Full));
        assert_eq!(of(Colorspace::Rec709, unsaid, Layout::Mjpeg, none), (ColorMatrix::Bt601, ColorRange::Full));
        let said = Wanted { range: Some(ColorRange::Full), matrix: Some(ColorMatrix::Bt2020), ..none };
        assert_eq!(of(srgb, unsaid, Layout::Yuyv, said), (ColorMatrix::Bt2020, ColorRange::Full));
        assert_eq!(of(srgb, unsaid, Layout::Rgb, said), (ColorMatrix::Rgb, ColorRange::Full));
    }
}
