//! Recently opened documents with their last views, the newest first.

use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::{Builder, JoinHandle};
use std::time::{Duration, Instant};

use eframe::egui::Context;
use serde::{Deserialize, Serialize};

use super::project::Project;
use super::state;
use super::task::BackgroundTask;
use locard_engine::live::LiveSpec;

const MAX_ENTRIES: usize = 12;
/// Interval at which the existence of the documents is checked.
const CHECK_INTERVAL: Duration = Duration::from_secs(2);

/// A document to open: a recording or camera with its files. Paths are absolute.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
pub struct DocumentRef {
    pub recording: PathBuf,
    pub scene: Option<PathBuf>,
    pub profile: Option<PathBuf>,
    pub metres_per_unit: f64,
    #[serde(default)]
    pub at: ViewState,
    /// Live camera that replaces the recording, whose path is then the camera's name.
    #[serde(default)]
    pub camera: Option<LiveSpec>,
}

/// The displayed frame and view.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize, Serialize)]
#[serde(default)]
pub struct ViewState {
    pub frame: usize,
    /// Screen pixels per picture pixel; `None` fits the picture into the panel.
    pub zoom: Option<f32>,
    /// Centre of the view, relative to the picture's size.
    pub centre: [f32; 2],
}

impl DocumentRef {
    /// A recording without further files.
    pub fn recording(recording: PathBuf) -> Self {
        Self { recording, scene: None, profile: None, metres_per_unit: 1.0, at: ViewState::default(), camera: None }
    }

    /// A camera with its profile and scene.
    pub fn camera(from: LiveSpec, profile: Option<PathBuf>, scene: Option<PathBuf>) -> Self {
        let name = PathBuf::from(from.name());
        Self { scene, profile, camera: Some(from), ..Self::recording(name) }
    }

    /// The open document with the default view.
    pub fn of(project: &Project) -> Self {
        let absolute = |path: &Path| std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
        let (scene, profile) = (project.scene.as_deref().map(absolute), project.profile.as_deref().map(absolute));
        match project.camera.clone().filter(|_| project.shot().recording.is_live()) {
            Some(from) => Self::camera(from, profile, scene),
            None => Self {
                scene,
                profile,
                metres_per_unit: project.metres_per_unit,
                ..Self::recording(absolute(&project.shot().recording.path))
            },
        }
    }
}

/// Moves a document to the front of a list.
fn move_to_front(list: &mut Vec<DocumentRef>, document: DocumentRef) {
    list.retain(|other| other.recording != document.recording);
    list.insert(0, document);
    list.truncate(MAX_ENTRIES);
}

/// Writes the list on a background thread.
#[derive(Debug)]
struct RecentWriter {
    updates: Option<Sender<DocumentRef>>,
    /// The lists as written; other windows add to the same file.
    lists: Receiver<Vec<DocumentRef>>,
    thread: Option<JoinHandle<()>>,
}

impl RecentWriter {
    /// `None` if no thread could be started.
    fn begin(file: PathBuf) -> Option<Self> {
        let ((updates, incoming), (sender, lists)) = (channel(), channel());
        let thread = Builder::new().name("recent".to_owned()).spawn(move || {
            for document in incoming {
                // Another window may have changed the file.
                let mut list = state::read(&file);
                move_to_front(&mut list, document);
                // A failure to write the list is ignored.
                state::keep(&file, &list);
                let _ = sender.send(list);
            }
        });
        Some(Self { updates: Some(updates), lists, thread: Some(thread.ok()?) })
    }
}

impl Drop for RecentWriter {
    fn drop(&mut self) {
        drop(self.updates.take());
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// The list in a file. Without a file it starts empty and is not stored.
#[derive(Debug, Default)]
pub struct Recent {
    writer: Option<RecentWriter>,
    list: Vec<DocumentRef>,
    /// Documents that no longer exist.
    missing: Vec<PathBuf>,
    check_task: Option<BackgroundTask<Vec<PathBuf>>>,
    last_check: Option<Instant>,
}

impl Recent {
    pub fn read(file: PathBuf) -> Self {
        let list = state::read(&file);
        Self { writer: RecentWriter::begin(file), list, ..Self::default() }
    }

    /// Moves a document to the front.
    pub fn add(&mut self, document: DocumentRef) {
        if let Some(updates) = self.writer.as_ref().and_then(|writer| writer.updates.as_ref()) {
            let _ = updates.send(document.clone());
        }
        move_to_front(&mut self.list, document);
    }

    /// The documents, each with whether it exists as far as known: the check runs in the
    /// background.
    pub fn entries(&mut self, ctx: &Context) -> impl Iterator<Item = (&DocumentRef, bool)> + use<'_> {
        if let Some(list) = self.writer.as_ref().and_then(|writer| writer.lists.try_iter().last()) {
            self.list = list;
        }
        if let Some(missing) = self.check_task.as_ref().and_then(BackgroundTask::take) {
            (self.missing, self.check_task) = (missing.unwrap_or_default(), None);
        }
        if self.check_task.is_none() && self.last_check.is_none_or(|last_check| last_check.elapsed() >= CHECK_INTERVAL)
        {
            let recordings = self.list.iter().filter(|document| document.camera.is_none());
            let (wake, paths) = (ctx.clone(), recordings.map(|document| document.recording.clone()));
            let paths: Vec<PathBuf> = paths.collect();
            let missing = move || paths.into_iter().filter(|path| !path.exists()).collect();
            self.check_task = BackgroundTask::spawn("recent there", move || wake.request_repaint(), missing).ok();
            self.last_check = Some(Instant::now());
        }
        self.list.iter().map(|document| (document, !self.missing.contains(&document.recording)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn newest_entry_is_first_and_entries_are_unique() {
        let temp = tempfile::tempdir().unwrap();
        let file = temp.path().join("new/recent.json");
        let document = |n: usize| DocumentRef {
            profile: Some("/p.toml".into()),
            at: ViewState { frame: n, ..ViewState::default() },
            ..DocumentRef::recording(format!("/r/{n}").into())
        };
        let mut recent = Recent::read(file.clone());
        let mut other = Recent::read(file.clone());
        (0..MAX_ENTRIES).for_each(|n| recent.add(document(n)));
        drop(recent);
        // It has not read what the first one added.
        other.add(document(99));
        other.add(document(5));
        drop(other);
        let list = Recent::read(file.clone()).list;
        assert_eq!((list.len(), &list[0], &list[1]), (MAX_ENTRIES, &document(5), &document(99)));
        assert_eq!(list.iter().filter(|o| **o == document(5)).count(), 1);
        std::fs::write(&file, "no list").unwrap();
        assert!(Recent::read(file).list.is_empty());
    }
}
