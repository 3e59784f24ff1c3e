//! A video that stands in for a camera: played at its rate, its newest picture first, as a camera would.

use std::path::Path;
use std::time::Duration;

use super::clock::monotonic_s;
use super::newest::Putter;
use super::picture::{Delivered, Layout, Picture};
use super::wanted::Given;
use crate::pixels::{Codes, eight_bits};
use crate::source::SourceError;
use crate::source::decoding::VideoFrames;
use crate::source::video::{ColorMatrix, ColorRange, Overrides, Video, probe};
use crate::tracking::median_interval_s;

pub struct Played {
    video: Video,
    frames: VideoFrames,
    delivered: Delivered,
}

impl Played {
    pub fn open(file: &Path, overrides: &Overrides) -> Result<(Self, Given), SourceError> {
        let video = probe(file, overrides)?;
        let frames = video.read(0..video.timestamps_s.len())?;
        let (width, height) = (video.width, video.height);
        let (layout, range, matrix) = (Layout::Rgb, ColorRange::Full, ColorMatrix::Rgb);
        let delivered = Delivered { layout, width, height, stride: 3 * width as usize, range, matrix };
        let rate_hz = median_interval_s(&video.timestamps_s).map(|s| 1.0 / s);
        let name = file.display().to_string();
        let lost = video.presentation.lost_without_tags();
        let warnings = lost.map(|lost| format!("{name}: {lost}")).into_iter().collect();
        let given = Given { name, delivered, rate_hz, has_exposure: false, warnings };
        Ok((Self { video, frames, delivered }, given))
    }

    /// Plays it once. Its first picture is at `first_s` of the monotonic clock.
    pub fn run(self, putter: &Putter<Picture>) {
        let Self { video, frames, delivered } = self;
        let mut first_s = None;
        for (pixels, at_s) in frames.zip(&video.timestamps_s) {
            let pixels = match pixels {
                Ok(pixels) => pixels,
                Err(error) => return putter.gone(error.to_string()),
            };
            let time_s = *first_s.get_or_insert_with(monotonic_s) + at_s;
            let bytes = match pixels.codes {
                Codes::U8(codes) => codes,
                Codes::U16(codes) => codes.into_iter().map(eight_bits).collect(),
            };
            let picture = Picture { delivered, bytes, time_s, exposure_s: None };
            putter.rest(Duration::from_secs_f64((time_s - monotonic_s()).max(0.0)));
            if putter.is_over() {
                return;
            }
            putter.put(picture);
        }
    }
}
