//! Disk access of the chooser when it opens and when a path is entered. Each operation may be slow
//! and runs on a background thread.

use std::io::ErrorKind;
use std::path::{Component, Path, PathBuf};

use super::listing::ChooserMode;
use locard_engine::photo::existing_series;
use locard_engine::recording::Recording;
use locard_engine::text::reason;

/// Candidates for the start folder, and further folders to offer.
#[derive(Clone, Debug, Default)]
pub struct StartLocation {
    /// The first existing folder is used; else the nearest existing parent of the first one.
    pub folders: Vec<PathBuf>,
    /// Proposed name of a new file.
    pub name: String,
    /// Labelled folders; missing ones are left out.
    pub places: Vec<(&'static str, PathBuf)>,
}

impl StartLocation {
    /// The folder and name of a file.
    pub fn at(file: &Path) -> Self {
        let file = std::path::absolute(file).unwrap_or_else(|_| file.to_owned());
        let name = file.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        Self { folders: file.parent().map(Path::to_owned).into_iter().collect(), name, places: Vec::new() }
    }

    /// The first existing folder.
    pub fn within(folders: impl IntoIterator<Item = PathBuf>) -> Self {
        Self { folders: folders.into_iter().collect(), ..Self::default() }
    }

    /// Checks the candidates on disk.
    pub fn resolve(self) -> ResolvedStart {
        let existing = self.folders.iter().find(|folder| folder.is_dir()).cloned();
        let of_first = || self.folders.first()?.ancestors().find(|folder| folder.is_dir()).map(Path::to_owned);
        let folder = existing.or_else(of_first).or_else(std::env::home_dir).unwrap_or_default();
        // The parent folders are displayed.
        let has_parents = folder.components().any(|part| part == Component::ParentDir);
        let folder = folder.canonicalize().ok().filter(|_| has_parents).unwrap_or(folder);
        let places = self
            .places
            .into_iter()
            .filter_map(|(label, folder)| Some((label, folder.canonicalize().ok().filter(|folder| folder.is_dir())?)));
        ResolvedStart { folder, places: places.collect() }
    }
}

/// The resolved start folder.
#[derive(Clone, Debug)]
pub struct ResolvedStart {
    pub folder: PathBuf,
    pub places: Vec<(&'static str, PathBuf)>,
}

/// Result of the dialog.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ChooserResult {
    Path {
        path: PathBuf,
        /// The user confirmed the replacement of existing files.
        replaces: bool,
    },
    Cancelled,
}

impl ChooserResult {
    pub fn new_path(path: PathBuf) -> Self {
        Self::Path { path, replaces: false }
    }
}

/// An entry to check on disk.
#[derive(Clone, Debug)]
pub struct EnteredPath {
    pub mode: ChooserMode,
    /// The displayed folder.
    pub folder: PathBuf,
    /// Entered path; `None` if the field is empty.
    pub path: Option<PathBuf>,
    /// The only list entry that contains the typed text.
    pub only: Option<PathBuf>,
}

/// Outcome of an entry.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum EntryOutcome {
    /// The path is chosen.
    Path(PathBuf),
    /// The folder is to be displayed.
    Folder(PathBuf),
    /// Replacement needs confirmation, possibly of the existing files of a series.
    ConfirmReplace { path: PathBuf, existing: Vec<PathBuf> },
    /// The entry is rejected with a message.
    Rejected(String),
}

impl EnteredPath {
    /// Checks the entry on disk.
    pub fn check(self) -> EntryOutcome {
        let Self { mode, folder, path, only } = self;
        let Some(path) = path else {
            return match mode {
                ChooserMode::NewFolder | ChooserMode::EmptyFolder => outcome(mode, folder),
                ChooserMode::Recording if Recording::is_at(&folder) => outcome(mode, folder),
                ChooserMode::Recording => {
                    EntryOutcome::Rejected("There is no recording in this folder: choose a marked one".to_owned())
                }
                _ => EntryOutcome::Rejected("Choose a file, or type its name".to_owned()),
            };
        };
        if mode.is_new() || path.exists() {
            return outcome(mode, path);
        }
        only.map_or_else(
            || EntryOutcome::Rejected(format!("There is no {}", path.display())),
            |only| outcome(mode, only),
        )
    }
}

