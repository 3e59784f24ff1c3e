//! Folder of the state between sessions: autosaved work, recent files, preferences.
//!
//! The folders follow the conventions of each system. Three variables do not justify a dependency.

use std::env;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use serde::Serialize;
use serde::de::DeserializeOwned;

use locard_engine::sink::atomic::write_atomically;
use locard_engine::source::file::{self, MAX_DOCUMENT_BYTES};

/// The user's state folder: by the XDG Base Directory Specification, or the equivalent of macOS and
/// Windows. `None` if the environment names no home.
pub fn folder() -> Option<PathBuf> {
    let named = |name: &str| env::var_os(name).map(PathBuf::from).filter(|path| path.is_absolute());
    let home = || env::home_dir().filter(|home| home.is_absolute());
    if cfg!(windows) {
        return named("LOCALAPPDATA").map(|folder| folder.join("Locard"));
    }
    if cfg!(target_vendor = "apple") {
        return home().map(|home| home.join("Library/Application Support/Locard"));
    }
    // The specification requires relative paths to be ignored.
    named("XDG_STATE_HOME").or_else(|| home().map(|home| home.join(".local/state"))).map(|state| state.join("locard"))
}

/// Reads a file of that folder; the default value if it cannot be read.
pub fn read<T: DeserializeOwned + Default>(file: &Path) -> T {
    file::read_text(file, MAX_DOCUMENT_BYTES).ok().and_then(|text| serde_json::from_str(&text).ok()).unwrap_or_default()
}

/// Writes a value to a file of that folder. Errors are ignored.
pub fn keep(file: &Path, value: &impl Serialize) {
    if let Ok(text) = serde_json::to_string_pretty(value) {
        let _ = file.parent().map(std::fs::create_dir_all);
        let _ = write_atomically(file, true, |to: &mut BufWriter<&mut File>| to.write_all(text.as_bytes()));
    }
}
