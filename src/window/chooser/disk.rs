//! What the disk is asked when a dialog opens, and when something is entered in it. Each of these may take its time, and is
//! done on a thread of its own.

use std::io::ErrorKind;
use std::path::{Component, Path, PathBuf};

use super::listed::Seeks;
use locard_engine::photo::series_there;
use locard_engine::recording::Recording;
use locard_engine::text::reason;

/// Where a dialog may begin, and what else it offers.
#[derive(Clone, Debug, Default)]
pub struct Begin {
    /// The first of them that is there; else what is there of the first one.
    pub folders: Vec<PathBuf>,
    /// The name that is proposed for a new file.
    pub name: String,
    /// What a folder is called, and where it is; those that are not there are left out.
    pub places: Vec<(&'static str, PathBuf)>,
}

impl Begin {
    /// In the folder of a file, with its name.
    pub fn at(file: &Path) -> Self {
        let file = std::path::absolute(file).unwrap_or_else(|_| file.to_owned());
        let name = file.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        Self { folders: file.parent().map(Path::to_owned).into_iter().collect(), name, places: Vec::new() }
    }

    /// In the first of these that is there.
    pub fn within(folders: impl IntoIterator<Item = PathBuf>) -> Self {
        Self { folders: folders.into_iter().collect(), ..Self::default() }
    }

    /// Asks the disk.
    pub fn found(self) -> Begun {
        let there = self.folders.iter().find(|folder| folder.is_dir()).cloned();
        let of_first = || self.folders.first()?.ancestors().find(|folder| folder.is_dir()).map(Path::to_owned);
        let folder = there.or_else(of_first).or_else(std::env::home_dir).unwrap_or_default();
        // The folders above it are shown.
        let has_parents = folder.components().any(|part| part == Component::ParentDir);
        let folder = folder.canonicalize().ok().filter(|_| has_parents).unwrap_or(folder);
        let places = self.places.into_iter().filter_map(|(called, folder)| {
            Some((called, folder.canonicalize().ok().filter(|folder| folder.is_dir())?))
        });
        Begun { folder, places: places.collect() }
    }
}

/// Where it begins.
#[derive(Clone, Debug)]
pub struct Begun {
    pub folder: PathBuf,
    pub places: Vec<(&'static str, PathBuf)>,
}

/// How it ended.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Chosen {
    Path {
        path: PathBuf,
        /// What is there may be replaced: it was asked.
        replaces: bool,
    },
    Nothing,
}

impl Chosen {
    pub fn free(path: PathBuf) -> Self {
        Self::Path { path, replaces: false }
    }
}

/// What was entered.
#[derive(Clone, Debug)]
pub struct Entered {
    pub seeks: Seeks,
    /// The folder that is shown.
    pub folder: PathBuf,
    /// What is meant; `None` where nothing is typed.
    pub path: Option<PathBuf>,
    /// The only one in the list whose name has what is typed.
    pub only: Option<PathBuf>,
}

/// What comes of it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Taken {
    /// It is chosen.
    Path(PathBuf),
    /// It is shown.
    Folder(PathBuf),
    /// It is to be asked whether it may be replaced, with the files that are there of a series.
    Asks { path: PathBuf, there: Vec<PathBuf> },
    /// It is not accepted.
    Told(String),
}

impl Entered {
    /// Asks the disk.
    pub fn taken(self) -> Taken {
        let Self { seeks, folder, path, only } = self;
        let Some(path) = path else {
            return match seeks {
                Seeks::NewFolder | Seeks::EmptyFolder => taken(seeks, folder),
                Seeks::Recording if Recording::is_at(&folder) => taken(seeks, folder),
                Seeks::Recording => {
                    Taken::Told("There is no recording in this folder: go to one that is marked".to_owned())
                }
                _ => Taken::Told("Choose a file, or type its name".to_owned()),
            };
        };
        if seeks.is_new() || path.exists() {
            return taken(seeks, path);
        }
        only.map_or_else(|| Taken::Told(format!("There is no {}", path.display())), |only| taken(seeks, only))
    }
}

fn taken(seeks: Seeks, path: PathBuf) -> Taken {
    match seeks {
        Seeks::Recording if path.is_dir() && !Recording::is_at(&path) => Taken::Folder(path),
        Seeks::File(_) | Seeks::NewFile(_) | Seeks::NewSeries(_) if path.is_dir() => Taken::Folder(path),
        Seeks::File(_) | Seeks::Recording => Taken::Path(path),
        Seeks::NewFile(endings) | Seeks::NewSeries(endings) => {
            let path = match path.extension() {
                Some(_) => path,
                None => path.with_extension(endings.first().unwrap_or(&"")),
            };
            let is_series = matches!(seeks, Seeks::NewSeries(_));
            let there = if is_series { series_there(&path) } else { Vec::new() };
            match if is_series { there.is_empty() } else { !path.exists() } {
                true => Taken::Path(path),
                false => Taken::Asks { path, there },
            }
        }
        Seeks::NewFolder | Seeks::EmptyFolder => {
            let is_free = !std::fs::read_dir(&path).is_ok_and(|mut entries| entries.next().is_some());
            match seeks {
                _ if is_free => Taken::Path(path),
                Seeks::EmptyFolder => Taken::Told(format!("There are files in {}: name a new folder", path.display())),
                _ => Taken::Asks { path, there: Vec::new() },
            }
        }
    }
}

/// Makes a folder, to be shown then.
pub fn make(folder: PathBuf) -> Taken {
    match std::fs::create_dir(&folder) {
        Ok(()) => Taken::Folder(folder),
        Err(error) => {
            let why = match error.kind() {
                ErrorKind::AlreadyExists => "it is there already; choose another name".to_owned(),
                _ => reason(&error),
            };
            Taken::Told(format!("{} is not made: {why}", folder.display()))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_begins_in_the_first_folder_that_is_there() {
        let temp = tempfile::tempdir().unwrap();
        let here = temp.path().canonicalize().unwrap();
        let inner = here.join("in");
        std::fs::create_dir(&inner).unwrap();
        let found = |folders: &[&Path]| Begin::within(folders.iter().map(|f| f.to_path_buf())).found().folder;
        assert_eq!(found(&[&here.join("gone"), &inner, &here]), inner);
        assert_eq!(found(&[&here.join("gone/too"), &here.join("none")]), here, "what is there of the first");
        let at = Begin::at(&inner.join("mine.toml"));
        assert_eq!((at.name.as_str(), at.clone().found().folder), ("mine.toml", inner.clone()));
        let places = vec![("there", inner.join("../in")), ("gone", here.join("gone"))];
        assert_eq!(Begin { places, ..at }.found().places, [("there", inner)]);
    }

    #[test]
    fn a_folder_is_made_once() {
        let temp = tempfile::tempdir().unwrap();
        let made = temp.path().join("case 7");
        assert_eq!(make(made.clone()), Taken::Folder(made.clone()));
        assert!(made.is_dir());
        std::fs::write(made.join("kept"), "").unwrap();
        let Taken::Told(why) = make(made.clone()) else { panic!("it is there already") };
        assert!(why.contains("case 7 is not made: ") && made.join("kept").exists(), "{why}");
        assert!(matches!(make(temp.path().join("no/such")), Taken::Told(_)));
    }
}
