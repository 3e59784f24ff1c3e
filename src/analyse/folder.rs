//! Writes an analysis to its folder. `analysis.toml` is removed first and written last, so an
//! incomplete folder is not taken for an analysis.

use std::io::{ErrorKind, Write};
use std::path::Path;

use super::artefact::{Analysis, AnalysisError, FILE_NAME, FILES, SUPPORTS};
use crate::cleanup::MadeFolder;
use crate::recording::Recording;
use crate::sink::atomic::write_atomically;
use crate::sink::check_file;
use crate::text::{reason, shown};

/// Name of [`SUPPORTS`] in analyses of earlier versions.
const EARLIER_SUPPORTS: &str = "standing.toml";

/// Refuses a file, and a folder with files that are not part of an analysis. Hidden files are
/// ignored.
pub fn check_folder(folder: &Path) -> Result<(), AnalysisError> {
    if folder.exists() && !folder.is_dir() {
        let reason = "a file of this name exists, but an analysis is a folder; move it elsewhere, or choose another \
                      folder (--output)";
        return Err(AnalysisError::Unwritten { folder: folder.to_owned(), reason: reason.to_owned() });
    }
    let Ok(entries) = folder.read_dir() else { return Ok(()) };
    let names = entries.flatten().map(|entry| entry.file_name().to_string_lossy().into_owned());
    let is_other =
        |name: &String| !name.starts_with('.') && !FILES.contains(&name.as_str()) && name.as_str() != EARLIER_SUPPORTS;
    match names.filter(is_other).min() {
        Some(other) => Err(AnalysisError::Others { folder: folder.to_owned(), other: shown(&other) }),
        None => Ok(()),
    }
}

/// Refuses a folder to which an analysis cannot be written.
pub fn check_writable(folder: &Path) -> Result<(), AnalysisError> {
    check_folder(folder)?;
    let unwritten = |error| AnalysisError::Unwritten {
        folder: folder.to_owned(),
        reason: format!("{}, or choose another folder (--output)", reason(&error)),
    };
    // Removed at the end of this check, unless it existed before.
    let _made = MadeFolder::make(folder).map_err(unwritten)?;
    Ok(FILES.iter().try_for_each(|name| check_file(&folder.join(name), true))?)
}

impl Analysis {
    /// Writes the analysis, replacing an existing one.
    pub fn write(&self, folder: &Path, recording: &Recording) -> Result<(), AnalysisError> {
        check_folder(folder)?;
        let unwritten = |reason: String| AnalysisError::Unwritten { folder: folder.to_owned(), reason };
        let new_folder = MadeFolder::make(folder).map_err(|error| unwritten(reason(&error)))?;
        // Support reports depend on the replaced poses.
        for name in [FILE_NAME, SUPPORTS, EARLIER_SUPPORTS] {
            match std::fs::remove_file(folder.join(name)) {
                Err(error) if error.kind() != ErrorKind::NotFound => return Err(unwritten(reason(&error))),
                _ => {}
            }
        }
        for (name, bytes) in self.files(recording)? {
            write_atomically(&folder.join(name), true, |out| out.write_all(&bytes))?;
        }
        new_folder.keep();
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn check_of_a_writable_folder_leaves_no_folder_behind() {
        let temp = tempfile::tempdir().unwrap();
        check_writable(&temp.path().join("new/rec.analysis")).unwrap();
        assert!(!temp.path().join("new").exists());
    }

    #[test]
    fn folder_with_files_of_an_earlier_version_is_writable() {
        let temp = tempfile::tempdir().unwrap();
        std::fs::write(temp.path().join(EARLIER_SUPPORTS), "").unwrap();
        check_writable(temp.path()).unwrap();
    }

    #[test]
    fn folder_that_cannot_be_written_is_refused() {
        let temp = tempfile::tempdir().unwrap();
        std::fs::write(temp.path().join("file"), "").unwrap();
        let error = check_writable(&temp.path().join("file/rec.analysis")).unwrap_err().to_string();
        assert!(error.contains("rec.analysis: cannot be written") && error.contains("(--output)"), "{error}");
        // A write-protected file of an earlier analysis would not be replaced.
        let folder = temp.path().join("rec.analysis");
        std::fs::create_dir(&folder).unwrap();
        let poses = folder.join("poses.txt");
        std::fs::write(&poses, "").unwrap();
        let mut permissions = poses.metadata().unwrap().permissions();
        permissions.set_readonly(true);
        std::fs::set_permissions(&poses, permissions).unwrap();
        let error = check_writable(&folder).unwrap_err().to_string();
        assert!(error.contains("poses.txt: cannot be written: it is write-protected"), "{error}");
    }
}
