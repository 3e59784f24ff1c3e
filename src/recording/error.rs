//! Errors of recordings.

use std::path::{Path, PathBuf};

use crate::source::SourceError;
use crate::text::number;
use crate::tracking::records::TextError;

/// Why a recording, or one of its frames, could not be read.
#[derive(Debug, thiserror::Error)]
pub enum RecordingError {
    #[error(transparent)]
    Text(#[from] TextError),
    #[error(transparent)]
    Source(#[from] SourceError),
    #[error(
        "{}: not a recording: {actual}. Supported: a folder with recording.toml, TUM RGB-D, EuRoC, COLMAP, nerfstudio \
         and others (docs/recordings.md)",
        path.display()
    )]
    NotARecording { path: PathBuf, actual: String },
    /// A file of a recording has invalid content.
    #[error("{}: {problem}", file.display())]
    Content { file: PathBuf, problem: String },
    /// A binary file of a recording has invalid content. Bytes count from 0.
    #[error("{}, byte {offset}: {problem}", file.display())]
    Bytes { file: PathBuf, offset: usize, problem: String },
    #[error("the option {name} = {}: expected {accepted}", number(*actual))]
    Option { name: &'static str, actual: f64, accepted: &'static str },
    #[error("frames {start}..{end} were requested; the recording has 0..{count}")]
    Range { start: usize, end: usize, count: usize },
}

/// Replaces a message that would quote a file outside the recording's folder.
const FOREIGN_CONTENT: &str = "has unexpected content; it is not quoted because the file lies outside the recording's folder. \
                       Check that the path is the intended one";

impl RecordingError {
    /// Removes the quoted text of a file that lies neither in the folder of the given path nor in
    /// that of the recording found there: a recording may reference any file, and the reader of the
    /// message may lack permission to read it.
    pub(super) fn without_foreign_text(mut self, opened: &Path, recording: &Path) -> Self {
        let (Self::Text(TextError::Line { file, problem, .. }) | Self::Bytes { file, problem, .. }) = &mut self else {
            return self;
        };
        let Ok(file) = file.canonicalize() else { return self };
        // Symbolic links in the given path are intended; those in the recording may lead anywhere.
        let of_given = opened.canonicalize().ok().and_then(|opened| folder_of(&opened).map(Path::to_owned));
        let of_found = folder_of(recording).and_then(|folder| folder.canonicalize().ok());
        if !of_given.iter().chain(&of_found).any(|folder| file.starts_with(folder)) {
            FOREIGN_CONTENT.clone_into(problem);
        }
        self
    }

    pub(super) fn content(file: &Path, problem: impl ToString) -> Self {
        Self::Content { file: file.to_owned(), problem: problem.to_string() }
    }
}

/// A folder itself, or the parent folder of a file.
fn folder_of(path: &Path) -> Option<&Path> {
    if path.is_dir() { Some(path) } else { path.parent() }
}
