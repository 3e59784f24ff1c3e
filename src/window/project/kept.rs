//! Where changed values are saved: those of the shot with the scene, those of the camera with the
//! scene or in its profile.

use std::collections::BTreeSet;
use std::path::Path;

use super::{Edit, Project, full_name};
use locard_engine::params::Value;
use locard_engine::profile::{Look, ShotSettings};
use locard_engine::shot::Follows;

/// Tables that describe the camera itself. What is dialled for a shot stands in [`DIALS`].
const CAMERA: [&str; 5] = ["camera", "camera.distortion", "camera.lens", "camera.response", "point_spread"];
const DIALS: [&str; 3] = ["f_number", "aperture_diameter_mm", "focus_distance_m"];
const EXPOSURE: &str = "camera.exposure";

/// Whether a parameter describes the camera, and with it every recording by that camera.
fn is_of_camera(table: &str, name: &str) -> bool {
    CAMERA.contains(&table) && !DIALS.contains(&name)
}

/// Which values are written into a profile.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ProfileScope {
    /// All but what an analysis found of the recording.
    All,
    /// The changed ones that describe the camera.
    Camera,
}

/// Values that are about to be written into a profile.
#[derive(Clone, Debug)]
pub struct ForProfile {
    /// Against [`Project::saved`], and against what holds without the scene.
    pub of_saved: ShotSettings,
    pub of_opened: ShotSettings,
}

/// The scene file's own settings for a camera and effects: what differs from `opened`, and what the
/// file has and still holds.
pub(super) fn settings_of_scene(opened: Look<'_>, of_scene: &ShotSettings, now: Look<'_>) -> ShotSettings {
    ShotSettings::between(opened, now).with_unchanged(of_scene, now)
}

/// Puts values of another edit into one: their names and ranges are right.
fn put(values: &ShotSettings, edit: &mut Edit) {
    let _ = values.apply(&mut edit.rig, &mut edit.settings, Path::new(""));
}

impl Project {
    /// Changes against what is saved.
    fn unsaved(&self) -> ShotSettings {
        ShotSettings::between(self.saved.look(), self.edit().look())
    }

    /// Changes that describe the camera, against what is saved.
    fn unsaved_of_camera(&self) -> ShotSettings {
        self.unsaved().filtered(is_of_camera)
    }

    /// The names of the changed values that describe the camera.
    pub fn camera_changes(&self) -> Vec<String> {
        self.names(&self.unsaved_of_camera())
    }

    /// The names of changed values that no file can keep: a model that is opened alone has no scene
    /// file, and its profile does not take them.
    pub fn unsavable_changes(&self) -> Vec<String> {
        if self.can_place() {
            return Vec::new();
        }
        let changes = self.unsaved().filtered(|table, name| !self.profile_takes(table, name));
        self.names(&changes)
    }

    fn names(&self, values: &ShotSettings) -> Vec<String> {
        let tables = super::tables(&self.edit().rig, &self.edit().settings);
        let called = |(table, name, _): (&str, &str, &Value)| {
            let params = tables.iter().find(|params| params.table() == table);
            params.map_or_else(|| name.to_owned(), |params| locard_engine::params::called(*params, name))
        };
        let noise = values.noise().map(|_| "Camera: noise".to_owned());
        values.values().map(called).chain(noise).collect()
    }

    pub fn camera_is_changed(&self) -> bool {
        (&self.edit().rig, &self.edit().settings) != (&self.saved.rig, &self.saved.settings)
            && !self.unsaved_of_camera().is_empty()
    }

    pub fn settings_are_changed(&self) -> bool {
        (&self.edit().rig, &self.edit().settings) != (&self.saved.rig, &self.saved.settings)
    }

    /// Whether settings are changed that a profile takes. Changes that are no parameter's count, too.
    pub fn profile_is_changed(&self) -> bool {
        let unsaved = self.unsaved();
        let is_taken = unsaved.is_empty() || !self.taken_by_profile(&unsaved).is_empty();
        self.settings_are_changed() && is_taken
    }

    /// Whether the scene file has to be written: what is placed, the shot's settings, or settings
    /// that a profile has taken.
    pub fn scene_is_changed(&self) -> bool {
        let is_unpinned = self.edit().unpinned != self.saved.unpinned;
        self.edit().scene != self.saved.scene
            || self.can_place() && (self.settings_are_changed() || is_unpinned || self.scene_is_stale)
    }

