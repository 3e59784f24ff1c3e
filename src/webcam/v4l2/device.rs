//! Pictures from a Video4Linux device, with the driver's times and counts.

use std::io;
use std::time::{Duration, Instant};

use v4l::buffer::{Flags, Metadata, Type};
use v4l::control::Value;
use v4l::io::mmap::Stream;
use v4l::io::traits::CaptureStream;
use v4l::{Device, Timestamp};

use super::negotiate::{self, agree, name_of, names, open, path_of, query, why};
use crate::webcam::camera_id::number;
use crate::webcam::clock::monotonic_s;
use crate::webcam::driver::{Driver, DriverPicture, DriverStream, Stamp};
use crate::webcam::driver_name::DriverName;
use crate::webcam::error::CameraError;
use crate::webcam::list::CameraListing;
use crate::webcam::negotiation::{AssumedColor, FormatRequest, NegotiatedFormat, TimeSource};
use crate::webcam::picture::PictureFormat;

/// Limits of the driver's wait for a picture. They are below those of [`SessionLimits::default`],
/// so that the driver reports a stall first.
///
/// [`SessionLimits::default`]: crate::webcam::session::SessionLimits::default
const FIRST_PICTURE_LIMIT: Duration = Duration::from_millis(14_500);
const PICTURE_LIMIT: Duration = Duration::from_millis(1500);
/// How often the exposure is read.
const EXPOSURE_EVERY: Duration = Duration::from_millis(500);
/// Buffers at the driver: one is filled, one waits.
const BUFFERS: u32 = 4;
/// `linux/v4l2-controls.h`: V4L2_CID_EXPOSURE_AUTO, of which 1 is by hand and 2 with the shutter by
/// hand, and V4L2_CID_EXPOSURE_ABSOLUTE, in units of 100 µs.
const EXPOSURE_AUTO: u32 = 0x009a_0901;
const EXPOSURE: u32 = 0x009a_0902;

/// Video4Linux. A camera's id is its number or the path of its device.
pub struct V4l2;

/// An open device.
struct V4l2Capture {
    device: Device,
    stream: Stream<'static>,
    picture_format: PictureFormat,
    stamps: BufferStamps,
    /// Last known exposure time, seconds.
    exposure_s: Option<f64>,
    exposure_read: Option<Instant>,
}

/// The number and the arrival, s, of the picture before; see [`BufferStamps::lost`].
struct BufferStamps {
    before: Option<(u32, f64)>,
    rate_hz: Option<f64>,
}

impl Driver for V4l2 {
    fn cameras(&self) -> Result<Vec<CameraListing>, CameraError> {
        Ok(negotiate::cameras())
    }

    fn find(&self, id: &str, name: &str) -> Option<String> {
        negotiate::find(number(id)?, name).map(|number| number.to_string())
    }

    fn open(
        &self,
        id: &str,
        requested: &FormatRequest,
    ) -> Result<(Box<dyn DriverStream>, NegotiatedFormat), CameraError> {
        let none = || CameraError::NotACamera { name: id.to_owned(), cameras: names() };
        let number = number(id).ok_or_else(none)?;
        let path = path_of(number);
        if !path.exists() {
            return Err(none());
        }
        let device = open(&path)?;
        let (picture_format, rate_hz) = agree(&device, &path, requested)?;
        // Another program that takes pictures is found here.
        let stream = query(|| Stream::with_buffers(&device, Type::VideoCapture, BUFFERS));
        let stream = stream.map_err(|error| why(&path, error))?;
        let exposure_s = exposure(&device);
        let negotiated = NegotiatedFormat {
            driver: DriverName::V4l2,
            name: name_of(number),
            picture_format,
            rate_hz,
            times: TimeSource::Driver,
            has_exposure: exposure_s.is_some(),
            assumed: AssumedColor::default(),
            warnings: Vec::new(),
        };
        let stamps = BufferStamps { before: None, rate_hz };
        let capture = V4l2Capture { device, stream, picture_format, stamps, exposure_s, exposure_read: None };
        Ok((Box::new(capture), negotiated))
    }
}

