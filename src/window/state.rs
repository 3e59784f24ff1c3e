//! State that persists between sessions: the theme, the last used folders and the recent documents.
//! All windows of a user share one file, which a thread changes under a lock.
//!
//! The storage of eframe is not used: each of two windows would overwrite the changes of the other,
//! and a crash during its write would lose the file.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Sender, channel};

use eframe::egui::{Context, ThemePreference};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Deserializer, Serialize};

use super::file_lock::FileLock;
use super::recent::{DocumentRef, ExistenceCheck, move_to_front};
use super::task::BackgroundTask;
use locard_engine::sink::atomic::write_atomically;
use locard_engine::source::file::{self, MAX_DOCUMENT_BYTES};

/// Name of the file in the user's state folder.
const FILE_NAME: &str = "state.json";

/// Kind of file that a folder was used for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum FolderUse {
    Recording,
    Profile,
    Scene,
    Scan,
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

/// Content of the file. A part that cannot be read has its default.
#[derive(Clone, Debug, Default, Deserialize, Serialize)]
#[serde(default)]
struct StoredState {
    #[serde(deserialize_with = "or_default")]
    theme: StoredTheme,
    #[serde(deserialize_with = "or_default")]
    folders: BTreeMap<FolderUse, PathBuf>,
    /// The newest first.
    #[serde(deserialize_with = "or_default")]
    recent: Vec<DocumentRef>,
}

fn or_default<'de, D: Deserializer<'de>, T: DeserializeOwned + Default>(from: D) -> Result<T, D::Error> {
    Ok(serde_json::from_value(serde_json::Value::deserialize(from)?).unwrap_or_default())
}

impl StoredState {
    fn read(path: &Path) -> Self {
        file::read_text(path, MAX_DOCUMENT_BYTES)
            .ok()
            .and_then(|text| serde_json::from_str(&text).ok())
            .unwrap_or_default()
    }

    fn write(&self, path: &Path) {
        if let Ok(text) = serde_json::to_string_pretty(self) {
            let _ = write_atomically(path, true, |to: &mut BufWriter<&mut File>| to.write_all(text.as_bytes()));
        }
    }
}

type StateChange = Box<dyn FnOnce(&mut StoredState) + Send>;

/// Changes the file on a background thread. A drop closes `changes`, then waits for `task`.
#[derive(Debug)]
struct StateWriter {
    changes: Sender<StateChange>,
    /// Its values are the recent documents as written; other windows add to the same file.
    task: BackgroundTask<Vec<DocumentRef>>,
}

impl StateWriter {
    /// `None` if no thread could be started.
    fn begin(path: PathBuf) -> Option<Self> {
        let (changes, incoming) = channel::<StateChange>();
        let task = BackgroundTask::stream(
            "state",
            || (),
            move |output| {
                for change in incoming {
                    output.send(change_file(&path, change));
                }
            },
        );
        Some(Self { changes, task: task.ok()?.joined() })
    }
}

/// Changes the file under its lock, and returns the recent documents. All errors are ignored.
fn change_file(path: &Path, change: StateChange) -> Vec<DocumentRef> {
    let _ = path.parent().map(std::fs::create_dir_all);
    let _lock = File::create(path.with_extension("lock")).and_then(FileLock::wait);
    let mut stored = StoredState::read(path);
    change(&mut stored);
    stored.write(path);
    stored.recent
}

/// The state of a folder. By default it has no file and is not stored.
#[derive(Debug, Default)]
pub struct UserState {
    writer: Option<StateWriter>,
    stored: StoredState,
    existence: ExistenceCheck,
}

impl UserState {
    pub fn read(folder: &Path) -> Self {
        let path = folder.join(FILE_NAME);
        Self {
            stored: StoredState::read(&path),
            writer: StateWriter::begin(path),
            existence: ExistenceCheck::default(),
        }
    }

    pub fn theme(&self) -> ThemePreference {
        match self.stored.theme {
            StoredTheme::Light => ThemePreference::Light,
            StoredTheme::Dark => ThemePreference::Dark,
            StoredTheme::System => ThemePreference::System,
        }
    }