    /// The scene's own settings, as all is set now.
    pub(super) fn shot_settings(&self) -> ShotSettings {
        self.settings_of(self.edit().look(), &self.edit().unpinned)
    }

    /// The same for another camera and other effects.
    pub(super) fn settings_of(&self, now: Look<'_>, unpinned: &BTreeSet<String>) -> ShotSettings {
        settings_of_scene(self.opened.look(), &self.pins(unpinned), now)
    }

    /// The settings that the scene file is to have for an edit: the scene's own, and those that
    /// [`Given::sets`] overrides as long as the user has not changed them.
    ///
    /// [`Given::sets`]: locard_engine::shot::Given::sets
    pub(super) fn file_settings(&self, edit: &Edit) -> ShotSettings {
        let overridden = self.overridden.where_alike(self.opened.look(), edit.look());
        self.settings_of(edit.look(), &edit.unpinned).or(&overridden)
    }

    /// Settings that the scene keeps as long as their values are not changed.
    pub(super) fn pins(&self, unpinned: &BTreeSet<String>) -> ShotSettings {
        let is_pinned = |table: &str, name: &str| !unpinned.contains(&full_name(table, name));
        self.of_scene.clone().or(&self.unpinned).filtered(is_pinned)
    }

    /// Whether the scene's own settings keep a parameter's value, though the profile may have the
    /// same.
    pub fn is_pinned(&self, table: &str, name: &str) -> bool {
        let is_given = self.of_scene.has(table, name) || self.unpinned.has(table, name);
        is_given && self.shot_settings().has(table, name)
    }

    /// A scene file with these settings has been written for an edit.
    pub(super) fn scene_took(&mut self, settings: ShotSettings, edit: &Edit) {
        let before = std::mem::take(&mut self.of_scene).or(&self.unpinned);
        let is_unpinned = |table: &str, name: &str| edit.unpinned.contains(&full_name(table, name));
        self.unpinned = before.filtered(is_unpinned).without_noise();
        (self.of_scene, self.scene_is_stale) = (settings, false);
    }

    /// Whether a profile takes a parameter. An exposure that overrides each frame's own is the
    /// recording's alone. A readout time that an analysis overrides needs a scene file.
    fn profile_takes(&self, table: &str, name: &str) -> bool {
        if table == EXPOSURE && self.edit().settings.overrule_recorded_exposure {
            let exposure = &self.shot.recording.exposure;
            return exposure.iter().all(|e| e.time_s.or(e.blurred_s).is_none());
        }
        let mut found = self.shot.baseline().found.iter().filter(|found| found.overrides_profiles());
        self.can_place() || !found.any(|found| (found.table, found.name) == (table, name))
    }

    fn taken_by_profile(&self, values: &ShotSettings) -> ShotSettings {
        values.filtered(|table, name| self.profile_takes(table, name))
    }

    /// Values to write into a profile.
    pub(super) fn for_profile(&self, scope: ProfileScope) -> ForProfile {
        match scope {
            ProfileScope::All => ForProfile {
                of_saved: self.taken_by_profile(&self.unsaved()),
                of_opened: self.taken_by_profile(&self.shot_settings()),
            },
            ProfileScope::Camera => {
                let of_camera = self.unsaved_of_camera();
                ForProfile { of_saved: of_camera.clone(), of_opened: of_camera }
            }
        }
    }

    /// The camera and settings that the profile is to give.
    pub(super) fn by_profile(&self, values: &ForProfile) -> Edit {
        let mut edit = self.opened.clone();
        put(&values.of_opened, &mut edit);
        edit
    }

    /// Values have been written into the profile; `edit` is the state at that moment.
    pub(super) fn profile_took(&mut self, values: &ForProfile, edit: &Edit) {
        put(&values.of_saved, &mut self.saved);
        put(&values.of_opened, &mut self.opened);
        // The profile does not override these, so that values that differ stay in the scene.
        let overriding = self.shot.baseline().found.iter().filter(|found| found.overrides_profiles());
        Follows::apply(overriding, &mut self.opened.rig, &mut self.opened.settings);
        let is_same = |one: &Edit| ShotSettings::between(one.look(), edit.look()).is_empty();
        if is_same(&self.saved) {
            (self.saved.rig, self.saved.settings) = (edit.rig.clone(), edit.settings.clone());
        }
        if is_same(&self.opened) {
            self.opened.rig = edit.rig.clone();
        }
        self.scene_is_stale = self.file_settings(&self.saved) != self.of_scene;
    }
}
