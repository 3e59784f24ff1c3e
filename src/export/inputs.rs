//! Protection of a run's inputs: outputs never overwrite them, nor lie among the frames of a
//! recording.

use std::path::{Path, PathBuf};

use super::error::ExportError;
use crate::analyse::default_folder;
use crate::shot::{AnalysisState, Shot};
use crate::sink::atomic::Destination;
use crate::source::still_format;

/// The files and folders that a run reads.
#[derive(Debug, Default)]
pub struct Inputs {
    files: Vec<PathBuf>,
    /// The recording's own folder.
    recording: Option<PathBuf>,
    /// Folders with frames and depth pictures.
    folders: Vec<PathBuf>,
    /// Folders of the recording's analyses: the one beside it, and the one that the run uses.
    analyses: Vec<PathBuf>,
}

impl Inputs {
    pub fn of(shot: &Shot) -> Self {
        let mut folders: Vec<_> = shot.recording.folders().into_iter().map(resolved).collect();
        folders.dedup();
        let files = shot.files().map(Path::to_owned).collect();
        let used = match &shot.analysis {
            AnalysisState::Used(folder, _) | AnalysisState::Unfit(folder, _) => Some(resolved(folder)),
            AnalysisState::Absent | AnalysisState::Ignored => None,
        };
        let analyses = [resolved(&default_folder(&shot.recording.path))].into_iter().chain(used).collect();
        Self { files, recording: Some(resolved(&shot.recording.path)), folders, analyses }
    }

    /// Adds files that are also read.
    pub fn and<'a>(mut self, files: impl IntoIterator<Item = &'a PathBuf>) -> Self {
        self.files.extend(files.into_iter().cloned());
        self
    }

    /// Checks that a file may be written at a path.
    pub fn check_file(&self, path: &Path) -> Result<(), ExportError> {
        let at = resolved(path);
        if self.is_read(path, &at) {
            return Err(ExportError::refused(path, format!("is an input of this run, {NEVER_WRITTEN}")));
        }
        if self.analyses.iter().any(|folder| at.starts_with(folder)) {
            return Err(ExportError::refused(
                path,
                format!("lies in the folder of the recording's analysis, {NEVER_WRITTEN}"),
            ));
        }
        let is_picture = still_format::is_picture_name(&at);
        let is_parent = |folder: &PathBuf| at.parent() == Some(folder);
        if self.folders.iter().any(|folder| {
            (is_picture && is_parent(folder)) || (self.is_inside_recording(folder) && at.starts_with(folder))
        }) {
            return Err(ExportError::refused(
                path,
                format!("lies in the folder of the recording's frames, {NEVER_WRITTEN}"),
            ));
        }
        Ok(())
    }

    /// Checks that files of these names may be written into a folder.
    pub fn check_folder(&self, path: &Path, names: impl IntoIterator<Item = String>) -> Result<(), ExportError> {
        let at = resolved(path);
        if self.recording.as_ref() == Some(&at) {
            return Err(ExportError::refused(path, format!("is the recording's folder, {NEVER_WRITTEN}")));
        }
        if self.analyses.contains(&at) {
            return Err(ExportError::refused(
                path,
                format!("is the folder of the recording's analysis, {NEVER_WRITTEN}"),
            ));
        }
        if self.analyses.iter().any(|folder| at.starts_with(folder)) {
            return Err(ExportError::refused(
                path,
                format!("lies in the folder of the recording's analysis, {NEVER_WRITTEN}"),
            ));
        }
        if self
            .folders
            .iter()
            .any(|folder| at == *folder || (self.is_inside_recording(folder) && at.starts_with(folder)))
        {
            return Err(ExportError::refused(
                path,
                format!("is the folder of the recording's frames, {NEVER_WRITTEN}"),
            ));
        }
        // Symbolic links among them may point anywhere.
        let mut there = names.into_iter().map(|name| at.join(name)).filter(|file| file.symlink_metadata().is_ok());
        there.try_for_each(|file| self.check_file(&file))
    }

    /// True if a folder of frames lies inside the recording's folder. Any other folder may also
    /// have unrelated files.
    fn is_inside_recording(&self, folder: &Path) -> bool {
        self.recording.as_deref().is_some_and(|own| folder != own && folder.starts_with(own))
    }

    fn is_read(&self, path: &Path, at: &Path) -> bool {
        // A path that does not exist is not an input.
        path.exists() && self.files.iter().any(|file| file.canonicalize().is_ok_and(|file| file == at))
    }
}