impl DriverStream for V4l2Capture {
    fn next(&mut self) -> Result<Option<DriverPicture>, String> {
        if self.exposure_s.is_some() && self.exposure_read.is_none_or(|at| at.elapsed() > EXPOSURE_EVERY) {
            self.exposure_read = Some(Instant::now());
            self.exposure_s = exposure(&self.device).or(self.exposure_s);
        }
        let limit = if self.stamps.before.is_none() { FIRST_PICTURE_LIMIT } else { PICTURE_LIMIT };
        self.stream.set_timeout(limit);
        let (bytes, metadata) = self.stream.next().map_err(|error| stopped(&error, limit))?;
        let arrived_s = monotonic_s();
        let dropped_frames = self.stamps.dropped_frames(metadata.sequence, arrived_s);
        // Drivers that do not report the length have filled the buffer.
        let length = if metadata.bytesused == 0 { bytes.len() } else { metadata.bytesused as usize };
        Ok(Some(DriverPicture {
            picture_format: self.picture_format,
            bytes: bytes.get(..length).unwrap_or(bytes).to_vec(),
            stamp: stamp(metadata),
            arrived_s,
            exposure_s: self.exposure_s,
            dropped_frames,
            is_damaged: metadata.flags.contains(Flags::ERROR),
        }))
    }
}

impl BufferStamps {
    /// Pictures lost since the one before, by the driver's count. A count that goes back has begun
    /// anew, and one that leaps by more pictures than fit into the time is ignored: v4l2loopback's
    /// first picture is always its number 0.
    fn dropped_frames(&mut self, sequence: u32, time_s: f64) -> u64 {
        let Some((before, before_s)) = self.before.replace((sequence, time_s)) else { return 0 };
        let gap = f64::from(sequence.checked_sub(before).unwrap_or(1).saturating_sub(1));
        let max_gap = self.rate_hz.map_or(f64::INFINITY, |rate_hz| 2.0 + 1.5 * (time_s - before_s) * rate_hz);
        if gap > max_gap { 0 } else { gap as u64 }
    }
}

/// The driver's time. Stamps that are flagged as unknown or copied are monotonic in most drivers.
fn stamp(metadata: &Metadata) -> Stamp {
    let Timestamp { sec, usec } = metadata.timestamp;
    let time_s = sec as f64 + 1e-6 * usec as f64;
    let is_monotonic = (metadata.flags & Flags::TIMESTAMP_MASK) == Flags::TIMESTAMP_MONOTONIC;
    if is_monotonic { Stamp::Monotonic(time_s) } else { Stamp::UnnamedClock(time_s) }
}

/// Exposure time, seconds, if it was set by hand. Drivers do not report automatic exposure
/// reliably.
fn exposure(device: &Device) -> Option<f64> {
    let value = |id| match query(|| device.control(id)).ok()?.value {
        Value::Integer(value) => Some(value),
        _ => None,
    };
    if !matches!(value(EXPOSURE_AUTO)?, 1 | 2) {
        return None;
    }
    value(EXPOSURE).filter(|ticks| (1..=600_000).contains(ticks)).map(|ticks| 1e-4 * ticks as f64)
}

fn stopped(error: &io::Error, limit: Duration) -> String {
    match error.kind() {
        io::ErrorKind::TimedOut => format!("no picture came for {} s", limit.as_secs_f64()),
        // ENODEV: unplugged.
        _ if error.raw_os_error() == Some(19) => "it was unplugged".to_owned(),
        _ => crate::text::reason(error),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sequence_gaps_count_dropped_frames() {
        let mut stamps = BufferStamps { before: None, rate_hz: Some(30.0) };
        let came =
            [(5, 0.0), (6, 0.03), (9, 0.13), (10, 0.16), (0, 0.2), (1, 0.23), (3, 0.3), (1492, 0.34), (1493, 0.37)];
        let dropped_frames: Vec<u64> = came.into_iter().map(|(n, time_s)| stamps.dropped_frames(n, time_s)).collect();
        assert_eq!(dropped_frames, [0, 0, 2, 0, 0, 0, 1, 0, 0]);
        // Without a rate nothing speaks against it.
        let mut stamps = BufferStamps { before: None, rate_hz: None };
        assert_eq!([(0, 0.0), (1492, 0.04)].map(|(n, time_s)| stamps.dropped_frames(n, time_s)), [0, 1491]);
    }

    #[test]
    fn stamp_without_the_monotonic_flag_is_of_an_unnamed_clock() {
        let stamp_of =
            |flags| stamp(&Metadata { flags, timestamp: Timestamp::new(99, 500_000), ..Metadata::default() });
        assert_eq!(stamp_of(Flags::TIMESTAMP_MONOTONIC), Stamp::Monotonic(99.5));
        assert_eq!(stamp_of(Flags::TIMESTAMP_MONOTONIC | Flags::TSTAMP_SRC_SOE), Stamp::Monotonic(99.5));
        assert_eq!(stamp_of(Flags::TIMESTAMP_COPY), Stamp::UnnamedClock(99.5));
        assert_eq!(stamp_of(Flags::empty()), Stamp::UnnamedClock(99.5));
    }
}
