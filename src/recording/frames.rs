//! The frames of a recording, in order.

use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::parts::Pictures;
use super::{Recording, RecordingError};
use crate::frame::{Frame, FrameExposure};
use crate::pixels::{DepthMap, Pixels};
use crate::source::ahead::Ahead;
use crate::source::decoding::VideoFrames;
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
    exposure: Arc<[FrameExposure]>,
    pictures: Arc<Pictures>,
}

#[derive(Debug)]
enum Decoding {
    Stills(Ahead<Result<(Pixels, Option<DepthMap>), SourceError>>),
    /// ffmpeg decodes the pictures, our own threads the depth.
    Video(VideoFrames, Ahead<MaybeDepth>),
}

impl Frames {
    pub(super) fn new(recording: &Recording, range: Range<usize>) -> Result<Self, RecordingError> {
        let (next, end) = (range.start, range.end);
        let (depth, codes_per_metre) = (recording.depth.clone(), recording.codes_per_metre);
        let read_depth = move |i: usize| -> MaybeDepth {
            let entry = depth.as_ref().and_then(|depth| depth.get(i)?.as_ref());
            entry.map(|(time_s, file)| still::read_depth(file, codes_per_metre, *time_s)).transpose()
        };
        let decoding = match &*recording.pictures {
            Pictures::Video(video) => Decoding::Video(video.read(range.clone())?, Ahead::new(range, read_depth)?),
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
            size: (recording.width, recording.height),
            timestamps_s: Arc::clone(&recording.timestamps_s),
            exposure: Arc::clone(&recording.exposure),
            pictures: Arc::clone(&recording.pictures),
        })
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
        Ok(Frame {
            index,
            timestamp_s: self.timestamps_s.get(index).copied().unwrap_or_default(),
            pixels,
            depth,
            exposure: self.exposure.get(index).copied().unwrap_or_default(),
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
            Self::Video(video) => video.file.clone(),
        }
    }
}
