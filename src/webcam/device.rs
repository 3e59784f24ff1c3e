//! A camera's thread.

use std::io;
use std::path::Path;
use std::time::{Duration, Instant};

use v4l::buffer::{Flags, Metadata, Type};
use v4l::control::Value;
use v4l::io::mmap::Stream;
use v4l::io::traits::CaptureStream;
use v4l::{Device, Timestamp};

use super::clock::monotonic_s;
use super::error::CameraError;
use super::negotiate::{agree, asked, find, name_of, open, path_of, why};
use super::newest::{Drops, Putter};
use super::picture::{Delivered, Picture};
use super::wanted::{Given, Wanted};

/// Without a picture for so long, a camera counts as stopped.
const PATIENCE: Duration = Duration::from_secs(2);
/// How often one that is gone is looked for, and how often its exposure is asked for.
const AGAIN: Duration = Duration::from_millis(500);
/// Buffers at the driver: one is filled, one waits.
const BUFFERS: u32 = 4;
/// `linux/v4l2-controls.h`: V4L2_CID_EXPOSURE_AUTO, of which 1 is by hand and 2 with the shutter by hand, and
/// V4L2_CID_EXPOSURE_ABSOLUTE, in units of 100 µs.
const EXPOSURE_AUTO: u32 = 0x009a_0901;
const EXPOSURE: u32 = 0x009a_0902;

/// A camera that has agreed, and delivers from the first call of [`Running::run`] on.
pub struct Running {
    number: usize,
    name: String,
    wanted: Wanted,
    delivered: Delivered,
    /// Pictures a second, if the driver says.
    rate_hz: Option<f64>,
    /// What pictures were last exposed for, seconds, if that is known at all.
    exposure_s: Option<f64>,
    device: Option<Device>,
}

/// The number and the time, s, of the picture before; see [`stamped`].
struct Stamps {
    before: Option<(u32, f64)>,
    rate_hz: Option<f64>,
}

impl Running {
    pub fn open(number: usize, wanted: &Wanted) -> Result<(Self, Given), CameraError> {
        let path = path_of(number);
        let device = open(&path)?;
        let (delivered, rate_hz) = agree(&device, &path, wanted)?;
        // Another program that takes pictures is found here.
        drop(asked(|| Stream::with_buffers(&device, Type::VideoCapture, BUFFERS)).map_err(|error| why(&path, error))?);
        let exposure_s = exposure(&device);
        let name = name_of(number);
        let given =
            Given { name: name.clone(), delivered, rate_hz, has_exposure: exposure_s.is_some(), warnings: Vec::new() };
        let device = Some(device);
        Ok((Self { number, name, wanted: *wanted, delivered, rate_hz, exposure_s, device }, given))
    }

    /// Delivers until nobody takes pictures any more. A camera that goes is waited for.
    pub fn run(mut self, putter: &Putter<Picture>) {
        while !putter.is_over() {
            let device = self.device.take().map_or_else(|| self.again(), Ok);
            let ended = device.map(|device| asked(|| self.deliver(&device, putter)));
            match ended {
                Ok(Ok(())) => return,
                Ok(Err(error)) => putter.gone(format!("{} stopped: {}", self.name, stopped(&error))),
                Err(problem) => putter.gone(problem),
            }
            putter.rest(AGAIN);
        }
    }

    /// Opens it again, wherever it is now. What it gives must be what was agreed on.
    fn again(&mut self) -> Result<Device, String> {
        let number = find(self.number, &self.name).ok_or_else(|| format!("{} is unplugged", self.name))?;
        let path = path_of(number);
        let device = open(&path).map_err(|error| error.to_string())?;
        let (delivered, _) = agree(&device, &path, &self.wanted).map_err(|error| error.to_string())?;
        if delivered != self.delivered {
            return Err(format!("{} gives {delivered} now, and gave {} before", self.name, self.delivered));
        }
        self.number = number;
        Ok(device)
    }

    fn deliver(&mut self, device: &Device, putter: &Putter<Picture>) -> io::Result<()> {
        let mut stream = Stream::with_buffers(device, Type::VideoCapture, BUFFERS)?;
        stream.set_timeout(PATIENCE);
        let mut stamps = Stamps { before: None, rate_hz: self.rate_hz };
        let mut asked_at = None;
        while !putter.is_over() {
            let (bytes, metadata) = stream.next()?;
            let time_s = stamped(metadata, monotonic_s());
            let lost = stamps.lost(metadata.sequence, time_s);
            if self.exposure_s.is_some() && asked_at.is_none_or(|at: Instant| at.elapsed() > AGAIN) {
                asked_at = Some(Instant::now());
                self.exposure_s = exposure(device).or(self.exposure_s);
            }
            let exposure_s = self.exposure_s;
            let is_damaged = metadata.flags.contains(Flags::ERROR);
            putter.count(Drops { lost, damaged: u64::from(is_damaged), ..Drops::default() });
            if is_damaged {
                continue;
            }
            // Drivers that do not say it have filled all.
            let length = if metadata.bytesused == 0 { bytes.len() } else { metadata.bytesused as usize };
            let bytes = bytes.get(..length).unwrap_or(bytes).to_vec();
            putter.put(Picture { delivered: self.delivered, bytes, time_s, exposure_s });
        }
        Ok(())
    }
}

