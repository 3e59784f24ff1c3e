//! What was found of the footage while a person works.

use std::collections::BTreeSet;
use std::path::PathBuf;

use super::kept::settings_of_scene;
use super::{Edit, Project, full_name};
use locard_engine::analyse::Analysis;
use locard_engine::compositor::Settings;
use locard_engine::profile::{Look, Rig};
use locard_engine::shot::{Follows, ShotError};

impl Project {
    /// Goes on with an analysis of the recording. Scene, history and settings stay. The values that
    /// were found replace those of the recording and the profiles in every step, which is no change
    /// to be saved. Values that the scene or the user sets stay.
    pub fn take_analysis(&mut self, folder: PathBuf, analysis: Analysis) -> Result<(), ShotError> {
        let follows = self.shot.take_analysis(folder, analysis)?;
        let (opened, pins) = (self.opened.clone(), self.pins(&BTreeSet::new()));
        let follow_in = |rig: &mut Rig, settings: &mut Settings, unpinned: &BTreeSet<String>| {
            let pins = pins.filtered(|table, name| !unpinned.contains(&full_name(table, name)));
            let own = settings_of_scene(opened.look(), &pins, Look { rig, settings });
            Follows::apply(follows.iter().filter(|found| !own.has(found.table, found.name)), rig, settings);
        };
        let follow = |edit: &mut Edit| {
            follow_in(&mut edit.rig, &mut edit.settings, &edit.unpinned);
            if let Some(other) = &mut edit.other {
                follow_in(&mut other.rig, &mut other.settings, &edit.unpinned);
            }
        };
        self.history.each(follow);
        follow(&mut self.saved);
        Follows::apply(&follows, &mut self.opened.rig, &mut self.opened.settings);
        // What stands wrong, and what is compared with, are others by other poses.
        self.scene_version += 1;
        self.other_version = self.version + 1;
        self.follow();
        Ok(())
    }
}
