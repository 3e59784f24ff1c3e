//! Decides where changed values are saved: shot settings in the scene, camera values in the scene
//! or its profile.

use std::collections::BTreeSet;
use std::path::Path;

use super::{Edit, Project, full_name};
use locard_engine::compositor::Settings;
use locard_engine::params::Value;
use locard_engine::profile::{ParameterValues, Rig, ShotSettings};
use locard_engine::shot::{EstimatedParam, ResolvedSettings};

/// Tables that describe the camera itself. Shot settings among them are in [`SHOT_PARAMETERS`].
const CAMERA_TABLES: [&str; 5] = ["camera", "camera.distortion", "camera.lens", "camera.response", "point_spread"];
const SHOT_PARAMETERS: [&str; 3] = ["f_number", "aperture_diameter_mm", "focus_distance_m"];
const EXPOSURE_TABLE: &str = "camera.exposure";

/// True for a parameter of the camera, which applies to every recording by that camera.
fn is_of_camera(table: &str, name: &str) -> bool {
    CAMERA_TABLES.contains(&table) && !SHOT_PARAMETERS.contains(&name)
}

/// Selects the values to write into a profile.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ProfileScope {
    /// All except the results of an analysis of the recording.
    All,
    /// Changed values that describe the camera.
    Camera,
}

/// Values to write into a profile.
#[derive(Clone, Debug)]
pub struct ProfileValues {
    /// Relative to [`Project::saved`], and relative to the state without the scene.
    pub from_saved: ShotSettings,
    pub from_baseline: ShotSettings,
}

/// The scene file's own settings for a camera and effects: differences from `opened`, and settings
/// of the file that are still in effect.
pub(super) fn settings_of_scene(
    opened: ParameterValues<'_>,
    scene_settings: &ShotSettings,
    now: ParameterValues<'_>,
) -> ShotSettings {
    ShotSettings::between(opened, now).with_unchanged(scene_settings, now)
}

/// Applies values of another edit, whose names and ranges are valid.
fn apply_values(values: &ShotSettings, rig: &mut Rig, settings: &mut Settings) {
    let _ = values.apply(rig, settings, Path::new(""));
}

impl Project {
    /// Differences from the saved state.
    fn unsaved(&self) -> ShotSettings {
        ShotSettings::between(self.saved.look(), self.edit().look())
    }

    /// Differences from the saved state that describe the camera.
    fn unsaved_of_camera(&self) -> ShotSettings {
        self.unsaved().filtered(is_of_camera)
    }

    /// Names of the changed values that describe the camera.
    pub fn camera_changes(&self) -> Vec<String> {
        self.names(&self.unsaved_of_camera())
    }

    /// Names of changed values that no file can store: a model that is opened alone has no scene
    /// file, and its profile does not accept them.
    pub fn unsavable_changes(&self) -> Vec<String> {
        if self.can_place() {
            return Vec::new();
        }
        let changes = self.unsaved().filtered(|table, name| !self.profile_accepts(table, name));
        self.names(&changes)
    }

    fn names(&self, values: &ShotSettings) -> Vec<String> {
        let tables = super::tables(&self.edit().rig, &self.edit().settings);
        let name_of = |(table, name, _): (&str, &str, &Value)| {
            let params = tables.iter().find(|params| params.table() == table);
            params.map_or_else(|| name.to_owned(), |params| locard_engine::params::called(*params, name))
        };
        let noise = values.noise().map(|_| "Camera: noise".to_owned());
        values.values().map(name_of).chain(noise).collect()
    }

    pub fn camera_is_changed(&self) -> bool {
        (&self.edit().rig, &self.edit().settings) != (&self.saved.rig, &self.saved.settings)
            && !self.unsaved_of_camera().is_empty()
    }

    pub fn settings_are_changed(&self) -> bool {
        (&self.edit().rig, &self.edit().settings) != (&self.saved.rig, &self.saved.settings)
    }

    /// True if a profile accepts a changed setting. Changes that are not parameters count too.
    pub fn profile_is_changed(&self) -> bool {
        let unsaved = self.unsaved();
        let is_accepted = unsaved.is_empty() || !self.accepted_by_profile(&unsaved).is_empty();
        self.settings_are_changed() && is_accepted
    }

    /// True if the scene file must be written, for changed objects, shot settings, or settings that
    /// moved into a profile.
    pub fn scene_is_changed(&self) -> bool {
        let is_unpinned = self.edit().unpinned != self.saved.unpinned;
        self.edit().scene != self.saved.scene
            || self.can_place() && (self.settings_are_changed() || is_unpinned || self.scene_is_stale)
    }

