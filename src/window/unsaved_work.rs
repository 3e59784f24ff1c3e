//! Format of recovery files.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{SystemTime, UNIX_EPOCH};

use serde::{Deserialize, Serialize};

use super::history::HistoryRecord;
use super::project::Edit;
use super::recent::{DocumentRef, ViewState};
use locard_engine::live::LiveSpec;

/// Version of the file format.
const FORMAT_VERSION: u32 = 1;

/// The edited state with the paths of its documents.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct UnsavedWork {
    version: u32,
    /// Seconds since 1970 (UTC).
    pub at_s: u64,
    /// All paths are absolute.
    pub recording: PathBuf,
    pub metres_per_unit: f64,
    pub profile: Option<PathBuf>,
    pub scene: Option<PathBuf>,
    pub frame: usize,
    /// Live camera that replaces the recording.
    #[serde(default)]
    pub camera: Option<LiveSpec>,
    pub edit: Edit,
    /// The last [`HISTORY_STEPS`] steps that led to `edit`, and the undone steps after it.
    #[serde(default)]
    pub history: HistoryRecord<Edit>,
}

/// Largest number of history steps in a recovery file. Steps are dropped if the file would exceed
/// the limit of `locard_engine::source::file`.
pub const HISTORY_STEPS: usize = 50;

impl UnsavedWork {
    /// Unsaved work at this moment. A scene without a file refers to its models and panorama by
    /// absolute paths, because it has no folder.
    pub fn new(
        recording: &Path,
        metres_per_unit: f64,
        profile: Option<&Path>,
        scene: Option<&Path>,
        edit: Edit,
    ) -> Self {
        let mut edit = edit;
        if scene.is_none() {
            make_paths_absolute(&mut edit);
        }
        let at_s = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs());
        let (profile, scene) = (profile.map(absolute), scene.map(absolute));
        Self {
            version: FORMAT_VERSION,
            at_s,
            recording: absolute(recording),
            metres_per_unit,
            profile,
            scene,
            frame: 0,
            camera: None,
            edit,
            history: HistoryRecord::default(),
        }
    }

    /// Parses a recovery file; `None` for one of another format version.
    pub fn parse(text: &str) -> Option<Self> {
        serde_json::from_str(text).ok().filter(|work: &Self| work.version == FORMAT_VERSION)
    }

    /// The document to open for recovery.
    pub fn document(&self) -> DocumentRef {
        let Self { recording, scene, profile, metres_per_unit, frame, camera, .. } = self;
        let (scene, profile) = (scene.clone(), profile.clone());
        if let Some(from) = camera {
            return DocumentRef::camera(from.clone(), profile, scene);
        }
        let at = ViewState { frame: *frame, ..ViewState::default() };
        DocumentRef {
            scene,
            profile,
            metres_per_unit: *metres_per_unit,
            at,
            ..DocumentRef::recording(recording.clone())
        }
    }

    /// Adds the undo history.
    pub fn with_history(self, history: HistoryRecord<Edit>) -> Self {
        Self { history, ..self }
    }

    /// Serializes with as many history steps as fit into `max_bytes`. Copies the steps of a scene
    /// without a file, so the UI thread does not call it.
    pub fn write_json(&mut self, max_bytes: u64) -> serde_json::Result<String> {
        if self.scene.is_none() {
            self.history.steps.iter_mut().for_each(|(_, edit)| make_paths_absolute(Arc::make_mut(edit)));
        }
        loop {
            let text = serde_json::to_string(self)?;
            if text.len() as u64 <= max_bytes || !self.history.halve() {
                return Ok(text);
            }
        }
    }
}

/// Makes the paths of a scene's models and panorama absolute.
fn make_paths_absolute(edit: &mut Edit) {
    for name in edit.scene.file_names_mut() {
        *name = absolute(Path::new(name)).to_string_lossy().into_owned();
    }
}

fn absolute(path: &Path) -> PathBuf {
    std::path::absolute(path).unwrap_or_else(|_| path.to_owned())
}

/// Unsaved work for tests.
#[cfg(test)]
pub fn example(seed: u64) -> UnsavedWork {
    let mut edit = Edit {
        rig: Default::default(),
        settings: Default::default(),
        scene: Default::default(),
        other: None,
        unpinned: Default::default(),
    };
    edit.settings.seed = seed;
    UnsavedWork::new(Path::new("recordings/demo"), 1.0, None, Some(Path::new("scene.toml")), edit)
}

#[cfg(test)]
mod tests {
    use super::*;
    use locard_engine::source::file::MAX_LISTING_BYTES;

    #[test]
    fn recovery_file_contains_as_many_steps_as_fit() {
        let mut work = example(0);
        let steps = (0..16).map(|n| (n.to_string(), Arc::new(work.edit.clone()))).collect();
        work = work.with_history(HistoryRecord { steps, at: 15 });
        let alone = serde_json::to_string(&work.edit).unwrap().len() as u64;
        let text = work.write_json(8 * alone).unwrap();
        let read: UnsavedWork = serde_json::from_str(&text).unwrap();
        assert!((2..8).contains(&read.history.steps.len()) && text.len() as u64 <= 8 * alone);
        let last = &read.history.steps[read.history.at];
        assert_eq!((last.0.as_str(), &*last.1), ("15", &read.edit));
        // The work itself and its current step are always included.
        let least: UnsavedWork = serde_json::from_str(&work.write_json(1).unwrap()).unwrap();
        assert!(least.edit == work.edit && least.history.steps.len() == 1);
    }

    #[test]
    fn history_of_a_scene_without_a_file_has_absolute_paths() {
        let mut work = example(0);
        work.scene = None;
        let mut edit = work.edit.clone();
        edit.scene.light.environment = Some("hall.hdr".to_owned());
        let shared = Arc::new(edit);
        work = work.with_history(HistoryRecord { steps: vec![("lit".to_owned(), Arc::clone(&shared))], at: 0 });
        let read: UnsavedWork = serde_json::from_str(&work.write_json(MAX_LISTING_BYTES).unwrap()).unwrap();
        let written = read.history.steps[0].1.scene.light.environment.clone().unwrap();
        assert!(Path::new(&written).is_absolute(), "{written}");
        assert_eq!(shared.scene.light.environment.as_deref(), Some("hall.hdr"), "the window's own is as it was");
    }

    #[test]
    fn scene_without_a_file_has_absolute_model_paths() {
        let mut edit = example(0).edit;
        let model = locard_engine::scene::document::PlacedModel {
            model: "scenes/marker-1.glb".to_owned(),
            ..Default::default()
        };
        edit.scene.objects.push(model);
        edit.scene.light.environment = Some("scenes/demo-light.hdr".to_owned());
        let written = UnsavedWork::new(Path::new("r"), 1.0, None, None, edit.clone());
        assert!(Path::new(&written.edit.scene.objects[0].model).is_absolute());
        assert!(Path::new(&written.edit.scene.light.environment.unwrap()).is_absolute());
        let written = UnsavedWork::new(Path::new("r"), 1.0, None, Some(Path::new("s.toml")), edit.clone());
        assert_eq!(written.edit, edit);
    }
}
