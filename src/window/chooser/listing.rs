//! The relevant entries of a folder.

use std::path::{Path, PathBuf};

use locard_engine::recording::Recording;
use locard_engine::text::reason;

/// Kind of item that the chooser selects.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ChooserMode {
    /// An existing file with one of these extensions.
    File(&'static [&'static str]),
    /// A recording: a folder, or a file in one.
    Recording,
    /// A file that may be new. The first extension is added to a name without one.
    NewFile(&'static [&'static str]),
    /// A name for a series of photographs, as [`NewFile`](Self::NewFile).
    NewSeries(&'static [&'static str]),
    /// A folder that may be new.
    NewFolder,
    /// A folder that is new or empty.
    EmptyFolder,
}

impl ChooserMode {
    pub fn is_new(self) -> bool {
        matches!(self, Self::NewFile(_) | Self::NewSeries(_) | Self::NewFolder | Self::EmptyFolder)
    }

    fn shows(self, path: &Path) -> bool {
        let ending = path.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
        match self {
            Self::File(endings) | Self::NewFile(endings) | Self::NewSeries(endings) => {
                endings.contains(&ending.as_str())
            }
            Self::Recording => matches!(ending.as_str(), "toml" | "json" | "txt" | "xml" | "csv" | "xmp"),
            Self::NewFolder | Self::EmptyFolder => false,
        }
    }
}

/// A file or folder that can be chosen or opened.
#[derive(Clone, Debug)]
pub struct FolderEntry {
    pub name: String,
    pub is_folder: bool,
    pub is_recording: bool,
}

/// A folder and its entries.
#[derive(Clone, Debug)]
pub struct Listing {
    pub folder: PathBuf,
    /// The folder itself is a recording.
    pub is_recording: bool,
    pub entries: Result<Vec<FolderEntry>, String>,
}

impl Listing {
    /// Reads a folder, which may be slow.
    pub fn of(folder: PathBuf, mode: ChooserMode) -> Self {
        let is_recording = mode == ChooserMode::Recording && Recording::is_at(&folder);
        Self { is_recording, entries: list_folder(&folder, mode), folder }
    }

    /// A folder that could not be read.
    pub fn failed(folder: PathBuf, why: String) -> Self {
        Self { folder, is_recording: false, entries: Err(why) }
    }

    /// The recording of that name; for an empty name the folder itself.
    pub fn recording(&self, name: &str) -> Option<PathBuf> {
        if name.is_empty() {
            return self.is_recording.then(|| self.folder.clone());
        }
        let mut entries = self.entries.iter().flatten();
        entries.find(|entry| entry.is_recording && entry.name == name).map(|entry| self.folder.join(&entry.name))
    }
}

/// Folders, then matching files, without hidden ones.
fn list_folder(folder: &Path, mode: ChooserMode) -> Result<Vec<FolderEntry>, String> {
    let mut entries: Vec<FolderEntry> = std::fs::read_dir(folder)
        .map_err(|error| reason(&error))?
        .flatten()
        .filter_map(|entry| {
            let name = entry.file_name().to_str().filter(|name| !name.starts_with('.'))?.to_owned();
            // Follows links.
            let is_folder = std::fs::metadata(entry.path()).is_ok_and(|there| there.is_dir());
            let is_recording = mode == ChooserMode::Recording && is_folder && Recording::is_at(&entry.path());
            (is_folder || mode.shows(&entry.path())).then_some(FolderEntry { name, is_folder, is_recording })
        })
        .collect();
    entries.sort_by_key(|entry| (!entry.is_folder, entry.name.to_lowercase()));
    Ok(entries)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn listing_has_folders_first_and_only_matching_files() {
        let temp = tempfile::tempdir().unwrap();
        for folder in ["b", "A", ".hidden"] {
            std::fs::create_dir(temp.path().join(folder)).unwrap();
        }
        for file in ["z.toml", "a.TOML", "c.png", ".d.toml"] {
            std::fs::write(temp.path().join(file), "").unwrap();
        }
        let names = |mode| list_folder(temp.path(), mode).unwrap().into_iter().map(|e| e.name).collect::<Vec<_>>();
        assert_eq!(names(ChooserMode::File(&["toml"])), ["A", "b", "a.TOML", "z.toml"]);
        assert_eq!(names(ChooserMode::NewFolder), ["A", "b"]);
        assert!(list_folder(&temp.path().join("nowhere"), ChooserMode::NewFolder).unwrap_err().contains("no such"));
        let recordings = list_folder(Path::new("recordings"), ChooserMode::Recording).unwrap();
        assert!(recordings.iter().any(|entry| entry.name == "demo" && entry.is_recording));
        let here = Listing::of("recordings".into(), ChooserMode::Recording);
        assert_eq!(here.recording("demo"), Some("recordings/demo".into()));
        assert_eq!([here.recording("dem"), here.recording("")], [None, None]);
        let within = Listing::of("recordings/demo".into(), ChooserMode::Recording);
        assert_eq!(within.recording(""), Some("recordings/demo".into()));
    }
}
