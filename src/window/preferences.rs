//! Preferences that persist between sessions: the theme and the last used folders.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use eframe::egui::ThemePreference;
use serde::{Deserialize, Serialize};

use super::state;

/// Kind of file that a folder was used for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum FolderUse {
    Recording,
    Profile,
    Scene,
    Output,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
enum StoredTheme {
    Light,
    Dark,
    #[default]
    System,
}

#[derive(Clone, Debug, Default, Deserialize, Serialize)]
#[serde(default)]
struct StoredPreferences {
    theme: StoredTheme,
    folders: BTreeMap<FolderUse, PathBuf>,
}

/// Preferences stored in a file. Without a file the defaults apply and nothing is stored.
#[derive(Clone, Debug, Default)]
pub struct Preferences {
    file: Option<PathBuf>,
    stored: StoredPreferences,
}

impl Preferences {
    pub fn read(file: PathBuf) -> Self {
        let stored = state::read(&file);
        Self { file: Some(file), stored }
    }

    pub fn theme(&self) -> ThemePreference {
        match self.stored.theme {
            StoredTheme::Light => ThemePreference::Light,
            StoredTheme::Dark => ThemePreference::Dark,
            StoredTheme::System => ThemePreference::System,
        }
    }

    /// Stores the theme.
    pub fn set_theme(&mut self, theme: ThemePreference) {
        let theme = match theme {
            ThemePreference::Light => StoredTheme::Light,
            ThemePreference::Dark => StoredTheme::Dark,
            ThemePreference::System => StoredTheme::System,
        };
        self.change(|stored| stored.theme = theme);
    }

    /// The last used folder, which may no longer exist.
    pub fn folder(&self, of: FolderUse) -> Option<&Path> {
        self.stored.folders.get(&of).map(PathBuf::as_path)
    }

    /// Stores the folder of a chosen path.
    pub fn remember_folder(&mut self, of: FolderUse, path: &Path) {
        let absolute = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
        if let Some(folder) = absolute.parent() {
            self.change(|stored| _ = stored.folders.insert(of, folder.to_owned()));
        }
    }

    fn change(&mut self, change: impl Fn(&mut StoredPreferences)) {
        if let Some(file) = &self.file {
            // Another window may have changed the file.
            self.stored = state::read(file);
            change(&mut self.stored);
            state::keep(file, &self.stored);
        } else {
            change(&mut self.stored);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn theme_and_folders_persist_between_sessions() {
        let temp = tempfile::tempdir().unwrap();
        let file = temp.path().join("new/habits.json");
        let mut preferences = Preferences::read(file.clone());
        assert_eq!((preferences.theme(), preferences.folder(FolderUse::Output)), (ThemePreference::System, None));
        let mut other = Preferences::read(file.clone());
        preferences.set_theme(ThemePreference::Light);
        other.remember_folder(FolderUse::Output, &temp.path().join("out.mp4"));
        other.remember_folder(FolderUse::Scene, Path::new("/nowhere/at/all.toml"));
        let next = Preferences::read(file.clone());
        assert_eq!((next.theme(), next.folder(FolderUse::Output)), (ThemePreference::Light, Some(temp.path())));
        assert_eq!(next.folder(FolderUse::Scene), Some(Path::new("/nowhere/at")));
        std::fs::write(&file, "{\"theme\": \"pink\"}").unwrap();
        assert_eq!(Preferences::read(file).theme(), ThemePreference::System);
    }
}
