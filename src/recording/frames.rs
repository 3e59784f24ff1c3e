//! The frames of a recording, in order.

use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::depth_reader::DepthReader;
use super::parts::Pictures;
use super::{Recording, RecordingError};
use crate::coding::PictureCoding;
use crate::frame::{Frame, FrameExposure, Surfel};
use crate::pixels::{DepthMap, Pixels};
use crate::source::ahead::Ahead;
use crate::source::decoding::VideoFrames;
use crate::source::video::Video;
use crate::source::{SourceError, still};

/// A frame's depth, if it has any.
type MaybeDepth = Result<Option<DepthMap>, SourceError>;

/// The frames of a range, in order, as returned by [`Recording::frames`].
#[derive(Debug)]
pub struct Frames {
    decoding: Decoding,
    next: usize,
    end: usize,
    size: (u32, u32),
    timestamps_s: Arc<[f64]>,
    opacity: Arc<[f64]>,
    exposure: Arc<[FrameExposure]>,
    pictures: Arc<Pictures>,
    surfels: Arc<[Surfel]>,
    /// Coding of pictures that do not hold their own.
    coding: Option<Arc<PictureCoding>>,
}

#[derive(Debug)]
enum Decoding {
    Stills(Ahead<Result<(Pixels, Option<DepthMap>), SourceError>>),
    /// ffmpeg decodes the pictures, separate threads the depth.
    Video(Box<SelectedFrames>, Ahead<MaybeDepth>),
}

/// The frames of a video that are not skipped.
#[derive(Debug)]
pub struct SelectedFrames {
    decoded: VideoFrames,
    /// True for each decoded frame that is returned.
    taken: std::vec::IntoIter<bool>,
}

impl SelectedFrames {
    /// `kept`: file indices of the recording's frames; `None` if they are the same.
    pub fn new(video: &Video, kept: Option<&[usize]>, range: Range<usize>) -> Result<Self, SourceError> {
        let kept = kept.and_then(|kept| kept.get(range.clone())).filter(|kept| !kept.is_empty());
        let in_file = kept.map_or(range, |kept| kept[0]..kept[kept.len() - 1] + 1);
        let is_taken = |i: usize| kept.is_none_or(|kept| kept.binary_search(&i).is_ok());
        let taken: Vec<bool> = in_file.clone().map(is_taken).collect();
        Ok(Self { decoded: video.read(in_file)?, taken: taken.into_iter() })
    }
}

impl Iterator for SelectedFrames {
    type Item = Result<Pixels, SourceError>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            let (is_taken, pixels) = (self.taken.next()?, self.decoded.next()?);
            if is_taken || pixels.is_err() {
                return Some(pixels);
            }
        }
    }
}

impl Recording {
    /// The depth of a single frame, as returned by [`Recording::frames`].
    pub fn depth_at(&self, index: usize) -> Result<Option<DepthMap>, RecordingError> {
        Ok(DepthReader::new(self).read(index)?)
    }
}

impl Frames {
    pub(super) fn new(recording: &Recording, range: Range<usize>) -> Result<Self, RecordingError> {
        let (next, end) = (range.start, range.end);
        let size = (recording.width, recording.height);
        let depth = DepthReader::new(recording);
        let read_depth = move |i: usize| depth.read(i);
        let decoding = match &*recording.pictures {
            Pictures::Video(video, kept) => {
                let pictures = SelectedFrames::new(video, kept.as_deref(), range.clone())?;
                Decoding::Video(Box::new(pictures), Ahead::new(range, read_depth)?)
            }
            Pictures::Stills(_) => {
                let pictures = Arc::clone(&recording.pictures);
                let read = move |i: usize| Ok((still::read_pixels(&pictures.file(i))?, read_depth(i)?));
                Decoding::Stills(Ahead::new(range, read)?)
            }
        };
        Ok(Self {
            decoding,
            next,
            end,
            size,
            timestamps_s: Arc::clone(&recording.timestamps_s),
            opacity: Arc::clone(&recording.opacity),
            exposure: Arc::clone(&recording.exposure),
            pictures: Arc::clone(&recording.pictures),
            surfels: recording.surfels(),
            coding: None,
        })
    }

    /// Sets the coding of pictures that do not hold their own.
    pub(super) fn with_coding(self, coding: Option<Arc<PictureCoding>>) -> Self {
        Self { coding, ..self }
    }

    fn read(&mut self) -> Result<Frame, RecordingError> {
        let (pixels, depth) = match &mut self.decoding {
            Decoding::Stills(pairs) => pairs.next().unwrap_or(Err(SourceError::DecoderDied))??,
            Decoding::Video(pictures, depth) => (
                pictures.next().unwrap_or(Err(SourceError::DecoderDied))?,
                depth.next().unwrap_or(Err(SourceError::DecoderDied))??,
            ),
        };
        let index = self.next;
        // The size was checked when the recording was opened, but the file may have changed since.
        if (pixels.width, pixels.height) != self.size {
            let (w, h) = self.size;
            let problem = format!("frame {index} is {}x{}; the others are {w}x{h}", pixels.width, pixels.height);
            return Err(RecordingError::content(&self.pictures.file(index), problem));
        }
        let coding = pixels.coding.clone().or_else(|| self.coding.clone());
        let pixels = Pixels { coding, ..pixels };
        let timestamp_s = self.timestamps_s.get(index).copied().unwrap_or_default();
        Ok(Frame {
            depth: depth.map(Arc::new),
            exposure: self.exposure.get(index).copied().unwrap_or_default(),
            opacity: self.opacity.get(index).copied().unwrap_or(1.0),
            surfels: Arc::clone(&self.surfels),
            ..Frame::new(index, timestamp_s, pixels)
        })
    }
}

impl Iterator for Frames {
    type Item = Result<Frame, RecordingError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.next >= self.end {
            return None;
        }
        let frame = self.read();
        self.next = if frame.is_ok() { self.next + 1 } else { self.end };
        Some(frame)
    }
}

impl Pictures {
    /// The file that contains a frame.
    fn file(&self, index: usize) -> PathBuf {
        match self {
            Self::Stills(files) => files.get(index).map_or(Path::new(""), PathBuf::as_path).to_owned(),
            Self::Video(video, _) => video.file.clone(),
        }
    }
}
