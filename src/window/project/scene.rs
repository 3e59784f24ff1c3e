//! What is put into the footage: the scene as it is edited, tried and loaded.

use std::path::PathBuf;
use std::sync::Arc;

use glam::DVec3;

use super::super::history::Record;
use super::{Edit, Project};
use locard_engine::scene::{self, MissingModels, Scene, SceneError, SceneFile};

impl Project {
    /// Where scene files are looked for and models named from: the scene's file, or where one would
    /// be made.
    pub fn scene_path(&self) -> PathBuf {
        self.scene.clone().unwrap_or_else(|| PathBuf::from("scene.toml"))
    }

    /// Whether objects can be placed: a model that is opened alone stands by its own coordinates.
    pub fn can_place(&self) -> bool {
        self.scene.is_none() || self.scene_text.is_some()
    }

    /// Changes what is put into the footage. What does not load is refused, and nothing changes.
    pub fn change_scene(&mut self, what: &str, change: impl FnOnce(&mut SceneFile)) -> Result<(), SceneError> {
        let mut edit = self.edit().clone();
        change(&mut edit.scene);
        let loaded = self.load_changed(&edit.scene)?;
        self.put(loaded, &edit.scene);
        self.change(what, edit);
        Ok(())
    }

    /// Shows another scene, which is no step of the history until it is kept. A scene that does not
    /// load is refused, and the one that was shown stays.
    pub fn try_scene(&mut self, scene: SceneFile) -> Result<(), SceneError> {
        if scene == self.edit().scene {
            return Ok(());
        }
        let loaded = self.load_changed(&scene)?;
        self.put(loaded, &scene);
        self.history.try_on(Edit { scene, ..self.edit().clone() });
        self.follow();
        Ok(())
    }

    /// Makes the scene that was tried a step. `false` where that changes nothing.
    pub fn keep_tried(&mut self, what: &str) -> bool {
        self.history.keep_tried(what)
    }

    /// Goes back to the scene before it was tried.
    pub fn drop_tried(&mut self) {
        self.history.drop_tried();
        self.follow();
    }

    /// Restores unsaved work and its history, after the state of the files. Without a history the
    /// work is one step. A scene that does not load is refused, and nothing changes.
    pub fn restore(&mut self, edit: Edit, history: Record<Edit>) -> Result<(), SceneError> {
        let loaded = self.load(&edit.scene)?;
        self.put(loaded, &edit.scene);
        self.history.restore(history);
        self.change("restored", edit);
        self.close_step();
        Ok(())
    }

    /// Takes what the files say now, as they were opened anew: one step, which can be taken back.
    pub fn read_again(&mut self, fresh: Self) {
        let edit = fresh.edit().clone();
        (self.opened, self.saved, self.scene_text) = (fresh.opened, fresh.saved, fresh.scene_text);
        (self.of_scene, self.scene_is_stale) = (fresh.of_scene, fresh.scene_is_stale);
        (self.unpinned, self.overridden) = (fresh.unpinned, fresh.overridden);
        self.stamps = fresh.stamps;
        self.shot.take_files(fresh.shot);
        // The files were opened anew by absolute paths; here they may have relative ones.
        for path in [self.profile.clone(), self.scene.clone()].into_iter().flatten() {
            let stamp = std::path::absolute(&path).ok().and_then(|whole| self.stamp(&whole));
            self.stamps.entry(path).or_insert(stamp);
        }
        self.change("read again", edit);
        self.close_step();
    }

    /// The world's up for the scene as it is. While neither scene nor recording gives it and no
    /// object is placed, it follows from how the camera was held.
    pub fn up(&self) -> DVec3 {
        let unsaid = || if self.says_no_up() { self.shot.held_up() } else { DVec3::Z };
        self.shot.up().unwrap_or_else(unsaid)
    }

    /// Whether the first thing that is placed says which way is up.
    pub fn says_no_up(&self) -> bool {
        self.shot.up().is_none() && self.edit().scene.objects.is_empty()
    }

    /// Loads a scene, with marked boxes in place of models that cannot be read.
    pub(super) fn load(&mut self, scene: &SceneFile) -> Result<Scene, SceneError> {
        let path = self.scene_path();
        let up = self.shot.recording.up;
        scene::load_file_with(scene, &path, up, &mut self.models, MissingModels::StandIn)
    }

    /// Loads a changed scene. Files that the scene did not name before must be readable.
    pub(super) fn load_changed(&mut self, scene: &SceneFile) -> Result<Scene, SceneError> {
        let loaded = self.load(scene)?;
        let before = &self.edit().scene;
        let is_new = |name: &String| !before.objects.iter().any(|object| object.model == *name);
        let is_same_panorama = scene.light.environment == before.light.environment;
        let light = if is_same_panorama { Default::default() } else { scene.light.clone() };
        let objects = scene.objects.iter().filter(|object| is_new(&object.model)).cloned().collect();
        let new = SceneFile { objects, light, ..SceneFile::default() };
        let names_files = !(new.objects.is_empty() && new.light.says_none());
        if names_files && !loaded.missing.is_empty() {
            scene::load_file(&new, &self.scene_path(), None)?;
        }
        Ok(loaded)
    }

    /// Has the shot show what was loaded from a scene file's contents. The next change of the shot has
    /// the next version.
    fn put(&mut self, loaded: Scene, from: &SceneFile) {
        self.shot.set_scene(Arc::new(loaded));
        self.loaded = from.clone();
        self.scene_version += 1;
        self.other_version = self.version + 1;
        self.problem = None;
    }

    /// Has the shot follow what is set.
    pub(super) fn follow(&mut self) {
        if self.loaded != self.edit().scene {
            let scene = self.edit().scene.clone();
            // It was loaded when it was set; its files may be gone since.
            match self.load(&scene) {
                Ok(loaded) => self.put(loaded, &scene),
                Err(error) => self.problem = Some(error.to_string()),
            }
        }
        let own = self.shot_settings();
        self.shot.set_settings_of_scene(&own);
        let edit = self.history.now();
        self.shot.rig = edit.rig.clone();
        self.shot.settings = edit.settings.clone();
        self.version += 1;
        if self.other != edit.other {
            self.other = edit.other.clone();
            self.other_version = self.version;
        }
    }
}
