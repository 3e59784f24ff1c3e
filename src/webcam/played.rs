//! A video in place of a camera, played once at its own rate.

use std::path::Path;
use std::time::Duration;

use super::clock::monotonic_s;
use super::driver::{Driver, DriverPicture, DriverStream, Stamp};
use super::driver_name::DriverName;
use super::error::CameraError;
use super::list::CameraListing;
use super::negotiation::{AssumedColor, FormatRequest, NegotiatedFormat, TimeSource};
use super::picture::{Layout, PictureFormat};
use crate::coding::{ColorMatrix, ColorRange};
use crate::pixels::{Codes, eight_bits};
use crate::source::decoding::VideoFrames;
use crate::source::video::{Overrides, Video, probe};
use crate::tracking::median_interval_s;

/// Video files. The id is a file's path.
pub struct VideoFileDriver;

struct PlayedCapture {
    video: Video,
    frames: VideoFrames,
    picture_format: PictureFormat,
    next: usize,
    /// When the first picture came, s.
    first_s: Option<f64>,
}

impl Driver for VideoFileDriver {
    fn cameras(&self) -> Result<Vec<CameraListing>, CameraError> {
        Ok(Vec::new())
    }

    fn find(&self, id: &str, _: &str) -> Option<String> {
        Some(id.to_owned())
    }

    fn open(
        &self,
        id: &str,
        requested: &FormatRequest,
    ) -> Result<(Box<dyn DriverStream>, NegotiatedFormat), CameraError> {
        let overrides = Overrides { range: requested.range, matrix: requested.matrix, ..Overrides::default() };
        let video = probe(Path::new(id), &overrides)?;
        let frames = video.read(0..video.timestamps_s.len())?;
        let (width, height) = (video.width, video.height);
        let (layout, range, matrix) = (Layout::Rgb, ColorRange::Full, ColorMatrix::Rgb);
        let picture_format = PictureFormat { layout, width, height, stride: layout.row_bytes(width), range, matrix };
        let name = id.to_owned();
        let warning = video.presentation.lost_without_tags();
        let negotiated = NegotiatedFormat {
            driver: DriverName::Played,
            picture_format,
            rate_hz: median_interval_s(&video.timestamps_s).map(|s| 1.0 / s),
            times: TimeSource::File,
            has_exposure: false,
            assumed: AssumedColor::default(),
            warnings: warning.map(|warning| format!("{name}: {warning}")).into_iter().collect(),
            name,
        };
        Ok((Box::new(PlayedCapture { video, frames, picture_format, next: 0, first_s: None }), negotiated))
    }

    fn is_live(&self) -> bool {
        false
    }
}

impl DriverStream for PlayedCapture {
    /// Waits until the next picture is due. The first one is due at once.
    fn next(&mut self) -> Result<Option<DriverPicture>, String> {
        let at_s = self.video.timestamps_s.get(self.next).copied();
        let Some((pixels, at_s)) = self.frames.next().zip(at_s) else { return Ok(None) };
        self.next += 1;
        let pixels = pixels.map_err(|error| error.to_string())?;
        let bytes = match pixels.codes {
            Codes::U8(codes) => codes,
            Codes::U16(codes) => codes.into_iter().map(eight_bits).collect(),
        };
        let time_s = *self.first_s.get_or_insert_with(monotonic_s) + at_s;
        std::thread::sleep(Duration::from_secs_f64((time_s - monotonic_s()).max(0.0)));
        Ok(Some(DriverPicture {
            picture_format: self.picture_format,
            bytes,
            stamp: Stamp::Exact(time_s),
            arrived_s: monotonic_s(),
            exposure_s: None,
            dropped_frames: 0,
            is_damaged: false,
        }))
    }
}
