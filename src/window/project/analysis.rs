//! Adopts the results of an analysis that ran while the project was open.

use std::collections::BTreeSet;
use std::path::PathBuf;

use super::save_targets::settings_of_scene;
use super::{Edit, Project, full_name};
use locard_engine::analyse::Analysis;
use locard_engine::compositor::Settings;
use locard_engine::profile::{ParameterValues, Rig};
use locard_engine::shot::{EstimatedParam, ShotError};

impl Project {
    /// Continues with an analysis of the recording. Scene, history and settings stay. The results
    /// replace the values of the recording and the profiles in every step, which is not an unsaved
    /// change. Values set by the scene or the user stay.
    pub fn adopt_analysis(&mut self, folder: PathBuf, analysis: Analysis) -> Result<(), ShotError> {
        let follows = self.shot.apply_analysis(folder, analysis)?;
        let (opened, pins) = (self.baseline.clone(), self.pins(&BTreeSet::new()));
        EstimatedParam::apply(&follows, &mut self.baseline.rig, &mut self.baseline.settings);
        self.baseline.rig.noise = self.shot.baseline()?.rig.noise;
        let noise = &self.baseline.rig.noise;
        let apply_to = |rig: &mut Rig, settings: &mut Settings, unpinned: &BTreeSet<String>| {
            let pins = pins.filtered(|table, name| !unpinned.contains(&full_name(table, name)));
            let own = settings_of_scene(opened.values(), &pins, ParameterValues { rig, settings });
            EstimatedParam::apply(
                follows.iter().filter(|estimate| !own.has(estimate.table, estimate.name)),
                rig,
                settings,
            );
            if own.noise().is_none() {
                rig.noise.clone_from(noise);
            }
        };
        let apply_to_edit = |edit: &mut Edit| {
            apply_to(&mut edit.rig, &mut edit.settings, &edit.unpinned);
            if let Some(other) = &mut edit.other {
                apply_to(&mut other.rig, &mut other.settings, &edit.unpinned);
            }
        };
        self.history.change_all(apply_to_edit);
        apply_to_edit(&mut self.saved);
        // Other poses change the placement checks and the variant.
        self.scene_version += 1;
        self.variant_version = self.version + 1;
        self.update_shot();
        Ok(())
    }
}
