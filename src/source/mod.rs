//! Pixels and depth in: still pictures, video files, and decoding ahead of their consumer.

pub mod ahead;
pub mod decoding;
pub mod depth_map;
pub mod developed;
pub mod exif;
mod exr_layer;
pub mod ffmpeg;
pub mod file;
mod heif;
mod index;
pub mod jpeg;
pub mod jpeg_end;
pub mod jpeg_header;
mod jpeg_marker;
pub mod jpeg_tables;
mod motion_jpeg;
pub mod orientation;
mod oriented_coding;
pub mod presentation;
mod scene_linear;
pub mod st_map;
pub mod still;
pub mod still_color;
mod still_decoder;
pub mod still_format;
pub mod telemetry;
mod tiff_samples;
pub mod timecode;
pub mod unsupported;
pub mod video;

use std::path::{Path, PathBuf};

use crate::program::ProgramError;
use crate::text::reason;

/// Why there are no pixels.
#[derive(Debug, thiserror::Error)]
pub enum SourceError {
    #[error("{}: cannot be read: {}", file.display(), reason(source))]
    Read { file: PathBuf, source: std::io::Error },
    #[error("{}: {problem}", file.display())]
    Content { file: PathBuf, problem: String },
    #[error("{}: developed pictures cannot be stored there: {}; LOCARD_CACHE names another folder", folder.display(), reason(source))]
    Cache { folder: PathBuf, source: std::io::Error },
    #[error("{}: cannot be developed: {source}", file.display())]
    Undeveloped { file: PathBuf, source: ProgramError },
    #[error(transparent)]
    Program(#[from] ProgramError),
    #[error("a decoding thread could not be started: {0}")]
    Thread(std::io::Error),
    #[error("a decoding thread panicked; see the message above")]
    DecoderDied,
}

impl SourceError {
    fn content(file: &Path, problem: impl ToString) -> Self {
        Self::Content { file: file.to_owned(), problem: problem.to_string() }
    }
}
