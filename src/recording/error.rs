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

/// In place of a problem that would quote a file outside of the recording's folder.
const FOREIGN: &str = "is not what is expected there; its text is not shown, for the file lies outside of the recording's \
                       folder: check that it is the file meant";

impl RecordingError {
    /// Leaves out the text of a file outside of the folder of `recording`, which is a folder or a file in it: a recording
    /// may name any file, and whoever reads the message need not be allowed to read that one.
    pub(super) fn without_foreign_text(mut self, recording: &Path) -> Self {
        let Self::Text(TextError::Line { file, problem, .. }) = &mut self else { return self };
        if let (Ok(at), Ok(recording)) = (file.canonicalize(), recording.canonicalize()) {
            let folder = if recording.is_dir() { Some(recording.as_path()) } else { recording.parent() };
            if folder.is_some_and(|folder| !at.starts_with(folder)) {
                FOREIGN.clone_into(problem);
            }
        }
        self
    }

    pub(super) fn content(file: &Path, problem: impl ToString) -> Self {
        Self::Content { file: file.to_owned(), problem: problem.to_string() }
    }
}