impl Stamps {
    /// Pictures lost since the one before, by the driver's count. A count that goes back has begun anew, and one that leaps
    /// by more pictures than came in the time says nothing: v4l2loopback's first picture is always its number 0.
    fn lost(&mut self, sequence: u32, time_s: f64) -> u64 {
        let Some((before, before_s)) = self.before.replace((sequence, time_s)) else { return 0 };
        let lost = f64::from(sequence.checked_sub(before).unwrap_or(1).saturating_sub(1));
        let most = self.rate_hz.map_or(f64::INFINITY, |rate_hz| 2.0 + 1.5 * (time_s - before_s) * rate_hz);
        if lost > most { 0 } else { lost as u64 }
    }
}

/// The driver's time. One that is not of the monotonic clock, or is not of now, gives way to when the picture came.
fn stamped(metadata: &Metadata, now_s: f64) -> f64 {
    let Timestamp { sec, usec } = metadata.timestamp;
    let time_s = sec as f64 + 1e-6 * usec as f64;
    let is_monotonic = (metadata.flags & Flags::TIMESTAMP_MASK) == Flags::TIMESTAMP_MONOTONIC;
    if is_monotonic && (now_s - 10.0..=now_s).contains(&time_s) { time_s } else { now_s }
}

/// How long the shutter is open, seconds, where somebody has set it. One that the camera sets itself is not reliably told.
fn exposure(device: &Device) -> Option<f64> {
    let value = |id| match asked(|| device.control(id)).ok()?.value {
        Value::Integer(value) => Some(value),
        _ => None,
    };
    if !matches!(value(EXPOSURE_AUTO)?, 1 | 2) {
        return None;
    }
    value(EXPOSURE).filter(|ticks| (1..=600_000).contains(ticks)).map(|ticks| 1e-4 * ticks as f64)
}

fn stopped(error: &io::Error) -> String {
    match error.kind() {
        io::ErrorKind::TimedOut => format!("no picture came for {} s", PATIENCE.as_secs()),
        // ENODEV: unplugged.
        _ if error.raw_os_error() == Some(19) => "it was unplugged".to_owned(),
        _ => crate::words::reason(error),
    }
}

/// The number of a camera by its number or its device's path.
pub fn number(asked: &str) -> Option<usize> {
    let name = Path::new(asked).strip_prefix("/dev").ok().and_then(|name| name.to_str()?.strip_prefix("video"));
    name.unwrap_or(asked).parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_drivers_count_tells_what_was_lost() {
        let mut stamps = Stamps { before: None, rate_hz: Some(30.0) };
        let came =
            [(5, 0.0), (6, 0.03), (9, 0.13), (10, 0.16), (0, 0.2), (1, 0.23), (3, 0.3), (1492, 0.34), (1493, 0.37)];
        let lost: Vec<u64> = came.into_iter().map(|(n, time_s)| stamps.lost(n, time_s)).collect();
        assert_eq!(lost, [0, 0, 2, 0, 0, 0, 1, 0, 0]);
        // Without a rate nothing speaks against it.
        let mut stamps = Stamps { before: None, rate_hz: None };
        assert_eq!([(0, 0.0), (1492, 0.04)].map(|(n, time_s)| stamps.lost(n, time_s)), [0, 1491]);
    }

    #[test]
    fn a_time_of_another_clock_gives_way_to_the_arrival() {
        let of = |flags, sec, usec| {
            stamped(&Metadata { flags, timestamp: Timestamp::new(sec, usec), ..Metadata::default() }, 100.0)
        };
        assert_eq!(of(Flags::TIMESTAMP_MONOTONIC, 99, 500_000), 99.5);
        assert_eq!(of(Flags::TIMESTAMP_MONOTONIC | Flags::TSTAMP_SRC_SOE, 99, 0), 99.0);
        for (flags, sec) in
            [(Flags::TIMESTAMP_COPY, 99), (Flags::TIMESTAMP_MONOTONIC, 0), (Flags::TIMESTAMP_MONOTONIC, 101)]
        {
            assert_eq!(of(flags, sec, 0), 100.0);
        }
    }

    #[test]
    fn cameras_are_named_by_number_or_device() {
        assert_eq!(
            ["0", "/dev/video12", "video.mp4", "/dev/null", "x"].map(number),
            [Some(0), Some(12), None, None, None]
        );
    }
}
