//! Paths of the files that come with the program: models, profiles, the demonstration.

use std::path::{Path, PathBuf};

/// Number of parent folders of the program that are searched. `target/release/` is two levels below
/// the assets.
const UP: usize = 4;
/// Files that only an installation folder has. A user's folder may have a `profiles` or `scenes` of
/// its own.
const INSTALL_MARKER_FILES: [&str; 2] = ["profiles/neutral.toml", "scenes/demo.toml"];
/// The profiles that come with the program.
const PROFILES: [&str; 3] = ["neutral.toml", "simulated.toml", "tum-fr1.toml"];

/// The folder that the program was built from.
pub fn source_folder() -> &'static Path {
    let engine = Path::new(env!("CARGO_MANIFEST_DIR"));
    engine.parent().unwrap_or(engine)
}

/// The searched folders, in order, each once: the program's own and those above it, the one that it
/// was built from, and the current one.
pub fn folders() -> Vec<PathBuf> {
    let program = std::env::current_exe().and_then(|program| program.canonicalize()).ok();
    let above = program.iter().flat_map(|program| program.ancestors().skip(1).take(UP + 1).map(Path::to_owned));
    let all = above.chain([source_folder().to_owned()]).chain(std::env::current_dir());
    let mut folders: Vec<PathBuf> = Vec::new();
    for folder in all.filter(|folder| folder.is_dir()) {
        if !folders.contains(&folder) {
            folders.push(folder);
        }
    }
    folders
}

/// A file or folder that comes with the program, by its name in the program's folder. Where that is
/// the current folder it is called as it is. `None` where it is in none of the [folders].
pub fn find(name: &str) -> Option<PathBuf> {
    let mut own = folders();
    own.retain(|folder| is_installation_folder(folder));
    find_in(&own, std::env::current_dir().ok().as_deref(), name)
}

/// Whether a folder holds the program's files.
fn is_installation_folder(folder: &Path) -> bool {
    INSTALL_MARKER_FILES.iter().all(|mark| folder.join(mark).is_file())
}

/// Whether a path is the file or folder of this name in any installation folder, of this build or
/// another: none of them is written to.
pub fn is_supplied(path: &Path, name: &str) -> bool {
    folders().iter().any(|folder| is_installation_folder(folder) && same(path, &folder.join(name)))
}

/// Whether a profile is one of those that come with the program.
pub fn is_supplied_profile(profile: &Path) -> bool {
    PROFILES.iter().any(|name| is_supplied(profile, &format!("profiles/{name}")))
}

fn find_in(folders: &[PathBuf], current: Option<&Path>, name: &str) -> Option<PathBuf> {
    let folder = folders.iter().find(|folder| folder.join(name).exists())?;
    let is_current = current.is_some_and(|current| same(folder, current));
    Some(if is_current { PathBuf::from(name) } else { folder.join(name) })
}

fn same(a: &Path, b: &Path) -> bool {
    a == b || a.canonicalize().ok().zip(b.canonicalize().ok()).is_some_and(|(a, b)| a == b)
}

/// The path of [`find`], or the name alone if there is none, for the error of the reader.
pub fn path(name: &str) -> PathBuf {
    find(name).unwrap_or_else(|| name.into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_folder_that_has_it_counts() {
        let temp = tempfile::tempdir().unwrap();
        let folders = ["a", "b", "c"].map(|name| temp.path().join(name));
        folders.iter().for_each(|folder| std::fs::create_dir(folder).unwrap());
        assert_eq!(find_in(&folders, None, "scenes"), None);
        std::fs::create_dir(folders[1].join("scenes")).unwrap();
        std::fs::create_dir(folders[2].join("scenes")).unwrap();
        assert_eq!(find_in(&folders, Some(&folders[2]), "scenes"), Some(folders[1].join("scenes")));
        // Where it is here, it is called as a person would.
        assert_eq!(find_in(&folders, Some(&folders[1]), "scenes"), Some("scenes".into()));
    }

    #[test]
    fn folders_of_the_same_names_are_not_the_programs() {
        let temp = tempfile::tempdir().unwrap();
        let profiles = temp.path().join("profiles");
        std::fs::create_dir(&profiles).unwrap();
        std::fs::write(profiles.join("tum-fr1.toml"), "version = 1\n").unwrap();
        assert!(!is_installation_folder(temp.path()) && is_installation_folder(Path::new(".")));
        assert!(!is_supplied_profile(&profiles.join("tum-fr1.toml")));
    }

    #[test]
    fn the_supplied_profiles_are_those_of_the_folder() {
        let mut there: Vec<String> = std::fs::read_dir("profiles")
            .unwrap()
            .map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned())
            .collect();
        there.sort();
        assert_eq!(there, PROFILES);
        let mine = Path::new("profiles/mine.toml");
        assert!(there.iter().all(|name| is_supplied_profile(&Path::new("profiles").join(name))));
        assert!(!is_supplied_profile(mine));
    }

    #[test]
    fn bundled_files_are_found() {
        assert!(find("scenes/marker-1.glb").is_some() && find("recordings/demo").is_some());
        assert_eq!((find("no such thing"), path("no such thing")), (None, "no such thing".into()));
        let folders = folders();
        assert!(folders.iter().any(|folder| folder.join("scenes").is_dir()), "{folders:?}");
    }
}
