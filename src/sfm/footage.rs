//! A video or a folder of photographs whose motion is to be solved.

use std::ops::Range;
use std::path::{Path, PathBuf};

use super::colmap::PairMatching;
use super::error::SolveError;
use crate::pixels::Pixels;
use crate::recording::pictures_in;
use crate::source::still;
use crate::source::video::{Overrides, Video, probe};

/// Largest number of photographs that are all matched to each other. A folder with more counts as
/// the frames of a video.
pub const MAX_PHOTOGRAPHS: usize = 150;
/// Frames a second of a folder's pictures: they have no times.
pub const NOMINAL_FPS: f64 = 30.0;

/// The pictures.
#[derive(Debug)]
pub enum FootageFrames {
    Video(Box<Video>),
    /// Pictures in the order of their names, all of one size.
    Pictures {
        files: Vec<PathBuf>,
        size: (u32, u32),
    },
}

/// Pictures one after another.
pub type FrameIterator<'a> = Box<dyn Iterator<Item = Result<Pixels, SolveError>> + 'a>;

impl FootageFrames {
    pub fn open(path: &Path) -> Result<Self, SolveError> {
        if !path.is_dir() {
            return Ok(Self::Video(Box::new(probe(path, &Overrides::default())?)));
        }
        let files = pictures_in(path)?;
        let first = files.first().ok_or_else(|| SolveError::NoPictures(path.to_owned()))?;
        let size_of = |file: &Path| still::read_header(file).map(|header| (header.width, header.height));
        let size = size_of(first)?;
        for file in &files {
            let other = size_of(file)?;
            if other != size {
                return Err(SolveError::Sizes {
                    file: file.clone(),
                    size: other,
                    first: first.clone(),
                    expected: size,
                });
            }
        }
        Ok(Self::Pictures { files, size })
    }

    pub fn frame_count(&self) -> usize {
        match self {
            Self::Video(video) => video.timestamps_s.len(),
            Self::Pictures { files, .. } => files.len(),
        }
    }

    /// Width and height, px.
    pub fn size(&self) -> (u32, u32) {
        match self {
            Self::Video(video) => (video.width, video.height),
            Self::Pictures { size, .. } => *size,
        }
    }

    /// True for photographs in any order, false for successive frames.
    pub fn is_unordered(&self) -> bool {
        matches!(self, Self::Pictures { files, .. } if files.len() <= MAX_PHOTOGRAPHS)
    }

    pub fn matching(&self) -> PairMatching {
        if self.is_unordered() { PairMatching::Exhaustive } else { PairMatching::Sequential }
    }

    /// The frames' times; nominal ones for pictures.
    pub fn times_s(&self) -> Vec<f64> {
        match self {
            Self::Video(video) => video.timestamps_s.clone(),
            Self::Pictures { files, .. } => (0..files.len()).map(|i| i as f64 / NOMINAL_FPS).collect(),
        }
    }

    pub fn warnings(&self) -> &[String] {
        match self {
            Self::Video(video) => &video.warnings,
            Self::Pictures { .. } => &[],
        }
    }

    pub fn pixels(&self, range: Range<usize>) -> Result<FrameIterator<'_>, SolveError> {
        Ok(match self {
            Self::Video(video) => Box::new(video.read(range)?.map(|pixels| Ok(pixels?))),
            Self::Pictures { files, .. } => Box::new(files[range].iter().map(|file| Ok(still::read_pixels(file)?))),
        })
    }
}
