//! References to recently opened documents with their last views.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use eframe::egui::Context;
use serde::{Deserialize, Serialize};

use super::project::Project;
use super::task::BackgroundTask;
use locard_engine::live::LiveSpec;

/// Largest number of recent documents.
pub const MAX_RECENT: usize = 12;
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
                metres_per_unit: project.shot().opened_unit_m(),
                ..Self::recording(absolute(&project.shot().recording.path))
            },
        }
    }
}

/// Moves a document to the front of a list.
pub fn move_to_front(list: &mut Vec<DocumentRef>, document: DocumentRef) {
    list.retain(|other| other.recording != document.recording);
    list.insert(0, document);
    list.truncate(MAX_RECENT);
}

/// Checks on a background thread which recordings exist.
#[derive(Debug, Default)]
pub struct ExistenceCheck {
    missing: Vec<PathBuf>,
    task: Option<BackgroundTask<Vec<PathBuf>>>,
    started: Option<Instant>,
}

impl ExistenceCheck {
    /// Takes the result of the last check, and starts another one when it is due.
    pub fn update(&mut self, ctx: &Context, documents: &[DocumentRef]) {
        if let Some(missing) = self.task.as_ref().and_then(BackgroundTask::take) {
            (self.missing, self.task) = (missing.unwrap_or_default(), None);
        }
        if self.task.is_some() || self.started.is_some_and(|started| started.elapsed() < CHECK_INTERVAL) {
            return;
        }
        let recordings = documents.iter().filter(|document| document.camera.is_none());
        let paths: Vec<PathBuf> = recordings.map(|document| document.recording.clone()).collect();
        let wake = ctx.clone();
        let missing = move || paths.into_iter().filter(|path| !path.exists()).collect();
        self.task = BackgroundTask::spawn("check recent", move || wake.request_repaint(), missing).ok();
        self.started = Some(Instant::now());
    }

    /// False if the last check did not find the recording.
    pub fn exists(&self, document: &DocumentRef) -> bool {
        !self.missing.contains(&document.recording)
    }
}
