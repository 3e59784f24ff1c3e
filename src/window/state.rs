//! Where the program keeps what lies between two sessions: work that was not saved, files that were open.
//!
//! The folders are those that the systems name for it. Three variables do not make up for a library.

use std::env;
use std::path::PathBuf;

/// The user's folder for the program's state: by the XDG base directories, or what macOS and Windows have for it. `None`
/// where the environment names no home.
pub fn folder() -> Option<PathBuf> {
    let named = |name: &str| env::var_os(name).map(PathBuf::from).filter(|path| path.is_absolute());
    let home = || env::home_dir().filter(|home| home.is_absolute());
    if cfg!(windows) {
        return named("LOCALAPPDATA").map(|folder| folder.join("Locard"));
    }
    if cfg!(target_vendor = "apple") {
        return home().map(|home| home.join("Library/Application Support/Locard"));
    }
    // A relative path in it is to be ignored, says the specification.
    named("XDG_STATE_HOME").or_else(|| home().map(|home| home.join(".local/state"))).map(|state| state.join("locard"))
}
