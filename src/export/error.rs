//! Errors of an export.

use std::io;
use std::path::{Path, PathBuf};

use crate::shot::ShotError;
use crate::sink::SinkError;
use crate::text::reason;

/// Why a range of frames could not be written completely.
#[derive(Debug, thiserror::Error)]
pub enum ExportError {
    #[error(transparent)]
    Shot(#[from] ShotError),
    #[error(transparent)]
    Sink(#[from] SinkError),
    /// The path must not be written to.
    #[error("{}: {problem}", path.display())]
    Refused { path: PathBuf, problem: String },
    #[error("{}: cannot be created: {}", path.display(), reason(source))]
    Folder { path: PathBuf, source: io::Error },
    #[error("the writing thread could not be started: {}", reason(source))]
    Thread { source: io::Error },
    #[error("the writing thread stopped early")]
    Stopped,
    /// Cancelled by the caller. Finished frames of a folder stay; an unfinished video is removed.
    #[error("cancelled")]
    Cancelled,
}

impl ExportError {
    pub fn refused(path: &Path, problem: impl Into<String>) -> Self {
        Self::Refused { path: path.to_owned(), problem: problem.into() }
    }
}
