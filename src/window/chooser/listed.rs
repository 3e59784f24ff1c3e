//! What a folder holds of what is looked for.

use std::path::{Path, PathBuf};

use locard_engine::recording::Recording;
use locard_engine::text::reason;

/// What is looked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Seeks {
    /// A file with one of these endings.
    File(&'static [&'static str]),
    /// A recording: a folder, or a file of one.
    Recording,
    /// A file that may be new; the first ending is added where there is none.
    NewFile(&'static [&'static str]),
    /// A name for a series of photographs, as [`NewFile`](Self::NewFile).
    NewSeries(&'static [&'static str]),
    /// A folder that may be new.
    NewFolder,
    /// The same, and nothing may be in it.
    EmptyFolder,
}

impl Seeks {
    pub fn is_new(self) -> bool {
        matches!(self, Self::NewFile(_) | Self::NewSeries(_) | Self::NewFolder | Self::EmptyFolder)
    }

    fn shows(self, path: &Path) -> bool {
        let ending = path.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
        match self {
            Self::File(endings) | Self::NewFile(endings) | Self::NewSeries(endings) => {
                endings.contains(&ending.as_str())
            }
            Self::Recording => matches!(ending.as_str(), "toml" | "json" | "txt"),
            Self::NewFolder | Self::EmptyFolder => false,
        }
    }
}

#[derive(Clone, Debug)]
pub struct Entry {
    pub name: String,
    pub is_folder: bool,
    pub is_recording: bool,
}

/// A folder, and what is in it.
#[derive(Clone, Debug)]
pub struct Listing {
    pub folder: PathBuf,
    /// The folder itself is one.
    pub is_recording: bool,
    pub entries: Result<Vec<Entry>, String>,
}

impl Listing {
    /// Reads a folder, which may take its time.
    pub fn of(folder: PathBuf, seeks: Seeks) -> Self {
        let is_recording = seeks == Seeks::Recording && Recording::is_at(&folder);
        Self { is_recording, entries: listed(&folder, seeks), folder }
    }

    /// One that could not be read.
    pub fn failed(folder: PathBuf, why: String) -> Self {
        Self { folder, is_recording: false, entries: Err(why) }
    }

    /// The recording that a name in it means; none: the folder itself.
    pub fn recording(&self, name: &str) -> Option<PathBuf> {
        if name.is_empty() {
            return self.is_recording.then(|| self.folder.clone());
        }
        let mut entries = self.entries.iter().flatten();
        entries.find(|entry| entry.is_recording && entry.name == name).map(|entry| self.folder.join(&entry.name))
    }
}

/// Folders first, then the files that are looked for; no hidden ones.
fn listed(folder: &Path, seeks: Seeks) -> Result<Vec<Entry>, String> {
    let mut entries: Vec<Entry> = std::fs::read_dir(folder)
        .map_err(|error| reason(&error))?
        .flatten()
        .filter_map(|entry| {
            let name = entry.file_name().to_str().filter(|name| !name.starts_with('.'))?.to_owned();
            // Through links.
            let is_folder = std::fs::metadata(entry.path()).is_ok_and(|there| there.is_dir());
            let is_recording = seeks == Seeks::Recording && is_folder && Recording::is_at(&entry.path());
            (is_folder || seeks.shows(&entry.path())).then_some(Entry { name, is_folder, is_recording })
        })
        .collect();
    entries.sort_by_key(|entry| (!entry.is_folder, entry.name.to_lowercase()));
    Ok(entries)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn folders_come_first_and_files_of_the_wrong_kind_do_not_come() {
        let temp = tempfile::tempdir().unwrap();
        for folder in ["b", "A", ".hidden"] {
            std::fs::create_dir(temp.path().join(folder)).unwrap();
        }
        for file in ["z.toml", "a.TOML", "c.png", ".d.toml"] {
            std::fs::write(temp.path().join(file), "").unwrap();
        }
        let names = |seeks| listed(temp.path(), seeks).unwrap().into_iter().map(|e| e.name).collect::<Vec<_>>();
        assert_eq!(names(Seeks::File(&["toml"])), ["A", "b", "a.TOML", "z.toml"]);
        assert_eq!(names(Seeks::NewFolder), ["A", "b"]);
        assert!(listed(&temp.path().join("nowhere"), Seeks::NewFolder).unwrap_err().contains("no such"));
        let recordings = listed(Path::new("recordings"), Seeks::Recording).unwrap();
        assert!(recordings.iter().any(|entry| entry.name == "demo" && entry.is_recording));
        let here = Listing::of("recordings".into(), Seeks::Recording);
        assert_eq!(here.recording("demo"), Some("recordings/demo".into()));
        assert_eq!([here.recording("dem"), here.recording("")], [None, None]);
        let within = Listing::of("recordings/demo".into(), Seeks::Recording);
        assert_eq!(within.recording(""), Some("recordings/demo".into()));
    }
}