const NEVER_WRITTEN: &str = "which is never overwritten, not even with --force; choose another path";

/// An absolute path without symbolic links. Its last components need not exist.
pub fn resolved(path: &Path) -> PathBuf {
    // A link may point to a file that does not exist yet.
    let at = Destination::of(path);
    let path = if let Ok(Destination::File(at)) = &at { at } else { path };
    // An empty path is the current folder.
    let path = std::path::absolute(Path::new(".").join(path)).unwrap_or_else(|_| path.to_owned());
    let parts: Vec<_> = path.components().collect();
    for there in (1..=parts.len()).rev() {
        if let Ok(real) = parts[..there].iter().collect::<PathBuf>().canonicalize() {
            return parts[there..].iter().fold(real, |at, part| match part {
                std::path::Component::ParentDir => at.parent().map(Path::to_owned).unwrap_or(at),
                part => at.join(part),
            });
        }
    }
    path
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn inputs_of_a_run_are_never_outputs() {
        let temp = tempfile::tempdir().unwrap();
        let at = |name: &str| temp.path().join(name);
        std::fs::create_dir_all(at("r/rgb")).unwrap();
        let read = ["r/recording.toml", "r/rgb/0.jpg", "scene.toml"].map(at);
        for file in &read {
            std::fs::write(file, "").unwrap();
        }
        let inputs = Inputs {
            files: read.to_vec(),
            recording: Some(resolved(&at("r"))),
            folders: vec![resolved(&at("r/rgb"))],
            analyses: vec![resolved(&at("r.analysis"))],
        };
        for file in [
            "r/recording.toml",
            "r/rgb/0.jpg",
            "scene.toml",
            "r/../scene.toml",
            "r/rgb/new.json",
            "r/new/../rgb/a/b.json",
            "r.analysis/poses.txt",
            "r.analysis/not-there-yet.json",
            "r.analysis/new/report.json",
        ] {
            assert!(inputs.check_file(&at(file)).is_err(), "{file}");
        }
        for file in ["r/report.json", "new/report.json", "r/picture.png"] {
            assert!(inputs.check_file(&at(file)).is_ok(), "{file}");
        }
        let names = || ["0.jpg".to_owned()];
        for folder in ["r", "r/rgb", "r/rgb/.", "r/rgb/new", "r.analysis", "r.analysis/out"] {
            assert!(inputs.check_folder(&at(folder), names()).is_err(), "{folder}");
        }
        assert!(inputs.check_folder(&at("r/out"), names()).is_ok());

        // Frames directly in the recording's folder, and existing files with names of outputs.
        let inputs = Inputs { folders: vec![resolved(&at("r"))], ..inputs };
        assert!(inputs.check_file(&at("r/picture.png")).is_err() && inputs.check_file(&at("r/report.json")).is_ok());
        assert!(
            inputs.check_folder(&at("r/out"), names()).is_ok() && inputs.check_folder(&at("r/rgb"), names()).is_err()
        );
        #[cfg(unix)]
        {
            std::os::unix::fs::symlink(at("scene.toml"), at("link")).unwrap();
            assert!(inputs.check_file(&at("link")).is_err());
            // Links among the outputs, to an input and to a path among the frames.
            std::fs::create_dir(at("links")).unwrap();
            for (name, to) in [("0.png", "scene.toml"), ("1.png", "r/rgb/0.jpg"), ("2.png", "r/new.png")] {
                std::os::unix::fs::symlink(at(to), at("links").join(name)).unwrap();
                assert!(inputs.check_folder(&at("links"), [name.to_owned()]).is_err(), "{name}");
            }
            assert!(inputs.check_folder(&at("links"), ["3.png".to_owned()]).is_ok());
        }
        assert_eq!(resolved(&at("a/../b")), resolved(&at("b")));
    }
}
