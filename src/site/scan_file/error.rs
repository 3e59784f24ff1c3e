//! Errors of scan files.

use std::fmt::Display;
use std::path::{Path, PathBuf};

use crate::text::{reason, shown};

/// Why a scan could not be read. Each message names the file and the next step.
#[derive(Debug, thiserror::Error)]
pub enum ScanError {
    /// The file is missing or cannot be read.
    #[error("{}: cannot be read: {}", file.display(), reason(source))]
    Read { file: PathBuf, source: std::io::Error },
    /// The file as a whole is not usable: its format is not supported, or it holds no points.
    #[error("{}: {problem}", file.display())]
    Unsupported { file: PathBuf, problem: String },
    /// Invalid content at a place in the file, such as `line 3` or `byte 84`. Lines count from 1,
    /// bytes from 0.
    #[error("{}, {location}: {problem}", file.display())]
    Content { file: PathBuf, location: String, problem: String },
    /// A decoder panicked.
    #[error("{}: reading it failed inside ({message}); the file is probably damaged: export it again", file.display())]
    DecoderPanic { file: PathBuf, message: String },
}

impl ScanError {
    pub(super) fn read(file: &Path, source: std::io::Error) -> Self {
        Self::Read { file: file.to_owned(), source }
    }

    pub(super) fn unsupported(file: &Path, problem: impl Display) -> Self {
        Self::Unsupported { file: file.to_owned(), problem: shown(&problem.to_string()) }
    }

    pub(super) fn content(file: &Path, location: impl Display, problem: impl Display) -> Self {
        // Both may quote anything from the file.
        let [location, problem] = [location.to_string(), problem.to_string()].map(|text| shown(&text));
        Self::Content { file: file.to_owned(), location, problem }
    }
}
