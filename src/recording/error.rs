//! Why a recording cannot be opened or read.

use std::path::{Path, PathBuf};

use crate::source::SourceError;
use crate::tracking::text::TextError;
use crate::words::number;

#[derive(Debug, thiserror::Error)]
pub enum RecordingError {
    #[error(transparent)]
    Text(#[from] TextError),
    #[error(transparent)]
    Source(#[from] SourceError),
    #[error(
        "{}: is no recording: {found}; accepted are {accepted}",
        path.display()
    )]
    NotARecording { path: PathBuf, found: String, accepted: String },
    /// A file of a recording does not contain what it should.
    #[error("{}: {problem}", file.display())]
    Content { file: PathBuf, problem: String },
    #[error("the option {name} = {} is refused: accepted is {accepted}", number(*found))]
    Option { name: &'static str, found: f64, accepted: &'static str },
    #[error("frames {start}..{end} are asked for; the recording has 0..{count}")]
    Range { start: usize, end: usize, count: usize },
}

impl RecordingError {
    pub(super) fn content(file: &Path, problem: impl ToString) -> Self {
        Self::Content { file: file.to_owned(), problem: problem.to_string() }
    }
}