    /// The scene's own settings at present.
    pub(super) fn shot_settings(&self) -> ShotSettings {
        self.settings_of(self.edit().look(), &self.edit().unpinned)
    }

    /// The scene's own settings for another camera and other effects.
    pub(super) fn settings_of(&self, now: ParameterValues<'_>, unpinned: &BTreeSet<String>) -> ShotSettings {
        settings_of_scene(self.baseline.values(), &self.pins(unpinned), now)
    }

    /// The settings to write into the scene file: the scene's own, and those that
    /// [`ShotOptions::sets`] overrides unless the user has changed them.
    ///
    /// [`ShotOptions::sets`]: locard_engine::shot::ShotOptions::sets
    pub(super) fn file_settings(&self, edit: &Edit) -> ShotSettings {
        let overridden = self.overridden.where_equal(self.baseline.values(), edit.look());
        self.settings_of(edit.look(), &edit.unpinned).or(&overridden)
    }

    /// Settings that the scene keeps while their values are unchanged.
    pub(super) fn pins(&self, unpinned: &BTreeSet<String>) -> ShotSettings {
        let is_pinned = |table: &str, name: &str| !unpinned.contains(&full_name(table, name));
        self.scene_settings.clone().or(&self.unpinned).filtered(is_pinned)
    }

    /// True if the scene's own settings pin a parameter's value, possibly to the same value as the
    /// profile's.
    pub fn is_pinned(&self, table: &str, name: &str) -> bool {
        let is_given = self.scene_settings.has(table, name) || self.unpinned.has(table, name);
        is_given && self.shot_settings().has(table, name)
    }

    /// Called when a scene file with these settings has been written for an edit.
    pub(super) fn mark_scene_written(&mut self, settings: ShotSettings, edit: &Edit) {
        let before = std::mem::take(&mut self.scene_settings).or(&self.unpinned);
        let is_unpinned = |table: &str, name: &str| edit.unpinned.contains(&full_name(table, name));
        self.unpinned = before.filtered(is_unpinned).without_noise();
        (self.scene_settings, self.scene_is_stale) = (settings, false);
    }

    /// True if a profile accepts a parameter. An exposure that overrides each frame's own belongs
    /// to the recording only. A readout time that an analysis overrides needs a scene file.
    fn profile_accepts(&self, table: &str, name: &str) -> bool {
        if table == EXPOSURE_TABLE && self.edit().settings.overrule_recorded_exposure {
            return !self.shot.recording.has_exposure_times();
        }
        let overrides = |estimate: &EstimatedParam| {
            estimate.overrides_profiles() && (estimate.table, estimate.name) == (table, name)
        };
        self.can_place() || !self.shot.estimates().iter().any(overrides)
    }

    fn accepted_by_profile(&self, values: &ShotSettings) -> ShotSettings {
        values.filtered(|table, name| self.profile_accepts(table, name))
    }

    /// Values to write into a profile.
    pub(super) fn profile_values(&self, scope: ProfileScope) -> ProfileValues {
        match scope {
            ProfileScope::All => ProfileValues {
                from_saved: self.accepted_by_profile(&self.unsaved()),
                from_baseline: self.accepted_by_profile(&self.shot_settings()),
            },
            ProfileScope::Camera => {
                let of_camera = self.unsaved_of_camera();
                ProfileValues { from_saved: of_camera.clone(), from_baseline: of_camera }
            }
        }
    }

    /// The camera and settings that the written profile results in.
    pub(super) fn by_profile(&self, values: &ProfileValues) -> ResolvedSettings {
        let ResolvedSettings { mut rig, mut settings } = self.baseline.clone();
        apply_values(&values.from_baseline, &mut rig, &mut settings);
        ResolvedSettings { rig, settings }
    }

    /// Called when values have been written into the profile; `edit` is the state of that moment.
    pub(super) fn mark_profile_written(&mut self, values: &ProfileValues, edit: &Edit) {
        apply_values(&values.from_saved, &mut self.saved.rig, &mut self.saved.settings);
        self.baseline = self.by_profile(values);
        // The profile does not override these values, so differences stay in the scene.
        let estimates = self.shot.estimates();
        let overriding = estimates.iter().filter(|estimate| estimate.overrides_profiles());
        EstimatedParam::apply(overriding, &mut self.baseline.rig, &mut self.baseline.settings);
        let is_same = |one: ParameterValues<'_>| ShotSettings::between(one, edit.look()).is_empty();
        if is_same(self.saved.look()) {
            (self.saved.rig, self.saved.settings) = (edit.rig.clone(), edit.settings.clone());
        }
        if is_same(self.baseline.values()) {
            self.baseline.rig = edit.rig.clone();
        }
        self.scene_is_stale = self.file_settings(&self.saved) != self.scene_settings;
    }
}
