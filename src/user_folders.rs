//! The user's folders for state and caches: by the XDG Base Directory Specification, or the
//! equivalents of macOS and Windows. Four variables do not justify a dependency.

use std::env;
use std::path::PathBuf;

/// An absolute path in an environment variable. The specification requires relative ones to be
/// ignored.
fn named(variable: &str) -> Option<PathBuf> {
    env::var_os(variable).map(PathBuf::from).filter(|path| path.is_absolute())
}

fn home() -> Option<PathBuf> {
    env::home_dir().filter(|home| home.is_absolute())
}

/// Folder of state that persists between sessions. `None` if the environment names no home.
pub fn state() -> Option<PathBuf> {
    if cfg!(windows) {
        return named("LOCALAPPDATA").map(|folder| folder.join("Locard"));
    }
    if cfg!(target_vendor = "apple") {
        return home().map(|home| home.join("Library/Application Support/Locard"));
    }
    named("XDG_STATE_HOME").or_else(|| home().map(|home| home.join(".local/state"))).map(|state| state.join("locard"))
}

/// Folder of files that can be recreated: `LOCARD_CACHE`, or the system's cache folder. The
/// system's folder of temporary files if the environment names no home.
pub fn cache() -> PathBuf {
    let of_system = || {
        if cfg!(windows) {
            return named("LOCALAPPDATA").map(|folder| folder.join("Locard").join("cache"));
        }
        if cfg!(target_vendor = "apple") {
            return home().map(|home| home.join("Library/Caches/Locard"));
        }
        named("XDG_CACHE_HOME").or_else(|| home().map(|home| home.join(".cache"))).map(|cache| cache.join("locard"))
    };
    named("LOCARD_CACHE").or_else(of_system).unwrap_or_else(|| env::temp_dir().join("locard-cache"))
}
