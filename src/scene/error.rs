//! The errors of scenes.

use std::fmt::Display;
use std::path::{Path, PathBuf};

use crate::words::{brief, reason, shown};

/// Why a scene cannot be used. Each error names the file, the place in it, what was found and what is accepted.
#[derive(Debug, thiserror::Error)]
pub enum SceneError {
    /// The file is missing or cannot be read.
    #[error("{}: cannot be read: {}{}", file.display(), reason(source), named_in(needed_by))]
    Read {
        file: PathBuf,
        /// The file that names this one.
        needed_by: Option<PathBuf>,
        source: std::io::Error,
    },
    /// Something in the file is not as it must be.
    #[error("{}: {what}: found {found}; accepted: {accepted}", file.display())]
    Bad {
        file: PathBuf,
        /// The place, such as `meshes[2].primitives[0].attributes.POSITION` or `line 3`.
        what: String,
        found: String,
        accepted: String,
    },
    /// A library that decodes pictures or text panicked.
    #[error("{}: reading it failed inside ({message}); the file is probably damaged: export it again", file.display())]
    Inside { file: PathBuf, message: String },
}

fn named_in(needed_by: &Option<PathBuf>) -> String {
    needed_by.as_ref().map(|file| format!(" (named in {})", file.display())).unwrap_or_default()
}

impl SceneError {
    pub(super) fn bad(file: &Path, what: impl Display, found: impl Display, accepted: impl Display) -> Self {
        Self::Bad {
            file: file.to_owned(),
            what: what.to_string(),
            // It may be anything from a file.
            found: shown(&brief(&found.to_string())),
            accepted: accepted.to_string(),
        }
    }
}
