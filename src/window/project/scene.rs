//! The edited scene: loading, uncommitted changes, and history steps.

use std::path::PathBuf;
use std::sync::Arc;

use glam::DVec3;

use super::super::history::HistoryRecord;
use super::{Edit, Project};
use locard_engine::scene::{self, MissingModels, Scene, SceneError, SceneFile};

impl Project {
    /// The scene's file, or the one that would be created. Relative paths are relative to it.
    pub fn scene_path(&self) -> PathBuf {
        self.scene.clone().unwrap_or_else(|| PathBuf::from("scene.toml"))
    }

    /// True if objects can be placed. A model that is opened alone keeps its own coordinates.
    pub fn can_place(&self) -> bool {
        self.scene.is_none() || self.scene_text.is_some()
    }

    /// Changes the scene. A scene that fails to load is refused, and nothing changes.
    pub fn change_scene(&mut self, what: &str, change: impl FnOnce(&mut SceneFile)) -> Result<(), SceneError> {
        let mut edit = self.edit().clone();
        change(&mut edit.scene);
        let loaded = self.load_changed(&edit.scene)?;
        self.show_loaded(loaded, &edit.scene);
        self.change(what, edit);
        Ok(())
    }

    /// Shows an uncommitted scene. A scene that fails to load is refused, and the displayed one
    /// stays.
    pub fn set_uncommitted_scene(&mut self, scene: SceneFile) -> Result<(), SceneError> {
        if scene == self.edit().scene {
            return Ok(());
        }
        let loaded = self.load_changed(&scene)?;
        self.show_loaded(loaded, &scene);
        self.history.set_uncommitted(Edit { scene, ..self.edit().clone() });
        self.update_shot();
        Ok(())
    }

    /// Commits the uncommitted scene as a step. Returns false if it changes nothing.
    pub fn commit(&mut self, what: &str) -> bool {
        self.history.commit(what)
    }

    /// Discards the uncommitted scene.
    pub fn discard_uncommitted(&mut self) {
        self.history.discard_uncommitted();
        self.update_shot();
    }

    /// Restores unsaved work and its history after the state of the files. Without a history the
    /// work is one step. A scene that fails to load is refused, and nothing changes.
    pub fn restore(&mut self, edit: Edit, history: HistoryRecord<Edit>) -> Result<(), SceneError> {
        let loaded = self.load(&edit.scene)?;
        self.show_loaded(loaded, &edit.scene);
        self.history.restore(history);
        self.change("restored", edit);
        self.close_step();
        Ok(())
    }

    /// Takes over the reopened files, in one step that can be undone.
    pub fn adopt_files(&mut self, fresh: Self) {
        let edit = fresh.edit().clone();
        (self.baseline, self.saved, self.scene_text) = (fresh.baseline, fresh.saved, fresh.scene_text);
        (self.scene_settings, self.scene_is_stale) = (fresh.scene_settings, fresh.scene_is_stale);
        (self.unpinned, self.overridden) = (fresh.unpinned, fresh.overridden);
        self.stamps = fresh.stamps;
        self.shot.take_files(fresh.shot);
        // The files were reopened by absolute paths; here they may be relative.
        for path in [self.profile.clone(), self.scene.clone()].into_iter().flatten() {
            let stamp = std::path::absolute(&path).ok().and_then(|whole| self.stamp(&whole));
            self.stamps.entry(path).or_insert(stamp);
        }
        self.change("read again", edit);
        self.close_step();
    }

    /// The world's up direction. If neither scene nor recording defines it and no object is placed,
    /// it follows from the camera's orientation.
    pub fn up(&self) -> DVec3 {
        let fallback = || if self.is_up_undefined() { self.shot.camera_up() } else { DVec3::Z };
        self.shot.up().unwrap_or_else(fallback)
    }

    /// True if the first placed object will define the up direction.
    pub fn is_up_undefined(&self) -> bool {
        self.shot.up().is_none() && self.edit().scene.objects.is_empty()
    }

    /// Loads a scene. Marked boxes replace models that cannot be read.
    pub(super) fn load(&mut self, scene: &SceneFile) -> Result<Scene, SceneError> {
        let path = self.scene_path();
        let up = self.shot.recording.up;
        scene::load_file_with(scene, &path, up, &mut self.models, MissingModels::StandIn)
    }

    /// Loads a changed scene. Files that are new to it must be readable.
    pub(super) fn load_changed(&mut self, scene: &SceneFile) -> Result<Scene, SceneError> {
        let loaded = self.load(scene)?;
        let before = &self.edit().scene;
        let is_new = |name: &String| !before.objects.iter().any(|object| object.model == *name);
        let is_same_panorama = scene.light.environment == before.light.environment;
        let light = if is_same_panorama { Default::default() } else { scene.light.clone() };
        let objects = scene.objects.iter().filter(|object| is_new(&object.model)).cloned().collect();
        let new = SceneFile { objects, light, ..SceneFile::default() };
        let names_files = !(new.objects.is_empty() && new.light.is_unspecified());
        if names_files && !loaded.missing.is_empty() {
            scene::load_file(&new, &self.scene_path(), None)?;
        }
        Ok(loaded)
    }

    /// Shows a loaded scene. The next change of the shot has the next version.
    fn show_loaded(&mut self, loaded: Scene, from: &SceneFile) {
        self.shot.set_scene(Arc::new(loaded));
        self.loaded_scene = from.clone();
        self.scene_version += 1;
        self.variant_version = self.version + 1;
        self.problem = None;
    }

    /// Updates the shot to the edited state.
    pub(super) fn update_shot(&mut self) {
        if self.loaded_scene != self.edit().scene {
            let scene = self.edit().scene.clone();
            // It was loadable when it was set; its files may have gone since.
            match self.load(&scene) {
                Ok(loaded) => self.show_loaded(loaded, &scene),
                Err(error) => self.problem = Some(error.to_string()),
            }
        }
        let own = self.shot_settings();
        self.shot.set_settings_of_scene(&own);
        let edit = self.history.current();
        let has_other_camera = self.shot.rig != edit.rig;
        self.shot.rig = edit.rig.clone();
        // A scan is rendered in the present camera.
        if has_other_camera && self.shot.recording.site().is_some() {
            self.shot.register_depth();
        }
        self.shot.settings = edit.settings.clone();
        self.version += 1;
        if self.last_variant != edit.other {
            self.last_variant = edit.other.clone();
            self.variant_version = self.version;
        }
    }
}
