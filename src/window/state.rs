//! Where the program keeps what lies between two sessions: work that was not saved, files that were open.
//!
//! The folders are those that the systems name for it. Three variables do not make up for a library.

use std::env;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use serde::Serialize;
use serde::de::DeserializeOwned;

use locard_engine::sink::atomic::write_atomically;
use locard_engine::source::file::{self, MAX_DOCUMENT_BYTES};

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

/// What a file of that folder keeps; nothing where it cannot be read.
pub fn read<T: DeserializeOwned + Default>(file: &Path) -> T {
    file::read_text(file, MAX_DOCUMENT_BYTES).ok().and_then(|text| serde_json::from_str(&text).ok()).unwrap_or_default()
}

/// Keeps something in a file of that folder. That it cannot be kept is no reason to stop.
pub fn keep(file: &Path, value: &impl Serialize) {
    if let Ok(text) = serde_json::to_string_pretty(value) {
        let _ = file.parent().map(std::fs::create_dir_all);
        let _ = write_atomically(file, true, |to: &mut BufWriter<&mut File>| to.write_all(text.as_bytes()));
    }
}
