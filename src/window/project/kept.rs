//! Where changed values are saved: those of the shot with the scene, those of the camera with the
//! scene or in its profile.

use std::path::Path;

use super::{Edit, Project};
use crate::profile::{Look, ShotSettings};

/// Tables that describe the camera itself. What is dialled for a shot stands in [`DIALS`].
const CAMERA: [&str; 5] = ["camera", "camera.distortion", "camera.lens", "camera.response", "point_spread"];
const DIALS: [&str; 3] = ["f_number", "aperture_diameter_mm", "focus_distance_m"];
const EXPOSURE: &str = "camera.exposure";

/// Whether a parameter describes the camera, and with it every recording by that camera.
fn is_of_camera(table: &str, name: &str) -> bool {
    CAMERA.contains(&table) && !DIALS.contains(&name)
}

/// Which values a profile takes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Extent {
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

fn look(edit: &Edit) -> Look<'_> {
    Look { rig: &edit.rig, settings: &edit.settings }
}

/// Puts values of another edit into one: their names and ranges are right.
fn put(values: &ShotSettings, edit: &mut Edit) {
    let _ = values.apply(&mut edit.rig, &mut edit.settings, Path::new(""));
}

impl Project {
    /// Changes against what is saved.
    fn unsaved(&self) -> ShotSettings {
        ShotSettings::between(look(&self.saved), look(self.edit()))
    }

    /// Changes that describe the camera, against what is saved.
    fn unsaved_of_camera(&self) -> ShotSettings {
        self.unsaved().filtered(is_of_camera)
    }

    /// The names of the changed values that describe the camera.
    pub fn camera_changes(&self) -> Vec<String> {
        let changes = self.unsaved_of_camera();
        let tables = super::tables(&self.edit().rig, &self.edit().settings);
        let called = |(table, name): (&str, &str)| {
            let params = tables.iter().find(|params| params.table() == table);
            params.map_or_else(|| name.to_owned(), |params| crate::params::called(*params, name))
        };
        let noise = changes.has_noise().then(|| "Camera: noise".to_owned());
        changes.keys().map(called).chain(noise).collect()
    }

    pub fn camera_is_changed(&self) -> bool {
        (&self.edit().rig, &self.edit().settings) != (&self.saved.rig, &self.saved.settings)
            && !self.unsaved_of_camera().is_empty()
    }

    pub fn settings_are_changed(&self) -> bool {
        (&self.edit().rig, &self.edit().settings) != (&self.saved.rig, &self.saved.settings)
    }

    /// Whether the scene file has to be written: what is placed, the shot's settings, or settings
    /// that a profile has taken.
    pub fn scene_is_changed(&self) -> bool {
        self.edit().scene != self.saved.scene
            || self.can_place() && (self.settings_are_changed() || self.scene_is_stale)
    }

    /// The scene file's own settings, as all is set now.
    pub(super) fn shot_settings(&self) -> ShotSettings {
        ShotSettings::between(look(&self.opened), look(self.edit()))
    }

    /// What a profile takes. An exposure that overrides each frame's own is the recording's alone.
    pub(super) fn for_profile(&self, extent: Extent) -> ForProfile {
        let exposure = &self.shot.recording.exposure;
        let is_recorded = exposure.iter().any(|e| e.time_s.or(e.blurred_s).is_some());
        let keeps_exposure = is_recorded && self.edit().settings.overrule_recorded_exposure;
        match extent {
            Extent::All => {
                let takes = |table: &str, _: &str| !(keeps_exposure && table == EXPOSURE);
                ForProfile { of_saved: self.unsaved().filtered(takes), of_opened: self.shot_settings().filtered(takes) }
            }
            Extent::Camera => {
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
        let is_same = |one: &Edit| ShotSettings::between(look(one), look(edit)).is_empty();
        if is_same(&self.saved) {
            (self.saved.rig, self.saved.settings) = (edit.rig.clone(), edit.settings.clone());
        }
        if is_same(&self.opened) {
            self.opened.rig = edit.rig.clone();
        }
        let wanted = ShotSettings::between(look(&self.opened), look(&self.saved));
        self.scene_is_stale = wanted != self.of_scene;
    }
}
