//! Errors of planning and joining parts.

use std::io;
use std::path::{Path, PathBuf};

use crate::program::ProgramError;
use crate::provenance::ProvenanceError;
use crate::sink::SinkError;
use crate::text::reason;

/// Why parts could not be planned or joined.
#[derive(Debug, thiserror::Error)]
pub enum FarmError {
    /// A file or folder is not usable.
    #[error("{}: {problem}", path.display())]
    Refused { path: PathBuf, problem: String },
    #[error("{}: cannot be read: {}", path.display(), reason(source))]
    Read { path: PathBuf, source: io::Error },
    /// The numbers of a plan contradict each other.
    #[error("{0}")]
    Plan(String),
    #[error(transparent)]
    Record(#[from] ProvenanceError),
    #[error(transparent)]
    Sink(#[from] SinkError),
    #[error(transparent)]
    Program(#[from] ProgramError),
}

impl FarmError {
    pub(super) fn refused(path: &Path, problem: impl Into<String>) -> Self {
        Self::Refused { path: path.to_owned(), problem: problem.into() }
    }

    pub(super) fn reading(path: &Path, source: io::Error) -> Self {
        Self::Read { path: path.to_owned(), source }
    }
}