fn outcome(mode: ChooserMode, path: PathBuf) -> EntryOutcome {
    match mode {
        ChooserMode::Recording if path.is_dir() && !Recording::is_at(&path) => EntryOutcome::Folder(path),
        ChooserMode::File(_) | ChooserMode::NewFile(_) | ChooserMode::NewSeries(_) if path.is_dir() => {
            EntryOutcome::Folder(path)
        }
        ChooserMode::File(_) | ChooserMode::Recording => EntryOutcome::Path(path),
        ChooserMode::NewFile(endings) | ChooserMode::NewSeries(endings) => {
            let path = match path.extension() {
                Some(_) => path,
                None => path.with_extension(endings.first().unwrap_or(&"")),
            };
            let is_series = matches!(mode, ChooserMode::NewSeries(_));
            let existing = if is_series { existing_series(&path) } else { Vec::new() };
            let is_free = if is_series { existing.is_empty() } else { !path.exists() };
            if is_free { EntryOutcome::Path(path) } else { EntryOutcome::ConfirmReplace { path, existing } }
        }
        ChooserMode::NewFolder | ChooserMode::EmptyFolder => {
            let is_free = !std::fs::read_dir(&path).is_ok_and(|mut entries| entries.next().is_some());
            match mode {
                _ if is_free => EntryOutcome::Path(path),
                ChooserMode::EmptyFolder => {
                    EntryOutcome::Rejected(format!("There are files in {}: name a new folder", path.display()))
                }
                _ => EntryOutcome::ConfirmReplace { path, existing: Vec::new() },
            }
        }
    }
}

/// Creates a folder, to be displayed.
pub fn make(folder: PathBuf) -> EntryOutcome {
    match std::fs::create_dir(&folder) {
        Ok(()) => EntryOutcome::Folder(folder),
        Err(error) => {
            let why = match error.kind() {
                ErrorKind::AlreadyExists => "it exists already; choose another name".to_owned(),
                _ => reason(&error),
            };
            EntryOutcome::Rejected(format!("{} was not created: {why}", folder.display()))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn start_folder_is_the_first_existing_one() {
        let temp = tempfile::tempdir().unwrap();
        let here = temp.path().canonicalize().unwrap();
        let inner = here.join("in");
        std::fs::create_dir(&inner).unwrap();
        let start_folder =
            |folders: &[&Path]| StartLocation::within(folders.iter().map(|f| f.to_path_buf())).resolve().folder;
        assert_eq!(start_folder(&[&here.join("gone"), &inner, &here]), inner);
        assert_eq!(start_folder(&[&here.join("gone/too"), &here.join("none")]), here, "what is there of the first");
        let at = StartLocation::at(&inner.join("mine.toml"));
        assert_eq!((at.name.as_str(), at.clone().resolve().folder), ("mine.toml", inner.clone()));
        let places = vec![("there", inner.join("../in")), ("gone", here.join("gone"))];
        assert_eq!(StartLocation { places, ..at }.resolve().places, [("there", inner)]);
    }

    #[test]
    fn existing_folder_is_not_created_again() {
        let temp = tempfile::tempdir().unwrap();
        let made = temp.path().join("case 7");
        assert_eq!(make(made.clone()), EntryOutcome::Folder(made.clone()));
        assert!(made.is_dir());
        std::fs::write(made.join("kept"), "").unwrap();
        let EntryOutcome::Rejected(why) = make(made.clone()) else { panic!("it exists already") };
        assert!(why.contains("case 7 was not created: ") && made.join("kept").exists(), "{why}");
        assert!(matches!(make(temp.path().join("no/such")), EntryOutcome::Rejected(_)));
    }
}