    pub fn set_theme(&mut self, theme: ThemePreference) {
        let theme = match theme {
            ThemePreference::Light => StoredTheme::Light,
            ThemePreference::Dark => StoredTheme::Dark,
            ThemePreference::System => StoredTheme::System,
        };
        self.change(move |stored| stored.theme = theme);
    }

    /// The last used folder, which may no longer exist.
    pub fn folder(&self, of: FolderUse) -> Option<&Path> {
        self.stored.folders.get(&of).map(PathBuf::as_path)
    }

    /// Stores the folder of a chosen path.
    pub fn remember_folder(&mut self, of: FolderUse, path: &Path) {
        let absolute = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
        if let Some(folder) = absolute.parent().map(Path::to_owned) {
            self.change(move |stored| _ = stored.folders.insert(of, folder.clone()));
        }
    }

    /// Moves a document to the front of the recent ones.
    pub fn add_recent(&mut self, document: DocumentRef) {
        self.change(move |stored| move_to_front(&mut stored.recent, document.clone()));
    }

    /// The recent documents, each with whether it exists as far as known.
    pub fn recent(&mut self, ctx: &Context) -> impl Iterator<Item = (&DocumentRef, bool)> + use<'_> {
        while let Some(Ok(recent)) = self.writer.as_ref().and_then(|writer| writer.task.take()) {
            self.stored.recent = recent;
        }
        self.existence.update(ctx, &self.stored.recent);
        self.stored.recent.iter().map(|document| (document, self.existence.exists(document)))
    }

    /// Changes this copy and the file.
    fn change(&mut self, change: impl Fn(&mut StoredState) + Send + 'static) {
        change(&mut self.stored);
        if let Some(writer) = &self.writer {
            let _ = writer.changes.send(Box::new(change));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::recent::{MAX_RECENT, ViewState};
    use super::*;

    #[test]
    fn theme_and_folders_persist_between_sessions() {
        let temp = tempfile::tempdir().unwrap();
        let folder = temp.path().join("new");
        let mut state = UserState::read(&folder);
        assert_eq!((state.theme(), state.folder(FolderUse::Output)), (ThemePreference::System, None));
        let mut other = UserState::read(&folder);
        state.set_theme(ThemePreference::Light);
        other.remember_folder(FolderUse::Output, &temp.path().join("out.mp4"));
        other.remember_folder(FolderUse::Scene, Path::new("/nowhere/at/all.toml"));
        drop((state, other));
        let next = UserState::read(&folder);
        assert_eq!((next.theme(), next.folder(FolderUse::Output)), (ThemePreference::Light, Some(temp.path())));
        assert_eq!(next.folder(FolderUse::Scene), Some(Path::new("/nowhere/at")));
        std::fs::write(folder.join(FILE_NAME), "{\"theme\": \"pink\", \"folders\": {\"scene\": \"/s\"}}").unwrap();
        let next = UserState::read(&folder);
        assert_eq!((next.theme(), next.folder(FolderUse::Scene)), (ThemePreference::System, Some(Path::new("/s"))));
    }

    #[test]
    fn newest_recent_document_is_first_and_documents_are_unique() {
        let temp = tempfile::tempdir().unwrap();
        let document = |n: usize| DocumentRef {
            profile: Some("/p.toml".into()),
            at: ViewState { frame: n, ..ViewState::default() },
            ..DocumentRef::recording(format!("/r/{n}").into())
        };
        let mut state = UserState::read(temp.path());
        let mut other = UserState::read(temp.path());
        (0..MAX_RECENT).for_each(|n| state.add_recent(document(n)));
        drop(state);
        // It has not read the entries that the first one added.
        other.add_recent(document(99));
        other.add_recent(document(5));
        drop(other);
        let recent = UserState::read(temp.path()).stored.recent;
        assert_eq!((recent.len(), &recent[0], &recent[1]), (MAX_RECENT, &document(5), &document(99)));
        assert_eq!(recent.iter().filter(|o| **o == document(5)).count(), 1);
        std::fs::write(temp.path().join(FILE_NAME), "no object").unwrap();
        assert!(UserState::read(temp.path()).stored.recent.is_empty());
    }
}
