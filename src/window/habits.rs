//! What the window remembers of a person from one start to the next: light or dark, and the folders that were used last.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use eframe::egui::ThemePreference;
use serde::{Deserialize, Serialize};

use super::state;

/// What a folder was used for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Use {
    Recording,
    Profile,
    Scene,
    Output,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
enum Theme {
    Light,
    Dark,
    #[default]
    System,
}

#[derive(Clone, Debug, Default, Deserialize, Serialize)]
#[serde(default)]
struct Kept {
    theme: Theme,
    folders: BTreeMap<Use, PathBuf>,
}

/// The habits of a file. Without a file there are none, and none are kept.
#[derive(Clone, Debug, Default)]
pub struct Habits {
    file: Option<PathBuf>,
    kept: Kept,
}

impl Habits {
    pub fn read(file: PathBuf) -> Self {
        let kept = state::read(&file);
        Self { file: Some(file), kept }
    }

    pub fn theme(&self) -> ThemePreference {
        match self.kept.theme {
            Theme::Light => ThemePreference::Light,
            Theme::Dark => ThemePreference::Dark,
            Theme::System => ThemePreference::System,
        }
    }

    /// Remembers light or dark.
    pub fn set_theme(&mut self, theme: ThemePreference) {
        let theme = match theme {
            ThemePreference::Light => Theme::Light,
            ThemePreference::Dark => Theme::Dark,
            ThemePreference::System => Theme::System,
        };
        self.change(|kept| kept.theme = theme);
    }

    /// The folder that was used last. It may be gone.
    pub fn folder(&self, of: Use) -> Option<&Path> {
        self.kept.folders.get(&of).map(PathBuf::as_path)
    }

    /// Remembers the folder of a path that was chosen.
    pub fn used(&mut self, of: Use, path: &Path) {
        let whole = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
        if let Some(folder) = whole.parent() {
            self.change(|kept| _ = kept.folders.insert(of, folder.to_owned()));
        }
    }

    fn change(&mut self, change: impl Fn(&mut Kept)) {
        if let Some(file) = &self.file {
            // Another window may have kept something in it.
            self.kept = state::read(file);
            change(&mut self.kept);
            state::keep(file, &self.kept);
        } else {
            change(&mut self.kept);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn light_and_folders_are_there_at_the_next_start() {
        let temp = tempfile::tempdir().unwrap();
        let file = temp.path().join("new/habits.json");
        let mut habits = Habits::read(file.clone());
        assert_eq!((habits.theme(), habits.folder(Use::Output)), (ThemePreference::System, None));
        let mut other = Habits::read(file.clone());
        habits.set_theme(ThemePreference::Light);
        other.used(Use::Output, &temp.path().join("out.mp4"));
        other.used(Use::Scene, Path::new("/nowhere/at/all.toml"));
        let next = Habits::read(file.clone());
        assert_eq!((next.theme(), next.folder(Use::Output)), (ThemePreference::Light, Some(temp.path())));
        assert_eq!(next.folder(Use::Scene), Some(Path::new("/nowhere/at")));
        std::fs::write(&file, "{\"theme\": \"pink\"}").unwrap();
        assert_eq!(Habits::read(file).theme(), ThemePreference::System);
    }
}
