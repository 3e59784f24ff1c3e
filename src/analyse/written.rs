//! How an analysis comes into its folder: the file that tells one goes first and comes last, so that a half-written one is none.

use std::io::{ErrorKind, Write};
use std::path::Path;

use super::artefact::{Analysis, AnalysisError, FILE_NAME, FILES, STANDING};
use crate::recording::Recording;
use crate::sink::atomic::write_atomically;
use crate::unfinished::MadeFolder;
use crate::words::{reason, shown};

/// Refuses a file, and a folder that holds something that no analysis has; what an interrupted one left is none.
pub fn check_folder(folder: &Path) -> Result<(), AnalysisError> {
    if folder.exists() && !folder.is_dir() {
        let reason = "a file of that name is there, and an analysis is a folder; move it away, or name another folder (--output)";
        return Err(AnalysisError::Unwritten { folder: folder.to_owned(), reason: reason.to_owned() });
    }
    let Ok(entries) = folder.read_dir() else { return Ok(()) };
    let names = entries.flatten().map(|entry| entry.file_name().to_string_lossy().into_owned());
    match names.filter(|name| !name.starts_with('.') && !FILES.contains(&name.as_str())).min() {
        Some(other) => Err(AnalysisError::Others { folder: folder.to_owned(), other: shown(&other) }),
        None => Ok(()),
    }
}

impl Analysis {
    /// Writes it whole, in place of one that may be there.
    pub fn write(&self, folder: &Path, recording: &Recording) -> Result<(), AnalysisError> {
        check_folder(folder)?;
        let unwritten = |reason: String| AnalysisError::Unwritten { folder: folder.to_owned(), reason };
        let there = MadeFolder::make(folder).map_err(|error| unwritten(reason(&error)))?;
        // What things stand on was found by the poses that were here.
        for name in [FILE_NAME, STANDING] {
            match std::fs::remove_file(folder.join(name)) {
                Err(error) if error.kind() != ErrorKind::NotFound => return Err(unwritten(reason(&error))),
                _ => {}
            }
        }
        for (name, bytes) in self.files(recording)? {
            let written = write_atomically(&folder.join(name), true, |out| out.write_all(&bytes));
            written.map_err(|error| unwritten(error.to_string()))?;
        }
        there.keep();
        Ok(())
    }
}
